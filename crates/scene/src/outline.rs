//! Where in the image a part may be: what lets rays pass by parts that they cannot meet.

use crate::aircraft::Part;
use mavsight_geometry::Camera;
use nalgebra::{Isometry3, Point3, Vector2};

/// A line and a reach about it in the plane of unit depth before the camera, where lines are straight
/// whatever the lens does: no ray outside meets the part at any pose of an exposure.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Outline {
    from: Vector2<f64>,
    to: Vector2<f64>,
    reach: f64,
}

/// Parts that come so near to the camera's own plane have no outline.
const LEAST_DEPTH_M: f64 = 0.05;

impl Outline {
    pub(crate) const ALL: Self =
        Self { from: Vector2::new(0.0, 0.0), to: Vector2::new(0.0, 0.0), reach: f64::INFINITY };

    /// The outline of a part; everywhere where it comes beside or behind the camera.
    pub(crate) fn of(part: &Part, poses: &[Isometry3<f64>], camera: &Camera) -> Self {
        let (core, radius_m) = part.shape.core();
        let mut first = None;
        let (mut moved, mut slope2, mut nearest_m) = (0.0_f64, 0.0_f64, f64::MAX);
        for pose in poses {
            let ends = core.map(|end| (camera.cam_from_world * (pose * Point3::from(end))).coords);
            nearest_m = nearest_m.min(ends[0].z).min(ends[1].z);
            let ends = ends.map(|end| end.xy() / end.z);
            let [from, to] = *first.get_or_insert(ends);
            moved = moved.max((ends[0] - from).norm()).max((ends[1] - to).norm());
            slope2 = slope2.max(ends[0].norm_squared()).max(ends[1].norm_squared());
        }
        let Some([from, to]) = first.filter(|_| nearest_m - radius_m > LEAST_DEPTH_M) else {
            return Self::ALL;
        };
        // A ball of radius r at depth z and slope n appears within r (1 + n²)/(z - r √(1 + n²)) of it.
        let lean = (1.0 + slope2).sqrt();
        let depth_m = nearest_m - radius_m * lean;
        let reach = if depth_m > 0.0 { moved + radius_m * lean * lean / depth_m } else { f64::INFINITY };
        Self { from, to, reach }
    }

    /// Whether a ray within `margin` of a place may meet the part.
    pub(crate) fn may_be_at(&self, place: &Vector2<f64>, margin: f64) -> bool {
        let (along, to_place) = (self.to - self.from, place - self.from);
        let w = (to_place.dot(&along) / along.norm_squared().max(1e-30)).clamp(0.0, 1.0);
        (to_place - along * w).norm_squared() <= (self.reach + margin).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::{Composer, Moving, PART_SAMPLES, Plate};
    use crate::{Aircraft, PaintedBall, Room};
    use mavsight_geometry::{BrownConrady, ImageSize, Intrinsics};
    use nalgebra::Vector3;

    /// Every sample as where rays try all parts, for aircraft that move fast, near and far, behind a lens
    /// that bends lines too.
    #[test]
    fn the_picture_is_that_of_trying_all_parts() {
        let size = ImageSize { width_px: 80, height_px: 60 };
        let balls = [(0.2, 0.2), (-0.2, 0.15)].map(|(x, y)| PaintedBall {
            centre_m: Vector3::new(x, y, 0.1),
            radius_m: 0.03,
            linear: [0.9, 0.05, 0.05],
        });
        let (room, aircraft) = (Room::meeting_room(), Aircraft::helicopter(&balls));
        let plate = Plate { light: vec![[0.2; 3]; size.area_px()], distance_m: vec![20.0; size.area_px()] };
        let bent = BrownConrady { k1: -0.25, k2: 0.06, ..BrownConrady::default() };
        let mut seen = 0;
        for (turn, distortion, far_m) in
            [(0.0, BrownConrady::default(), 0.9), (1.2, bent, 0.8), (2.5, bent, 1.6), (0.7, bent, 0.3)]
        {
            let k = Intrinsics::from_horizontal_fov(size, 1.2);
            let eye = Vector3::new(far_m * f64::cos(turn), far_m * f64::sin(turn), 1.7);
            let mut camera = mavsight_geometry::Camera::looking_at(eye, Vector3::new(0.1, 0.0, 1.5), k, size);
            camera.distortion = distortion;
            let poses: Vec<Isometry3<f64>> = (0..PART_SAMPLES)
                .map(|k| {
                    let share = k as f64 / 8.0 - 0.5;
                    Isometry3::new(
                        Vector3::new(0.06 * share, 0.0, 1.5),
                        Vector3::new(3.0 + 0.2 * share, 0.1, 0.3),
                    )
                })
                .collect();
            let light: Vec<_> = (aircraft.parts.iter())
                .map(|p| crate::light::IrradianceMap::at(&p.bound.0, &room.lamps))
                .collect();
            let moving = Moving { parts: &aircraft.parts, poses: &poses, light: &light };
            let composer = Composer::new(&moving, &camera, &plate);
            let trying_all = composer.clone().trying_all();
            let columns = (0, size.width_px as usize);
            let blank = vec![[0.0_f32; 3]; columns.1 * PART_SAMPLES * PART_SAMPLES];
            let (mut got, mut want) = (blank.clone(), blank);
            for y in 0..size.height_px as usize {
                composer.row(y, columns, &mut got);
                trying_all.row(y, columns, &mut want);
                assert_eq!(got, want, "row {y} at {far_m} m");
                seen += want.iter().filter(|s| s[0] != 0.2).count();
            }
        }
        assert!(seen > 50_000, "{seen} samples of the aircraft");
    }
}
