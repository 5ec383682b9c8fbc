//! Flights in a virtual laboratory: simulated observations, measured by the real pipeline.

use crate::{ScoreError, VirtualLab};
use mavsight_geometry::{Camera, ControlPoint, Isometry3, Matrix2, Point3, Vector2, Vector3};
use mavsight_pipeline::{NoProgress, Refinement, Tracked, motion_of, reconstruct, refine};
use mavsight_pose::{CameraControl, MarkerObservation, Motion, Rig, calibrate};
use mavsight_random::Random;
use mavsight_session::ns_from_s;
use mavsight_simulator::{Carried, FlightState, Maneuver, Scenario, Simulator};

const DURATION_S: f64 = 6.0;

/// Inputs that are moved, with the largest amplitudes: degrees of the swash-plate, per cent of the rotor
/// speed.
const LARGEST: [(&str, f64); 3] = [("delta_lon", 5.0), ("delta_lat", 4.0), ("omega_u", 1.5)];

/// What is carried by hand is so at most this long before its flight: its sines do not come together again.
const LONGEST_S: f64 = 1e3;

/// Once a flight no camera sees anything for this time.
const GAP_S: f64 = 0.25;

/// Least distance of a ball's centre from the border of the image.
const MARGIN_PX: f64 = 3.0;

/// Part of the instants at which two cameras must see three markers.
const IN_VIEW_SHARE: f64 = 0.9;

/// A flight that leaves the view gets smaller manoeuvres by this factor, at most eight times.
const SMALLER: f64 = 0.6;
const SMALLER_TIMES: usize = 8;

/// A flight and its measurement.
#[derive(Debug, Clone)]
pub struct VirtualFlight {
    /// True states at the instants of the frames.
    pub truth: Vec<FlightState>,
    /// The cameras as calibrated for this flight, and as refined from it.
    pub rig: Rig,
    /// Poses.
    pub tracked: Tracked,
    /// Motion.
    pub motion: Motion,
}

impl VirtualLab {
    /// One flight from simulated observations: control points are observed with noise and the cameras
    /// calibrated from them, the aircraft flies a random manoeuvre, its markers are observed with noise and
    /// losses, and the pipeline behind detection measures the motion.
    ///
    /// # Errors
    /// A laboratory in which nothing can be measured, or a pipeline that fails.
    pub fn fly(&self, random: &mut Random) -> Result<VirtualFlight, ScoreError> {
        let rig = calibrate(&self.control_observations(random))?;
        let truth = self.flight(random)?;
        let as_it_stands = |camera: usize, _: usize| self.cameras[camera].camera;
        let tracked = reconstruct(&rig, &self.vehicle, self.draw_observations(&truth, as_it_stands, random))?;
        self.measured(truth, rig, tracked)
    }

    /// Smooths a tracked flight; first refines the cameras from it if the laboratory does so.
    ///
    /// # Errors
    /// Too few poses.
    pub fn measured(
        &self,
        truth: Vec<FlightState>,
        rig: Rig,
        mut tracked: Tracked,
    ) -> Result<VirtualFlight, ScoreError> {
        let how = Refinement { rig: Some(self.refines), ..Refinement::default() };
        let rig = refine(&mut tracked, &rig, &self.vehicle, how)?.map_or(rig, |body| body.refined.rig);
        let motion = motion_of(&tracked, None, &self.vehicle, &NoProgress)?;
        Ok(VirtualFlight { truth, rig, tracked, motion })
    }

    /// A random motion in view of the cameras: hover with doublets and a 3-2-1-1 in the swash-plate and the
    /// rotor speed where the vehicle has these inputs; another aircraft is carried about by hand, since what
    /// it does in a room by itself is not known.
    ///
    /// # Errors
    /// [`ScoreError::OutOfView`] where even a small motion is not seen; a vehicle that cannot be simulated.
    pub fn flight(&self, random: &mut Random) -> Result<Vec<FlightState>, ScoreError> {
        let mut scenario = self.scenario(random);
        let flies = LARGEST.iter().all(|(input, _)| self.vehicle.model.input(input).is_some());
        let simulator = if flies { Some(Simulator::new(&self.vehicle)?) } else { None };
        let since_s = if flies { 0.0 } else { random.between(0.0, LONGEST_S) };
        let (mut most, mut size) = (0.0, 1.0);
        for _ in 0..SMALLER_TIMES {
            let states = match &simulator {
                Some(simulator) => {
                    let (inputs, start) = (scenario.inputs(&self.vehicle)?, scenario.start(&self.vehicle)?);
                    simulator.fly(&inputs, &start, &scenario.frame_times_s())?
                }
                None => {
                    let (heading_rad, place) = (-scenario.heading_deg.to_radians(), scenario.position_m);
                    let motion = Carried { middle_in_world_m: place.into(), heading_rad, size, since_s };
                    motion.states(DURATION_S, self.frame_rate_hz, self.vehicle.model.states.len())
                }
            };
            let seen = states.iter().filter(|s| self.is_in_view(s)).count() as f64;
            let share = seen / states.len().max(1) as f64;
            if share >= IN_VIEW_SHARE {
                return Ok(states);
            }
            most = f64::max(most, share);
            size *= SMALLER;
            scenario.maneuver.iter_mut().for_each(|m| *m = m.scaled(SMALLER));
        }
        let (share_percent, needed_percent) = (100.0 * most, 100.0 * IN_VIEW_SHARE);
        Err(ScoreError::OutOfView { share_percent, needed_percent, middle_m: self.middle_m.into() })
    }

    fn scenario(&self, random: &mut Random) -> Scenario {
        let mut maneuver = Vec::new();
        for (input, largest) in LARGEST {
            let (amplitude, start_s) = (largest * random.between(-1.0, 1.0), random.between(0.5, 3.0));
            let (channel, pulse_s) = (input.to_owned(), random.between(0.3, 0.8));
            maneuver.push(Maneuver::Doublet { channel, start_s, pulse_s, amplitude });
        }
        let (channel, amplitude) = (LARGEST[0].0.to_owned(), random.between(-2.0, 2.0));
        maneuver.push(Maneuver::ThreeTwoOneOne { channel, start_s: 3.0, unit_s: 0.25, amplitude });
        let start = self.middle_m + self.around_m.map(|half| half * random.between(-1.0, 1.0));
        Scenario {
            duration_s: DURATION_S,
            frame_rate_hz: self.frame_rate_hz,
            heading_deg: random.between(0.0, 360.0),
            position_m: start.into(),
            maneuver,
            ..Scenario::paper()
        }
    }

    fn pixel(&self, view: &Camera, marker: usize, pose: &Isometry3<f64>) -> Option<Vector2<f64>> {
        let ball = &self.vehicle.marker[marker];
        let centre = (pose * Point3::from(Vector3::from(ball.position_m))).coords;
        let pixel = view.project_ball(&centre, ball.diameter_m / 2.0).ok()?.pixel;
        view.size.contains(&pixel, MARGIN_PX).then_some(pixel)
    }

    fn is_in_view(&self, state: &FlightState) -> bool {
        let pose = state.pose();
        let markers = self.vehicle.marker.len();
        let sees = |camera: usize| {
            let seen = |m: &usize| {
                let noise = &self.observations[camera * markers + m];
                !noise.stated_px2.is_empty() && self.pixel(&self.cameras[camera].camera, *m, &pose).is_some()
            };
            (0..markers).filter(seen).count() >= 3
        };
        (0..self.cameras.len()).filter(|c| sees(*c)).count() >= 2
    }

    /// Observations of the control frame by each camera, with common survey errors.
    pub(crate) fn control_observations(&self, random: &mut Random) -> Vec<CameraControl> {
        let mut normal3 = |std: f64| Vector3::from_fn(|_, _| std * random.normal());
        let places: Vec<Vector3<f64>> =
            self.control.iter().map(|row| Vector3::from(row.position_m) + normal3(row.std_m)).collect();
        let mut out = Vec::with_capacity(self.cameras.len());
        for c in &self.cameras {
            let mut control = CameraControl::exact(c.name.clone(), c.camera.size, vec![], vec![]);
            for ((row, place), _) in self.control.iter().zip(&places).zip(&c.sees).filter(|(_, sees)| **sees)
            {
                let Ok(seen) = c.camera.project_ball(place, row.diameter_m / 2.0) else { continue };
                let noise = Vector2::new(random.normal(), random.normal()) * c.control_std_px;
                control.points.push(ControlPoint {
                    name: row.name.clone(),
                    point_in_world_m: row.position_m.into(),
                    pixel: seen.pixel + noise,
                    pixel_cov_px2: Matrix2::identity() * c.control_std_px.powi(2),
                });
                control.ball_radius_m.push(row.diameter_m / 2.0);
                control.survey_std_m.push(row.std_m);
            }
            out.push(control);
        }
        out
    }

    /// What each camera, which stands at a frame's number as `view` says, observes of the markers, with noise and losses.
    pub(crate) fn draw_observations(
        &self,
        flight: &[FlightState],
        view: impl Fn(usize, usize) -> Camera,
        random: &mut Random,
    ) -> Vec<(i64, Vec<MarkerObservation>)> {
        let markers = self.vehicle.marker.len();
        let gap = ((GAP_S * self.frame_rate_hz).round() as usize).min(flight.len());
        let lost_from = (random.uniform() * (flight.len() - gap) as f64) as usize;
        let mut normal2 = |std: f64| Vector2::new(random.normal(), random.normal()) * std;
        let bias: Vec<Vector2<f64>> = self.observations.iter().map(|_| normal2(self.bias_px)).collect();
        let mut out = Vec::with_capacity(flight.len());
        for (k, state) in flight.iter().enumerate() {
            let (pose, t_ns) = (state.pose(), ns_from_s(state.t_s));
            let mut seen = Vec::new();
            for (index, noise) in self.observations.iter().enumerate() {
                let (camera, marker) = (index / markers, index % markers);
                let drawn = (random.uniform() * noise.stated_px2.len() as f64) as usize;
                let normal = Vector2::new(random.normal(), random.normal()) * self.noise_over_stated;
                let is_lost =
                    random.uniform() < noise.lost_share || (lost_from..lost_from + gap).contains(&k);
                let Some(covariance_px2) = noise.stated_px2.get(drawn).copied() else { continue };
                let Some(spread) = covariance_px2.cholesky().filter(|_| !is_lost) else { continue };
                let Some(pixel) = self.pixel(&view(camera, k), marker, &pose) else { continue };
                let pixel = pixel + spread.l() * normal + bias[index];
                seen.push(MarkerObservation { t_ns, camera, marker, pixel, covariance_px2 });
            }
            out.push((t_ns, seen));
        }
        out
    }
}
