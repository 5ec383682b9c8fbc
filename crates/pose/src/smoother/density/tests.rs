use super::{CUT_OFF, SHOWN};
use crate::smoother::smooth::tests::{GRAVITY, pose};
use crate::{Motion, PoseSample, smooth};
use mavsight_geometry::{Isometry3, UnitQuaternion, Vector3};
use mavsight_random::Random;
use nalgebra::Translation3;

/// Integral over frequencies from zero, by the midpoint rule after f = x/(1 - x).
fn integral(of: impl Fn(f64) -> f64) -> f64 {
    let count = 200_000;
    let at = |n: i32| (f64::from(n) + 0.5) / f64::from(count);
    (0..count).map(|n| of(at(n) / (1.0 - at(n))) / (1.0 - at(n)).powi(2)).sum::<f64>() / f64::from(count)
}

#[test]
fn shares_are_those_of_the_response() {
    let passed = |f: f64| 1.0 / (1.0 + f.powi(6));
    for (k, share) in CUT_OFF.into_iter().enumerate() {
        let power = |f: f64| f.powi(2 * k as i32) * passed(f);
        let found = integral(|f| power(f) * (1.0 - passed(f))) / integral(power);
        assert!((found - share).abs() < 1e-4, "{k}: {found}");
    }
    assert!((integral(|f| passed(f).powi(2)) / integral(passed) - SHOWN).abs() < 1e-4);
}

const STD: f64 = 1e-3;
const STEP_NS: i64 = 20_000_000;

/// A flight that is driven by white jerk along all axes, and its true velocities; the density of the jerk by the time.
fn driven(
    seconds: f64,
    density: impl Fn(f64) -> f64,
    random: &mut Random,
) -> (Vec<PoseSample>, Vec<Vector3<f64>>) {
    let (fine_s, per_pose) = (1e-3, STEP_NS / 1_000_000);
    let mut moving = [Vector3::zeros(); 3];
    let (mut poses, mut truth) = (vec![], vec![]);
    for step in 0..(seconds / fine_s) as i64 {
        let [place, rate, acceleration] = moving;
        if step % per_pose == 0 {
            let seen = place + Vector3::from(random.normals()) * STD;
            let there = Isometry3::from_parts(Translation3::from(seen), UnitQuaternion::identity());
            poses.push(pose(step * 1_000_000, there, (STD, STD)));
            truth.push(rate);
        }
        let jerk = Vector3::from(random.normals()) * (density(step as f64 * fine_s) / fine_s).sqrt();
        // Kept near hover by forces that are slow beside the smoother.
        let kept = acceleration * 0.5 + rate * 0.2 + place * 0.05;
        moving = [place + rate * fine_s, rate + acceleration * fine_s, acceleration + (jerk - kept) * fine_s];
    }
    (poses, truth)
}

/// The mean square of errors of the velocity over what a row claims, and over what the whole flight has.
fn square(motion: &Motion, truth: &[Vector3<f64>], which: impl Fn(f64) -> bool) -> (f64, f64) {
    let (mut own, mut of_flight, mut count) = (0.0, 0.0, 0.0);
    for (sample, truth) in motion.samples.iter().zip(truth).filter(|(s, _)| which(s.t_ns as f64 * 1e-9)) {
        let error = sample.velocity_in_body_m_s - sample.world_from_body.rotation.inverse() * truth;
        for (axis, error) in error.iter().enumerate() {
            own += error * error / sample.covariance.variance(6 + axis);
            of_flight += error * error / sample.covariance.noise_variance(axis);
            count += 1.0;
        }
    }
    (own / count, of_flight / count)
}

/// Hover and manoeuvre in one flight: what the smoother cuts off is less in the one and more in the other, and it says so.
#[test]
fn a_hover_and_a_manoeuvre_each_claim_what_they_err() {
    let is_hover = |t_s: f64| t_s % 20.0 < 10.0;
    let (mut hover, mut manoeuvre) = ((0.0, 0.0), (0.0, 0.0));
    let flights = 6;
    for seed in 0..flights {
        let density = |t_s: f64| if is_hover(t_s) { 0.01 } else { 1.0 };
        let (poses, truth) = driven(40.0, density, &mut Random::new(seed, 5));
        let motion = smooth(&poses, GRAVITY).unwrap();
        let is_inner = |t_s: f64| (1.0..9.0).contains(&(t_s % 10.0));
        for (sum, which) in [(&mut hover, true), (&mut manoeuvre, false)] {
            let (own, of_flight) = square(&motion, &truth, |t_s| is_inner(t_s) && is_hover(t_s) == which);
            *sum = (sum.0 + own / flights as f64, sum.1 + of_flight / flights as f64);
        }
    }
    assert!(hover.1 < 0.7 && manoeuvre.1 > 1.4, "as the flight has it: {hover:?} {manoeuvre:?}");
    assert!((0.8..1.2).contains(&hover.0) && (0.8..1.2).contains(&manoeuvre.0), "{hover:?} {manoeuvre:?}");
}

/// Where the density does not change, claims remain what the flight has.
#[test]
fn an_even_flight_claims_what_the_flight_has() {
    let (mut sum, mut count) = (0.0, 0.0);
    for seed in 0..6 {
        let (poses, _) = driven(40.0, |_| 1.0, &mut Random::new(seed, 6));
        for sample in smooth(&poses, GRAVITY).unwrap().samples {
            let ratio = sample.covariance.variance(6) / sample.covariance.noise_variance(0);
            (sum, count) = (sum + (ratio - 1.0).abs(), count + 1.0);
        }
    }
    assert!(sum / count < 0.1, "{}", sum / count);
}
