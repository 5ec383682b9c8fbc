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

struct Search<'a> {
    planner: &'a Planner,
    poses: Vec<Isometry3<f64>>,
    places: Vec<Vector3<f64>>,
    options: SearchOptions,
}

struct Costed {
    cost: f64,
    placed: Vec<Placed>,
}

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
    /// 0.1 to 10 m, or so short that there are more than 100 000 places.
    pub fn search(&self, options: &SearchOptions) -> Result<Vec<Ranked>, PlanError> {
        PlanError::unless((0.1..=10.0).contains(&options.step_m), "step", || {
            format!("{} m is no distance: give 0.1 to 10", options.step_m)
        })?;
        let kinds: Vec<usize> =
            self.room.camera.iter().enumerate().flat_map(|(k, c)| std::iter::repeat_n(k, c.count)).collect();
        let (poses, places) = (self.room.poses(COARSE), self.room.places(options.step_m)?);
        let search = Search { planner: self, poses, places, options: *options };
        let starts = search.pairs(&kinds);
        let mut found: Vec<Costed> = starts.into_par_iter().map(|s| search.developed(s, &kinds)).collect();
        found.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let mut unlike: Vec<Vec<Placed>> = Vec::new();
        for Costed { placed, .. } in found {
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

    fn costed(&self, placed: Vec<Placed>) -> Costed {
        Costed { cost: self.planner.predict(&placed, &self.poses).cost(), placed }
    }

    /// The best unlike pairs of the first two cameras.
    fn pairs(&self, kinds: &[usize]) -> Vec<Costed> {
        let few = thinned(&self.places, &self.planner.room.middle_m(), PAIR_PLACES);
        let same = kinds[0] == kinds[1];
        let pairs: Vec<(usize, usize)> = (0..few.len())
            .flat_map(|i| (0..few.len()).map(move |j| (i, j)))
            .filter(|(i, j)| if same { i < j } else { i != j })
            .collect();
        let pair = |(i, j)| self.costed(vec![self.at(kinds[0], few[i]), self.at(kinds[1], few[j])]);
        let mut all: Vec<Costed> = pairs.into_par_iter().map(pair).collect();
        all.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let mut out: Vec<Costed> = Vec::new();
        for one in all {
            let is_near = |known: &Costed| {
                let stands =
                    |p: &Placed| known.placed.iter().any(|q| (p.centre_m - q.centre_m).norm() < 1e-9);
                one.placed.iter().all(stands)
            };
            let is_used = |p: &Placed| out.iter().filter(|known| known.placed.contains(p)).count() >= 2;
            if !out.iter().any(is_near) && !one.placed.iter().any(is_used) {
                out.push(one);
            }
            if out.len() == STARTS {
                break;
            }
        }
        out
    }

    fn developed(&self, pair: Costed, kinds: &[usize]) -> Costed {
        let mut best = pair;
        for kind in &kinds[2..] {
            best = self.with_best_place(&best.placed, best.placed.len(), *kind).unwrap_or(best);
        }
        for _ in 0..ROUNDS {
            let before = best.cost;
            for k in 0..best.placed.len() {
                let (kind, mut others) = (best.placed[k].kind, best.placed.clone());
                others.remove(k);
                let better = self.with_best_place(&others, k, kind);
                best = better.filter(|b| b.cost < best.cost * (1.0 - 1e-9)).unwrap_or(best);
            }
            if best.cost >= before {
                break;
            }
        }
        self.refined(best)
    }

    /// The best place of one more camera, the `k`-th.
    fn with_best_place(&self, others: &[Placed], k: usize, kind: usize) -> Option<Costed> {
        let costed = |place: &Vector3<f64>| {
            let mut all = others.to_vec();
            all.insert(k, self.at(kind, *place));
            self.costed(all)
        };
        let all: Vec<Costed> = self.places.par_iter().map(costed).collect();
        all.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost))
    }

    /// Compass search over all places, and over what the cameras look at where that is free.
    fn refined(&self, mut best: Costed) -> Costed {
        let mut step_m = self.options.step_m / 2.0;
        while step_m > LAST_STEP_M {
            let mut improved = false;
            for k in 0..best.placed.len() {
                for axis in 0..if self.options.free_aim { 6 } else { 3 } {
                    for sign in [-1.0, 1.0] {
                        let mut tried = best.placed.clone();
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
                        let now = self.costed(tried);
                        if now.cost < best.cost * (1.0 - 1e-6) {
                            (best, improved) = (now, true);
                        }
                    }
                }
            }
            if !improved {
                step_m /= 2.0;
            }
        }
        best
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
    while out.len() < count {
        let farthest = (0..places.len()).max_by(|a, b| distance[*a].total_cmp(&distance[*b]));
        let Some(next) = farthest.map(|k| places[k]) else { break };
        for (d, p) in distance.iter_mut().zip(places) {
            let to = (p - next).norm();
            *d = if out.is_empty() { to } else { d.min(to) };
        }
        out.push(next);
    }
    out
}

/// Whether two placements have the same cameras at the same places, in any order.
fn is_same(a: &[Placed], b: &[Placed]) -> bool {
    a.iter().all(|p| b.iter().any(|q| p.kind == q.kind && (p.centre_m - q.centre_m).norm() < SAME_M))
}
