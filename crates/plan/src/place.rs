//! Where cameras may stand.

use crate::{PlanError, Planner, Room, Solid};
use mavsight_geometry::Vector3;

/// A camera needs so much room to the walls.
const CLEARANCE_M: f64 = 0.05;

impl Room {
    /// Whether a camera may stand there.
    pub fn allows(&self, place_m: &Vector3<f64>) -> bool {
        let within = self.stand.is_empty() || self.stand.iter().any(|s| s.contains(place_m));
        let barred = self.keep_out.iter().chain(&self.block).any(|s| s.contains(place_m));
        inner(&self.room).contains(place_m) && within && !barred
    }

    /// Grid points at which cameras may stand, `step_m` apart or less; each box of [`Room::stand`] has its
    /// corners.
    pub(crate) fn places(&self, step_m: f64) -> Result<Vec<Vector3<f64>>, PlanError> {
        let whole = [inner(&self.room)];
        let boxes: &[Solid] = if self.stand.is_empty() { &whole } else { &self.stand };
        let (mut out, mut looked_at): (Vec<Vector3<f64>>, usize) = (Vec::new(), 0);
        for solid in boxes {
            let (low, side) =
                (Vector3::from(solid.low_m), Vector3::from(solid.high_m) - Vector3::from(solid.low_m));
            let steps = side.map(|s| (s / step_m).ceil().max(0.0) as usize);
            let part =
                |k: usize, axis: usize| if steps[axis] == 0 { 0.5 } else { k as f64 / steps[axis] as f64 };
            for i in 0..=steps[0] {
                for j in 0..=steps[1] {
                    for k in 0..=steps[2] {
                        looked_at += 1;
                        let share = Vector3::new(part(i, 0), part(j, 1), part(k, 2));
                        let place = low + side.component_mul(&share);
                        let known = out.iter().any(|p| (p - place).norm() < 1e-9);
                        if self.allows(&place) && !known {
                            out.push(place);
                        }
                    }
                }
            }
        }
        if out.is_empty() { Err(PlanError::NoPlace { looked_at, step_m }) } else { Ok(out) }
    }
}

fn inner(room: &Solid) -> Solid {
    Solid {
        name: None,
        low_m: room.low_m.map(|x| x + CLEARANCE_M),
        high_m: room.high_m.map(|x| x - CLEARANCE_M),
    }
}

impl Planner {
    /// The place nearest to the wanted one within its box of [`Room::stand`], where a camera may stand.
    pub(crate) fn allowed_near(&self, wanted_m: &Vector3<f64>) -> Option<Vector3<f64>> {
        let room = &self.room;
        let whole = [inner(&room.room)];
        let boxes: &[Solid] = if room.stand.is_empty() { &whole } else { &room.stand };
        let near = boxes.iter().map(|b| b.nearest_m(wanted_m));
        near.filter(|p| room.allows(p)).min_by(|a, b| (a - wanted_m).norm().total_cmp(&(b - wanted_m).norm()))
    }
}
