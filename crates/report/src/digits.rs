//! Numbers with as many digits as their standard deviation supports.

/// How a value and its interval are written: two digits of the standard deviation, and a power of ten where the
/// value is small or large.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Digits {
    exponent: i32,
    decimals: usize,
}

/// A value beyond these powers of ten is written with its power.
const PLAIN: std::ops::Range<i32> = -3..5;
/// Digits of a value whose standard deviation is not known.
const WITHOUT_STD: i32 = 4;
const MOST_DECIMALS: i32 = 12;

impl Digits {
    pub(crate) fn of(value: f64, std: f64) -> Self {
        let power = |v: f64| if v > 0.0 && v.is_finite() { v.log10().floor() as i32 } else { 0 };
        let own = power(value.abs().max(std));
        let exponent = if PLAIN.contains(&own) { 0 } else { own };
        let last = if std > 0.0 && std.is_finite() { power(std) - 1 } else { own - WITHOUT_STD };
        Self { exponent, decimals: (exponent - last).clamp(0, MOST_DECIMALS) as usize }
    }

    /// A number with these digits, without the power of ten.
    pub(crate) fn text(self, value: f64) -> String {
        let text = format!("{:.*}", self.decimals, value / 10f64.powi(self.exponent));
        match text.strip_prefix('-') {
            Some(size) if size.chars().all(|c| c == '0' || c == '.') => size.to_owned(),
            Some(size) => format!("−{size}"),
            None => text,
        }
    }

    /// The power of ten as a factor; nothing where it is one.
    pub(crate) fn factor(self) -> String {
        if self.exponent == 0 {
            return String::new();
        }
        let raised = |c: char| match c {
            '-' => '⁻',
            c => c.to_digit(10).and_then(|d| "⁰¹²³⁴⁵⁶⁷⁸⁹".chars().nth(d as usize)).unwrap_or(c),
        };
        format!("·10{}", self.exponent.to_string().chars().map(raised).collect::<String>())
    }

    /// Value, standard deviation, power of ten and unit.
    pub(crate) fn with_std(self, value: f64, std: f64, unit: &str) -> String {
        let both = format!("{} ± {}", self.text(value), self.text(std));
        let both = if self.exponent == 0 { both } else { format!("({both}){}", self.factor()) };
        format!("{both} {unit}").trim_end().to_owned()
    }
}

/// A number to two digits, for sentences.
pub(crate) fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let digits = (1 - value.abs().log10().floor() as i32).clamp(0, MOST_DECIMALS) as usize;
    format!("{value:.digits$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_those_that_the_standard_deviation_supports() {
        let shown = |value, std| Digits::of(value, std).with_std(value, std, "s");
        assert_eq!(shown(-0.013_512_4, 0.000_481_3), "−0.01351 ± 0.00048 s");
        assert_eq!(shown(1.396e-6, 1.77e-6), "(1.4 ± 1.8)·10⁻⁶ s");
        assert_eq!(shown(-2.432e-5, 1.9e-10), "(−2.432000 ± 0.000019)·10⁻⁵ s");
        assert_eq!(shown(123_456.0, 1200.0), "(1.235 ± 0.012)·10⁵ s");
        assert_eq!(shown(3.0, 40.0), "3 ± 40 s");
        assert_eq!(shown(-0.001, 0.3), "0.00 ± 0.30 s");
        assert_eq!(
            (short(0.4163), short(12.345), short(1234.5)),
            ("0.42".into(), "12".into(), "1234".into())
        );
    }

    #[test]
    fn a_value_without_a_standard_deviation_and_none_at_all_are_written() {
        assert_eq!(Digits::of(3.5, 0.0).text(3.5), "3.5000");
        assert_eq!(Digits::of(0.0, 0.0).text(0.0), "0.0000");
        assert_eq!(Digits::of(f64::NAN, f64::NAN).text(f64::NAN), "NaN");
    }
}
