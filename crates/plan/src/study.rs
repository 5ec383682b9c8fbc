//! The study of two cameras: error against the angle between them, and against their distance.

use crate::{Placed, Planner, Prediction};
use mavsight_geometry::Vector3;
use rayon::prelude::*;
use serde::Serialize;

/// One row of a study.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StudyRow {
    /// Angle between the optical axes.
    pub angle_deg: f64,
    /// Distance of both cameras from the middle of the volume.
    pub distance_m: f64,
    /// Whether both places are allowed in the room.
    pub is_allowed: bool,
    /// Prediction for these cameras.
    pub prediction: Prediction,
}

/// Steps along each side of the volume.
const STEPS: usize = 5;

impl Planner {
    /// Two cameras of one type at the height of the volume's middle, at a distance from it, with an angle
    /// between their axes; they stand on the side of -Y, as in the paper.
    pub fn pair(&self, kind: usize, angle_deg: f64, distance_m: f64) -> [Placed; 2] {
        let middle = self.room().middle_m();
        [0.5, -0.5].map(|side| {
            let turn = (side * angle_deg).to_radians();
            let centre_m = middle + Vector3::new(turn.sin(), -turn.cos(), 0.0) * distance_m;
            Placed { kind, centre_m, aim_m: middle }
        })
    }

    /// Predicted errors of such pairs, each at an angle in degrees and a distance in metres.
    pub fn study(&self, kind: usize, pairs: &[(f64, f64)]) -> Vec<StudyRow> {
        let poses = self.room.poses(STEPS);
        let row = |(angle_deg, distance_m): &(f64, f64)| {
            let placed = self.pair(kind, *angle_deg, *distance_m);
            StudyRow {
                angle_deg: *angle_deg,
                distance_m: *distance_m,
                is_allowed: placed.iter().all(|p| self.room.allows(&p.centre_m)),
                prediction: self.predict(&placed, &poses),
            }
        };
        pairs.par_iter().map(row).collect()
    }
}
