//! Where in the image a part may be: what lets rays pass by parts that they cannot meet.

use crate::aircraft::Part;
use crate::shapes::Shape;
use mavsight_geometry::Camera;
use nalgebra::{Isometry3, Point3, Vector2};

/// A part's bounds in the plane of unit depth before the camera, where lines are straight whatever the lens
/// does, over all poses of an exposure.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Outline {
    low: Vector2<f64>,
    high: Vector2<f64>,
    /// Ends of a bar's axis, and how far from it the bar reaches.
    bar: Option<[Vector2<f64>; 2]>,
    reach: f64,
}

impl Outline {
    /// Everywhere.
    pub(crate) const ALL: Self = Self {
        low: Vector2::new(f64::NEG_INFINITY, f64::NEG_INFINITY),
        high: Vector2::new(f64::INFINITY, f64::INFINITY),
        bar: None,
        reach: 0.0,
    };

    /// The outline of a part; everywhere where it comes beside or behind the camera.
    pub(crate) fn of(part: &Part, poses: &[Isometry3<f64>], camera: &Camera) -> Self {
        let (low, high) = part.shape.bounds();
        let corner = |k: usize| {
            let of = |bit: usize| if k >> bit & 1 == 0 { low[bit] } else { high[bit] };
            Point3::new(of(0), of(1), of(2))
        };
        let mut out = Self { low: Vector2::repeat(f64::MAX), high: Vector2::repeat(f64::MIN), ..Self::ALL };
        let mut nearest_m = f64::MAX;
        for pose in poses {
            let into_cam = camera.cam_from_world * pose;
            for k in 0..8 {
                let at = (into_cam * corner(k)).coords;
                if at.z < LEAST_DEPTH_M {
                    return Self::ALL;
                }
                nearest_m = nearest_m.min(at.z);
                let seen = at.xy() / at.z;
                (out.low, out.high) = (out.low.inf(&seen), out.high.sup(&seen));
            }
        }
        if let Shape::Capsule { from, to, radius } = part.shape {
            let ends = |pose: &Isometry3<f64>| {
                [from, to].map(|end| {
                    let at = (camera.cam_from_world * (pose * Point3::from(end))).coords;
                    at.xy() / at.z
                })
            };
            let first = ends(&poses[0]);
            let moved = poses.iter().map(ends).fold(0.0_f64, |most, now| {
                most.max((now[0] - first[0]).norm()).max((now[1] - first[1]).norm())
            });
            // A ball of radius r at depth z and slope n is seen within r (1 + n²) / (z - r) of its centre.
            let slope2 = out.low.abs().sup(&out.high.abs()).norm_squared();
            out.reach = moved + radius * (1.0 + slope2) / (nearest_m - radius).max(LEAST_DEPTH_M);
            out.bar = Some(first);
        }
        out
    }

    /// Whether a ray within `margin` of a place may meet the part.
    pub(crate) fn may_be_at(&self, place: &Vector2<f64>, margin: f64) -> bool {
        let is_in_box = place.x >= self.low.x - margin
            && place.x <= self.high.x + margin
            && place.y >= self.low.y - margin
            && place.y <= self.high.y + margin;
        is_in_box
            && self.bar.is_none_or(|[from, to]| {
                let (along, to_place) = (to - from, place - from);
                let w = (to_place.dot(&along) / along.norm_squared().max(1e-30)).clamp(0.0, 1.0);
                let reach = self.reach + margin;
                (to_place - along * w).norm_squared() <= reach * reach
            })
    }
}

/// Parts that come so near to the camera's own plane have no outline.
const LEAST_DEPTH_M: f64 = 0.05;

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
