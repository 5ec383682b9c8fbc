//! Truth files: the simulator's own values, which scoring alone reads.

use mavsight_flight::Vehicle;
use mavsight_session::{Session, SessionError, Table, write_csv, write_numbers};
use mavsight_simulator::FlightState;
use std::path::Path;

/// The columns of a truth file with the numbers of a state that they hold.
fn columns(state: &mut FlightState) -> [(&'static str, &mut f64); 23] {
    let [x_m, y_m, z_m] = state.position_in_world_m.as_mut();
    let [u_m_s, v_m_s, w_m_s] = state.velocity_in_body_m_s.as_mut();
    let [p_rad_s, q_rad_s, r_rad_s] = state.rates_rad_s.as_mut();
    let [du_m_s2, dv_m_s2, dw_m_s2] = state.velocity_rate_m_s2.as_mut();
    let [dp_rad_s2, dq_rad_s2, dr_rad_s2] = state.angular_acceleration_rad_s2.as_mut();
    [
        ("t_s", &mut state.t_s),
        ("x_m", x_m),
        ("y_m", y_m),
        ("z_m", z_m),
        ("u_m_s", u_m_s),
        ("v_m_s", v_m_s),
        ("w_m_s", w_m_s),
        ("phi_rad", &mut state.attitude.phi_rad),
        ("theta_rad", &mut state.attitude.theta_rad),
        ("psi_rad", &mut state.attitude.psi_rad),
        ("p_rad_s", p_rad_s),
        ("q_rad_s", q_rad_s),
        ("r_rad_s", r_rad_s),
        ("alpha_l_rad", &mut state.flap.alpha_l_rad),
        ("beta_l_rad", &mut state.flap.beta_l_rad),
        ("alpha_f_rad", &mut state.flap.alpha_f_rad),
        ("beta_f_rad", &mut state.flap.beta_f_rad),
        ("du_m_s2", du_m_s2),
        ("dv_m_s2", dv_m_s2),
        ("dw_m_s2", dw_m_s2),
        ("dp_rad_s2", dp_rad_s2),
        ("dq_rad_s2", dq_rad_s2),
        ("dr_rad_s2", dr_rad_s2),
    ]
}

fn names() -> [&'static str; 23] {
    columns(&mut FlightState::default()).map(|(name, _)| name)
}

/// Reads a truth file: a CSV or Parquet table with the columns that [`write_truth`] writes, or more.
///
/// # Errors
/// Names the file, row and column.
pub fn read_truth(path: &Path) -> Result<Vec<FlightState>, SessionError> {
    let table = Table::read(path, "truth")?;
    let places = table.columns(names())?;
    let states = table.rows()?.map(|row| {
        let mut state = FlightState::default();
        for ((_, number), place) in columns(&mut state).into_iter().zip(places) {
            *number = row.number(place)?;
        }
        Ok(state)
    });
    states.collect()
}

/// Writes a simulated motion as a truth file.
///
/// # Errors
/// What the file system refuses.
pub fn write_truth(path: &Path, states: &[FlightState]) -> Result<(), SessionError> {
    write_numbers(
        path,
        &names(),
        states.iter().map(|s| columns(&mut s.clone()).map(|(_, number)| *number).to_vec()),
    )
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
    session.file.truth.as_deref().map(read_truth).transpose()
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
        let refused = read_truth(&path).unwrap_err().to_string();
        std::fs::remove_file(&path).unwrap();
        assert!(refused.contains("mavsight-truth") && refused.contains("y_m"), "{refused}");
    }
}
