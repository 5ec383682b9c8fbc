//! The ball about a pixel at which a person points, and all balls of a vehicle's colours in a frame.

use crate::calibrate::diameter_range_px;
use crate::markers::MarkerColors;
use mavsight_flight::Vehicle;
use mavsight_geometry::{ImageSize, Vector2};
use mavsight_vision::{BallColor, Detection, Detector, Frame, VisionError};

/// How far beside a ball a click may be: a hand hits to two or three pixels of the screen, and an image may be shown at half
/// its size.
pub const REACH_PX: f64 = 5.0;

/// The ball, whatever its colour, at or within [`REACH_PX`] beside a pixel: its centre by the fit of a run, and the colour
/// that the frame has there. `None` where nothing coloured and round is 3 px wide or more, and no more than a tenth of the
/// image.
///
/// Its colour is first taken from the pixel itself, then from the most coloured one in reach.
pub fn ball_at(frame: &Frame, at: Vector2<f64>) -> Option<Detection> {
    let (part, offset) = around(frame, at)?;
    let at_part = at - offset;
    let colors = [color_at(&part, at_part), most_colored(&part, at_part)];
    let found = colors.into_iter().flatten().find_map(|rgb| ball_of(&part, frame.size, at_part, rgb))?;
    Some(Detection { pixel: found.pixel + offset, ..found })
}

/// Everything in one frame that may be a ball of a vehicle's markers, by colour and shape alone: each with the first marker of
/// its colour, the best of a colour first. Sizes are those of [`ball_at`].
///
/// # Errors
/// [`VisionError::ColorsTooClose`] for two markers of unlike colours that cannot be distinguished, [`VisionError::ColorTooGrey`] for one
/// that has no hue, [`VisionError::NoMarkers`].
pub fn balls_of_markers(frame: &Frame, vehicle: &Vehicle) -> Result<Vec<(usize, Detection)>, VisionError> {
    let colors = MarkerColors::of(vehicle);
    let lists = Detector::new(&colors.balls)?.detect(frame, diameter_range_px(frame.size));
    let first_of = |color: usize| colors.of_marker.iter().position(|c| *c == color).unwrap_or_default();
    let balls = lists.into_iter().enumerate();
    Ok(balls.flat_map(|(color, list)| list.into_iter().map(move |ball| (first_of(color), ball))).collect())
}

/// The part of a frame in which a ball about a pixel is whole, with what is around it, and where that part begins.
fn around(frame: &Frame, at: Vector2<f64>) -> Option<(Frame, Vector2<f64>)> {
    let half_px = 1.5 * diameter_range_px(frame.size).end() + 2.0 * REACH_PX;
    let range = |at: f64, count: u32| {
        let (from, to) = ((at - half_px).floor().max(0.0), (at + half_px).ceil().min(f64::from(count) - 1.0));
        (from <= to).then_some(from as usize..to as usize + 1)
    };
    let (columns, rows) = (range(at.x, frame.size.width_px)?, range(at.y, frame.size.height_px)?);
    let (part, [left, top]) = frame.part(columns, rows);
    Some((part, Vector2::new(left as f64, top as f64)))
}

fn color_at(frame: &Frame, at: Vector2<f64>) -> Option<[u8; 3]> {
    let (x, y) = (at.x.round(), at.y.round());
    let is_inside =
        x >= 0.0 && y >= 0.0 && x < f64::from(frame.size.width_px) && y < f64::from(frame.size.height_px);
    is_inside.then(|| frame.rgb(x as usize, y as usize))
}

/// The colour in reach whose channels differ most.
fn most_colored(frame: &Frame, at: Vector2<f64>) -> Option<[u8; 3]> {
    let reach = REACH_PX as i32;
    let offsets = (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| Vector2::new(dx, dy).cast()));
    let colors =
        offsets.filter(|d: &Vector2<f64>| d.norm() <= REACH_PX).filter_map(|d| color_at(frame, at + d));
    colors.max_by_key(|rgb| rgb.iter().max().zip(rgb.iter().min()).map(|(most, least)| most - least))
}

/// The ball of a colour about a pixel, found once more by the colour that it then has.
fn ball_of(part: &Frame, size: ImageSize, at: Vector2<f64>, rgb: [u8; 3]) -> Option<Detection> {
    let find = |rgb: [u8; 3]| {
        let mut detector = Detector::new(&[BallColor { name: "ball".into(), rgb }]).ok()?;
        let beside_px = |d: &Detection| (d.pixel - at).norm() - 0.5 * d.diameter_px;
        let found = detector.detect(part, diameter_range_px(size)).into_iter().flatten();
        found.filter(|d| beside_px(d) < REACH_PX).min_by(|a, b| beside_px(a).total_cmp(&beside_px(b)))
    };
    let first = find(rgb)?;
    find(first.color).or(Some(first))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_flight::Color;
    use mavsight_vision::YuvMatrix;

    /// A red disc of 12 px.
    fn frame() -> Frame {
        disc(6.0, [210.0, 30.0, 40.0])
    }

    /// A disc at (60.3, 40.7) on grey, each pixel the mean of 64 samples.
    fn disc(radius_px: f64, [red, green, blue]: [f64; 3]) -> Frame {
        let size = ImageSize { width_px: 320, height_px: 240 };
        let share = |x: usize, y: usize| {
            let inside = |k: usize| {
                let sample = Vector2::new(
                    x as f64 + (k % 8) as f64 / 8.0 - 0.4375,
                    y as f64 + (k / 8) as f64 / 8.0 - 0.4375,
                );
                (sample - Vector2::new(60.3, 40.7)).norm() < radius_px
            };
            (0..64).filter(|k| inside(*k)).count() as f64 / 64.0
        };
        let mix = |share: f64, ball: f64| (120.0 + share * (ball - 120.0)).round() as u8;
        let rgb = (0..240 * 320).flat_map(|k| {
            let s = share(k % 320, k / 320);
            [mix(s, red), mix(s, green), mix(s, blue)]
        });
        Frame::from_rgb(size, rgb.collect()).unwrap()
    }

    #[test]
    fn a_click_beside_the_centre_finds_the_ball_and_one_on_nothing_none() {
        let frame = frame();
        for (dx, dy) in [(0.0, 0.0), (3.0, -3.0), (-6.0, 3.0), (0.0, 9.0)] {
            let ball = ball_at(&frame, Vector2::new(60.3 + dx, 40.7 + dy)).unwrap();
            assert!((ball.pixel - Vector2::new(60.3, 40.7)).norm() < 0.1, "{dx}, {dy}: {}", ball.pixel);
            assert!(
                (ball.diameter_px - 12.0).abs() < 0.5 && ball.color[0] > 150 && ball.color[1] < 80,
                "{ball:?}"
            );
        }
        for (x, y) in [(90.0, 40.0), (0.0, 0.0), (-50.0, 1e9), (f64::NAN, 3.0)] {
            assert_eq!(ball_at(&frame, Vector2::new(x, y)), None, "{x}, {y}");
        }
    }

    #[test]
    fn a_small_ball_of_a_film_is_found_in_spite_of_its_coarse_colours() {
        for rgb in [[50.0, 70.0, 190.0], [45.0, 160.0, 60.0], [215.0, 190.0, 50.0], [210.0, 30.0, 40.0]] {
            let frame = disc(3.0, rgb).to_yuv420(YuvMatrix::Bt709);
            for (dx, dy) in [(0.0, 0.0), (1.5, -1.0), (-4.0, 3.0)] {
                let ball = ball_at(&frame, Vector2::new(60.3 + dx, 40.7 + dy));
                let ball = ball.unwrap_or_else(|| panic!("{rgb:?} at {dx}, {dy}"));
                assert!((ball.pixel - Vector2::new(60.3, 40.7)).norm() < 0.3, "{rgb:?}: {}", ball.pixel);
            }
        }
    }

    #[test]
    fn balls_are_found_by_the_colours_of_a_vehicle_and_two_of_one_hue_are_refused() {
        let frame = frame();
        let mut vehicle = Vehicle::paper();
        let ball = ball_at(&frame, Vector2::new(60.3, 40.7)).unwrap();
        let [r, g, b] = ball.color;
        vehicle.marker[2].color = Color::new(r, g, b);
        vehicle.marker[0].color = Color::new(20, 180, 200);
        let found = balls_of_markers(&frame, &vehicle).unwrap();
        let [(marker, found)] = found[..] else { panic!("{found:?}") };
        assert!(marker == 2 && (found.pixel - ball.pixel).norm() < 0.5, "{marker}: {}", found.pixel);
        vehicle.marker[1].color = Color::new(r - 20, g, b);
        assert!(matches!(balls_of_markers(&frame, &vehicle), Err(VisionError::ColorsTooClose { .. })));
    }
}
