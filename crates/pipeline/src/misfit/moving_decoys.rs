//! Balls of a marker's colour and size that move through the room while the body is seen elsewhere.

use super::decoys::{BallImage, place};
use mavsight_geometry::{Camera, Point3, Vector3};
use mavsight_pose::{Association, BodyMarker, TrackedDetection};

/// Instants in a row at which the rays of two tracks have to meet: those of two objects meet at one instant in a hundred, four
/// pixels of an image's height.
const LEAST_INSTANTS: usize = 5;

/// Pairs of tracks that are followed at a time: more are clutter.
const MOST_FOLLOWED: usize = 64;

/// A decoy that moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct MovingDecoy {
    pub(crate) color: usize,
    /// When and where it was first seen.
    pub(crate) from: (i64, Vector3<f64>),
    /// When and where it was further from there than it is large.
    pub(crate) to: (i64, Vector3<f64>),
}

/// Two cameras' tracks whose rays meet.
#[derive(Debug)]
struct Followed {
    /// Camera and track.
    tracks: [(usize, u32); 2],
    from: (i64, Vector3<f64>),
    instants: usize,
}

/// Looks for decoys that move, one of each colour.
#[derive(Debug, Default)]
pub(crate) struct MovingDecoys {
    following: Vec<Followed>,
    found: Vec<MovingDecoy>,
}

impl MovingDecoys {
    pub(crate) fn found(&self) -> &[MovingDecoy] {
        &self.found
    }

    /// Takes an instant. What is looked at are detections that no marker has, in cameras that see every marker of their colour
    /// elsewhere, where there is a pose.
    pub(crate) fn take(
        &mut self,
        cameras: &[Camera],
        markers: &[BodyMarker],
        colors: &[usize],
        seen: &[TrackedDetection],
        association: &Association,
    ) {
        let Ok(estimate) = &association.sample.estimate else { return };
        let pairs = &association.pairs;
        let is_free = |k: &usize| {
            let own = &seen[*k];
            let is_alike = |(index, marker): &&(usize, usize)| {
                seen[*index].camera == own.camera && colors[*marker] == own.color
            };
            let all = colors.iter().filter(|c| **c == own.color).count();
            let is_new = self.found.iter().all(|f| f.color != own.color);
            is_new && !pairs.iter().any(|p| p.0 == *k) && pairs.iter().filter(is_alike).count() == all
        };
        let free: Vec<usize> = (0..seen.len()).filter(is_free).collect();
        let t_ns = association.sample.t_ns;
        for (n, i) in free.iter().enumerate() {
            for j in &free[n + 1..] {
                let (a, b) = (&seen[*i], &seen[*j]);
                if a.camera == b.camera || a.color != b.color {
                    continue;
                }
                let own = || markers.iter().zip(colors).filter(|(_, color)| **color == a.color);
                let Some((marker, _)) = own().next() else { continue };
                let diameter_m = 2.0 * marker.radius_m;
                let image = |s: &TrackedDetection| -> Option<BallImage<'_>> {
                    Some((cameras.get(s.camera)?, s.pixel, s.diameter_px))
                };
                let tracks = [(a.camera, a.track_id), (b.camera, b.track_id)];
                let met = image(a).zip(image(b)).and_then(|(a, b)| place([a, b], diameter_m));
                // A marker of which a camera sees two parts is no other ball.
                let is_apart = |at: &Vector3<f64>| {
                    let marker_m =
                        |m: &BodyMarker| (estimate.world_from_body * Point3::from(m.marker_in_body_m)).coords;
                    own().all(|(m, _)| (marker_m(m) - at).norm() > 2.0 * diameter_m)
                };
                match met.filter(is_apart) {
                    Some(at) => self.follow(a.color, tracks, (t_ns, at), diameter_m),
                    None => self.following.retain(|f| f.tracks != tracks),
                }
            }
        }
    }

    fn follow(&mut self, color: usize, tracks: [(usize, u32); 2], to: (i64, Vector3<f64>), diameter_m: f64) {
        let Some(own) = self.following.iter_mut().find(|f| f.tracks == tracks) else {
            if self.following.len() == MOST_FOLLOWED {
                self.following.remove(0);
            }
            self.following.push(Followed { tracks, from: to, instants: 1 });
            return;
        };
        own.instants += 1;
        let is_new = self.found.iter().all(|f| f.color != color);
        if is_new && own.instants >= LEAST_INSTANTS && (to.1 - own.from.1).norm() > diameter_m {
            self.found.push(MovingDecoy { color, from: own.from, to });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body_markers;
    use crate::testing::rig;
    use mavsight_flight::Vehicle;
    use mavsight_geometry::{Isometry3, Matrix2};
    use mavsight_pose::{MarkerObservation, PoseEstimator, PoseSample};

    /// A second ball of the third marker's colour, along a way in each of two cameras.
    fn found(ways: [&dyn Fn(f64) -> Vector3<f64>; 2]) -> Vec<MovingDecoy> {
        let (rig, body) = (rig(), body_markers(&Vehicle::paper()));
        let cameras: Vec<Camera> = rig.cameras.iter().map(|c| c.camera).collect();
        let estimator = PoseEstimator::new(&rig, &body);
        let pose = Isometry3::translation(0.0, 0.0, 1.5);
        let colors: Vec<usize> = (0..body.len()).collect();
        let mut decoys = MovingDecoys::default();
        for k in 0..12 {
            let t_ns = k * 33_333_333;
            let see = |camera: usize, at: Vector3<f64>, color: usize, track_id: u32| {
                let seen = cameras[camera].project_ball(&at, body[color].radius_m).unwrap();
                let range_m = (at - cameras[camera].centre_in_world()).norm();
                TrackedDetection {
                    t_ns,
                    camera,
                    track_id,
                    color,
                    pixel: seen.pixel,
                    covariance_px2: Matrix2::identity() * 1e-2,
                    diameter_px: cameras[camera].intrinsics.fx_px * 2.0 * body[color].radius_m / range_m,
                    is_static: false,
                    is_preferred: true,
                }
            };
            let at = |m: usize| (pose * Point3::from(body[m].marker_in_body_m)).coords;
            let places = (0..2).flat_map(|camera| (0..body.len()).map(move |m| (camera, m)));
            let mut seen: Vec<_> =
                places.clone().map(|(camera, m)| see(camera, at(m), m, m as u32)).collect();
            let observed: Vec<MarkerObservation> =
                seen.iter().map(|s| MarkerObservation { t_ns, ..s.of_marker(s.color) }).collect();
            let estimate = estimator.estimate(t_ns, &observed, Some(&pose));
            let pairs = places.enumerate().map(|(index, (_, m))| (index, m)).collect();
            let since_s = k as f64 / 30.0;
            seen.extend([see(0, ways[0](since_s), 2, 9), see(1, ways[1](since_s), 2, 9)]);
            let association = Association { sample: PoseSample { t_ns, estimate }, pairs };
            decoys.take(&cameras, &body, &colors, &seen, &association);
        }
        decoys.found().to_vec()
    }

    #[test]
    fn a_ball_that_is_carried_past_is_a_decoy_and_what_two_cameras_see_apart_is_not() {
        let start_m = Vector3::new(0.5, 0.2, 1.2);
        let carried = |t: f64| start_m + Vector3::new(0.6, -0.3, 0.1) * t;
        let all = found([&carried, &carried]);
        let [one] = &all[..] else { panic!("{all:?}") };
        assert!(one.color == 2 && one.from.0 == 0 && (one.from.1 - start_m).norm() < 5e-3, "{one:?}");
        assert!((one.to.1 - carried(one.to.0 as f64 * 1e-9)).norm() < 5e-3, "{one:?}");
        let standing = |_: f64| start_m;
        assert_eq!(found([&standing, &standing]), vec![]);
        let other = |t: f64| start_m + Vector3::new(-0.2, 0.1, 0.5) * (1.0 + t);
        assert_eq!(found([&carried, &other]), vec![]);
    }
}
