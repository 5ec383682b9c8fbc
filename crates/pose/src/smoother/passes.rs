//! The filter forward and the smoother backward over what was measured.

use crate::smoother::integrator::{CHAIN, Transition};
use crate::smoother::jumps::Jumps;
use crate::smoother::rates::Rates;
use crate::smoother::state::{Adjoint, Joint, MotionNoise, Update};
use crate::{PoseEstimate, PoseSample};
use nalgebra::Matrix6xX;
use std::borrow::Cow;
use std::ops::Range;

/// Systematic columns of a pose by its index; none: those that it holds.
pub type EffectsOf<'a> = &'a dyn Fn(usize) -> Option<Matrix6xX<f64>>;

/// What happens at a time: an instant of the poses, measured or not, or a mean of rates, by their numbers.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Instant {
    Pose(usize),
    Rates(usize),
}

/// Poses with their systematic columns, formed as they are asked for, and the rates between them.
pub(crate) struct Flown<'a> {
    pub(crate) poses: &'a [PoseSample],
    /// Index of the first of the poses among all.
    first: usize,
    effects: EffectsOf<'a>,
    rates: Option<&'a Rates>,
    /// In order, from the first pose to the last.
    pub(crate) instants: Vec<Instant>,
    /// Jerk beyond that of the noise.
    pub(crate) jumps: Jumps,
    /// Systematic columns of the pose that has most; those of the rates follow.
    pose_columns: usize,
    rate_columns: usize,
}

impl<'a> Flown<'a> {
    pub(crate) fn new(
        poses: &'a [PoseSample],
        first: usize,
        effects: EffectsOf<'a>,
        rates: Option<&'a Rates>,
    ) -> Self {
        let rate_columns = rates.map_or(0, Rates::columns);
        let (instants, jumps) = (Vec::new(), Jumps::default());
        let mut flown = Self { poses, first, effects, rates, instants, jumps, pose_columns: 0, rate_columns };
        flown.pose_columns = flown.columns();
        for (k, pose) in poses.iter().enumerate() {
            flown.instants.push(Instant::Pose(k));
            let (Some(rates), Some(next)) = (rates, poses.get(k + 1)) else { continue };
            flown.instants.extend(rates.between(pose.t_ns, next.t_ns - 1).map(Instant::Rates));
        }
        flown
    }

    /// With systematic errors of the rates alone, whatever the poses hold.
    pub(crate) fn with_errors_of_rates(
        poses: &'a [PoseSample],
        first: usize,
        rates: Option<&'a Rates>,
    ) -> Self {
        Self { pose_columns: 0, ..Self::new(poses, first, &|_| Some(Matrix6xX::zeros(0)), rates) }
    }

    /// Without systematic errors, which do not change how poses agree.
    pub(crate) fn without_effects(poses: &'a [PoseSample], first: usize, rates: Option<&'a Rates>) -> Self {
        Self { rate_columns: 0, ..Self::with_errors_of_rates(poses, first, rates) }
    }

    /// Times of the instants at which something is measured, with their numbers.
    pub(crate) fn measured(&self) -> impl Iterator<Item = (usize, i64)> {
        let is_measured = |instant: &Instant| match instant {
            Instant::Pose(k) => self.poses[*k].estimate.is_ok(),
            Instant::Rates(_) => true,
        };
        let instants = self.instants.iter().enumerate().filter(move |(_, instant)| is_measured(instant));
        instants.map(|(number, instant)| (number, self.t_ns(*instant)))
    }

    /// Whether rates are measured too.
    pub(crate) fn has_rates(&self) -> bool {
        self.rates.is_some()
    }

    /// Time from the instant before to one, s; the first has none.
    pub(crate) fn interval_s(&self, instant: usize) -> Option<f64> {
        let before = instant.checked_sub(1)?;
        let t_ns = |k: usize| self.t_ns(self.instants[k]);
        Some((t_ns(instant) - t_ns(before)) as f64 * 1e-9)
    }

    /// Moves a state over the interval before an instant, on or back.
    fn predict(&self, before: usize, dt_s: f64, state: &mut Joint, noise: &MotionNoise) -> [Transition; 2] {
        let transitions = state.predict(dt_s, noise);
        if let Some(jerk) = self.jumps.before(before) {
            state.loosen(dt_s, jerk);
        }
        transitions
    }

    fn t_ns(&self, instant: Instant) -> i64 {
        match (instant, self.rates) {
            (Instant::Rates(j), Some(rates)) => rates.mean(j).t_ns,
            (Instant::Pose(k) | Instant::Rates(k), _) => self.poses[k].t_ns,
        }
    }

    /// Updates a state by what is measured at an instant.
    fn update(&self, instant: Instant, state: &mut Joint, noise: &MotionNoise) -> Option<Updates> {
        let mut done = Updates::default();
        match (instant, self.rates) {
            (Instant::Rates(j), Some(rates)) => {
                let mut blank = state.blank_update();
                state.update_by_rates(rates, rates.mean(j), self.pose_columns, &mut blank)?;
                done.rates = Some(blank);
            }
            (Instant::Pose(k) | Instant::Rates(k), _) => {
                if let Some(seen) = self.estimate(k) {
                    let mut blank = state.blank_update();
                    state.update(&seen, noise, &mut blank)?;
                    done.pose = Some(blank);
                }
            }
        }
        Some(done)
    }

    fn estimate(&self, k: usize) -> Option<Cow<'a, PoseEstimate>> {
        let estimate = self.poses[k].estimate.as_ref().ok()?;
        Some(match (self.effects)(self.first + k) {
            Some(columns) => Cow::Owned(estimate.clone().with_rounded(&columns)),
            None => Cow::Borrowed(estimate),
        })
    }

    /// Systematic columns of the pose that has most.
    fn columns(&self) -> usize {
        let formed =
            (0..self.poses.len()).find_map(|k| self.estimate(k)).map_or(0, |e| e.systematic_columns());
        let held = self.poses.iter().filter_map(|p| Some(p.estimate.as_ref().ok()?.systematic_columns()));
        held.fold(formed, usize::max)
    }
}

/// What was measured at an instant.
#[derive(Default)]
pub(crate) struct Updates {
    pub(crate) pose: Option<Update>,
    rates: Option<Update<3>>,
}

/// What the forward pass leaves at an instant.
pub(crate) struct Step {
    pub(crate) filtered: Joint,
    transitions: Option<[Transition; 2]>,
    pub(crate) updates: Updates,
}

/// Share of the whole record's information that the smoother's start carries: little enough not to count,
/// enough that the backward pass does not cancel a diffuse covariance digit by digit.
const START_SHARE: f64 = 1e-4;

/// The state at the first time as the whole record, filtered backwards, gives it, with a covariance that
/// makes it next to worthless; the first steps of an attitude are linearised there.
pub(crate) fn informed_start(flown: &Flown<'_>, noise: &MotionNoise) -> Option<Joint> {
    let last = flown.poses.iter().rposition(|p| p.estimate.is_ok())?;
    let columns = flown.pose_columns + flown.rate_columns;
    let mut state = Joint::start(flown.estimate(last)?.as_ref(), columns, noise);
    let mut after_ns = flown.poses[last].t_ns;
    let last = flown.instants.iter().rposition(|i| matches!(i, Instant::Pose(k) if *k == last))?;
    for (before, instant) in flown.instants[..last].iter().enumerate().rev() {
        let t_ns = flown.t_ns(*instant);
        flown.predict(before + 1, (t_ns - after_ns) as f64 * 1e-9, &mut state, noise);
        flown.update(*instant, &mut state, noise)?;
        after_ns = t_ns;
    }
    state.covariance /= START_SHARE;
    // Its variance is known beforehand: what is not known of the motion must not be sought in it.
    state.forget_correlated(noise);
    Some(state)
}

/// The filter over some instants, from the state before them; the first of all is measured.
pub(crate) fn forward(
    flown: &Flown<'_>,
    instants: Range<usize>,
    noise: &MotionNoise,
    state: &mut Joint,
) -> Option<Vec<Step>> {
    let mut steps = Vec::with_capacity(instants.len());
    for k in instants {
        let transitions = flown.interval_s(k).map(|dt_s| flown.predict(k, dt_s, state, noise));
        let updates = flown.update(flown.instants[k], state, noise)?;
        steps.push(Step { filtered: state.clone(), transitions, updates });
    }
    Some(steps)
}

/// What a pose is next to the others, each chi-square with six degrees of freedom.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Checked {
    /// Its innovation.
    pub(crate) innovation: f64,
    /// Its difference from what all others say of it.
    pub(crate) disagreement: f64,
}

/// Calls `visit` with each pose's number, the smoothed state there and how the pose agrees, the last first, until
/// it has none; the first of the instants is a measured pose.
pub(crate) fn each_smoothed(
    flown: &Flown<'_>,
    noise: &MotionNoise,
    mut visit: impl FnMut(usize, Joint, Option<Checked>) -> Option<()>,
) -> Option<()> {
    let at_pose = |k: usize, step: &Step, later: &Adjoint| {
        let smoothed = later.smoothed(&step.filtered);
        is_sound(&smoothed).then_some(())?;
        let mut checked = None;
        if let Some(update) = &step.updates.pose {
            let (innovation, disagreement) = (update.chi_square(), later.disagreement(update)?);
            checked = Some(Checked { innovation, disagreement });
        }
        visit(k, smoothed, checked)
    };
    backward(flown, noise, at_pose, |_, _| ())
}

/// The backward pass, the last instant first. `at_pose` gets each pose's number, what the forward pass left there and the
/// information of all later measurements; `behind` the number of each instant and the information of what was measured from
/// then on. Only one stretch of √n steps is held at a time: each is filtered once more when the backward pass comes to it
/// (checkpoints, Griewank 1992).
pub(crate) fn backward(
    flown: &Flown<'_>,
    noise: &MotionNoise,
    mut at_pose: impl FnMut(usize, &Step, &Adjoint) -> Option<()>,
    mut behind: impl FnMut(usize, &Adjoint),
) -> Option<()> {
    let count = flown.instants.len();
    let stretch = ((count as f64).sqrt() as usize).max(64);
    let instants = |part: usize| part * stretch..((part + 1) * stretch).min(count);
    let mut state = informed_start(flown, noise)?;
    let mut starts = Vec::new();
    for part in 0..count.div_ceil(stretch) {
        starts.push(state.clone());
        forward(flown, instants(part), noise, &mut state)?;
    }
    let mut adjoint = Adjoint::nothing(state.effects.ncols());
    for (part, start) in starts.iter().enumerate().rev() {
        let steps = forward(flown, instants(part), noise, &mut start.clone())?;
        for (k, step) in instants(part).zip(&steps).rev() {
            if let Instant::Pose(pose) = flown.instants[k] {
                at_pose(pose, step, &adjoint)?;
            }
            if let Some(update) = &step.updates.pose {
                adjoint.before_update(update);
            }
            if let Some(update) = &step.updates.rates {
                adjoint.before_rates(update);
            }
            behind(k, &adjoint);
            if let Some(transitions) = &step.transitions {
                adjoint.before_predict(transitions);
            }
        }
    }
    Some(())
}

fn is_sound(state: &Joint) -> bool {
    let mut known = (0..9).chain(CHAIN..CHAIN + 9);
    state.covariance.iter().all(|v| v.is_finite()) && known.all(|i| state.covariance[(i, i)] > 0.0)
}
