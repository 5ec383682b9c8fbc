//! The motion of an integration of the same model that shares no code with this one.

use mavsight_flight::{InputSeries, Vehicle};
use mavsight_simulator::{Scenario, simulate};
use std::path::PathBuf;

fn recordings() -> Option<PathBuf> {
    let folder = std::env::var_os("MAVSIGHT_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from)
        .join("paper-flight");
    if folder.join("truth.csv").is_file() {
        return Some(folder);
    }
    println!("skipped: no recordings at {}", folder.display());
    None
}

fn table(text: &str) -> Vec<Vec<f64>> {
    text.lines().skip(1).map(|l| l.split(',').map(|c| c.parse().expect("a number")).collect()).collect()
}

#[test]
fn paper_flights_motion_is_reproduced() {
    let Some(folder) = recordings() else { return };
    let read = |name: &str| table(&std::fs::read_to_string(folder.join(name)).expect("a table"));
    let rows = read("inputs.csv");
    let names = ["omega_u_rad_s", "omega_l_rad_s", "delta_lon_rad", "delta_lat_rad"].map(str::to_owned);
    let values = rows.iter().flat_map(|r| r[1..5].iter().copied()).collect();
    let inputs = InputSeries::new(names, rows.iter().map(|r| r[0]).collect(), values).expect("inputs");
    let truth = read("truth.csv");
    let times: Vec<f64> = truth.iter().map(|r| r[0]).collect();
    let vehicle = Vehicle::paper();
    let start = Scenario::paper().start(&vehicle).expect("a start");
    let states = simulate(&vehicle, &inputs, &start, &times).expect("a flight");
    let mut worst = [0.0_f64; 3];
    for (row, s) in truth.iter().zip(&states) {
        let p = s.position_in_world_m;
        worst[0] = worst[0].max((p.x - row[1]).hypot(p.y - row[2]).hypot(p.z - row[3]));
        worst[1] = worst[1].max((s.attitude.theta_rad - row[8]).abs());
        worst[2] = worst[2].max((s.rates_rad_s.y - row[11]).abs());
    }
    println!("worst: position {:.2e} m, theta {:.2e} rad, q {:.2e} rad/s", worst[0], worst[1], worst[2]);
    assert!(worst[0] < 1e-6 && worst[1] < 5e-6 && worst[2] < 5e-5, "{worst:?}");
}
