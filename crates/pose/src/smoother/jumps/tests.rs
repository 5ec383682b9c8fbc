use super::{Jumps, Shock, disturbances, shocks};
use crate::smoother::passes::Flown;
use crate::smoother::smooth::tests::{GRAVITY, pose, white_jerk};
use crate::smoother::wider::WIDER;
use crate::{JerkNoise, Motion, MotionNoise, MotionSample, PoseSample, smooth};
use mavsight_geometry::{Isometry3, UnitQuaternion, Vector3};
use mavsight_random::Random;
use nalgebra::Translation3;

const STD: f64 = 3e-3;

fn all_shocks(poses: &[PoseSample], noise: &MotionNoise) -> Vec<Shock> {
    let flown = Flown::without_effects(poses, 0, None);
    shocks(&flown, &flown.measured().collect::<Vec<_>>(), noise).unwrap().0
}

fn jumps(poses: &[PoseSample], noise: &MotionNoise) -> Jumps {
    disturbances(&Flown::without_effects(poses, 0, None), noise).unwrap().0
}

/// Times at which the pitching acceleration jumps: a doublet and its answer.
const STEPS_S: [f64; 6] = [2.01, 2.33, 2.65, 6.02, 6.35, 6.68];

/// A hover that is pitched by doublets of an acceleration, and its true pitch rates.
fn stepped(acceleration: f64, random: &mut Random) -> (Vec<PoseSample>, Vec<f64>) {
    let fine = 1e-3;
    let (mut turn, mut rate) = (0.0, 0.0);
    let (mut poses, mut truth) = (vec![], vec![]);
    for step in 0..9_900_i64 {
        let t_s = step as f64 * fine;
        if step % 33 == 0 {
            let seen = Vector3::y() * turn + Vector3::from(random.normals()) * STD;
            let place = Vector3::z() + Vector3::from(random.normals()) * 1e-3;
            let there =
                Isometry3::from_parts(Translation3::from(place), UnitQuaternion::from_scaled_axis(seen));
            poses.push(pose(step * 1_000_000, there, (1e-3, STD)));
            truth.push(rate);
        }
        let passed = STEPS_S.iter().filter(|s| **s <= t_s).count();
        let now = [0.0, 1.0, -1.0][passed % 3] * acceleration;
        turn += rate * fine + now * (0.5 * fine * fine);
        rate += now * fine;
    }
    (poses, truth)
}

/// The largest error of the pitch rate over standard deviations, with what jumps do and as the whole flight has them, and rows
/// inside 95 %.
fn worst(motion: &Motion, truth: &[f64]) -> (f64, f64, usize) {
    let (mut with, mut plain, mut inside) = (0.0_f64, 0.0_f64, 0);
    for (sample, truth) in motion.samples.iter().zip(truth) {
        let error = (sample.rates_rad_s.y - truth).abs();
        let own = error / sample.covariance.variance(10).sqrt();
        (with, plain) = (with.max(own), plain.max(error / sample.covariance.noise_variance(4).sqrt()));
        inside += usize::from(own <= 1.96);
    }
    (with, plain, inside)
}

/// Beside a step the smoother is off by what it is too slow for, and says so.
#[test]
fn rates_beside_a_step_are_within_what_they_claim() {
    let (mut inside, mut rows, mut beyond, mut in_vain) = (0, 0, 0, 0);
    for seed in 0..8 {
        let (poses, truth) = stepped(12.0, &mut Random::new(seed, 0));
        let motion = smooth(&poses, GRAVITY).unwrap();
        let (with, plain, held) = worst(&motion, &truth);
        assert!(with < 5.0, "{seed}: {with}");
        (inside, rows, beyond) = (inside + held, rows + truth.len(), beyond + usize::from(plain > 5.0));
        let near = |t_ns: i64| STEPS_S.iter().any(|s| (t_ns as f64 * 1e-9 - s).abs() < 0.7);
        let is_wider = |s: &&MotionSample| s.covariance.variance(10) > WIDER * s.covariance.noise_variance(4);
        let times = || motion.samples.iter().filter(is_wider).map(|s| s.t_ns);
        assert!(STEPS_S.iter().all(|s| times().any(|t_ns| (t_ns as f64 * 1e-9 - s).abs() < 0.04)));
        in_vain += usize::from(!times().all(near));
    }
    assert!(beyond > 4, "without jumps some rates must lie beyond: in {beyond} of 8 flights");
    assert!(in_vain <= 4, "elsewhere rows are wider in {in_vain} of 8 flights");
    // Between steps the motion is smoother than white jerk: intervals hold more than they claim.
    let share = inside as f64 / rows as f64;
    assert!((0.93..0.995).contains(&share), "{share}");
}

/// Motion of the smoother's own kind: shocks are chi-square, and hardly any is called a jump.
#[test]
fn shocks_of_white_jerk_are_chance() {
    let noise =
        MotionNoise { translation: JerkNoise::white(0.25, 0.25), rotation: JerkNoise::white(4.0, 0.25) };
    let (mut sum, mut large, mut count, mut called) = (0.0, 0.0, 0.0, 0);
    for seed in (104..108).chain(904..908) {
        let (poses, _) = white_jerk(seed, (0.0, 1.0));
        let found = all_shocks(&poses, &noise);
        assert_eq!(found.len(), 6 * (poses.len() - 1));
        count += found.len() as f64;
        sum += found.iter().map(|s| f64::from(s.square)).sum::<f64>();
        large += found.iter().filter(|s| s.square > 3.841).count() as f64;
        called += jumps(&poses, &noise).0.len();
    }
    // Neighbours are correlated: the mean of 14 000 counts as that of some 2000.
    assert!((sum / count - 1.0).abs() < 0.1, "{}", sum / count);
    assert!((large / count - 0.05).abs() < 0.01, "{}", large / count);
    // A tenth of what is called may be chance: where all is, one flight in ten has a call.
    assert!(called <= 4, "{called} in 8 flights");
}

/// A jump of a known size is found where it is, also across poses that are missing.
#[test]
fn a_shock_has_its_place_and_size() {
    let noise =
        MotionNoise { translation: JerkNoise::white(1e-3, 1.0), rotation: JerkNoise::white(1e-2, 1.0) };
    for gap in [0, 3] {
        let (acceleration, at) = (0.2, 150);
        let pose_at = |k: i64| {
            // The jerk is even over the interval before `at`, so that the size is exact.
            let (dt, t) = (0.033, 0.033 * (k - at) as f64);
            let jerk = acceleration / (dt * (gap + 1) as f64);
            let begin = t + dt * (gap + 1) as f64;
            let cubes = (begin.max(0.0).powi(3) - t.max(0.0).powi(3)) / 6.0;
            pose(k * 33_000_000, Isometry3::translation(0.0, jerk * cubes, 1.0), (1e-3, STD))
        };
        let mut poses: Vec<PoseSample> = (0..300).map(pose_at).collect();
        for k in at - gap..at {
            poses[k as usize].estimate = Err(crate::PoseError::NotMeasured);
        }
        let found = jumps(&poses, &noise).0;
        let intervals: Vec<usize> = found.keys().copied().collect();
        assert_eq!(intervals, ((at - gap) as usize..=at as usize).collect::<Vec<_>>());
        for densities in found.values() {
            let size = (densities[1] * 0.033 * (gap + 1) as f64).sqrt();
            assert!((size / acceleration - 1.0).abs() < 0.02, "{size}");
            assert_eq!(densities.iter().filter(|d| **d > 0.0).count(), 1);
        }
    }
}
