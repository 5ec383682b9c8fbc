//! Exact derivatives of the equations of motion with respect to state and coefficients.

use super::{Airframe, COEFFICIENTS, Coefficient as C, Coefficients, FLIGHT_STATES, StateVector};
use crate::InputSample;
use mavsight_geometry::{Matrix3, Vector3};
use nalgebra::{Matrix3x4, RowVector3, Vector4};

/// Derivatives of [`Airframe::derivative`] at one state.
#[derive(Debug, Clone)]
pub struct Linearisation {
    /// By the state: row the rate, column the state. Zero outside [`Linearisation::COLUMNS`].
    pub by_state: [[f64; FLIGHT_STATES]; FLIGHT_STATES],
    /// By the coefficients: row the rate.
    pub by_coefficient: [[f64; COEFFICIENTS]; FLIGHT_STATES],
}

const POSITION: &[usize] = &[3, 4, 5, 6, 7, 8, 9];
const TURN: &[usize] = &[3, 4, 5, 6, 10, 11, 12];

impl Linearisation {
    /// The states that the rate of each state may depend on.
    pub const COLUMNS: [&'static [usize]; FLIGHT_STATES] = [
        POSITION,
        POSITION,
        POSITION,
        TURN,
        TURN,
        TURN,
        TURN,
        &[3, 4, 5, 6, 7, 8, 9, 11, 12, 13, 15],
        &[3, 4, 5, 6, 7, 8, 9, 10, 12, 14, 16],
        &[3, 4, 5, 6, 7, 8, 9, 10, 11],
        &[8, 10, 11, 12, 14, 16],
        &[7, 9, 10, 11, 12, 13, 15],
        &[10, 11, 12],
        &[11, 13],
        &[10, 14],
        &[11, 15],
        &[10, 16],
    ];

    /// All zero, to be filled by [`Airframe::linearise`].
    pub fn zeros() -> Self {
        Self {
            by_state: [[0.0; FLIGHT_STATES]; FLIGHT_STATES],
            by_coefficient: [[0.0; COEFFICIENTS]; FLIGHT_STATES],
        }
    }

    fn set3(&mut self, (row, column): (usize, usize), m: &Matrix3<f64>) {
        for i in 0..3 {
            for j in 0..3 {
                self.by_state[row + i][column + j] = m[(i, j)];
            }
        }
    }

    fn set34(&mut self, (row, column): (usize, usize), m: &Matrix3x4<f64>) {
        for i in 0..3 {
            for j in 0..4 {
                self.by_state[row + i][column + j] = m[(i, j)];
            }
        }
    }
}

/// d(R(q/|q|) v)/dq with q as w, x, y, z.
fn d_turned(q: &Vector4<f64>, v: &Vector3<f64>) -> Matrix3x4<f64> {
    let (w, u) = (q[0], Vector3::new(q[1], q[2], q[3]));
    let n2 = q.norm_squared();
    let turned = (v * (w * w - u.dot(&u)) + u * (2.0 * u.dot(v)) + u.cross(v) * (2.0 * w)) / n2;
    let by_w = (v * w + u.cross(v)) * 2.0;
    let by_u =
        (u * v.transpose() - v * u.transpose() + Matrix3::identity() * u.dot(v) - v.cross_matrix() * w) * 2.0;
    let mut out = Matrix3x4::zeros();
    out.set_column(0, &by_w);
    out.fixed_view_mut::<3, 3>(0, 1).copy_from(&by_u);
    (out - turned * q.transpose() * 2.0) / n2
}

impl Airframe {
    /// Derivatives of [`Airframe::derivative`] with respect to state and coefficients, written into `out`, of
    /// which only the entries that can differ from zero are touched.
    pub fn linearise(&self, c: &Coefficients, input: &InputSample, y: &StateVector, out: &mut Linearisation) {
        let q = Vector4::new(y[3], y[4], y[5], y[6]);
        let velocity = Vector3::new(y[7], y[8], y[9]);
        let rates = Vector3::new(y[10], y[11], y[12]);
        self.kinematics(&q, &velocity, &rates, out);
        let drag = Matrix3::identity() * (c.get(C::CxU) * self.scales(input).reference_n / self.mass_kg);
        out.set3((7, 7), &(drag - rates.cross_matrix()));
        out.set3((7, 10), &velocity.cross_matrix());
        let conjugate = Vector4::new(q[0], -q[1], -q[2], -q[3]);
        let mut by_q = d_turned(&conjugate, &Vector3::new(0.0, 0.0, self.gravity_m_s2));
        for k in 1..4 {
            by_q.column_mut(k).neg_mut();
        }
        out.set34((7, 3), &by_q);
        self.loads_by_state(c, input, &rates, out);
        self.by_coefficient(c, input, y, out);
        let flap = [
            (13, 11, c.get(C::TauLower)),
            (14, 10, c.get(C::TauLower)),
            (15, 11, c.get(C::TauFlybar)),
            (16, 10, c.get(C::TauFlybar)),
        ];
        for (row, rate, tau_s) in flap {
            out.by_state[row][row] = -1.0 / tau_s;
            out.by_state[row][rate] = -1.0;
        }
    }

    fn kinematics(
        &self,
        q: &Vector4<f64>,
        velocity: &Vector3<f64>,
        rates: &Vector3<f64>,
        out: &mut Linearisation,
    ) {
        let mut by_q = d_turned(q, velocity);
        let (w, u) = (q[0], Vector3::new(q[1], q[2], q[3]));
        let n2 = q.norm_squared();
        let mut rotation = (Matrix3::identity() * (w * w - u.dot(&u))
            + u * u.transpose() * 2.0
            + u.cross_matrix() * (2.0 * w))
            / n2;
        for row in 1..3 {
            by_q.row_mut(row).neg_mut();
            rotation.row_mut(row).neg_mut();
        }
        out.set34((0, 3), &by_q);
        out.set3((0, 7), &rotation);
        let spin = rates.cross_matrix();
        let by_rates = Matrix3::identity() * w + u.cross_matrix();
        let row: RowVector3<f64> = u.transpose();
        for j in 0..3 {
            out.by_state[3][4 + j] = -0.5 * rates[j];
            out.by_state[4 + j][3] = 0.5 * rates[j];
            out.by_state[3][10 + j] = -0.5 * row[j];
            for i in 0..3 {
                out.by_state[4 + i][4 + j] = -0.5 * spin[(i, j)];
                out.by_state[4 + i][10 + j] = 0.5 * by_rates[(i, j)];
            }
        }
        out.by_state[3][3] = 0.0;
        for i in 0..4 {
            out.by_state[3 + i][3 + i] += 0.5 * (1.0 - n2);
            for j in 0..4 {
                out.by_state[3 + i][3 + j] -= q[i] * q[j];
            }
        }
    }

    fn loads_by_state(
        &self,
        c: &Coefficients,
        input: &InputSample,
        rates: &Vector3<f64>,
        out: &mut Linearisation,
    ) {
        let s = self.scales(input);
        let ku = c.get(C::FlybarGain);
        let force_l = c.get(C::CxAlphaL) * s.lower_n / self.mass_kg;
        let force_f = ku * c.get(C::CxAlphaU) * s.upper_n / self.mass_kg;
        out.by_state[7][13] = force_l;
        out.by_state[7][15] = force_f;
        out.by_state[8][14] = -force_l;
        out.by_state[8][16] = -force_f;
        let i = &self.inertia_kg_m2;
        let re = s.reference_n * self.radius_m;
        let momentum = i.component_mul(rates);
        let mut by_rates = momentum.cross_matrix() - rates.cross_matrix() * Matrix3::from_diagonal(i);
        for (k, which) in [C::ClP, C::CmQ, C::CnR].into_iter().enumerate() {
            by_rates[(k, k)] += c.get(which) * re;
        }
        for k in 0..3 {
            by_rates.row_mut(k).scale_mut(1.0 / i[k]);
        }
        out.set3((10, 10), &by_rates);
        let moment_l = self.radius_m * (c.get(C::CmAlphaL) * s.lower_n + c.get(C::CmHub) * s.reference_n);
        let moment_f =
            ku * self.radius_m * (c.get(C::CmAlphaU) * s.upper_n + c.get(C::CmHub) * s.reference_n);
        out.by_state[10][14] = moment_l / i.x;
        out.by_state[10][16] = moment_f / i.x;
        out.by_state[11][13] = moment_l / i.y;
        out.by_state[11][15] = moment_f / i.y;
        out.by_state[10][8] = -c.get(C::CmU) * re / i.x;
        out.by_state[11][7] = c.get(C::CmU) * re / i.y;
        out.by_state[11][9] = c.get(C::CmW) * re / i.y;
    }

    fn by_coefficient(
        &self,
        c: &Coefficients,
        input: &InputSample,
        y: &StateVector,
        out: &mut Linearisation,
    ) {
        let s = self.scales(input);
        let ku = c.get(C::FlybarGain);
        let m = 1.0 / self.mass_kg;
        let i = self.inertia_kg_m2.map(|v| self.radius_m / v);
        let (up, lo, re) = (s.upper_n, s.lower_n, s.reference_n);
        let (tau_l, tau_f) = (c.get(C::TauLower), c.get(C::TauFlybar));
        let upper_turn = c.get(C::CmAlphaU) * up + c.get(C::CmHub) * re;
        let entries = [
            (7, C::CxAlphaU, m * up * ku * y[15]),
            (8, C::CxAlphaU, -m * up * ku * y[16]),
            (7, C::CxAlphaL, m * lo * y[13]),
            (8, C::CxAlphaL, -m * lo * y[14]),
            (9, C::CzU, m * up),
            (9, C::CzL, m * lo),
            (10, C::CmAlphaU, i.x * up * ku * y[16]),
            (11, C::CmAlphaU, i.y * up * ku * y[15]),
            (10, C::CmAlphaL, i.x * lo * y[14]),
            (11, C::CmAlphaL, i.y * lo * y[13]),
            (10, C::CmHub, i.x * re * (y[14] + ku * y[16])),
            (11, C::CmHub, i.y * re * (y[13] + ku * y[15])),
            (10, C::ClP, i.x * re * y[10]),
            (11, C::CmQ, i.y * re * y[11]),
            (12, C::CnR, i.z * re * y[12]),
            (10, C::CmU, -i.x * re * y[8]),
            (11, C::CmU, i.y * re * y[7]),
            (11, C::CmW, i.y * re * y[9]),
            (12, C::CnUpper, i.z * up),
            (12, C::CnLower, i.z * lo),
            (7, C::CxU, m * re * y[7]),
            (8, C::CxU, m * re * y[8]),
            (9, C::CxU, m * re * y[9]),
            (7, C::Cx0, m * re),
            (8, C::Cy0, m * re),
            (9, C::Cz0, m * re),
            (10, C::Cl0, i.x * re),
            (11, C::Cm0, i.y * re),
            (12, C::Cn0, i.z * re),
            (13, C::TauLower, -(c.get(C::SwashplateGain) * input.delta_lon_rad - y[13]) / (tau_l * tau_l)),
            (14, C::TauLower, -(c.get(C::SwashplateGain) * input.delta_lat_rad - y[14]) / (tau_l * tau_l)),
            (15, C::TauFlybar, y[15] / (tau_f * tau_f)),
            (16, C::TauFlybar, y[16] / (tau_f * tau_f)),
            (13, C::SwashplateGain, input.delta_lon_rad / tau_l),
            (14, C::SwashplateGain, input.delta_lat_rad / tau_l),
            (7, C::FlybarGain, m * c.get(C::CxAlphaU) * up * y[15]),
            (8, C::FlybarGain, -m * c.get(C::CxAlphaU) * up * y[16]),
            (10, C::FlybarGain, i.x * upper_turn * y[16]),
            (11, C::FlybarGain, i.y * upper_turn * y[15]),
        ];
        for (row, which, value) in entries {
            out.by_coefficient[row][which as usize] = value;
        }
    }
}
