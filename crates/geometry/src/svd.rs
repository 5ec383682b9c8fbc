//! Singular values of small dense matrices by one-sided Jacobi rotations.
//!
//! nalgebra's own SVD loses digits on small matrices with repeated or tiny singular values (its issues 1117
//! and 1172), which are those of rigid fits and null vectors:
//! `tests::nalgebra_fails_on_a_matrix_of_nearly_rank_one`.

use nalgebra::{DMatrix, DVector};

/// A = U diag(σ) Vᵀ with orthonormal columns, singular values descending.
#[derive(Debug, Clone)]
pub struct Svd {
    /// Left singular vectors, rows × min(rows, columns).
    pub u: DMatrix<f64>,
    /// Singular values, descending, non-negative.
    pub singular_values: DVector<f64>,
    /// Right singular vectors as columns, columns × min(rows, columns).
    pub v: DMatrix<f64>,
}

/// Sweeps after which the rotations stop; convergence is quadratic and takes 6 to 10 for such sizes.
const MAX_SWEEPS: usize = 60;

/// Singular value decomposition by one-sided Jacobi (Hestenes 1958; Demmel & Veselić 1992 for its relative
/// accuracy).
///
/// With rows ≥ columns `v` is square, so its last columns span the null space. Zero, empty and not finite
/// matrices yield zero singular values and unit vectors.
pub fn jacobi_svd(a: &DMatrix<f64>) -> Svd {
    if a.nrows() < a.ncols() {
        let t = jacobi_svd(&a.transpose());
        return Svd { u: t.v, singular_values: t.singular_values, v: t.u };
    }
    let (scale, n) = (a.amax(), a.ncols());
    let mut v = DMatrix::identity(n, n);
    if n == 0 || scale == 0.0 || !scale.is_finite() {
        return Svd { u: DMatrix::identity(a.nrows(), n), singular_values: DVector::zeros(n), v };
    }
    let mut work = a / scale;
    let negligible = f64::EPSILON * work.norm();
    for _ in 0..MAX_SWEEPS {
        let mut rotated = false;
        for p in 0..n {
            for q in p + 1..n {
                if let Some((c, s)) = rotation(&work, p, q, negligible) {
                    rotate(&mut work, p, q, c, s);
                    rotate(&mut v, p, q, c, s);
                    rotated = true;
                }
            }
        }
        if !rotated {
            break;
        }
    }
    let norms: Vec<f64> = work.column_iter().map(|c| c.norm()).collect();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| norms[j].total_cmp(&norms[i]));
    // The columns are orthogonal, so Q of their QR has them at unit length, and unit vectors across where
    // they vanish.
    let u = work.select_columns(&order).qr().q();
    let singular_values = DVector::from_iterator(n, order.iter().map(|&j| norms[j] * scale));
    Svd { u, singular_values, v: v.select_columns(&order) }
}

/// Cosine and sine that make two columns orthogonal; `None` when they already are, to rounding.
fn rotation(work: &DMatrix<f64>, p: usize, q: usize, negligible: f64) -> Option<(f64, f64)> {
    let alpha = work.column(p).norm_squared();
    let beta = work.column(q).norm_squared();
    let gamma = work.column(p).dot(&work.column(q));
    let size = (alpha * beta).sqrt();
    if gamma.abs() <= 4.0 * f64::EPSILON * size || alpha.min(beta).sqrt() <= 0.1 * negligible {
        return None;
    }
    let zeta = (beta - alpha) / (2.0 * gamma);
    let t = zeta.signum() / (zeta.abs() + zeta.hypot(1.0));
    let c = 1.0 / t.hypot(1.0);
    Some((c, c * t))
}

fn rotate(m: &mut DMatrix<f64>, p: usize, q: usize, c: f64, s: f64) {
    for row in 0..m.nrows() {
        let (x, y) = (m[(row, p)], m[(row, q)]);
        m[(row, p)] = c * x - s * y;
        m[(row, q)] = s * x + c * y;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn check(a: &DMatrix<f64>, tolerance: f64) {
        let svd = jacobi_svd(a);
        let k = a.nrows().min(a.ncols());
        let back = &svd.u * DMatrix::from_diagonal(&svd.singular_values) * svd.v.transpose();
        let scale = a.norm().max(f64::MIN_POSITIVE);
        assert!((back - a).norm() <= tolerance * scale, "reconstruction of {a}");
        assert!((svd.u.transpose() * &svd.u - DMatrix::identity(k, k)).norm() < tolerance, "U of {a}");
        assert!((svd.v.transpose() * &svd.v - DMatrix::identity(k, k)).norm() < tolerance, "V of {a}");
        assert!(svd.singular_values.as_slice().windows(2).all(|w| w[0] >= w[1] && w[1] >= 0.0));
    }

    /// An orthogonal matrix from Householder reflections, built without any decomposition.
    fn orthogonal(n: usize, seeds: &[f64]) -> DMatrix<f64> {
        let mut q = DMatrix::identity(n, n);
        for k in 0..n {
            let w = DVector::from_fn(n, |i, _| seeds[(k * n + i) % seeds.len()] + 0.1);
            q -= (&w * 2.0 / w.norm_squared()) * (w.transpose() * &q);
        }
        q
    }

    proptest! {
        #[test]
        fn repeated_and_tiny_singular_values_of_4x4(
            seeds in proptest::collection::vec(-1.0..1.0, 32),
            exponents in proptest::collection::vec(-18i32..=0, 4),
            repeat in any::<bool>(),
        ) {
            let mut sigma: Vec<f64> = exponents.iter().map(|&e| 10f64.powi(e)).collect();
            if repeat {
                sigma[1] = sigma[0];
                sigma[3] = sigma[2];
            }
            let a = orthogonal(4, &seeds[..16])
                * DMatrix::from_diagonal(&DVector::from_vec(sigma.clone()))
                * orthogonal(4, &seeds[16..]).transpose();
            check(&a, 1e-13);
            sigma.sort_by(|x, y| y.total_cmp(x));
            let got = jacobi_svd(&a).singular_values;
            for (want, got) in sigma.iter().zip(got.iter()) {
                prop_assert!((want - got).abs() <= 1e-14 * sigma[0], "{want} against {got}");
            }
        }

        #[test]
        fn nearly_collinear_3x3(d in proptest::collection::vec(-1.0..1.0, 3), noise in proptest::collection::vec(-1.0..1.0, 9),
            e in -17i32..-3)
        {
            let d = DVector::from_vec(d);
            let a = &d * d.transpose() + DMatrix::from_vec(3, 3, noise) * 10f64.powi(e);
            check(&a, 1e-13);
        }

        #[test]
        fn tall_wide_and_deficient(values in proptest::collection::vec(-1.0..1.0, 8 * 12), rows in 1usize..12, rank in 1usize..8) {
            let cols = 96 / 12;
            let a = DMatrix::from_fn(rows, cols, |i, j| values[(i % rank) * cols + j]);
            check(&a, 1e-13);
        }
    }

    #[test]
    fn the_null_vector_of_an_ill_conditioned_matrix_is_found() {
        let seeds: Vec<f64> = (0..64).map(|i| (f64::from(i) * 1.7).sin()).collect();
        let (u, v) = (orthogonal(4, &seeds[..20]), orthogonal(4, &seeds[20..]));
        let sigma = DVector::from_vec(vec![1.0, 1e-5, 1e-10, 0.0]);
        let a = u * DMatrix::from_diagonal(&sigma) * v.transpose();
        let null = jacobi_svd(&a).v.column(3).into_owned();
        assert!(1.0 - null.dot(&v.column(3)).abs() < 1e-10);
    }

    #[test]
    fn zero_and_empty_matrices_return() {
        check(&DMatrix::zeros(3, 2), 1e-15);
        assert_eq!(jacobi_svd(&DMatrix::zeros(0, 0)).singular_values.len(), 0);
    }

    /// When this fails, nalgebra has become accurate enough: its decomposition can take the place of this
    /// one.
    #[test]
    fn nalgebra_fails_on_a_matrix_of_nearly_rank_one() {
        #[rustfmt::skip]
        let nearly_collinear = DMatrix::from_row_slice(3, 3, &[
            0.009134626016893606, -0.08679021712027082, -0.09557523746710349,
            -0.08679021712027012, 0.8246141411649827, 0.9080826730892855,
            -0.0955752374671032, 0.9080826730892855, 1.0,
        ]);
        check(&nearly_collinear, 1e-13);
        let back = nearly_collinear.clone().svd(true, true).recompose().expect("both sides were asked for");
        let error = (back - &nearly_collinear).norm() / nearly_collinear.norm();
        assert!(error > 0.01, "{error}");
    }
}
