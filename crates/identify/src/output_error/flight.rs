//! Output error on all that was recorded of a flight.

use super::adequacy::Adequacy;
use super::ahead::FILTERED_S;
use super::measure::{Measurements, StateMeasurement};
use super::model::FlightModel;
use super::prediction::predict_poses;
use super::structure::terms_asked_for;
use super::{
    ImageMeasurements, InitialStates, OutputErrorFit, OutputErrorOptions, filter_error, output_error,
    predict_ahead, search_structure, seconds,
};
use crate::IdentifyError;
use mavsight_flight::{InputSeries, SensorSeries, Vehicle};
use mavsight_pose::{BodyMarker, MarkerObservation, PoseSample, Rig};
use std::thread::ScopedJoinHandle;
use std::time::Duration;

/// What the images of a flight are made of.
#[derive(Debug, Clone, Copy)]
pub struct Images<'a> {
    /// Cameras, with what their calibration leaves open.
    pub rig: &'a Rig,
    /// Markers of the body.
    pub markers: &'a [BodyMarker],
    /// Standard deviation of a coordinate of a marker on the body.
    pub markers_std_m: f64,
    /// Where they were seen.
    pub observations: &'a [MarkerObservation],
}

/// What is known of the inputs' clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum InputClock {
    /// It is that of the measurements.
    Known,
    /// It may be early or late.
    #[default]
    Free,
}

/// Which fits of the equations of motion are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MotionFits {
    /// Output error, from poses and from images.
    pub output_error: bool,
    /// Filter error, from poses.
    pub filter_error: bool,
}

impl MotionFits {
    /// None of them.
    pub const NONE: Self = Self { output_error: false, filter_error: false };
}

impl Default for MotionFits {
    fn default() -> Self {
        Self { output_error: true, filter_error: true }
    }
}

/// What a user may choose of [`FlightFits::of_flight`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FlightFitOptions<'a> {
    /// The inputs' clock.
    pub clock: InputClock,
    /// From and to: what is seen in this part of the flight is not fitted but predicted.
    pub held_out_s: Option<(f64, f64)>,
    /// The fits.
    pub fits: MotionFits,
    /// Whether terms that the model's file marks as candidates are searched ([`search_structure`]).
    pub search: bool,
    /// Samples of the model's sensors by the clock of the poses, which both fits then take in.
    pub sensors: Option<&'a SensorSeries>,
    /// Times, in order, from which on the motion begins anew ([`Measurements::beginning_anew`]).
    pub anew_ns: &'a [i64],
    /// Whether what was recorded begins in flight: the model's further states then begin anywhere.
    pub begins_in_flight: bool,
    /// Time that each fit may take ([`OutputErrorOptions::at_most`]).
    pub at_most: Option<Duration>,
}

impl FlightFitOptions<'_> {
    pub(super) fn of_fit(&self, initial: InitialStates) -> OutputErrorOptions {
        OutputErrorOptions { initial, at_most: self.at_most, ..OutputErrorOptions::default() }
    }

    pub(super) fn holds_out(&self, t_ns: i64) -> bool {
        let t_s = t_ns as f64 * 1e-9;
        self.held_out_s.is_some_and(|(from_s, to_s)| t_s >= from_s && t_s <= to_s)
    }

    /// The poses by which the state at the beginning of what is held out is filtered; none where nothing is.
    fn filtered_before<'p>(&self, poses: &'p [PoseSample]) -> &'p [PoseSample] {
        let Some((from_s, _)) = self.held_out_s else { return &[] };
        within(poses, Some((from_s - FILTERED_S, from_s)), |p| p.t_ns)
    }
}

/// The fits of a flight by output error.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FlightFits {
    /// To the poses.
    pub poses: Option<OutputErrorFit>,
    /// To the poses, by filter error.
    pub filter: Option<OutputErrorFit>,
    /// To the images of the markers.
    pub image: Option<OutputErrorFit>,
    /// What speaks against the model.
    pub adequacy: Adequacy,
    /// Parameters that would be free had the inputs moved what they act on.
    pub held: Vec<String>,
    /// Fits that were refused, and why.
    pub refusals: Vec<String>,
    /// First and last time of what was fitted, where that is less than the flight.
    pub stretch_s: Option<(f64, f64)>,
    /// Coefficients of equation error over the parameters of the same names
    /// ([`Model::equation_over_motion`]).
    pub(super) equation_over_motion: Vec<(String, f64)>,
}

/// A flight is fitted in one piece up to this length, since a fit holds tens of kilobytes for each instant: a
/// minute is twenty time constants of the fly-bar, the slowest that is fitted, and six manoeuvres.
const LONGEST_S: f64 = 60.0;

/// How far ahead the part that is held out is predicted: long for a small aircraft, short enough for an unstable
/// one.
const AHEAD_S: f64 = 1.0;

/// Names of fits in `parameters.csv`.
pub const OUTPUT_ERROR: &str = "oe";
/// See [`OUTPUT_ERROR`].
pub const FILTER_ERROR: &str = "fe";

impl FlightFits {
    /// Fits the default model of a vehicle ([`FlightModel::new`]) to the poses, by output error and by filter
    /// error, and to the images where there are some.
    ///
    /// Of a flight that is longer than a minute, the minute is fitted in which it turns most
    /// ([`fitted_stretch_s`]); its further states begin anywhere, where it is not the flight's first.
    ///
    /// Where the clocks are not known to agree, the lag of the inputs is free too: what is not known of it is
    /// then in all intervals. A flight that does not determine it is fitted without. What is held out enters
    /// no fit; each then predicts its poses. Where filter error contradicts output error, no parameter of output
    /// error is determined. Candidate terms are searched on the poses; the fit to the images has those that were
    /// added, and the notes of the fit to the poses say which and why. With a search the further states begin
    /// anywhere.
    ///
    /// # Errors
    /// A vehicle that is not valid; sensors that are not those of the model; refusals of a fit become sentences.
    pub fn of_flight(
        vehicle: &Vehicle,
        inputs: &InputSeries,
        poses: &[PoseSample],
        images: Option<Images<'_>>,
        options: &FlightFitOptions<'_>,
    ) -> Result<Self, IdentifyError> {
        let sensors = options.sensors.map(|s| s.within(|t_ns| !options.holds_out(t_ns)));
        let free = if sensors.is_some() { FlightModel::with_outputs } else { FlightModel::new };
        let mut model = free(vehicle, inputs)?;
        let stretch_s = fitted_stretch_s(poses);
        let begins =
            stretch_s.is_none_or(|(from_s, _)| poses.first().is_some_and(|p| seconds(p.t_ns) >= from_s));
        // A search doubts the model, and so the trim in which it begins.
        let is_known = begins && !options.search && !options.begins_in_flight;
        let initial = if is_known { InitialStates::AsModelled } else { InitialStates::Free };
        let defaults = options.of_fit(initial);
        let poses = within(poses, stretch_s, |p| p.t_ns);
        let images =
            images.map(|i| Images { observations: within(i.observations, stretch_s, |o| o.t_ns), ..i });
        let out: Vec<PoseSample> = poses.iter().filter(|p| options.holds_out(p.t_ns)).cloned().collect();
        let before = options.filtered_before(poses);
        let fitted = poses.iter().filter(|p| p.estimate.is_ok() && !options.holds_out(p.t_ns));
        let sensed = |measured: Measurements| match &sensors {
            Some(sensors) => measured.with_sensors(&vehicle.model, sensors),
            None => Ok(measured),
        };
        let states = Measurements::States(StateMeasurement::of_poses(fitted));
        let states = sensed(states.beginning_anew(options.anew_ns))?;
        let mut refusals = Vec::new();
        let search = options.search.then(|| {
            with_clock(&model, options.clock, |model| search_structure(model, inputs, &states, &defaults))
        });
        let found = search.and_then(|search| {
            search.map_err(|why| refusals.push(format!("No search for missing terms: {why}"))).ok()
        });
        if let Some(found) = &found {
            model = found.extended(model)?;
        }
        let fit = |estimate: Estimate, measured: &Measurements| {
            fitted_with_clock(&model, options.clock, |model| estimate(model, inputs, measured, &defaults))
        };
        let free = OutputErrorOptions { initial: InitialStates::Free, ..defaults };
        let ask =
            || with_clock(&model, options.clock, |model| terms_asked_for(model, inputs, &states, &free));
        let (poses, filter, image, asked_for) = std::thread::scope(|scope| {
            let image = images.filter(|_| options.fits.output_error).map(|images| {
                scope.spawn(move || fit(output_error, &sensed(images.measurements(options)?)?))
            });
            let asked_for = (options.fits == MotionFits::default()).then(|| scope.spawn(ask));
            let filter = options.fits.filter_error.then(|| scope.spawn(|| fit(filter_error, &states)));
            let poses = match found {
                Some(found) => Some(Ok(found.into_fit())),
                None => options.fits.output_error.then(|| fit(output_error, &states)),
            };
            (poses, joined(filter), joined(image), joined(asked_for))
        });
        let held_out = HeldOut { model: &model, inputs, before, poses: out };
        let mut kept = |what: &str, fit: Result<OutputErrorFit, IdentifyError>| {
            let mut fit = fit.map_err(|why| refusals.push(format!("No {what}: {why}"))).ok()?;
            if options.held_out_s.is_some() {
                let why = held_out.predict_by(&mut fit);
                refusals.extend(why.into_iter().map(|why| format!("No prediction by {what}: {why}")));
            }
            Some(fit)
        };
        let poses = poses.and_then(|fit| kept("output error from poses", fit));
        let filter = filter.and_then(|fit| kept("filter error", fit));
        let image = image.and_then(|fit| kept("output error from images", fit));
        let own = model.inputs_of(inputs)?;
        let rows = (0..own.times_s().len()).map(|k| own.row(k));
        let equation_over_motion = model.model().equation_over_motion(model.values(), rows);
        let held = model.held();
        let mut out =
            Self { poses, filter, image, held, refusals, stretch_s, equation_over_motion, ..Self::default() };
        out.doubt(asked_for);
        Ok(out)
    }

    /// The fits with their names in `parameters.csv`.
    pub fn named(&self) -> impl Iterator<Item = (&'static str, &OutputErrorFit)> {
        [(OUTPUT_ERROR, &self.poses), (FILTER_ERROR, &self.filter), ("image", &self.image)]
            .into_iter()
            .filter_map(|(name, fit)| Some((name, fit.as_ref()?)))
    }
}

pub(super) type Estimate = fn(
    &FlightModel,
    &InputSeries,
    &Measurements,
    &OutputErrorOptions,
) -> Result<OutputErrorFit, IdentifyError>;

/// A fit of a model with the lag of the inputs free too, where their clock is not known; without, where the
/// flight does not determine it.
pub(super) fn with_clock<T>(
    model: &FlightModel,
    clock: InputClock,
    fit: impl Fn(&FlightModel) -> Result<T, IdentifyError>,
) -> Result<T, IdentifyError> {
    with_lag_or_why(model, clock, fit).map(|(found, _)| found)
}

/// [`with_clock`] of a fit that says so in its notes where its lag was to be free and could not be.
pub(super) fn fitted_with_clock(
    model: &FlightModel,
    clock: InputClock,
    fit: impl Fn(&FlightModel) -> Result<OutputErrorFit, IdentifyError>,
) -> Result<OutputErrorFit, IdentifyError> {
    let (mut found, held) = with_lag_or_why(model, clock, fit)?;
    if let Some(IdentifyError::FitNotConverged { .. }) = held {
        found.notes.push(format!(
            "The fit with the lag of the inputs free did not converge: the lag is held at {:.1} ms, and no interval includes what is \
             not known of it.",
            1e3 * model.input_lag_s
        ));
    }
    Ok(found)
}

fn with_lag_or_why<T>(
    model: &FlightModel,
    clock: InputClock,
    fit: impl Fn(&FlightModel) -> Result<T, IdentifyError>,
) -> Result<(T, Option<IdentifyError>), IdentifyError> {
    if clock == InputClock::Known {
        return Ok((fit(model)?, None));
    }
    match fit(&model.clone().with_free_lag()) {
        // Shifted times may lie outside the inputs, or the inputs may move too little to determine the lag.
        Err(
            why @ (IdentifyError::NotDetermined { .. }
            | IdentifyError::Flight(_)
            | IdentifyError::FitNotConverged { .. }),
        ) => Ok((fit(model)?, Some(why))),
        fitted => Ok((fitted?, None)),
    }
}

/// The result of a thread; none where there was none. Its panic goes on here.
fn joined<T>(thread: Option<ScopedJoinHandle<'_, T>>) -> Option<T> {
    thread.map(|thread| thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
}

/// What is held out of the fits of a flight, to be predicted by each.
struct HeldOut<'a> {
    model: &'a FlightModel,
    inputs: &'a InputSeries,
    /// Poses before it, from which the first state to predict from is filtered.
    before: &'a [PoseSample],
    poses: Vec<PoseSample>,
}

impl HeldOut<'_> {
    /// Lets a fit predict what is held out, all of it and a second ahead; the reasons why it cannot.
    fn predict_by(&self, fit: &mut OutputErrorFit) -> Vec<IdentifyError> {
        let mut refusals = Vec::new();
        let whole = predict_poses(self.model, fit, self.inputs, &self.poses);
        fit.held_out = whole.map_err(|why| refusals.push(why)).ok();
        let fitted =
            self.before.iter().filter(|p| self.poses.first().is_none_or(|first| p.t_ns < first.t_ns));
        let states = StateMeasurement::of_poses(fitted.chain(&self.poses));
        let ahead = predict_ahead(self.model, fit, self.inputs, &states, AHEAD_S);
        fit.ahead = ahead.map_err(|why| refusals.push(why)).ok().flatten();
        refusals
    }
}

/// What lies in a stretch of something that is in order of time.
fn within<T>(all: &[T], stretch_s: Option<(f64, f64)>, t_ns: impl Fn(&T) -> i64) -> &[T] {
    let Some((from_s, to_s)) = stretch_s else { return all };
    let place = |t_s: f64, also: bool| {
        all.partition_point(|x| seconds(t_ns(x)) < t_s || (also && seconds(t_ns(x)) <= t_s))
    };
    &all[place(from_s, false)..place(to_s, true)]
}

/// Of a flight that is too long for output error to fit in one piece, first and last time of the minute in
/// which the aircraft turns most: the largest sum of squared angles from one pose to the next. Stretches
/// begin every quarter of a minute.
pub fn fitted_stretch_s(poses: &[PoseSample]) -> Option<(f64, f64)> {
    let (begin_s, end_s) = (seconds(poses.first()?.t_ns), seconds(poses.last()?.t_ns));
    if end_s - begin_s <= LONGEST_S {
        return None;
    }
    let turned = |from_s: f64| {
        let own = within(poses, Some((from_s, from_s + LONGEST_S)), |p| p.t_ns);
        let turns = own.windows(2).filter_map(|w| {
            let [a, b] = [&w[0], &w[1]].map(|p| p.estimate.as_ref().ok().map(|e| e.world_from_body.rotation));
            Some(a?.angle_to(&b?).powi(2))
        });
        turns.sum::<f64>()
    };
    let last = ((end_s - begin_s - LONGEST_S) / (0.25 * LONGEST_S)).floor();
    // A stretch with any pose begins less than its length before that pose.
    let mut quarters: Vec<u64> = poses
        .iter()
        .map(|p| ((seconds(p.t_ns) - begin_s) / (0.25 * LONGEST_S)).floor().clamp(0.0, last) as u64)
        .flat_map(|quarter| quarter.saturating_sub(3)..=quarter)
        .collect();
    quarters.sort_unstable();
    quarters.dedup();
    let all = quarters.into_iter().rev().map(|k| begin_s + 0.25 * LONGEST_S * k as f64);
    // Of equal ones the first.
    let (best_s, _) = all.map(|from_s| (from_s, turned(from_s))).max_by(|a, b| a.1.total_cmp(&b.1))?;
    Some((best_s, best_s + LONGEST_S))
}

impl Images<'_> {
    fn measurements(&self, options: &FlightFitOptions<'_>) -> Result<Measurements, IdentifyError> {
        let fitted: Vec<MarkerObservation> =
            self.observations.iter().filter(|o| !options.holds_out(o.t_ns)).cloned().collect();
        let images = ImageMeasurements::new(self.rig, self.markers, &fitted)?
            .with_cameras(self.rig)?
            .with_marker_positions(self.markers_std_m);
        Ok(Measurements::Image(images).beginning_anew(options.anew_ns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::{Isometry3, Matrix6, Vector3};
    use mavsight_pose::{PoseError, PoseEstimate};

    fn poses(count: i64, turn_rad: impl Fn(f64) -> f64) -> Vec<PoseSample> {
        let estimate = |t_s: f64| {
            PoseEstimate::new(
                Isometry3::new(Vector3::zeros(), Vector3::y() * turn_rad(t_s)),
                &Matrix6::identity(),
            )
        };
        let pose = |k: i64| PoseSample {
            t_ns: k * 100_000_000,
            estimate: (k % 7 != 0).then(|| estimate(0.1 * k as f64)).ok_or(PoseError::NotMeasured),
        };
        (0..count).map(pose).collect()
    }

    #[test]
    fn a_long_flight_is_fitted_where_it_turns_most() {
        let poses = poses(6001, |t| if (400.0..410.0).contains(&t) { t.sin() } else { 1e-3 * t.sin() });
        let stretch = fitted_stretch_s(&poses).expect("a stretch");
        assert!(
            stretch.0 <= 400.0 && stretch.1 >= 410.0 && stretch.1 - stretch.0 == LONGEST_S,
            "{stretch:?}"
        );
        let inside = within(&poses, Some(stretch), |p| p.t_ns);
        assert_eq!(inside.len(), 601);
        assert_eq!((seconds(inside[0].t_ns), seconds(inside[600].t_ns)), stretch);
    }

    #[test]
    fn a_short_flight_and_one_without_poses_are_whole() {
        assert_eq!(fitted_stretch_s(&poses(600, f64::sin)), None);
        assert_eq!(fitted_stretch_s(&[]), None);
        // A last time stamp that is none takes no longer than any other.
        let mut late = poses(1200, f64::sin);
        late.last_mut().expect("a pose").t_ns = i64::MAX;
        assert!(fitted_stretch_s(&late).is_some_and(|(from_s, _)| from_s < 60.0));
        // What stands still says nothing: the first minute.
        assert_eq!(fitted_stretch_s(&poses(6001, |_| 0.0)), Some((0.0, LONGEST_S)));
        assert_eq!(within(&[1, 2, 3], None, |t| *t).len(), 3);
    }
}
