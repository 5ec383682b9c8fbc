//! Balls at the end of a rod, as those of a control frame are, drawn by supersampling and measured through
//! the public calls.
#![allow(clippy::unwrap_used, clippy::panic)]

use mavsight_random::Random;
use mavsight_vision::{BallColor, Detector, Frame, ImageSize, Vector2};

const SIZE: ImageSize = ImageSize { width_px: 40, height_px: 40 };
const BLUR_PX: f64 = 0.5;
const WALL: [f64; 3] = [0.45, 0.42, 0.36];
const ROD: [f64; 3] = [0.05; 3];
const BALL: [f64; 3] = [0.06, 0.014, 0.16];

fn code(linear: f64) -> f64 {
    255.0 * if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// A ball before the wall and a rod that leaves it in a direction.
struct Scene {
    middle: Vector2<f64>,
    radius_px: f64,
    along: Vector2<f64>,
    rod_px: f64,
    /// Where the rod begins, from the middle: less than the radius where it lies before the ball's face.
    from_px: f64,
}

/// Light over the pixel and a Gaussian blur, with two levels of noise.
fn still(scene: &Scene, seed: u32) -> Frame {
    let along = scene.along;
    let light_at = |at: Vector2<f64>| {
        let d = at - scene.middle;
        let (far, aside) = (d.dot(&along), d.x * along.y - d.y * along.x);
        if far > scene.from_px && aside.abs() < 0.5 * scene.rod_px {
            ROD
        } else if d.norm() < scene.radius_px {
            BALL
        } else {
            WALL
        }
    };
    let taps: Vec<f64> = (-20..=20).map(|k| 0.1 * f64::from(k)).collect();
    let weight = |offset: f64| {
        let edge = |z: f64| 1.0 / (1.0 + (-1.5976 * z - 0.070_565 * z * z * z).exp());
        edge((offset + 0.5) / BLUR_PX) - edge((offset - 0.5) / BLUR_PX)
    };
    let mut random = Random::new(seed.into(), 0);
    let mut rgb = Vec::new();
    for (y, x) in (0..SIZE.height_px).flat_map(|y| (0..SIZE.width_px).map(move |x| (y, x))) {
        let (mut light, mut total) = ([0.0; 3], 0.0);
        for (dy, dx) in taps.iter().flat_map(|dy| taps.iter().map(move |dx| (dy, dx))) {
            let share = weight(*dx) * weight(*dy);
            let here = light_at(Vector2::new(f64::from(x) + dx, f64::from(y) + dy));
            light.iter_mut().zip(here).for_each(|(sum, value)| *sum += share * value);
            total += share;
        }
        rgb.extend(light.map(|l| (code(l / total) + 2.0 * random.normal()).round().clamp(0.0, 255.0) as u8));
    }
    Frame::from_rgb(SIZE, rgb).unwrap()
}

/// Over 24 balls: mean error along the rod, and squared errors over what is claimed, per coordinate.
fn measured(radius_px: f64, rod_px: f64, from_px: f64) -> (f64, f64) {
    let color = BallColor { name: "violet".into(), rgb: [80, 48, 120] };
    let mut detector = Detector::new(&[color]).unwrap();
    let (mut pull, mut square) = (0.0, 0.0);
    const COUNT: u32 = 24;
    for k in 0..COUNT {
        let angle = 0.7 * f64::from(k);
        let along = Vector2::new(angle.cos(), angle.sin());
        let middle = Vector2::new(20.0 + 0.37 * f64::from(k % 5), 19.6 + 0.21 * f64::from(k % 7));
        let scene = Scene { middle, radius_px, along, rod_px, from_px };
        let found = detector.detect(&still(&scene, k + 1), 3.0..=20.0);
        let ball = found[0].first().unwrap_or_else(|| panic!("no ball at a rod in direction {angle}"));
        let error = ball.pixel - middle;
        pull += error.dot(&along);
        let precision = ball.covariance_px2.try_inverse().unwrap();
        square += (error.transpose() * precision * error)[0];
    }
    let count = f64::from(COUNT);
    (pull / count, square / (2.0 * count))
}

#[test]
fn a_rod_that_ends_at_a_ball_does_not_draw_its_centre() {
    let (mean_px, square) = measured(2.3, 0.9, 2.3);
    assert!(mean_px.abs() < 0.012, "drawn {mean_px} px along the rod");
    assert!(square < 1.6, "errors are {square} times what is claimed");
}

#[test]
fn a_rod_before_a_balls_face_does_not_draw_its_centre() {
    let (mean_px, square) = measured(4.0, 0.9, 2.0);
    assert!(mean_px.abs() < 0.012, "drawn {mean_px} px along the rod");
    assert!(square < 1.6, "errors are {square} times what is claimed");
}

/// Its parts are two regions of the image, none of which is a disc.
#[test]
fn a_ball_that_an_arm_cuts_in_two_is_found_whole() {
    let (mean_px, square) = measured(7.0, 2.5, -20.0);
    assert!(mean_px.abs() < 0.02, "drawn {mean_px} px along the arm");
    assert!(square < 1.6, "errors are {square} times what is claimed");
}
