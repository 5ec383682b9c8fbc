//! The discrete filter that passes what the smoother passes.

/// Band of the penalty matrix: third differences reach three samples.
const BAND: usize = 3;
const STENCIL: [f64; 4] = [-1.0, 3.0, -3.0, 1.0];

/// Whittaker-Henderson smoothing with third differences: the response of [`crate::smooth`], zero phase.
///
/// Minimises Σ (x - y)² + λ Σ (Δ³x)² with λ such that the response 1/(1 + λ (2 sin(π f dt))⁶) is one half at
/// `bandwidth_hz` (Whittaker 1923; Eilers 2003). Quadratics pass unchanged. A bandwidth at or above the
/// Nyquist frequency, a series under 4 samples, and arguments that are not positive return it as it is.
pub fn lowpass_like(series: &[f64], dt_s: f64, bandwidth_hz: f64) -> Vec<f64> {
    let n = series.len();
    let valid = dt_s > 0.0 && bandwidth_hz > 0.0 && dt_s.is_finite() && bandwidth_hz.is_finite();
    if n <= BAND || !valid || bandwidth_hz * dt_s >= 0.5 {
        return series.to_vec();
    }
    let lambda = (2.0 * (std::f64::consts::PI * bandwidth_hz * dt_s).sin()).powi(-6);
    // x = y - Dᵀ z with (I/λ + D Dᵀ) z = D y is the same as (I + λ DᵀD) x = y, but exact for quadratics at
    // any λ.
    let m = n - BAND;
    let differences: Vec<f64> = (0..m).map(|i| (0..4).map(|k| STENCIL[k] * series[i + k]).sum()).collect();
    let band: [f64; BAND + 1] =
        std::array::from_fn(|offset| (0..=BAND - offset).map(|k| STENCIL[k] * STENCIL[k + offset]).sum());
    let z = banded_solve(&band, 1.0 / lambda, differences);
    let mut out = series.to_vec();
    for (i, z) in z.iter().enumerate() {
        for (k, c) in STENCIL.iter().enumerate() {
            out[i + k] -= c * z;
        }
    }
    out
}

/// Solves a banded system with equal rows by its Cholesky factor, which is kept by rows: `row[k]` is the
/// entry k columns left of the diagonal.
fn banded_solve(band: &[f64; BAND + 1], ridge: f64, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    let mut factor: Vec<[f64; BAND + 1]> = Vec::with_capacity(n);
    for i in 0..n {
        let mut row = [0.0; BAND + 1];
        for offset in (1..=BAND.min(i)).rev() {
            let left = &factor[i - offset];
            let known = (1..=BAND - offset).map(|k| row[offset + k] * left[k]).sum::<f64>();
            row[offset] = (band[offset] - known) / left[0];
        }
        let known = row.iter().map(|x| x * x).sum::<f64>();
        row[0] = (band[0] + ridge - known).max(f64::MIN_POSITIVE).sqrt();
        let known = (1..=BAND.min(i)).map(|k| row[k] * b[i - k]).sum::<f64>();
        b[i] = (b[i] - known) / row[0];
        factor.push(row);
    }
    for i in (0..n).rev() {
        let known = (1..=BAND.min(n - 1 - i)).map(|k| factor[i + k][k] * b[i + k]).sum::<f64>();
        b[i] = (b[i] - known) / factor[i][0];
    }
    b
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use std::f64::consts::PI;

    #[test]
    fn it_is_the_dense_solution_of_its_definition() {
        let n = 25;
        let y = DVector::from_fn(n, |i, _| (i as f64 * 1.3).sin() + 0.1 * i as f64);
        let (dt, fc) = (0.1, 1.2);
        let lambda = (2.0 * (PI * fc * dt).sin()).powi(-6);
        let d = DMatrix::from_fn(n - 3, n, |i, j| if j >= i && j < i + 4 { STENCIL[j - i] } else { 0.0 });
        let dense = (DMatrix::identity(n, n) + d.transpose() * &d * lambda).lu().solve(&y).unwrap();
        let banded = lowpass_like(y.as_slice(), dt, fc);
        assert!((DVector::from_vec(banded) - dense).norm() < 1e-10);
    }

    #[test]
    fn a_quadratic_passes_unchanged() {
        let y: Vec<f64> =
            (0..300).map(|i| f64::from(i) / 30.0).map(|t| 1.0 - 2.0 * t + 0.7 * t * t).collect();
        let smooth = lowpass_like(&y, 1.0 / 30.0, 0.05);
        assert!(y.iter().zip(&smooth).all(|(a, b)| (a - b).abs() < 1e-8));
    }

    #[test]
    fn a_sine_is_scaled_by_the_response() {
        let (dt, fc) = (1.0 / 100.0, 2.0);
        for f in [0.5, 1.0, 2.0, 3.0, 5.0] {
            let y: Vec<f64> = (0..4000).map(|i| (2.0 * PI * f * f64::from(i) * dt).sin()).collect();
            let smooth = lowpass_like(&y, dt, fc);
            let middle = 1000..3000;
            let project = |x: &[f64]| middle.clone().map(|i| x[i] * y[i]).sum::<f64>();
            let gain = project(&smooth) / project(&y);
            let want = 1.0 / (1.0 + (f / fc).powi(6));
            assert!((gain - want).abs() < 0.01, "at {f} Hz {gain} against {want}");
        }
    }

    #[test]
    fn what_cannot_be_smoothed_comes_back() {
        let y = vec![1.0, 5.0, -2.0];
        assert_eq!(lowpass_like(&y, 0.1, 1.0), y);
        let y = vec![1.0, 5.0, -2.0, 3.0, 9.0];
        assert_eq!(lowpass_like(&y, 0.1, 5.0), y);
        assert_eq!(lowpass_like(&y, f64::NAN, 1.0), y);
        assert_eq!(lowpass_like(&[], 0.1, 1.0), Vec::<f64>::new());
    }
}
