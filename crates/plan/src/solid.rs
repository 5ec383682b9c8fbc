//! Boxes along the world's axes: rooms, places, obstacles.

use mavsight_geometry::Vector3;
use serde::{Deserialize, Serialize};

/// A box along the world's axes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Solid {
    /// Name for messages and drawings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Corner of the least coordinates.
    pub low_m: [f64; 3],
    /// Corner of the largest.
    pub high_m: [f64; 3],
}

impl Solid {
    /// Middle of the box.
    pub fn middle_m(&self) -> Vector3<f64> {
        (Vector3::from(self.low_m) + Vector3::from(self.high_m)) / 2.0
    }

    /// Whether a point lies in it or on its faces.
    pub fn contains(&self, point_m: &Vector3<f64>) -> bool {
        (0..3).all(|k| point_m[k] >= self.low_m[k] && point_m[k] <= self.high_m[k])
    }

    /// The point of the box that is nearest to a point.
    pub fn nearest_m(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        Vector3::from_fn(|k, _| point_m[k].max(self.low_m[k]).min(self.high_m[k]))
    }

    /// Whether the box cuts the straight line between two points (slab method, Kay & Kajiya 1986); touching
    /// counts.
    pub fn blocks(&self, from_m: &Vector3<f64>, to_m: &Vector3<f64>) -> bool {
        let along = to_m - from_m;
        let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
        for k in 0..3 {
            let (low, high) = (self.low_m[k] - from_m[k], self.high_m[k] - from_m[k]);
            if along[k].abs() < 1e-12 {
                if low > 0.0 || high < 0.0 {
                    return false;
                }
                continue;
            }
            let (a, b) = (low / along[k], high / along[k]);
            (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
        }
        enter <= leave
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pillar() -> Solid {
        Solid { name: None, low_m: [-0.2, -0.2, 0.0], high_m: [0.2, 0.2, 2.0] }
    }

    #[test]
    fn a_pillar_blocks_what_passes_through_and_nothing_else() {
        let at = Vector3::new;
        for (from, to, blocked) in [
            (at(-2.0, 0.0, 1.0), at(2.0, 0.0, 1.0), true),
            (at(-2.0, 0.0, 1.0), at(-0.3, 0.0, 1.0), false),
            (at(-2.0, 0.0, 2.5), at(2.0, 0.0, 2.5), false),
            (at(-2.0, 0.0, 2.5), at(2.0, 0.0, 1.0), true),
            (at(-2.0, 0.3, 1.0), at(2.0, 0.3, 1.0), false),
            (at(0.0, 0.0, 1.0), at(2.0, 0.0, 1.0), true),
        ] {
            assert_eq!(pillar().blocks(&from, &to), blocked, "{from} {to}");
            assert_eq!(pillar().blocks(&to, &from), blocked, "{to} {from}");
        }
    }

    #[test]
    fn the_nearest_point_lies_in_the_box() {
        let near = pillar().nearest_m(&Vector3::new(3.0, 0.1, -1.0));
        assert_eq!(near, Vector3::new(0.2, 0.1, 0.0));
        assert!(pillar().contains(&near) && !pillar().contains(&Vector3::new(0.21, 0.0, 1.0)));
    }
}
