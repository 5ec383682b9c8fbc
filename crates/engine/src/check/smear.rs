//! How long a camera exposes, by the smear of balls that move.
//!
//! A ball that moves by s pixels while the shutter is open has the second moment along its motion larger by s²/12, and
//! the one across as it was: lens, pixel and encoder widen both alike. The slope of the difference by the square of the
//! speed is the square of the time of exposure.

use super::film::{Film, ring_light};
use super::{CameraCheck, CheckItem};
use mavsight_geometry::{Matrix2, Vector2};
use mavsight_pipeline::Cause;
use mavsight_pose::{MAD_TO_STD, MarkerObservation, median};
use mavsight_vision::{Frame, hue, linear_light};

/// Standard deviation along its motion from which a smear spreads a small ball's edges over the whole of it, as blur
/// by the lens does (`mavsight_pipeline`, out of focus).
const SMEARED_PX: f64 = 1.5;
/// Balls in motion from which the slope is taken.
const LEAST: usize = 12;
/// Rim of a ball's image that lens, pixel and encoder blur.
const RIM_PX: f64 = 2.5;
/// Share of the balls that are quicker than the speed for which the smear is given: the quick parts are those that count.
const QUICK: f64 = 0.1;
/// Standard deviations by which the time of exposure must exceed what is harmless: once in a thousand by chance.
const SURE: f64 = 3.0;

/// Time of exposure of one camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exposure {
    /// Time of exposure, s.
    pub exposure_s: f64,
    /// Its standard deviation, s.
    pub std_s: f64,
    /// Speed in the image that a tenth of the balls exceed, px/s.
    pub quick_px_s: f64,
}

impl Exposure {
    /// Length of the smear of a quick ball, px.
    pub fn smear_px(&self) -> f64 {
        self.exposure_s * self.quick_px_s
    }
}

/// The time of exposure of a camera; none where too few balls moved.
pub(super) fn exposure(camera: usize, film: &Film) -> Option<Exposure> {
    let (mut pairs, mut speeds) = (Vec::new(), Vec::new());
    let half_ns = film.half_step_ns(camera);
    let all = &film.tracked.observations;
    let times_ns: Vec<i64> = all.times_ns().collect();
    let seen_at = |t_ns: i64| {
        let mut seen = Vec::new();
        all.at(t_ns, &mut seen);
        seen.retain(|o: &MarkerObservation| o.camera == camera);
        seen
    };
    for (stamp_ns, frame) in &film.taps[camera].frames {
        let t_ns = film.time_ns(camera, *stamp_ns);
        let at = times_ns.partition_point(|t| *t < t_ns - half_ns);
        if at == 0 || at + 1 >= times_ns.len() || (times_ns[at] - t_ns).abs() > half_ns {
            continue;
        }
        let (before, after) = (seen_at(times_ns[at - 1]), seen_at(times_ns[at + 1]));
        let step_s = (times_ns[at + 1] - times_ns[at - 1]) as f64 * 1e-9;
        for own in seen_at(times_ns[at]) {
            let of = |all: &[MarkerObservation]| all.iter().find(|o| o.marker == own.marker).map(|o| o.pixel);
            let (Some(from), Some(to)) = (of(&before), of(&after)) else { continue };
            let velocity_px_s = (to - from) / step_s;
            let diameter_px = film.diameter_near(camera, own.pixel, times_ns[at]);
            speeds.push(velocity_px_s.norm());
            // No shutter is open for longer than a frame lasts.
            let longest_px = 0.5 * step_s * velocity_px_s.norm();
            let stretched =
                diameter_px.and_then(|d| stretch_px2(frame, own.pixel, [d, longest_px], velocity_px_s));
            pairs.extend(stretched.map(|moment| (velocity_px_s.norm_squared() / 12.0, moment)));
        }
    }
    slope(&pairs, speeds, 2e-9 * half_ns as f64)
}

/// The square of the time of exposure: the slope of moments by the squares of speed, through what a ball at rest has by
/// its shading; robust, as a background of the ball's colour spoils single moments (Huber 1981, section 7.8). None where
/// it is longer than a frame lasts: then something else stretches the balls.
fn slope(pairs: &[(f64, f64)], mut speeds: Vec<f64>, step_s: f64) -> Option<Exposure> {
    if pairs.len() < LEAST {
        return None;
    }
    let (mut line, mut normal, mut scale) = (Vector2::zeros(), Matrix2::zeros(), f64::INFINITY);
    for _ in 0..ROUNDS {
        let mut right = Vector2::zeros();
        normal = Matrix2::zeros();
        for (x, y) in pairs {
            let row = Vector2::new(1.0, *x);
            let weight = (HUBER * scale / (y - row.dot(&line)).abs()).min(1.0);
            normal += row * row.transpose() * weight;
            right += row * (weight * y);
        }
        line = normal.try_inverse()? * right;
        let away = pairs.iter().map(|(x, y)| (y - line.x - line.y * x).abs());
        scale = (MAD_TO_STD * median(away.collect())?).max(f64::MIN_POSITIVE);
    }
    let std_s2 = scale * normal.try_inverse()?[(1, 1)].max(0.0).sqrt();
    let exposure_s = line.y.max(0.0).sqrt();
    // Of a square near zero the root's error is the root of the error.
    let std_s = (0.5 * std_s2 / exposure_s.max(f64::MIN_POSITIVE)).min(std_s2.sqrt());
    speeds.sort_by(f64::total_cmp);
    let quick_px_s = *speeds.get(((1.0 - QUICK) * speeds.len() as f64) as usize)?;
    // Without looking it is known to be between nothing and a frame: to a standard deviation of step/√12.
    let is_one = exposure_s - SURE * std_s <= step_s && std_s < step_s / 12.0_f64.sqrt();
    is_one.then_some(Exposure { exposure_s, std_s, quick_px_s })
}

/// Rounds of a robust fit: it converges to a per cent in a few.
const ROUNDS: usize = 12;
/// Standard deviations up to which a residual counts in full: 95 % efficient for normal errors (Huber 1981).
const HUBER: f64 = 1.345;

/// Second moment of a ball's colour along its motion less that across; none at an image's rim or without colour.
fn stretch_px2(
    frame: &Frame,
    at: Vector2<f64>,
    [diameter_px, longest_px]: [f64; 2],
    velocity_px_s: Vector2<f64>,
) -> Option<f64> {
    let along = velocity_px_s.try_normalize(1e-9)?;
    let wide_px = 0.5 * diameter_px + RIM_PX;
    let reach_px = wide_px + 0.5 * longest_px;
    if !frame.size.contains(&at, reach_px) {
        return None;
    }
    let around = ring_light(frame, at, reach_px, reach_px + 2.0)?;
    let ball = ring_light(frame, at, 0.0, (0.25 * diameter_px).max(1.0))?;
    // By hue alone: what is behind balls is mostly neutral.
    let (ground, contrast) = (hue(around), hue(ball) - hue(around));
    let strength = contrast.norm_squared();
    let (mut sum, mut first, mut second) = (0.0, Vector2::zeros(), [0.0; 2]);
    let reach = reach_px.ceil() as i64;
    let (cx, cy) = (at.x.round() as i64, at.y.round() as i64);
    let across = Vector2::new(-along.y, along.x);
    let mut parts = Vec::new();
    for y in cy - reach..=cy + reach {
        for x in cx - reach..=cx + reach {
            let away = Vector2::new(x as f64, y as f64) - at;
            // As far as the rim of the smeared ball may reach, along and across.
            let beyond_px = (away.dot(&along).abs() - 0.5 * longest_px).max(0.0);
            if beyond_px.hypot(away.dot(&across)) > wide_px {
                continue;
            }
            let rgb = frame.rgb(usize::try_from(x).ok()?, usize::try_from(y).ok()?);
            // Share of the pixel that shows the ball.
            let share = (hue(rgb.map(linear_light)) - ground).dot(&contrast) / strength;
            let share = share.clamp(-0.2, 1.2);
            sum += share;
            first += away * share;
            parts.push((away, share));
        }
    }
    // As much as the ball has, at rest or smeared: otherwise what is behind it has its colour too.
    let disc_px = 0.25 * std::f64::consts::PI * diameter_px * diameter_px;
    if !(0.5 * disc_px..1.5 * (disc_px + diameter_px * longest_px)).contains(&sum) {
        return None;
    }
    let middle = first / sum;
    for (away, share) in parts {
        let from_middle = away - middle;
        second[0] += share * from_middle.dot(&along).powi(2);
        second[1] += share * from_middle.dot(&across).powi(2);
    }
    Some((second[0] - second[1]) / sum)
}

/// Cameras that expose too long.
pub(super) fn items(cameras: &[CameraCheck]) -> Vec<CheckItem> {
    let item = |(k, camera): (usize, &CameraCheck)| {
        let own = camera.exposure?;
        let least_px = (own.exposure_s - SURE * own.std_s) * own.quick_px_s / 12.0_f64.sqrt();
        (least_px > SMEARED_PX).then(|| {
            let wanted_s = SMEARED_PX * 12.0_f64.sqrt() / own.quick_px_s;
            let text = format!(
                "{} exposes for {:.0} ± {:.0} ms, in which a quick ball moves by {:.0} px along and is blurred that way alone: expose for 1/{:.0} s \
                 at most, with more light.",
                camera.name,
                1e3 * own.exposure_s,
                1e3 * own.std_s,
                own.smear_px(),
                (1.0 / wanted_s).ceil()
            );
            CheckItem::of_cause(Cause::ExposureLong, Some(k), text)
        })
    };
    cameras.iter().enumerate().filter_map(item).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::ImageSize;

    /// A red disc on grey that moves while the shutter is open, drawn with sixteen samples a pixel.
    fn drawn(smear: Vector2<f64>) -> Frame {
        let size = ImageSize { width_px: 60, height_px: 48 };
        let at = Vector2::new(29.3, 24.4);
        let pixel = |k: usize| {
            let (x, y) = ((k % 60) as f64, (k / 60) as f64);
            let mut share = 0.0;
            for i in 0..16 {
                let sub =
                    Vector2::new(x + (f64::from(i % 4) - 1.5) / 4.0, y + (f64::from(i / 4) - 1.5) / 4.0);
                let is_in = |t: i32| (sub - at - smear * (f64::from(t) - 4.5) / 10.0).norm() < 4.0;
                share += (0..10).filter(|t| is_in(*t)).count() as f64 / 160.0;
            }
            let light = |ball: f64| super::super::film::coded(0.2 + share * (ball - 0.2));
            [light(0.6), light(0.02), light(0.02)]
        };
        Frame::from_rgb(size, (0..size.area_px()).flat_map(pixel).collect()).unwrap()
    }

    #[test]
    fn smear_is_as_long_as_the_ball_moved() {
        for length_px in [2.0, 5.0, 8.0] {
            let smear = Vector2::new(0.8, 0.6) * length_px;
            let moment = stretch_px2(&drawn(smear), Vector2::new(29.3, 24.4), [8.0, 10.0], smear).unwrap();
            assert!((moment / (length_px * length_px / 12.0) - 1.0).abs() < 0.15, "{length_px}: {moment}");
        }
        let still =
            stretch_px2(&drawn(Vector2::zeros()), Vector2::new(29.3, 24.4), [8.0, 10.0], Vector2::x())
                .unwrap();
        assert!(still.abs() < 0.1, "{still}");
    }

    #[test]
    fn the_slope_is_the_square_of_the_exposure() {
        let at = |k: i32| f64::from(k * k) * 2.0;
        let mut pairs: Vec<(f64, f64)> = (1..40).map(|k| (at(k), 0.2 + at(k) * 0.04 * 0.04)).collect();
        for k in [3, 17, 30] {
            pairs[k].1 += 20.0;
        }
        let got = slope(&pairs, vec![100.0; 20], 0.04).unwrap();
        assert!((got.exposure_s - 0.04).abs() < 1e-3 && got.smear_px() > 3.9, "{got:?}");
        assert_eq!(slope(&pairs[..5], vec![], 0.04), None);
        // No shutter is open for longer than a frame.
        assert_eq!(slope(&pairs, vec![100.0; 20], 0.02), None);
    }
}
