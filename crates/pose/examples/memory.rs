//! How much memory a flight of so many instants takes from its poses on: `cargo run --release -p mavsight-pose --example memory
//! -- 108000`. Linux alone tells the peak.

use mavsight_geometry::{EulerAngles, Matrix6, Vector3, world_from_body};
use mavsight_pose::{PoseEstimate, PoseSample, smooth};
use nalgebra::Matrix6xX;

/// Columns of what stays, as two cameras and four markers have them.
const COLUMNS: usize = 40;

fn main() {
    let count: i64 = std::env::args().nth(1).and_then(|n| n.parse().ok()).unwrap_or(9000);
    let poses: Vec<PoseSample> = (0..count).map(pose).collect();
    let after_poses_mb = peak_mb();
    let motion = smooth(&poses, 9.81).map(|m| m.samples.len());
    let after_motion_mb = peak_mb();
    let each = |mb: f64| 1e3 * mb / count as f64;
    println!("{count} instants: poses {after_poses_mb:.0} MB ({:.2} kB each)", each(after_poses_mb));
    println!("motion of {motion:?}: peak {after_motion_mb:.0} MB ({:.2} kB each)", each(after_motion_mb));
}

fn pose(k: i64) -> PoseSample {
    let t = k as f64 / 30.0;
    let noise = |n: i64| ((k * 7919 + n * 104_729) % 1000) as f64 / 1000.0 - 0.5;
    let attitude =
        EulerAngles { phi_rad: 0.1 * t.sin() + 1e-3 * noise(1), theta_rad: 0.1 * t.cos(), psi_rad: 0.2 };
    let place = Vector3::new(t.sin() + 1e-3 * noise(2), 0.5 * (0.7 * t).cos(), 1.5 + 1e-3 * noise(3));
    let systematic = Matrix6xX::from_fn(COLUMNS, |i, j| 1e-5 * ((i + j) as f64 + t).cos());
    PoseSample {
        t_ns: k * 33_333_333,
        estimate: Some(PoseEstimate {
            world_from_body: world_from_body(place, attitude),
            covariance: Matrix6::identity() * 1e-6 + &systematic * systematic.transpose(),
            systematic,
            markers_used: vec![0, 1, 2, 3],
            left_out: vec![],
            residual_px: 0.1,
        }),
        reason: None,
    }
}

/// Peak of the resident memory of this process.
fn peak_mb() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    let kb = line.and_then(|l| l.trim().trim_end_matches("kB").trim().parse::<f64>().ok());
    kb.unwrap_or(f64::NAN) / 1e3
}
