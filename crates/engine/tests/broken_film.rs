//! A film whose picture an encoder has broken: most poses are lost, many of the others err by the same in every
//! frame. What motion is given must hold its claims.

#![allow(clippy::unwrap_used, clippy::panic)]

use mavsight_engine::{Options, run};
use mavsight_geometry::EulerAngles;
use mavsight_pipeline::NoProgress;
use mavsight_pose::{MotionSample, euler_std};
use mavsight_session::Session;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Re-encodes both films; `None` where there are no films or no ffmpeg.
fn broken(folder: &Path, crf: &str) -> Option<PathBuf> {
    let shared = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let data = std::env::var_os("MAVSIGHT_DATA").map_or(shared, PathBuf::from).join("paper-flight");
    if !data.join("session.toml").is_file() || Command::new("ffmpeg").arg("-version").output().is_err() {
        println!("skipped: no ffmpeg, or no {}", data.display());
        return None;
    }
    std::fs::create_dir_all(folder).unwrap();
    for entry in std::fs::read_dir(&data).unwrap() {
        let (path, to) = (entry.as_ref().unwrap().path(), folder.join(entry.unwrap().file_name()));
        if path.extension().is_some_and(|e| e == "mp4") {
            let film = [path.as_os_str(), to.as_os_str()];
            let coding = ["-c:v", "libx264", "-crf", crf];
            let mut ffmpeg = Command::new("ffmpeg");
            ffmpeg.args(["-v", "error", "-y", "-i"]).arg(film[0]).args(coding).arg(film[1]);
            assert!(ffmpeg.status().unwrap().success());
        } else {
            std::fs::write(to, std::fs::read(path).unwrap()).unwrap();
        }
    }
    Some(folder.join("session.toml"))
}

/// Rows of the truth: time, then x, y, z, u, v, w, roll, pitch, yaw, p, q, r.
fn truth(folder: &Path) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(folder.join("truth.csv")).unwrap();
    text.lines().skip(1).map(|l| l.split(',').map(|c| c.parse().unwrap()).collect()).collect()
}

/// Errors over their standard deviations, in the order of the truth's columns.
fn normalised(sample: &MotionSample, truth: &[f64]) -> Vec<f64> {
    let angles = EulerAngles::from_world_from_body(&sample.world_from_body);
    let std = |quantity: usize| sample.covariance.quantity(quantity).diagonal().map(f64::sqrt);
    let of_angles = euler_std(&sample.world_from_body, &sample.covariance.quantity(1));
    let position = sample.world_from_body.translation.vector;
    let groups = [
        (position, std(0)),
        (sample.velocity_in_body_m_s, std(2)),
        ([angles.phi_rad, angles.theta_rad, angles.psi_rad].into(), of_angles),
        (sample.rates_rad_s, std(3)),
    ];
    let values = groups.iter().flat_map(|(value, std)| (0..3).map(|k| (value[k], std[k])));
    values.zip(&truth[1..13]).map(|((value, std), want)| (value - want) / std).collect()
}

#[test]
fn motion_of_a_broken_film_holds_its_claims() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("broken-film");
    let Some(session) = broken(&folder, "38") else { return };
    let session = Session::load(&session).unwrap();
    let options = Options { equation_error_only: true, ..Options::default() };
    let motion = run(&session, &options, &NoProgress).unwrap().motion.expect("a motion");
    let truth = truth(&folder);
    let mut errors = Vec::new();
    for sample in &motion.samples {
        let t_s = sample.t_ns as f64 * 1e-9;
        let row = truth.iter().find(|row| (row[0] - t_s).abs() < 1e-3).expect("a row of the truth");
        errors.extend(normalised(sample, row));
    }
    assert!(errors.len() >= 12 * 50, "{} values", errors.len());
    let inside = errors.iter().filter(|e| e.abs() <= 1.96).count() as f64 / errors.len() as f64;
    let worst = errors.iter().fold(0.0_f64, |worst, e| worst.max(e.abs()));
    assert!(inside >= 0.9 && worst < 5.0, "{inside} inside, worst {worst}");
}
