//! Control points that are misplaced or misnamed in the table.

use super::adjust::{Fit, adjust};
use super::choose::{Chosen, choose, is_enough, most_probable, start_cameras};
use super::model::CameraModel;
use super::problem::{Choice, Data, Problem};
use super::rig::{LeftOut, LeftOutReason};
use crate::PoseError;
use mavsight_geometry::{Camera, Dlt};

/// Probability of naming any good point of a rig, divided by the number of tests for each (Bonferroni).
const FALSE_ALARM: f64 = 0.01;
/// Prior probability that a given point is mis-surveyed or mis-identified.
const SUSPECT: f64 = 0.01;
/// By how much the next explanation must be less probable: "strong" of Kass & Raftery (1995).
const DECISIVE: f64 = 20.0;
/// Variance factor from which all points are tried: two that are swapped hide each other.
const MASKED: f64 = 9.0;

/// Most suspect explanations that are worked out in full.
const CLOSER_LOOKS: usize = 8;

#[derive(Debug, Clone, PartialEq)]
enum Suspicion {
    /// A point, for all cameras.
    Point(usize),
    /// A point, for one camera: an observation.
    Observation(usize),
    /// Two points that bear each other's names, in one camera or in all.
    Swap(usize, usize, Option<usize>),
}

impl Suspicion {
    fn points(&self, problem: &Problem) -> Vec<usize> {
        match self {
            Self::Point(p) => vec![*p],
            Self::Observation(k) => vec![problem.observations[*k].point],
            Self::Swap(a, b, _) => vec![*a, *b],
        }
    }

    /// Name of the camera for which it is made; none for all of them.
    fn camera(&self, problem: &Problem) -> Option<String> {
        let camera = match self {
            Self::Point(_) => None,
            Self::Observation(k) => Some(problem.observations[*k].camera),
            Self::Swap(_, _, camera) => *camera,
        };
        camera.map(|c| problem.names[c].clone())
    }
}

struct Explanation {
    suspicion: Suspicion,
    /// Others that explain the data about as well and name other points; these are left out too.
    alternatives: Vec<Suspicion>,
    without: Choice,
    log_evidence: f64,
}

pub(super) struct Cleaned {
    pub(super) chosen: Chosen,
    pub(super) choice: Choice,
    pub(super) left_out: Vec<LeftOut>,
}

/// Leaves out points until none disagrees with the rest beyond chance. Refuses points that disagree where too
/// few others remain, or where two explanations are about as good.
pub(super) fn clean(problem: &Problem) -> Result<Cleaned, PoseError> {
    let mut choice = problem.all();
    let mut left_out = Vec::new();
    loop {
        let data = problem.with(&choice);
        let started = start_cameras(data);
        let chosen = started.as_deref().ok().and_then(|start| choose(data, start));
        let is_doubtful = chosen.as_ref().is_none_or(|c| is_doubtful(data, c, started.as_deref().ok()));
        let explanation = if is_doubtful { explain(data, chosen.as_ref())? } else { None };
        match (explanation, chosen, started) {
            (Some(found), ..) => {
                left_out.extend(reports(problem, &found));
                choice = found.without;
            }
            (None, Some(chosen), _) => {
                refuse_gross(data, &chosen.best)?;
                return Ok(Cleaned { chosen, choice, left_out });
            }
            (None, None, Err(error)) => return Err(error),
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

/// Whether a group disagrees with the others of a fit at a level of probability.
fn is_beyond(fit: &Fit, data: Data, group: &[usize], level: f64) -> bool {
    fit.disagreement(data, group).is_some_and(|d| d.probability < level)
}

/// Whether a point disagrees under the chosen model or the least one, as a wider one may absorb it.
fn is_doubtful(data: Data, chosen: &Chosen, start: Option<&[Camera]>) -> bool {
    let groups = groups(data);
    let level = FALSE_ALARM / groups.len().max(1) as f64;
    let beyond = |fit: &Fit| {
        fit.variance_factor > MASKED
            || refuse_gross(data, fit).is_err()
            || groups.iter().any(|(_, group)| is_beyond(fit, data, group, level))
    };
    let least = vec![CameraModel::PINHOLE; data.problem.sizes.len()];
    let start = start.filter(|_| chosen.best.models != least);
    beyond(&chosen.best) || start.and_then(|s| adjust(data, &least, s)).is_some_and(|fit| beyond(&fit))
}

/// The best explanation of what disagrees, if one is needed and stands out.
fn explain(data: Data, now: Option<&Chosen>) -> Result<Option<Explanation>, PoseError> {
    let Data { problem, choice } = data;
    let ahead = now.map_or(f64::NEG_INFINITY, |c| c.best.log_evidence);
    let groups = groups(data);
    let level = FALSE_ALARM / groups.len().max(1) as f64;
    let mut found: Vec<Explanation> = Vec::new();
    let mut needed: Vec<Suspicion> = Vec::new();
    for (suspicion, group) in most_suspect(data, groups, now.map(|c| &c.best)) {
        let mut without = choice.clone();
        group.iter().for_each(|k| without.used[*k] = false);
        if !is_enough(problem.with(&without)) {
            needed.extend(now.is_some_and(|c| is_beyond(&c.best, data, &group, level)).then_some(suspicion));
            continue;
        }
        let Some(fit) = quick(problem.with(&without), now) else { continue };
        if is_beyond(&fit, problem.with(&without), &group, level) {
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

/// Takes the best of explanations sorted by evidence; leaves out the points of others about as good too.
fn decide(problem: &Problem, mut found: Vec<Explanation>) -> Result<Explanation, PoseError> {
    let ahead = found[0].log_evidence;
    found.retain(|e| ahead - e.log_evidence < DECISIVE.ln());
    let points = found[0].suspicion.points(problem);
    let (same, others): (Vec<_>, Vec<_>) =
        found.into_iter().partition(|e| e.suspicion.points(problem) == points);
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

/// Leaves a misplaced point out of all cameras if enough remain: another line of view may hide its error. Two others that agree
/// with its place in the table do not.
fn distrust_everywhere(problem: &Problem, best: &mut Explanation) {
    let Suspicion::Observation(k) = best.suspicion else { return };
    let point = problem.observations[k].point;
    let others =
        problem.observations.iter().zip(&best.without.used).filter(|(o, used)| o.point == point && **used);
    if others.count() > 1 {
        return;
    }
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
    let mut order: Vec<_> = groups.into_iter().map(|g| (probability(&g.1), g)).collect();
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
    most_probable(fresh.into_iter().chain(wide))
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
    // The places of an exchange of two points, and the observations that it leaves in use.
    let swapped = |a: usize, b: usize, camera: Option<usize>| {
        let (mut swapped, mut without) = (choice.clone(), choice.clone());
        for (k, o) in problem.observations.iter().enumerate() {
            if camera.is_none_or(|c| c == o.camera) && (o.point == a || o.point == b) {
                swapped.place[k] = if o.point == a { b } else { a };
                without.used[k] = false;
            }
        }
        (swapped, without)
    };
    let mut promising: Vec<(f64, Suspicion)> = Vec::new();
    for camera in std::iter::once(None).chain((0..problem.sizes.len()).map(Some)) {
        let before = misfit(choice, camera).unwrap_or(f64::INFINITY);
        for (a, b) in (0..problem.points.len()).flat_map(|b| (0..b).map(move |a| (a, b))) {
            let after = misfit(&swapped(a, b, camera).0, camera).filter(|after| *after <= 0.25 * before);
            promising.extend(after.map(|after| (after, Suspicion::Swap(a, b, camera))));
        }
    }
    promising.sort_by(|a, b| a.0.total_cmp(&b.0));
    let explained = |(_, suspicion): (f64, Suspicion)| {
        let Suspicion::Swap(a, b, camera) = suspicion else { return None };
        let (choice, without) = swapped(a, b, camera);
        let log_evidence = quick(problem.with(&choice), None)?.log_evidence + 2.0 * SUSPECT.ln();
        Some(Explanation { suspicion, alternatives: vec![], without, log_evidence })
    };
    promising.into_iter().take(CLOSER_LOOKS).filter_map(explained).collect()
}

fn reports(problem: &Problem, found: &Explanation) -> Vec<LeftOut> {
    let is_certain = found.alternatives.is_empty();
    let all = std::iter::once(&found.suspicion).chain(&found.alternatives);
    let mut points: Vec<usize> = all.flat_map(|s| s.points(problem)).collect();
    points.sort_unstable();
    points.dedup();
    let camera = found.suspicion.camera(problem).filter(|_| is_certain);
    let left_out = |p: &usize| {
        let others = points.iter().filter(|q| *q != p).map(|q| problem.points[*q].name.as_str());
        let with = others.collect::<Vec<_>>().join(", ");
        let reason = match found.suspicion {
            _ if !is_certain => LeftOutReason::Doubtful { with },
            Suspicion::Swap(..) => LeftOutReason::Swapped { with },
            _ => LeftOutReason::Displaced,
        };
        LeftOut { name: problem.points[*p].name.clone(), camera: camera.clone(), reason }
    };
    points.iter().map(left_out).collect()
}

fn refusal(problem: &Problem, suspicions: &[Suspicion]) -> PoseError {
    let mut texts: Vec<String> = Vec::new();
    for suspicion in suspicions {
        let names: Vec<&str> =
            suspicion.points(problem).iter().map(|p| problem.points[*p].name.as_str()).collect();
        let camera = suspicion.camera(problem).map_or_else(String::new, |c| format!(" (in {c})"));
        let text = names.join(" swapped with ") + &camera;
        if !texts.contains(&text) {
            texts.push(text);
        }
    }
    PoseError::SuspectControlPoints { suspects: texts.join(" or ") }
}

/// Refuses points that as a whole miss by more than half a per cent of the width.
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
