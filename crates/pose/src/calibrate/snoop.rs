//! Control points that are not where, or what, the table says.

use super::adjust::{Fit, adjust};
use super::choose::{Chosen, choose, is_enough, start_cameras};
use super::problem::{Choice, Problem};
use super::{LeftOut, LeftOutReason};
use crate::PoseError;
use mavsight_geometry::{Camera, Dlt};

/// Probability of naming any good point, all points of a rig together: divided by the number of tests for each (Bonferroni).
pub(super) const FALSE_ALARM: f64 = 0.01;
/// Probability before the data that a given point is mis-surveyed or mis-identified; it counts against leaving one out.
const SUSPECT: f64 = 0.01;
/// How much less probable the next explanation must be for one to be taken: "strong" of Kass & Raftery (1995).
const DECISIVE: f64 = 20.0;
/// Variance factor from which points are tried one by one and in pairs even if none stands out: two that are swapped
/// hide each other. Claimed covariances are trusted to within a factor 3 in the standard deviation.
const MASKED: f64 = 9.0;

/// What may be wrong.
#[derive(Debug, Clone, PartialEq)]
enum Suspicion {
    /// A point, for all cameras.
    Point(usize),
    /// A point, for one camera.
    Sight(usize),
    /// Two points that bear each other's names, in one camera or in all.
    Swap(usize, usize, Option<usize>),
}

struct Explanation {
    suspicion: Suspicion,
    /// The choice without the suspects.
    without: Choice,
    log_evidence: f64,
}

/// The adjustment after all that disagrees was left out.
pub(super) struct Cleaned {
    pub(super) chosen: Chosen,
    pub(super) choice: Choice,
    pub(super) left_out: Vec<LeftOut>,
}

/// Leaves out points until none disagrees with the rest beyond chance.
///
/// # Errors
/// [`PoseError::Calibration`] for a camera without an answer; [`PoseError::SuspectControlPoints`] for points that
/// disagree where too few others remain, or where two explanations are about as good.
pub(super) fn clean(problem: &Problem) -> Result<Cleaned, PoseError> {
    let mut choice = problem.all();
    let mut left_out = Vec::new();
    loop {
        let started = start_cameras(problem, &choice);
        let chosen = match &started {
            Ok(start) => choose(problem, &choice, start),
            Err(_) => None,
        };
        let doubtful =
            chosen.as_ref().is_none_or(|c| is_doubtful(problem, &choice, c, started.as_deref().ok()));
        let explanation = if doubtful { explain(problem, &choice, chosen.as_ref())? } else { None };
        match (explanation, chosen, started) {
            (Some(found), ..) => {
                left_out.extend(reports(problem, &found));
                choice = found.without;
            }
            (None, Some(chosen), _) => {
                refuse_gross(problem, &choice, &chosen.best)?;
                return Ok(Cleaned { chosen, choice, left_out });
            }
            (None, None, Err((camera, source))) => {
                return Err(PoseError::Calibration { camera: problem.names[camera].clone(), source });
            }
            (None, None, Ok(_)) => {
                let source =
                    mavsight_geometry::GeometryError::UndeterminedCamera { condition: f64::INFINITY };
                return Err(PoseError::Calibration { camera: problem.names.join(", "), source });
            }
        }
    }
}

/// Groups of sights that stand or fall together: each point's, and each sight by itself.
fn groups(problem: &Problem, choice: &Choice) -> Vec<(Suspicion, Vec<usize>)> {
    let mut out = Vec::new();
    for point in 0..problem.points.len() {
        let sights: Vec<usize> = (0..problem.sights.len())
            .filter(|k| choice.used[*k] && problem.sights[*k].point == point)
            .collect();
        if sights.len() > 1 {
            out.extend(sights.iter().map(|k| (Suspicion::Sight(*k), vec![*k])));
        }
        if !sights.is_empty() {
            out.push((Suspicion::Point(point), sights));
        }
    }
    out
}

/// The level for one of several tests.
fn level(tests: usize) -> f64 {
    FALSE_ALARM / tests.max(1) as f64
}

/// Whether a point disagrees under the chosen model or under the least one, in whose place a wider one may have
/// swallowed the disagreement.
fn is_doubtful(problem: &Problem, choice: &Choice, chosen: &Chosen, start: Option<&[Camera]>) -> bool {
    let groups = groups(problem, choice);
    let level = level(groups.len());
    let beyond = |fit: &Fit| {
        let masked = fit.variance_factor > MASKED || refuse_gross(problem, choice, fit).is_err();
        masked
            || groups.iter().any(|(_, group)| {
                fit.disagreement(problem, choice, group).is_some_and(|d| d.probability < level)
            })
    };
    let least = vec![super::CameraModel::PINHOLE; problem.sizes.len()];
    beyond(&chosen.best)
        || (chosen.best.models != least
            && start.and_then(|s| adjust(problem, choice, &least, s)).is_some_and(|fit| beyond(&fit)))
}

/// The best explanation of what disagrees, if one is needed and stands out.
fn explain(
    problem: &Problem,
    choice: &Choice,
    now: Option<&Chosen>,
) -> Result<Option<Explanation>, PoseError> {
    let ahead = now.map_or(f64::NEG_INFINITY, |c| c.best.log_evidence);
    let mut found: Vec<Explanation> = Vec::new();
    let mut needed: Vec<Suspicion> = Vec::new();
    let groups = groups(problem, choice);
    let level = level(groups.len());
    for (suspicion, group) in groups {
        let mut without = choice.clone();
        group.iter().for_each(|k| without.used[*k] = false);
        if !is_enough(problem, &without) {
            let beyond = now
                .and_then(|c| c.best.disagreement(problem, choice, &group))
                .is_some_and(|d| d.probability < level);
            needed.extend(beyond.then_some(suspicion));
            continue;
        }
        let Some(chosen) = start_cameras(problem, &without).ok().and_then(|s| choose(problem, &without, &s))
        else {
            continue;
        };
        let disagrees =
            chosen.best.disagreement(problem, &without, &group).is_some_and(|d| d.probability < level);
        if disagrees {
            let log_evidence = chosen.best.log_evidence + SUSPECT.ln();
            found.push(Explanation { suspicion, without, log_evidence });
        }
    }
    found.extend(swaps(problem, choice).into_iter().filter(|e| e.log_evidence > ahead));
    found.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    if found.is_empty() {
        return if needed.is_empty() { Ok(None) } else { Err(refusal(problem, &needed)) };
    }
    let best = &found[0];
    if !is_enough(problem, &best.without) {
        return Err(refusal(problem, std::slice::from_ref(&best.suspicion)));
    }
    let rivals: Vec<Suspicion> = found
        .iter()
        .filter(|e| best.log_evidence - e.log_evidence < DECISIVE.ln())
        .map(|e| e.suspicion.clone())
        .collect();
    let same = rivals.iter().all(|r| points_of(problem, r) == points_of(problem, &best.suspicion));
    if !same {
        return Err(refusal(problem, &rivals));
    }
    // Of explanations about as good the one that trusts the point least.
    let used = |e: &Explanation| e.without.used.iter().filter(|u| **u).count();
    found.truncate(rivals.len());
    Ok(found.into_iter().min_by_key(used))
}

/// Pairs whose exchange turns a gross misfit into a fit.
fn swaps(problem: &Problem, choice: &Choice) -> Vec<Explanation> {
    let misfit = |choice: &Choice| -> Option<f64> {
        let mut sum_px2 = 0.0;
        for camera in 0..problem.sizes.len() {
            let control = problem.control(choice, camera);
            let dlt = Dlt::fit_linear(&control).ok()?;
            for c in &control {
                sum_px2 += (c.pixel - dlt.project(&c.point_in_world_m).ok()?).norm_squared();
            }
        }
        Some(sum_px2)
    };
    let before = misfit(choice).unwrap_or(f64::INFINITY);
    let cameras: Vec<Option<usize>> =
        std::iter::once(None).chain((0..problem.sizes.len()).map(Some)).collect();
    let mut out = Vec::new();
    for a in 0..problem.points.len() {
        for b in a + 1..problem.points.len() {
            for camera in &cameras {
                let (swapped, without) = swapped(problem, choice, (a, b), *camera);
                if misfit(&swapped).is_none_or(|after| after > 0.25 * before) {
                    continue;
                }
                let start = start_cameras(problem, &swapped).ok();
                let Some(fitted) = start.and_then(|s| choose(problem, &swapped, &s)) else { continue };
                let log_evidence = fitted.best.log_evidence + 2.0 * SUSPECT.ln();
                out.push(Explanation { suspicion: Suspicion::Swap(a, b, *camera), without, log_evidence });
            }
        }
    }
    out
}

/// The choice with two points exchanged, and the one without either.
fn swapped(
    problem: &Problem,
    choice: &Choice,
    (a, b): (usize, usize),
    camera: Option<usize>,
) -> (Choice, Choice) {
    let (mut swapped, mut without) = (choice.clone(), choice.clone());
    for (k, sight) in problem.sights.iter().enumerate() {
        if camera.is_some_and(|c| c != sight.camera) || (sight.point != a && sight.point != b) {
            continue;
        }
        swapped.place[k] = if sight.point == a { b } else { a };
        without.used[k] = false;
    }
    (swapped, without)
}

fn points_of(problem: &Problem, suspicion: &Suspicion) -> Vec<usize> {
    match suspicion {
        Suspicion::Point(p) => vec![*p],
        Suspicion::Sight(s) => vec![problem.sights[*s].point],
        Suspicion::Swap(a, b, _) => vec![*a, *b],
    }
}

fn reports(problem: &Problem, found: &Explanation) -> Vec<LeftOut> {
    let name = |p: usize| problem.points[p].name.clone();
    match found.suspicion {
        Suspicion::Point(p) => {
            vec![LeftOut { name: name(p), camera: None, reason: LeftOutReason::Displaced }]
        }
        Suspicion::Sight(s) => {
            let sight = &problem.sights[s];
            let camera = Some(problem.names[sight.camera].clone());
            vec![LeftOut { name: name(sight.point), camera, reason: LeftOutReason::Displaced }]
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
            Suspicion::Sight(s) => {
                let sight = &problem.sights[*s];
                format!("{} (in {})", name(sight.point), problem.names[sight.camera])
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

/// What is left must be a calibration: points that miss by more than half a per cent of the width, all of them together,
/// are not seen where the table puts them.
fn refuse_gross(problem: &Problem, choice: &Choice, fit: &Fit) -> Result<(), PoseError> {
    for (camera, size) in problem.sizes.iter().enumerate() {
        let (mut sum_px2, mut count) = (0.0, 0.0);
        let mut worst = (0.0, 0);
        for (k, sight) in problem.sights.iter().enumerate() {
            if sight.camera != camera || !choice.used[k] {
                continue;
            }
            let Some(residual) = fit.residual_px(problem, choice, k) else { continue };
            sum_px2 += residual.norm_squared();
            count += 2.0;
            if residual.norm() > worst.0 {
                worst = (residual.norm(), sight.point);
            }
        }
        let rms_px = (sum_px2 / f64::max(count, 1.0)).sqrt();
        let gate_px = 0.005 * f64::from(size.width_px);
        if rms_px > gate_px {
            return Err(PoseError::ControlMisfit {
                camera: problem.names[camera].clone(),
                rms_px,
                gate_px,
                worst: problem.points[worst.1].name.clone(),
                worst_px: worst.0,
            });
        }
    }
    Ok(())
}
