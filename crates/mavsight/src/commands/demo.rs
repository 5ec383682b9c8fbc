//! Fly, film, calibrate, track, identify, report; and score all of it.

use super::named;
use super::run::{finish, scores_of};
use crate::cli::Demo;
use crate::lab::{self, StagedFilm};
use crate::progress::Bars;
use anyhow::{Context, Result};
use mavsight_engine::{Flight, TrackedFlight, solve};
use mavsight_flight::{Vehicle, hover_rotor_speed_rad_s};
use mavsight_geometry::{ImageSize, Vector3};
use mavsight_pipeline::{
    CameraFeed, ControlStill, IdentifyOptions, PipelineError, Progress, TimedFrame, calibrate_from_stills,
};
use mavsight_report::FlightReport;
use mavsight_scene::Aircraft;
use mavsight_score::{
    TruthRow, VirtualCamera, score_cameras, score_identity, score_output_error, score_parameters, write_truth,
};
use mavsight_session::{ns_from_s, write_control_points, write_inputs, write_vehicle};
use mavsight_simulator::{Scenario, model_coefficients, simulate};
use mavsight_vision::Frame;
use std::path::Path;

/// Reads a vehicle, or takes the paper's.
pub(crate) fn vehicle_of(path: Option<&Path>) -> Result<Vehicle> {
    path.map_or_else(|| Ok(Vehicle::paper()), |p| named(mavsight_session::load_vehicle(p)))
}

/// Reads a scenario, or takes the paper's.
pub(crate) fn scenario_of(path: Option<&Path>) -> Result<Scenario> {
    let Some(path) = path else { return Ok(Scenario::paper()) };
    let wrong = |e: String| crate::cli::WrongCall(format!("{}: {e}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|e| wrong(e.to_string()))?;
    let scenario: Scenario = toml::from_str(&text).map_err(|e| wrong(e.to_string().trim().to_owned()))?;
    scenario.validate().map_err(|e| wrong(e.to_string()))?;
    Ok(scenario)
}

/// `mavsight demo`
pub(crate) fn demo(args: &Demo) -> Result<()> {
    let vehicle = vehicle_of(args.vehicle.as_deref())?;
    let scenario = scenario_of(args.scenario.as_deref())?;
    let bars = Bars::new();
    bars.start("flying", None);
    let inputs = scenario.inputs(&vehicle)?;
    let states = simulate(&vehicle, &inputs, &scenario.start(), &scenario.frame_times_s())?;
    let truth: Vec<TruthRow> = states.iter().map(TruthRow::from).collect();
    bars.start("building", None);
    let cameras = lab::cameras();
    let staging = &scenario.staging;
    let (room, aircraft) = (lab::room(staging), lab::aircraft(&vehicle));
    let filmed = |(k, camera)| lab::staged_film(&room, camera, k, args.seed, staging);
    let films: Vec<StagedFilm<'_>> = cameras.iter().enumerate().map(filmed).collect();
    bars.begin(mavsight_pipeline::Stage::Calibrate, None);
    let stills = cameras
        .iter()
        .zip(&films)
        .map(|(c, film)| {
            let frame =
                frame_of(c.camera.size, film.still(Some(&lab::control_frame(&lab::control_points()))))?;
            Ok(ControlStill { camera: c.name.clone(), frame })
        })
        .collect::<Result<Vec<_>>>()?;
    let rig = calibrate_from_stills(&stills, &lab::control_points())?;
    let interval_s = 1.0 / scenario.frame_rate_hz;
    let feeds = cameras
        .iter()
        .zip(&films)
        .map(|(camera, film)| feed(camera, film, &aircraft, &truth, interval_s))
        .collect();
    let tracked = mavsight_pipeline::track(feeds, &rig, &vehicle, &bars)?;
    let flight = Flight {
        name: "demo",
        vehicle: &vehicle,
        inputs: Some(&inputs),
        options: IdentifyOptions::default(),
    };
    let tracked = TrackedFlight { rig, tracked, body: Vec::new() };
    let mut results = solve(&flight, tracked, Some(&args.out), &bars)?;
    let mut scores = scores_of(&results, &truth);
    let model = model_coefficients(&vehicle, hover_rotor_speed_rad_s(&vehicle));
    scores.parameters =
        results.identification.as_ref().map(|i| score_parameters(i, &model)).unwrap_or_default();
    scores.output_error = score_output_error(&results.output_error, &vehicle);
    let shares = |row: &TruthRow| films.iter().map(|f| f.visible_shares(&vehicle, &aircraft, row)).collect();
    let visible: Vec<Vec<Vec<f64>>> = truth.iter().map(shares).collect();
    scores.identity = Some(score_identity(&results.poses, &truth, &markers_of(&vehicle), &visible));
    let centres: Vec<_> = cameras.iter().map(|c| (c.name.clone(), c.camera.centre_in_world())).collect();
    scores.cameras = results.rig.as_ref().map(|r| score_cameras(r, &centres)).unwrap_or_default();
    bars.done();
    write_vehicle(&args.out.join("vehicle.toml"), &vehicle)?;
    write_inputs(&args.out.join("inputs.csv"), &inputs)?;
    write_truth(&args.out.join("truth.csv"), &states)?;
    write_control_points(&args.out.join("control_points.csv"), &lab::control_points())?;
    let frames = cameras
        .iter()
        .zip(&films)
        .filter_map(|(c, film)| Some((c, film, truth.first()?)))
        .map(|(c, film, row)| frame_of(c.camera.size, film.frame(0, &aircraft, row, interval_s)))
        .collect::<Result<Vec<_>>>()?;
    let report =
        FlightReport { vehicle: &vehicle, inputs: Some(&inputs), truth: Some(&truth), frames: &frames };
    finish(&mut results, Some(&scores), &report, &args.out)
}

/// Places and radii of a vehicle's markers.
pub(super) fn markers_of(vehicle: &Vehicle) -> Vec<(Vector3<f64>, f64)> {
    vehicle.marker.iter().map(|m| (m.position_m.into(), m.diameter_m / 2.0)).collect()
}

pub(super) fn frame_of(size: ImageSize, rgb: Vec<u8>) -> Result<Frame> {
    Frame::from_rgb(size, rgb).context("a filmed frame has the size of its camera")
}

/// A virtual camera as a source of frames.
pub(super) fn feed<'a>(
    camera: &'a VirtualCamera,
    film: &'a StagedFilm<'a>,
    aircraft: &'a Aircraft,
    truth: &'a [TruthRow],
    interval_s: f64,
) -> CameraFeed<'a> {
    let frames = truth.iter().enumerate().map(move |(k, row)| {
        let rgb = film.frame(k, aircraft, row, interval_s);
        let frame = Frame::from_rgb(camera.camera.size, rgb)
            .map_err(|e| PipelineError::Source { camera: camera.name.clone(), source: Box::new(e) })?;
        Ok(TimedFrame { t_ns: ns_from_s(row.t_s), frame })
    });
    CameraFeed::new(camera.name.clone(), Some(truth.len()), Box::new(frames))
}
