//! The numbers of a field, in as little memory as they need.

/// Numbers in the order of their times.
#[derive(Debug, Clone)]
pub(crate) enum Values {
    /// One number throughout, as an output has that is not used; whether numbers after it fit in 32 bits.
    Constant { value: f64, count: usize, is_single: bool },
    /// Numbers that the log has in 32 bits or fewer.
    Single(Vec<f32>),
    /// Others.
    Double(Vec<f64>),
}

impl Values {
    /// None yet; `is_single` where every one will be exact in 32 bits.
    pub(crate) fn new(is_single: bool) -> Self {
        Self::Constant { value: f64::NAN, count: 0, is_single }
    }

    pub(crate) fn push(&mut self, next: f64) {
        match self {
            Self::Constant { value, count, .. } if *count == 0 || value.to_bits() == next.to_bits() => {
                *value = next;
                *count += 1;
            }
            Self::Constant { value, count, is_single } => {
                *self = if *is_single {
                    Self::Single(vec![*value as f32; *count])
                } else {
                    Self::Double(vec![*value; *count])
                };
                self.push(next);
            }
            Self::Single(all) => all.push(next as f32),
            Self::Double(all) => all.push(next),
        }
    }

    /// Multiplies all.
    pub(crate) fn scale(&mut self, factor: f64) {
        if factor != 1.0 {
            *self = Self::Double(self.iter().map(|value| value * factor).collect());
        }
    }

    /// Gives back the room that was kept for more.
    pub(crate) fn shrink(&mut self) {
        match self {
            Self::Constant { .. } => {}
            Self::Single(all) => all.shrink_to_fit(),
            Self::Double(all) => all.shrink_to_fit(),
        }
    }

    pub(crate) fn len(&self) -> usize {
        match self {
            Self::Constant { count, .. } => *count,
            Self::Single(all) => all.len(),
            Self::Double(all) => all.len(),
        }
    }

    pub(crate) fn get(&self, k: usize) -> Option<f64> {
        match self {
            Self::Constant { value, count, .. } => (k < *count).then_some(*value),
            Self::Single(all) => all.get(k).map(|value| f64::from(*value)),
            Self::Double(all) => all.get(k).copied(),
        }
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = f64> + '_ {
        (0..self.len()).map(|k| self.get(k).unwrap_or(f64::NAN))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_back_however_they_are_kept() {
        let all = [[0.0, 0.0, 0.5, -1.0], [f64::NAN, f64::NAN, 2.0, 2.0], [7.0; 4]];
        for (is_single, numbers) in all.iter().flat_map(|numbers| [(true, numbers), (false, numbers)]) {
            let mut values = Values::new(is_single);
            assert_eq!((values.len(), values.get(0)), (0, None));
            numbers.iter().for_each(|value| values.push(*value));
            let bits = |value: f64| value.to_bits();
            assert!(values.iter().map(bits).eq(numbers.iter().copied().map(bits)), "{values:?}");
            assert_eq!(matches!(values, Values::Constant { .. }), numbers == &[7.0; 4]);
            values.scale(0.1);
            values.shrink();
            assert!(values.iter().map(bits).eq(numbers.iter().map(|v| bits(v * 0.1))), "{values:?}");
            assert_eq!(values.get(4), None);
        }
    }
}
