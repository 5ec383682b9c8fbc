//! Identification by itself, on a table of poses or of motion from any system.

use super::run::require_a_pose;
use super::stages::beside_other_stages;
use super::{named, require_folder};
use crate::cli::{Identify, WrongCall};
use crate::out::{out, outln};
use crate::progress::Bars;
use anyhow::Result;
use mavsight_engine::{Flight, identify_from_motion, identify_from_poses};
use mavsight_flight::Vehicle;
use mavsight_identify::output_error::{FILTER_ERROR, MotionFits, OUTPUT_ERROR};
use mavsight_identify::{Band, Bandwidth, EquationFile, Estimator, FitOptions, Options};
use mavsight_pipeline::IdentifyOptions;
use mavsight_report::{Summary, parameter_text};
use mavsight_session::{
    FlightTable, RunResults, load_equations, load_vehicle, read_flight_table, read_summary,
    results::names,
    tables::{read_inputs, read_sensors},
    write_results,
};

pub(crate) fn identify(args: &Identify) -> Result<()> {
    let vehicle = named(load_vehicle(&args.vehicle))?;
    args.out.as_deref().map_or(Ok(()), require_folder)?;
    let options = options(args, &vehicle)?;
    let vehicle = options.table.equations.as_ref().map_or(vehicle.clone(), |file| file.vehicle(&vehicle));
    let inputs = named(read_inputs(&args.inputs, &vehicle))?;
    let sensors =
        args.sensors.as_deref().map(|path| named(read_sensors(path, &vehicle.model))).transpose()?;
    let marker_names: Vec<String> = vehicle.marker.iter().map(|m| m.name.clone()).collect();
    let table = named(read_flight_table(&args.table, &marker_names))?;
    let only_output_error =
        !args.estimator.is_empty() && args.estimator.iter().all(|name| name == OUTPUT_ERROR);
    if only_output_error && matches!(table, FlightTable::Motion(_)) {
        let what = "--estimator oe: output error fits poses, and this is a table of motion; give it pose.csv";
        return Err(WrongCall(what.into()).into());
    }
    let bars = Bars::new();
    let session = session_of(args).unwrap_or_else(|| vehicle.name.clone());
    let mut results = RunResults { session, marker_names, ..RunResults::default() };
    let flight = Flight {
        name: &vehicle.name,
        vehicle: &vehicle,
        inputs: Some(&inputs),
        sensors: sensors.as_ref(),
        options,
    };
    match table {
        FlightTable::Poses(poses) => {
            results.poses = poses;
            identify_from_poses(&mut results, &flight, &bars)?
        }
        FlightTable::Motion(motion) => identify_from_motion(&mut results, motion, &flight, &bars)?,
    }
    bars.done();
    let summary = Summary::of(&results, None);
    out!("{}{}", summary.text(), parameter_text(&results));
    let has_pose = require_a_pose(&results);
    if let Some(out) = &args.out {
        results.summary = beside_other_stages(out, &results.session, summary.json());
        // The table came from a file of the caller's, perhaps in this folder: it is not written again.
        if results.poses.is_empty() {
            results.motion = None;
        }
        results.poses.clear();
        write_results(out, &results)?;
        outln!("\nResults: {}", out.display());
    }
    has_pose
}

/// The session whose results the table lies among, if these go to the same folder.
fn session_of(args: &Identify) -> Option<String> {
    let out = args.out.as_ref()?.canonicalize().ok()?;
    let among = args.table.canonicalize().ok()?.parent()? == out;
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
    let (lag_s, stepwise, search) = (args.lag, args.stepwise, args.search);
    Ok(IdentifyOptions { table, fit, lag_s, stepwise, search, motion_fits })
}
