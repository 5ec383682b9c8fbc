//! Coefficients and regressors of equation 3 from motion and inputs.

use crate::IdentifyError;
use mavsight_flight::flapping::{self, Between};
use mavsight_flight::{InputSeries, Vehicle, thrust_n};
use mavsight_pose::{Motion, lowpass_like};
use std::f64::consts::PI;

/// One regressor over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Name: `0`, `alpha_u`, `alpha_l`, `q`, `delta_lon`, `T_u`, `T_l`.
    pub name: String,
    /// Values at the table's times.
    pub values: Vec<f64>,
    /// Standard deviation of their error; 0 where the column is exact.
    pub std: f64,
}

/// One coefficient over time with its regressors, which have passed the same low-pass.
#[derive(Debug, Clone, PartialEq)]
pub struct Output {
    /// `C_X`, `C_Z` or `C_m`.
    pub name: String,
    /// Values at the table's times.
    pub values: Vec<f64>,
    /// Standard deviation of their error, at each time.
    pub std: Vec<f64>,
    /// Regressors.
    pub columns: Vec<Column>,
    /// Frequency at which both sides are passed by one half.
    pub bandwidth_hz: f64,
}

/// Coefficients and regressors of a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct CoefficientTable {
    /// Times.
    pub t_s: Vec<f64>,
    /// Outputs.
    pub outputs: Vec<Output>,
    /// First and last time that is fitted.
    pub window_s: (f64, f64),
    /// Median interval of the times.
    pub sample_interval_s: f64,
}

impl CoefficientTable {
    /// Indices of the times that are fitted.
    pub fn rows_in_window(&self) -> Vec<usize> {
        const ROUNDING_S: f64 = 1e-9;
        let (from_s, to_s) = (self.window_s.0 - ROUNDING_S, self.window_s.1 + ROUNDING_S);
        (0..self.t_s.len()).filter(|i| self.t_s[*i] >= from_s && self.t_s[*i] <= to_s).collect()
    }

    /// Rows over which errors behind a low-pass are correlated: about one period of its cut-off frequency, at most a
    /// quarter of the rows.
    pub(crate) fn correlated_rows(&self, bandwidth_hz: f64, rows: usize) -> usize {
        (1.0 / (bandwidth_hz * self.sample_interval_s)).ceil().min(rows as f64 / 4.0).max(1.0) as usize
    }
}

/// What a user may choose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Left out at either end, where a smoother leans on one side only: half a second is one to two periods of the
    /// cut-off frequencies that ordinary cameras allow.
    pub margin_s: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { margin_s: 0.5 }
    }
}

/// Forms C_X, C_Z and C_m (equation 4, with q̇ in place of the misprinted q) and the regressors of equation 3.
///
/// C_X, C_Z = m a/(½ρπR⁴ω²) with a the specific force and ω the mean rotor speed, C_m = I_yy q̇/(½ρπR⁵ω²). The flapping
/// angles are integrated from the smoothed rate and the recorded swash-plate (equation 2), from trim. What the
/// swash-plate drives directly passes the low-pass of the smoother ([`mavsight_pose::lowpass_like`]), at the bandwidth of
/// translation for forces and of rotation for the moment; what the rate drives has passed it already.
///
/// Valid for flights that begin in trim, with flapping times that are known.
///
/// # Errors
/// Inputs that do not cover the flight, rotors that stand still, fewer than eight samples in the window.
pub fn coefficients(
    motion: &Motion,
    inputs: &InputSeries,
    vehicle: &Vehicle,
    options: &Options,
) -> Result<CoefficientTable, IdentifyError> {
    let t_s: Vec<f64> = motion.samples.iter().map(|s| s.t_ns as f64 * 1e-9).collect();
    let (Some(first_s), Some(last_s)) = (t_s.first().copied(), t_s.last().copied()) else {
        return Err(IdentifyError::TooFewInstants { found: 0, parameters: 7 });
    };
    let scale = force_scales_n(&t_s, inputs, vehicle)?;
    let q: Vec<f64> = motion.samples.iter().map(|s| s.rates_rad_s.y).collect();
    let q_dot: Vec<f64> = motion.samples.iter().map(|s| s.angular_acceleration_rad_s2.y).collect();
    let sources = Sources { t_s: &t_s, q: &q, q_dot: &q_dot, motion, inputs, vehicle };
    let inertia = vehicle.inertia_kg_m2[1] / vehicle.rotor.radius_m;
    let plan = [
        ("C_X", motion.translation_bandwidth_hz, vehicle.mass_kg, 12),
        ("C_Z", motion.translation_bandwidth_hz, vehicle.mass_kg, 14),
        ("C_m", motion.rotation_bandwidth_hz, inertia, 16),
    ];
    let mut outputs = Vec::with_capacity(plan.len());
    for (name, bandwidth_hz, factor, index) in plan {
        let value = |k: usize| {
            let s = &motion.samples[k];
            match index {
                12 => s.specific_force_m_s2.x,
                14 => s.specific_force_m_s2.z,
                _ => s.angular_acceleration_rad_s2.y,
            }
        };
        let std = |k: usize| motion.samples[k].covariance[(index, index)].max(0.0).sqrt();
        outputs.push(Output {
            name: name.to_owned(),
            values: (0..t_s.len()).map(|k| factor * value(k) / scale[k]).collect(),
            std: (0..t_s.len()).map(|k| factor * std(k) / scale[k]).collect(),
            columns: sources.columns(bandwidth_hz)?,
            bandwidth_hz,
        });
    }
    let margin_s = options.margin_s.clamp(0.0, (last_s - first_s) / 4.0);
    let window_s = (first_s + margin_s, last_s - margin_s);
    Ok(CoefficientTable { t_s, outputs, window_s, sample_interval_s: motion.sample_interval_s })
}

/// ½ρπR⁴ω² at each time.
fn force_scales_n(t_s: &[f64], inputs: &InputSeries, vehicle: &Vehicle) -> Result<Vec<f64>, IdentifyError> {
    let per_omega2 = 0.5 * vehicle.environment.air_density_kg_m3 * PI * vehicle.rotor.radius_m.powi(4);
    t_s.iter()
        .map(|t| {
            let input = inputs.require(*t)?;
            let omega_rad_s = 0.5 * (input.omega_u_rad_s + input.omega_l_rad_s);
            if omega_rad_s.abs() < 1.0 {
                return Err(IdentifyError::RotorsStopped { t_s: *t, omega_rad_s });
            }
            Ok(per_omega2 * omega_rad_s * omega_rad_s)
        })
        .collect()
}

struct Sources<'a> {
    t_s: &'a [f64],
    q: &'a [f64],
    q_dot: &'a [f64],
    motion: &'a Motion,
    inputs: &'a InputSeries,
    vehicle: &'a Vehicle,
}

impl Sources<'_> {
    /// The seven regressors, low-passed at a bandwidth.
    fn columns(&self, bandwidth_hz: f64) -> Result<Vec<Column>, IdentifyError> {
        let rotor = &self.vehicle.rotor;
        let samples = self.inputs.samples();
        let flybar = flapping::from_rate(self.t_s, self.q, self.q_dot, rotor.flap_time_flybar_s);
        let lower_rate = flapping::from_rate(self.t_s, self.q, self.q_dot, rotor.flap_time_lower_s);
        let (lower_swash, _) = flapping::lower_from_swashplate(self.inputs, rotor);
        let lower_swash = self.onto_frames(&lower_swash, Between::Line, bandwidth_hz)?;
        let delta: Vec<f64> = samples.iter().map(|s| s.delta_lon_rad).collect();
        let upper: Vec<f64> = samples.iter().map(|s| thrust_n(self.vehicle, s).upper_n).collect();
        let lower: Vec<f64> = samples.iter().map(|s| thrust_n(self.vehicle, s).lower_n).collect();
        let (turn_std, rate_std) = self.errors();
        let column = |name: &str, values: Vec<f64>, std: f64| Column { name: name.to_owned(), values, std };
        Ok(vec![
            column("0", vec![1.0; self.t_s.len()], 0.0),
            // The fly-bar's slow lag makes alpha_f follow minus the attitude, and its error that of the attitude.
            column(
                "alpha_u",
                flybar.iter().map(|a| rotor.flybar_gain * a).collect(),
                rotor.flybar_gain.abs() * turn_std,
            ),
            column(
                "alpha_l",
                lower_swash.iter().zip(&lower_rate).map(|(a, b)| a + b).collect(),
                rotor.flap_time_lower_s * rate_std,
            ),
            column("q", self.q.to_vec(), rate_std),
            column("delta_lon", self.onto_frames(&delta, Between::Hold, bandwidth_hz)?, 0.0),
            column("T_u", self.onto_frames(&upper, Between::Hold, bandwidth_hz)?, 0.0),
            column("T_l", self.onto_frames(&lower, Between::Hold, bandwidth_hz)?, 0.0),
        ])
    }

    /// Root mean square standard deviation of the smoothed turn and rate about the pitch axis.
    fn errors(&self) -> (f64, f64) {
        let mean = |index: usize| {
            let sum: f64 = self.motion.samples.iter().map(|s| s.covariance[(index, index)].max(0.0)).sum();
            (sum / self.motion.samples.len().max(1) as f64).sqrt()
        };
        (mean(4), mean(10))
    }

    /// A series on the inputs' times, low-passed on a regular grid of their mean interval and read off at the frames.
    ///
    /// A series that holds steps at a grid point: its value there is the mean of what it steps from and to.
    fn onto_frames(
        &self,
        series: &[f64],
        between: Between,
        bandwidth_hz: f64,
    ) -> Result<Vec<f64>, IdentifyError> {
        let first = series.first().copied().unwrap_or(0.0);
        if series.iter().all(|v| *v == first) {
            return Ok(vec![first; self.t_s.len()]);
        }
        let times_s: Vec<f64> = self.inputs.samples().iter().map(|s| s.t_s).collect();
        let (start_s, end_s) = (self.inputs.start_s(), self.inputs.end_s());
        let step_s = (end_s - start_s) / (times_s.len() - 1) as f64;
        let grid_s: Vec<f64> = (0..times_s.len()).map(|k| start_s + step_s * k as f64).collect();
        let held_at = |t_s: f64| series[times_s.partition_point(|t| *t <= t_s).max(1) - 1];
        let regular = grid_s
            .iter()
            .map(|t_s| match between {
                Between::Hold => Ok(0.5 * (held_at(t_s + 0.5 * step_s) + held_at(t_s - 0.5 * step_s))),
                Between::Line => flapping::interpolate(&times_s, series, *t_s),
            })
            .collect::<Result<Vec<f64>, _>>()?;
        let smooth = lowpass_like(&regular, step_s, bandwidth_hz);
        self.t_s
            .iter()
            .map(|t| flapping::interpolate(&grid_s, &smooth, *t).map_err(IdentifyError::from))
            .collect()
    }
}
