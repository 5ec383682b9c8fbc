//! From a session to its results.

use crate::error::input;
use crate::identification::{identify_into, motion_into};
use crate::log_clock::LogBesidePoses;
use crate::{EngineError, TrackedFlight, calibrate, track};
use mavsight_flight::{InputSeries, SensorSeries, Vehicle};
use mavsight_identify::EquationFile;
use mavsight_identify::output_error::{MotionFits, fitted_stretch_s};
use mavsight_pipeline::{IdentifyOptions, Progress, motion_of, systematic_columns};
use mavsight_pose::{MarkerObservation, RateSeries};
use mavsight_session::logs::LogGyroscope;
use mavsight_session::{RunResults, Session, write_markers_early};
use std::path::Path;

/// What a user may choose of a run; the default is what a session file alone asks for.
#[derive(Debug, Clone, Copy, Default)]
pub struct Options<'a> {
    /// Whether output error is left out.
    pub equation_error_only: bool,
    /// What is to be added to the inputs' times; estimated where it is not given.
    pub lag_s: Option<f64>,
    /// From and to: a part of the flight that no fit uses, for validation.
    pub held_out_s: Option<(f64, f64)>,
    /// Whether output error searches the terms that the model's file marks as candidates.
    pub search: bool,
    /// Where the results will be written: `markers.csv` of a long flight waits there from early on, to save
    /// memory.
    pub results_folder: Option<&'a Path>,
}

/// What is known of a flight in addition to its frames.
#[derive(Debug, Clone)]
pub struct Flight<'a> {
    /// Name of the session.
    pub name: &'a str,
    /// The aircraft.
    pub vehicle: &'a Vehicle,
    /// Recorded inputs, where there are any.
    pub inputs: Option<&'a InputSeries>,
    /// Samples of the model's sensors by the clock of the poses, where there are any.
    pub sensors: Option<&'a SensorSeries>,
    /// The gyroscope of the log that the inputs are of, where they are of one: it gives the log's clock.
    pub gyroscope: Option<&'a LogGyroscope>,
    /// Samples of the model's sensors by the clock of that log, where it has any.
    pub log_sensors: Option<&'a SensorSeries>,
    /// How parameters are estimated.
    pub options: IdentifyOptions,
}

impl<'a> Flight<'a> {
    /// The flight of a session, with the equations that it names and without sensors. Output error is left out where these are of
    /// another aircraft than the vehicle file ([`EquationFile::is_of_another_aircraft`]).
    ///
    /// # Errors
    /// A model file that is wrong.
    pub fn of_session(
        session: &'a Session,
        inputs: Option<&'a InputSeries>,
        options: &Options<'_>,
    ) -> Result<Self, EngineError> {
        let mut identify = IdentifyOptions::default();
        identify.table.equations = input(session.equations())?;
        let is_other = |file: &EquationFile| file.is_of_another_aircraft(&session.vehicle);
        if options.equation_error_only || identify.table.equations.as_ref().is_some_and(is_other) {
            identify.motion_fits = MotionFits::NONE;
        }
        identify.lag_s = options.lag_s;
        identify.fit.held_out_s = options.held_out_s;
        identify.search = options.search;
        let (name, vehicle) = (&session.file.name, &session.vehicle);
        Ok(Self {
            name,
            vehicle,
            inputs,
            sensors: None,
            gyroscope: None,
            log_sensors: None,
            options: identify,
        })
    }

    /// This flight with samples of the model's sensors, as [`recorded_sensors`] reads them.
    #[must_use]
    pub fn with_sensors(self, sensors: Option<&'a SensorSeries>) -> Self {
        Self { sensors, ..self }
    }

    /// This flight with the gyroscope of the log that its inputs are of, and with the model's sensors in that log, as
    /// [`log_gyroscope`] and [`log_sensors`] read them.
    #[must_use]
    pub fn with_log(
        self,
        gyroscope: Option<&'a LogGyroscope>,
        log_sensors: Option<&'a SensorSeries>,
    ) -> Self {
        Self { gyroscope, log_sensors, ..self }
    }
}

/// The inputs of a session, where it has any.
///
/// # Errors
/// A table that is wrong.
pub fn recorded_inputs(session: &Session) -> Result<Option<InputSeries>, EngineError> {
    input(session.inputs())
}

/// The samples of a session's sensors, where it has any.
///
/// # Errors
/// A table that is wrong.
pub fn recorded_sensors(session: &Session) -> Result<Option<SensorSeries>, EngineError> {
    input(session.sensors())
}

/// The gyroscope of a session's log, where it has any.
///
/// # Errors
/// A log that is wrong.
pub fn log_gyroscope(session: &Session) -> Result<Option<LogGyroscope>, EngineError> {
    input(session.log_gyroscope())
}

/// The samples of the model's sensors in a session's log, where it has any, and what is to be said of them.
///
/// # Errors
/// A log that is wrong.
pub fn log_sensors(session: &Session) -> Result<(Option<SensorSeries>, Vec<String>), EngineError> {
    let sensors = input(session.log_sensors())?;
    Ok(sensors.map_or((None, Vec::new()), |sensors| (Some(sensors.value), sensors.notes)))
}

/// Carries a recorded session through all stages: cameras, observations, poses, motion and parameters, each
/// with its uncertainty, and notes on what could not be had.
///
/// # Errors
/// Files that are missing or wrong, recordings that cannot be read, and what calibration and tracking
/// refuse. A flight that moves too little for motion or parameters is no error.
pub fn run(
    session: &Session,
    options: &Options<'_>,
    progress: &dyn Progress,
) -> Result<RunResults, EngineError> {
    let (inputs, sensors) = (input(session.noted_inputs())?, recorded_sensors(session)?);
    let (gyroscope, (log_sensors, of_sensors)) = (log_gyroscope(session)?, log_sensors(session)?);
    let (inputs, notes) = inputs.map_or((None, Vec::new()), |inputs| (Some(inputs.value), inputs.notes));
    let rig = calibrate(session, progress)?;
    let tracked = track(session, rig, progress)?;
    let flight = Flight::of_session(session, inputs.as_ref(), options)?
        .with_sensors(sensors.as_ref())
        .with_log(gyroscope.as_ref(), log_sensors.as_ref());
    let mut results = solve(&flight, tracked, options.results_folder, progress)?;
    results.notes.extend(notes);
    results.notes.extend(of_sensors);
    Ok(results)
}

/// The results of a tracked flight with its motion, into which the gyroscope of the log goes where the flight has one;
/// without parameters. Why there is no motion becomes a note.
pub fn smooth_tracked(flight: &Flight<'_>, tracked: TrackedFlight, progress: &dyn Progress) -> RunResults {
    let of_film = |rates: Option<&RateSeries>| motion_of(&tracked.tracked, rates, flight.vehicle, progress);
    let motion = of_film(None);
    let log = LogBesidePoses::of(&tracked.tracked.poses, flight, |rates| of_film(Some(rates)));
    let mut results = tracked.into_results(flight.name, flight.vehicle);
    motion_into(&mut results, motion, log);
    results
}

/// Smooths the poses of a tracked flight into motion and identifies its parameters. Where a folder for the
/// results is given, the observations of a long flight wait in it, and the results keep those that output
/// error needs.
///
/// # Errors
/// A model, a setting or a vehicle that is wrong; a folder that cannot be written.
pub fn solve(
    flight: &Flight<'_>,
    mut tracked: TrackedFlight,
    folder: Option<&Path>,
    progress: &dyn Progress,
) -> Result<RunResults, EngineError> {
    let of_film = |rates: Option<&RateSeries>| motion_of(&tracked.tracked, rates, flight.vehicle, progress);
    let motion = of_film(None);
    let log = LogBesidePoses::of(&tracked.tracked.poses, flight, |rates| of_film(Some(rates)));
    // Large lists of a long flight are freed as soon as nothing needs them.
    drop(std::mem::take(&mut tracked.tracked.diameters_px));
    let systematic = systematic_columns(&tracked.tracked);
    let (mut results, observations) = tracked.split(flight.name, flight.vehicle);
    match folder.zip(fitted_stretch_s(&results.poses)) {
        // From here on only output error looks at images, and of a long flight at a minute.
        Some((folder, (from_s, to_s))) => {
            let is_needed = |o: &MarkerObservation| (from_s..=to_s).contains(&(o.t_ns as f64 * 1e-9));
            write_markers_early(folder, &mut results, &observations, is_needed)?;
        }
        None => results.markers = observations.iter().collect(),
    }
    drop(observations);
    let mut condensed = Vec::with_capacity(systematic.len());
    for (k, columns) in systematic {
        let pose = &mut results.poses[k];
        condensed.push((k, pose.estimate.clone()));
        pose.estimate = pose.estimate.clone().map(|e| e.with_systematic(&columns));
    }
    identify_into(&mut results, motion, log, flight, progress)?;
    for (k, estimate) in condensed {
        results.poses[k].estimate = estimate;
    }
    Ok(results)
}
