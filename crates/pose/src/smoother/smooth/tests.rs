use super::*;
use crate::{JerkNoise, PoseEstimate};
use mavsight_geometry::{EulerAngles, Isometry3, Matrix3, Matrix6, UnitQuaternion, Vector3, world_from_body};
use mavsight_random::Random;
use nalgebra::{Matrix6xX, SVector, Translation3};
use std::f64::consts::PI;

pub(crate) const GRAVITY: f64 = 9.804;

pub(crate) fn pose(t_ns: i64, world_from_body: Isometry3<f64>, std: (f64, f64)) -> PoseSample {
    let mut covariance = Matrix6::identity() * std.0 * std.0;
    covariance.fixed_view_mut::<3, 3>(3, 3).fill_diagonal(std.1 * std.1);
    PoseSample { t_ns, estimate: Ok(PoseEstimate::new(world_from_body, &covariance)) }
}

/// A smooth flight: sines of much the same jerk in all axes, as the smoother's one intensity supposes.
pub(crate) fn flight(t: f64) -> Isometry3<f64> {
    let position =
        Vector3::new(0.8 * (1.1 * t).sin(), 0.3 * (1.5 * t + 1.0).cos(), 1.5 + 0.2 * (1.7 * t).sin());
    let attitude = EulerAngles {
        phi_rad: 0.2 * (1.7 * t).sin(),
        theta_rad: 0.15 * (1.9 * t + 0.4).sin(),
        psi_rad: -0.4 + 0.5 * (1.3 * t).sin(),
    };
    world_from_body(position, attitude)
}

/// The motion by central differences of the exact flight.
pub(crate) fn exact(t: f64) -> SVector<f64, 12> {
    let h = 1e-4;
    let place = |t: f64| flight(t).translation.vector;
    let turn = |t: f64| (flight(t - h).rotation.inverse() * flight(t + h).rotation).scaled_axis() / (2.0 * h);
    let body = flight(t).rotation.inverse();
    let velocity = body * ((place(t + h) - place(t - h)) / (2.0 * h));
    let acceleration = (place(t + h) - place(t) * 2.0 + place(t - h)) / (h * h);
    let force = body * (acceleration + Vector3::z() * GRAVITY);
    let wide = 1e-3;
    let spin = (turn(t + wide) - turn(t - wide)) / (2.0 * wide);
    let mut out = SVector::<f64, 12>::zeros();
    for (k, v) in [velocity, turn(t), force, spin].iter().enumerate() {
        out.fixed_rows_mut::<3>(3 * k).copy_from(v);
    }
    out
}

pub(crate) fn filmed(
    count: i64,
    claimed_over_true: f64,
    random: &mut Random,
    missing: impl Fn(i64) -> bool,
) -> Vec<PoseSample> {
    let (position_std, turn_std) = (5e-4, 2e-3);
    (0..count)
        .map(|k| {
            let t_ns = k * 33_333_333 + if k % 2 == 0 { 0 } else { 2_000_000 };
            let truth = flight(t_ns as f64 * 1e-9);
            let noisy = Isometry3::from_parts(
                Translation3::from(truth.translation.vector + Vector3::from(random.normals()) * position_std),
                truth.rotation * UnitQuaternion::from_scaled_axis(Vector3::from(random.normals()) * turn_std),
            );
            let mut sample =
                pose(t_ns, noisy, (position_std * claimed_over_true, turn_std * claimed_over_true));
            if missing(k) {
                sample.estimate = Err(PoseError::NotMeasured);
            }
            sample
        })
        .collect()
}

/// What a motion should have been: pose, then velocity in body axes, rates, specific force, angular
/// acceleration.
pub(crate) type Truth = (Isometry3<f64>, SVector<f64, 12>);

/// Share of the errors within 1.96 standard deviations of pose, velocities, accelerations; root mean
/// square errors.
pub(crate) fn coverage(motion: &Motion, truth: impl Fn(usize) -> Truth) -> ([f64; 3], SVector<f64, 18>) {
    let mut inside = [0.0; 3];
    let mut squares = SVector::<f64, 18>::zeros();
    let count = motion.samples.len() as f64;
    for (i, s) in motion.samples.iter().enumerate() {
        let (pose, want) = truth(i);
        let shift = s.world_from_body.translation.vector - pose.translation.vector;
        let turn = (pose.rotation.inverse() * s.world_from_body.rotation).scaled_axis();
        let rest =
            [s.velocity_in_body_m_s, s.rates_rad_s, s.specific_force_m_s2, s.angular_acceleration_rad_s2];
        let mut error = SVector::<f64, 18>::zeros();
        error.fixed_rows_mut::<3>(0).copy_from(&shift);
        error.fixed_rows_mut::<3>(3).copy_from(&turn);
        for (k, v) in rest.iter().enumerate() {
            error.fixed_rows_mut::<3>(6 + 3 * k).copy_from(&(v - want.fixed_rows::<3>(3 * k)));
        }
        for k in 0..18 {
            inside[k / 6] +=
                f64::from(error[k].abs() <= 1.96 * s.covariance.variance(k).sqrt()) / (6.0 * count);
            squares[k] += error[k] * error[k] / count;
        }
    }
    (inside, squares.map(f64::sqrt))
}

#[test]
fn intervals_hold_the_truth_with_gaps_and_wrong_claims() {
    for (claimed, seed) in [(1.0, 1), (3.0, 2), (0.3, 3)] {
        let mut random = Random::new(seed, 0);
        let gap = |k: i64| (120..132).contains(&k) || k % 17 == 3 || k == 0 || k == 299;
        let motion = smooth(&filmed(300, claimed, &mut random, gap), GRAVITY).unwrap();
        // From the first pose to the last.
        assert_eq!(motion.samples.len(), 298);
        let at = |i: usize| motion.samples[i].t_ns as f64 * 1e-9;
        let (share, rms) = coverage(&motion, |i| (flight(at(i)), exact(at(i))));
        // Sines are smoother than white jerk, so the intervals of their derivatives hold more than they
        // claim.
        assert!((0.90..=0.99).contains(&share[0]), "claimed {claimed}: {share:?}");
        assert!(share[1] >= 0.95 && share[2] >= 0.95, "claimed {claimed}: {share:?}");
        assert!(rms[0] < 4e-4 && rms[3] < 2e-3, "smoothing must help: {rms}");
        assert!(rms[12] < 0.1 && rms[16] < 0.2, "accelerations: {rms}");
    }
}

/// Three seconds unseen: an attitude might turn by radians meanwhile.
#[test]
fn over_a_long_gap_there_is_no_motion_and_next_to_it_intervals_hold() {
    let mut random = Random::new(4, 0);
    let gap = |k: i64| (150..240).contains(&k);
    let poses = filmed(400, 1.0, &mut random, gap);
    let longest_s = crate::motion_noise(&poses).unwrap().longest_gap_s();
    assert!((0.2..2.5).contains(&longest_s), "{longest_s}");
    let motion = smooth(&poses, GRAVITY).unwrap();
    let times: Vec<i64> = motion.samples.iter().map(|s| s.t_ns).collect();
    let wanted: Vec<i64> = (0..400).filter(|k| !gap(*k)).map(|k| poses[k as usize].t_ns).collect();
    assert_eq!(times, wanted);
    assert_eq!(motion.unknown_ns.len(), 90);
    assert!(motion.unknown_ns.iter().all(|t| !times.contains(t)));
    let at = |i: usize| times[i] as f64 * 1e-9;
    let (share, _) = coverage(&motion, |i| (flight(at(i)), exact(at(i))));
    assert!(share.iter().all(|s| *s >= 0.9), "{share:?}");
    // Parts that are too short have no motion.
    let flecks = filmed(400, 1.0, &mut random, |k| k % 100 > 5);
    let refused = smooth(&flecks, GRAVITY);
    assert!(matches!(refused, Err(PoseError::TooFewPoses { measured: 24, .. })), "{refused:?}");
}

/// A flight of the smoother's own kind, integrated in steps of a millisecond and measured every 33: each
/// error of 1 mm and 3 mrad is new, but for a part whose standard deviation and time constant are given.
/// Under the seeds that are used no flight turns by more than half a turn between two poses.
pub(crate) fn white_jerk(seed: u64, correlated: (f64, f64)) -> (Vec<PoseSample>, Vec<Truth>) {
    let (jerk, spin_jerk, fine) = (0.5f64, 2.0f64, 1e-3);
    let mut random = Random::new(seed, 0);
    let (mut p, mut v, mut a) = (Vector3::new(0.0, 0.0, 1.5), Vector3::zeros(), Vector3::zeros());
    let (mut r, mut w, mut alpha) = (UnitQuaternion::identity(), Vector3::zeros(), Vector3::zeros());
    let (mut poses, mut truth): (Vec<PoseSample>, Vec<Truth>) = (vec![], vec![]);
    let kept = (-0.033 / correlated.1).exp();
    let mut correlated_error = [Vector3::from(random.normals()), Vector3::from(random.normals())];
    for step in 0..10_000i64 {
        if step % 33 == 0 {
            let body = r.inverse();
            let mut rest = SVector::<f64, 12>::zeros();
            let parts = [body * v, w, body * (a + Vector3::z() * GRAVITY), alpha];
            for (k, part) in parts.iter().enumerate() {
                rest.fixed_rows_mut::<3>(3 * k).copy_from(part);
            }
            truth.push((Isometry3::from_parts(Translation3::from(p), r), rest));
            for s in &mut correlated_error {
                *s = *s * kept + Vector3::from(random.normals()) * (1.0 - kept * kept).sqrt();
            }
            let error = |random: &mut Random, k: usize| {
                Vector3::from(random.normals()) + correlated_error[k] * correlated.0
            };
            let noisy = Isometry3::from_parts(
                Translation3::from(p + error(&mut random, 0) * 1e-3),
                r * UnitQuaternion::from_scaled_axis(error(&mut random, 1) * 3e-3),
            );
            poses.push(pose(step * 1_000_000, noisy, (2e-3, 6e-3)));
        }
        p += v * fine + a * (0.5 * fine * fine);
        v += a * fine;
        a += Vector3::from(random.normals()) * jerk * fine.sqrt();
        r *= UnitQuaternion::from_scaled_axis(w * fine + alpha * (0.5 * fine * fine));
        w += alpha * fine;
        alpha += Vector3::from(random.normals()) * spin_jerk * fine.sqrt();
    }
    (poses, truth)
}

#[test]
fn intervals_are_exact_for_white_jerk() {
    let mut total = [0.0; 3];
    for flight in 0..4 {
        let (poses, truth) = white_jerk(104 + flight, (0.0, 1.0));
        let motion = smooth(&poses, GRAVITY).unwrap();
        let (share, _) = coverage(&motion, |i| truth[i]);
        (0..3).for_each(|k| total[k] += share[k] / 4.0);
        let fc = (0.25_f64 / (1e-6 * 0.033)).powf(1.0 / 6.0) / (2.0 * PI);
        assert!(
            (motion.translation_bandwidth_hz / fc).ln().abs() < 0.15,
            "{} Hz",
            motion.translation_bandwidth_hz
        );
    }
    assert!(total.iter().all(|s| (0.92..=0.98).contains(s)), "{total:?}");
}

/// Where half of the error's variance lasts a tenth of a second, intervals that take it as new hold too
/// little.
#[test]
fn intervals_hold_where_a_part_of_the_error_lasts() {
    let (mut total, mut plain) = ([0.0; 3], [0.0; 3]);
    for flight in 0..4 {
        let (poses, truth) = white_jerk(304 + flight, (1.5, 0.1));
        let motion = smooth(&poses, GRAVITY).unwrap();
        let (share, _) = coverage(&motion, |i| truth[i]);
        let noise = crate::motion_noise(&poses).unwrap();
        assert!(noise.translation.correlated[(0, 0)] > 0.0, "{noise:?}");
        let white = |n: JerkNoise| JerkNoise { correlated: Matrix3::zeros(), ..n };
        let white = MotionNoise { translation: white(noise.translation), rotation: white(noise.rotation) };
        let states = smoothed(&poses, &white).unwrap();
        let samples = poses.iter().zip(&states).map(|(p, s)| s.sample(p.t_ns, GRAVITY).unwrap()).collect();
        let (without, _) = coverage(&Motion { samples, ..motion.clone() }, |i| truth[i]);
        (0..3).for_each(|k| total[k] += share[k] / 4.0);
        (0..3).for_each(|k| plain[k] += without[k] / 4.0);
    }
    assert!(plain[0] < 0.8, "the correlated part must matter in this test: {plain:?}");
    assert!(total.iter().all(|s| (0.91..=0.98).contains(s)), "{total:?}");
}

/// One pose in ten that is known to half a metre made all of the motion five times as uncertain.
#[test]
fn a_few_poses_that_are_hardly_known_do_not_make_the_rest_of_the_motion_uncertain() {
    let (mut poses, _) = white_jerk(104, (0.0, 1.0));
    let tiny = Matrix6xX::from_element(1, 1e-9);
    let mut without = poses.clone();
    for (k, (sample, without)) in poses.iter_mut().zip(&mut without).enumerate() {
        let stds = if k % 10 == 5 { (0.5, 1.0) } else { (2e-3, 6e-3) };
        let own = pose(sample.t_ns, sample.estimate.as_ref().unwrap().world_from_body, stds);
        sample.estimate = own.estimate.map(|e| e.with_systematic(&tiny));
        let known = if k % 10 == 5 { Err(PoseError::NotMeasured) } else { sample.estimate.clone() };
        without.estimate = known;
    }
    let median_std = |poses: &[PoseSample], at: usize| {
        let motion = smooth(poses, GRAVITY).unwrap();
        let stds = motion.samples.iter().map(|s| s.covariance.variance(at).sqrt());
        crate::statistics::median(stds.collect()).unwrap()
    };
    for at in [0, 3] {
        let (with, without) = (median_std(&poses, at), median_std(&without, at));
        assert!((with / without - 1.0).abs() < 0.1, "coordinate {at}: {with} with them, {without} without");
    }
}

#[test]
fn intervals_hold_in_gaps_and_grow_there() {
    let (mut inside, mut count) = ([0.0; 3], 0.0);
    let gap = |k: usize| (90..100).contains(&(k % 100));
    for flight in 0..8 {
        let (mut poses, truth) = white_jerk(515 + flight, (0.0, 1.0));
        for (k, p) in poses.iter_mut().enumerate() {
            if gap(k) {
                p.estimate = Err(PoseError::NotMeasured);
            }
        }
        let motion = smooth(&poses, GRAVITY).unwrap();
        let std = |k: usize| motion.samples[k].covariance.variance(0).sqrt();
        assert!(std(95) > 2.0 * std(80) && std(95) < 0.1, "{} then {}", std(80), std(95));
        let in_gaps: Vec<usize> = (0..poses.len()).filter(|k| gap(*k)).collect();
        let samples = in_gaps.iter().map(|k| motion.samples[*k].clone()).collect();
        let (share, _) = coverage(&Motion { samples, ..motion.clone() }, |i| truth[in_gaps[i]]);
        (0..3).for_each(|k| inside[k] += share[k]);
        count += 1.0;
    }
    // Ten samples of one gap count little more than one: 24 gaps in three axes leave a standard deviation
    // of 3 %.
    assert!(inside.iter().all(|s| (0.87..=1.0).contains(&(s / count))), "{inside:?} of {count}");
}

/// Systematic columns come out as what the smoother makes of poses that are displaced by them.
#[test]
fn systematic_errors_of_poses_reach_the_motion_as_their_smoothed_course() {
    let mut random = Random::new(5, 0);
    let mut poses = filmed(120, 1.0, &mut random, |k| (50..56).contains(&k) || k == 0);
    for p in &mut poses {
        let t = p.t_ns as f64 * 1e-9;
        if let Ok(e) = &mut p.estimate {
            let column = |k: usize| (1.0 + 0.3 * k as f64) * (t + k as f64).sin() * 1e-3;
            *e = e.clone().with_systematic(&Matrix6xX::from_fn(2, |i, j| column(i + 6 * j) as f32));
        }
    }
    let noise = crate::motion_noise(&poses).unwrap();
    let states = smoothed(&poses, &noise).unwrap();
    for c in 0..2 {
        let displaced = |step: f64| {
            let mut poses = poses.clone();
            for e in poses.iter_mut().filter_map(|p| p.estimate.as_mut().ok()) {
                let by = e.systematic_column(c) * step;
                let pose = &mut e.world_from_body;
                pose.translation.vector += by.fixed_rows::<3>(0);
                pose.rotation *= UnitQuaternion::from_scaled_axis(by.fixed_rows::<3>(3).into_owned());
            }
            smoothed(&poses, &noise).unwrap()
        };
        let (plus, minus) = (displaced(0.5), displaced(-0.5));
        for (k, state) in states.iter().enumerate() {
            let want = [
                plus[k].translation.place - minus[k].translation.place,
                plus[k].translation.rate - minus[k].translation.rate,
                (minus[k].rotation.place.inverse() * plus[k].rotation.place).scaled_axis(),
                plus[k].rotation.rate - minus[k].rotation.rate,
            ];
            for (want, at) in want.iter().zip([0, 3, 12, 15]) {
                let got = state.effects.fixed_view::<3, 1>(at, c);
                assert!((got - want).norm() < 0.05 * want.norm() + 5e-5, "{k} at {at}: {got} against {want}");
            }
        }
    }
    let motion = smooth(&poses, GRAVITY).unwrap();
    // The first instant, which has no pose, has no sample.
    let (sample, state) = (&motion.samples[30], &states[31]);
    let effect = state.effects.row(1).norm_squared();
    assert!((sample.covariance.variance(1) / (state.covariance[(1, 1)] + effect) - 1.0).abs() < 1e-3);
}

#[test]
fn hover_reads_minus_g() {
    let mut random = Random::new(4, 0);
    let still = world_from_body(Vector3::new(0.0, 0.0, 1.5), EulerAngles::default());
    let poses: Vec<_> = (0..100)
        .map(|k| {
            let noisy = Isometry3::from_parts(
                Translation3::from(still.translation.vector + Vector3::from(random.normals()) * 1e-3),
                still.rotation * UnitQuaternion::from_scaled_axis(Vector3::from(random.normals()) * 1e-3),
            );
            pose(k * 33_333_333, noisy, (1e-3, 1e-3))
        })
        .collect();
    let motion = smooth(&poses, GRAVITY).unwrap();
    for s in &motion.samples {
        let std = s.covariance.variances().map(f64::sqrt);
        assert!((s.specific_force_m_s2.z + GRAVITY).abs() < 4.0 * std[14] + 1e-3);
        assert!(s.specific_force_m_s2.x.abs() < 4.0 * std[12] + 1e-3);
    }
    assert!(motion.translation_bandwidth_hz < 1.0, "{}", motion.translation_bandwidth_hz);
}

#[test]
fn a_quadratic_and_a_steady_turn_pass_unchanged() {
    let spin = Vector3::new(0.3, -0.2, 0.4);
    let poses: Vec<_> = (0..60)
        .map(|k| {
            let t = f64::from(k) / 30.0;
            let place = Vector3::new(1.0 - 2.0 * t + 0.5 * t * t, 0.3 * t, 1.5 - 0.2 * t * t);
            let turn = UnitQuaternion::from_scaled_axis(spin * t);
            pose((t * 1e9) as i64, Isometry3::from_parts(place.into(), turn), (1e-4, 1e-4))
        })
        .collect();
    let motion = smooth(&poses, GRAVITY).unwrap();
    for (s, p) in motion.samples.iter().zip(&poses) {
        let want = p.estimate.as_ref().unwrap().world_from_body;
        assert!((s.world_from_body.translation.vector - want.translation.vector).norm() < 1e-6);
        assert!(s.world_from_body.rotation.angle_to(&want.rotation) < 1e-6);
        assert!((s.rates_rad_s - spin).norm() < 1e-4, "{}", s.rates_rad_s);
        let acceleration = s.world_from_body.rotation * s.specific_force_m_s2 - Vector3::z() * GRAVITY;
        assert!((acceleration - Vector3::new(1.0, 0.0, -0.4)).norm() < 1e-3, "{acceleration}");
    }
}

/// The gain of the smoother for a given noise is the one that the bandwidth promises.
#[test]
fn a_sine_is_scaled_by_the_response() {
    let (dt, fc, std) = (1.0 / 30.0, 2.0, 1e-3);
    let intensity = (2.0 * PI * fc).powi(6) * std * std * dt;
    let noise = JerkNoise::white(intensity, 1.0);
    for f in [1.0, 1.6, 2.0, 2.5] {
        let wave = |t: f64| (2.0 * PI * f * t).sin();
        let poses: Vec<_> = (0..900)
            .map(|k| {
                let t = f64::from(k) * dt;
                let place = Isometry3::translation(wave(t), 0.0, 0.0);
                pose((t * 1e9).round() as i64, place, (std, std))
            })
            .collect();
        let states = smoothed(&poses, &MotionNoise { translation: noise, rotation: noise }).unwrap();
        let (mut along, mut square) = (0.0, 0.0);
        for (p, s) in poses.iter().zip(&states).skip(300).take(300) {
            let w = wave(p.t_ns as f64 * 1e-9);
            along += w * s.translation.place.x;
            square += w * w;
        }
        let want = 1.0 / (1.0 + (f / fc).powi(6));
        assert!((along / square - want).abs() < 0.01, "at {f} Hz {} against {want}", along / square);
    }
}

/// Single precision keeps no variance beyond 3e38 m², and the smoother gave an infinite one.
#[test]
fn a_flight_whose_variances_are_beyond_all_numbers_is_refused() {
    let mut poses = filmed(60, 1.0, &mut Random::new(5, 0), |_| false);
    for (k, sample) in poses.iter_mut().enumerate() {
        if let Ok(estimate) = &mut sample.estimate {
            let far = &mut estimate.world_from_body.translation.vector;
            far.x += if k % 2 == 0 { 1e25 } else { -1e25 };
        }
    }
    let refused = smooth(&poses, GRAVITY);
    assert!(
        matches!(refused, Err(PoseError::BadPose { what: "the smoother's covariance", index: 0..60 })),
        "{refused:?}"
    );
}

#[test]
fn what_cannot_be_smoothed_is_refused() {
    let mut random = Random::new(6, 0);
    let good = filmed(30, 1.0, &mut random, |_| false);
    let few = filmed(30, 1.0, &mut random, |k| k > 8);
    assert_eq!(smooth(&few, GRAVITY), Err(PoseError::TooFewPoses { measured: 9, samples: 30, needed: 10 }));
    assert!(matches!(smooth(&[], GRAVITY), Err(PoseError::TooFewPoses { .. })));
    let mut back = good.clone();
    back[7].t_ns = back[6].t_ns;
    assert!(matches!(smooth(&back, GRAVITY), Err(PoseError::TimeNotIncreasing { index: 7, .. })));
    let mut lost = good.clone();
    let place = lost[4].estimate.as_ref().unwrap().world_from_body;
    lost[4].estimate = Ok(PoseEstimate::new(place, &Matrix6::zeros()));
    assert!(matches!(smooth(&lost, GRAVITY), Err(PoseError::BadPose { index: 4, .. })));
    assert!(matches!(smooth(&good, f64::NAN), Err(PoseError::BadPose { .. })));
}
