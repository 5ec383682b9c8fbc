//! Is the predicted error of a pose the one that is achieved? Rigs filmed in the virtual room: stills of the control frame
//! calibrate them, then the aircraft on a short way somewhere in the volume is detected and measured.
//!
//! `cargo run --release -p mavsight --example plan_filmed -- 40 5`: calibrations a rig, and frames after each. Each time the cameras
//! are set up anew, some centimetres off: what is wrong with a ball's centre comes from what is behind it, and would be the
//! same each time.
//!
//! Given to the prediction are the places of cameras, control points and markers, and how good centres are by what the chain claims of
//! them, as a user has it from a session: in the same films, and in those of the rig at 90°. How good they are depends on what is
//! behind them, which a plan does not know. Truth is not in it.

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

/// The middle of the control frame, and its size over that of the paper's: the near corners are still in view.
const MIDDLE_M: Vector3<f64> = Vector3::new(0.0, 0.0, 1.5);
const FRAME: f64 = 0.75;
/// How well a camera is put where it was planned.
const SET_UP_STD_M: f64 = 0.05;
/// Ways that are tried for one on which all balls are seen.
const TRIES: usize = 1000;

/// Squares of errors of position and turn, squares of centres, and their numbers; and the poses.
#[derive(Default, Clone)]
struct Sums {
    position_m2: f64,
    turn_rad2: f64,
    poses: f64,
    centres_px2: f64,
    coordinates: f64,
    control_px2: f64,
    calibrations: f64,
    claims: Vec<Claim>,
}

/// A pose that was filmed, and the variance that the chain claims of its turn.
#[derive(Clone)]
struct Claim {
    placed: Vec<Placed>,
    pose: Isometry3<f64>,
    turn_rad2: f64,
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

/// A way through the volume at a walking pace, with a heading of the plan, give or take, and a few degrees of bank and pitch, on
/// which all balls are seen.
fn poses(
    (planner, placed): (&Planner, &[Placed]),
    count: usize,
    random: &mut Random,
) -> Option<Vec<(TruthRow, Isometry3<f64>)>> {
    let volume = &planner.room().volume;
    (0..TRIES).find_map(|_| {
        let mut vector = |low: f64, high: f64| Vector3::from_fn(|_, _| random.between(low, high));
        let (share, velocity_m_s, turn) = (vector(0.0, 1.0), vector(-1.0, 1.0), vector(-0.1, 0.1));
        let heading =
            random.between(0.0, volume.headings_deg.len() as f64) as usize % volume.headings_deg.len();
        let attitude = EulerAngles {
            phi_rad: turn.x,
            theta_rad: turn.y,
            psi_rad: turn.z - volume.headings_deg[heading].to_radians(),
        };
        let at = |k: usize| {
            let corner = |i: usize| volume.low_m[i] + share[i] * (volume.high_m[i] - volume.low_m[i]);
            let place = Vector3::from_fn(|i, _| corner(i)) + velocity_m_s * (k as f64 * INTERVAL_S);
            (row(k, place, attitude), world_from_body(place, attitude))
        };
        let way: Vec<_> = (0..count).map(at).collect();
        way.iter().all(|(_, pose)| planner.predict(placed, &[*pose]).is_feasible()).then_some(way)
    })
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

/// Films of a rig, set up and calibrated again and again.
fn filmed(
    planner: &Planner,
    placed: &[Placed],
    (seeds, count): (std::ops::Range<u64>, usize),
) -> Outcome<Sums> {
    let room = Room::meeting_room();
    let mut sums = Sums::default();
    for seed in seeds {
        let random = &mut Random::new(seed, 7);
        let off = |random: &mut Random| Vector3::from_fn(|_, _| random.normal()) * SET_UP_STD_M;
        let set_up: Vec<Placed> = placed
            .iter()
            .map(|p| Placed { centre_m: p.centre_m + off(random), aim_m: p.aim_m + off(random), ..*p })
            .collect();
        let cameras = cameras_of(planner, &set_up);
        let films: Vec<Film<'_>> =
            cameras.iter().enumerate().map(|(k, c)| lab::film(&room, c, k, seed)).collect();
        let Some(way) = poses((planner, &set_up), count, random) else {
            println!("set up {seed}: no way on which all balls are seen");
            continue;
        };
        match film_once(planner, (&set_up, &cameras, &films), &way, &mut sums) {
            Ok(()) => sums.calibrations += 1.0,
            Err(error) => println!("set up {seed}: {error}"),
        }
    }
    Ok(sums)
}

fn film_once(
    planner: &Planner,
    (placed, cameras, films): (&[Placed], &[VirtualCamera], &[Film<'_>]),
    truth: &[(TruthRow, Isometry3<f64>)],
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
    sums.control_px2 +=
        rig.cameras.iter().map(|c| c.sigma_px.powi(2)).sum::<f64>() / rig.cameras.len() as f64;
    let feeds = cameras.iter().zip(films).map(|(c, film)| {
        let frames = truth.iter().enumerate().map(|(k, (row, _))| {
            let frame = Frame::from_rgb(c.camera.size, lab::frame(film, k, &aircraft, row, INTERVAL_S))
                .map_err(|e| PipelineError::Source { camera: c.name.clone(), source: Box::new(e) })?;
            Ok(TimedFrame { t_ns: ns_from_s(row.t_s), frame })
        });
        CameraFeed::new(c.name.clone(), Some(truth.len()), Box::new(frames))
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
        sums.position_m2 += (got.world_from_body.translation.vector - pose.translation.vector).norm_squared();
        sums.turn_rad2 += pose.rotation.angle_to(&got.world_from_body.rotation).powi(2);
        sums.poses += 1.0;
        let turn_rad2 = got.covariance().fixed_view::<3, 3>(3, 3).trace();
        sums.claims.push(Claim { placed: placed.to_vec(), pose: *pose, turn_rad2 });
        for o in seen {
            let ball = &planner.markers()[o.marker];
            let centre = (pose * Point3::from(ball.marker_in_body_m)).coords;
            let exact = cameras[o.camera].camera.project_ball(&centre, ball.radius_m)?.pixel;
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

fn planner(known: Option<Known>) -> Outcome<Planner> {
    let mut room: RoomFile = toml::from_str(EXAMPLE[0].1)?;
    room.block.clear();
    if let Some(known) = known {
        room.camera[0].centre_std_px = Some(known.centre_std_px);
        // What stays wrong with a centre is in the claims.
        room.centre_bias_px = 0.0;
        if let Some(control) = &mut room.control {
            control.std_px = Some(known.control_std_px);
        }
    }
    let mut control = lab::control_points();
    for point in &mut control {
        let from_middle = Vector3::from(point.position_m) - MIDDLE_M;
        point.position_m = (MIDDLE_M + from_middle * FRAME).into();
    }
    Ok(Planner::new(room, body_markers(&Vehicle::paper()), control)?)
}

/// Rigs of two cameras at angles, that of 90° first, and of three.
fn rigs() -> Outcome<Vec<(String, Planner, Vec<Placed>)>> {
    let mut out: Vec<(String, Planner, Vec<Placed>)> = Vec::new();
    for angle in [90.0, 50.0, 70.0, 110.0, 130.0] {
        let p = planner(None)?;
        let placed = p.pair(0, angle, DISTANCE_M).to_vec();
        out.push((format!("{angle:.0} degrees"), p, placed));
    }
    let three = planner(None)?;
    let mut placed = three.pair(0, 90.0, DISTANCE_M).to_vec();
    placed.push(Placed { centre_m: Vector3::new(1.5, 1.9, 2.9), ..placed[0] });
    out.push(("three".to_owned(), three, placed));
    Ok(out)
}

/// Sums of the predicted variances of position and turn over the poses of films.
fn predicted(claims: &[Claim], known: Known) -> Outcome<[f64; 2]> {
    let p = planner(Some(known))?;
    Ok(claims.iter().fold([0.0; 2], |[position_m2, turn_rad2], claim| {
        let one = p.predict(&claim.placed, &[claim.pose]).mean;
        [
            position_m2 + (1e-3 * one.position_std_mm).powi(2),
            turn_rad2 + one.attitude_std_deg.to_radians().powi(2),
        ]
    }))
}

/// What films tell of their centres, without truth. In stills it is what calibration claims. Of markers it is the noise of equal centres
/// with which a plan of these poses comes to what is claimed of their attitude: centres differ by a factor of ten and more, so
/// that neither the mean of their variances nor that of their weights would do.
fn known(sums: &Sums) -> Outcome<Known> {
    const UNIT_PX: f64 = 0.1;
    const NEARLY_NONE_PX: f64 = 1e-6;
    let control_std_px = (sums.control_px2 / sums.calibrations).sqrt();
    let claimed: f64 = sums.claims.iter().map(|c| c.turn_rad2).sum();
    let of_stills = predicted(&sums.claims, Known { centre_std_px: NEARLY_NONE_PX, control_std_px })?[1];
    let of_unit =
        predicted(&sums.claims, Known { centre_std_px: UNIT_PX, control_std_px: NEARLY_NONE_PX })?[1];
    // Predicted variances are linear in those of the centres.
    let share = (claimed - of_stills) / of_unit;
    if share.is_nan() || share <= 0.0 {
        return Err("the stills alone are claimed to turn poses by more: take more films".into());
    }
    Ok(Known { centre_std_px: UNIT_PX * share.sqrt(), control_std_px })
}

fn main() -> Outcome<()> {
    let mut words = std::env::args().skip(1);
    let calibrations: u64 = words.next().map_or(Ok(40), |w| w.parse())?;
    let frames: usize = words.next().map_or(Ok(5), |w| w.parse())?;
    let only: Option<String> = words.next();
    println!(
        "rig          poses | position mm, over achieved: with its own noise, with that at 90 degrees | the same of attitude, deg | own noise of centres, stills px"
    );
    let mut first = None;
    for (name, planner, placed) in rigs()? {
        if only.as_ref().is_some_and(|o| !name.contains(o.as_str())) {
            continue;
        }
        let s = filmed(&planner, &placed, (1..1 + calibrations, frames))?;
        let own = known(&s)?;
        let (with_own, with_first) =
            (predicted(&s.claims, own)?, predicted(&s.claims, *first.get_or_insert(own))?);
        let ratios = |k: usize, achieved: f64| [with_own[k], with_first[k]].map(|v| (v / achieved).sqrt());
        let ([a, b], [c, d]) = (ratios(0, s.position_m2), ratios(1, s.turn_rad2));
        let root = |sum: f64, n: f64| (sum / n.max(f64::MIN_POSITIVE)).sqrt();
        println!(
            "{name:<12} {:>5.0} | {:.4} {a:.3} {b:.3} | {:.5} {c:.3} {d:.3} | {:.4} {:.4} | achieved {:.4}",
            s.poses,
            1e3 * root(s.position_m2, s.poses),
            root(s.turn_rad2, s.poses).to_degrees(),
            own.centre_std_px,
            own.control_std_px,
            root(s.centres_px2, s.coordinates),
        );
    }
    Ok(())
}
