//! Each stage by itself, on the files of the stage before it.

use super::demo::{scenario_of, vehicle_of};
use super::film::{INPUTS, STAGING};
use super::run::{print_summary, remove_absent, scores_of};
use super::{named, require_folder};
use crate::cli::{Simulate, Stage, WrongCall};
use crate::out::{out, outln};
use crate::progress::Bars;
use anyhow::Result;
use mavsight_engine::{
    Flight, Options, first_frames, identify_from_poses, log_gyroscope, log_sensors, recorded_inputs,
    recorded_sensors, smooth_tracked,
};
use mavsight_pipeline::IdentifyOptions;
use mavsight_report::{FlightReport, Summary, clocks_in, write_report};
use mavsight_score::{truth_of, write_truth};
use mavsight_session::{
    RunResults, Session, make_folder, read_body, read_markers, read_poses, read_rig, read_summary,
    results::names,
    tables::{read_inputs, write_sensors},
    write_inputs, write_results, write_toml, write_vehicle,
};
use mavsight_simulator::Carried;
use serde_json::Value;
use std::path::Path;

pub(crate) fn simulate(args: &Simulate) -> Result<()> {
    let vehicle = vehicle_of(args.vehicle.as_deref())?;
    let scenario = scenario_of(args.scenario.as_deref())?;
    if args.print_scenario {
        out!("{}", toml::to_string(&scenario)?);
    }
    if args.print_vehicle {
        out!("{}", toml::to_string(&vehicle)?);
    }
    let Some(out) = &args.out else { return Ok(()) };
    let inputs = match &args.inputs {
        Some(path) => named(read_inputs(path, &vehicle))?,
        None => scenario.inputs(&vehicle)?,
    };
    let mut sensors = None;
    let states = if args.carried {
        let further = vehicle.model.states.len();
        Carried::default().states(scenario.duration_s, scenario.frame_rate_hz, further)
    } else {
        let (start, times_s) = (scenario.start(&vehicle)?, scenario.frame_times_s());
        let states = mavsight_simulator::simulate(&vehicle, &inputs, &start, &times_s)?;
        if !vehicle.model.sensors.is_empty() {
            sensors = Some(mavsight_simulator::sensed(&vehicle, &inputs, &states)?);
        }
        states
    };
    make_folder(out)?;
    if let Some(sensors) = sensors {
        write_sensors(&out.join("sensors.csv"), &sensors)?;
    }
    write_vehicle(&out.join("vehicle.toml"), &vehicle)?;
    if !args.carried {
        write_inputs(&out.join(INPUTS), &inputs)?;
    }
    // Those of an earlier flight are not of this one.
    remove_absent(out, &[(INPUTS, !args.carried)])?;
    write_truth(&out.join("truth.csv"), &states, &vehicle)?;
    if !scenario.staging.is_empty() {
        write_toml(&out.join(STAGING), &scenario.staging)?;
    }
    outln!("{} instants of {:.2} s: {}", states.len(), scenario.duration_s, out.display());
    Ok(())
}

pub(crate) fn calibrate(args: &Stage) -> Result<()> {
    let session = named(Session::load(&args.session))?;
    require_folder(&args.out)?;
    let bars = Bars::new();
    let rig = mavsight_engine::calibrate(&session, &bars)?;
    bars.done();
    let (session, notes) = (session.file.name.clone(), rig.notes().collect());
    put(RunResults { session, notes, rig: Some(rig), ..RunResults::default() }, &args.out, &[])
}

pub(crate) fn track(args: &Stage) -> Result<()> {
    let session = named(Session::load(&args.session))?;
    let rig = named(read_rig(&args.out.join(names::RIG)))?;
    let wanted: Vec<&str> = session.cameras().iter().map(|c| c.name.as_str()).collect();
    let found: Vec<&str> = rig.cameras.iter().map(|c| c.name.as_str()).collect();
    if wanted != found {
        let rig_file = args.out.join(names::RIG);
        let message = format!(
            "{}: holds the cameras {}, but the session has {}: run `mavsight calibrate` on this session",
            rig_file.display(),
            found.join(", "),
            wanted.join(", ")
        );
        return Err(WrongCall(message).into());
    }
    named(session.require_sizes(&rig, &args.out.join(names::RIG)))?;
    let gyroscope = log_gyroscope(&session)?;
    let bars = Bars::new();
    let tracked = mavsight_engine::track(&session, rig, &bars)?;
    let flight = Flight {
        name: &session.file.name,
        vehicle: &session.vehicle,
        inputs: None,
        sensors: None,
        gyroscope: gyroscope.as_ref(),
        log_sensors: None,
        options: IdentifyOptions::default(),
    };
    let results = smooth_tracked(&flight, tracked, &bars);
    bars.done();
    let own = [
        Own { file: names::BODY, sections: &["body"], is_there: !results.body.is_empty() },
        Own { file: names::MOTION, sections: &["motion", "smoother"], is_there: results.motion.is_some() },
    ];
    put(results, &args.out, &own)
}

/// A file that a stage writes where it has what belongs into it.
struct Own {
    file: &'static str,
    /// What the summary says of it.
    sections: &'static [&'static str],
    is_there: bool,
}

/// The figures of a stage among those that the summary in a folder has of the same session's other stages.
pub(super) fn beside_other_stages(out: &Path, session: &str, figures: Value) -> Value {
    let Some(Value::Object(mut all)) = summary_of(out, session) else { return figures };
    for (section, value) in figures.as_object().into_iter().flatten() {
        match value {
            // This stage has nothing to say in words: what the others said stands.
            Value::Array(words) if words.is_empty() => {}
            _ => {
                all.insert(section.clone(), value.clone());
            }
        }
    }
    Value::Object(all)
}

/// Writes the results of a stage. What an earlier call of it left, and this one has nothing of, goes.
fn put(mut results: RunResults, out: &Path, own: &[Own]) -> Result<()> {
    let summary = Summary::of(&results, None);
    results.summary = beside_other_stages(out, &results.session, summary.json());
    if let Value::Object(all) = &mut results.summary {
        let absent = own.iter().filter(|own| !own.is_there).flat_map(|own| own.sections);
        absent.for_each(|section| drop(all.remove(*section)));
    }
    write_results(out, &results)?;
    let files: Vec<(&str, bool)> = own.iter().map(|own| (own.file, own.is_there)).collect();
    remove_absent(out, &files)?;
    print_summary(&summary, &results, out)
}

/// The summary in a folder, where it is of this session.
fn summary_of(out: &Path, session: &str) -> Option<Value> {
    read_summary(&out.join(names::SUMMARY)).ok().filter(|before| before["session"] == session)
}

const NO_CLOCKS: &str = "The report has no pictures of the cameras: summary.json has no clocks of these cameras, which say when \
                         a picture was taken; `mavsight track` writes them.";

pub(crate) fn report(args: &Stage) -> Result<()> {
    let session = named(Session::load(&args.session))?;
    let (inputs, sensors) = (recorded_inputs(&session)?, recorded_sensors(&session)?);
    let (gyroscope, (of_log, of_sensors)) = (log_gyroscope(&session)?, log_sensors(&session)?);
    let truth = named(truth_of(&session))?;
    let camera_names: Vec<String> = session.cameras().iter().map(|c| c.name.clone()).collect();
    let marker_names: Vec<String> = session.vehicle.marker.iter().map(|m| m.name.clone()).collect();
    let mut results = RunResults {
        session: session.file.name.clone(),
        rig: Some(named(read_rig(&args.out.join(names::RIG)))?),
        markers: named(read_markers(&args.out.join(names::MARKERS), &camera_names, &marker_names))?,
        poses: named(read_poses(&args.out.join(names::POSE), &marker_names))?,
        camera_names,
        marker_names,
        ..RunResults::default()
    };
    let body = args.out.join(names::BODY);
    if session.file.refine.is_some() && body.is_file() {
        results.body = named(read_body(&body))?;
    }
    let bars = Bars::new();
    let flight = Flight::of_session(&session, inputs.as_ref(), &Options::default())?
        .with_sensors(sensors.as_ref())
        .with_log(gyroscope.as_ref(), of_log.as_ref());
    identify_from_poses(&mut results, &flight, &bars)?;
    results.notes.extend(of_sensors);
    bars.done();
    let of_track = summary_of(&args.out, &results.session);
    match of_track.and_then(|figures| clocks_in(&figures, &results.camera_names)) {
        Some(clocks) => results.pictures = first_frames(&session, &clocks)?,
        None => results.notes.push(NO_CLOCKS.to_owned()),
    }
    let scores = truth.as_deref().map(|t| scores_of(&results, t));
    let summary = Summary::of(&results, scores.as_ref());
    let report = FlightReport {
        vehicle: &session.vehicle,
        inputs: inputs.as_ref(),
        truth: truth.as_deref(),
        session: Some(&session.path),
    };
    write_report(&report, &results, &summary, &args.out)?;
    outln!("{}", args.out.join(names::REPORT).display());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_stage_leaves_the_figures_of_the_others() {
        let folder = std::env::temp_dir().join(format!("mavsight-summary-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        let before = json!({
            "session": "flight", "cameras": {"a": 1}, "poses": {"measured": 2}, "notes": ["seen"],
        });
        std::fs::write(folder.join(names::SUMMARY), before.to_string()).expect("a summary");
        let stage = json!({"poses": {"measured": 3}, "notes": [], "verdicts": ["determined"]});
        let merged = beside_other_stages(&folder, "flight", stage.clone());
        assert_eq!(merged["cameras"], before["cameras"]);
        assert_eq!(merged["poses"], stage["poses"]);
        assert_eq!(merged["notes"], before["notes"]);
        assert_eq!(merged["verdicts"], stage["verdicts"]);
        // Another session's figures have no place beside these.
        assert_eq!(beside_other_stages(&folder, "another", stage.clone()), stage);
        std::fs::remove_dir_all(&folder).expect("cleared");
        assert_eq!(beside_other_stages(&folder, "flight", stage.clone()), stage);
    }
    #[test]
    fn a_stage_that_has_no_motion_leaves_none_of_an_earlier_call() {
        let folder = std::env::temp_dir().join(format!("mavsight-stale-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        let before =
            json!({"session": "flight", "motion": {"seconds": 1}, "smoother": {}, "cameras": {"a": 1}});
        std::fs::write(folder.join(names::SUMMARY), before.to_string()).expect("a summary");
        for file in [names::MOTION, names::PARAMETERS] {
            std::fs::write(folder.join(file), "t_s").expect("a table");
        }
        let results = RunResults { session: "flight".to_owned(), ..RunResults::default() };
        let own = Own { file: names::MOTION, sections: &["motion", "smoother"], is_there: false };
        put(results, &folder, &[own]).expect("written");
        let left = read_summary(&folder.join(names::SUMMARY)).expect("a summary");
        assert_eq!((&left["motion"], &left["smoother"]), (&Value::Null, &Value::Null));
        assert_eq!(left["cameras"], before["cameras"]);
        // The file of another stage is kept.
        assert!(!folder.join(names::MOTION).exists() && folder.join(names::PARAMETERS).exists());
        std::fs::remove_dir_all(&folder).expect("cleared");
    }
}
