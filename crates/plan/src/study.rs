//! The study of two cameras: error against the angle between them, and against their distance.

use crate::{Placed, Planner, Prediction};
use mavsight_geometry::Vector3;
use rayon::prelude::*;
use serde::Serialize;

/// Two cameras of one type at the height of the volume's middle, on the side of -Y, as in the paper.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CameraPair {
    /// Angle between the optical axes.
    pub angle_deg: f64,
    /// Distance of both cameras from the middle of the volume.
    pub distance_m: f64,
}

/// One row of a study.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StudyRow {
    /// The cameras.
    #[serde(flatten)]
    pub pair: CameraPair,
    /// Whether both places are allowed in the room.
    pub is_allowed: bool,
    /// Prediction for these cameras.
    pub prediction: Prediction,
}

/// Steps along each side of the volume.
const STEPS: usize = 5;

impl Planner {
    /// A pair of cameras of a type at its places.
    pub fn pair(&self, kind: usize, pair: CameraPair) -> [Placed; 2] {
        let middle = self.room().middle_m();
        [0.5, -0.5].map(|side| {
            let turn = (side * pair.angle_deg).to_radians();
            let centre_m = middle + Vector3::new(turn.sin(), -turn.cos(), 0.0) * pair.distance_m;
            Placed { kind, centre_m, aim_m: middle }
        })
    }

    /// Predicted errors of pairs of cameras of a type.
    pub fn study(&self, kind: usize, pairs: &[CameraPair]) -> Vec<StudyRow> {
        let poses = self.room.poses(STEPS);
        let row = |pair: &CameraPair| {
            let placed = self.pair(kind, *pair);
            StudyRow {
                pair: *pair,
                is_allowed: placed.iter().all(|p| self.room.allows(&p.centre_m)),
                prediction: self.predict(&placed, &poses),
            }
        };
        pairs.par_iter().map(row).collect()
    }
}
