use super::*;
use mavsight_random::Random;

const TAPE_STD_M: f64 = 0.002;

/// The corners of a frame of 3 m that nobody built at right angles, the lower four first.
fn frame(random: &mut Random) -> Vec<Vector3<f64>> {
    let corner = |k: usize| {
        let side = |bit: usize| if (k >> bit) & 1 == 1 { 3.0 } else { 0.0 };
        // Counter-clockwise from above.
        let (x, y) = if k & 2 == 0 { (side(0), 0.0) } else { (3.0 - side(0), 3.0) };
        Vector3::new(x, y, if k >= 4 { 2.9 } else { 0.05 })
    };
    (0..8).map(|k| corner(k) + Vector3::from(random.normals::<3>()) * 0.1).collect()
}

fn names() -> Vec<String> {
    (0..8).map(|k| format!("p{k}")).collect()
}

fn measure(between: MeasuredBetween, points: &[Vector3<f64>], noise: f64) -> NetworkMeasurement {
    let value_m = match between {
        MeasuredBetween::Distance(a, b) => (points[a] - points[b]).norm() + TAPE_STD_M * noise,
        MeasuredBetween::Height(a) => points[a].z + TAPE_STD_M * noise,
        MeasuredBetween::Plumb(..) => 0.0,
    };
    NetworkMeasurement { between, value_m, std_m: TAPE_STD_M }
}

fn distances(points: &[Vector3<f64>], mut noise: impl FnMut() -> f64) -> Vec<NetworkMeasurement> {
    let pairs = (0..points.len()).flat_map(|a| (a + 1..points.len()).map(move |b| (a, b)));
    pairs.map(|(a, b)| measure(MeasuredBetween::Distance(a, b), points, noise())).collect()
}

fn heights(points: &[Vector3<f64>], mut noise: impl FnMut() -> f64) -> Vec<NetworkMeasurement> {
    (0..4).map(|k| measure(MeasuredBetween::Height(k), points, noise())).collect()
}

/// A tetrahedron with an edge of one metre: the coordinates are in every textbook.
#[test]
fn a_regular_tetrahedron_has_its_closed_form() {
    let pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];
    let edge = |(a, b)| NetworkMeasurement {
        between: MeasuredBetween::Distance(a, b),
        value_m: 1.0,
        std_m: TAPE_STD_M,
    };
    let names: Vec<String> = ["a", "b", "c", "d"].map(str::to_owned).into();
    let got = points_from_distances(&names, &pairs.map(edge)).unwrap();
    let want = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.5, 0.75_f64.sqrt(), 0.0],
        [0.5, 1.0 / 12.0_f64.sqrt(), (2.0_f64 / 3.0).sqrt()],
    ];
    for (got, want) in got.points_m.iter().zip(want) {
        assert!((got - Vector3::from(want)).norm() < 1e-8, "{got} {want:?}");
    }
    assert_eq!(got.redundancy, 0);
    // A corner's covariance in the free network, by symmetry: what six edges know is spread over four corners. Along
    // an edge the difference of its ends must have the tape's variance.
    let along = Vector3::x();
    let block =
        |a: usize, b: usize| -> Matrix3<f64> { got.covariance_m2.fixed_view::<3, 3>(3 * a, 3 * b).into() };
    let var = along.dot(&((block(0, 0) + block(1, 1) - block(0, 1) - block(1, 0)) * along));
    assert!((var / (TAPE_STD_M * TAPE_STD_M) - 1.0).abs() < 1e-6, "{var}");
}

/// Any distance between two points, and any height, has an interval that holds the truth.
#[test]
fn intervals_of_two_hundred_networks_hold_the_truth() {
    let (mut inside, mut all, mut squares, mut freedom, mut refused) = (0, 0, 0.0, 0, 0);
    for seed in 0..200 {
        let mut random = Random::new(36, seed);
        let mut truth = frame(&mut random);
        // The axes of the answer: through the first two points seen from above.
        let (origin, second) = (truth[0], truth[1]);
        let turn = -(second.y - origin.y).atan2(second.x - origin.x);
        let turn = mavsight_geometry::UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn);
        for point in &mut truth {
            let level = turn * (*point - origin);
            *point = Vector3::new(level.x, level.y, point.z);
        }
        let mut measured = distances(&truth, || random.normal());
        measured.extend(heights(&truth, || random.normal()));
        let Ok(got) = points_from_distances(&names(), &measured) else {
            refused += 1;
            continue;
        };
        squares += got.chi_square;
        freedom += got.redundancy;
        let mut count = |error_m: f64, var_m2: f64| {
            inside += usize::from(error_m.abs() <= 1.959_964 * var_m2.sqrt());
            all += 1;
        };
        for (a, b) in [(0, 7), (1, 6), (2, 4), (3, 5)] {
            let (apart, true_apart) = (got.points_m[a] - got.points_m[b], truth[a] - truth[b]);
            let along = apart.normalize();
            let block = |i: usize, j: usize| -> Matrix3<f64> {
                got.covariance_m2.fixed_view::<3, 3>(3 * i, 3 * j).into()
            };
            let cov = block(a, a) + block(b, b) - block(a, b) - block(b, a);
            count(apart.norm() - true_apart.norm(), along.dot(&(cov * along)));
            count(got.points_m[a].z - truth[a].z, block(a, a)[(2, 2)]);
        }
    }
    let share = f64::from(inside as u32) / f64::from(all);
    assert!((0.93..0.97).contains(&share), "{share}");
    let ratio = squares / freedom as f64;
    assert!((0.94..1.06).contains(&ratio), "{ratio}");
    // One in a thousand is refused by chance.
    assert!(refused <= 2, "{refused}");
}

#[test]
fn a_wrong_distance_is_named_and_left_out() {
    let mut random = Random::new(5, 0);
    let truth = frame(&mut random);
    let mut measured = distances(&truth, || random.normal());
    measured.extend(heights(&truth, || random.normal()));
    measured[11].value_m += 0.1;
    let got = points_from_distances(&names(), &measured).unwrap();
    assert_eq!(got.left_out, Some(11));
    assert!((got.residuals_m[11] - 0.1).abs() < 0.02, "{}", got.residuals_m[11]);
    // Two that are wrong are no single one's fault.
    measured[3].value_m += 0.1;
    let refused = points_from_distances(&names(), &measured).unwrap_err();
    assert!(matches!(refused, DistanceRefusal::Contradictory { .. }), "{refused}");
}

#[test]
fn a_network_that_can_move_is_refused() {
    let mut random = Random::new(6, 0);
    let truth = frame(&mut random);
    // 17 distances hold 24 coordinates less 6 at most but for one.
    let few: Vec<_> = distances(&truth, || 0.0).into_iter().take(17).collect();
    let refused = points_from_distances(&names(), &few).unwrap_err();
    assert!(matches!(refused, DistanceRefusal::Loose { .. }), "{refused}");
    let mut bad = distances(&truth, || 0.0);
    bad[4].value_m = f64::NAN;
    assert!(matches!(points_from_distances(&names(), &bad), Err(DistanceRefusal::Bad { .. })));
    bad[4] = bad[3];
    assert!(points_from_distances(&names(), &bad).unwrap_err().to_string().contains("twice"));
}

/// Balls in one plane, or nearly so: noise lifts them out of it further than any covariance says.
#[test]
fn a_flat_network_is_refused() {
    for seed in 0..40 {
        let mut random = Random::new(8, seed);
        let off_m = if seed % 2 == 0 { 0.0 } else { 0.01 };
        let flat = |(k, p): (usize, &Vector3<f64>)| {
            Vector3::new(p.x + 0.2 * k as f64, p.y, if k % 2 == 0 { off_m } else { 0.0 })
        };
        let flat: Vec<Vector3<f64>> = frame(&mut random).iter().enumerate().map(flat).collect();
        let mut measured = distances(&flat, || random.normal());
        let refused = points_from_distances(&names(), &measured).unwrap_err();
        assert!(
            matches!(refused, DistanceRefusal::Loose { .. } | DistanceRefusal::Flat { .. }),
            "{seed}: {refused}"
        );
        // Heights of all of them hold them.
        measured.extend((0..8).map(|k| measure(MeasuredBetween::Height(k), &flat, random.normal())));
        let held = points_from_distances(&names(), &measured).unwrap();
        assert!((0..8).all(|k| (held.points_m[k].z - flat[k].z).abs() < 4.0 * TAPE_STD_M), "{seed}");
    }
}

/// Strings with weights give the vertical without any height.
#[test]
fn plumb_lines_stand_upright() {
    let mut random = Random::new(7, 0);
    let mut truth = frame(&mut random);
    for k in 0..4 {
        truth[4 + k].x = truth[k].x;
        truth[4 + k].y = truth[k].y;
    }
    let mut measured = distances(&truth, || random.normal());
    measured.extend((0..4).map(|k| measure(MeasuredBetween::Plumb(4 + k, k), &truth, 0.0)));
    let got = points_from_distances(&names(), &measured).unwrap();
    for k in 0..4 {
        let apart = got.points_m[4 + k] - got.points_m[k];
        assert!(apart.z > 2.0 && apart.xy().norm() < 4.0 * TAPE_STD_M, "{apart}");
        let rise_m = (got.points_m[k].z - got.points_m[0].z) - (truth[k].z - truth[0].z);
        assert!(rise_m.abs() < 10.0 * TAPE_STD_M, "{rise_m}");
    }
    assert_eq!((got.points_m[0].norm(), got.points_m[1].y.abs() < 1e-12), (0.0, true));
}
