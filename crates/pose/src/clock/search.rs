//! The search for the clocks: coarse over a second, then by Gauss and Newton, then what is made of it.

use super::equations::{Misfit, Problem, Sums, Unknown};
use super::types::{CameraClock, ClockEstimate, ClockVerdict, DRIFT, LINE_TIME, OFFSET};
use mavsight_geometry::Isometry3;
use nalgebra::{DMatrix, DVector};

/// Part of a frame's interval to which a determined clock's offset is known.
const DETERMINED_INTERVALS: f64 = 0.125;

/// A difference of this many standard deviations is not by chance: one in sixteen thousand normal numbers is.
const SIGNIFICANT: f64 = 4.0;

/// An offset matters where it moves centres by this part of their standard deviation at the flight's image
/// speed: it would add a thirtieth to their errors.
const RELEVANT_STD: f64 = 0.25;

/// An offset of which nothing is known is sought this far on either side of the start.
const REACH_S: f64 = 1.0;

/// Part of the misfit at the start below which a coarse offset is taken: beyond what noise does.
const MUCH_BETTER: f64 = 0.9;

const COARSE_INSTANTS: usize = 80;

const MOST_STEPS: usize = 20;

/// A search that is right ends at the same offset from this part of an interval beside it: as far as the coarse search may be
/// off.
const BESIDE_INTERVALS: f64 = 0.5;

/// An end of the search is no rival of one that leaves half of its misfit: four times the square is beyond what a part of the
/// balls that is not seen as claimed does.
const MUCH_WORSE: f64 = 2.0;

/// Steps smaller than this part of an unknown's standard deviation are the last.
const CONVERGED_STD: f64 = 0.03;

struct Found {
    clocks: Vec<CameraClock>,
    sums: Sums,
    /// Of the unknowns, corrected for noise in the velocities; infinite where they are not determined.
    std: Vec<f64>,
    /// Whether the search came to an end.
    is_end: bool,
}

pub(super) fn solve(problem: &mut Problem<'_>, out: &mut [ClockEstimate]) {
    let free = |part: usize| -> Vec<Unknown> {
        let first = usize::from(part != LINE_TIME);
        let is_free = |k: &usize| problem.streams[*k].prior.stds()[part] > 0.0;
        (first..problem.streams.len()).filter(is_free).map(|k| (k, part)).collect()
    };
    let (offsets, drifts, lines) = (free(OFFSET), free(DRIFT), free(LINE_TIME));
    if (offsets.is_empty() && lines.is_empty()) || problem.instants.is_empty() {
        return;
    }
    let mut clocks: Vec<CameraClock> = problem.streams.iter().map(|s| s.prior.clock).collect();
    problem.find_poses(&clocks);
    for (camera, _) in &offsets {
        coarse(problem, &mut clocks, *camera);
    }
    problem.leave_out_leaps(&clocks);
    let Some(mut found) = best_end(problem, clocks, &offsets) else {
        let (speed_px_s, needed_px_s, needed_m_s) = (0.0, f64::INFINITY, f64::INFINITY);
        let unseen = ClockVerdict::TooSlow { speed_px_s, needed_px_s, needed_m_s };
        return offsets.iter().for_each(|(k, _)| out[*k].verdict = unseen);
    };
    // A drift is estimated where its offset is determined.
    let is_determined = |(k, _): &Unknown| {
        let limit_s = DETERMINED_INTERVALS * problem.streams[*k].interval_s;
        offsets.iter().zip(&found.std).any(|(u, std)| *u == (*k, OFFSET) && *std <= limit_s)
    };
    let drifts: Vec<Unknown> = drifts.into_iter().filter(is_determined).collect();
    offsets.iter().for_each(|(k, _)| out[*k].drift_std = f64::INFINITY);
    let with_drifts = extended(problem, &mut found, &offsets, &drifts, out);
    let mut unknowns = extended(problem, &mut found, &with_drifts, &lines, out);
    if unknowns.len() > with_drifts.len() && with_drifts.len() == offsets.len() {
        // Rows that are read one after another may have hidden them.
        unknowns = extended(problem, &mut found, &unknowns, &drifts, out);
    }
    conclude(problem, &found, &unknowns, out);
}

/// Frees further unknowns and keeps those that are not by chance, with the fit that they give. The standard deviations of all
/// that were free are noted.
fn extended(
    problem: &mut Problem<'_>,
    found: &mut Found,
    unknowns: &[Unknown],
    more: &[Unknown],
    out: &mut [ClockEstimate],
) -> Vec<Unknown> {
    let mut more = more.to_vec();
    while !more.is_empty() {
        let all: Vec<Unknown> = unknowns.iter().chain(&more).copied().collect();
        let Some(with) = descend(problem, found.clocks.clone(), &all) else { break };
        let kept = significant(&with, &more, out);
        if kept.len() == more.len() {
            *found = with;
            return all;
        }
        more = kept;
    }
    unknowns.to_vec()
}

/// Those of the last unknowns of a fit that are not by chance; the standard deviations of all are noted.
fn significant(with: &Found, last: &[Unknown], out: &mut [ClockEstimate]) -> Vec<Unknown> {
    let first = with.std.len() - last.len();
    let mut kept = Vec::new();
    for ((camera, part), std) in last.iter().zip(&with.std[first..]) {
        let of = if *part == DRIFT { &mut out[*camera].drift_std } else { &mut out[*camera].line_time_std_s };
        *of = *std;
        let mut clock = with.clocks[*camera];
        if clock.parts()[*part].abs() > SIGNIFICANT * std {
            kept.push((*camera, *part));
        }
    }
    kept
}

/// The clocks that fit best, with the problem's poses and systematic errors; `None` where nothing is seen by two cameras.
pub(super) fn fitted(problem: &mut Problem<'_>) -> Option<Vec<CameraClock>> {
    let mut clocks: Vec<CameraClock> = problem.streams.iter().map(|s| s.prior.clock).collect();
    problem.find_poses(&clocks);
    for (camera, _) in free_offsets(problem) {
        coarse(problem, &mut clocks, camera);
    }
    problem.leave_out_leaps(&clocks);
    refitted(problem, clocks)
}

/// [`fitted`] from clocks that are near.
pub(super) fn refitted(problem: &mut Problem<'_>, clocks: Vec<CameraClock>) -> Option<Vec<CameraClock>> {
    let free = free_offsets(problem);
    // Where no clock is unknown the first step to the systematic errors is the last.
    let found = descend(problem, clocks, &free)?;
    Some(descend(problem, found.clocks, &free)?.clocks)
}

fn free_offsets(problem: &Problem<'_>) -> Vec<Unknown> {
    let is_free = |k: &usize| problem.streams[*k].prior.offset_std_s > 0.0;
    (1..problem.streams.len()).filter(is_free).map(|k| (k, OFFSET)).collect()
}

/// Tries offsets of one camera half a frame apart against the first camera, and takes one that is much better
/// than the start.
fn coarse(problem: &mut Problem<'_>, clocks: &mut [CameraClock], camera: usize) {
    let stream = &problem.streams[camera];
    let reach_s = (3.0 * stream.prior.offset_std_s).min(REACH_S);
    let step_s = 0.5 * stream.interval_s;
    let stride = (problem.instants.len() / COARSE_INSTANTS).max(1);
    let start_s = clocks[camera].offset_s;
    let mut tried = clocks.to_vec();
    let mut misfit = |offset_s: f64, most: f64| {
        tried[camera].offset_s = offset_s;
        problem.misfit(&tried, &[0, camera], stride, most)
    };
    let at_start = misfit(start_s, f64::INFINITY);
    let steps = (reach_s / step_s).floor() as i32;
    let mut least = if at_start.instants > 0 { MUCH_BETTER * at_start.mean } else { f64::INFINITY };
    for k in (-steps..=steps).filter(|k| *k != 0) {
        let offset_s = start_s + f64::from(k) * step_s;
        let Misfit { instants, mean } = misfit(offset_s, least);
        // Where the recordings share less than half of what they share at the start, little agreement is no
        // merit.
        if instants > 10 && 2 * instants >= at_start.instants && mean < least {
            (least, clocks[camera].offset_s) = (mean, offset_s);
        }
    }
}

/// The best end of the search from some clocks, from the given ones, and from beside the first end. Where another end is hardly
/// worse, the flight does not say which is right: the standard deviations reach to it.
///
/// Noise beyond what the observations claim makes ends where there are none: it passes for speed in the image, so that steps are
/// too short, and a centre between frames has that of its neighbours too, so that whole intervals seem to fit.
fn best_end(problem: &mut Problem<'_>, clocks: Vec<CameraClock>, unknowns: &[Unknown]) -> Option<Found> {
    let given: Vec<CameraClock> = problem.streams.iter().map(|s| s.prior.clock).collect();
    let first = End::of(problem, clocks.clone(), unknowns)?;
    let beside = |intervals: f64| {
        let mut beside = first.found.clocks.clone();
        for (camera, _) in unknowns.iter().filter(|u| u.1 == OFFSET) {
            beside[*camera].offset_s += intervals * problem.streams[*camera].interval_s;
        }
        beside
    };
    let mut starts = vec![beside(-BESIDE_INTERVALS), beside(BESIDE_INTERVALS)];
    if given != clocks {
        starts.push(given);
    }
    let others = starts.into_iter().filter_map(|start| End::of(problem, start, unknowns));
    let mut ends: Vec<End> = others.collect();
    ends.push(first);
    problem.scale = ends.iter().map(|end| end.scale).fold(f64::INFINITY, f64::min);
    ends.iter_mut().for_each(|end| end.misfit = end.misfit(problem));
    ends.sort_by(|a, b| a.misfit.total_cmp(&b.misfit));
    let mut ends = ends.into_iter();
    let mut best = ends.next()?;
    let mut std = best.found.std.clone();
    let is_rival = |other: &End| other.found.is_end && other.misfit < MUCH_WORSE * best.misfit;
    for other in ends.filter(is_rival) {
        for (u, (camera, part)) in unknowns.iter().enumerate() {
            let [mut own, mut rival] = [&best, &other].map(|end| end.found.clocks[*camera]);
            let apart = *rival.parts()[*part] - *own.parts()[*part];
            std[u] = std[u].max(best.found.std[u].hypot(apart));
        }
    }
    best.found.std = std;
    (problem.poses, problem.systematic_px, problem.scale) = (best.poses, best.systematic_px, best.scale);
    Some(best.found)
}

/// Where a search ended, with what else it found.
struct End {
    found: Found,
    poses: Vec<Option<Isometry3<f64>>>,
    systematic_px: DVector<f64>,
    scale: f64,
    misfit: f64,
}

impl End {
    fn of(problem: &mut Problem<'_>, clocks: Vec<CameraClock>, unknowns: &[Unknown]) -> Option<Self> {
        problem.systematic_px.fill(0.0);
        let found = descend(problem, clocks, unknowns)?;
        let (poses, systematic_px) = (problem.poses.clone(), problem.systematic_px.clone());
        Some(Self { found, poses, systematic_px, scale: problem.scale, misfit: f64::INFINITY })
    }

    fn misfit(&self, problem: &mut Problem<'_>) -> f64 {
        problem.poses.clone_from(&self.poses);
        problem.systematic_px.clone_from(&self.systematic_px);
        let cameras: Vec<usize> = (0..problem.streams.len()).collect();
        problem.misfit(&self.found.clocks, &cameras, 1, f64::INFINITY).mean
    }
}

/// Gauss-Newton over the unknowns and the systematic errors; `None` where nothing is seen by two cameras.
fn descend(problem: &mut Problem<'_>, mut clocks: Vec<CameraClock>, unknowns: &[Unknown]) -> Option<Found> {
    let mut last: DVector<f64> = DVector::zeros(unknowns.len());
    for k in 0..=MOST_STEPS {
        let mut sums = problem.sums(&clocks, unknowns);
        problem.poses.clone_from(&sums.poses);
        if k < MOST_STEPS && sums.factors.len() < 2 * unknowns.len() + 2 {
            return None;
        }
        if k < MOST_STEPS {
            problem.scale = sums.scale();
        }
        problem.add_priors(&mut sums, &clocks, unknowns);
        let inverse = sums.normal.clone().cholesky()?.inverse();
        let mut std = deviations(problem, &sums, &inverse);
        if k == MOST_STEPS {
            // Still under way: where it will end is not known better than by the way that it still goes.
            std.iter_mut().zip(last.iter()).for_each(|(std, step)| *std = std.hypot(*step));
            return Some(Found { clocks, sums, std, is_end: false });
        }
        let step = -(&inverse * &sums.gradient);
        let mut largest: f64 = 0.0;
        for (u, (camera, part)) in unknowns.iter().enumerate() {
            let interval_s = problem.streams[*camera].interval_s;
            let most = [interval_s, 1e-3, interval_s * 1e-3][*part];
            *clocks[*camera].parts()[*part] += step[u].clamp(-most, most);
            largest = largest.max(step[u].abs() * (problem.scale * inverse[(u, u)]).sqrt().recip());
        }
        problem.systematic_px += step.rows_range(unknowns.len()..);
        last = step.rows(0, unknowns.len()).into_owned();
        if largest < CONVERGED_STD {
            return Some(Found { clocks, sums, std, is_end: true });
        }
    }
    None
}

/// Standard deviations of the unknowns: the larger of what white noise gives and what the scatter between
/// parts of the flight gives (Huber 1967; Liang & Zeger 1986), less what the velocities' noise only seems to
/// show.
fn deviations(problem: &Problem<'_>, sums: &Sums, inverse: &DMatrix<f64>) -> Vec<f64> {
    let count = sums.blocks.len() as f64;
    let mean: DVector<f64> = sums.blocks.iter().map(|b| b / count).sum();
    let apart = sums.blocks.iter().map(|b| b - &mean);
    let between: DMatrix<f64> = apart.map(|a| &a * a.transpose()).sum();
    let robust = inverse * between * inverse;
    let std = |(u, noise): (usize, &f64)| {
        let white = problem.scale * inverse[(u, u)];
        let share = 1.0 - noise * white;
        if share > 0.25 { (white.max(robust[(u, u)]) / share).sqrt() } else { f64::INFINITY }
    };
    sums.by_noise.iter().enumerate().map(std).collect()
}

/// What is made of the clocks shown.
fn conclude(problem: &Problem<'_>, found: &Found, unknowns: &[Unknown], out: &mut [ClockEstimate]) {
    for ((camera, part), std) in unknowns.iter().zip(&found.std) {
        let (stream, of) = (&problem.streams[*camera], &found.sums.by_camera[*camera]);
        let (estimate, std) = (&mut out[*camera], *std);
        estimate.shown = found.clocks[*camera];
        match *part {
            DRIFT => estimate.drift_std = std,
            LINE_TIME => {
                estimate.line_time_std_s = std;
                estimate.clock.line_time_s = estimate.shown.line_time_s;
            }
            _ => {
                estimate.offset_std_s = std;
                let speed_px_s = (of.speed2 / of.observations.max(1.0)).max(0.0).sqrt();
                let limit_s = DETERMINED_INTERVALS * stream.interval_s;
                let shift_s = (estimate.shown.offset_s - stream.prior.clock.offset_s).abs();
                let white_px = (of.observations / (2.0 * of.at_unit_speed).max(1e-300)).sqrt();
                let is_drifting = estimate.shown.drift != stream.prior.clock.drift;
                estimate.verdict = if std > limit_s && shift_s < 2.0 * SIGNIFICANT * std {
                    let needed_px_s = (problem.scale / of.at_unit_speed.max(1e-300)).sqrt() / limit_s;
                    let needed_m_s = needed_px_s * of.metres_a_pixel / of.observations.max(1.0);
                    ClockVerdict::TooSlow { speed_px_s, needed_px_s, needed_m_s }
                } else if is_drifting
                    || (shift_s >= SIGNIFICANT * std && shift_s * speed_px_s >= RELEVANT_STD * white_px)
                {
                    let line_time_s = estimate.clock.line_time_s;
                    estimate.clock = CameraClock { line_time_s, ..estimate.shown };
                    ClockVerdict::SetRight
                } else {
                    ClockVerdict::InStep
                };
            }
        }
    }
}
