//! Structure search on twelve flights of a helicopter whose drag the model lacks.
//!
//! `cargo run --release -p mavsight-identify --example missing_term -- FOLDER`: the folder has `vehicle.toml`
//! and, for flights 11 to 22, `poses-N.csv` and `inputs-N.csv`. For each flight what was added, and whether
//! the drag (0.1 N s/m) and the fly-bar's time constant (3 s) lie in their intervals.

use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::{EulerAngles, Matrix6, Vector3, world_from_body};
use mavsight_identify::output_error::{
    FlightModel, InitialStates, Measurements, OutputErrorOptions, StateMeasurement, StructureSearch,
    search_structure,
};
use std::error::Error;
use std::path::Path;
use std::time::Instant;

/// What the simulator had.
const TRUE_DRAG_N_S_M: f64 = 0.1;
const TRUE_FLYBAR_S: f64 = 3.0;

struct Table {
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
}

fn table(path: &Path) -> Result<Table, Box<dyn Error>> {
    let text = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    let mut lines = text.lines();
    let names = lines.next().ok_or("an empty table")?.split(',').map(str::to_owned).collect();
    let row = |line: &str| line.split(',').map(str::parse::<f64>).collect::<Result<Vec<f64>, _>>();
    Ok(Table { names, rows: lines.map(row).collect::<Result<_, _>>()? })
}

/// Rows of time, then value and standard deviation of each coordinate.
fn pose(row: &[f64]) -> StateMeasurement {
    let angles = EulerAngles { phi_rad: row[7], theta_rad: row[9], psi_rad: row[11] };
    let pose = world_from_body(Vector3::new(row[1], row[3], row[5]), angles);
    let variances = [2, 4, 6, 8, 10, 12].map(|k| row[k] * row[k]);
    StateMeasurement::of_pose((row[0] * 1e9).round() as i64, pose, Matrix6::from_diagonal(&variances.into()))
}

fn search(folder: &Path, flight: usize) -> Result<StructureSearch, Box<dyn Error>> {
    let vehicle: Vehicle = toml::from_str(&std::fs::read_to_string(folder.join("vehicle.toml"))?)?;
    let Table { names, rows } = table(&folder.join(format!("inputs-{flight}.csv")))?;
    let times_s = rows.iter().map(|r| r[0]).collect();
    let values = rows.iter().flat_map(|r| &r[1..]).copied().collect();
    let inputs = InputSeries::new(names[1..].to_vec(), times_s, values)?;
    // Of the clocks' difference the poses beyond the last input are not covered.
    let covered = |row: &&Vec<f64>| row[0] <= inputs.end_s();
    let poses = table(&folder.join(format!("poses-{flight}.csv")))?;
    let poses = poses.rows.iter().filter(covered).map(|row| pose(row)).collect();
    let model = FlightModel::new(&vehicle, &inputs)?.with_free_lag();
    // The discs are not in trim at the first instant.
    let options = OutputErrorOptions { initial: InitialStates::Free, ..OutputErrorOptions::default() };
    Ok(search_structure(&model, &inputs, &Measurements::States(poses), &options)?)
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("give the folder of the flights")?;
    let (mut found, mut held, mut flybar, mut others) = (0, 0, 0, 0);
    for flight in 11..=22 {
        let begin = Instant::now();
        let search = match search(Path::new(&folder), flight) {
            Ok(search) => search,
            Err(error) => {
                println!("{flight}: {error}");
                continue;
            }
        };
        println!("flight {flight}, {:.1} s:", begin.elapsed().as_secs_f64());
        search.notes().iter().for_each(|note| println!("  {note}"));
        for term in &search.added {
            if term.fitted.name == "d_xy" {
                found += 1;
                held += usize::from((term.fitted.ci_low..=term.fitted.ci_high).contains(&TRUE_DRAG_N_S_M));
            } else if term.fitted.name != "d_z" {
                others += 1;
            }
        }
        if let Some(tau) = search.fit.parameter("tau_f") {
            let is_held = (tau.ci_low..=tau.ci_high).contains(&TRUE_FLYBAR_S);
            flybar += usize::from(is_held);
            println!(
                "  tau_f {:.3} ± {:.3} s{}",
                tau.value,
                tau.std,
                if is_held { "" } else { ", not held" }
            );
        }
    }
    println!(
        "drag along x and y found in {found} of 12, its interval holds 0.1 in {held}; tau_f's holds 3 in {flybar}; {others} other terms"
    );
    Ok(())
}
