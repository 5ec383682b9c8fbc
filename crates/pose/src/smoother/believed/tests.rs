use crate::smoother::smooth::tests::{GRAVITY, Truth, exact, filmed, flight, pose, white_jerk};
use crate::{Motion, MotionSample, PoseError, PoseEstimate, PoseSample, smooth};
use mavsight_geometry::{Isometry3, UnitQuaternion, Vector3};
use mavsight_random::Random;
use nalgebra::{Matrix6xX, SVector, Translation3};

/// Errors of position, turn, velocity and rates over their standard deviations.
fn normalised(sample: &MotionSample, (place, rest): &Truth) -> SVector<f64, 12> {
    let world_from_body = &sample.world_from_body;
    let errors = [
        world_from_body.translation.vector - place.translation.vector,
        (place.rotation.inverse() * world_from_body.rotation).scaled_axis(),
        sample.velocity_in_body_m_s - rest.fixed_rows::<3>(0),
        sample.rates_rad_s - rest.fixed_rows::<3>(3),
    ];
    SVector::from_fn(|k, _| errors[k / 3][k % 3] / sample.covariance.variance(k).sqrt())
}

/// Share of intervals of 95 % that hold the truth, and the largest normalised error.
fn held(motion: &Motion, poses: &[PoseSample], truth: &[Truth]) -> (f64, f64) {
    let (mut inside, mut worst) = (0.0, 0.0_f64);
    for sample in &motion.samples {
        let k = poses.iter().position(|p| p.t_ns == sample.t_ns).unwrap();
        let errors = normalised(sample, &truth[k]);
        inside += errors.iter().filter(|e| e.abs() <= 1.96).count() as f64 / 12.0;
        worst = worst.max(errors.amax());
    }
    (inside / motion.samples.len() as f64, worst)
}

/// The motion of [`filmed`] at a time.
fn sines(t_ns: i64) -> Truth {
    let t_s = t_ns as f64 * 1e-9;
    (flight(t_s), exact(t_s))
}

fn displace(sample: &mut PoseSample, shift: Vector3<f64>, turn: Vector3<f64>) {
    let pose = &mut sample.estimate.as_mut().unwrap().world_from_body;
    pose.translation.vector += shift;
    pose.rotation *= UnitQuaternion::from_scaled_axis(turn);
}

#[test]
fn gross_outliers_are_left_out_and_no_row_suffers() {
    let mut total = 0.0;
    for flight in 0..3 {
        let mut random = Random::new(flight, 0);
        let mut poses = filmed(300, 1.0, &mut random, |k| (100..103).contains(&k));
        let truth: Vec<Truth> = poses.iter().map(|p| sines(p.t_ns)).collect();
        let wrong: Vec<usize> = (10..poses.len()).step_by(19).collect();
        for k in &wrong {
            displace(&mut poses[*k], Vector3::from(random.normals()) * 0.2, Vector3::from(random.normals()));
        }
        let motion = smooth(&poses, GRAVITY).unwrap();
        let left_out = &motion.doubts.left_out_ns;
        assert!(wrong.iter().all(|k| left_out.contains(&poses[*k].t_ns)), "{left_out:?}");
        assert!(left_out.len() <= wrong.len() + 1, "{left_out:?}, {:?}", motion.doubts.severed_ns);
        assert!(motion.doubts.words()[0].starts_with(&format!("{} pose(s)", left_out.len())));
        let (share, worst) = held(&motion, &poses, &truth);
        assert!(worst < 5.0 && motion.samples.len() > 290, "{worst}, {}", motion.samples.len());
        total += share / 3.0;
    }
    // Sines are smoother than white jerk: their intervals hold more than they claim.
    assert!((0.93..=0.995).contains(&total), "{total}");
}

/// Poses of one place that agree with each other, as those of a wrong association.
#[test]
fn runs_of_wrong_poses_are_not_followed() {
    for (flight, length) in [(0, 2), (1, 3), (2, 5)] {
        let (mut poses, truth) = white_jerk(814 + flight, (0.0, 1.0));
        for start in [60, 150, 220] {
            for sample in &mut poses[start..start + length] {
                displace(sample, Vector3::new(0.3, -0.2, 0.1), Vector3::new(0.0, 0.0, 1.5));
            }
        }
        let motion = smooth(&poses, GRAVITY).unwrap();
        let (share, worst) = held(&motion, &poses, &truth);
        assert!((0.88..=0.99).contains(&share) && worst < 5.0, "{length}: {share}, {worst}");
        assert!(motion.samples.len() > 250, "{length}: {}", motion.samples.len());
    }
}

fn hover(k: i64, random: &mut Random, moved: bool) -> PoseSample {
    let (place, turn) = if moved { (Vector3::new(0.4, 0.1, 1.2), 1.0) } else { (Vector3::z(), 0.0) };
    let rotation =
        UnitQuaternion::from_scaled_axis(Vector3::z() * turn + Vector3::from(random.normals()) * 2e-3);
    let translation = Translation3::from(place + Vector3::from(random.normals()) * 1e-3);
    pose(k * 33_333_333, Isometry3::from_parts(translation, rotation), (1e-3, 2e-3))
}

/// A jerk that only hover has shown bridged the gap with claims of centimetres.
#[test]
fn a_gap_with_a_manoeuvre_that_nobody_saw_is_not_crossed() {
    let mut random = Random::new(9, 0);
    let (first, behind) = (150, 170);
    let mut poses: Vec<_> = (0..300).map(|k| hover(k, &mut random, k >= behind)).collect();
    for sample in &mut poses[first as usize..behind as usize] {
        sample.estimate = Err(PoseError::NotMeasured);
    }
    let longest_s = crate::motion_noise(&poses).unwrap().longest_gap_s();
    assert!(longest_s > 20.0 / 30.0, "the gap must be one that hover would bridge: {longest_s}");
    let motion = smooth(&poses, GRAVITY).unwrap();
    let severed = (poses[first as usize - 1].t_ns, poses[behind as usize].t_ns);
    assert_eq!(motion.doubts.severed_ns, [severed]);
    assert!(motion.doubts.left_out_ns.is_empty());
    assert_eq!(motion.unknown_ns.len(), 20);
    let truth = |k: i64| {
        let world_from_body = hover(k, &mut Random::new(0, 0), k >= behind).estimate.unwrap().world_from_body;
        let still = UnitQuaternion::from_scaled_axis(Vector3::z() * if k >= behind { 1.0 } else { 0.0 });
        let place = if k >= behind { Vector3::new(0.4, 0.1, 1.2) } else { Vector3::z() };
        assert!((world_from_body.translation.vector - place).norm() < 0.01);
        (Isometry3::from_parts(place.into(), still), SVector::zeros())
    };
    let (_, worst) = held(&motion, &poses, &(0..300).map(truth).collect::<Vec<_>>());
    assert!(worst < 5.0, "{worst}");
}

#[test]
fn a_flight_without_fault_keeps_its_poses_and_its_gaps() {
    for seed in 0..4 {
        let (poses, _) = white_jerk(904 + seed, (0.0, 1.0));
        let motion = smooth(&poses, GRAVITY).unwrap();
        assert_eq!(motion.doubts, crate::Doubts::default());
        let mut random = Random::new(seed, 1);
        let motion = smooth(&filmed(300, 1.0, &mut random, |k| k % 40 < 6), GRAVITY).unwrap();
        assert_eq!(motion.doubts, crate::Doubts::default());
    }
}

/// What an encoder repeats errs by the same in every frame: no smoother averages it out.
#[test]
fn errors_that_remain_are_claimed_in_full() {
    let (mut inside, flights) = ([0.0; 2], 40);
    for seed in 0..flights {
        let mut random = Random::new(seed, 2);
        let (place, turn) = (Vector3::from(random.normals()) * 1e-3, Vector3::from(random.normals()) * 2e-3);
        let poses: Vec<PoseSample> = (0..60)
            .map(|k| {
                let shift = place + Vector3::from(random.normals()) * 1e-5;
                let rotation =
                    UnitQuaternion::from_scaled_axis(turn + Vector3::from(random.normals()) * 2e-5);
                let there = Isometry3::from_parts(Translation3::from(shift), rotation);
                let mut sample = pose(k * 33_333_333, there, (1e-3, 2e-3));
                let vouched = |e: PoseEstimate| e.with_systematic(&Matrix6xX::from_element(1, 1e-7));
                sample.estimate = sample.estimate.map(vouched);
                sample
            })
            .collect();
        let motion = smooth(&poses, GRAVITY).unwrap();
        let errors = normalised(&motion.samples[30], &(Isometry3::identity(), SVector::zeros()));
        for k in 0..6 {
            inside[k / 3] += f64::from(errors[k].abs() <= 1.96) / (3 * flights) as f64;
        }
    }
    assert!(inside.iter().all(|s| (0.9..=0.99).contains(s)), "{inside:?}");
}

/// A flight is as well known at its start as at its end, also where a part of the error lasts.
#[test]
fn the_start_is_known_as_the_end_is() {
    let (poses, _) = white_jerk(304, (1.5, 0.1));
    let noise = crate::motion_noise(&poses).unwrap();
    assert!(noise.translation.correlated[(0, 0)] > 0.0);
    let samples = smooth(&poses, GRAVITY).unwrap().samples;
    let (first, last) = (samples[0].covariance, samples[samples.len() - 1].covariance);
    for k in 0..3 {
        let ratio = (first.variance(k) / last.variance(k)).sqrt();
        assert!((0.5..2.0).contains(&ratio), "{k}: {ratio}");
    }
}
