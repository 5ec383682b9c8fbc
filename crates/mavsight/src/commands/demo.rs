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
    CameraFeed, ControlPointRow, ControlStill, IdentifyOptions, PipelineError, Progress, TimedFrame, Tracked,
    calibrate_from_stills,
};
use mavsight_pose::Rig;
use mavsight_report::FlightReport;
use mavsight_scene::Aircraft;
use mavsight_score::{
    VirtualCamera, score_cameras, score_identity, score_output_error, score_parameters, write_truth,
};
use mavsight_session::{ns_from_s, write_control_points, write_inputs, write_toml};
use mavsight_simulator::{FlightState, Scenario, model_coefficients, simulate};
use mavsight_vision::Frame;
use std::path::Path;

/// Reads a vehicle, or takes the paper's.
pub(crate) fn vehicle_of(path: Option<&Path>) -> Result<Vehicle> {
    path.map_or_else(|| Ok(Vehicle::paper()), |p| named(mavsight_session::load_vehicle(p)))
}

/// Reads a scenario, or takes the paper's.
pub(crate) fn scenario_of(path: Option<&Path>) -> Result<Scenario> {
    let Some(path) = path else { return Ok(Scenario::paper()) };
    let scenario: Scenario = named(mavsight_session::read_toml(path, "scenario file"))?;
    scenario.validate().map_err(|e| crate::cli::WrongCall(format!("{}: {e}", path.display())))?;
    Ok(scenario)
}

/// `mavsight demo`
pub(crate) fn demo(args: &Demo) -> Result<()> {
    let vehicle = vehicle_of(args.vehicle.as_deref())?;
    let scenario = scenario_of(args.scenario.as_deref())?;
    let bars = Bars::new();
    bars.start("flying", None);
    let inputs = scenario.inputs(&vehicle)?;
    let truth = simulate(&vehicle, &inputs, &scenario.start(), &scenario.frame_times_s())?;
    bars.start("building", None);
    let cameras = lab::cameras();
    let staging = &scenario.staging;
    let (room, aircraft) = (lab::room(staging), lab::aircraft(&vehicle));
    let filmed = |(k, camera)| lab::staged_film(&room, camera, k, args.seed, staging);
    let films: Vec<StagedFilm<'_>> = cameras.iter().enumerate().map(filmed).collect();
    let interval_s = 1.0 / scenario.frame_rate_hz;
    let filmed =
        FilmedFlight { cameras: &cameras, films: &films, aircraft: &aircraft, truth: &truth, interval_s };
    let control = lab::control_points();
    let (rig, tracked) = filmed.track(&control, &control, &vehicle, &bars)?;
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
    let shares =
        |row: &FlightState| films.iter().map(|f| f.visible_shares(&vehicle, &aircraft, row)).collect();
    let visible: Vec<Vec<Vec<f64>>> = truth.iter().map(shares).collect();
    scores.identity = Some(score_identity(&results.poses, &truth, &markers_of(&vehicle), &visible));
    let centres: Vec<_> = cameras.iter().map(|c| (c.name.clone(), c.camera.centre_in_world())).collect();
    scores.cameras = results.rig.as_ref().map(|r| score_cameras(r, &centres)).unwrap_or_default();
    bars.done();
    write_toml(&args.out.join("vehicle.toml"), &vehicle)?;
    write_inputs(&args.out.join("inputs.csv"), &inputs)?;
    write_truth(&args.out.join("truth.csv"), &truth)?;
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

/// A flight filmed in the virtual room.
pub(super) struct FilmedFlight<'a> {
    pub(super) cameras: &'a [VirtualCamera],
    pub(super) films: &'a [StagedFilm<'a>],
    pub(super) aircraft: &'a Aircraft,
    pub(super) truth: &'a [FlightState],
    pub(super) interval_s: f64,
}

impl FilmedFlight<'_> {
    /// Calibrates from stills of a control frame, of which the table may be wrong, and tracks the flight.
    pub(super) fn track(
        &self,
        as_built: &[ControlPointRow],
        table: &[ControlPointRow],
        vehicle: &Vehicle,
        progress: &dyn Progress,
    ) -> Result<(Rig, Tracked)> {
        progress.begin(mavsight_pipeline::Stage::Calibrate, None);
        let control = lab::control_frame(as_built);
        let stills = control_stills(self.cameras, |k| self.films[k].still(Some(&control)))?;
        let rig = calibrate_from_stills(&stills, table, &[])?;
        let feeds = (0..self.cameras.len()).map(|k| self.feed(k)).collect();
        let tracked = mavsight_pipeline::track(feeds, &rig, vehicle, progress)?;
        Ok((rig, tracked))
    }

    /// A virtual camera as a source of frames.
    fn feed(&self, k: usize) -> CameraFeed<'_> {
        let camera = &self.cameras[k];
        let frames = self.truth.iter().enumerate().map(move |(n, row)| {
            let rgb = self.films[k].frame(n, self.aircraft, row, self.interval_s);
            let frame = Frame::from_rgb(camera.camera.size, rgb)
                .map_err(|e| PipelineError::Source { camera: camera.name.clone(), source: Box::new(e) })?;
            Ok(TimedFrame { t_ns: ns_from_s(row.t_s), frame })
        });
        CameraFeed::new(camera.name.clone(), Some(self.truth.len()), Box::new(frames))
    }
}

/// The control frame as each camera sees it.
pub(super) fn control_stills(
    cameras: &[VirtualCamera],
    still: impl Fn(usize) -> Vec<u8>,
) -> Result<Vec<ControlStill>> {
    let of = |(k, c): (usize, &VirtualCamera)| {
        Ok(ControlStill { camera: c.name.clone(), frame: frame_of(c.camera.size, still(k))? })
    };
    cameras.iter().enumerate().map(of).collect()
}

/// Places and radii of a vehicle's markers.
pub(super) fn markers_of(vehicle: &Vehicle) -> Vec<(Vector3<f64>, f64)> {
    vehicle.marker.iter().map(|m| (m.position_m.into(), m.diameter_m / 2.0)).collect()
}

fn frame_of(size: ImageSize, rgb: Vec<u8>) -> Result<Frame> {
    Frame::from_rgb(size, rgb).context("a filmed frame has the size of its camera")
}
