//! Files that a simulated flight leaves.

use crate::table::csv_cell;
use crate::tables::{CONTROL_COLUMNS, ControlPointRow, INPUT_COLUMNS, SURVEY_COLUMN, TRUTH_COLUMNS};
use crate::{SessionError, SessionFile, TruthRow, write_whole};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_simulator::FlightState;
use std::path::Path;

/// Writes recorded inputs.
///
/// # Errors
/// What the file system refuses.
pub fn write_inputs(path: &Path, inputs: &InputSeries) -> Result<(), SessionError> {
    let rows = inputs
        .samples()
        .iter()
        .map(|s| vec![s.t_s, s.omega_u_rad_s, s.omega_l_rad_s, s.delta_lon_rad, s.delta_lat_rad]);
    write_numbers(path, &INPUT_COLUMNS, rows)
}

/// Writes the simulated motion.
///
/// # Errors
/// What the file system refuses.
pub fn write_truth(path: &Path, states: &[FlightState]) -> Result<(), SessionError> {
    write_numbers(path, TRUTH_COLUMNS, states.iter().map(|s| TruthRow::from(s).values()))
}

impl From<&FlightState> for TruthRow {
    fn from(s: &FlightState) -> Self {
        let (p, v, e, w) = (s.position_in_world_m, s.velocity_in_body_m_s, s.attitude, s.rates_rad_s);
        let (f, a, d) = (s.flap, s.velocity_rate_m_s2, s.angular_acceleration_rad_s2);
        Self {
            t_s: s.t_s,
            x_m: p.x,
            y_m: p.y,
            z_m: p.z,
            u_m_s: v.x,
            v_m_s: v.y,
            w_m_s: v.z,
            phi_rad: e.phi_rad,
            theta_rad: e.theta_rad,
            psi_rad: e.psi_rad,
            p_rad_s: w.x,
            q_rad_s: w.y,
            r_rad_s: w.z,
            alpha_l_rad: f.alpha_l_rad,
            beta_l_rad: f.beta_l_rad,
            alpha_f_rad: f.alpha_f_rad,
            beta_f_rad: f.beta_f_rad,
            du_m_s2: a.x,
            dv_m_s2: a.y,
            dw_m_s2: a.z,
            dp_rad_s2: d.x,
            dq_rad_s2: d.y,
            dr_rad_s2: d.z,
        }
    }
}

/// Twelve decimals: a picometre, and beyond what any reader of these tables resolves.
fn write_numbers(
    path: &Path,
    columns: &[&str],
    rows: impl Iterator<Item = Vec<f64>>,
) -> Result<(), SessionError> {
    let mut text = columns.join(",") + "\n";
    for row in rows {
        let cells: Vec<String> = row.iter().map(|x| format!("{x:.12}")).collect();
        text += &cells.join(",");
        text.push('\n');
    }
    write_whole(path, text.as_bytes())
}

/// Writes surveyed control points.
///
/// # Errors
/// What the file system refuses.
pub fn write_control_points(path: &Path, points: &[ControlPointRow]) -> Result<(), SessionError> {
    let surveyed = points.iter().any(|p| p.std_m > 0.0);
    let mut columns = CONTROL_COLUMNS.to_vec();
    columns.extend(surveyed.then_some(SURVEY_COLUMN));
    let mut text = columns.join(",") + "\n";
    for p in points {
        let [x, y, z] = p.position_m;
        let std = if surveyed { format!(",{}", p.std_m) } else { String::new() };
        let name = csv_cell(&p.name);
        text += &format!("{name},{x},{y},{z},{},{}{std}\n", p.diameter_m, p.color);
    }
    write_whole(path, text.as_bytes())
}

/// Writes a vehicle file.
///
/// # Errors
/// What the file system refuses.
pub fn write_vehicle(path: &Path, vehicle: &Vehicle) -> Result<(), SessionError> {
    write_toml(path, vehicle)
}

/// Writes a session file; its paths are written as given, relative ones relative to the file.
///
/// # Errors
/// What the file system refuses.
pub fn write_session(path: &Path, session: &SessionFile) -> Result<(), SessionError> {
    write_toml(path, session)
}

/// Writes anything as TOML.
pub(crate) fn write_toml(path: &Path, value: &impl serde::Serialize) -> Result<(), SessionError> {
    let text = toml::to_string(value)
        .map_err(|e| SessionError::io(path, "express it as TOML", std::io::Error::other(e.to_string())))?;
    write_whole(path, text.as_bytes())
}
