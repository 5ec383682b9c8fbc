//! Choice of the candidates of control balls that one camera can have seen together.
//!
//! Colour proposes, geometry decides: each choice is judged by the camera that fits it, first the best
//! colours, then choices that differ in one ball to four, and further from the most promising of these.

use crate::PoseError;
use mavsight_geometry::{ControlPoint, Dlt, GeometryError, ImageSize, Matrix2, Vector2, Vector3};

const CANDIDATES: usize = 4;
/// A-priori error of a ball's centre, and its weight in degrees of freedom against lucky fits.
const APRIORI_STD_PX: f64 = 0.5;
const APRIORI_WEIGHT: f64 = 4.0;
/// Choices from which the search climbs on when [`MAX_CHANGES`] do not suffice, and its steps from each.
const CLIMBS: usize = 12;
const CLIMB_STEPS: usize = 4;
/// Most balls changed at once, and most choices of one such number: half a second's work.
const MAX_CHANGES: usize = 4;
const MAX_CHOICES: usize = 20_000;

/// The candidate of each ball.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Selection {
    /// For each ball an index into its candidates, or none.
    pub chosen: Vec<Option<usize>>,
    /// Pairs of balls, the lower index first, of which each has its best colour at the predicted image of the
    /// other: their colours, or their places, are exchanged in the table.
    pub swapped: Vec<(usize, usize)>,
    /// Balls with candidates of their colour, but none near their predicted image.
    pub elsewhere: Vec<usize>,
}

/// One choice: for each ball the index of a candidate, or none.
type Choice = Vec<Option<usize>>;

#[derive(Debug, Clone)]
struct Judged {
    choice: Choice,
    dlt: Dlt,
    std_px: f64,
    cost: f64,
}

struct Search<'a> {
    /// Candidates best first, with their original index.
    candidates: Vec<Vec<(usize, Vector2<f64>)>>,
    points: &'a [Vector3<f64>],
    names: &'a [&'a str],
    size: ImageSize,
    gate_px: f64,
}

/// Chooses the candidates of each control ball that one camera can have seen together.
///
/// `candidates` holds (pixel, score) per ball, a higher score is a better colour. A choice is accepted when
/// its residuals' standard deviation is within 0.5 % of the image width and the camera is plausible: little
/// skew, pixels at most half as long again as wide, principal point in the middle half. Lists of different
/// length count up to the shortest. Same input, same answer.
///
/// # Errors
/// [`PoseError::TooFewControlBalls`] and [`PoseError::InconsistentControlBalls`] name the balls.
pub fn select_control_balls(
    candidates: &[Vec<(Vector2<f64>, f64)>],
    points_in_world_m: &[Vector3<f64>],
    names: &[&str],
    size: ImageSize,
) -> Result<Selection, PoseError> {
    let n = candidates.len().min(points_in_world_m.len()).min(names.len());
    let search = Search {
        candidates: candidates[..n].iter().map(|list| best_first(list)).collect(),
        points: &points_in_world_m[..n],
        names: &names[..n],
        size,
        gate_px: 0.005 * f64::from(size.width_px),
    };
    let top: Choice = search.candidates.iter().map(|c| (!c.is_empty()).then_some(0)).collect();
    let found = top.iter().flatten().count();
    if found < 6 {
        let missing = search.listed((0..n).filter(|i| top[*i].is_none()));
        return Err(PoseError::TooFewControlBalls { found, wanted: n, missing });
    }
    // Places that no choice of candidates can make a camera.
    if let Err(error @ (GeometryError::CoplanarControlPoints { .. } | GeometryError::NotFinite { .. })) =
        Dlt::fit(&search.control(&top))
    {
        return Err(error.into());
    }
    let best = search.run(&top).map(|b| search.completed(b));
    match &best {
        Some(best) if search.accepts(best) => Ok(search.selection(best)),
        _ => Err(search.refusal(&top, best.as_ref())),
    }
}

fn best_first(list: &[(Vector2<f64>, f64)]) -> Vec<(usize, Vector2<f64>)> {
    let mut order: Vec<usize> = (0..list.len())
        .filter(|i| list[*i].0.iter().all(|x| x.is_finite()) && !list[*i].1.is_nan())
        .collect();
    order.sort_by(|a, b| list[*b].1.total_cmp(&list[*a].1));
    order.iter().take(CANDIDATES).map(|i| (*i, list[*i].0)).collect()
}

impl Search<'_> {
    fn control(&self, choice: &Choice) -> Vec<ControlPoint> {
        let pixel_cov_px2 = Matrix2::identity() * APRIORI_STD_PX * APRIORI_STD_PX;
        let point = |i: usize| {
            let (pixel, point_in_world_m) = (self.candidates[i][choice[i]?].1, self.points[i]);
            Some(ControlPoint { name: String::new(), point_in_world_m, pixel, pixel_cov_px2 })
        };
        (0..choice.len()).filter_map(point).collect()
    }

    /// The camera of a choice, if it makes one at all.
    fn judge(&self, choice: Choice, top: &Choice) -> Option<Judged> {
        let control = self.control(&choice);
        let is_one = |i: usize, j: usize| (control[i].pixel - control[j].pixel).norm() <= 1.0;
        if control.len() < 6 || (0..control.len()).any(|i| (0..i).any(|j| is_one(i, j))) {
            return None;
        }
        let dlt = Dlt::fit(&control).ok()?;
        let implausible = implausibility(&dlt, self.size)?;
        let mut sum_px2 = 0.0;
        for c in &control {
            sum_px2 += (c.pixel - dlt.project(&c.point_in_world_m).ok()?).norm_squared();
        }
        let redundancy = (2 * control.len() - 11) as f64;
        let prior_px2 = APRIORI_STD_PX * APRIORI_STD_PX * (APRIORI_WEIGHT + implausible);
        let std_px = ((sum_px2 + prior_px2) / (redundancy + APRIORI_WEIGHT)).sqrt();
        // Another colour must halve the residuals, a ball given up must quarter them.
        let change = |(now, first): (&Option<usize>, &Option<usize>)| match (now, first) {
            (None, Some(_)) => 2.0,
            _ => f64::from(u8::from(now != first)),
        };
        let changes: f64 = choice.iter().zip(top).map(change).sum();
        Some(Judged { choice, dlt, std_px, cost: std_px.ln() + changes * 2f64.ln() })
    }

    fn listed(&self, balls: impl Iterator<Item = usize>) -> String {
        balls.map(|i| self.names[i]).collect::<Vec<_>>().join(", ")
    }

    fn selection(&self, best: &Judged) -> Selection {
        let n = self.points.len();
        // Where the colour of one ball is best, is it where another must be?
        let lies_at = |ball: usize, place: usize| {
            let Some((_, pixel)) = self.candidates[ball].first() else { return false };
            best.dlt.project(&self.points[place]).is_ok_and(|at| (at - pixel).norm() <= 2.0 * self.gate_px)
        };
        let swapped: Vec<(usize, usize)> = (0..n)
            .flat_map(|a| (a + 1..n).map(move |b| (a, b)))
            .filter(|(a, b)| lies_at(*a, *b) && lies_at(*b, *a) && !lies_at(*a, *a) && !lies_at(*b, *b))
            .collect();
        let elsewhere = (0..n)
            .filter(|i| best.choice[*i].is_none() && !self.candidates[*i].is_empty())
            .filter(|i| !swapped.iter().any(|(a, b)| a == i || b == i))
            .collect();
        let chosen = (0..n).map(|i| best.choice[i].map(|k| self.candidates[i][k].0)).collect();
        Selection { chosen, swapped, elsewhere }
    }

    fn accepts(&self, judged: &Judged) -> bool {
        judged.std_px <= self.gate_px
    }

    /// All choices that differ in one ball.
    fn neighbours(&self, choice: &Choice) -> Vec<(usize, Option<usize>)> {
        let options = |i: usize| (0..self.candidates[i].len()).map(Some).chain([None]).map(move |o| (i, o));
        (0..choice.len()).flat_map(options).filter(|(i, o)| choice[*i] != *o).collect()
    }

    fn run(&self, top: &Choice) -> Option<Judged> {
        let mut seen: Vec<Judged> = self.judge(top.clone(), top).into_iter().collect();
        let single = self.neighbours(top);
        // Each choice with the first ball that it may change further.
        let mut level: Vec<(usize, Choice)> = vec![(0, top.clone())];
        for _ in 0..MAX_CHANGES {
            let wider = level.iter().flat_map(|(from, choice)| {
                let later = single.iter().filter(|c| c.0 >= *from);
                later.map(|change| (change.0 + 1, changed(choice, *change)))
            });
            level = wider.take(MAX_CHOICES + 1).collect();
            if level.len() > MAX_CHOICES {
                break;
            }
            seen.extend(level.iter().filter_map(|(_, choice)| self.judge(choice.clone(), top)));
            if let Some(best) = self.best(&mut seen).filter(|b| self.accepts(b)) {
                return Some(best);
            }
        }
        let starts: Vec<Judged> = seen.iter().take(CLIMBS).cloned().collect();
        seen.extend(starts.into_iter().map(|start| self.climb(start, top)));
        self.best(&mut seen)
    }

    /// Sorts by acceptance, then by cost, and gives the first.
    fn best(&self, seen: &mut [Judged]) -> Option<Judged> {
        seen.sort_by(|a, b| self.accepts(b).cmp(&self.accepts(a)).then(a.cost.total_cmp(&b.cost)));
        seen.first().cloned()
    }

    fn climb(&self, mut now: Judged, top: &Choice) -> Judged {
        for _ in 0..CLIMB_STEPS {
            let around = self.neighbours(&now.choice).into_iter();
            let mut around: Vec<_> =
                around.filter_map(|change| self.judge(changed(&now.choice, change), top)).collect();
            let Some(next) = self.best(&mut around).filter(|next| next.cost < now.cost) else { break };
            now = next;
        }
        now
    }

    /// Balls without a candidate in the choice take one that lies where the camera sees them.
    fn completed(&self, best: Judged) -> Judged {
        let mut choice = best.choice.clone();
        for (i, chosen) in choice.iter_mut().enumerate().filter(|(_, c)| c.is_none()) {
            let Ok(expected) = best.dlt.project(&self.points[i]) else { continue };
            let distance = |k: &usize| (self.candidates[i][*k].1 - expected).norm();
            let nearest = (0..self.candidates[i].len()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
            *chosen = nearest.filter(|k| distance(k) <= self.gate_px);
        }
        match self.judge(choice.clone(), &choice) {
            Some(more) if self.accepts(&more) => more,
            _ => best,
        }
    }

    fn refusal(&self, top: &Choice, best: Option<&Judged>) -> PoseError {
        let misses = |i: &usize| {
            let Some(best) = best else { return true };
            let pixel = best.choice[*i].or(top[*i]).map(|k| self.candidates[*i][k].1);
            match (pixel, best.dlt.project(&self.points[*i])) {
                (Some(pixel), Ok(expected)) => (pixel - expected).norm() > self.gate_px,
                _ => true,
            }
        };
        let (found, gate_px) = (top.iter().flatten().count(), self.gate_px);
        let missing: Vec<usize> = (0..top.len()).filter(|i| top[*i].is_some()).filter(misses).collect();
        let agreeing = found - missing.len();
        let disagreeing = self.listed(missing.into_iter());
        PoseError::InconsistentControlBalls { agreeing, found, disagreeing, gate_px }
    }
}

/// The choice with another candidate for one ball.
fn changed(choice: &Choice, (ball, to): (usize, Option<usize>)) -> Choice {
    let mut out = choice.clone();
    out[ball] = to;
    out
}

/// Squared distance of the camera from usual ones, in their standard deviations (skew 1 % of the focal
/// length, aspect 10 %, principal point 5 % of the width); `None` for an implausible one.
fn implausibility(dlt: &Dlt, size: ImageSize) -> Option<f64> {
    let k = dlt.camera(size).ok()?.intrinsics;
    let (width, height) = (f64::from(size.width_px), f64::from(size.height_px));
    let skew = k.skew_px / k.fx_px;
    let aspect = (k.fx_px / k.fy_px).ln();
    let off = Vector2::new(k.cx_px - (width - 1.0) / 2.0, k.cy_px - (height - 1.0) / 2.0);
    let plausible = skew.abs() < 0.05
        && aspect.abs() < 1.5f64.ln()
        && off.x.abs() < width / 4.0
        && off.y.abs() < height / 4.0;
    plausible.then(|| (skew / 0.01).powi(2) + (aspect / 0.1).powi(2) + (off / (0.05 * width)).norm_squared())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{SIZE, cameras, cube};
    use mavsight_random::Random;

    fn scene(camera: usize, random: &mut Random) -> Vec<Vec<(Vector2<f64>, f64)>> {
        let noise = |random: &mut Random| Vector2::from(random.normals()) * 0.1;
        cube()
            .iter()
            .map(|p| vec![(cameras()[camera].project(p).unwrap().pixel + noise(random), 0.9)])
            .collect()
    }

    const NAMES: [&str; 8] = ["p0", "p1", "p2", "p3", "p4", "p5", "p6", "p7"];

    fn clutter(random: &mut Random) -> Vector2<f64> {
        Vector2::new(320.0 + 150.0 * random.normal(), 240.0 + 110.0 * random.normal())
    }

    #[test]
    fn a_plain_scene_is_taken_as_it_is() {
        let mut random = Random::new(1, 0);
        for camera in 0..2 {
            let got = select_control_balls(&scene(camera, &mut random), &cube(), &NAMES, SIZE).unwrap();
            let want = Selection { chosen: vec![Some(0); 8], swapped: vec![], elsewhere: vec![] };
            assert_eq!(got, want);
        }
    }

    #[test]
    fn balls_are_found_among_better_coloured_clutter() {
        let mut random = Random::new(4, 0);
        for trial in 0..12 {
            let wrong = 1 + trial % 4;
            let mut candidates = scene(trial % 2, &mut random);
            let mut want = vec![Some(0); 8];
            for (i, list) in candidates.iter_mut().enumerate() {
                let score = if (i + trial) % 8 < wrong { 0.99 } else { 0.5 };
                want[i] = Some(usize::from(trial % 2 == 0));
                list.insert(usize::from(trial % 2 == 1), (clutter(&mut random), score));
                list.push((clutter(&mut random), 0.1));
            }
            let got = select_control_balls(&candidates, &cube(), &NAMES, SIZE).unwrap();
            assert_eq!(got.chosen, want, "trial {trial} with {wrong} wrong colours");
        }
    }

    #[test]
    fn a_hidden_ball_is_none_even_if_clutter_has_its_colour() {
        let mut random = Random::new(8, 0);
        let mut candidates = scene(0, &mut random);
        candidates[5] = vec![(Vector2::new(400.0, 50.0), 1.0)];
        candidates[2] = vec![];
        let got = select_control_balls(&candidates, &cube(), &NAMES, SIZE).unwrap();
        let want: Vec<_> = (0..8).map(|i| (i != 5 && i != 2).then_some(0)).collect();
        assert_eq!((got.chosen, got.elsewhere), (want, vec![5]));
    }

    #[test]
    fn two_swapped_colours_are_named_whether_the_other_colour_is_a_candidate_or_not() {
        let mut random = Random::new(12, 0);
        for a in 0..8 {
            for b in a + 1..8 {
                let mut candidates = scene(a % 2, &mut random);
                candidates.swap(a, b);
                if b % 2 == 0 {
                    let (first, second) = (candidates[a][0].0, candidates[b][0].0);
                    candidates[a].push((second, 0.4));
                    candidates[b].push((first, 0.4));
                }
                let got = select_control_balls(&candidates, &cube(), &NAMES, SIZE).unwrap();
                assert_eq!(got.swapped, vec![(a, b)]);
                assert!(got.elsewhere.is_empty());
                let others = (0..8).filter(|i| *i != a && *i != b).all(|i| got.chosen[i] == Some(0));
                assert!(others, "{a} with {b}: {got:?}");
            }
        }
    }

    #[test]
    fn many_swapped_balls_are_refused_by_name() {
        let mut random = Random::new(2, 0);
        let mut candidates = scene(0, &mut random);
        for k in 0..3 {
            candidates.swap(k, 7 - k);
        }
        let error = select_control_balls(&candidates, &cube(), &NAMES, SIZE).unwrap_err();
        assert!(matches!(error, PoseError::InconsistentControlBalls { found: 8, .. }), "{error}");
        assert!(error.to_string().contains("disagrees on p"), "{error}");
        candidates.iter_mut().skip(5).for_each(Vec::clear);
        let error = select_control_balls(&candidates, &cube(), &NAMES, SIZE).unwrap_err();
        let missing = "p5, p6, p7".to_string();
        assert_eq!(error, PoseError::TooFewControlBalls { found: 5, wanted: 8, missing });
    }

    #[test]
    fn a_flat_frame_is_refused_as_such() {
        let mut random = Random::new(2, 0);
        let flat: Vec<_> = (0..8).map(|i| Vector3::new(f64::from(i % 3), f64::from(i / 3), 1.0)).collect();
        let error = select_control_balls(&scene(0, &mut random), &flat, &NAMES, SIZE).unwrap_err();
        assert!(matches!(error, PoseError::Geometry(GeometryError::CoplanarControlPoints { .. })));
    }
}
