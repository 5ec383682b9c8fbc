//! Is the predicted error of a pose the one that is achieved? Rigs filmed in the virtual room: stills of the control frame
//! calibrate them, then single frames of the aircraft at random poses in the volume are detected and measured.
//!
//! `cargo run --release -p mavsight --example plan_filmed -- 4 12`: calibrations a rig, and frames after each.
//!
//! Given to the prediction are the places of cameras, control points and markers, and how good centres are by the claims of a
//! first film of other seeds, as a user has them from a session; nothing is taken from the films that it is compared with.

use mavsight::flight::Vehicle;
use mavsight::geometry::{EulerAngles, Isometry3, Point3, Vector3, world_from_body};
use mavsight::lab;
use mavsight::pipeline::{
    CameraFeed, ControlStill, PipelineError, Quiet, TimedFrame, body_markers, calibrate_from_stills, track,
};
use mavsight::plan::{EXAMPLE, Placed, Planner, Room as RoomFile};
use mavsight::scene::{Film, Room};
use mavsight::score::{Random, VirtualCamera};
use mavsight::session::{TruthRow, ns_from_s};
use mavsight::vision::Frame;

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

const INTERVAL_S: f64 = 1.0 / 30.0;
/// Of the cameras from the middle: within the walls for every angle.
const DISTANCE_M: f64 = 5.3;

/// Squares of errors of position and turn, what was predicted of them, squares of centres, and their numbers.
#[derive(Default, Clone, Copy)]
struct Sums {
    position_m2: f64,
    turn_rad2: f64,
    predicted_m2: f64,
    predicted_rad2: f64,
    poses: f64,
    centres_px2: f64,
    coordinates: f64,
    control_px: f64,
    claimed_px2: f64,
    calibrations: f64,
}

fn row(k: usize, place: Vector3<f64>, attitude: EulerAngles) -> TruthRow {
    TruthRow {
        t_s: k as f64 * INTERVAL_S,
        x_m: place.x,
        y_m: place.y,
        z_m: place.z,
        phi_rad: attitude.phi_rad,
        theta_rad: attitude.theta_rad,
        psi_rad: attitude.psi_rad,
        ..TruthRow::default()
    }
}

/// Random poses in the volume: any heading, a few degrees of bank and pitch.
fn poses(planner: &Planner, count: usize, random: &mut Random) -> Vec<(TruthRow, Isometry3<f64>)> {
    let volume = &planner.room().volume;
    (0..count)
        .map(|k| {
            let place = Vector3::from_fn(|i, _| random.between(volume.low_m[i], volume.high_m[i]));
            let attitude = EulerAngles {
                phi_rad: random.between(-0.1, 0.1),
                theta_rad: random.between(-0.1, 0.1),
                // The headings of the plan, give or take: they keep the balls apart.
                psi_rad: random.between(-0.1, 0.1)
                    - volume.headings_deg[k % volume.headings_deg.len()].to_radians(),
            };
            (row(k, place, attitude), world_from_body(place, attitude))
        })
        .collect()
}

fn cameras_of(planner: &Planner, placed: &[Placed]) -> Vec<VirtualCamera> {
    let camera = |(k, p): (usize, &Placed)| VirtualCamera {
        name: planner.name(k),
        camera: planner.camera(p),
        sees: vec![true; planner.control().len()],
        control_std_px: 0.0,
    };
    placed.iter().enumerate().map(camera).collect()
}

/// Films of a rig, calibration after calibration; the room is rendered once.
fn filmed(
    planner: &Planner,
    placed: &[Placed],
    (seeds, count): (std::ops::Range<u64>, usize),
) -> Outcome<Sums> {
    let room = Room::meeting_room();
    let cameras = cameras_of(planner, placed);
    let mut films: Vec<Film<'_>> =
        cameras.iter().enumerate().map(|(k, c)| lab::film(&room, c, k, 1)).collect();
    let mut sums = Sums::default();
    for seed in seeds {
        films.iter_mut().enumerate().for_each(|(k, f)| f.reseed(1_000_003 * seed + k as u64));
        if let Err(error) = film_once(planner, (placed, &cameras, &films), (seed, count), &mut sums) {
            println!("calibration {seed}: {error}");
        }
        sums.calibrations += 1.0;
    }
    Ok(sums)
}

fn film_once(
    planner: &Planner,
    (placed, cameras, films): (&[Placed], &[VirtualCamera], &[Film<'_>]),
    (seed, count): (u64, usize),
    sums: &mut Sums,
) -> Outcome<()> {
    let vehicle = Vehicle::paper();
    let aircraft = lab::aircraft(&vehicle);
    let control = lab::control_frame(planner.control());
    let mut stills = Vec::new();
    for (c, film) in cameras.iter().zip(films) {
        let frame = Frame::from_rgb(c.camera.size, film.still(Some(&control)))?;
        stills.push(ControlStill { camera: c.name.clone(), frame });
    }
    let rig = calibrate_from_stills(&stills, planner.control())?;
    sums.control_px += rig.cameras.iter().map(|c| c.sigma_px).sum::<f64>() / rig.cameras.len() as f64;
    let truth = poses(planner, count, &mut Random::new(seed, 7));
    let feeds = cameras.iter().zip(films).map(|(c, film)| {
        let frames = truth.iter().enumerate().map(|(k, (row, _))| {
            let frame = Frame::from_rgb(c.camera.size, lab::frame(film, k, &aircraft, row, INTERVAL_S))
                .map_err(|e| PipelineError::Source { camera: c.name.clone(), source: Box::new(e) })?;
            Ok(TimedFrame { t_ns: ns_from_s(row.t_s), frame })
        });
        CameraFeed::new(c.name.clone(), Some(count), Box::new(frames))
    });
    let tracked = track(feeds.collect(), &rig, &vehicle, &Quiet)?;
    for (k, (row, pose)) in truth.iter().enumerate() {
        let t_ns = ns_from_s(row.t_s);
        let seen: Vec<_> = tracked.observations.iter().filter(|o| o.t_ns == t_ns).collect();
        let Some(got) = &tracked.poses[k].estimate else { continue };
        // What the plan is about: every marker seen by all, none taken for false.
        if seen.len() < cameras.len() * vehicle.marker.len() || !got.left_out.is_empty() {
            continue;
        }
        let foreseen = planner.predict(placed, &[*pose]);
        if !foreseen.is_feasible() {
            continue;
        }
        sums.predicted_m2 += (1e-3 * foreseen.mean.position_std_mm).powi(2);
        sums.predicted_rad2 += foreseen.mean.attitude_std_deg.to_radians().powi(2);
        sums.position_m2 += (got.world_from_body.translation.vector - pose.translation.vector).norm_squared();
        sums.turn_rad2 += pose.rotation.angle_to(&got.world_from_body.rotation).powi(2);
        sums.poses += 1.0;
        for o in seen {
            sums.claimed_px2 += o.covariance_px2.trace();
            let ball = &planner.markers()[o.marker];
            let centre = (pose * Point3::from(ball.marker_in_body_m)).coords;
            let view = &cameras[o.camera].camera;
            let exact = view.project_ball(&centre, ball.radius_m)?.pixel;
            sums.centres_px2 += (o.pixel - exact).norm_squared();
            sums.coordinates += 2.0;
        }
    }
    Ok(())
}

/// What a session knows of its centres: of markers and in stills.
#[derive(Clone, Copy)]
struct Known {
    centre_std_px: f64,
    control_std_px: f64,
}

fn planner(known: Option<Known>, change: impl FnOnce(&mut RoomFile)) -> Outcome<Planner> {
    let mut room: RoomFile = toml::from_str(EXAMPLE[0].1)?;
    room.block.clear();
    if let Some(known) = known {
        room.camera[0].centre_std_px = Some(known.centre_std_px);
        if let Some(control) = &mut room.control {
            control.std_px = Some(known.control_std_px);
        }
    }
    change(&mut room);
    Ok(Planner::new(room, body_markers(&Vehicle::paper()), lab::control_points())?)
}

fn rigs(known: Option<Known>) -> Outcome<Vec<(String, Planner, Vec<Placed>)>> {
    let mut out: Vec<(String, Planner, Vec<Placed>)> = Vec::new();
    for angle in [50.0, 70.0, 90.0, 110.0, 130.0] {
        let p = planner(known, |_| ())?;
        let placed = p.pair(0, angle, DISTANCE_M).to_vec();
        out.push((format!("{angle:.0} degrees"), p, placed));
    }
    let three = planner(known, |_| ())?;
    let mut placed = three.pair(0, 90.0, DISTANCE_M).to_vec();
    placed.push(Placed { centre_m: Vector3::new(1.5, 1.9, 2.9), ..placed[0] });
    out.push(("three".to_owned(), three, placed));
    Ok(out)
}

/// What the first session in a room tells of its centres, without truth: the claims of `markers.csv` after the flight's
/// residuals, and the residuals of calibration.
fn pilot(calibrations: u64, frames: usize) -> Outcome<Known> {
    let p = planner(None, |_| ())?;
    let sums = filmed(&p, &p.pair(0, 90.0, DISTANCE_M), (1000..1000 + calibrations, frames))?;
    let centre_std_px = (sums.claimed_px2 / sums.coordinates.max(1.0)).sqrt();
    Ok(Known { centre_std_px, control_std_px: sums.control_px / calibrations as f64 })
}

fn main() -> Outcome<()> {
    let mut words = std::env::args().skip(1);
    let calibrations: u64 = words.next().map_or(Ok(4), |w| w.parse())?;
    let frames: usize = words.next().map_or(Ok(12), |w| w.parse())?;
    let only: Option<String> = words.next();
    let known = pilot(2.max(calibrations / 2), frames)?;
    println!("pilot: centres {:.4} px, stills {:.4} px", known.centre_std_px, known.control_std_px);
    println!(
        "{:<12} {:>5} | position mm: achieved predicted ratio | attitude deg: achieved predicted ratio | centres px: achieved, claimed | stills px",
        "rig", "poses"
    );
    for (name, planner, placed) in rigs(Some(known))? {
        if only.as_ref().is_some_and(|o| !name.contains(o.as_str())) {
            continue;
        }
        let s = filmed(&planner, &placed, (1..1 + calibrations, frames))?;
        let root = |sum: f64, n: f64| (sum / n.max(1.0)).sqrt();
        let (mm, wanted_mm) = (1e3 * root(s.position_m2, s.poses), 1e3 * root(s.predicted_m2, s.poses));
        let (deg, wanted_deg) =
            (root(s.turn_rad2, s.poses).to_degrees(), root(s.predicted_rad2, s.poses).to_degrees());
        println!(
            "{name:<12} {:>5.0} | {mm:.4} {wanted_mm:.4} {:.3} | {deg:.5} {wanted_deg:.5} {:.3} | {:.4} {:.4} | {:.4}",
            s.poses,
            wanted_mm / mm,
            wanted_deg / deg,
            root(s.centres_px2, s.coordinates),
            root(s.claimed_px2, s.coordinates),
            s.control_px / calibrations as f64
        );
    }
    Ok(())
}
