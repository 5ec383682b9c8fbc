//! The paper's control frame, filmed, with its table as it is and with mistakes in it.

#![allow(clippy::unwrap_used, clippy::panic)]

use mavsight_geometry::Vector3;
use mavsight_pipeline::{ControlPointRow, ControlStill, PipelineError, calibrate_from_stills};
use mavsight_pose::{LeftOutReason, PoseError, Rig};
use mavsight_session::{read_image, tables::read_control_points};
use std::path::PathBuf;

/// The flight's folder, if the data are there.
fn folder() -> Option<PathBuf> {
    let data = std::env::var_os("MAVSIGHT_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
        PathBuf::from,
    );
    let folder = data.join("paper-flight");
    if !folder.is_dir() {
        println!("skipped: {} is not there", folder.display());
    }
    folder.is_dir().then_some(folder)
}

struct Paper {
    stills: Vec<ControlStill>,
    table: Vec<ControlPointRow>,
}

fn paper() -> Option<Paper> {
    let folder = folder()?;
    let stills = ["cam1", "cam2"].map(|name| ControlStill {
        camera: name.to_owned(),
        frame: read_image(&folder.join(format!("{name}-control.png"))).unwrap(),
    });
    let table = read_control_points(&folder.join("control_points.csv")).unwrap();
    Some(Paper { stills: stills.into(), table })
}

fn centre_squares(rig: &Rig) -> Vec<(f64, f64)> {
    let truth = [Vector3::new(4.5, -4.5, 1.5), Vector3::new(-4.5, -4.5, 1.5)];
    rig.cameras
        .iter()
        .zip(truth)
        .map(|(camera, truth)| {
            let error = camera.camera.centre_in_world() - truth;
            let square = (error.transpose() * camera.centre_cov_m2.try_inverse().unwrap() * error)[0];
            (1e3 * error.norm(), square)
        })
        .collect()
}

#[test]
fn the_frame_gives_the_cameras_within_their_regions() {
    let Some(paper) = paper() else { return };
    let rig = calibrate_from_stills(&paper.stills, &paper.table, &[]).unwrap();
    assert_eq!(rig.left_out, vec![]);
    for (mm, square) in centre_squares(&rig) {
        println!("{mm:.2} mm, {square:.2}");
        assert!(mm < 8.0 && square < 7.815, "{mm} mm, {square} beyond the 95 % region");
    }
}

#[test]
fn a_ball_surveyed_wrongly_by_2_cm_is_named() {
    let Some(paper) = paper() else { return };
    for k in 0..paper.table.len() {
        let mut table = paper.table.clone();
        table[k].position_m[k % 3] += 0.02;
        let name = &table[k].name;
        match calibrate_from_stills(&paper.stills, &table, &[]) {
            Ok(rig) => {
                let names: Vec<&String> = rig.left_out.iter().map(|l| &l.name).collect();
                assert!(names.contains(&name) && names.len() <= 2, "{name}: {:?}", rig.left_out);
            }
            Err(PipelineError::Pose { source: PoseError::SuspectControlPoints { suspects }, .. }) => {
                assert!(suspects.contains(name.as_str()), "{name}: {suspects}");
            }
            Err(other) => panic!("{name}: {other}"),
        }
    }
}

/// Colours exchanged and places exchanged are the same mistake.
#[test]
fn two_exchanged_balls_are_named() {
    let Some(paper) = paper() else { return };
    for (a, b) in [(0, 1), (1, 2), (2, 5), (3, 7), (4, 6), (0, 6), (4, 5)] {
        for colors in [true, false] {
            let mut table = paper.table.clone();
            if colors {
                (table[a].color, table[b].color) = (table[b].color, table[a].color);
            } else {
                (table[a].position_m, table[b].position_m) = (table[b].position_m, table[a].position_m);
            }
            let rig = calibrate_from_stills(&paper.stills, &table, &[]).unwrap();
            let mut names: Vec<&String> = rig
                .left_out
                .iter()
                .filter(|l| matches!(l.reason, LeftOutReason::Swapped { .. }))
                .map(|l| &l.name)
                .collect();
            names.sort();
            let mut want = vec![&table[a].name, &table[b].name];
            want.sort();
            assert_eq!(names, want, "colours {colors}: {:?}", rig.left_out);
            assert!(centre_squares(&rig).iter().all(|(_, square)| *square < 16.27));
        }
    }
}
