//! The best placements: pairs first, then one camera after the other, exchange, and refinement.

use crate::{Placed, PlanError, Planner, Prediction};
use mavsight_geometry::{Isometry3, Vector3};
use rayon::prelude::*;

/// Options of the search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchOptions {
    /// Distance of the grid of places.
    pub step_m: f64,
    /// Whether cameras may aim off the middle of the volume.
    pub free_aim: bool,
    /// Placements in the ranking.
    pub best: usize,
}

impl Default for SearchOptions {
    fn default() -> Self {
        Self { step_m: 0.75, free_aim: false, best: 5 }
    }
}

/// A placement with its prediction.
#[derive(Debug, Clone, PartialEq)]
pub struct Ranked {
    /// The cameras.
    pub placed: Vec<Placed>,
    /// Over a fine grid of the volume.
    pub prediction: Prediction,
}

/// Places of which all pairs are tried.
const PAIR_PLACES: usize = 56;
/// Pairs that are developed further.
const STARTS: usize = 8;
/// Steps along each side of the volume, while searching and in the end.
const COARSE: usize = 2;
const FINE: usize = 5;
/// Rounds of exchange; each ends when no camera has a better place.
const ROUNDS: usize = 8;
/// The refinement ends with steps of this length.
const LAST_STEP_M: f64 = 0.02;
/// Placements whose cameras are all nearer to each other than this are one.
const SAME_M: f64 = 0.25;

/// State of a search.
struct Search<'a> {
    planner: &'a Planner,
    poses: Vec<Isometry3<f64>>,
    places: Vec<Vector3<f64>>,
    options: SearchOptions,
}

type Costed = (f64, Vec<Placed>);

impl Planner {
    /// The best placements of all cameras of the room, best first: at most `options.best`, all of which meet
    /// all limits.
    ///
    /// All pairs of a thinned grid of places are predicted; the best unlike ones are completed greedily,
    /// improved by exchanging one camera at a time against every place (Fedorov 1972), and refined by a
    /// compass search (Kolda, Lewis & Torczon 2003). Local: a better placement may exist.
    ///
    /// # Errors
    /// [`PlanError::NoPlace`]; [`PlanError::NothingSeen`]; [`PlanError::Value`] for a step that is not
    /// positive.
    pub fn search(&self, options: &SearchOptions) -> Result<Vec<Ranked>, PlanError> {
        PlanError::unless(options.step_m.is_finite() && options.step_m > 0.01, "step", || {
            format!("{} m is no distance: give 0.1 to 2", options.step_m)
        })?;
        let kinds: Vec<usize> =
            self.room.camera.iter().enumerate().flat_map(|(k, c)| std::iter::repeat_n(k, c.count)).collect();
        let (poses, places) = (self.room.poses(COARSE), self.room.places(options.step_m)?);
        let search = Search { planner: self, poses, places, options: *options };
        let starts = search.pairs(&kinds);
        let mut found: Vec<Costed> = starts.into_par_iter().map(|s| search.developed(s, &kinds)).collect();
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut unlike: Vec<Vec<Placed>> = Vec::new();
        for (_, placed) in found {
            if !unlike.iter().any(|known| is_same(known, &placed)) {
                unlike.push(placed);
            }
        }
        let fine = self.room.poses(FINE);
        let mut ranked: Vec<Ranked> = unlike
            .into_par_iter()
            .map(|placed| Ranked { prediction: self.predict(&placed, &fine), placed })
            .collect();
        ranked.sort_by(|a, b| a.prediction.cost().total_cmp(&b.prediction.cost()));
        let tried = ranked.len();
        let best = ranked.first().map(|r| r.prediction.clone());
        ranked.retain(|r| r.prediction.is_feasible());
        ranked.truncate(options.best.max(1));
        if !ranked.is_empty() {
            return Ok(ranked);
        }
        let limit = best.as_ref().map_or_else(
            || Some("there are fewer places to stand than cameras".to_owned()),
            |p| p.refused.clone().or(p.limit.map(|l| l.text().to_owned())),
        );
        Err(PlanError::NothingSeen {
            tried,
            cameras: kinds.len(),
            seen_percent: best.map_or(0.0, |p| 100.0 * p.share_seen),
            limit: limit.unwrap_or_default(),
        })
    }
}

impl Search<'_> {
    fn at(&self, kind: usize, centre_m: Vector3<f64>) -> Placed {
        Placed { kind, centre_m, aim_m: self.planner.room.middle_m() }
    }

    fn cost(&self, placed: &[Placed]) -> f64 {
        self.planner.predict(placed, &self.poses).cost()
    }

    /// The best unlike pairs of the first two cameras.
    fn pairs(&self, kinds: &[usize]) -> Vec<Costed> {
        let few = thinned(&self.places, &self.planner.room.middle_m(), PAIR_PLACES);
        let same = kinds[0] == kinds[1];
        let pairs: Vec<(usize, usize)> = (0..few.len())
            .flat_map(|i| (0..few.len()).map(move |j| (i, j)))
            .filter(|(i, j)| if same { i < j } else { i != j })
            .collect();
        let mut all: Vec<Costed> = pairs
            .into_par_iter()
            .map(|(i, j)| {
                let placed = vec![self.at(kinds[0], few[i]), self.at(kinds[1], few[j])];
                (self.cost(&placed), placed)
            })
            .collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut out: Vec<Costed> = Vec::new();
        for one in all {
            let near = out.iter().any(|known| {
                let shared = |p: &Placed| known.1.iter().any(|q| (p.centre_m - q.centre_m).norm() < 1e-9);
                one.1.iter().all(shared)
            });
            let used = |p: &Placed| out.iter().filter(|k| k.1.contains(p)).count() >= 2;
            if !near && !one.1.iter().any(used) {
                out.push(one);
            }
            if out.len() == STARTS {
                break;
            }
        }
        out
    }

    /// A pair completed, exchanged and refined.
    fn developed(&self, (_, mut placed): Costed, kinds: &[usize]) -> Costed {
        for kind in &kinds[2..] {
            let best = self.best_place(&placed, *kind);
            placed.extend(best.map(|b| b.1));
        }
        let mut cost = self.cost(&placed);
        for _ in 0..ROUNDS {
            let before = cost;
            for k in 0..placed.len() {
                let (kind, mut others) = (placed[k].kind, placed.clone());
                others.remove(k);
                if let Some((better, place)) =
                    self.best_place(&others, kind).filter(|b| b.0 < cost * (1.0 - 1e-9))
                {
                    (cost, placed[k]) = (better, place);
                }
            }
            if cost >= before {
                break;
            }
        }
        self.refined((cost, placed))
    }

    /// The best place of one more camera.
    fn best_place(&self, others: &[Placed], kind: usize) -> Option<(f64, Placed)> {
        let costed = |place: &Vector3<f64>| {
            let mut all = others.to_vec();
            all.push(self.at(kind, *place));
            (self.cost(&all), self.at(kind, *place))
        };
        let all: Vec<(f64, Placed)> = self.places.par_iter().map(costed).collect();
        all.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Compass search over all places, and over what the cameras look at where that is free.
    fn refined(&self, (mut cost, mut placed): Costed) -> Costed {
        let mut step_m = self.options.step_m / 2.0;
        while step_m > LAST_STEP_M {
            let mut improved = false;
            for k in 0..placed.len() {
                for axis in 0..if self.options.free_aim { 6 } else { 3 } {
                    for sign in [-1.0, 1.0] {
                        let mut tried = placed.clone();
                        let by = Vector3::ith(axis % 3, sign * step_m);
                        if axis < 3 {
                            let Some(place) = self.planner.room.allowed_near(&(tried[k].centre_m + by))
                            else {
                                continue;
                            };
                            tried[k].centre_m = place;
                        } else {
                            tried[k].aim_m += by;
                        }
                        let now = self.cost(&tried);
                        if now < cost * (1.0 - 1e-6) {
                            (cost, placed, improved) = (now, tried, true);
                        }
                    }
                }
            }
            if !improved {
                step_m /= 2.0;
            }
        }
        (cost, placed)
    }
}

/// So many of the places, far from each other (farthest-point sampling, Gonzalez 1985), starting far from
/// `from`.
fn thinned(places: &[Vector3<f64>], from: &Vector3<f64>, count: usize) -> Vec<Vector3<f64>> {
    if places.len() <= count {
        return places.to_vec();
    }
    let mut distance: Vec<f64> = places.iter().map(|p| (p - from).norm()).collect();
    let mut out: Vec<Vector3<f64>> = Vec::with_capacity(count);
    for round in 0..count {
        let Some(next) = (0..places.len()).max_by(|a, b| distance[*a].total_cmp(&distance[*b])) else {
            break;
        };
        out.push(places[next]);
        for (d, p) in distance.iter_mut().zip(places) {
            let to = (p - places[next]).norm();
            *d = if round == 0 { to } else { d.min(to) };
        }
    }
    out
}

/// Whether two placements have the same cameras at the same places, in any order.
fn is_same(a: &[Placed], b: &[Placed]) -> bool {
    a.iter().all(|p| b.iter().any(|q| p.kind == q.kind && (p.centre_m - q.centre_m).norm() < SAME_M))
}
