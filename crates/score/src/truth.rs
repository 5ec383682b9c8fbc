//! Truth files: the simulator's own values, which scoring alone reads.

use mavsight_flight::Vehicle;
use mavsight_session::{Session, SessionError, Table, csv_cell, write_numbers, write_whole};
use mavsight_simulator::FlightState;
use std::path::Path;

/// Declares the truth's row and its columns together, so that they cannot drift apart.
macro_rules! truth_row {
    ($($(#[$doc:meta])* $field:ident),+ $(,)?) => {
        /// The true state at one instant, for scoring.
        #[derive(Debug, Clone, Copy, PartialEq, Default)]
        pub struct TruthRow { $($(#[$doc])* pub $field: f64,)+ }

        /// Columns of the truth.
        const TRUTH_COLUMNS: &[&str] = &[$(stringify!($field)),+];

        impl TruthRow {
            fn values(&self) -> Vec<f64> { vec![$(self.$field),+] }
        }

        /// Reads the truth table; other columns are ignored.
        ///
        /// # Errors
        /// Names the file, row and column.
        pub fn read_truth(path: &Path) -> Result<Vec<TruthRow>, SessionError> {
            let table = Table::read(path, "truth")?;
            $(let $field = table.column(stringify!($field))?;)+
            table.rows()?.map(|row| Ok(TruthRow { $($field: row.number($field)?),+ })).collect()
        }
    };
}

truth_row! {
    /// Time.
    t_s,
    /// Position of the centre of gravity, world axes.
    x_m,
    /// World Y.
    y_m,
    /// World Z, up.
    z_m,
    /// Velocity, body axes: forward.
    u_m_s,
    /// Right.
    v_m_s,
    /// Down.
    w_m_s,
    /// Roll.
    phi_rad,
    /// Pitch.
    theta_rad,
    /// Yaw.
    psi_rad,
    /// Roll rate.
    p_rad_s,
    /// Pitch rate.
    q_rad_s,
    /// Yaw rate.
    r_rad_s,
    /// Flapping of the lower rotor, back.
    alpha_l_rad,
    /// Flapping of the lower rotor, right.
    beta_l_rad,
    /// Flapping of the fly-bar, back.
    alpha_f_rad,
    /// Flapping of the fly-bar, right.
    beta_f_rad,
    /// Rate of u.
    du_m_s2,
    /// Rate of v.
    dv_m_s2,
    /// Rate of w.
    dw_m_s2,
    /// Rate of p.
    dp_rad_s2,
    /// Rate of q.
    dq_rad_s2,
    /// Rate of r.
    dr_rad_s2,
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

/// Name of the file, next to `truth.csv`.
pub const VISIBILITY: &str = "visibility.csv";

/// Writes which share of each ball's face each camera saw: by instant, camera and marker.
///
/// # Errors
/// What the file system refuses.
pub fn write_visibility(
    path: &Path,
    truth: &[TruthRow],
    cameras: &[String],
    vehicle: &Vehicle,
    shares: &[Vec<Vec<f64>>],
) -> Result<(), SessionError> {
    let mut text = "t_s,camera".to_owned();
    vehicle.marker.iter().for_each(|m| text += &format!(",{}", csv_cell(&m.name)));
    text.push('\n');
    for (row, of_cameras) in truth.iter().zip(shares) {
        for (camera, of_markers) in cameras.iter().zip(of_cameras) {
            text += &format!("{:.9},{}", row.t_s, csv_cell(camera));
            of_markers.iter().for_each(|share| text += &format!(",{share:.3}"));
            text.push('\n');
        }
    }
    write_whole(path, text.as_bytes())
}

/// Reads the shares of the balls' faces that each camera saw, by instant, camera and marker, in the order of
/// the rows, for a number of cameras.
///
/// # Errors
/// Names the file, row and column.
pub fn read_visibility(
    path: &Path,
    cameras: usize,
    markers: &[String],
) -> Result<Vec<Vec<Vec<f64>>>, SessionError> {
    let table = Table::read(path, "visibility")?;
    let columns = markers.iter().map(|m| table.column(m)).collect::<Result<Vec<_>, _>>()?;
    let rows = table
        .rows()?
        .map(|row| columns.iter().map(|c| row.number(*c)).collect::<Result<Vec<f64>, _>>())
        .collect::<Result<Vec<_>, _>>()?;
    Ok(rows.chunks(cameras.max(1)).map(<[Vec<f64>]>::to_vec).collect())
}

/// Reads the truth of a session, where it has one.
///
/// # Errors
/// Names row and column.
pub fn truth_of(session: &Session) -> Result<Option<Vec<TruthRow>>, SessionError> {
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
    let markers: Vec<String> = session.vehicle.marker.iter().map(|m| m.name.clone()).collect();
    read_visibility(&path, session.cameras().len(), &markers).map(Some)
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
        assert_eq!((truth[1].t_s, truth[1].z_m), (0.033333333, 1.5));
        assert!((truth[1].psi_rad + 22.5_f64.to_radians()).abs() < 1e-6);
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
