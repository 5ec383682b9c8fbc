//! Where cameras may stand.

use crate::{PlanError, Room, Solid};
use mavsight_geometry::Vector3;

/// A camera needs so much room to the walls.
const CLEARANCE_M: f64 = 0.05;

/// Places that are compared at most: each is with all others.
const MOST_PLACES: f64 = 1e5;

impl Room {
    /// Whether a camera may stand there.
    pub fn allows(&self, place_m: &Vector3<f64>) -> bool {
        let within = self.stand.is_empty() || self.stand.iter().any(|s| s.contains(place_m));
        let barred = self.keep_out.iter().chain(&self.block).any(|s| s.contains(place_m));
        inner(&self.room).contains(place_m) && within && !barred
    }

    fn stands(&self) -> Vec<Solid> {
        if self.stand.is_empty() { vec![inner(&self.room)] } else { self.stand.clone() }
    }

    /// Grid points at which cameras may stand, `step_m` apart or less; each box of [`Room::stand`] has its
    /// corners.
    pub(crate) fn places(&self, step_m: f64) -> Result<Vec<Vector3<f64>>, PlanError> {
        let (mut out, mut looked_at): (Vec<Vector3<f64>>, usize) = (Vec::new(), 0);
        let cells_of = |s: &Solid| (0..3).map(|k| (s.high_m[k] - s.low_m[k]) / step_m + 2.0).product::<f64>();
        let cells: f64 = self.stands().iter().map(cells_of).sum();
        PlanError::unless(cells <= MOST_PLACES, "step", || {
            format!(
                "{step_m} m makes about {cells:.0} places for a camera, and {MOST_PLACES} are compared at most: lengthen it, or make the [[stand]] boxes smaller"
            )
        })?;
        for solid in self.stands() {
            let low = Vector3::from(solid.low_m);
            let side = Vector3::from(solid.high_m) - low;
            let [nx, ny, nz] = side.map(|s| (s / step_m).ceil().max(0.0) as usize).into();
            let part = |k: usize, n: usize| if n == 0 { 0.5 } else { k as f64 / n as f64 };
            let cells = (0..=nx).flat_map(|i| (0..=ny).flat_map(move |j| (0..=nz).map(move |k| [i, j, k])));
            for [i, j, k] in cells {
                looked_at += 1;
                let share = Vector3::new(part(i, nx), part(j, ny), part(k, nz));
                let place = low + side.component_mul(&share);
                let known = out.iter().any(|p| (p - place).norm() < 1e-9);
                if self.allows(&place) && !known {
                    out.push(place);
                }
            }
        }
        if out.is_empty() { Err(PlanError::NoPlace { looked_at, step_m }) } else { Ok(out) }
    }

    /// The place nearest to the wanted one within its box of [`Room::stand`], where a camera may stand.
    pub(crate) fn allowed_near(&self, wanted_m: &Vector3<f64>) -> Option<Vector3<f64>> {
        let near = self.stands().into_iter().map(|b| b.nearest_m(wanted_m)).filter(|p| self.allows(p));
        near.min_by(|a, b| (a - wanted_m).norm().total_cmp(&(b - wanted_m).norm()))
    }
}

fn inner(room: &Solid) -> Solid {
    let (low_m, high_m) = (room.low_m.map(|x| x + CLEARANCE_M), room.high_m.map(|x| x - CLEARANCE_M));
    Solid { name: None, low_m, high_m }
}
