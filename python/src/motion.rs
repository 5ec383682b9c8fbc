//! The smoother on arrays.

use mavsight::geometry::{EulerAngles, Isometry3, Vector3, world_from_body};
use mavsight::pose::{
    Motion as Smoothed, MotionSample, PoseError, PoseEstimate, PoseSample, covariance_from_std, euler_std,
};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Times that nanoseconds can count, either way, and their differences.
const LATEST_S: f64 = 4.6e9;

/// Columns of a pose, and of all that is smoothed.
const POSE: usize = 6;
const ALL: usize = 18;

/// Times, values, standard deviations, bandwidths.
type MotionArrays<'py> =
    (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, (f64, f64));

/// Motion of an aircraft, a row an instant. Columns of `state` and `std` are those of `Motion.columns`.
#[pyclass(frozen, module = "mavsight._mavsight")]
pub(crate) struct Motion {
    t_s: Vec<f64>,
    state: Vec<f64>,
    std: Vec<f64>,
    bandwidth_hz: (f64, f64),
}

#[pymethods]
impl Motion {
    /// Names of the columns of `state` and `std`.
    #[classattr]
    fn columns() -> Vec<&'static str> {
        vec![
            "x_m",
            "y_m",
            "z_m",
            "phi_rad",
            "theta_rad",
            "psi_rad",
            "u_m_s",
            "v_m_s",
            "w_m_s",
            "p_rad_s",
            "q_rad_s",
            "r_rad_s",
            "a_x_m_s2",
            "a_y_m_s2",
            "a_z_m_s2",
            "p_dot_rad_s2",
            "q_dot_rad_s2",
            "r_dot_rad_s2",
        ]
    }

    /// A motion from its arrays: n times, (n, 18) values and standard deviations.
    #[new]
    fn new(
        t_s: PyReadonlyArray1<'_, f64>,
        state: PyReadonlyArray2<'_, f64>,
        std: PyReadonlyArray2<'_, f64>,
        bandwidth_hz: (f64, f64),
    ) -> PyResult<Self> {
        let n = t_s.len();
        for (name, shape) in [("state", state.shape()), ("std", std.shape())] {
            if *shape != [n, ALL] {
                return Err(PyValueError::new_err(format!(
                    "{name} has the shape {shape:?}: ({n}, {ALL}) is wanted"
                )));
            }
        }
        let all = |table: PyReadonlyArray2<'_, f64>| table.as_array().iter().copied().collect();
        Ok(Self { t_s: t_s.as_array().to_vec(), state: all(state), std: all(std), bandwidth_hz })
    }

    /// What makes the same motion again: it can be pickled, and so sent from one machine to another.
    fn __getnewargs__<'py>(&self, py: Python<'py>) -> PyResult<MotionArrays<'py>> {
        Ok((self.t_s(py), self.state(py)?, self.std(py)?, self.bandwidth_hz))
    }

    /// Times, s.
    #[getter]
    fn t_s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.t_s)
    }

    /// Pose, velocity and rates in body axes, specific force and angular acceleration.
    #[getter]
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        PyArray1::from_slice(py, &self.state).reshape([self.t_s.len(), ALL])
    }

    /// Their standard deviations.
    #[getter]
    fn std<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        PyArray1::from_slice(py, &self.std).reshape([self.t_s.len(), ALL])
    }

    /// Frequencies at which the smoother passes one half, of position and of attitude, Hz.
    #[getter]
    fn bandwidth_hz(&self) -> (f64, f64) {
        self.bandwidth_hz
    }

    fn __len__(&self) -> usize {
        self.t_s.len()
    }
}

impl From<Smoothed> for Motion {
    fn from(motion: Smoothed) -> Self {
        Self {
            t_s: motion.samples.iter().map(|s| s.t_ns as f64 * 1e-9).collect(),
            state: motion.samples.iter().flat_map(values).collect(),
            std: motion.samples.iter().flat_map(stds).collect(),
            bandwidth_hz: (motion.translation_bandwidth_hz, motion.rotation_bandwidth_hz),
        }
    }
}

fn values(s: &MotionSample) -> [f64; ALL] {
    let e = EulerAngles::from_world_from_body(&s.world_from_body);
    let parts = [
        s.world_from_body.translation.vector,
        Vector3::new(e.phi_rad, e.theta_rad, e.psi_rad),
        s.velocity_in_body_m_s,
        s.rates_rad_s,
        s.specific_force_m_s2,
        s.angular_acceleration_rad_s2,
    ];
    std::array::from_fn(|k| parts[k / 3][k % 3])
}

fn stds(s: &MotionSample) -> [f64; ALL] {
    let euler = euler_std(&s.world_from_body, &s.covariance.pose().fixed_view::<3, 3>(3, 3).into_owned());
    std::array::from_fn(|k| {
        if (3..POSE).contains(&k) { euler[k - 3] } else { s.covariance.variance(k).max(0.0).sqrt() }
    })
}

/// Smooths poses into motion, as `mavsight run` does: strength of the jerk and level of the noise from the data.
///
/// t_s: n rising times. pose: (n, 6) x, y, z (m, world axes), roll, pitch, yaw (rad); a row that is not a number was not
/// measured. std: (n, 6), their standard deviations; one level for all is enough, since a factor on it is estimated.
#[pyfunction]
#[pyo3(signature = (t_s, pose, std, gravity_m_s2=9.81))]
pub(crate) fn smooth(
    py: Python<'_>,
    t_s: PyReadonlyArray1<'_, f64>,
    pose: PyReadonlyArray2<'_, f64>,
    std: PyReadonlyArray2<'_, f64>,
    gravity_m_s2: f64,
) -> PyResult<Motion> {
    let wrong = |what: String| PyValueError::new_err(what);
    let n = t_s.len();
    for (name, shape) in [("pose", pose.shape()), ("std", std.shape())] {
        if *shape != [n, POSE] {
            return Err(wrong(format!(
                "{name} has the shape {shape:?}: ({n}, {POSE}) is wanted, a row for each time"
            )));
        }
    }
    let (t_s, pose, std) = (t_s.as_array(), pose.as_array(), std.as_array());
    let mut samples = Vec::with_capacity(n);
    for k in 0..n {
        let value: [f64; POSE] = std::array::from_fn(|j| pose[[k, j]]);
        let spread: [f64; POSE] = std::array::from_fn(|j| std[[k, j]]);
        let measured = value.iter().all(|v| v.is_finite());
        if !(t_s[k].abs() < LATEST_S) || (measured && !spread.iter().all(|s| *s > 0.0 && s.is_finite())) {
            return Err(wrong(format!(
                "row {k}: times must be numbers of seconds below {LATEST_S}, and standard deviations numbers above zero"
            )));
        }
        let t_ns = (t_s[k] * 1e9).round() as i64;
        let estimate = measured.then(|| estimate(&value, &spread)).ok_or(PoseError::NotMeasured);
        samples.push(PoseSample { t_ns, estimate });
    }
    let motion = py.detach(|| mavsight::pose::smooth(&samples, gravity_m_s2));
    motion.map(Motion::from).map_err(|e| wrong(e.to_string()))
}

fn estimate(value: &[f64; POSE], spread: &[f64; POSE]) -> PoseEstimate {
    let angles = EulerAngles { phi_rad: value[3], theta_rad: value[4], psi_rad: value[5] };
    let world_from_body: Isometry3<f64> = world_from_body(Vector3::new(value[0], value[1], value[2]), angles);
    PoseEstimate::new(world_from_body, &covariance_from_std(&world_from_body, spread))
}
