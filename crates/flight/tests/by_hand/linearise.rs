//! Exact derivatives of the equations of motion with respect to state and coefficients.

use super::HelicopterInput;
use super::{Airframe, COEFFICIENTS, Coefficient as C, Coefficients, Effect, FLIGHT_STATES, StateVector};
use mavsight_geometry::{Matrix3, Vector3};
use nalgebra::{Matrix3x4, SMatrix, Vector4};

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

    fn zeros() -> Self {
        Self {
            by_state: [[0.0; FLIGHT_STATES]; FLIGHT_STATES],
            by_coefficient: [[0.0; COEFFICIENTS]; FLIGHT_STATES],
        }
    }

    fn set<const N: usize>(&mut self, row: usize, column: usize, m: &SMatrix<f64, 3, N>) {
        for (i, values) in m.row_iter().enumerate() {
            values.iter().enumerate().for_each(|(j, value)| self.by_state[row + i][column + j] = *value);
        }
    }

    fn flapping(&mut self, c: &Coefficients, input: &HelicopterInput, y: &StateVector) {
        let kb = c.get(C::SwashplateGain);
        let lower = (C::TauLower, c.get(C::TauLower));
        let flybar = (C::TauFlybar, c.get(C::TauFlybar));
        for (row, rate, (which, tau_s), delta_rad) in [
            (13, 11, lower, input.delta_lon_rad),
            (14, 10, lower, input.delta_lat_rad),
            (15, 11, flybar, 0.0),
            (16, 10, flybar, 0.0),
        ] {
            self.by_state[row][row] = -1.0 / tau_s;
            self.by_state[row][rate] = -1.0;
            self.by_coefficient[row][which as usize] = (y[row] - kb * delta_rad) / (tau_s * tau_s);
            self.by_coefficient[row][C::SwashplateGain as usize] = delta_rad / tau_s;
        }
    }

    fn kinematics(&mut self, q: &Vector4<f64>, velocity: &Vector3<f64>, rates: &Vector3<f64>) {
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
        self.set(0, 3, &by_q);
        self.set(0, 7, &rotation);
        self.set(4, 4, &(rates.cross_matrix() * -0.5));
        self.set(4, 10, &((Matrix3::identity() * w + u.cross_matrix()) * 0.5));
        for j in 0..3 {
            self.by_state[3][4 + j] = -0.5 * rates[j];
            self.by_state[4 + j][3] = 0.5 * rates[j];
            self.by_state[3][10 + j] = -0.5 * u[j];
        }
        for i in 0..4 {
            self.by_state[3 + i][3 + i] += 0.5 * (1.0 - n2);
            (0..4).for_each(|j| self.by_state[3 + i][3 + j] -= q[i] * q[j]);
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
    /// Derivatives of [`Airframe::derivative`] with respect to state and coefficients.
    pub fn linearise(&self, c: &Coefficients, input: &HelicopterInput, y: &StateVector) -> Linearisation {
        let mut out = Linearisation::zeros();
        let q = Vector4::new(y[3], y[4], y[5], y[6]);
        let velocity = Vector3::new(y[7], y[8], y[9]);
        let rates = Vector3::new(y[10], y[11], y[12]);
        out.kinematics(&q, &velocity, &rates);
        out.set(7, 7, &-rates.cross_matrix());
        out.set(7, 10, &velocity.cross_matrix());
        let conjugate = Vector4::new(q[0], -q[1], -q[2], -q[3]);
        let mut by_q = d_turned(&conjugate, &Vector3::new(0.0, 0.0, self.gravity_m_s2));
        (1..4).for_each(|k| by_q.column_mut(k).neg_mut());
        out.set(7, 3, &by_q);
        let i = &self.inertia_kg_m2;
        let mut by_rates =
            i.component_mul(&rates).cross_matrix() - rates.cross_matrix() * Matrix3::from_diagonal(i);
        by_rates.column_iter_mut().for_each(|mut c| c.component_div_assign(i));
        out.set(10, 10, &by_rates);
        out.flapping(c, input, y);
        self.add_effects(c, input, y, &mut out);
        out
    }

    fn add_effects(
        &self,
        c: &Coefficients,
        input: &HelicopterInput,
        y: &StateVector,
        out: &mut Linearisation,
    ) {
        for Effect { row, which, state, per_unit } in self.effects(input) {
            let by_coefficient = &mut out.by_coefficient[row];
            let Some(k) = state else {
                by_coefficient[which as usize] += per_unit;
                continue;
            };
            by_coefficient[which as usize] += per_unit * c.disc_per_state(k) * y[k];
            if k >= 15 {
                by_coefficient[C::FlybarGain as usize] += per_unit * c.get(which) * y[k];
            }
            out.by_state[row][k] += per_unit * c.get(which) * c.disc_per_state(k);
        }
    }
}
