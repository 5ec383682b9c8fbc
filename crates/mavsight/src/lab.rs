//! The virtual laboratory: the paper's cameras, control frame and aircraft, filmed.

use mavsight_flight::{Color, Vehicle};
use mavsight_geometry::{Isometry3, UnitQuaternion, Vector2, Vector3};
use mavsight_pipeline::ControlPointRow;
use mavsight_scene::{Aircraft, ControlFrame, Film, Occluders, PaintedBall, Person, Room, Sensor, Veil};
use mavsight_score::{VirtualCamera, VirtualLab, true_pose};
use mavsight_simulator::staging::{Black, Walker};
use mavsight_simulator::{FlightState, Staging};

/// The paper's cameras.
pub fn cameras() -> Vec<VirtualCamera> {
    VirtualLab::paper().cameras
}

/// The paper's control frame.
pub fn control_points() -> Vec<ControlPointRow> {
    VirtualLab::paper().control
}

fn ball(centre_m: [f64; 3], diameter_m: f64, color: Color) -> PaintedBall {
    PaintedBall { centre_m: centre_m.into(), radius_m: diameter_m / 2.0, linear: color.to_linear() }
}

/// Models of the shelf that are flown by a small helicopter.
const HELICOPTERS: [&str; 3] = ["coaxial", "coaxial-lag", "helicopter"];

/// The balls and the hull of a vehicle: the paper's helicopter, or, of other models, arms that carry the balls.
pub fn aircraft(vehicle: &Vehicle) -> Aircraft {
    let balls = vehicle.marker.iter().map(|m| ball(m.position_m, m.diameter_m, m.color));
    let balls = balls.collect::<Vec<_>>();
    match HELICOPTERS.contains(&vehicle.model.name.as_str()) {
        true => Aircraft::helicopter(&balls),
        false => Aircraft::hub_with_arms(&balls),
    }
}

/// A control frame as it is filmed.
pub fn control_frame(points: &[ControlPointRow]) -> ControlFrame {
    let balls = points.iter().map(|p| ball(p.position_m, p.diameter_m, p.color));
    ControlFrame::new(&balls.collect::<Vec<_>>())
}

/// The meeting room with what a scenario puts into it.
pub fn room(staging: &Staging) -> Room {
    let mut room = Room::meeting_room();
    for d in &staging.decoy {
        room.add_ball(&ball(d.position_m, d.diameter_m, d.color));
    }
    for p in &staging.poster {
        let [width_m, height_m] = p.size_m;
        room.add_block(p.position_m, [width_m, 0.01, height_m], p.heading_deg, p.color.to_linear());
    }
    room
}

/// A camera that films a scenario.
pub struct StagedFilm<'a> {
    /// The camera, as it stands at first.
    pub camera: VirtualCamera,
    film: Film<'a>,
    /// From when on the camera stands otherwise, and what it films then.
    bumped: Vec<(f64, Film<'a>)>,
    staging: Staging,
}

/// A camera's film; the noise of each camera is its own.
pub fn film<'a>(room: &'a Room, camera: &VirtualCamera, index: usize, seed: u64) -> Film<'a> {
    Film::new(room, camera.camera, sensor(index, seed))
}

fn sensor(index: usize, seed: u64) -> Sensor {
    let seed = seed.wrapping_mul(1_000_003).wrapping_add(index as u64);
    Sensor { seed, ..Sensor::default() }
}

/// The films of all cameras of a scenario.
pub fn staged_films<'a>(
    room: &'a Room,
    cameras: &[VirtualCamera],
    seed: u64,
    staging: &Staging,
) -> Vec<StagedFilm<'a>> {
    cameras.iter().enumerate().map(|(k, camera)| staged_film(room, camera, k, seed, staging)).collect()
}

/// A camera's film with what a scenario does to the camera.
pub fn staged_film<'a>(
    room: &'a Room,
    camera: &VirtualCamera,
    index: usize,
    seed: u64,
    staging: &Staging,
) -> StagedFilm<'a> {
    let mut turned = camera.camera;
    let mut bumps: Vec<_> = staging.bump.iter().filter(|b| b.camera == camera.name).collect();
    bumps.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    let bumped = bumps
        .into_iter()
        .map(|bump| {
            let turn = Vector3::from(bump.turn_deg.map(f64::to_radians));
            turned.cam_from_world = UnitQuaternion::from_scaled_axis(turn) * turned.cam_from_world;
            (bump.at_s, Film::new(room, turned, sensor(index, seed)))
        })
        .collect();
    let film = film(room, camera, index, seed);
    StagedFilm { camera: camera.clone(), film, bumped, staging: staging.clone() }
}

impl StagedFilm<'_> {
    /// The room with a control frame, before anything happens.
    pub fn still(&self, control: Option<&ControlFrame>) -> Vec<u8> {
        self.film.still(control)
    }

    /// One frame of a flight; the shutter is open for a quarter of the interval around the state's time.
    pub fn frame(&self, index: usize, aircraft: &Aircraft, state: &FlightState, interval_s: f64) -> Vec<u8> {
        let open_s = Sensor::default().exposure_fraction * interval_s;
        let pose_at = |share: f64| pose_near(state, share * open_s);
        self.film_at(state.t_s).frame_with(index as u64, aircraft, pose_at, &self.way(state.t_s))
    }

    /// One frame of a flight at any time between the rows of its truth. Before the first row the aircraft
    /// comes from rest, and to rest after the last. A rolling shutter films nothing that is in the way.
    pub fn frame_at(
        &self,
        index: usize,
        aircraft: &Aircraft,
        truth: &[FlightState],
        when: Shot,
    ) -> Option<Vec<u8>> {
        let open_s = Sensor::default().exposure_fraction * when.interval_s;
        let first = truth.first()?;
        let pose_at = |share: f64| {
            let t_s = when.t_s + share * open_s;
            let before = truth.partition_point(|row| row.t_s <= t_s).checked_sub(1);
            let end = before.map_or(first, |row| &truth[row]);
            true_pose(truth, t_s).unwrap_or_else(|| pose_beyond(end, t_s - end.t_s))
        };
        let film = self.film_at(when.t_s);
        Some(if when.line_time_s == 0.0 {
            film.frame_with(index as u64, aircraft, pose_at, &self.way(when.t_s))
        } else {
            film.rolling_frame(index as u64, aircraft, when.line_time_s / open_s, pose_at)
        })
    }

    /// Share of each ball's face that the camera sees.
    pub fn visible_shares(&self, vehicle: &Vehicle, aircraft: &Aircraft, state: &FlightState) -> Vec<f64> {
        let (way, pose) = (self.way(state.t_s), pose_near(state, 0.0));
        let film = self.film_at(state.t_s);
        let share = |m: &mavsight_flight::Marker| {
            film.visible_share(&m.position_m.into(), m.diameter_m / 2.0, aircraft, &pose, &way)
        };
        vehicle.marker.iter().map(share).collect()
    }

    fn film_at(&self, t_s: f64) -> &Film<'_> {
        self.bumped.iter().rev().find(|b| b.0 <= t_s).map_or(&self.film, |b| &b.1)
    }

    fn way(&self, t_s: f64) -> Occluders {
        let (staging, own, size) = (&self.staging, &self.camera.name, self.camera.camera.size);
        let (width, height) = (f64::from(size.width_px), f64::from(size.height_px));
        let shines = staging.glare.iter().filter(|g| g.camera == *own && (g.from_s..g.to_s).contains(&t_s));
        let veils = shines.map(|g| {
            let along = (t_s - g.from_s) / (g.to_s - g.from_s);
            let at = |k: usize| g.from[k] + along * (g.to[k] - g.from[k]);
            let pixel = Vector2::new(at(0) * width, at(1) * height);
            Veil { pixel, radius_px: g.radius * width, strength: g.strength }
        });
        let person = |w: &Walker| Person { at_m: w.place_m(t_s), linear: w.color.to_linear() };
        let is_dark = |b: &Black| b.camera == *own && t_s >= b.from_s && b.to_s.is_none_or(|to_s| t_s < to_s);
        Occluders {
            people: staging.walker.iter().map(person).collect(),
            veils: veils.collect(),
            black: staging.black.iter().any(is_dark),
        }
    }
}

/// When a frame is taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shot {
    /// Middle of the exposure of the middle row.
    pub t_s: f64,
    /// Time from frame to frame.
    pub interval_s: f64,
    /// Time from row to row; 0: all together.
    pub line_time_s: f64,
}

/// The pose a moment before or after a state, with its velocities and accelerations taken as constant.
pub fn pose_near(state: &FlightState, dt_s: f64) -> Isometry3<f64> {
    let mut near = state.pose();
    let moved = near.rotation * state.velocity_in_body_m_s * dt_s;
    let turn = state.rates_rad_s * dt_s + state.angular_acceleration_rad_s2 * (0.5 * dt_s * dt_s);
    near.translation.vector += moved;
    near.rotation *= UnitQuaternion::from_scaled_axis(turn);
    near
}

/// Time constant of the velocity beyond the ends of a flight: within what small aircraft brake by.
const REST_S: f64 = 0.25;

/// The pose before the first or after the last state, with velocities that fall off from there.
fn pose_beyond(end: &FlightState, dt_s: f64) -> Isometry3<f64> {
    pose_near(end, dt_s.signum() * REST_S * (1.0 - (-dt_s.abs() / REST_S).exp()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::EulerAngles;

    #[test]
    fn an_aircraft_comes_from_rest_without_a_jolt() {
        let state = FlightState {
            velocity_in_body_m_s: Vector3::new(0.8, 0.0, -0.3),
            rates_rad_s: Vector3::y(),
            attitude: EulerAngles { theta_rad: 0.1, ..EulerAngles::default() },
            ..FlightState::default()
        };
        const STEP_S: f64 = 1e-4;
        let here = pose_near(&state, 0.0);
        for side in [-STEP_S, STEP_S] {
            let (beyond, flown) = (pose_beyond(&state, side), pose_near(&state, side));
            let moved = beyond.translation.vector - here.translation.vector;
            assert!((beyond.translation.vector - flown.translation.vector).norm() < 1e-3 * moved.norm());
            assert!(
                beyond.rotation.angle_to(&flown.rotation) < 1e-3 * here.rotation.angle_to(&flown.rotation)
            );
        }
        let (far, farther) = (pose_beyond(&state, -10.0), pose_beyond(&state, -20.0));
        assert!((far.inverse() * farther).translation.vector.norm() < 1e-9);
        assert!((far.translation.vector - here.translation.vector).norm() < REST_S);
    }
}
