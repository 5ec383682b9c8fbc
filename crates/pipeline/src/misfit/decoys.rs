//! Balls of a marker's colour and size that stand in the room.

use crate::spread::Spread;
use mavsight_geometry::{Camera, ImagePoint, Matrix2, Vector2, Vector3, triangulate};
use mavsight_pose::{Association, BodyMarker, Rig, TrackedDetection};
use std::collections::BTreeMap;

/// Part of the instants in which what stands is seen: half of that in which a marker counts as seen throughout.
const OFTEN: f64 = 0.45;

/// Rays that miss each other by less meet, in pixels: systematic errors of centres, of the cameras, and of what
/// is no ball.
const MEETS_PX: f64 = 2.0;

/// Largest ratio between the diameter seen and that of a marker's ball there.
const ALIKE: f64 = 1.6;

/// Detections that no marker has, track by track, of colours of which a camera sees more than there are markers.
#[derive(Debug, Default)]
pub(crate) struct Unclaimed {
    instants: usize,
    tracks: BTreeMap<(usize, usize, u32), Sums>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    spread: Spread,
    diameter_px: f64,
}

impl Sums {
    fn stands(&self, instants: usize) -> bool {
        self.spread.count() as f64 >= (OFTEN * instants as f64).max(3.0) && self.spread.stands()
    }

    fn mean_diameter_px(&self) -> f64 {
        self.diameter_px / self.spread.count() as f64
    }
}

impl Unclaimed {
    pub(crate) fn take(&mut self, seen: &[TrackedDetection], colors: &[usize], found: &Association) {
        self.instants += 1;
        for (k, own) in seen.iter().enumerate() {
            let alike = seen.iter().filter(|s| (s.camera, s.color) == (own.camera, own.color)).count();
            let markers = colors.iter().filter(|c| **c == own.color).count();
            if alike <= markers || found.pairs.iter().any(|(index, _)| *index == k) {
                continue;
            }
            let sums = self.tracks.entry((own.camera, own.color, own.track_id)).or_default();
            sums.spread.add(&own.pixel);
            sums.diameter_px += own.diameter_px;
        }
    }

    /// Colours of balls that two cameras see at one place of the room, standing and as large as a marker's, and
    /// those places.
    pub(crate) fn balls(
        &self,
        rig: &Rig,
        markers: &[BodyMarker],
        colors: &[usize],
    ) -> Vec<(usize, Vector3<f64>)> {
        let standing: Vec<_> = self.tracks.iter().filter(|(_, s)| s.stands(self.instants)).collect();
        let mut out: Vec<(usize, Vector3<f64>)> = Vec::new();
        for (k, ((camera, color, _), one)) in standing.iter().enumerate() {
            for ((other_camera, other_color, _), other) in &standing[k + 1..] {
                if camera == other_camera || color != other_color || out.iter().any(|o| o.0 == *color) {
                    continue;
                }
                let marker = colors.iter().position(|c| c == color).and_then(|m| markers.get(m));
                let Some(marker) = marker else { continue };
                let image = |camera: usize, sums: &Sums| -> BallImage<'_> {
                    (&rig.cameras[camera].camera, sums.spread.middle(), sums.mean_diameter_px())
                };
                let place = place([image(*camera, one), image(*other_camera, other)], 2.0 * marker.radius_m);
                out.extend(place.map(|place| (*color, place)));
            }
        }
        out
    }
}

/// A ball's image in a camera: its centre and its diameter.
pub(super) type BallImage<'a> = (&'a Camera, Vector2<f64>, f64);

/// Where two images show one ball of this diameter, if they do.
pub(super) fn place(images: [BallImage<'_>; 2], diameter_m: f64) -> Option<Vector3<f64>> {
    let points =
        images.map(|(camera, pixel, _)| ImagePoint { camera, pixel, covariance_px2: Matrix2::identity() });
    let met = triangulate(&points).ok()?;
    let at = met.point_in_world_m;
    let is_as_large = images.iter().all(|(view, _, diameter_px)| {
        let focal_px = (view.intrinsics.fx_px * view.intrinsics.fy_px).abs().sqrt();
        let expected_px = focal_px * diameter_m / (at - view.centre_in_world()).norm();
        (1.0 / ALIKE..=ALIKE).contains(&(diameter_px / expected_px))
    });
    (met.residual_px < MEETS_PX && is_as_large).then_some(at)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body_markers;
    use crate::testing::rig;
    use mavsight_flight::Vehicle;
    use mavsight_pose::{PoseError, PoseSample};

    /// A second ball of colour 3 in cameras 0 and 1, at places of the room.
    fn found(at: [Vector3<f64>; 2], diameter_m: f64) -> Vec<(usize, Vector3<f64>)> {
        let (rig, body) = (rig(), body_markers(&Vehicle::paper()));
        let colors = [0, 1, 2, 3];
        let mut unclaimed = Unclaimed::default();
        for k in 0..30 {
            let see = |camera: usize, at: Vector3<f64>, track_id| {
                let view = &rig.cameras[camera].camera;
                TrackedDetection {
                    t_ns: k,
                    camera,
                    track_id,
                    color: 3,
                    pixel: view.project(&at).unwrap().pixel,
                    covariance_px2: Matrix2::identity() * 0.01,
                    diameter_px: view.intrinsics.fx_px * diameter_m / (at - view.centre_in_world()).norm(),
                    is_static: false,
                    is_preferred: false,
                }
            };
            let own = Vector3::new(0.01 * k as f64, 0.0, 1.5);
            let seen = [see(0, own, 1), see(0, at[0], 2), see(1, own, 1), see(1, at[1], 2)];
            let sample = PoseSample {
                t_ns: k,
                estimate: Err(PoseError::TooFewMarkers { seen: 1, markers: 4, observations: 2 }),
            };
            unclaimed.take(&seen, &colors, &Association { sample, pairs: vec![(0, 3), (2, 3)] });
        }
        unclaimed.balls(&rig, &body, &colors)
    }

    #[test]
    fn a_ball_that_two_cameras_see_standing_is_a_decoy_and_clutter_is_not() {
        let at = Vector3::new(0.7, 0.4, 1.2);
        let [(3, place)] = found([at, at], 0.05)[..] else { panic!("{:?}", found([at, at], 0.05)) };
        assert!((place - at).norm() < 1e-6, "{place}");
        assert_eq!(found([at, at + Vector3::new(0.3, 0.0, 0.5)], 0.05), vec![]);
        assert_eq!(found([at, at], 0.15), vec![]);
    }
}
