//! Truth files: the simulator's own values, which scoring alone reads.

use mavsight_flight::Vehicle;
use mavsight_geometry::{EulerAngles, Vector3};
use mavsight_session::{Session, SessionError, Table, write_csv, write_numbers};
use mavsight_simulator::FlightState;
use std::path::Path;

/// Columns before and behind those of the further states.
const BEFORE: [&str; 13] = [
    "t_s",
    "x_m",
    "y_m",
    "z_m",
    "u_m_s",
    "v_m_s",
    "w_m_s",
    "phi_rad",
    "theta_rad",
    "psi_rad",
    "p_rad_s",
    "q_rad_s",
    "r_rad_s",
];
const BEHIND: [&str; 6] = ["du_m_s2", "dv_m_s2", "dw_m_s2", "dp_rad_s2", "dq_rad_s2", "dr_rad_s2"];

/// The numbers of [`BEFORE`] and [`BEHIND`].
fn numbers(state: &FlightState) -> ([f64; 13], [f64; 6]) {
    let (p, v, e) = (state.position_in_world_m, state.velocity_in_body_m_s, state.attitude);
    let (w, dv, dw) = (state.rates_rad_s, state.velocity_rate_m_s2, state.angular_acceleration_rad_s2);
    #[rustfmt::skip]
    let before = [
        state.t_s, p.x, p.y, p.z, v.x, v.y, v.z, e.phi_rad, e.theta_rad, e.psi_rad, w.x, w.y, w.z,
    ];
    (before, [dv.x, dv.y, dv.z, dw.x, dw.y, dw.z])
}

fn state_of(before: &[f64; 13], further: Vec<f64>, behind: &[f64; 6]) -> FlightState {
    let [t_s, x, y, z, u, v, w, phi_rad, theta_rad, psi_rad, p, q, r] = *before;
    let [du, dv, dw, dp, dq, dr] = *behind;
    FlightState {
        t_s,
        position_in_world_m: Vector3::new(x, y, z),
        attitude: EulerAngles { phi_rad, theta_rad, psi_rad },
        velocity_in_body_m_s: Vector3::new(u, v, w),
        rates_rad_s: Vector3::new(p, q, r),
        further,
        velocity_rate_m_s2: Vector3::new(du, dv, dw),
        angular_acceleration_rad_s2: Vector3::new(dp, dq, dr),
    }
}

/// Reads a truth file: a CSV or Parquet table with the columns that [`write_truth`] writes, or more.
///
/// The further states are those of the vehicle's model where the file has a column for each; none where it
/// does not, as in a flight that another model has flown.
///
/// # Errors
/// Names the file, row and column.
pub fn read_truth(path: &Path, vehicle: &Vehicle) -> Result<Vec<FlightState>, SessionError> {
    let table = Table::read(path, "truth")?;
    let (before, behind) = (table.columns(BEFORE)?, table.columns(BEHIND)?);
    let further: Result<Vec<_>, _> = vehicle.model.states.iter().map(|s| table.column(&s.column)).collect();
    let further = further.unwrap_or_default();
    let mut states: Vec<FlightState> = Vec::new();
    for row in table.rows()? {
        let (first, last) = (row.numbers(before)?, row.numbers(behind)?);
        let further = further.iter().map(|place| row.number(*place)).collect::<Result<_, _>>()?;
        let state = state_of(&first, further, &last);
        if states.last().is_some_and(|last| last.t_s >= state.t_s) {
            return Err(row.refuse(
                before[0],
                "the time does not come after that of the row before: sort the rows by time",
            ));
        }
        states.push(state);
    }
    Ok(states)
}

/// Writes a simulated motion as a truth file: time, position, velocity, attitude and rates, the further
/// states by the model's columns, then accelerations.
///
/// # Errors
/// What the file system refuses.
pub fn write_truth(path: &Path, states: &[FlightState], vehicle: &Vehicle) -> Result<(), SessionError> {
    let further: Vec<&str> = vehicle.model.states.iter().map(|s| s.column.as_str()).collect();
    let header = [&BEFORE[..], &further, &BEHIND].concat();
    let row = |s: &FlightState| {
        let (before, behind) = numbers(s);
        [&before[..], &s.further, &behind].concat()
    };
    write_numbers(path, &header, states.iter().map(row))
}

/// Name of the file, next to `truth.csv`.
pub const VISIBILITY: &str = "visibility.csv";

/// Writes which share of each ball's face each camera saw: by instant, camera and marker.
///
/// # Errors
/// What the file system refuses.
pub fn write_visibility(
    path: &Path,
    truth: &[FlightState],
    cameras: &[String],
    vehicle: &Vehicle,
    shares: &[Vec<Vec<f64>>],
) -> Result<(), SessionError> {
    let header = ["t_s", "camera"].into_iter().chain(vehicle.marker.iter().map(|m| m.name.as_str()));
    let of_instant = |(row, of_cameras): (&FlightState, &Vec<Vec<f64>>)| -> Vec<Vec<String>> {
        let cells = |(camera, of_markers): (&String, &Vec<f64>)| {
            let shares = of_markers.iter().map(|share| format!("{share:.3}"));
            [format!("{:.9}", row.t_s), camera.clone()].into_iter().chain(shares).collect()
        };
        cameras.iter().zip(of_cameras).map(cells).collect()
    };
    write_csv(path, header, truth.iter().zip(shares).flat_map(of_instant))
}

/// Reads the truth of a session, where it has one.
///
/// # Errors
/// Names row and column.
pub fn truth_of(session: &Session) -> Result<Option<Vec<FlightState>>, SessionError> {
    session.file.truth.as_deref().map(|path| read_truth(path, &session.vehicle)).transpose()
}

/// Reads the shares of the balls' faces that were visible, by instant, camera and marker; none where no such
/// file stands next to the truth.
///
/// # Errors
/// Names the file, row and column.
pub fn visibility_of(session: &Session) -> Result<Option<Vec<Vec<Vec<f64>>>>, SessionError> {
    let path = session.file.truth.as_deref().map(|t| t.with_file_name(VISIBILITY));
    let Some(path) = path.filter(|p| p.is_file()) else { return Ok(None) };
    let table = Table::read(&path, "visibility")?;
    let columns =
        session.vehicle.marker.iter().map(|m| table.column(&m.name)).collect::<Result<Vec<_>, _>>()?;
    let rows = table
        .rows()?
        .map(|row| columns.iter().map(|c| row.number(*c)).collect())
        .collect::<Result<Vec<Vec<f64>>, _>>()?;
    Ok(Some(rows.chunks(session.cameras().len().max(1)).map(<[_]>::to_vec).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_model::Model;
    use std::path::PathBuf;

    #[test]
    fn the_truth_of_paper_flight_is_read() {
        let data = std::env::var_os("MAVSIGHT_DATA").map_or_else(
            || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
            PathBuf::from,
        );
        let path = data.join("paper-flight").join("session.toml");
        if !path.is_file() {
            println!("skipped: {} is not there", path.display());
            return;
        }
        let truth = truth_of(&Session::load(&path).unwrap()).unwrap().unwrap();
        assert_eq!(truth.len(), 300);
        assert_eq!((truth[1].t_s, truth[1].position_in_world_m.z), (0.033333333, 1.5));
        assert!((truth[1].attitude.psi_rad + 22.5_f64.to_radians()).abs() < 1e-6);
    }

    #[test]
    fn truth_names_its_missing_column() {
        let path = std::env::temp_dir().join(format!("mavsight-truth-{}.csv", std::process::id()));
        std::fs::write(&path, "t_s,x_m\n0,0\n").unwrap();
        let refused = read_truth(&path, &Vehicle::paper()).unwrap_err().to_string();
        std::fs::remove_file(&path).unwrap();
        assert!(refused.contains("mavsight-truth") && refused.contains("y_m"), "{refused}");
    }

    #[test]
    fn further_states_are_columns_of_the_model_between_rates_and_accelerations() {
        let path = std::env::temp_dir().join(format!("mavsight-further-{}.csv", std::process::id()));
        let number = |k: usize| 0.5 * k as f64;
        let row: Vec<f64> = (0..19).map(number).collect();
        let (before, behind) = (row[..13].try_into().unwrap(), row[13..].try_into().unwrap());
        let states = vec![state_of(before, vec![0.1, 0.2, 0.3, 0.4], behind)];
        let vehicle = Vehicle::paper();
        write_truth(&path, &states, &vehicle).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains("r_rad_s,alpha_l_rad,beta_l_rad,alpha_f_rad,beta_f_rad,du_m_s2"), "{text}");
        assert_eq!(read_truth(&path, &vehicle).unwrap(), states);
        let other = Vehicle { model: Model::shelf("quadrotor").unwrap().into(), ..Vehicle::paper() };
        let read = read_truth(&path, &other).unwrap();
        std::fs::remove_file(&path).unwrap();
        assert_eq!(read[0].further, Vec::<f64>::new());
        assert_eq!(read[0].rates_rad_s, states[0].rates_rad_s);
    }
}
