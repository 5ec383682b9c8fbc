//! How close centres come to what the pixels permit: balls of 5, 10 and 30 px filmed in the virtual room,
//! noise of two grey levels, error of the tracked centres over the Cramér-Rao bound of the very same
//! images; and of that the part that changes from frame to frame at a place, which is the noise's, without
//! the systematic part.
//!
//! `cargo run --release -p mavsight --example centre_bound`

use mavsight::flight::Vehicle;
use mavsight::geometry::{Camera, ImageSize, Intrinsics, Point3, Vector2, Vector3};
use mavsight::random::Random;
use mavsight::scene::{ControlFrame, Film, PaintedBall, Room, Sensor};
use mavsight::vision::{BallColor, Frame, Tracker};
use nalgebra::{DMatrix, Matrix2};

const NOISE_LEVELS: f64 = 2.0;
/// Rounding to whole levels adds its own variance.
const VARIANCE: f64 = NOISE_LEVELS * NOISE_LEVELS + 1.0 / 12.0;
/// Standard deviation of the directions from which a ball mirrors the lamps.
const LAMPS_RAD: f64 = 0.3;
const PLACES: u64 = 24;
const FRAMES_AT_A_PLACE: u64 = 25;
const SIZE: ImageSize = ImageSize { width_px: 640, height_px: 480 };

fn camera() -> Camera {
    let intrinsics = Intrinsics::from_horizontal_fov(SIZE, 53_f64.to_radians());
    Camera::looking_at(Vector3::new(4.5, -4.5, 1.5), Vector3::new(0.0, 0.0, 1.5), intrinsics, SIZE)
}

/// A film camera, sharp or a little less, without noise of its own.
fn film(room: &Room, lens_blur_px: f64) -> Film<'_> {
    Film::new(room, camera(), Sensor { noise: false, lens_blur_px, ..Sensor::default() })
}

fn shown(film: &Film<'_>, ball: &PaintedBall) -> Vec<u8> {
    film.still(Some(&ControlFrame::new(std::slice::from_ref(ball))))
}

fn pixel_of(ball: &PaintedBall) -> Vector2<f64> {
    camera().project_ball(&ball.centre_m, ball.radius_m).expect("in view").pixel
}

/// Difference of two images over a step: the derivative of every sample.
fn derivative(up: &[u8], down: &[u8], step: f64) -> Vec<f64> {
    up.iter().zip(down).map(|(a, b)| (f64::from(*a) - f64::from(*b)) / step).collect()
}

/// Least covariance of an unbiased centre, px²: with all else known, and with what must be estimated along
/// with it: radius, blur, colour, the light on the ball in first and second harmonics and in the fourth
/// about the vertical, and what its gloss adds: slopes, and the image of lamps straight above.
fn bounds(sharp: &Film<'_>, softer: &Film<'_>, ball: &PaintedBall) -> (Matrix2<f64>, Matrix2<f64>) {
    let view = camera();
    let right = view.cam_from_world.rotation.inverse() * Vector3::x();
    let down = view.cam_from_world.rotation.inverse() * Vector3::y();
    let depth_m = (view.cam_from_world * Point3::from(ball.centre_m)).z;
    let half_px_m = 0.5 * depth_m / view.intrinsics.fx_px;
    let moved = |by: Vector3<f64>| PaintedBall { centre_m: ball.centre_m + by, ..*ball };
    let between = |up: &PaintedBall, down: &PaintedBall, step: f64| {
        derivative(&shown(sharp, up), &shown(sharp, down), step)
    };
    let mut columns = vec![
        between(&moved(right * half_px_m), &moved(-right * half_px_m), 1.0),
        between(&moved(down * half_px_m), &moved(-down * half_px_m), 1.0),
    ];
    let resized = |by: f64| PaintedBall { radius_m: ball.radius_m + by, ..*ball };
    columns.push(between(&resized(half_px_m), &resized(-half_px_m), 1.0));
    columns.push(derivative(&shown(softer, ball), &shown(sharp, ball), 0.1));
    // Change of every sample with the ball's light as it is coloured, and with neutral light that a gloss
    // adds.
    let (mut lit, mut glossy) = (vec![0.0; 3 * SIZE.area_px()], vec![0.0; 3 * SIZE.area_px()]);
    for channel in 0..3 {
        let dyed = |by: f64| {
            let mut linear = ball.linear;
            linear[channel] *= 1.0 + by;
            PaintedBall { linear, ..*ball }
        };
        let by_color = between(&dyed(0.1), &dyed(-0.1), 0.2);
        for ((lit, glossy), d) in lit.iter_mut().zip(&mut glossy).zip(&by_color) {
            *lit += d;
            *glossy += d / ball.linear[channel];
        }
        columns.push(by_color);
    }
    let centre = pixel_of(ball);
    let radius_px = ball.radius_m / (2.0 * half_px_m);
    let over = |light: &[f64], harmonic: &dyn Fn(f64, f64, f64) -> f64| -> Vec<f64> {
        let at = |k: usize| {
            let place = (Vector2::new((k / 3 % 640) as f64, (k / 3 / 640) as f64) - centre) / radius_px;
            harmonic(place.x, place.y, (1.0 - place.norm_squared()).max(0.0).sqrt())
        };
        light.iter().enumerate().map(|(k, v)| if *v == 0.0 { 0.0 } else { v * at(k) }).collect()
    };
    let harmonics: [&dyn Fn(f64, f64, f64) -> f64; 9] = [
        &|x, _, _| x,
        &|_, y, _| y,
        &|_, _, z| z,
        &|x, y, _| x * y,
        &|x, _, z| x * z,
        &|_, y, z| y * z,
        &|x, y, _| x * x - y * y,
        &|_, _, z| z * z,
        &|_, y, _| (35.0 * y.powi(4) - 30.0 * y * y + 3.0) / 8.0,
    ];
    columns.extend(harmonics.iter().map(|h| over(&lit, *h)));
    columns.extend(harmonics[..2].iter().map(|h| over(&glossy, *h)));
    // Straight up, to the right, down and towards the camera.
    let up = Vector3::new(right.z, down.z, down.cross(&right).z);
    columns.push(over(&glossy, &|x, y, z| {
        let mirrored = Vector3::new(2.0 * z * x, 2.0 * z * y, 2.0 * z * z - 1.0);
        ((mirrored.dot(&up) - 1.0) / (LAMPS_RAD * LAMPS_RAD)).exp()
    }));
    let n = columns.len();
    let information = DMatrix::from_fn(n, n, |i, j| {
        columns[i].iter().zip(&columns[j]).map(|(a, b)| a * b).sum::<f64>() / VARIANCE
    });
    let alone = information.fixed_view::<2, 2>(0, 0).try_inverse().expect("a ball in view");
    let all = information.try_inverse().expect("a ball in view");
    (alone, all.fixed_view::<2, 2>(0, 0).into_owned())
}

fn noisy(image: &[u8], random: &mut Random) -> Vec<u8> {
    image.iter().map(|v| (f64::from(*v) + NOISE_LEVELS * random.normal()).round() as u8).collect()
}

/// Sums over all centres of one ball: squared error, both bounds, squared normalised error, number, error
/// in u and v, and the part of the squared error that is the noise's.
#[derive(Default)]
struct Sums([f64; 8]);

fn follow(films: &[Film<'_>; 2], marker: (&str, [u8; 3], [f64; 3]), diameter_px: f64, sums: &mut Sums) {
    let [sharp, softer] = films;
    let view = camera();
    let colors = [BallColor { name: marker.0.to_owned(), rgb: marker.1 }];
    let range_px = 0.5 * diameter_px..=2.0 * diameter_px;
    let mut tracker = Tracker::new(&colors, range_px).expect("a tracker").with_camera(view);
    let mut random = Random::new(1, diameter_px as u64);
    for _ in 0..PLACES {
        let mut around = || 0.006 * random.normal();
        let centre_m = Vector3::new(-1.46 + around(), 0.85 + around(), 2.0 + around());
        let depth_m = (view.cam_from_world * Point3::from(centre_m)).z;
        let radius_m = 0.5 * diameter_px * depth_m / view.intrinsics.fx_px;
        let ball = PaintedBall { centre_m, radius_m, linear: marker.2 };
        let image = shown(sharp, &ball);
        let (alone, all) = bounds(sharp, softer, &ball);
        let (mut at_place, mut square, mut seen_here) = (Vector2::zeros(), 0.0, 0.0_f64);
        for _ in 0..FRAMES_AT_A_PLACE {
            let frame = Frame::from_rgb(SIZE, noisy(&image, &mut random)).expect("a frame");
            // The room holds other objects of a marker's colour; which is the marker is not asked here.
            let truth = pixel_of(&ball);
            let detections = tracker.update(&frame).iter().map(|s| s.detection);
            let near = detections.filter(|seen| (seen.pixel - truth).norm() < 0.5 * diameter_px);
            let Some(seen) = near.max_by(|a, b| a.diameter_px.total_cmp(&b.diameter_px)) else { continue };
            let error = seen.pixel - truth;
            let claimed = seen.covariance_px2.try_inverse().expect("a covariance");
            let one = [
                error.norm_squared(),
                alone.trace(),
                all.trace(),
                error.dot(&(claimed * error)),
                1.0,
                error.x,
                error.y,
                0.0,
            ];
            at_place += error;
            square += error.norm_squared();
            seen_here += 1.0;
            sums.0.iter_mut().zip(one).for_each(|(sum, v)| *sum += v);
        }
        // One of the frames' freedoms goes to their mean.
        let around_mean = square - at_place.norm_squared() / seen_here.max(1.0);
        sums.0[7] += around_mean * seen_here / (seen_here - 1.0).max(1.0);
    }
}

fn main() {
    let room = Room::meeting_room();
    let films = [film(&room, 0.5), film(&room, 0.6)];
    println!("noise {NOISE_LEVELS} levels, {} frames a ball", PLACES * FRAMES_AT_A_PLACE);
    println!(
        "ball            found  RMS, px  over the bound  its noise over it  over that with all else known  NEES/2  mean error, px"
    );
    for diameter_px in [5.0, 10.0, 30.0] {
        for marker in Vehicle::paper().marker {
            let mut sums = Sums::default();
            let painted = (marker.name.as_str(), marker.color.rgb(), marker.color.to_linear());
            follow(&films, painted, diameter_px, &mut sums);
            let [square, alone, all, normalised, count, u, v, noise] = sums.0;
            println!(
                "{diameter_px:4.0} px {:8} {count:5.0}  {:.4}         {:.2}               {:.2}                 {:.2}                      {:.2}     {:+.4} {:+.4}",
                marker.name,
                (0.5 * square / count).sqrt(),
                (square / all).sqrt(),
                (noise / all).sqrt(),
                (square / alone).sqrt(),
                0.5 * normalised / count,
                u / count,
                v / count
            );
        }
    }
}
