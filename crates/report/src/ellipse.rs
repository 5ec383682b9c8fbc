//! Ellipses of covariances, and how large to draw them.

use mavsight_geometry::{Matrix2, Vector2};
use mavsight_session::RunResults;

/// A typical ellipse of a detection is drawn so large, px.
const ELLIPSE_PX: f64 = 24.0;
/// χ² of two degrees of freedom below which 95 % are.
const CHI2_95: f64 = 5.991;

/// The ellipse around zero that holds 95 % of what has a covariance.
pub(crate) fn ellipse_95(covariance: &Matrix2<f64>) -> Vec<Vector2<f64>> {
    const CORNERS: usize = 40;
    let eigen = covariance.symmetric_eigen();
    let axes = eigen.eigenvectors
        * Matrix2::from_diagonal(&eigen.eigenvalues.map(|v| (CHI2_95 * v.max(0.0)).sqrt()));
    let angle = |k: usize| k as f64 / CORNERS as f64 * std::f64::consts::TAU;
    (0..=CORNERS).map(|k| axes * Vector2::new(angle(k).cos(), angle(k).sin())).collect()
}

/// 1, 2 or 5 times a power of ten, by which the middle one of the detections' ellipses is drawn large enough to be seen.
pub(crate) fn typical_enlargement(results: &RunResults, scale: f64) -> f64 {
    let major = |c: &Matrix2<f64>| (CHI2_95 * c.symmetric_eigenvalues().max()).max(0.0).sqrt();
    let all = results.markers.iter().map(|o| major(&o.covariance_px2)).filter(|v| v.is_finite());
    let Some(middle) = mavsight_pose::median(all.collect()) else { return 1.0 };
    let typical = middle * scale;
    let wanted = (ELLIPSE_PX / typical.max(1e-3)).max(1.0);
    let power = 10f64.powf(wanted.log10().floor());
    [5.0, 2.0].into_iter().find(|step| step * power <= wanted).unwrap_or(1.0) * power
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ellipses_hold_what_they_say() {
        let covariance = Matrix2::new(4.0, 1.5, 1.5, 1.0);
        let inverse = covariance.try_inverse().expect("regular");
        for p in ellipse_95(&covariance) {
            assert!(((inverse * p).dot(&p) - CHI2_95).abs() < 1e-9);
        }
        let flat = ellipse_95(&Matrix2::new(1.0, 1.0, 1.0, 1.0));
        assert!(flat.iter().all(|p| (p.x - p.y).abs() < 1e-6));
    }

    #[test]
    fn the_enlargement_is_a_round_number() {
        let results = |std_px: f64| RunResults {
            markers: vec![mavsight_pose::MarkerObservation {
                t_ns: 0,
                camera: 0,
                marker: 0,
                pixel: Vector2::zeros(),
                covariance_px2: Matrix2::identity() * std_px * std_px,
            }],
            ..RunResults::default()
        };
        // 24 px over 2.448 standard deviations of 0.05 px.
        assert_eq!(typical_enlargement(&results(0.05), 1.0), 100.0);
        assert_eq!(typical_enlargement(&results(0.05), 2.0), 50.0);
        assert_eq!(typical_enlargement(&results(20.0), 1.0), 1.0);
        assert_eq!(typical_enlargement(&RunResults::default(), 1.0), 1.0);
    }
}
