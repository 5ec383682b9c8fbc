//! Is the predicted error of a pose the one that is achieved? Films of the virtual room, calibrated from
//! stills.
//!
//! `cargo run --release -p mavsight --example plan_filmed -- 40 5`: calibrations a rig, and frames after
//! each; `-- 40 5 130 1001` films one rig alone, from the 1001st set-up on. For each set-up the cameras move
//! by some tenths of a metre, so that backgrounds, and with them systematic errors, differ. Balls are out of
//! round by what the stated covariances allow for ([`MODEL_STD`]). The prediction knows the rig, the markers
//! and stated precisions of centres; truth only chooses ways on which the aircraft hides no ball.

use mavsight::flight::Vehicle;
use mavsight::geometry::{ControlPoint, EulerAngles, Isometry3, Point3, Vector3};
use mavsight::lab;
use mavsight::pipeline::{
    CameraFeed, CentreQuality, ControlPointRow, ControlStill, NoProgress, PipelineError, TimedFrame,
    body_markers, calibrate_from_stills, track,
};
use mavsight::plan::{CameraPair, CentreStd, EXAMPLE, Placed, Planner, Room as RoomFile};
use mavsight::pose::{
    CameraControl, MarkerObservation, PoseEstimator, PredictedObservation, Rig, predict_calibration,
};
use mavsight::random::Random;
use mavsight::scene::{Aircraft, Film, Occluders, Room, Sensor};
use mavsight::score::VirtualCamera;
use mavsight::session::ns_from_s;
use mavsight::simulator::FlightState;
use mavsight::vision::{BallColor, Detector, Frame, MODEL_STD};

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

const INTERVAL_S: f64 = 1.0 / 30.0;
/// Of the cameras from the middle: within the walls for every angle.
const DISTANCE_M: f64 = 5.3;

/// Middle of the control frame, and its size over the paper's: the near corners are still in view.
const MIDDLE_M: Vector3<f64> = Vector3::new(0.0, 0.0, 1.5);
const FRAME: f64 = 0.75;
/// How far from its place a camera is put, so that something else is behind each ball every time.
const SET_UP_STD_M: f64 = 0.2;
/// Ways that are tried for one on which all balls are seen.
const TRIES: usize = 1000;
/// Part of a ball's face that must be seen: an arm before it hides less than the rest.
const SEEN: f64 = 0.8;

/// Results of one set-up's films: poses that were filmed, errors against truth, and stated errors.
#[derive(Default)]
struct SetUp {
    placed: Vec<Placed>,
    poses: Vec<Isometry3<f64>>,
    /// Sums of the squares of the errors of position and of turn.
    achieved: [f64; 2],
    /// Sums of the variances that are predicted of these by each centre's claim.
    predicted: [f64; 2],
    /// How good the markers' centres claim to be.
    centres: Option<CentreQuality>,
    /// Variance of a coordinate of control points that determine as much and are all alike, mean over the
    /// cameras.
    control_px2: f64,
    /// Squares of the errors of the markers' centres, and the number of coordinates.
    centres_px2: f64,
    coordinates: f64,
}

/// A way through the volume at a walking pace, with a heading of the plan, give or take, and a few degrees
/// of bank and pitch, on which all cameras see all balls.
fn way(
    planner: &Planner,
    films: &[Film<'_>],
    aircraft: &Aircraft,
    count: usize,
    random: &mut Random,
) -> Option<Vec<FlightState>> {
    let is_seen = |pose: &Isometry3<f64>| {
        let shows = |film: &Film<'_>| {
            let share = |m: &mavsight::pose::BodyMarker| {
                film.visible_share(&m.marker_in_body_m, m.radius_m, aircraft, pose, &Occluders::default())
            };
            planner.markers().iter().all(|m| share(m) > SEEN)
        };
        films.iter().all(shows)
    };
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
            FlightState {
                t_s: k as f64 * INTERVAL_S,
                position_in_world_m: place,
                attitude,
                ..FlightState::default()
            }
        };
        let way: Vec<_> = (0..count).map(at).collect();
        way.iter().all(|state| is_seen(&state.pose())).then_some(way)
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
    seeds: std::ops::Range<u64>,
    count: usize,
) -> Outcome<Vec<SetUp>> {
    let room = Room::meeting_room();
    let aircraft = lab::aircraft(&Vehicle::paper());
    let mut all = Vec::new();
    for seed in seeds {
        let random = &mut Random::new(seed, 7);
        let off = |random: &mut Random| Vector3::from_fn(|_, _| random.normal()) * SET_UP_STD_M;
        let placed: Vec<Placed> = placed
            .iter()
            .map(|p| Placed { centre_m: p.centre_m + off(random), aim_m: p.aim_m + off(random), ..*p })
            .collect();
        if let Err(refused) = planner.rig(&placed) {
            println!("set up {seed}: {refused}");
            continue;
        }
        let cameras = cameras_of(planner, &placed);
        let films: Vec<Film<'_>> =
            cameras.iter().enumerate().map(|(k, c)| lab::film(&room, c, k, seed)).collect();
        let Some(way) = way(planner, &films, &aircraft, count, random) else {
            println!("set up {seed}: no way on which all cameras see all balls");
            continue;
        };
        match film_once(planner, &cameras, &films, &way, random) {
            Ok(one) => all.push(SetUp { placed, ..one }),
            Err(error) => println!("set up {seed}: {error}"),
        }
    }
    Ok(all)
}

fn film_once(
    planner: &Planner,
    cameras: &[VirtualCamera],
    films: &[Film<'_>],
    truth: &[FlightState],
    random: &mut Random,
) -> Outcome<SetUp> {
    let vehicle = Vehicle::paper();
    let (mut stills, mut aircraft) = (Vec::new(), Vec::new());
    for (c, film) in cameras.iter().zip(films) {
        let mut off = |diameter_m: f64| Vector3::from_fn(|_, _| random.normal()) * (MODEL_STD * diameter_m);
        let balls: Vec<Vector3<f64>> = planner.control().iter().map(|p| off(p.diameter_m)).collect();
        let control = lab::control_frame(planner.control()).with_balls_off(&balls);
        let mut as_seen = vehicle.clone();
        for marker in &mut as_seen.marker {
            marker.position_m = (Vector3::from(marker.position_m) + off(marker.diameter_m)).into();
        }
        aircraft.push(lab::aircraft(&as_seen));
        let frame = Frame::from_rgb(c.camera.size, film.still(Some(&control)))?;
        stills.push(ControlStill { camera: c.name.clone(), frame });
    }
    let rig = calibrate_from_stills(&stills, planner.control(), &[])?;
    let feeds = cameras.iter().zip(films).zip(&aircraft).map(|((c, film), aircraft)| {
        let frames = truth.iter().enumerate().map(move |(k, row)| {
            let frame = Frame::from_rgb(c.camera.size, frame_of(film, k, aircraft, row))
                .map_err(|e| PipelineError::Source { camera: c.name.clone(), source: Box::new(e) })?;
            Ok(TimedFrame { t_ns: ns_from_s(row.t_s), frame })
        });
        CameraFeed::new(c.name.clone(), Some(truth.len()), Box::new(frames))
    });
    let tracked = track(feeds.collect(), &rig, &vehicle, &NoProgress)?;
    let predicted = PoseEstimator::new(&predicted_rig(planner, cameras, &stills, &rig)?, planner.markers());
    let control_px2 = rig.cameras.iter().map(|c| c.sigma_px.powi(2)).sum::<f64>() / rig.cameras.len() as f64;
    let mut out = SetUp { control_px2, centres: tracked.centre_quality(), ..SetUp::default() };
    for (k, row) in truth.iter().enumerate() {
        let pose = row.pose();
        let t_ns = ns_from_s(row.t_s);
        let seen: Vec<_> = tracked.observations.iter().filter(|o| o.t_ns == t_ns).collect();
        let Ok(got) = &tracked.poses[k].estimate else { continue };
        // What the plan is about: every marker seen by all, none taken for false.
        if seen.len() < cameras.len() * vehicle.marker.len() || !got.left_out.is_empty() {
            continue;
        }
        let off_m = got.world_from_body.translation.vector - pose.translation.vector;
        out.achieved[0] += off_m.norm_squared();
        out.achieved[1] += pose.rotation.angle_to(&got.world_from_body.rotation).powi(2);
        let [position_m2, turn_rad2] = variances(&predicted, &pose, &seen)?;
        out.predicted = [out.predicted[0] + position_m2, out.predicted[1] + turn_rad2];
        out.poses.push(pose);
        for o in seen {
            let ball = &planner.markers()[o.marker];
            let centre = (pose * Point3::from(ball.marker_in_body_m)).coords;
            let exact = cameras[o.camera].camera.project_ball(&centre, ball.radius_m)?.pixel;
            out.centres_px2 += (o.pixel - exact).norm_squared();
            out.coordinates += 2.0;
        }
    }
    Ok(out)
}

/// What is predicted of position and turn from centres as good as they claim.
fn variances(
    estimator: &PoseEstimator,
    pose: &Isometry3<f64>,
    seen: &[MarkerObservation],
) -> Outcome<[f64; 2]> {
    let views: Vec<PredictedObservation> = seen
        .iter()
        .map(|o| PredictedObservation {
            camera: o.camera,
            marker: o.marker,
            covariance_px2: o.covariance_px2,
        })
        .collect();
    let covariance = estimator.predict(pose, &views)?.covariance();
    Ok([0, 3].map(|at| covariance.fixed_view::<3, 3>(at, at).trace()))
}

/// The cameras as they are, with what their calibration is predicted to leave open if each control point's
/// centre is as good as it claims, times the factor that the residuals have shown.
fn predicted_rig(
    planner: &Planner,
    cameras: &[VirtualCamera],
    stills: &[ControlStill],
    rig: &Rig,
) -> Outcome<Rig> {
    let table = planner.control();
    let ball = |row: &ControlPointRow| BallColor { name: row.name.clone(), rgb: row.color.rgb() };
    let colors: Vec<BallColor> = table.iter().map(ball).collect();
    let mut controls = Vec::new();
    for ((c, still), seen_by) in cameras.iter().zip(stills).zip(&rig.cameras) {
        let mut detector = Detector::new(&colors)?.with_camera(seen_by.camera);
        let found = detector.detect(&still.frame, 3.0..=f64::from(c.camera.size.width_px) / 10.0);
        let mut control = CameraControl::exact(c.name.clone(), c.camera.size, vec![], vec![]);
        for (row, found) in table.iter().zip(found) {
            let Some(point) = seen_by.points.iter().find(|p| p.used && p.name == row.name) else { continue };
            let (place, radius_m) = (Vector3::from(row.position_m), row.diameter_m / 2.0);
            let pixel = seen_by.camera.project_ball(&place, radius_m)?.pixel + point.residual_px;
            let off_px = |at: &mavsight::geometry::Vector2<f64>| (at - pixel).norm();
            let same = found.iter().min_by(|a, b| off_px(&a.pixel).total_cmp(&off_px(&b.pixel)));
            let Some(pixel_cov_px2) = same.map(|b| b.covariance_px2) else { continue };
            let name = row.name.clone();
            control.points.push(ControlPoint { name, point_in_world_m: place, pixel, pixel_cov_px2 });
            control.ball_radius_m.push(radius_m);
            control.survey_std_m.push(row.std_m);
        }
        controls.push(control);
    }
    let model = planner.room().camera[0].model();
    let given: Vec<_> = cameras.iter().map(|c| (c.camera, model)).collect();
    let mut out = predict_calibration(&given, &controls)?;
    let squares = |rig: &Rig| rig.cameras.iter().map(|c| c.sigma_px.powi(2)).sum::<f64>();
    out.uncertainty *= (squares(rig) / squares(&out)).sqrt();
    Ok(out)
}

/// What a session knows of its centres: of markers and in stills.
#[derive(Clone)]
struct Known {
    centres: CentreStd,
    control_std_px: f64,
}

fn planner(known: Option<Known>) -> Outcome<Planner> {
    let mut room: RoomFile = toml::from_str(EXAMPLE[0].1)?;
    room.block.clear();
    if let Some(known) = known {
        room.camera[0].centre_std_px = Some(known.centres);
        // The systematic error of a centre is in the stated one.
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
        let placed = p.pair(0, CameraPair { angle_deg: angle, distance_m: DISTANCE_M }).to_vec();
        out.push((format!("{angle:.0} degrees"), p, placed));
    }
    let three = planner(None)?;
    let mut placed = three.pair(0, CameraPair { angle_deg: 90.0, distance_m: DISTANCE_M }).to_vec();
    // By the wall to the left, high, as far away as the others: from there, too, a calibration has the
    // whole control frame.
    placed.push(Placed { centre_m: Vector3::new(-4.6, 1.6, 2.2), ..placed[0] });
    out.push(("three".to_owned(), three, placed));
    Ok(out)
}

/// For each set-up, the sums of the predicted variances of position and turn over its poses.
fn predicted(set_ups: &[SetUp], known: &Known) -> Outcome<Vec<[f64; 2]>> {
    let p = planner(Some(known.clone()))?;
    let of_pose = |placed: &[Placed], pose: &Isometry3<f64>| {
        let one = p.predict(placed, &[*pose]).mean;
        [(1e-3 * one.position_std_mm).powi(2), one.attitude_std_deg.to_radians().powi(2)]
    };
    let of_set_up = |s: &SetUp| {
        s.poses.iter().map(|pose| of_pose(&s.placed, pose)).fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]])
    };
    Ok(set_ups.iter().map(of_set_up).collect())
}

/// What films show of their centres, without truth: what runs of such sessions say for plans.
fn known(set_ups: &[SetUp]) -> Known {
    let centres = set_ups.iter().filter_map(|s| s.centres).flat_map(|c| c.tenths_px);
    let poses = |s: &SetUp| s.poses.len() as f64;
    let control_px2 = set_ups.iter().map(|s| poses(s) * s.control_px2).sum::<f64>();
    Known {
        centres: CentreStd::Drawn(centres.collect()),
        control_std_px: (control_px2 / set_ups.iter().map(poses).sum::<f64>()).sqrt(),
    }
}

/// Predicted over achieved standard deviation of position (0) or turn (1), and how well it is known: the
/// jackknife over set-ups (Efron & Tibshirani 1993, chapter 11).
fn ratio(set_ups: &[SetUp], variances: &[[f64; 2]], of: usize) -> (f64, f64) {
    let without = |left_out: Option<usize>| {
        let kept = || set_ups.iter().zip(variances).enumerate().filter(|(k, _)| Some(*k) != left_out);
        let predicted: f64 = kept().map(|(_, (_, v))| v[of]).sum();
        (predicted / kept().map(|(_, (s, _))| s.achieved[of]).sum::<f64>()).sqrt()
    };
    let all = without(None);
    let n = set_ups.len() as f64;
    let square: f64 = (0..set_ups.len()).map(|k| (without(Some(k)) - all).powi(2)).sum();
    (all, (square * (n - 1.0) / n).sqrt())
}

/// One frame with nothing in the way; the shutter is open around the row's time.
fn frame_of(film: &Film<'_>, index: usize, aircraft: &Aircraft, row: &FlightState) -> Vec<u8> {
    let open_s = Sensor::default().exposure_fraction * INTERVAL_S;
    film.frame(index as u64, aircraft, |share| lab::pose_near(row, share * open_s))
}

fn main() -> Outcome<()> {
    let mut words = std::env::args().skip(1);
    let calibrations: u64 = words.next().map_or(Ok(40), |w| w.parse())?;
    let frames: usize = words.next().map_or(Ok(5), |w| w.parse())?;
    let only: Option<String> = words.next();
    let first_seed: u64 = words.next().map_or(Ok(1), |w| w.parse())?;
    println!(
        "rig      set-ups poses | position mm, predicted over achieved: by each centre's claim, as planned, with that of 90 degrees | the same of attitude, deg | typical claim of centres px, stills px | achieved"
    );
    let mut first = None;
    for (name, planner, placed) in rigs()? {
        if only.as_ref().is_some_and(|o| !name.contains(o.as_str())) {
            continue;
        }
        let mut all = filmed(&planner, &placed, first_seed..first_seed + calibrations, frames)?;
        all.retain(|s| !s.poses.is_empty());
        if all.is_empty() {
            println!("{name}: nothing was measured");
            continue;
        }
        let own = known(&all);
        let with_own = predicted(&all, &own)?;
        let with_first = predicted(&all, first.get_or_insert_with(|| own.clone()))?;
        let sum = |of: &dyn Fn(&SetUp) -> f64| all.iter().map(of).sum::<f64>();
        let poses = sum(&|s| s.poses.len() as f64);
        let root = |k: usize| (sum(&|s| s.achieved[k]) / poses).sqrt();
        let cell = |k: usize| {
            let each: Vec<[f64; 2]> = all.iter().map(|s| s.predicted).collect();
            let [each, own, first] = [&each, &with_own, &with_first].map(|v| ratio(&all, v, k));
            format!("{:.2} ± {:.2}, {:.2} ± {:.2}, {:.2}", each.0, each.1, own.0, own.1, first.0)
        };
        println!(
            "{name:<12} {:>4} {poses:>4} | {:.4} {} | {:.5} {} | {:.4} {:.4} | achieved {:.4}",
            all.len(),
            1e3 * root(0),
            cell(0),
            root(1).to_degrees(),
            cell(1),
            own.centres.typical_px(),
            own.control_std_px,
            (sum(&|s| s.centres_px2) / sum(&|s| s.coordinates)).sqrt(),
        );
    }
    Ok(())
}
