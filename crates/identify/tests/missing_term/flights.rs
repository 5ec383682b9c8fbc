//! The flights, as they were recorded.

use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::{EulerAngles, Matrix6, Vector3, world_from_body};
use mavsight_identify::IdentifyError;
use mavsight_identify::output_error::{FlightModel, Measurements, StateMeasurement};
use mavsight_pose::{PoseEstimate, PoseSample};
use std::error::Error;
use std::path::Path;

/// What the simulator had, of the model's free parameters and of the inputs' clock: rows are samples of what changes
/// all the time, which is 4.5 ms early if taken to hold.
pub(crate) const TRUTH: [(&str, f64); 10] = [
    ("C_X,alpha_u", -0.01436),
    ("C_X,alpha_l", -0.00996),
    ("C_Z,u", -0.01436),
    ("C_Z,l", -0.00996),
    ("C_m,alpha_u", 0.011488),
    ("C_m,alpha_l", 0.0047808),
    ("C_m,q", -2.480_620_155e-5),
    ("tau_l", 0.05),
    ("tau_f", 3.0),
    ("input_lag_s", -0.0045),
];

/// One flight.
pub(crate) struct Flown {
    /// The paper's helicopter.
    pub(crate) vehicle: Vehicle,
    /// Recorded inputs.
    pub(crate) inputs: InputSeries,
    /// Poses that the inputs cover.
    pub(crate) poses: Vec<PoseSample>,
}

impl Flown {
    /// Reads `vehicle.toml`, `inputs-N.csv` and `poses-N.csv` of a folder.
    pub(crate) fn read(folder: &Path, flight: usize) -> Result<Self, Box<dyn Error>> {
        let vehicle: Vehicle = toml::from_str(&text(&folder.join("vehicle.toml"))?)?;
        let Table { names, rows } = table(&folder.join(format!("inputs-{flight}.csv")))?;
        let times_s = rows.iter().map(|r| r[0]).collect();
        let values = rows.iter().flat_map(|r| &r[1..]).copied().collect();
        let inputs = InputSeries::new(names[1..].to_vec(), times_s, values)?;
        let poses = table(&folder.join(format!("poses-{flight}.csv")))?.rows;
        let poses = poses.iter().filter(|row| row[0] <= inputs.end_s()).map(|row| pose(row)).collect();
        Ok(Self { vehicle, inputs, poses })
    }

    /// The model, with the lag of the inputs free.
    pub(crate) fn model(&self) -> Result<FlightModel, IdentifyError> {
        Ok(FlightModel::new(&self.vehicle, &self.inputs)?.with_free_lag())
    }

    /// The poses as measurements.
    pub(crate) fn measurements(&self) -> Measurements {
        Measurements::States(StateMeasurement::of_poses(self.poses.iter()))
    }
}

fn text(path: &Path) -> Result<String, String> {
    std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))
}

struct Table {
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
}

fn table(path: &Path) -> Result<Table, Box<dyn Error>> {
    let text = text(path)?;
    let mut lines = text.lines();
    let names = lines.next().ok_or("an empty table")?.split(',').map(str::to_owned).collect();
    let row = |line: &str| line.split(',').map(str::parse::<f64>).collect::<Result<Vec<f64>, _>>();
    Ok(Table { names, rows: lines.map(row).collect::<Result<_, _>>()? })
}

/// A row has time, then value and standard deviation of each coordinate.
fn pose(row: &[f64]) -> PoseSample {
    let angles = EulerAngles { phi_rad: row[7], theta_rad: row[9], psi_rad: row[11] };
    let pose = world_from_body(Vector3::new(row[1], row[3], row[5]), angles);
    let variances = [2, 4, 6, 8, 10, 12].map(|k| row[k] * row[k]);
    let estimate = PoseEstimate::new(pose, &Matrix6::from_diagonal(&variances.into()));
    PoseSample { t_ns: (row[0] * 1e9).round() as i64, estimate: Ok(estimate) }
}
