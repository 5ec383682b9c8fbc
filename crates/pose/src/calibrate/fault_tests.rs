//! Mistakes in the table of control points are named, and left out or refused.

use super::test_sets::{around, both, cameras_around, unlike_cameras, unlike_rig};
use super::{CameraControl, Rig, calibrate};
use crate::PoseError;
use crate::testing::cameras;
use mavsight_geometry::{Camera, Vector3};
use mavsight_random::Random;

/// Names that a calibration leaves out, or that its refusal holds.
fn named(result: &Result<Rig, PoseError>) -> (Vec<String>, String) {
    match result {
        Ok(rig) => {
            let mut names: Vec<String> = rig.left_out.iter().map(|l| l.name.clone()).collect();
            names.sort();
            names.dedup();
            (names, rig.left_out.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))
        }
        Err(PoseError::SuspectControlPoints { suspects }) => {
            let mut names: Vec<String> =
                suspects.split(" or ").map(|s| s.split(' ').next().unwrap_or("").to_owned()).collect();
            names.sort();
            names.dedup();
            (names, suspects.clone())
        }
        Err(other) => (vec![], other.to_string()),
    }
}

/// A rig: its control points as its cameras see them under a seed, and the true cameras.
struct Case {
    name: &'static str,
    seen: fn(&mut Random) -> Vec<CameraControl>,
    cameras: fn() -> Vec<Camera>,
    points: usize,
}

/// Two cameras and the least frame; three cameras and twelve points; three unlike cameras, surveyed to 2 mm.
const CASES: [Case; 3] = [
    Case { name: "pair", seen: |s| both(0.1, s), cameras: || cameras().to_vec(), points: 8 },
    Case { name: "around", seen: |s| around(0.15, s), cameras: cameras_around, points: 12 },
    Case { name: "unlike", seen: |s| unlike_rig(0.1, 0.002, s), cameras: unlike_cameras, points: 16 },
];

/// A point moved 2 cm in the table is named with at most one other, or the calibration refused by its name;
/// where it is not refused the cameras are within their uncertainty.
fn displaced(case: &Case, point: usize, direction: Vector3<f64>, random: &mut Random) -> Result<(), String> {
    let mut controls = (case.seen)(random);
    for c in &mut controls {
        c.points[point].point_in_world_m += direction.normalize() * 0.02;
    }
    let result = calibrate(&controls);
    let (names, text) = named(&result);
    let place = format!("{}: p{point} by {:?}", case.name, direction.as_slice());
    if !names.contains(&format!("p{point}")) || (result.is_ok() && names.len() > 2) {
        return Err(format!("{place}: {names:?} {text}"));
    }
    for (got, truth) in result.iter().flat_map(|r| &r.cameras).zip((case.cameras)()) {
        let error_m = (got.camera.centre_in_world() - truth.centre_in_world()).norm();
        if error_m > 4.0 * got.centre_std_m.norm() {
            return Err(format!("{place}: {} off by {error_m} m, {} {text}", got.name, got.model));
        }
    }
    Ok(())
}

fn swapped(case: &Case, (a, b): (usize, usize), random: &mut Random) -> Result<(), String> {
    let mut controls = (case.seen)(random);
    for c in &mut controls {
        let place = c.points[a].point_in_world_m;
        c.points[a].point_in_world_m = c.points[b].point_in_world_m;
        c.points[b].point_in_world_m = place;
    }
    let (names, text) = named(&calibrate(&controls));
    let both = [a, b].iter().all(|p| names.contains(&format!("p{p}")));
    // Chance names a good point too in one calibration of a hundred.
    if both && names.len() <= 3 {
        Ok(())
    } else {
        Err(format!("{}: p{a} with p{b}: {names:?} {text}", case.name))
    }
}

fn none_wrong(checked: impl Iterator<Item = Result<(), String>>) {
    let (mut all, mut wrong) = (0, vec![]);
    for result in checked {
        all += 1;
        wrong.extend(result.err());
    }
    assert!(wrong.is_empty(), "{} of {all}:\n{}", wrong.len(), wrong.join("\n"));
}

const DIRECTIONS: [[f64; 3]; 5] =
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, -1.0], [-1.0, 1.0, 1.0]];

/// All points and directions, of which each `every`-th is checked.
fn all_displaced(case: &Case, every: usize, random: &mut Random) {
    let trials = (0..case.points).flat_map(|p| DIRECTIONS.map(|d| (p, Vector3::from(d))));
    none_wrong(trials.step_by(every).map(|(point, direction)| displaced(case, point, direction, random)));
}

fn all_swapped(case: &Case, every: usize, random: &mut Random) {
    let trials = (0..case.points).flat_map(|a| (a + 1..case.points).map(move |b| (a, b)));
    none_wrong(trials.step_by(every).map(|pair| swapped(case, pair, random)));
}

#[test]
fn a_displaced_point_is_named() {
    let mut random = Random::new(21, 0);
    CASES.iter().zip([1, 7, 27]).for_each(|(case, every)| all_displaced(case, every, &mut random));
}

#[test]
fn swapped_points_are_named() {
    let mut random = Random::new(5, 0);
    CASES.iter().zip([1, 9, 61]).for_each(|(case, every)| all_swapped(case, every, &mut random));
}

/// `cargo test --release -p mavsight-pose faults_of_many -- --ignored`
#[test]
#[ignore = "minutes: every point, direction and pair under many seeds"]
fn faults_of_many_seeds_are_named() {
    for (case, seeds) in CASES.iter().zip([6, 3, 1]) {
        for first in 0..seeds {
            let mut random = Random::new(1000 + first, 0);
            all_displaced(case, 1, &mut random);
            all_swapped(case, 1, &mut random);
        }
        println!("{}: {seeds} seeds", case.name);
    }
}

/// A ball before a rod of its colour, in one camera of three: its place in the table was said to be wrong.
#[test]
fn an_image_that_is_off_in_one_of_three_cameras_is_left_out_there_alone() {
    let mut random = Random::new(23, 0);
    let mut controls = around(0.15, &mut random);
    controls[2].points[4].pixel += mavsight_geometry::Vector2::new(1.6, -1.4);
    let rig = calibrate(&controls).unwrap();
    let [left_out] = &rig.left_out[..] else { panic!("{:?}", rig.left_out) };
    assert_eq!((left_out.name.as_str(), left_out.camera.as_deref()), ("p4", Some("cam3")));
    assert!(
        left_out.to_string().contains("of cam3") && !left_out.to_string().contains("measure"),
        "{left_out}"
    );
    let used = |camera: usize| rig.cameras[camera].points.iter().filter(|p| p.used).count();
    assert_eq!([0, 1, 2].map(used), [12, 12, 11]);
}

#[test]
fn good_points_are_kept() {
    let (mut random, mut alarms) = (Random::new(77, 0), vec![]);
    for (case, trials) in CASES.iter().zip([60, 20, 6]) {
        for _ in 0..trials {
            let rig = calibrate(&(case.seen)(&mut random)).unwrap();
            alarms.extend(rig.left_out.first().map(|l| format!("{}: {l}", case.name)));
        }
    }
    // One calibration of a hundred is wrong by design: more than four of 86 happen once in a thousand times.
    assert!(alarms.len() <= 4, "{}", alarms.join("\n"));
}
