//! How much memory a flight takes, stage by stage, from its markers on: `cargo run --release -p
//! mavsight-pipeline --example memory -- 108000`, an hour of two cameras at 30 Hz. Linux alone reports the
//! peak.

#[path = "../tests/carried/mod.rs"]
mod carried;

use carried::{LARGE, TWO, inputs, instants, rig_at};
use mavsight_flight::Vehicle;
use mavsight_identify::output_error::fitted_stretch_s;
use mavsight_pipeline::{IdentifyOptions, NoProgress, body_markers, identify_motion, motion_of, reconstruct};
use mavsight_pose::MarkerObservation;
use mavsight_session::{RunResults, make_folder, write_markers_early, write_results};

/// Instants of an hour.
const HOUR: f64 = 108_000.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let count: usize = std::env::args().nth(1).and_then(|n| n.parse().ok()).unwrap_or(9000);
    let (rig, vehicle) = (rig_at(&TWO, LARGE, 0.1), Vehicle::paper());
    let flown = inputs(count);
    let before = report("program and inputs", count, 0.0);
    let tracked = reconstruct(&rig, &vehicle, instants(&rig, &body_markers(&vehicle), count))?;
    report("observations and poses", count, before);
    let motion = motion_of(&tracked, None, &vehicle, &NoProgress)?;
    report("motion", count, before);
    // As a run does: the markers go to the disk, and those of a minute are kept.
    let folder = std::env::temp_dir().join(format!("mavsight-memory-{}", std::process::id()));
    make_folder(&folder)?;
    let mut results = RunResults {
        session: "memory".into(),
        rig: Some(rig),
        poses: tracked.poses,
        ..RunResults::default()
    };
    let (from_s, to_s) = fitted_stretch_s(&results.poses).unwrap_or_default();
    let is_needed = |o: &MarkerObservation| (from_s..=to_s).contains(&(o.t_ns as f64 * 1e-9));
    write_markers_early(&folder, &mut results, &tracked.observations, is_needed)?;
    drop(tracked.observations);
    report("markers written", count, before);
    let solved = identify_motion(&motion, &flown, &vehicle, &IdentifyOptions::default(), &NoProgress);
    report("coefficients and fits", count, before);
    results.motion = Some(motion);
    match solved {
        Ok(solution) => {
            results.coefficients = Some(solution.coefficients);
            results.identification = Some(solution.identification);
        }
        Err(refusal) => println!("no parameters: {refusal}"),
    }
    write_results(&folder, &results)?;
    report("result files", count, before);
    std::fs::remove_dir_all(&folder)?;
    Ok(())
}

/// Prints what is held now and was held at most since it was asked last, in MB and for an hour.
fn report(what: &str, count: usize, before_mb: f64) -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let of = |key: &str| {
        let line = status.lines().find_map(|l| l.strip_prefix(key)).unwrap_or_default();
        line.trim().trim_end_matches("kB").trim().parse::<f64>().unwrap_or(f64::NAN) / 1e3
    };
    let (held_mb, most_mb) = (of("VmRSS:"), of("VmHWM:"));
    let hour = |mb: f64| (mb - before_mb) * HOUR / count as f64;
    println!(
        "{what:>24}: {held_mb:7.1} MB, at most {most_mb:7.1} MB; an hour {:6.0} MB, at most {:6.0} MB",
        hour(held_mb),
        hour(most_mb)
    );
    // The peak from here on.
    drop(std::fs::write("/proc/self/clear_refs", "5"));
    held_mb
}
