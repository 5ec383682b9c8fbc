//! The same flights smoothed by mavsight, by Savitzky-Golay filters and by quintic smoothing splines, for
//! `docs/measured.md`: `cargo run --release -p mavsight-pose --example smoothers`.

#[path = "../tests/simulated/mod.rs"]
#[allow(dead_code)]
mod simulated;

use mavsight_geometry::{EulerAngles, Vector3, world_from_body};
use mavsight_pose::{Motion, MotionSample, PoseEstimator, smooth};
use mavsight_simulator::FlightState;
use nalgebra::{DMatrix, DVector};
use simulated::{Random, error, flight, observed, poses, rigs, square, true_cameras};

const FLIGHTS: usize = 20;
const GRAVITY: f64 = 9.81;
/// Windows of the Savitzky-Golay filter that are tried, in frames.
const WINDOWS: [usize; 8] = [5, 7, 9, 11, 13, 17, 21, 27];

/// Value, first and second derivative of a series at its own times.
type Derivatives = Vec<[f64; 3]>;

/// Savitzky & Golay (1964): a cubic by least squares in a window, one-sided at the ends.
fn savitzky_golay(t_s: &[f64], y: &[f64], window: usize) -> Derivatives {
    let half = window / 2;
    (0..y.len())
        .map(|k| {
            let first = k.saturating_sub(half).min(y.len() - window);
            let dt = |i: usize| t_s[first + i] - t_s[k];
            let powers = DMatrix::from_fn(window, 4, |i, p| dt(i).powi(p as i32));
            let values = DVector::from_fn(window, |i, _| y[first + i]);
            let c = powers.svd(true, true).solve(&values, 1e-14).expect("a cubic");
            [c[0], c[1], 2.0 * c[2]]
        })
        .collect()
}

/// B-splines of degree `degree` at `t` and their derivative of the given order (Cox 1972; de Boor 1972).
fn b_spline(knots: &[f64], index: usize, degree: usize, order: usize, t: f64) -> f64 {
    if order > 0 {
        let part = |i: usize| {
            let width = knots[i + degree] - knots[i];
            if width > 0.0 { b_spline(knots, i, degree - 1, order - 1, t) / width } else { 0.0 }
        };
        return degree as f64 * (part(index) - part(index + 1));
    }
    if degree == 0 {
        let last = t >= knots[knots.len() - 1] && knots[index + 1] >= t && knots[index] < t;
        return f64::from((knots[index] <= t && t < knots[index + 1]) || last);
    }
    let ratio = |a: f64, b: f64| if b > 0.0 { a / b } else { 0.0 };
    let rise = ratio(t - knots[index], knots[index + degree] - knots[index]);
    let fall = ratio(knots[index + degree + 1] - t, knots[index + degree + 1] - knots[index + 1]);
    rise * b_spline(knots, index, degree - 1, 0, t) + fall * b_spline(knots, index + 1, degree - 1, 0, t)
}

/// The matrices of a quintic smoothing spline with a knot at each instant (Reinsch 1967; Wahba 1990): values
/// and derivatives of its basis, and the integral of the squared third derivative.
struct Quintic {
    basis: [DMatrix<f64>; 3],
    penalty: DMatrix<f64>,
}

impl Quintic {
    fn new(t_s: &[f64]) -> Self {
        let n = t_s.len();
        let mut knots = vec![t_s[0]; 5];
        knots.extend_from_slice(t_s);
        knots.extend([t_s[n - 1]; 5]);
        let size = knots.len() - 6;
        let near = |k: usize, j: usize| j + 1 >= k.saturating_sub(1) && j <= k + 6;
        let at =
            |order: usize| {
                DMatrix::from_fn(n, size, |k, j| {
                    if near(k, j) { b_spline(&knots, j, 5, order, t_s[k]) } else { 0.0 }
                })
            };
        // The third derivative is quadratic between knots: Gauss's three points integrate its square exactly.
        let mut penalty = DMatrix::zeros(size, size);
        for (k, pair) in t_s.windows(2).enumerate() {
            let (middle, half) = ((pair[0] + pair[1]) / 2.0, (pair[1] - pair[0]) / 2.0);
            for (node, weight) in
                [(-0.6_f64.sqrt(), 5.0 / 9.0), (0.0, 8.0 / 9.0), (0.6_f64.sqrt(), 5.0 / 9.0)]
            {
                let third: Vec<f64> =
                    (k..k + 6).map(|j| b_spline(&knots, j, 5, 3, middle + half * node)).collect();
                for i in 0..6 {
                    for j in 0..6 {
                        penalty[(k + i, k + j)] += weight * half * third[i] * third[j];
                    }
                }
            }
        }
        Self { basis: [at(0), at(1), at(2)], penalty }
    }

    /// The spline whose smoothing has the least generalised cross-validation (Craven & Wahba 1979).
    fn fit(&self, y: &[f64]) -> Derivatives {
        let (n, y) = (y.len() as f64, DVector::from_column_slice(y));
        let b = &self.basis[0];
        let gram = b.tr_mul(b);
        let mut best: Option<(f64, DVector<f64>)> = None;
        for step in 0..36 {
            let lambda = 10f64.powf(-12.0 + 0.25 * f64::from(step));
            let Some(factor) = (&gram + &self.penalty * lambda).cholesky() else { continue };
            let coefficients = factor.solve(&b.tr_mul(&y));
            let free = n - factor.solve(&gram).trace();
            let score = n * (&y - b * &coefficients).norm_squared() / (free * free);
            if best.as_ref().is_none_or(|(s, _)| score < *s) {
                best = Some((score, coefficients));
            }
        }
        let c = best.expect("a spline").1;
        let [value, rate, second] = [0, 1, 2].map(|k| &self.basis[k] * &c);
        (0..y.len()).map(|k| [value[k], rate[k], second[k]]).collect()
    }
}

/// Position and Euler angles with their derivatives as a motion.
fn motion_of(t_ns: &[i64], six: &[Derivatives; 6]) -> Vec<MotionSample> {
    let row = |k: usize, order: usize, from: usize| {
        Vector3::new(six[from][k][order], six[from + 1][k][order], six[from + 2][k][order])
    };
    let angles = |k: usize| {
        let a = row(k, 0, 3);
        EulerAngles { phi_rad: a.x, theta_rad: a.y, psi_rad: a.z }
    };
    let sample = |k: usize| {
        let pose = world_from_body(row(k, 0, 0), angles(k));
        let body = pose.rotation.inverse();
        let to_rates = angles(k).rates_from_body_rates().try_inverse().expect("no pitch of 90 degrees");
        MotionSample {
            t_ns: t_ns[k],
            world_from_body: pose,
            velocity_in_body_m_s: body * row(k, 1, 0),
            rates_rad_s: to_rates * row(k, 1, 3),
            specific_force_m_s2: body * (row(k, 2, 0) + Vector3::z() * GRAVITY),
            angular_acceleration_rad_s2: to_rates * row(k, 2, 3),
            covariance: mavsight_pose::MotionCovariance::default(),
        }
    };
    (0..t_ns.len()).map(sample).collect()
}

/// Sums of squared errors of the six quantities.
fn add(sums: &mut [f64; 6], motion: &[MotionSample], truth: &[FlightState]) {
    for (sample, state) in motion.iter().zip(truth) {
        let e = error(sample, state, GRAVITY);
        (0..6).for_each(|k| sums[k] += e.fixed_rows::<3>(3 * k).norm_squared() / (3.0 * truth.len() as f64));
    }
}

fn unwrapped(mut angles: Vec<f64>) -> Vec<f64> {
    let turn = 2.0 * std::f64::consts::PI;
    for k in 1..angles.len() {
        angles[k] -= ((angles[k] - angles[k - 1]) / turn).round() * turn;
    }
    angles
}

fn main() {
    let (name, rig) = rigs().into_iter().next().expect("a rig");
    let exact = mavsight_pose::Rig::exact(rig.cameras.clone());
    let mut random = Random::new(3, 0);
    let (mut ours, mut splines, mut windows) = ([0.0; 6], [0.0; 6], [[0.0; 6]; WINDOWS.len()]);
    for _ in 0..FLIGHTS {
        let truth = flight(&mut random);
        let cameras = true_cameras(&exact, &mut random);
        let seen = observed(&cameras, &square(), &truth, &mut random);
        let poses = poses(&PoseEstimator::new(&exact, &square()), &truth, &seen);
        let Motion { samples, .. } = smooth(&poses, GRAVITY).expect("a motion");
        add(&mut ours, &samples, &truth);
        let t_ns: Vec<i64> = poses.iter().map(|p| p.t_ns).collect();
        let t_s: Vec<f64> = t_ns.iter().map(|t| *t as f64 * 1e-9).collect();
        let column = |k: usize| -> Vec<f64> {
            let values = poses.iter().map(|p| {
                let pose = p.estimate.as_ref().expect("every frame is measured").world_from_body;
                let a = EulerAngles::from_world_from_body(&pose);
                let t = pose.translation.vector;
                [t.x, t.y, t.z, a.phi_rad, a.theta_rad, a.psi_rad][k]
            });
            unwrapped(values.collect())
        };
        let columns: [Vec<f64>; 6] = std::array::from_fn(column);
        let quintic = Quintic::new(&t_s);
        add(&mut splines, &motion_of(&t_ns, &columns.clone().map(|c| quintic.fit(&c))), &truth);
        for (sums, window) in windows.iter_mut().zip(WINDOWS) {
            add(sums, &motion_of(&t_ns, &columns.clone().map(|c| savitzky_golay(&t_s, &c, window))), &truth);
        }
    }
    println!("{FLIGHTS} flights of 6 s at 30 frames a second, {name}, RMS per axis");
    println!(
        "| smoother | position mm | attitude ° | velocity mm/s | rates °/s | specific force m/s² | angular acceleration rad/s² |"
    );
    println!("|---|---|---|---|---|---|---|");
    let degrees = 180.0 / std::f64::consts::PI;
    let units = [1e3, degrees, 1e3, degrees, 1.0, 1.0];
    let print = |what: &str, sums: &[f64; 6]| {
        let cells: Vec<String> =
            sums.iter().zip(units).map(|(s, u)| format!("{:.3}", (s / FLIGHTS as f64).sqrt() * u)).collect();
        println!("| {what} | {} |", cells.join(" | "));
    };
    print("mavsight", &ours);
    print("quintic smoothing spline, generalised cross-validation", &splines);
    for (sums, window) in windows.iter().zip(WINDOWS) {
        print(&format!("Savitzky-Golay, cubic, {window} frames"), sums);
    }
    let best = std::array::from_fn(|k| windows.iter().map(|w| w[k]).fold(f64::INFINITY, f64::min));
    print("Savitzky-Golay, the best of these for each quantity", &best);
}
