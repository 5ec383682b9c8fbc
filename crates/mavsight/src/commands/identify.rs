//! Identification by itself, on a table of poses or of motion from any system.

use super::flights::{Fitted, distinct, heading, pool};
use super::run::require_a_pose;
use super::stages::beside_other_stages;
use super::{named, require_folder};
use crate::cli::{Identify, WrongCall};
use crate::out::{out, outln};
use crate::progress::Bars;
use anyhow::Result;
use mavsight_engine::{Flight, identify_from_log, identify_from_motion, identify_from_poses};
use mavsight_flight::{InputSeries, SensorSeries, Vehicle};
use mavsight_identify::output_error::{FILTER_ERROR, MotionFits, OUTPUT_ERROR};
use mavsight_identify::{Band, Bandwidth, EquationFile, Estimator, FitOptions, Options};
use mavsight_pipeline::IdentifyOptions;
use mavsight_report::{Summary, parameter_text};
use mavsight_session::foreign::Noted;
use mavsight_session::logs::{
    LogGyroscope, read_log_gyroscope, read_log_inputs, read_log_sensors, unit_by_model,
};
use mavsight_session::{
    FlightTable, RunResults, load_equations, load_vehicle, read_flight_table, read_summary,
    results::names,
    tables::{read_inputs, read_sensors},
    write_results,
};
use std::path::{Path, PathBuf};

pub(crate) fn identify(args: &Identify) -> Result<()> {
    refuse_without_effect(args)?;
    let vehicle = named(load_vehicle(&args.vehicle))?;
    args.out.as_deref().map_or(Ok(()), require_folder)?;
    let options = options(args, &vehicle)?;
    let vehicle = options.table.equations.as_ref().map_or(vehicle.clone(), |file| file.vehicle(&vehicle));
    let log = args.log.as_deref().map(|file| RecordedLog::read(args, file, &vehicle)).transpose()?;
    if let Some(log) = log.as_ref().filter(|_| args.tables.is_empty()) {
        return identify_log(args, log, &log.flight(&vehicle, &options));
    }
    let flights = recorded_flights(args, &vehicle)?;
    let bars = Bars::new();
    let one = |flight: Recorded, session: String, out: Option<&Path>| {
        if let Some(log) = &log {
            return identify_one(flight.table, session, &log.flight(&vehicle, &options), out, &bars);
        }
        let inputs = flight.inputs.as_deref().map(|path| named(read_inputs(path, &vehicle))).transpose()?;
        let sensors =
            flight.sensors.as_deref().map(|path| named(read_sensors(path, &vehicle.model))).transpose()?;
        let of = Flight {
            name: &vehicle.name,
            vehicle: &vehicle,
            inputs: inputs.as_ref(),
            sensors: sensors.as_ref(),
            gyroscope: None,
            log_sensors: None,
            options: options.clone(),
        };
        identify_one(flight.table, session, &of, out, &bars)
    };
    let names = distinct(flights.iter().map(|f| f.name.clone()).collect());
    if names.len() == 1 {
        let session = session_of(args).unwrap_or_else(|| vehicle.name.clone());
        let measured = flights.into_iter().map(|flight| one(flight, session.clone(), args.out.as_deref()));
        let results = measured.collect::<Result<Vec<RunResults>>>()?;
        bars.done();
        let require_all = |results| require_a_pose(results).and_then(|()| require_a_result(results));
        return results.first().map_or(Ok(()), require_all);
    }
    let mut fitted = Vec::new();
    for (flight, name) in flights.into_iter().zip(&names) {
        heading(name)?;
        let out = args.out.as_ref().map(|out| out.join(name));
        fitted.push(Fitted::of(one(flight, name.clone(), out.as_deref())?));
    }
    bars.done();
    pool(&vehicle.name, &names, &fitted, args.out.as_deref())
}

/// Options that nothing would come of.
fn refuse_without_effect(args: &Identify) -> Result<(), WrongCall> {
    if let Some(option) = args.mapping.given().filter(|_| args.log.is_none()) {
        let message = format!(
            "{option}: names fields of the aircraft's own log, and none is given: add --log FILE, or leave {option} out"
        );
        return Err(WrongCall(message));
    }
    let frequency_domain = Estimator::FrequencyDomain.name();
    if args.band.is_some() && !args.estimator.iter().any(|name| name == frequency_domain) {
        let message = format!(
            "--band: is that of the estimator {frequency_domain}, which this call leaves out: add --estimator {frequency_domain}, or \
             leave --band out"
        );
        return Err(WrongCall(message));
    }
    Ok(())
}

/// What a log has of a flight.
struct RecordedLog {
    inputs: InputSeries,
    sensors: Option<SensorSeries>,
    gyroscope: Option<LogGyroscope>,
}

impl RecordedLog {
    fn read(args: &Identify, file: &Path, vehicle: &Vehicle) -> Result<Self> {
        let whole = args.mapping.section(file);
        if !whole.has_inputs() {
            let path = file.display();
            let message = format!(
                "{path}: which fields are inputs? Give --preset or --input; `mavsight log {path}` lists them"
            );
            return Err(WrongCall(message).into());
        }
        let section = whole.without_sensors(&vehicle.model);
        let Noted { value: inputs, mut notes } =
            named(read_log_inputs(&section, &unit_by_model(&vehicle.model)))?;
        let sensors = named(read_log_sensors(&whole, &vehicle.model))?.map(|sensors| {
            notes.extend(sensors.notes);
            sensors.value
        });
        notes.iter().for_each(|note| eprintln!("note: {note}"));
        Ok(Self { inputs, sensors, gyroscope: named(read_log_gyroscope(&section))? })
    }

    fn flight<'a>(&'a self, vehicle: &'a Vehicle, options: &IdentifyOptions) -> Flight<'a> {
        Flight {
            name: &vehicle.name,
            vehicle,
            inputs: Some(&self.inputs),
            sensors: None,
            gyroscope: self.gyroscope.as_ref(),
            log_sensors: self.sensors.as_ref(),
            options: options.clone(),
        }
    }
}

/// Fits a log without a table of poses.
fn identify_log(args: &Identify, log: &RecordedLog, flight: &Flight<'_>) -> Result<()> {
    if log.sensors.is_none() {
        let message = "without a table of poses, name the sensors of the model's [outputs] with --input, such as \
                       --input acc_z_m_s2=acc.z,scale=-9.80665";
        return Err(WrongCall(message.into()).into());
    }
    let bars = Bars::new();
    let mut results = RunResults { session: flight.vehicle.name.clone(), ..RunResults::default() };
    identify_from_log(&mut results, &args.within, flight, &bars)?;
    bars.done();
    let summary = Summary::of(&results, None);
    out!("{}{}", summary.text(), parameter_text(&results));
    if let Some(out) = args.out.as_deref() {
        results.summary = beside_other_stages(out, &results.session, summary.json());
        write_identified(out, &mut results)?;
        outln!("\nResults: {}", out.display());
    }
    require_a_result(&results)
}

/// Refuses a flight that gave neither a motion nor parameters.
fn require_a_result(results: &RunResults) -> Result<()> {
    let is_regressed = results.identification.as_ref().is_some_and(|i| !i.fits.is_empty());
    if results.motion.is_some() || is_regressed || results.output_error.named().next().is_some() {
        return Ok(());
    }
    anyhow::bail!("there is neither a motion nor a parameter: the notes say why")
}

/// What was recorded of a flight, or of a part of one.
struct Recorded {
    name: String,
    table: FlightTable,
    inputs: Option<PathBuf>,
    sensors: Option<PathBuf>,
}

fn recorded_flights(args: &Identify, vehicle: &Vehicle) -> Result<Vec<Recorded>> {
    let marker_names: Vec<String> = vehicle.marker.iter().map(|m| m.name.clone()).collect();
    let (inputs, sensors) =
        (for_each(args, "--inputs", &args.inputs)?, for_each(args, "--sensors", &args.sensors)?);
    if args.log.is_none() && args.inputs.is_empty() && !vehicle.model.inputs.is_empty() {
        let names: Vec<&str> = vehicle.model.inputs.iter().map(|input| input.name.as_str()).collect();
        let (model, names) = (&vehicle.model.name, names.join(", "));
        return Err(WrongCall(format!("--inputs: give the table of the inputs of {model}: {names}")).into());
    }
    let only_output_error =
        !args.estimator.is_empty() && args.estimator.iter().all(|name| name == OUTPUT_ERROR);
    let mut flights = Vec::new();
    for (k, path) in args.tables.iter().enumerate() {
        let table = named(read_flight_table(path, &marker_names))?;
        if only_output_error && matches!(table, FlightTable::Motion(_)) {
            let what =
                "--estimator oe: output error fits poses, and this is a table of motion; give it pose.csv";
            return Err(WrongCall(what.into()).into());
        }
        let (inputs, sensors) = (inputs.get(k).cloned(), sensors.get(k).cloned());
        let name = path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
        let Some(parts) = args.parts else {
            flights.push(Recorded { name, table, inputs, sensors });
            continue;
        };
        flights.extend(table.parts(parts as usize).into_iter().enumerate().map(|(part, table)| Recorded {
            name: format!("{name}-part-{}", part + 1),
            table,
            inputs: inputs.clone(),
            sensors: sensors.clone(),
        }));
    }
    Ok(flights)
}

/// The file of each table: that of its own, or one that is for all.
fn for_each(args: &Identify, what: &str, files: &[PathBuf]) -> Result<Vec<PathBuf>, WrongCall> {
    match (files, args.tables.len()) {
        ([one], count) => Ok(vec![one.clone(); count]),
        (files, count) if files.is_empty() || files.len() == count => Ok(files.to_vec()),
        (files, count) => Err(WrongCall(format!(
            "{what}: {} files for {count} tables; give one, or one for each, with commas between them",
            files.len()
        ))),
    }
}

fn identify_one(
    table: FlightTable,
    session: String,
    flight: &Flight<'_>,
    out: Option<&Path>,
    bars: &Bars,
) -> Result<RunResults> {
    let marker_names = flight.vehicle.marker.iter().map(|m| m.name.clone()).collect();
    let mut results = RunResults { session, marker_names, ..RunResults::default() };
    match table {
        FlightTable::Poses(poses) => {
            results.poses = poses;
            identify_from_poses(&mut results, flight, bars)?
        }
        FlightTable::Motion(motion) => identify_from_motion(&mut results, motion, flight, bars)?,
    }
    let summary = Summary::of(&results, None);
    out!("{}{}", summary.text(), parameter_text(&results));
    if let Some(out) = out {
        results.summary = beside_other_stages(out, &results.session, summary.json());
        write_identified(out, &mut results)?;
        outln!("\nResults: {}", out.display());
    }
    Ok(results)
}

/// Writes the results without the table from which they came, which is a file of the caller's, perhaps in this folder.
fn write_identified(out: &Path, results: &mut RunResults) -> Result<()> {
    let poses = std::mem::take(&mut results.poses);
    let motion = if poses.is_empty() { results.motion.take() } else { None };
    write_results(out, results)?;
    results.poses = poses;
    results.motion = results.motion.take().or(motion);
    Ok(())
}

/// The session whose results the table lies among, if these go to the same folder.
fn session_of(args: &Identify) -> Option<String> {
    let out = args.out.as_ref()?.canonicalize().ok()?;
    let among = args.tables.first()?.canonicalize().ok()?.parent()? == out;
    let summary = among.then(|| read_summary(&out.join(names::SUMMARY)).ok())??;
    summary["session"].as_str().map(str::to_owned)
}

fn options(args: &Identify, vehicle: &Vehicle) -> Result<IdentifyOptions> {
    let is_of_motion = |name: &&String| [OUTPUT_ERROR, FILTER_ERROR].contains(&name.as_str());
    let estimator = |name: &String| {
        let of_motion = [OUTPUT_ERROR, FILTER_ERROR].join(", ");
        let known = || Estimator::ALL.map(Estimator::name).join(", ") + ", " + &of_motion;
        let wrong =
            || WrongCall(format!("--estimator {name}: there is none of that name; there are {}", known()));
        Estimator::from_name(name).ok_or_else(wrong)
    };
    let mut fit = FitOptions {
        band: args.band.map(|(low_hz, high_hz)| Band { low_hz, high_hz }),
        held_out_s: args.hold_out,
        ..FitOptions::default()
    };
    if !args.estimator.is_empty() {
        let equations = args.estimator.iter().filter(|name| !is_of_motion(name));
        fit.estimators = equations.map(estimator).collect::<Result<_, _>>()?;
    }
    let table = Options {
        equations: args.model.as_deref().map(|path| named(load_equations(path))).transpose()?,
        bandwidth: args.bandwidth.map_or(Bandwidth::Automatic, Bandwidth::Hz),
        ..Options::default()
    };
    let is_other = |file: &EquationFile| file.is_of_another_aircraft(vehicle);
    let has = |name: &str| args.estimator.iter().any(|own| own == name);
    let motion_fits = if !args.estimator.is_empty() {
        MotionFits { output_error: has(OUTPUT_ERROR), filter_error: has(FILTER_ERROR) }
    } else if table.equations.as_ref().is_some_and(is_other) {
        MotionFits::NONE
    } else {
        MotionFits::default()
    };
    if args.search && !motion_fits.output_error {
        let what = "--search: terms are searched by output error, which this call leaves out; name oe among the estimators";
        return Err(WrongCall(what.into()).into());
    }
    if args.search && args.tables.is_empty() {
        let what = "--search: terms are searched in poses, and a log alone has none: name the flight's pose.csv beside --log, or \
                    leave --search out";
        return Err(WrongCall(what.into()).into());
    }
    if args.tables.is_empty() && args.stepwise {
        let what = "--stepwise: a log alone is fitted without regression: name the flight's pose.csv beside --log, or leave --stepwise \
                    out";
        return Err(WrongCall(what.into()).into());
    }
    let Identify { lag: lag_s, stepwise, search, at_most, .. } = *args;
    Ok(IdentifyOptions { table, fit, lag_s, stepwise, search, motion_fits, at_most })
}
