//! Fly, film, calibrate, track, identify, report; and score all of it.

use super::named;
use super::run::{finish, scores_of};
use crate::cli::Demo;
use crate::lab::{self, StagedFilm};
use crate::progress::Bars;
use anyhow::Result;
use mavsight_engine::{Flight, TrackedFlight, solve};
use mavsight_flight::Vehicle;
use mavsight_geometry::Vector3;
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
use mavsight_session::{ns_from_s, write_control_points, write_inputs, write_vehicle};
use mavsight_simulator::{FlightState, Scenario, simulate};
use mavsight_vision::Frame;
use std::path::Path;

pub(crate) fn vehicle_of(path: Option<&Path>) -> Result<Vehicle> {
    path.map_or_else(|| Ok(Vehicle::paper()), |p| named(mavsight_session::load_vehicle(p)))
}

pub(crate) fn scenario_of(path: Option<&Path>) -> Result<Scenario> {
    let Some(path) = path else { return Ok(Scenario::paper()) };
    let scenario: Scenario = named(mavsight_session::read_toml(path, "scenario file"))?;
    scenario.validate().map_err(|e| crate::cli::WrongCall(format!("{}: {e}", path.display())))?;
    Ok(scenario)
}

pub(crate) fn demo(args: &Demo) -> Result<()> {
    let vehicle = vehicle_of(args.vehicle.as_deref())?;
    let scenario = scenario_of(args.scenario.as_deref())?;
    let bars = Bars::new();
    bars.start("flying", None);
    let inputs = scenario.inputs(&vehicle)?;
    let truth = simulate(&vehicle, &inputs, &scenario.start(&vehicle)?, &scenario.frame_times_s())?;
    bars.start("building", None);
    let cameras = lab::cameras();
    let staging = &scenario.staging;
    let (room, aircraft) = (lab::room(staging), lab::aircraft(&vehicle));
    let films = lab::staged_films(&room, &cameras, args.seed, staging);
    let interval_s = 1.0 / scenario.frame_rate_hz;
    let filmed = FilmedFlight { films: &films, aircraft: &aircraft, truth: &truth, interval_s };
    let control = lab::control_points();
    let (rig, tracked) = filmed.track(&control, &control, &vehicle, &bars)?;
    let flight = Flight {
        name: "demo",
        vehicle: &vehicle,
        inputs: Some(&inputs),
        sensors: None,
        gyroscope: None,
        log_sensors: None,
        options: IdentifyOptions::default(),
    };
    let tracked = TrackedFlight { rig, tracked, body: Vec::new() };
    let mut results = solve(&flight, tracked, Some(&args.out), &bars)?;
    let mut scores = scores_of(&results, &truth);
    scores.parameters =
        results.identification.as_ref().map(|i| score_parameters(i, &vehicle)).unwrap_or_default();
    scores.output_error = score_output_error(&results.output_error, &vehicle);
    let shares =
        |row: &FlightState| films.iter().map(|f| f.visible_shares(&vehicle, &aircraft, row)).collect();
    let visible: Vec<Vec<Vec<f64>>> = truth.iter().map(shares).collect();
    scores.identity = Some(score_identity(&results.poses, &truth, &markers_of(&vehicle), &visible));
    let centres: Vec<_> = cameras.iter().map(|c| (c.name.clone(), c.camera.centre_in_world())).collect();
    scores.cameras = results.rig.as_ref().map(|r| score_cameras(r, &centres)).unwrap_or_default();
    bars.done();
    write_vehicle(&args.out.join("vehicle.toml"), &vehicle)?;
    write_inputs(&args.out.join("inputs.csv"), &inputs)?;
    write_truth(&args.out.join("truth.csv"), &truth, &vehicle)?;
    write_control_points(&args.out.join("control_points.csv"), &lab::control_points())?;
    let report =
        FlightReport { vehicle: &vehicle, inputs: Some(&inputs), truth: Some(&truth), session: None };
    finish(&mut results, Some(&scores), &report, &args.out, args.verbose)
}

pub(super) struct FilmedFlight<'a> {
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
        let still = |film: &StagedFilm<'_>| control_still(&film.camera, film.still(Some(&control)));
        let stills = self.films.iter().map(still).collect::<Result<Vec<_>>>()?;
        let rig = calibrate_from_stills(&stills, table, &[])?;
        let feeds = self.films.iter().map(|film| self.feed(film)).collect();
        let tracked = mavsight_pipeline::track(feeds, &rig, vehicle, progress)?;
        Ok((rig, tracked))
    }

    fn feed<'b>(&'b self, film: &'b StagedFilm<'b>) -> CameraFeed<'b> {
        let VirtualCamera { name, camera, .. } = &film.camera;
        let frames = self.truth.iter().enumerate().map(move |(n, row)| {
            let rgb = film.frame(n, self.aircraft, row, self.interval_s);
            let frame = Frame::from_rgb(camera.size, rgb)
                .map_err(|e| PipelineError::Source { camera: name.clone(), source: Box::new(e) })?;
            Ok(TimedFrame { t_ns: ns_from_s(row.t_s), frame })
        });
        CameraFeed::new(name.clone(), Some(self.truth.len()), Box::new(frames))
    }
}

pub(super) fn control_still(camera: &VirtualCamera, rgb: Vec<u8>) -> Result<ControlStill> {
    Ok(ControlStill { camera: camera.name.clone(), frame: Frame::from_rgb(camera.camera.size, rgb)? })
}

pub(super) fn markers_of(vehicle: &Vehicle) -> Vec<(Vector3<f64>, f64)> {
    vehicle.marker.iter().map(|m| (m.position_m.into(), m.diameter_m / 2.0)).collect()
}
