//! Control points that are misplaced or misnamed in the table.

use super::adjust::{Fit, adjust};
use super::choose::{Chosen, choose, is_enough, start_cameras};
use super::model::CameraModel;
use super::problem::{Choice, Data, Problem};
use super::rig::{LeftOut, LeftOutReason};
use crate::PoseError;
use mavsight_geometry::{Camera, Dlt};

/// Probability of naming any good point of a rig, divided by the number of tests for each (Bonferroni).
const FALSE_ALARM: f64 = 0.01;
/// Probability before the data that a given point is mis-surveyed or mis-identified; it counts against
/// leaving one out.
const SUSPECT: f64 = 0.01;
/// How much less probable the next explanation must be for one to be taken: "strong" of Kass & Raftery
/// (1995).
const DECISIVE: f64 = 20.0;
/// Variance factor from which points are tried one by one and in pairs even if none stands out: two that are
/// swapped hide each other. Stated covariances are trusted to within a factor 3 in the standard deviation.
const MASKED: f64 = 9.0;

/// Most suspect explanations that are worked out in full.
const CLOSER_LOOKS: usize = 8;

/// A suspected mistake of the table.
#[derive(Debug, Clone, PartialEq)]
enum Suspicion {
    /// A point, for all cameras.
    Point(usize),
    /// A point, for one camera: an observation.
    Observation(usize),
    /// Two points that bear each other's names, in one camera or in all.
    Swap(usize, usize, Option<usize>),
}

struct Explanation {
    suspicion: Suspicion,
    /// Others that explain the data about as well and name other points; these are left out too.
    alternatives: Vec<Suspicion>,
    /// The choice without the suspects.
    without: Choice,
    log_evidence: f64,
}

/// The adjustment without the points that disagree.
pub(super) struct Cleaned {
    pub(super) chosen: Chosen,
    pub(super) choice: Choice,
    pub(super) left_out: Vec<LeftOut>,
}

/// Leaves out points until none disagrees with the rest beyond chance.
///
/// # Errors
/// [`PoseError::Calibration`] for a camera without an answer; [`PoseError::SuspectControlPoints`] for points
/// that disagree where too few others remain, or where two explanations are about as good.
pub(super) fn clean(problem: &Problem) -> Result<Cleaned, PoseError> {
    let mut choice = problem.all();
    let mut left_out = Vec::new();
    loop {
        let started = start_cameras(problem.with(&choice));
        let chosen = match &started {
            Ok(start) => choose(problem.with(&choice), start),
            Err(_) => None,
        };
        let doubtful =
            chosen.as_ref().is_none_or(|c| is_doubtful(problem.with(&choice), c, started.as_deref().ok()));
        let explanation = if doubtful { explain(problem.with(&choice), chosen.as_ref())? } else { None };
        match (explanation, chosen, started) {
            (Some(found), ..) => {
                left_out.extend(reports(problem, &found));
                choice = found.without;
            }
            (None, Some(chosen), _) => {
                refuse_gross(problem.with(&choice), &chosen.best)?;
                return Ok(Cleaned { chosen, choice, left_out });
            }
            (None, None, Err(e)) => {
                return Err(PoseError::Calibration {
                    camera: problem.names[e.camera].clone(),
                    source: e.source,
                });
            }
            (None, None, Ok(_)) => return Err(problem.undetermined()),
        }
    }
}

/// Groups of observations that are right or wrong together: each point's, and each observation by itself.
fn groups(Data { problem, choice }: Data) -> Vec<(Suspicion, Vec<usize>)> {
    let mut out = Vec::new();
    for point in 0..problem.points.len() {
        let own: Vec<usize> = choice.used().filter(|k| problem.observations[*k].point == point).collect();
        if own.len() > 1 {
            out.extend(own.iter().map(|k| (Suspicion::Observation(*k), vec![*k])));
        }
        if !own.is_empty() {
            out.push((Suspicion::Point(point), own));
        }
    }
    out
}

/// The level for one of several tests.
fn level(tests: usize) -> f64 {
    FALSE_ALARM / tests.max(1) as f64
}

/// Whether a point disagrees under the chosen model or under the least one, as a wider one may absorb the
/// disagreement.
fn is_doubtful(data: Data, chosen: &Chosen, start: Option<&[Camera]>) -> bool {
    let groups = groups(data);
    let level = level(groups.len());
    let beyond = |fit: &Fit| {
        let masked = fit.variance_factor > MASKED || refuse_gross(data, fit).is_err();
        masked
            || groups
                .iter()
                .any(|(_, group)| fit.disagreement(data, group).is_some_and(|d| d.probability < level))
    };
    let least = vec![CameraModel::PINHOLE; data.problem.sizes.len()];
    beyond(&chosen.best)
        || (chosen.best.models != least
            && start.and_then(|s| adjust(data, &least, s)).is_some_and(|fit| beyond(&fit)))
}

/// The best explanation of what disagrees, if one is needed and stands out.
fn explain(data: Data, now: Option<&Chosen>) -> Result<Option<Explanation>, PoseError> {
    let Data { problem, choice } = data;
    let ahead = now.map_or(f64::NEG_INFINITY, |c| c.best.log_evidence);
    let groups = groups(data);
    let level = level(groups.len());
    let mut found: Vec<Explanation> = Vec::new();
    let mut needed: Vec<Suspicion> = Vec::new();
    for (suspicion, group) in most_suspect(data, groups, now.map(|c| &c.best)) {
        let mut without = choice.clone();
        group.iter().for_each(|k| without.used[*k] = false);
        if !is_enough(problem.with(&without)) {
            let beyond =
                now.and_then(|c| c.best.disagreement(data, &group)).is_some_and(|d| d.probability < level);
            needed.extend(beyond.then_some(suspicion));
            continue;
        }
        let Some(fit) = quick(problem.with(&without), now) else { continue };
        if fit.disagreement(problem.with(&without), &group).is_some_and(|d| d.probability < level) {
            let log_evidence = fit.log_evidence + SUSPECT.ln();
            found.push(Explanation { suspicion, alternatives: vec![], without, log_evidence });
        }
    }
    found.extend(swaps(data).into_iter().filter(|e| e.log_evidence > ahead));
    found.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    if found.is_empty() {
        return if needed.is_empty() { Ok(None) } else { Err(refusal(problem, &needed)) };
    }
    decide(problem, found).map(Some)
}

/// Takes the best of several explanations, sorted by evidence; of others about as good leaves out the points
/// too.
fn decide(problem: &Problem, mut found: Vec<Explanation>) -> Result<Explanation, PoseError> {
    let ahead = found[0].log_evidence;
    found.retain(|e| ahead - e.log_evidence < DECISIVE.ln());
    let points = points_of(problem, &found[0].suspicion);
    let (same, others): (Vec<_>, Vec<_>) =
        found.into_iter().partition(|e| points_of(problem, &e.suspicion) == points);
    // Of explanations by the same points the one that trusts them least.
    let used = |e: &Explanation| e.without.used.iter().filter(|u| **u).count();
    let mut all: Vec<Suspicion> = same.iter().chain(&others).map(|e| e.suspicion.clone()).collect();
    let least = same.into_iter().filter(|e| is_enough(problem.with(&e.without))).min_by_key(used);
    let Some(mut best) = least else { return Err(refusal(problem, &all)) };
    distrust_everywhere(problem, &mut best);
    for other in others {
        let shared = best.without.used.iter().zip(&other.without.used).map(|(a, b)| *a && *b).collect();
        best.without.used = shared;
        best.alternatives.push(other.suspicion);
    }
    if is_enough(problem.with(&best.without)) {
        return Ok(best);
    }
    all.dedup();
    Err(refusal(problem, &all))
}

/// A point that is misplaced for one camera may be misplaced along another's line of view, where that one is
/// blind to it: it is left out of all cameras if points enough remain.
fn distrust_everywhere(problem: &Problem, best: &mut Explanation) {
    let Suspicion::Observation(k) = best.suspicion else { return };
    let point = problem.observations[k].point;
    let mut without = best.without.clone();
    let own = problem.observations.iter().zip(&mut without.used).filter(|(o, _)| o.point == point);
    own.for_each(|(_, used)| *used = false);
    if is_enough(problem.with(&without)) {
        (best.suspicion, best.without) = (Suspicion::Point(point), without);
    }
}

/// The groups that disagree most with a fit; all of them where there is none.
fn most_suspect(
    data: Data,
    groups: Vec<(Suspicion, Vec<usize>)>,
    fit: Option<&Fit>,
) -> Vec<(Suspicion, Vec<usize>)> {
    let Some(fit) = fit else { return groups };
    let probability = |group: &[usize]| fit.disagreement(data, group).map_or(1.0, |d| d.probability);
    let mut order: Vec<(f64, (Suspicion, Vec<usize>))> =
        groups.into_iter().map(|g| (probability(&g.1), g)).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    order.into_iter().take(CLOSER_LOOKS).map(|(_, g)| g).collect()
}

/// A fit for judging an explanation: under the least model, and under the one that the data chose so far.
fn quick(data: Data, now: Option<&Chosen>) -> Option<Fit> {
    let least = vec![CameraModel::PINHOLE; data.problem.sizes.len()];
    let start = start_cameras(data).ok();
    let fresh = start.as_deref().and_then(|s| adjust(data, &least, s));
    let wide = now.filter(|c| c.best.models != least).and_then(|c| {
        let from = &fresh.as_ref().unwrap_or(&c.best).state.cameras;
        adjust(data, &c.best.models, from)
    });
    fresh.into_iter().chain(wide).max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
}

/// Pairs whose exchange turns a gross misfit into a fit.
fn swaps(Data { problem, choice }: Data) -> Vec<Explanation> {
    let misfit = |choice: &Choice, of: Option<usize>| -> Option<f64> {
        let mut sum_px2 = 0.0;
        for camera in (0..problem.sizes.len()).filter(|c| of.is_none_or(|of| of == *c)) {
            let control = problem.with(choice).control(camera);
            let dlt = Dlt::fit(&control).ok()?;
            for c in &control {
                sum_px2 += (c.pixel - dlt.project(&c.point_in_world_m).ok()?).norm_squared();
            }
        }
        Some(sum_px2)
    };
    let mut promising: Vec<(f64, Swapped)> = Vec::new();
    for camera in std::iter::once(None).chain((0..problem.sizes.len()).map(Some)) {
        let before = misfit(choice, camera).unwrap_or(f64::INFINITY);
        for a in 0..problem.points.len() {
            for b in a + 1..problem.points.len() {
                let swapped = Swapped::new(problem, choice, [a, b], camera);
                if let Some(after) = misfit(&swapped.choice, camera).filter(|after| *after <= 0.25 * before) {
                    promising.push((after, swapped));
                }
            }
        }
    }
    promising.sort_by(|a, b| a.0.total_cmp(&b.0));
    let explained = |(_, swapped): (f64, Swapped)| {
        let log_evidence = quick(problem.with(&swapped.choice), None)?.log_evidence + 2.0 * SUSPECT.ln();
        let Swapped { suspicion, without, .. } = swapped;
        Some(Explanation { suspicion, alternatives: vec![], without, log_evidence })
    };
    promising.into_iter().take(CLOSER_LOOKS).filter_map(explained).collect()
}

/// Two points exchanged.
struct Swapped {
    suspicion: Suspicion,
    choice: Choice,
    /// The choice without either.
    without: Choice,
}

impl Swapped {
    fn new(problem: &Problem, choice: &Choice, [a, b]: [usize; 2], camera: Option<usize>) -> Self {
        let (mut swapped, mut without) = (choice.clone(), choice.clone());
        for (k, o) in problem.observations.iter().enumerate() {
            if camera.is_none_or(|c| c == o.camera) && (o.point == a || o.point == b) {
                swapped.place[k] = if o.point == a { b } else { a };
                without.used[k] = false;
            }
        }
        Self { suspicion: Suspicion::Swap(a, b, camera), choice: swapped, without }
    }
}

fn points_of(problem: &Problem, suspicion: &Suspicion) -> Vec<usize> {
    match suspicion {
        Suspicion::Point(p) => vec![*p],
        Suspicion::Observation(k) => vec![problem.observations[*k].point],
        Suspicion::Swap(a, b, _) => vec![*a, *b],
    }
}

fn reports(problem: &Problem, found: &Explanation) -> Vec<LeftOut> {
    if found.alternatives.is_empty() {
        return report(problem, &found.suspicion);
    }
    let mut points: Vec<usize> = Vec::new();
    for suspicion in std::iter::once(&found.suspicion).chain(&found.alternatives) {
        points.extend(points_of(problem, suspicion));
    }
    points.sort_unstable();
    points.dedup();
    let name = |p: usize| problem.points[p].name.clone();
    let others =
        |p: usize| points.iter().filter(|q| **q != p).map(|q| name(*q)).collect::<Vec<_>>().join(", ");
    let doubtful = |p: usize| LeftOutReason::Doubtful { with: others(p) };
    points.iter().map(|p| LeftOut { name: name(*p), camera: None, reason: doubtful(*p) }).collect()
}

fn report(problem: &Problem, suspicion: &Suspicion) -> Vec<LeftOut> {
    let name = |p: usize| problem.points[p].name.clone();
    match *suspicion {
        Suspicion::Point(p) => {
            vec![LeftOut { name: name(p), camera: None, reason: LeftOutReason::Displaced }]
        }
        Suspicion::Observation(k) => {
            let o = &problem.observations[k];
            let camera = Some(problem.names[o.camera].clone());
            vec![LeftOut { name: name(o.point), camera, reason: LeftOutReason::Displaced }]
        }
        Suspicion::Swap(a, b, camera) => [(a, b), (b, a)]
            .map(|(p, with)| {
                let reason = LeftOutReason::Swapped { with: name(with) };
                LeftOut { name: name(p), camera: camera.map(|c| problem.names[c].clone()), reason }
            })
            .into(),
    }
}

fn refusal(problem: &Problem, suspicions: &[Suspicion]) -> PoseError {
    let mut texts: Vec<String> = Vec::new();
    for suspicion in suspicions {
        let name = |p: usize| problem.points[p].name.as_str();
        let text = match suspicion {
            Suspicion::Point(p) => name(*p).to_owned(),
            Suspicion::Observation(k) => {
                let o = &problem.observations[*k];
                format!("{} (in {})", name(o.point), problem.names[o.camera])
            }
            Suspicion::Swap(a, b, None) => format!("{} swapped with {}", name(*a), name(*b)),
            Suspicion::Swap(a, b, Some(c)) => {
                format!("{} swapped with {} (in {})", name(*a), name(*b), problem.names[*c])
            }
        };
        if !texts.contains(&text) {
            texts.push(text);
        }
    }
    PoseError::SuspectControlPoints { suspects: texts.join(" or ") }
}

/// Refuses a fit whose points miss by more than half a per cent of the width, all of them together: they
/// disagree with the table.
fn refuse_gross(data: Data, fit: &Fit) -> Result<(), PoseError> {
    let problem = data.problem;
    for (camera, size) in problem.sizes.iter().enumerate() {
        let (mut sum_px2, mut count, mut worst_px, mut worst) = (0.0, 0.0, 0.0, 0);
        for k in data.used_by(camera) {
            let Some(residual_px) = fit.residual_px(data, k).map(|r| r.norm()) else { continue };
            sum_px2 += residual_px * residual_px;
            count += 2.0;
            if residual_px > worst_px {
                (worst_px, worst) = (residual_px, problem.observations[k].point);
            }
        }
        let rms_px = (sum_px2 / f64::max(count, 1.0)).sqrt();
        let gate_px = 0.005 * f64::from(size.width_px);
        if rms_px > gate_px {
            let (camera, worst) = (problem.names[camera].clone(), problem.points[worst].name.clone());
            return Err(PoseError::ControlMisfit { camera, rms_px, gate_px, worst, worst_px });
        }
    }
    Ok(())
}
