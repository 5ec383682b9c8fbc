//! Which cause is named for which fault: films of ten virtual rooms, each as it is and with each of twelve
//! faults, by themselves.
//!
//! `cargo run --release -p mavsight --example causes [ROOMS [FAULT]]` (ROOMS: how many, or from-to) prints a table: a row for each fault, a
//! column for each cause that was named, and what was said where it was another.

use anyhow::{Result, anyhow};
use mavsight::engine::{Flight, TrackedFlight, solve};
use mavsight::flight::{InputSeries, Vehicle};
use mavsight::geometry::{Camera, ImageSize, Intrinsics, UnitQuaternion, Vector3};
use mavsight::identify::output_error::MotionFits;
use mavsight::lab;
use mavsight::pipeline::{
    CameraFeed, Cause, ControlStill, Finding, IdentifyOptions, NoProgress, PipelineError, TimedFrame,
    calibrate_from_stills, track,
};
use mavsight::pose::{CameraClock, ClockPrior, Rig};
use mavsight::random::Random;
use mavsight::scene::{Aircraft, Film, Occluders, Room, Sensor};
use mavsight::simulator::staging::Decoy;
use mavsight::simulator::{FlightState, Maneuver, Scenario, Staging, simulate};
use mavsight::vision::Frame;

const SECONDS: f64 = 2.5;
const RATE_HZ: f64 = 30.0;
const SIZE: ImageSize = ImageSize { width_px: 640, height_px: 480 };

/// What is injected, in the order of the rows.
const FAULTS: [Cause; 12] = [
    Cause::CameraMoved,
    Cause::CameraFrozen,
    Cause::CameraDark,
    Cause::OutOfFocus,
    Cause::ColorsExchanged,
    Cause::BodyScale,
    Cause::Mass,
    Cause::ClockOffset,
    Cause::FrameRate,
    Cause::CamerasExchanged,
    Cause::ImageTurned,
    Cause::Decoy,
];

/// A room, its cameras and a flight in it.
struct Place {
    number: usize,
    cameras: Vec<Camera>,
    sensor: Sensor,
    vehicle: Vehicle,
    inputs: InputSeries,
    truth: Vec<FlightState>,
    /// The camera to which something happens.
    victim: usize,
    /// Frame from which on it does.
    from: usize,
}

impl Place {
    fn new(number: usize) -> Result<Self> {
        let mut random = Random::new(34, number as u64);
        // Every other room has a third camera.
        let cameras = (0..2 + number % 2).map(|k| {
            let turn = [-45.0, -135.0, 95.0][k] + random.between(-20.0, 20.0);
            let (turn, away_m) = (f64::to_radians(turn), random.between(6.2, 7.2));
            let at = Vector3::new(away_m * turn.cos(), away_m * turn.sin(), random.between(1.2, 2.4));
            let lens = Intrinsics::from_horizontal_fov(SIZE, 53_f64.to_radians());
            Camera::looking_at(at, Vector3::new(0.0, 0.0, 1.5), lens, SIZE)
        });
        let cameras: Vec<Camera> = cameras.collect();
        let vehicle = Vehicle::paper();
        let mut doublet = |channel: &str, start_s: f64, amplitude: f64| Maneuver::Doublet {
            channel: channel.to_owned(),
            start_s,
            pulse_s: random.between(0.3, 0.5),
            amplitude: if random.between(-1.0, 1.0) < 0.0 { -amplitude } else { amplitude },
        };
        let maneuver = vec![
            doublet("delta_lon", 0.2, 5.0),
            doublet("delta_lat", 0.4, 3.0),
            doublet("omega_u", 0.3, 3.0),
        ];
        let scenario = Scenario {
            duration_s: SECONDS,
            frame_rate_hz: RATE_HZ,
            heading_deg: random.between(0.0, 360.0),
            position_m: [random.between(-0.4, 0.4), random.between(-0.4, 0.4), random.between(1.3, 1.7)],
            maneuver,
            ..Scenario::paper()
        };
        let inputs = scenario.inputs(&vehicle)?;
        let truth = simulate(&vehicle, &inputs, &scenario.start(&vehicle)?, &scenario.frame_times_s())?;
        // Bright and dim rooms: what fills a pixel is fewer electrons, and their noise is larger.
        let sensor = Sensor {
            full_well_e: random.between(2500.0, 9000.0),
            lens_blur_px: random.between(0.4, 0.7),
            seed: number as u64,
            ..Sensor::default()
        };
        let victim = number % cameras.len();
        let from = (random.between(0.3, 0.5) * SECONDS * RATE_HZ) as usize;
        Ok(Self { number, cameras, sensor, vehicle, inputs, truth, victim, from })
    }

    fn sensor(&self, camera: usize) -> Sensor {
        Sensor { seed: 1_000 * self.sensor.seed + camera as u64, ..self.sensor }
    }

    fn name(camera: usize) -> String {
        format!("cam{}", camera + 1)
    }

    fn calibrated(&self, room: &Room) -> Result<Rig> {
        let points = lab::control_points();
        let frame = lab::control_frame(&points);
        let still = |(k, camera): (usize, &Camera)| {
            let rgb = Film::new(room, *camera, self.sensor(k)).still(Some(&frame));
            Ok(ControlStill { camera: Self::name(k), frame: Frame::from_rgb(SIZE, rgb)? })
        };
        let stills = self.cameras.iter().enumerate().map(still).collect::<Result<Vec<_>>>()?;
        Ok(calibrate_from_stills(&stills, &points, &[])?)
    }

    /// The frames from one on, by a camera.
    fn filmed(&self, film: &Film<'_>, from: usize) -> Result<Vec<Frame>> {
        let aircraft: Aircraft = lab::aircraft(&self.vehicle);
        let open_s = Sensor::default().exposure_fraction / RATE_HZ;
        let frame = |(k, state): (usize, &FlightState)| {
            let pose_at = |share: f64| lab::pose_near(state, share * open_s);
            let rgb = film.frame_with(k as u64, &aircraft, pose_at, &Occluders::default());
            Ok(Frame::from_rgb(SIZE, rgb)?)
        };
        self.truth.iter().enumerate().skip(from).map(frame).collect()
    }

    fn by_all(&self, room: &Room) -> Result<Vec<Vec<Frame>>> {
        let cameras = self.cameras.iter().enumerate();
        cameras.map(|(k, c)| self.filmed(&Film::new(room, *c, self.sensor(k)), 0)).collect()
    }
}

/// What the program is handed.
#[derive(Clone)]
struct Handed {
    vehicle: Vehicle,
    frames: Vec<Vec<Frame>>,
    /// Seconds by camera: what is added to its stamps, after they were stretched by a factor.
    late_s: Vec<f64>,
    slower: Vec<f64>,
    clocks: Vec<ClockPrior>,
}

impl Handed {
    fn sound(place: &Place, frames: &[Vec<Frame>]) -> Self {
        let count = place.cameras.len();
        let known = ClockPrior::known(CameraClock::default());
        let mut clocks = vec![known; count];
        // Half of the rooms leave the clocks to the flight, as a session does that says nothing of them.
        if place.number % 4 < 2 {
            clocks[1..].fill(ClockPrior::unknown());
        }
        Self {
            vehicle: place.vehicle.clone(),
            frames: frames.to_vec(),
            late_s: vec![0.0; count],
            slower: vec![1.0; count],
            clocks,
        }
    }

    fn feeds(&self) -> Vec<CameraFeed<'_>> {
        let feed = |(k, frames): (usize, &Vec<Frame>)| {
            let frames = frames.clone().into_iter().enumerate().map(move |(n, frame)| {
                let t_s = n as f64 / RATE_HZ * self.slower[k] + self.late_s[k];
                Ok(TimedFrame { t_ns: (t_s * 1e9).round() as i64, frame })
            });
            let feed = CameraFeed::new(Place::name(k), None, Box::new(frames));
            CameraFeed { clock: self.clocks[k], ..feed }
        };
        self.frames.iter().enumerate().map(feed).collect()
    }
}

fn mirrored(frame: &Frame) -> Result<Frame> {
    let pixels = (0..480).flat_map(|y| (0..640).rev().flat_map(move |x| frame.rgb(x, y)));
    Ok(Frame::from_rgb(SIZE, pixels.collect())?)
}

fn turned(frame: &Frame) -> Result<Frame> {
    let pixels = (0..480).rev().flat_map(|y| (0..640).rev().flat_map(move |x| frame.rgb(x, y)));
    Ok(Frame::from_rgb(SIZE, pixels.collect())?)
}

/// A decoy of a marker's colour, or two, where all cameras see them and the aircraft does not hide them.
fn decoys(place: &Place) -> Staging {
    let mut random = Random::new(340, place.number as u64);
    let decoy = (0..1 + place.number % 2).map(|k| {
        let marker = &place.vehicle.marker[(place.number + k) % place.vehicle.marker.len()];
        let around = random.between(0.0, std::f64::consts::TAU);
        let position_m = [0.9 * around.cos(), 0.9 * around.sin(), random.between(1.1, 1.9)];
        Decoy { position_m, diameter_m: marker.diameter_m, color: marker.color }
    });
    Staging { decoy: decoy.collect(), ..Staging::default() }
}

/// What is handed to the program with a fault in it.
fn with_fault(place: &Place, room: &Room, sound: &[Vec<Frame>], fault: Cause) -> Result<Handed> {
    let mut handed = Handed::sound(place, sound);
    let (number, victim) = (place.number, place.victim);
    let count = place.cameras.len();
    // The clock that is wrong is another's than the reference's.
    let late = 1 + number % (count - 1);
    let own = &mut handed.frames[victim];
    match fault {
        Cause::CameraMoved => {
            let mut random = Random::new(341, number as u64);
            let turn =
                Vector3::new(random.between(0.3, 1.5), random.between(-1.5, 1.5), random.between(-1.0, 1.0));
            let mut camera = place.cameras[victim];
            let turn = UnitQuaternion::from_scaled_axis(turn.map(f64::to_radians));
            camera.cam_from_world = turn * camera.cam_from_world;
            // In every third room before the flight began.
            let from = if number % 3 == 0 { 0 } else { place.from };
            let moved = place.filmed(&Film::new(room, camera, place.sensor(victim)), from)?;
            own.truncate(from);
            own.extend(moved);
        }
        Cause::CameraFrozen => {
            let last = own[place.from].clone();
            own[place.from..].fill(last);
        }
        Cause::CameraDark => own[place.from..].fill(Frame::from_rgb(SIZE, vec![3; 3 * SIZE.area_px()])?),
        Cause::OutOfFocus => {
            let lens_blur_px = 2.0 + 0.1 * number as f64;
            let sensor = Sensor { lens_blur_px, ..place.sensor(victim) };
            *own = place.filmed(&Film::new(room, place.cameras[victim], sensor), 0)?;
        }
        Cause::ColorsExchanged => {
            let pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];
            let (a, b) = pairs[number % pairs.len()];
            let markers = &mut handed.vehicle.marker;
            (markers[a].color, markers[b].color) = (markers[b].color, markers[a].color);
        }
        Cause::BodyScale => {
            let factor = [1000.0, 10.0, 100.0, 0.1, 1.0 / 0.0254][number % 5];
            for marker in &mut handed.vehicle.marker {
                marker.position_m = marker.position_m.map(|x| factor * x);
            }
        }
        Cause::Mass => handed.vehicle.mass_kg *= 1000.0,
        Cause::ClockOffset => {
            handed.late_s[late] = [0.05, 0.1, 0.2, -0.07, 0.3][number % 5];
            handed.clocks.fill(ClockPrior::known(CameraClock::default()));
        }
        Cause::FrameRate => handed.slower[late] = RATE_HZ / [25.0, 24.0, 60.0, 50.0, 20.0][number % 5],
        Cause::CamerasExchanged => handed.frames.swap(victim, (victim + 1) % count),
        Cause::ImageTurned => {
            let turn = if number % 2 == 0 { mirrored } else { turned };
            *own = own.iter().map(turn).collect::<Result<_>>()?;
        }
        Cause::Decoy => handed.frames = place.by_all(&lab::room(&decoys(place)))?,
        _ => return Err(anyhow!("no injection of {fault}")),
    }
    Ok(handed)
}

/// What the program finds, and what it says besides.
fn found(place: &Place, rig: &Rig, handed: &Handed) -> (Vec<Finding>, Vec<String>) {
    let tracked = match track(handed.feeds(), rig, &handed.vehicle, &NoProgress) {
        Ok(tracked) => tracked,
        Err(PipelineError::MixedUp { causes, given, mistake, .. }) => {
            let note = format!("{given} … {mistake}");
            return (vec![Finding { causes, camera: None, note }], vec![]);
        }
        Err(other) => return (vec![], vec![other.to_string()]),
    };
    let options = IdentifyOptions { motion_fits: MotionFits::NONE, ..IdentifyOptions::default() };
    let flight = Flight {
        name: "room",
        vehicle: &handed.vehicle,
        inputs: Some(&place.inputs),
        sensors: None,
        gyroscope: None,
        log_sensors: None,
        options,
    };
    let findings = tracked.findings.clone();
    let tracked = TrackedFlight { rig: rig.clone(), tracked, body: Vec::new() };
    match solve(&flight, tracked, None, &NoProgress) {
        Ok(results) => (results.findings, results.notes),
        Err(other) => (findings, vec![other.to_string()]),
    }
}

/// Counts of one row of the table.
#[derive(Default, Clone)]
struct Row {
    films: usize,
    right: usize,
    wrong: usize,
    undecided: usize,
    named: Vec<(Cause, usize)>,
}

impl Row {
    /// Counts what was named for a fault, or for none; whether it is as it should be.
    fn count(&mut self, fault: Option<Cause>, findings: &[Finding]) -> bool {
        self.films += 1;
        let mut named: Vec<Cause> = findings.iter().filter_map(Finding::cause).collect();
        named.sort_unstable();
        named.dedup();
        for cause in &named {
            match self.named.iter_mut().find(|n| n.0 == *cause) {
                Some(n) => n.1 += 1,
                None => self.named.push((*cause, 1)),
            }
        }
        let is_right = fault.is_none_or(|fault| named.contains(&fault));
        let is_wrong = named.iter().any(|cause| Some(*cause) != fault);
        let is_among =
            |f: &Finding| f.causes.len() > 1 && fault.is_some_and(|fault| f.causes.contains(&fault));
        self.right += usize::from(is_right);
        self.wrong += usize::from(is_wrong);
        self.undecided += usize::from(!is_right && findings.iter().any(is_among));
        is_right && !is_wrong
    }
}

fn print(rows: &[(Option<Cause>, Row)]) {
    println!("| injected | films | right | undecided | wrong | named |");
    println!("|---|---|---|---|---|---|");
    for (fault, row) in rows {
        let name = fault.map_or("nothing", Cause::words);
        let named: Vec<String> = row.named.iter().map(|(cause, n)| format!("{cause} {n}")).collect();
        let right = if fault.is_some() { row.right.to_string() } else { "-".to_owned() };
        let Row { films, undecided, wrong, .. } = row;
        println!("| {name} | {films} | {right} | {undecided} | {wrong} | {} |", named.join(", "));
    }
    let injected = || rows.iter().filter(|r| r.0.is_some()).map(|r| &r.1);
    let films: usize = injected().map(|r| r.films).sum();
    let percent = |n: usize| 100.0 * n as f64 / films.max(1) as f64;
    let (right, wrong) = (injected().map(|r| r.right).sum(), injected().map(|r| r.wrong).sum());
    println!(
        "\nright cause in {:.1} %, a wrong one in {:.1} % of {films} films",
        percent(right),
        percent(wrong)
    );
}

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let rooms = arguments.next().unwrap_or_else(|| "10".to_owned());
    let rooms: std::ops::Range<usize> = match rooms.split_once('-') {
        Some((from, to)) => from.parse()?..to.parse()?,
        None => 0..rooms.parse()?,
    };
    let only = arguments.next();
    let all = std::iter::once(None).chain(FAULTS.map(Some));
    let is_wanted = |f: &Option<Cause>| {
        only.as_ref().is_none_or(|only| f.is_some_and(|f| format!("{f:?}").eq_ignore_ascii_case(only)))
    };
    let mut rows: Vec<(Option<Cause>, Row)> = all.filter(is_wanted).map(|f| (f, Row::default())).collect();
    let room = lab::room(&Staging::default());
    for number in rooms {
        let place = Place::new(number)?;
        let rig = place.calibrated(&room)?;
        let sound = place.by_all(&room)?;
        for (fault, row) in &mut rows {
            let handed = match fault {
                Some(fault) => with_fault(&place, &room, &sound, *fault)?,
                None => Handed::sound(&place, &sound),
            };
            let (findings, notes) = found(&place, &rig, &handed);
            if !row.count(*fault, &findings) {
                let name = fault.map_or("nothing", Cause::words);
                println!("room {number}, {name}:");
                findings.iter().for_each(|f| println!("  {:?} {}", f.causes, f.note));
                notes.iter().for_each(|note| println!("  - {note}"));
            }
        }
    }
    print(&rows);
    Ok(())
}
