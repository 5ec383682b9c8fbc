//! States for the integrator.

use differential_equations::traits::State;

/// The most states that [`Short`] holds.
pub(crate) const SHORT: usize = 24;

/// A few states in place: the integrator copies states some fifty times a step, which takes a third longer
/// where each copy is allocated.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Short {
    length: usize,
    /// Zero behind the length.
    values: [f64; SHORT],
}

/// A state as the integrator and the equations of motion take it.
pub(crate) trait Packed: State<f64> {
    /// From numbers; none where it cannot hold so many.
    fn of(values: &[f64]) -> Option<Self>;

    /// Its numbers.
    fn values(&self) -> &[f64];

    /// Its numbers, to be changed.
    fn values_mut(&mut self) -> &mut [f64];
}

impl Packed for Vec<f64> {
    fn of(values: &[f64]) -> Option<Self> {
        Some(values.to_vec())
    }

    fn values(&self) -> &[f64] {
        self
    }

    fn values_mut(&mut self) -> &mut [f64] {
        self
    }
}

impl Packed for Short {
    fn of(values: &[f64]) -> Option<Self> {
        let mut out = Self { length: values.len(), values: [0.0; SHORT] };
        out.values.get_mut(..values.len())?.copy_from_slice(values);
        Some(out)
    }

    fn values(&self) -> &[f64] {
        &self.values[..self.length]
    }

    fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values[..self.length]
    }
}

impl State<f64> for Short {
    fn len(&self) -> usize {
        self.length
    }

    fn get_component(&self, index: usize) -> f64 {
        self.values[index]
    }

    fn set_component(&mut self, index: usize, value: f64) {
        self.values[index] = value;
    }

    fn map_components_mut<F: FnMut(usize, &mut f64)>(&mut self, mut f: F) {
        self.values_mut().iter_mut().enumerate().for_each(|(k, value)| f(k, value));
    }

    fn zeros_like(&self) -> Self {
        Self { length: self.length, values: [0.0; SHORT] }
    }

    fn zeros() -> Self {
        Self { length: 0, values: [0.0; SHORT] }
    }

    fn mul_add_assign(&mut self, alpha: f64, other: &Self) {
        for k in 0..SHORT {
            self.values[k] += alpha * other.values[k];
        }
    }

    fn scale_mut(&mut self, alpha: f64) {
        self.values.iter_mut().for_each(|value| *value *= alpha);
    }

    fn add_scaled(&mut self, alpha: f64, other: &Self) -> &mut Self {
        self.mul_add_assign(alpha, other);
        self
    }

    fn scale_by(&mut self, alpha: f64) -> &mut Self {
        self.scale_mut(alpha);
        self
    }
}
