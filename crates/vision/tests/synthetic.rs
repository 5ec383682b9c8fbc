//! Balls drawn by supersampling, which shares nothing with the fit's analytic edge, measured through the
//! public calls.
#![allow(clippy::unwrap_used, clippy::panic)]

use mavsight_random::Random;
use mavsight_vision::{BallColor, Detector, Frame, ImageSize, Tracker, Vector2, VisionError, YuvMatrix};

const SIZE: ImageSize = ImageSize { width_px: 64, height_px: 48 };

#[derive(Clone, Copy)]
struct Drawn {
    middle: Vector2<f64>,
    radius_px: f64,
    light: [f64; 3],
    shade_per_radius: Vector2<f64>,
    /// Direction of a lamp that gives four fifths of the light, x, y and towards the camera.
    lamp: Option<[f64; 3]>,
}

fn ball(u: f64, v: f64) -> Drawn {
    Drawn {
        middle: Vector2::new(u, v),
        radius_px: 2.6,
        light: [0.6, 0.03, 0.03],
        shade_per_radius: Vector2::zeros(),
        lamp: None,
    }
}

impl Drawn {
    /// Light at a place of the face over that of the ball's colour.
    fn lit(&self, at: Vector2<f64>) -> f64 {
        let d = (at - self.middle) / self.radius_px;
        let towards = (1.0 - d.norm_squared()).max(0.0).sqrt();
        let lamp = self.lamp.map_or(1.0, |l| 0.2 + 0.8 * (l[0] * d.x + l[1] * d.y + l[2] * towards).max(0.0));
        lamp * (1.0 + self.shade_per_radius.dot(&d))
    }
}

fn code(linear: f64) -> f64 {
    let l = linear.clamp(0.0, 1.0);
    255.0 * if l <= 0.003_130_8 { 12.92 * l } else { 1.055 * l.powf(1.0 / 2.4) - 0.055 }
}

/// Draws balls before a wall with a gradient: Gaussian blur of `blur_px` and a pixel's box by 41 × 41
/// supersampling.
fn draw(balls: &[Drawn], blur_px: f64, noise: f64, random: &mut Random) -> Vec<u8> {
    let wall = |at: Vector2<f64>| [0.45 + 0.001 * at.x, 0.42 + 0.001 * at.y, 0.36];
    draw_before(wall, balls, blur_px, noise, random)
}

/// The same before another wall.
fn draw_before(
    wall: impl Fn(Vector2<f64>) -> [f64; 3],
    balls: &[Drawn],
    blur_px: f64,
    noise: f64,
    random: &mut Random,
) -> Vec<u8> {
    let mut rgb = Vec::new();
    let taps: Vec<(f64, f64)> = (-20..=20).map(|i| (f64::from(i) * 0.1, f64::from(i))).collect();
    let kernel = |offset: f64| {
        // Box of one pixel convolved with the Gaussian, at `offset`.
        let edge = |z: f64| 1.0 / (1.0 + (-1.5976 * z - 0.070_565 * z * z * z).exp());
        edge((offset + 0.5) / blur_px) - edge((offset - 0.5) / blur_px)
    };
    for y in 0..SIZE.height_px {
        for x in 0..SIZE.width_px {
            let (x, y) = (f64::from(x), f64::from(y));
            let mut light = [0.0; 3];
            let mut total = 0.0;
            let near = balls.iter().any(|b| (b.middle - Vector2::new(x, y)).norm() < b.radius_px + 3.0);
            for (dx, _) in &taps {
                for (dy, _) in &taps {
                    if !near && (*dx != 0.0 || *dy != 0.0) {
                        continue;
                    }
                    let weight = kernel(*dx) * kernel(*dy);
                    let at = Vector2::new(x + dx, y + dy);
                    let hit = balls.iter().find(|b| (at - b.middle).norm() < b.radius_px);
                    let behind = wall(at);
                    for c in 0..3 {
                        light[c] += weight * hit.map_or(behind[c], |b| b.light[c] * b.lit(at));
                    }
                    total += weight;
                }
            }
            for channel in light {
                rgb.push((code(channel / total) + noise * random.normal()).round().clamp(0.0, 255.0) as u8);
            }
        }
    }
    rgb
}

fn frame(balls: &[Drawn], blur_px: f64, noise: f64, random: &mut Random) -> Frame {
    Frame::from_rgb(SIZE, draw(balls, blur_px, noise, random)).unwrap()
}

fn red() -> Vec<BallColor> {
    vec![BallColor { name: "red".into(), rgb: [208, 42, 42] }]
}

/// Errors of the best candidate over many places, and the mean of the squared error over its covariance per
/// axis.
fn trial(count: usize, blur_px: f64, noise: f64, shade: Vector2<f64>) -> (Vector2<f64>, f64, f64) {
    let mut detector = Detector::new(&red()).unwrap();
    let mut random = Random::new(7, 1);
    let (mut sum, mut square, mut normalized) = (Vector2::zeros(), 0.0, 0.0);
    for _ in 0..count {
        let drawn =
            Drawn { shade_per_radius: shade, ..ball(30.0 + random.uniform(), 22.0 + random.uniform()) };
        let frame = frame(&[drawn], blur_px, noise, &mut random);
        let found = detector.detect(&frame, 3.0..=10.0);
        let best = found[0].first().expect("the ball is found");
        let error = best.pixel - drawn.middle;
        sum += error;
        square += error.norm_squared() / 2.0;
        normalized += error.dot(&(best.covariance_px2.try_inverse().unwrap() * error)) / 2.0;
    }
    let count = count as f64;
    (sum / count, (square / count).sqrt(), normalized / count)
}

#[test]
fn centres_are_unbiased_under_blur_noise_and_shading() {
    for (blur_px, shade) in
        [(0.3, Vector2::zeros()), (0.6, Vector2::new(0.0, -0.5)), (1.0, Vector2::new(0.3, -0.3))]
    {
        let (bias, rms_px, _) = trial(40, blur_px, 2.0, shade);
        println!("blur {blur_px}: bias {:.4} {:.4}, rms {rms_px:.4} px", bias.x, bias.y);
        assert!(bias.amax() < 0.02 && rms_px < 0.06, "blur {blur_px}: bias {bias:?}, rms {rms_px}");
    }
}

/// Of a pixel that is covered but for a hundredth, the wall there is two grey levels of a ball's dark
/// channels: with any wall for the one there is, the ball moves by up to 0.01 px, back and forth with its
/// place in a pixel.
#[test]
fn a_small_ball_before_a_dim_wall_is_where_it_is() {
    let (mut detector, mut random) = (Detector::new(&red()).unwrap(), Random::new(5, 1));
    let (mut square, mut count) = (0.0, 0.0);
    for k in 0..16_u32 {
        let middle = Vector2::new(30.0 + f64::from(k % 4) / 4.0, 22.125 + f64::from(k / 4) / 4.0);
        let drawn = Drawn { radius_px: 2.5, middle, light: [0.4, 0.012, 0.012], ..ball(0.0, 0.0) };
        let rgb = draw_before(|_| [0.2; 3], &[drawn], 0.5, 0.3, &mut random);
        let found = detector.detect(&Frame::from_rgb(SIZE, rgb).unwrap(), 3.0..=10.0);
        square += (found[0].first().expect("the ball is found").pixel - middle).norm_squared();
        count += 2.0;
    }
    let rms_px = f64::sqrt(square / count);
    assert!(rms_px < 0.004, "{rms_px} px");
}

/// A fit counts places from the corner of what it looks at, so that single precision holds them; what is
/// reported is in the image.
#[test]
fn a_ball_far_from_the_corner_of_a_large_image_is_where_it_is() {
    const LEFT: usize = 2016;
    let size = ImageSize { width_px: 4096, ..SIZE };
    let (mut detector, mut random) = (Detector::new(&red()).unwrap(), Random::new(13, 1));
    for k in 0..4_u32 {
        let middle = Vector2::new(32.0 + 0.3 * f64::from(k), 24.0 - 0.2 * f64::from(k));
        let drawn = Drawn { radius_px: 4.0, middle, ..ball(0.0, 0.0) };
        let small = draw_before(|_| [0.2; 3], &[drawn], 0.5, 0.3, &mut random);
        let mut rgb = vec![code(0.2).round() as u8; 3 * size.area_px()];
        let rows = rgb.chunks_exact_mut(3 * size.width_px as usize);
        for (row, small) in rows.zip(small.chunks_exact(3 * SIZE.width_px as usize)) {
            row[3 * LEFT..3 * LEFT + small.len()].copy_from_slice(small);
        }
        let found = detector.detect(&Frame::from_rgb(size, rgb).unwrap(), 3.0..=16.0);
        let seen = found[0].first().expect("the ball is found").pixel - Vector2::new(LEFT as f64, 0.0);
        assert!((seen - middle).norm() < 0.005, "{seen} for {middle}");
    }
}

/// One lamp from the side leaves half of a ball in the dark, behind an edge that no order of harmonics has.
#[test]
fn a_ball_that_one_lamp_lights_is_where_it_is() {
    let (mut detector, mut random) = (Detector::new(&red()).unwrap(), Random::new(11, 1));
    let (mut bias, mut turns) = (0.0, 0.0);
    for k in 0..30_u32 {
        let (sin, cos) = (0.9 * f64::from(k)).sin_cos();
        let middle = Vector2::new(30.0 + random.uniform(), 22.0 + random.uniform());
        let lamp = Some([cos, sin, 0.0]);
        let drawn = Drawn { radius_px: 5.0, lamp, middle, ..ball(0.0, 0.0) };
        let frame = frame(&[drawn], 0.5, 0.3, &mut random);
        let found = detector.detect(&frame, 3.0..=16.0);
        let error = found[0].first().expect("the ball is found").pixel - middle;
        bias += error.dot(&Vector2::new(cos, sin));
        turns += 1.0;
    }
    assert!((bias / turns).abs() < 0.003, "{} px towards the lamp", bias / turns);
}

#[test]
fn covariance_holds_the_errors() {
    for noise in [2.0, 12.0] {
        let (_, rms_px, normalized) = trial(60, 0.5, noise, Vector2::new(0.0, -0.3));
        println!("noise {noise}: rms {rms_px:.4} px, normalised {normalized:.2}");
        // The mean of 60 × 2 squared normal numbers is 1 ± 0.13; the allowance for light that is not modelled
        // makes the covariance larger where the noise is small.
        assert!(normalized < 1.5, "noise {noise}: {normalized}");
        assert!(noise < 10.0 || normalized > 0.3, "noise {noise}: {normalized}");
    }
}

/// The lower part of the ball is before a lamp whose light is beyond what can be shown: how far in its light
/// reaches remains unknown, and a centre that takes the lamp for as bright as it looks is half a pixel too
/// high.
#[test]
fn a_lamp_behind_a_part_of_a_ball_does_not_move_it() {
    let (mut detector, mut random, mut normalized) = (Detector::new(&red()).unwrap(), Random::new(5, 1), 0.0);
    const COUNT: usize = 30;
    for k in 0..COUNT {
        let drawn = Drawn { radius_px: 5.0, ..ball(30.0 + random.uniform(), 22.0 + random.uniform()) };
        let edge_px = drawn.middle.y - 1.0 + 3.0 * random.uniform();
        let lamp = [3.0, 7.0, 30.0][k % 3];
        let wall = |at: Vector2<f64>| if at.y > edge_px { [lamp; 3] } else { [0.12; 3] };
        let rgb = draw_before(wall, &[drawn], 0.5, 2.0, &mut random);
        let found = detector.detect(&Frame::from_rgb(SIZE, rgb).unwrap(), 3.0..=16.0);
        let best = found[0].first().expect("the ball is found");
        let error = best.pixel - drawn.middle;
        normalized += error.dot(&(best.covariance_px2.try_inverse().unwrap() * error)) / (2 * COUNT) as f64;
    }

    assert!(normalized < 2.0, "normalised {normalized}");
}

#[test]
fn a_ball_that_is_not_there_is_not_found() {
    let colors = [red().remove(0), BallColor { name: "blue".into(), rgb: [51, 69, 192] }];
    let mut tracker = Tracker::new(&colors, 3.0..=10.0).unwrap();
    let mut random = Random::new(3, 1);
    for step in 0..6 {
        let drawn = ball(20.0 + f64::from(step), 20.0);
        let seen = tracker.update_preferred(&frame(&[drawn], 0.5, 2.0, &mut random)).to_vec();
        assert!((seen[0].unwrap().pixel - drawn.middle).norm() < 0.2);
        assert!(seen[1].is_none());
    }
    assert_eq!(tracker.update_preferred(&frame(&[], 0.5, 2.0, &mut random)), [None, None]);
    // It comes back far from where it was last seen, and is found again.
    let drawn = ball(50.0, 35.0);
    let seen = tracker.update_preferred(&frame(&[drawn], 0.5, 2.0, &mut random));
    assert!((seen[0].unwrap().pixel - drawn.middle).norm() < 0.2);
}

/// A static ball of the marker's colour, and the marker that crosses it: both are there, and the one that
/// moves leads.
#[test]
fn everything_of_a_colour_is_followed_and_what_moves_leads() {
    let mut tracker = Tracker::new(&red(), 3.0..=10.0).unwrap();
    let mut random = Random::new(5, 1);
    let decoy = ball(20.0, 14.0);
    let mut ids = std::collections::BTreeSet::new();
    for step in 0..40 {
        let drawn = ball(14.0 + f64::from(step), 30.0);
        let hidden = (20..24).contains(&step);
        let balls = if hidden { vec![decoy] } else { vec![decoy, drawn] };
        let seen = tracker.update(&frame(&balls, 0.5, 2.0, &mut random)).to_vec();
        let at = |middle: Vector2<f64>| seen.iter().find(|s| (s.detection.pixel - middle).norm() < 0.3);
        assert!(at(decoy.middle).is_some(), "step {step}: {seen:?}");
        let marker = at(drawn.middle);
        assert_eq!(marker.is_none(), hidden, "step {step}: {seen:?}");
        ids.extend(marker.map(|m| m.id));
        if step > 12 && !hidden {
            let lead = tracker.clone().update_preferred(&frame(&balls, 0.5, 2.0, &mut random))[0].unwrap();
            assert!((lead.pixel - drawn.middle).norm() < 0.3, "step {step}");
        }
    }
    assert_eq!(ids.len(), 1, "one object has one number: {ids:?}");
}

/// A newcomer beside what is followed is seen within a look around in bands; who follows and looks in two
/// steps gets it once it has been seen in some frames.
#[test]
fn newcomers_are_reported_once_they_have_been_seen_in_some_frames() {
    let mut tracker = Tracker::new(&red(), 3.0..=10.0).unwrap();
    let mut random = Random::new(9, 1);
    let (known, newcomer) = (ball(20.0, 14.0), ball(44.0, 33.0));
    for _ in 0..3 {
        assert_eq!(tracker.update(&frame(&[known], 0.5, 2.0, &mut random)).len(), 1);
    }
    let mut stepwise = tracker.clone();
    let (mut seen, mut reported) = (Vec::new(), Vec::new());
    for _ in 0..14 {
        let image = frame(&[known, newcomer], 0.5, 2.0, &mut random);
        let all = tracker.update(&image);
        seen.push(all.len());
        let first = stepwise.follow(&image);
        reported.push(first.len());
        assert_eq!(first, &all[..first.len()]);
        stepwise.look_around(&image);
        stepwise.look_around(&image);
    }
    assert_eq!((seen[0], seen[8]), (1, 2), "{seen:?}");
    // The frame in which it was found, and three more.
    assert_eq!(reported, [&[1; 3], &seen[..11]].concat(), "{seen:?}");
}

/// Video is made from the same drawing by averaging 2 × 2 blocks of colour differences (centred siting).
#[test]
fn video_with_halved_colour_gives_the_same_centre() {
    let mut random = Random::new(11, 1);
    let mut tracker = Tracker::new(&red(), 3.0..=10.0).unwrap();
    let (mut sum, mut count) = (Vector2::zeros(), 0.0);
    for step in 0..30 {
        let drawn = ball(20.0 + 0.37 * f64::from(step), 20.0 + 0.21 * f64::from(step));
        let rgb = draw(&[drawn], 0.5, 1.0, &mut random);
        let frame = halved(&rgb);
        let seen = tracker.update_preferred(&frame)[0].expect("the ball is seen");
        if step >= 10 {
            sum += seen.pixel - drawn.middle;
            count += 1.0;
            assert!((seen.pixel - drawn.middle).norm() < 0.25);
        }
    }
    let bias: Vector2<f64> = sum / count;
    println!("bias {:.4} {:.4}", bias.x, bias.y);
    assert!(bias.amax() < 0.05, "{bias:?}");
}

fn halved(rgb: &[u8]) -> Frame {
    let (width, height) = (SIZE.width_px as usize, SIZE.height_px as usize);
    let (mut luma, mut blue, mut red) = (vec![], vec![], vec![]);
    let at = |x: usize, y: usize| -> [f64; 3] {
        [0, 1, 2].map(|c| f64::from(rgb[3 * (y * width + x) + c]) / 255.0)
    };
    let brightness = |p: [f64; 3]| 0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2];
    for y in 0..height {
        for x in 0..width {
            luma.push((16.0 + 219.0 * brightness(at(x, y))).round() as u8);
        }
    }
    for y in (0..height).step_by(2) {
        for x in (0..width).step_by(2) {
            let mut mean = [0.0; 3];
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                for (sum, value) in mean.iter_mut().zip(at(x + dx, y + dy)) {
                    *sum += value / 4.0;
                }
            }
            blue.push((128.0 + 224.0 * (mean[2] - brightness(mean)) / 1.8556).round() as u8);
            red.push((128.0 + 224.0 * (mean[0] - brightness(mean)) / 1.5748).round() as u8);
        }
    }
    Frame::from_yuv420(SIZE, [luma, blue, red], false, YuvMatrix::Bt709).unwrap()
}

#[test]
fn bad_requests_are_refused() {
    let twice = [
        BallColor { name: "a".into(), rgb: [200, 40, 40] },
        BallColor { name: "b".into(), rgb: [100, 18, 18] },
    ];
    assert!(matches!(Detector::new(&twice), Err(VisionError::ColorsTooClose { .. })));
    for range in [0.0..=8.0, 9.0..=4.0, 1.0..=2.0, f64::NAN..=4.0, 3.0..=f64::INFINITY] {
        let blank = Frame::from_rgb(SIZE, vec![90; 3 * SIZE.area_px()]).unwrap();
        assert!(Detector::new(&red()).unwrap().detect(&blank, range.clone())[0].is_empty());
        assert!(matches!(Tracker::new(&red(), range), Err(VisionError::DiameterRange { .. })));
    }
}

#[test]
fn a_frame_without_pixels_holds_nothing() {
    let empty = Frame::from_rgb(ImageSize { width_px: 0, height_px: 0 }, vec![]).unwrap();
    assert!(Detector::new(&red()).unwrap().detect(&empty, 3.0..=9.0)[0].is_empty());
    assert_eq!(Tracker::new(&red(), 3.0..=9.0).unwrap().update_preferred(&empty), [None]);
}
