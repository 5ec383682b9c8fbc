use super::tests::{GRAVITY, coverage, exact, filmed, flight};
use super::{smooth, smooth_with_rates};
use crate::{Motion, PoseError, PoseSample, RateError, RateSeries, RatesRefusal};
use mavsight_geometry::Vector3;
use mavsight_random::Random;
use nalgebra::{Matrix6xX, SVector};

/// Poses of a flight of sines, and rates of a gyroscope at 400 Hz whose constant error is drawn from its uncertainty.
fn with_gyroscope(seed: u64, missing: impl Fn(i64) -> bool) -> (Vec<PoseSample>, RateSeries) {
    let mut random = Random::new(seed, 3);
    let poses = filmed(300, 1.0, &mut random, missing);
    let bias = Vector3::from(random.normals()) * 5e-5;
    let times_ns: Vec<i64> = (0..4000).map(|k| k * 2_500_000).collect();
    let rates = times_ns.iter().map(|t_ns| {
        let rate = exact(*t_ns as f64 * 1e-9).fixed_rows::<3>(3).into_owned();
        rate + bias + Vector3::from(random.normals()) * 2.5e-3
    });
    let rates = rates.collect();
    let error = |axis: usize| RateError { bias_rad_s: Vector3::ith(axis, 5e-5), ..RateError::default() };
    (poses, RateSeries::new(times_ns, rates, (0..3).map(error).collect()).unwrap())
}

#[test]
fn a_gyroscope_sharpens_attitude_and_rates_and_leads_through_a_gap() {
    let (mut inside, mut ratios, flights) = ([0.0; 2], [0.0; 2], 4);
    for seed in 0..flights {
        let gap = |k: i64| (120..138).contains(&k);
        let (poses, rates) = with_gyroscope(seed, gap);
        let at = |motion: &Motion, i: usize| motion.samples[i].t_ns as f64 * 1e-9;
        let alone = smooth(&poses, GRAVITY).unwrap();
        let both = smooth_with_rates(&poses, &|_| None, &rates, GRAVITY).unwrap();
        // All instants are known, also those of the gap.
        assert_eq!(both.samples.len(), poses.len(), "{:?}", both.doubts);
        let truth = |i: usize| (flight(at(&both, i)), exact(at(&both, i)));
        let (_, rms) = coverage(&both, truth);
        let (_, film) = coverage(&alone, |i| (flight(at(&alone, i)), exact(at(&alone, i))));
        for q in 0..2 {
            let of = |rms: &SVector<f64, 18>| rms.fixed_rows::<3>([3, 9][q]).norm();
            ratios[q] += of(&rms) / of(&film) / flights as f64;
        }
        for (i, s) in both.samples.iter().enumerate() {
            let (pose, rest) = truth(i);
            let turn = (pose.rotation.inverse() * s.world_from_body.rotation).scaled_axis();
            let rate = s.rates_rad_s - rest.fixed_rows::<3>(3);
            for (q, error) in [turn, rate].iter().enumerate() {
                let std = s.covariance.quantity(2 * q + 1).diagonal().map(f64::sqrt);
                let held = (0..3).filter(|k| error[*k].abs() <= 1.96 * std[*k]).count();
                inside[q] += held as f64 / (900 * flights) as f64;
            }
            if gap(i as i64) {
                assert!(turn.norm() < 5e-3 && turn.norm() < 5.0 * s.covariance.quantity(1).trace().sqrt());
            }
        }
    }
    assert!(ratios[0] < 0.7 && ratios[1] < 0.4, "{ratios:?}");
    // Sines are smoother than white jerk: their intervals may hold more than they claim.
    assert!(inside.iter().all(|share| *share >= 0.9), "{inside:?}");
}

#[test]
fn a_gyroscope_that_contradicts_the_poses_is_refused() {
    let (poses, rates) = with_gyroscope(9, |_| false);
    let turned = rates.rates_rad_s().iter().map(|r| Vector3::new(r.y, -r.x, r.z)).collect();
    let turned = RateSeries::new(rates.times_ns().to_vec(), turned, Vec::new()).unwrap();
    let refused = smooth_with_rates(&poses, &|_| None, &turned, GRAVITY);
    let Err(PoseError::Rates(RatesRefusal::Disagree { with, without, loss })) = refused else {
        panic!("{refused:?}")
    };
    assert!(with > 3.0 * without && loss > 0.0, "{with} {without} {loss}");
    let elsewhere = RateSeries::new(vec![-5, -3, -1], vec![Vector3::zeros(); 3], Vec::new()).unwrap();
    let refused = smooth_with_rates(&poses, &|_| None, &elsewhere, GRAVITY);
    assert!(matches!(refused, Err(PoseError::Rates(RatesRefusal::TooFew { found: 0, .. }))), "{refused:?}");
}

/// Poses of a film hold six condensed columns of what is systematic, and their effects are formed anew.
#[test]
fn a_gyroscope_beside_poses_with_condensed_systematic_errors_is_taken() {
    let (mut poses, rates) = with_gyroscope(11, |_| false);
    let effects = Matrix6xX::from_fn(8, |i, k| if i == k % 6 { 1e-4 } else { 0.0 });
    for pose in &mut poses {
        let estimate = pose.estimate.clone().unwrap();
        pose.estimate = Ok(estimate.with_systematic(&effects.map(|v| v as f32)).condensed());
    }
    assert!(poses.iter().all(|p| p.estimate.as_ref().unwrap().is_condensed()));
    let plain = smooth_with_rates(&with_gyroscope(11, |_| false).0, &|_| None, &rates, GRAVITY).unwrap();
    for formed in [None, Some(effects)] {
        let both = smooth_with_rates(&poses, &|_| formed.clone(), &rates, GRAVITY).unwrap();
        for (with, without) in both.samples.iter().zip(&plain.samples) {
            assert!((with.rates_rad_s - without.rates_rad_s).norm() < 1e-9);
            assert!(with.covariance.quantity(0).trace() > without.covariance.quantity(0).trace());
        }
    }
}
