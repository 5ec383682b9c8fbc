//! Each stage by itself, on the files of the stage before it.

use super::demo::{scenario_of, vehicle_of};
use super::named;
use super::run::{Flight, feeds, first_frames, identify_into, refined_body, rig_of, scores_of};
use crate::cli::{Film, Simulate, Stage, WrongCall};
use crate::lab;
use crate::page::{Page, write_page};
use crate::progress::Bars;
use crate::summary::Summary;
use anyhow::{Context, Result, bail};
use mavsight_flight::{Scenario, Staging};
use mavsight_pipeline::Progress;
use mavsight_session::{
    ControlSection, RunResults, SESSION_SCHEMA, Session, SessionCamera, SessionFile, TruthRow, VISIBILITY,
    load_vehicle, make_folder, read_body, read_markers, read_poses, read_rig, results::names,
    tables::read_inputs, tables::read_truth, write_control_points, write_inputs, write_png, write_results,
    write_session, write_truth, write_vehicle, write_visibility,
};
use mavsight_vision::Frame;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

/// What a scenario stages, beside the flight that `simulate` writes.
const STAGING: &str = "staging.toml";

/// `mavsight simulate`
pub(crate) fn simulate(args: &Simulate) -> Result<()> {
    let vehicle = vehicle_of(args.vehicle.as_deref())?;
    let scenario = scenario_of(args.scenario.as_deref())?;
    if args.print_scenario {
        print!("{}", toml::to_string(&scenario)?);
    }
    if args.print_vehicle {
        print!("{}", toml::to_string(&vehicle)?);
    }
    let Some(out) = &args.out else { return Ok(()) };
    let inputs = match &args.inputs {
        Some(path) => named(read_inputs(path))?,
        None => scenario.inputs(&vehicle)?,
    };
    let states = mavsight_flight::simulate(&vehicle, &inputs, &scenario.start(), &scenario.frame_times_s())?;
    make_folder(out)?;
    write_vehicle(&out.join("vehicle.toml"), &vehicle)?;
    write_inputs(&out.join("inputs.csv"), &inputs)?;
    write_truth(&out.join("truth.csv"), &states)?;
    if !scenario.staging.is_empty() {
        let text = toml::to_string(&scenario.staging)?;
        mavsight_session::write_whole(&out.join(STAGING), text.as_bytes())?;
    }
    println!("{} instants of {:.2} s: {}", states.len(), scenario.duration_s, out.display());
    Ok(())
}

/// `mavsight film`
pub(crate) fn film(args: &Film) -> Result<()> {
    let vehicle = named(load_vehicle(&args.flight.join("vehicle.toml")))?;
    let truth = named(read_truth(&args.flight.join("truth.csv")))?;
    let inputs = named(read_inputs(&args.flight.join("inputs.csv")))?;
    let interval_s = match truth.as_slice() {
        [a, b, ..] => b.t_s - a.t_s,
        _ => 1.0 / Scenario::paper().frame_rate_hz,
    };
    make_folder(&args.out)?;
    let bars = Bars::new();
    let staging = staging_of(&args.flight)?;
    let (room, aircraft) = (lab::room(&staging), lab::aircraft(&vehicle));
    let mut visible = vec![Vec::new(); truth.len()];
    let mut cameras = Vec::new();
    for (k, camera) in lab::cameras().iter().enumerate() {
        bars.start("building", None);
        let film = lab::staged_film(&room, camera, k, args.seed, &staging);
        let shares = truth.iter().map(|row| film.visible_shares(&vehicle, &aircraft, row));
        visible.iter_mut().zip(shares).for_each(|(all, own): (&mut Vec<_>, _)| all.push(own));
        let still = format!("{}-control.png", camera.name);
        let size = camera.camera.size;
        write_png(
            &args.out.join(&still),
            &Frame::from_rgb(size, film.still(Some(&lab::control_frame(&lab::control_points()))))?,
        )?;
        bars.start("filming", Some(truth.len() as u64));
        let frames = truth.iter().enumerate().map(|(n, row)| {
            bars.step();
            film.frame(n, &aircraft, row, interval_s)
        });
        let video = if args.video {
            write_video(&args.out.join(format!("{}.mp4", camera.name)), size, interval_s, frames)?;
            format!("{}.mp4", camera.name)
        } else {
            make_folder(&args.out.join(&camera.name))?;
            for (n, rgb) in frames.enumerate() {
                let file = args.out.join(&camera.name).join(format!("frame_{n:05}.png"));
                write_png(&file, &Frame::from_rgb(size, rgb)?)?;
            }
            format!("{}/frame_%05d.png", camera.name)
        };
        cameras.push(SessionCamera {
            name: camera.name.clone(),
            video: video.into(),
            still: Some(still.into()),
            frame_rate_hz: (!args.video).then_some((1e6 / interval_s).round() / 1e6),
            time_offset_s: None,
        });
    }
    bars.done();
    let names: Vec<String> = cameras.iter().map(|c| c.name.clone()).collect();
    write_visibility(&args.out.join(VISIBILITY), &truth, &names, &vehicle, &visible)?;
    write_flight_files(args, &vehicle, &inputs)?;
    let session = SessionFile {
        schema: SESSION_SCHEMA,
        name: "virtual-flight".to_owned(),
        vehicle: "vehicle.toml".into(),
        inputs: "inputs.csv".into(),
        truth: Some("truth.csv".into()),
        model: None,
        control: ControlSection { points: "control_points.csv".into(), observations: None },
        refine: None,
        camera: cameras,
    };
    write_session(&args.out.join("session.toml"), &session)?;
    println!("{} frames of each camera: {}", truth.len(), args.out.join("session.toml").display());
    Ok(())
}

/// What a scenario staged, as `simulate` left it beside a flight; nothing where there is none.
fn staging_of(flight: &Path) -> Result<Staging> {
    let path = flight.join(STAGING);
    if !path.is_file() {
        return Ok(Staging::default());
    }
    let wrong = |e: String| WrongCall(format!("{}: {e}", path.display()));
    let text = std::fs::read_to_string(&path).map_err(|e| wrong(e.to_string()))?;
    let staging: Staging = toml::from_str(&text).map_err(|e| wrong(e.to_string().trim().to_owned()))?;
    staging.check().map_err(|e| wrong(e.to_string()))?;
    Ok(staging)
}

fn write_flight_files(
    args: &Film,
    vehicle: &mavsight_flight::Vehicle,
    inputs: &mavsight_flight::InputSeries,
) -> Result<()> {
    write_control_points(&args.out.join("control_points.csv"), &lab::control_points())?;
    let same = args.flight.canonicalize().ok() == args.out.canonicalize().ok();
    if !same {
        write_vehicle(&args.out.join("vehicle.toml"), vehicle)?;
        write_inputs(&args.out.join("inputs.csv"), inputs)?;
        let truth = std::fs::read(args.flight.join("truth.csv")).context("truth.csv")?;
        mavsight_session::write_whole(&args.out.join("truth.csv"), &truth)?;
    }
    Ok(())
}

/// Encodes frames with the `ffmpeg` program.
fn write_video(
    path: &Path,
    size: mavsight_geometry::ImageSize,
    interval_s: f64,
    frames: impl Iterator<Item = Vec<u8>>,
) -> Result<()> {
    let mut child = Command::new("ffmpeg")
        .args(["-v", "error", "-nostdin", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"])
        .args(["-s", &format!("{}x{}", size.width_px, size.height_px), "-r", &format!("{}", 1.0 / interval_s)])
        .args(["-i", "pipe:0", "-c:v", "libx264", "-crf", "12", "-pix_fmt", "yuv420p"])
        .arg(path)
        .stdin(Stdio::piped())
        .spawn()
        .context("--video needs the ffmpeg program: install it with `apt-get install ffmpeg`, or leave --video out")?;
    let Some(mut pipe) = child.stdin.take() else { bail!("ffmpeg gave no input pipe") };
    for rgb in frames {
        pipe.write_all(&rgb).context("ffmpeg stopped reading frames")?;
    }
    drop(pipe);
    let status = child.wait()?;
    if !status.success() {
        bail!("ffmpeg could not write {}: {status}", path.display());
    }
    Ok(())
}

/// `mavsight calibrate`
pub(crate) fn calibrate(args: &Stage) -> Result<()> {
    let session = named(Session::load(&args.session))?;
    let bars = Bars::new();
    let rig = rig_of(&session, &bars)?;
    bars.done();
    let results = RunResults { session: session.name.clone(), rig: Some(rig), ..RunResults::default() };
    put(results, &[], &args.out)
}

/// `mavsight track`
pub(crate) fn track(args: &Stage) -> Result<()> {
    let session = named(Session::load(&args.session))?;
    let rig = named(read_rig(&args.out.join(names::RIG)))?;
    let wanted: Vec<&str> = session.cameras.iter().map(|c| c.name.as_str()).collect();
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
    let bars = Bars::new();
    let mut tracked = mavsight_pipeline::track(feeds(&session)?, &rig, &session.vehicle, &bars)?;
    let (body, refusal) = refined_body(&session, &rig, &mut tracked)?;
    let motion = mavsight_pipeline::motion_from_poses(&tracked.poses, &session.vehicle, &bars).ok();
    bars.done();
    let results = RunResults {
        session: session.name.clone(),
        camera_names: rig.cameras.iter().map(|c| c.name.clone()).collect(),
        marker_names: session.vehicle.marker.iter().map(|m| m.name.clone()).collect(),
        rig: Some(rig),
        markers: tracked.observations,
        body,
        poses: tracked.poses,
        camera_health: tracked.health,
        motion,
        ..RunResults::default()
    };
    let mut notes = tracked.notes;
    notes.extend(refusal);
    put(results, &notes, &args.out)
}

fn put(mut results: RunResults, notes: &[String], out: &Path) -> Result<()> {
    let summary = Summary::of(&results, None, notes);
    results.summary = summary.json();
    write_results(out, &results)?;
    print!("{}", summary.text());
    println!("\nResults: {}", out.display());
    Ok(())
}

/// `mavsight report`
pub(crate) fn report(args: &Stage) -> Result<()> {
    let session = named(Session::load(&args.session))?;
    let inputs = named(session.inputs())?;
    let truth: Option<Vec<TruthRow>> = named(session.truth())?;
    let camera_names: Vec<String> = session.cameras.iter().map(|c| c.name.clone()).collect();
    let marker_names: Vec<String> = session.vehicle.marker.iter().map(|m| m.name.clone()).collect();
    let mut results = RunResults {
        session: session.name.clone(),
        rig: Some(named(read_rig(&args.out.join(names::RIG)))?),
        markers: named(read_markers(&args.out.join(names::MARKERS), &camera_names, &marker_names))?,
        poses: named(read_poses(&args.out.join(names::POSE), &marker_names))?,
        camera_names,
        marker_names,
        ..RunResults::default()
    };
    let body = args.out.join(names::BODY);
    if session.refine.is_some() && body.is_file() {
        results.body = named(read_body(&body))?;
    }
    let bars = Bars::new();
    let flight = Flight::of_session(&session, &inputs, truth.as_deref())?;
    let notes = identify_into(&mut results, &flight, &bars)?;
    bars.done();
    let scores = truth.as_deref().map(|t| scores_of(&results, t));
    let summary = Summary::of(&results, scores.as_ref(), &notes);
    let frames = first_frames(&session)?;
    write_page(&Page { flight: &flight, results: &results, summary: &summary, frames: &frames }, &args.out)?;
    println!("{}", args.out.join(names::REPORT).display());
    Ok(())
}
