//! What a ball that is not measured itself does to the centre of one that is.

use super::estimator::PoseEstimator;
use crate::reprojection::PointObservation;
use mavsight_geometry::{Isometry3, Point3, Vector2};

/// A ball's image.
struct Disc {
    pixel: Vector2<f64>,
    radius_px: f64,
    depth_m: f64,
}

impl PoseEstimator {
    /// What overlap leaves open of a centre: one standard deviation, towards the other ball.
    ///
    /// Of a ball that shows beside this one's rim, or covers a part of it, and was not measured in this image
    /// itself, the fit of this centre knew nothing. If it takes all of the strip that is not this ball's for a
    /// part of it, the centre moves by half of the strip, and as far the other way if the strip takes from the
    /// rim. Between these bounds all is alike: a standard deviation of the strip over √12 (GUM, JCGM 100:2008,
    /// section 4.3.7). Zero for a ball that no other touches.
    pub(super) fn hidden_px(
        &self,
        o: &PointObservation,
        views: &[PointObservation],
        pose: &Isometry3<f64>,
    ) -> Vector2<f64> {
        let is_measured = |m: usize| views.iter().any(|v| v.camera == o.camera && v.point == m);
        let Some(own) = self.disc(o.camera, o.point, pose) else { return Vector2::zeros() };
        let others = (0..self.markers.len()).filter(|m| !is_measured(*m));
        let strip_px = |other: Disc| {
            let (towards, both_px) = (other.pixel - own.pixel, other.radius_px + own.radius_px);
            let away_px = towards.norm();
            let is_behind = other.depth_m > own.depth_m;
            let strip_px =
                if is_behind { away_px + other.radius_px - own.radius_px } else { both_px - away_px };
            // Of a ball of which more than half is there, the rim is seen as that of another.
            let strip_px = if away_px < both_px { strip_px.clamp(0.0, other.radius_px) } else { 0.0 };
            towards * (strip_px / away_px.max(f64::MIN_POSITIVE))
        };
        let strips = others.filter_map(|m| self.disc(o.camera, m, pose)).map(strip_px);
        strips.max_by(|a, b| a.norm().total_cmp(&b.norm())).unwrap_or_default() / 12_f64.sqrt()
    }

    fn disc(&self, camera: usize, marker: usize, pose: &Isometry3<f64>) -> Option<Disc> {
        let (camera, ball) = (&self.cameras[camera], &self.markers[marker]);
        let centre = pose * Point3::from(ball.marker_in_body_m);
        let pixel = camera.project_ball(&centre.coords, ball.radius_m).ok()?.pixel;
        let depth_m = (camera.cam_from_world * centre).z;
        Some(Disc { pixel, radius_px: camera.intrinsics.fx_px * ball.radius_m / depth_m, depth_m })
    }
}

#[cfg(test)]
mod tests {
    use crate::estimate::tests::body;
    use crate::testing::rig;
    use crate::{MarkerObservation, PoseEstimator};
    use mavsight_geometry::{EulerAngles, Matrix2, Point3, Vector3, world_from_body};

    /// The nearer ball of a diagonal hides the farther one, which shows beside it or not at all.
    #[test]
    fn a_ball_that_was_not_measured_widens_the_claim_of_the_one_before_it() {
        let estimator = PoseEstimator::new(&rig(), &body()).with_centre_bias(0.0).unwrap();
        let camera = rig().cameras[0].camera;
        let towards = camera.centre_in_world();
        let mut widest: f64 = 0.0;
        for k in 0..360 {
            let attitude = EulerAngles { psi_rad: f64::from(k).to_radians(), ..EulerAngles::default() };
            let pose = world_from_body(Vector3::new(0.0, 0.0, towards.z), attitude);
            let seen: Vec<MarkerObservation> = (0..4)
                .map(|marker| {
                    let centre = (pose * Point3::from(body()[marker].marker_in_body_m)).coords;
                    let pixel = camera.project_ball(&centre, body()[marker].radius_m).unwrap().pixel;
                    let covariance_px2 = Matrix2::identity() * 1e-4;
                    MarkerObservation { t_ns: 0, camera: 0, marker, pixel, covariance_px2 }
                })
                .collect();
            let all = estimator.views(seen.iter().copied()).unwrap();
            for o in &all {
                assert_eq!(estimator.hidden_px(o, &all, &pose).norm(), 0.0);
                let alone: Vec<_> = all.iter().copied().filter(|v| v.point == o.point).collect();
                let discs: Vec<_> = (0..4).map(|m| estimator.disc(0, m, &pose).unwrap()).collect();
                let own = &discs[o.point];
                let touches = (0..4)
                    .filter(|m| *m != o.point)
                    .any(|m| (discs[m].pixel - own.pixel).norm() < discs[m].radius_px + own.radius_px);
                let std_px = estimator.hidden_px(o, &alone, &pose).norm();
                assert!(touches || std_px == 0.0, "{std_px} px of a ball that stands alone");
                assert!(std_px <= own.radius_px.max(discs[0].radius_px) * 1.2 / 12_f64.sqrt(), "{std_px}");
                widest = widest.max(std_px / own.radius_px);
            }
        }
        assert!(widest > 0.2, "no ball hid another: {widest}");
    }
}
