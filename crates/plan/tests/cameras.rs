//! Placements against closed forms, and what is refused.

use mavsight_flight::Vehicle;
use mavsight_geometry::Vector3;
use mavsight_pipeline::{ControlPointRow, body_markers};
use mavsight_plan::{CameraPair, CentreStd, Placed, PlanError, Planner, Room, SearchOptions, Solid};
use mavsight_pose::BodyMarker;

/// A change of the room.
type Spoil = fn(&mut Room);

const ROOM: &str = r#"
schema = 1
name = "meeting room"
[room]
low_m = [-5.0, -5.0, 0.0]
high_m = [5.0, 2.0, 3.2]
[volume]
low_m = [-0.8, -0.8, 0.9]
high_m = [0.8, 0.8, 2.1]
[[camera]]
name = "camcorder"
count = 2
width_px = 640
height_px = 480
horizontal_fov_deg = 53.0
centre_std_px = 0.1
least_diameter_px = 3.0
"#;

fn room() -> Room {
    toml::from_str(ROOM).expect("a room")
}

/// Balls whose middle is the body's origin: position and attitude are then independent.
fn balanced() -> Vec<BodyMarker> {
    [[0.2, 0.2, 0.1], [0.2, -0.2, -0.1], [-0.2, -0.2, 0.1], [-0.2, 0.2, -0.1]]
        .iter()
        .enumerate()
        .map(|(k, at)| BodyMarker {
            name: format!("m{k}"),
            marker_in_body_m: Vector3::from(*at),
            radius_m: 0.025,
        })
        .collect()
}

fn cube() -> Vec<ControlPointRow> {
    let side = |k: u32, bit: u32| if (k >> bit) & 1 == 1 { 1.5 } else { -1.5 };
    (0..8)
        .map(|k| ControlPointRow {
            name: format!("p{k}"),
            position_m: [side(k, 0), side(k, 1), 1.5 + side(k, 2)],
            diameter_m: 0.06,
            color: mavsight_flight::Color::new(200, 30, 30),
            std_m: 0.0,
        })
        .collect()
}

fn planner(change: impl FnOnce(&mut Room)) -> Planner {
    let mut room = room();
    change(&mut room);
    Planner::new(room, balanced(), cube()).expect("a planner")
}

fn with_control(room: &mut Room) {
    room.control =
        Some(mavsight_plan::ControlSection { points: "control_points.csv".into(), std_px: Some(0.1) });
}

/// Two cameras at an angle a and a distance D determine a point to s²(2/sin² a + 1/2), s = σ D/f: the
/// variances along the bisector, across it and upwards are s²/(2 sin² a/2), s²/(2 cos² a/2) and s²/2. Four
/// balls have a quarter of that.
#[test]
fn position_is_that_of_classical_triangulation() {
    let planner = planner(|_| ());
    let focal_px = 320.0 / 26.5_f64.to_radians().tan();
    let middle: Vec<_> = planner.room().poses_at(&planner.room().middle_m()).collect();
    for angle_deg in [50.0, 70.0, 90.0, 110.0, 130.0] {
        for distance_m in [5.0, 7.0] {
            let got = planner.predict(&planner.pair(0, CameraPair { angle_deg, distance_m }), &middle);
            let s_mm = 1e3 * 0.1 * distance_m / focal_px;
            let sine = angle_deg.to_radians().sin();
            let wanted = (s_mm * s_mm * (2.0 / (sine * sine) + 0.5) / 4.0).sqrt();
            let ratio = got.mean.position_std_mm / wanted;
            assert!((ratio - 1.0).abs() < 0.01, "{angle_deg}° at {distance_m} m: {ratio}");
            assert!(got.is_feasible() && got.mean.new_position_std_mm == got.mean.position_std_mm);
        }
    }
}

/// The paper's study (Amat et al.): least error at a right angle, and more the farther away.
#[test]
fn the_least_error_over_the_volume_is_at_a_right_angle() {
    let pair = |k: i32| CameraPair { angle_deg: 50.0 + 2.0 * f64::from(k), distance_m: 6.36 };
    let pairs: Vec<CameraPair> = (0..=40).map(pair).collect();
    for control in [false, true] {
        let planner = Planner::new(
            {
                let mut room = room();
                if control {
                    with_control(&mut room);
                }
                room
            },
            body_markers(&Vehicle::paper()),
            cube(),
        )
        .expect("a planner");
        let rows = planner.study(0, &pairs);
        let best = rows
            .iter()
            .min_by(|a, b| a.prediction.mean.position_std_mm.total_cmp(&b.prediction.mean.position_std_mm));
        let best = best.expect("rows").pair.angle_deg;
        assert!((best - 90.0).abs() <= 5.0, "control {control}: {best}°");
    }
    let rows = planner(|_| ())
        .study(0, &[5.0, 6.0, 7.0].map(|distance_m| CameraPair { angle_deg: 90.0, distance_m }));
    assert!(rows.windows(2).all(|w| w[0].prediction.figure < w[1].prediction.figure));
}

#[test]
fn systematic_errors_of_calibration_markers_and_centres_do_not_average_out() {
    let place = |p: &Planner| {
        p.predict(&p.pair(0, CameraPair { angle_deg: 90.0, distance_m: 6.36 }), &p.room().poses(2))
    };
    let exact = place(&planner(|_| ()));
    let mut before = exact.mean.position_std_mm;
    let with: [Spoil; 3] = [with_control, |r| r.markers_std_m = 2e-3, |r| r.centre_bias_px = 0.2];
    for change in with {
        let got = place(&planner(change)).mean;
        assert!((got.new_position_std_mm / exact.mean.position_std_mm - 1.0).abs() < 1e-9);
        assert!(got.position_std_mm > 1.05 * exact.mean.position_std_mm, "{got:?}");
        before = before.max(got.position_std_mm);
    }
    let all = place(&planner(|r| with.iter().for_each(|change| change(r))));
    assert!(all.mean.position_std_mm > before);
}

/// Cameras on a line at a distance d from the volume are d/cos h away for a half angle h, so that the error
/// grows as (2/sin² 2h + 1/2)/cos² h, which is least at 2h = 69°. A pillar and a keep-out box are respected.
#[test]
fn the_search_finds_the_best_angle_along_a_wall_and_keeps_to_the_rules() {
    let pillar = Solid { name: None, low_m: [2.4, -2.8, 0.0], high_m: [2.8, -2.4, 3.2] };
    let planner = planner(|r| {
        let strip = |low_m, high_m| Solid { name: None, low_m, high_m };
        r.stand = vec![strip([-4.9, -4.9, 1.5], [4.9, -4.9, 1.5])];
        r.keep_out = vec![strip([-4.9, -4.9, 0.0], [-4.7, -4.5, 3.2])];
        r.block = vec![pillar.clone()];
    });
    let best = planner.search(&SearchOptions { step_m: 0.5, ..Default::default() }).expect("placements");
    let middle = planner.room().middle_m();
    for ranked in &best {
        assert!(ranked.placed.iter().all(|p| planner.room().allows(&p.centre_m)));
        assert!(ranked.placed.iter().all(|p| !pillar.blocks(&p.centre_m, &middle)));
        assert!(ranked.prediction.is_feasible());
    }
    let [a, b] = [0, 1].map(|k| (best[0].placed[k].centre_m - middle).normalize());
    let angle = a.dot(&b).acos().to_degrees();
    let error = |degrees: f64| {
        let half = degrees.to_radians() / 2.0;
        (2.0 / (2.0 * half).sin().powi(2) + 0.5) / half.cos().powi(2)
    };
    let wanted = (300..1500).map(|k| 0.1 * f64::from(k)).min_by(|a, b| error(*a).total_cmp(&error(*b)));
    assert!((angle - wanted.expect("an angle")).abs() < 3.0, "{angle}° against {wanted:?}");
    let costs: Vec<f64> = best.iter().map(|r| r.prediction.figure).collect();
    assert!(costs.is_sorted(), "{costs:?}");
}

#[test]
fn a_third_camera_helps_and_the_search_is_the_same_every_time() {
    let cost = |count: usize| {
        let planner = planner(|r| {
            r.camera[0].count = count;
            r.stand = vec![Solid { name: None, low_m: [-4.9, -4.9, 1.0], high_m: [4.9, 1.9, 2.0] }];
        });
        let best = planner.search(&SearchOptions { step_m: 2.0, best: 1, ..Default::default() });
        best.expect("a placement")[0].clone()
    };
    let (two, three) = (cost(2), cost(3));
    assert!(three.prediction.figure < 0.9 * two.prediction.figure);
    assert_eq!(cost(2), two);
}

#[test]
fn limits_that_nothing_meets_are_named() {
    let options = SearchOptions { step_m: 1.5, ..Default::default() };
    let refuse = |change: fn(&mut Room)| planner(change).search(&options).expect_err("refused");
    let small = refuse(|r| r.camera[0].least_diameter_px = 40.0);
    assert!(matches!(small, PlanError::NothingSeen { .. }) && small.to_string().contains("small"), "{small}");
    let blurred = refuse(|r| r.camera[0].focus_m = Some([0.1, 0.5]));
    assert!(blurred.to_string().contains("focus"), "{blurred}");
    let barred = refuse(|r| r.keep_out = vec![r.room.clone()]);
    assert!(matches!(barred, PlanError::NoPlace { .. }), "{barred}");
    let walled = refuse(|r| {
        let (low_m, high_m) = ([-0.9, -0.9, 0.0], [0.9, 0.9, 3.2]);
        r.block = vec![Solid { name: None, low_m, high_m }];
    });
    assert!(walled.to_string().contains("obstacle"), "{walled}");
    let step = planner(|_| ()).search(&SearchOptions { step_m: f64::NAN, ..options });
    assert!(matches!(step, Err(PlanError::Value { .. })));
}

/// Weighted least squares does no better than with the mean of the weights, and no worse than unweighted with
/// the mean of the variances. What calibration leaves open weighs the same with all alike; with noises that
/// differ, errors of the cameras no longer cancel in the turn.
#[test]
fn centres_that_differ_are_worth_what_their_weights_allow() {
    let all_px = [0.02, 0.05, 0.1, 0.2, 0.5];
    let with = |std: CentreStd| {
        let planner = planner(|room| {
            with_control(room);
            room.camera[0].centre_std_px = Some(std);
            // One for the control points in both.
            room.control.as_mut().expect("control points").std_px = Some(0.1);
        });
        let got = planner.predict(
            &planner.pair(0, CameraPair { angle_deg: 90.0, distance_m: 6.36 }),
            &planner.room().poses(5),
        );
        [got.mean.new_position_std_mm, got.mean.attitude_std_deg, got.mean.new_attitude_std_deg]
    };
    let (alike, differ) = (with(CentreStd::Alike(0.1)), with(CentreStd::Drawn(all_px.to_vec())));
    let mean = |power: i32| all_px.iter().map(|v| (v / 0.1).powi(power)).sum::<f64>() / 5.0;
    for k in [0, 2] {
        let ratio = (differ[k] / alike[k]).powi(2);
        assert!(ratio > 1.0 / mean(-2) && ratio < mean(2), "{ratio}, not {} to {}", 1.0 / mean(-2), mean(2));
    }
    let by_cameras = |v: [f64; 3]| (v[1].powi(2) - v[2].powi(2)).sqrt();
    assert!(by_cameras(differ) > 1.2 * by_cameras(alike), "{differ:?} {alike:?}");
}

#[test]
fn a_camera_that_sees_too_few_control_points_is_refused_by_name() {
    let planner = planner(with_control);
    let near = Placed { kind: 0, centre_m: Vector3::new(0.0, -2.5, 1.5), aim_m: Vector3::new(0.0, 0.0, 1.5) };
    let mut placed = planner.pair(0, CameraPair { angle_deg: 90.0, distance_m: 6.36 }).to_vec();
    placed[1] = near;
    let got = planner.predict(&placed, &planner.room().poses(2));
    assert!(got.refused.as_ref().is_some_and(|r| r.contains("cam2")), "{got:?}");
    assert!(!got.is_feasible());
}

#[test]
fn rooms_that_make_no_sense_are_refused_by_key() {
    let cases: [(&str, Spoil); 11] = [
        ("schema", |r| r.schema = 9),
        ("volume", |r| r.volume.high_m[2] = 9.0),
        ("volume.headings_deg", |r| r.volume.headings_deg.clear()),
        ("weights", |r| r.weights.per_mm = 0.0),
        ("markers_std_m", |r| r.markers_std_m = -1.0),
        ("camera", |r| r.camera[0].count = 1),
        ("horizontal_fov_deg", |r| r.camera[0].horizontal_fov_deg = f64::NAN),
        ("centre_std_px", |r| r.camera[0].centre_std_px = Some(CentreStd::Drawn(vec![]))),
        ("centre_std_px", |r| r.camera[0].centre_std_px = Some(CentreStd::Drawn(vec![0.1, -0.1]))),
        ("focus_m", |r| r.camera[0].focus_m = Some([2.0, 1.0])),
        ("block", |r| r.block = vec![Solid { name: None, low_m: [1.0; 3], high_m: [0.0; 3] }]),
    ];
    for (key, spoil) in cases {
        let mut bad = room();
        spoil(&mut bad);
        let refused = Planner::new(bad, balanced(), cube()).expect_err(key);
        assert!(refused.to_string().contains(key), "{key}: {refused}");
    }
    let two = balanced()[..2].to_vec();
    assert!(Planner::new(room(), two, cube()).is_err());
    let mut calibrated = room();
    with_control(&mut calibrated);
    assert!(Planner::new(calibrated, balanced(), vec![]).is_err());
}
