//! How well one camera sees the balls: exposure, contrast, and what else has their colours.

use crate::color::{ColorModel, Seen, to_linear};
use crate::{Detection, Frame};

/// Frames between two looks: health changes slowly.
pub(crate) const EVERY: u64 = 8;
/// Grid of a look at a whole frame, each way.
const GRID: usize = 16;
/// sRGB code of the brightest sample below which a frame is dark: 1 % of the light of white, under which no
/// ball has a colour ([`crate::color::LEAST_CHROMA`] is 2 %).
const DARK_CODE: u8 = 25;
/// sRGB code from which a channel is taken to be full.
const FULL_CODE: u8 = 253;

/// How well the balls of one colour are seen. Means over the looks in which one was seen.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BallHealth {
    /// Looks in which a ball of the colour was seen.
    pub looks: u64,
    /// Share of its pixels with a full channel.
    pub saturated: f64,
    /// Contrast of its light to that around it (Michelson): 0 none, 1 against black.
    pub contrast: f64,
    /// Apparent diameter.
    pub diameter_px: f64,
    /// Other objects of the colour in the image.
    pub others: f64,
    /// Smallest angle of hue between the colour and coloured background beside the ball, degrees; 180 where
    /// there is none.
    pub hue_apart_deg: f64,
}

impl BallHealth {
    pub(crate) fn look(
        &mut self,
        frame: &Frame,
        model: &ColorModel,
        color: usize,
        ball: &Detection,
        others: usize,
    ) {
        let (mut inside, mut ring) = (Sum::default(), Sum::default());
        let mut apart_deg = 180.0_f64;
        let radius_px = 0.5 * ball.diameter_px;
        let reach = (2.0 * radius_px + 4.0).ceil() as i64;
        let (cx, cy) = (ball.pixel.x.round() as i64, ball.pixel.y.round() as i64);
        let size = (i64::from(frame.size.width_px), i64::from(frame.size.height_px));
        for y in (cy - reach).max(0)..(cy + reach + 1).min(size.1) {
            for x in (cx - reach).max(0)..(cx + reach + 1).min(size.0) {
                let away = (x as f64 - ball.pixel.x).hypot(y as f64 - ball.pixel.y);
                let rgb = frame.rgb(x as usize, y as usize);
                if away < (radius_px - 0.7).max(0.7) {
                    inside.add(rgb);
                } else if away > 1.3 * radius_px + 2.0 {
                    ring.add(rgb);
                    let seen = Seen::of(to_linear(rgb));
                    if seen.is_colored() {
                        apart_deg = apart_deg.min(model.apart_deg(color, &seen));
                    }
                }
            }
        }
        if inside.count == 0.0 || ring.count == 0.0 {
            return;
        }
        let (own, around) = (inside.light / inside.count, ring.light / ring.count);
        self.looks += 1;
        let gain = 1.0 / self.looks as f64;
        let mean = |value: &mut f64, now: f64| *value += gain * (now - *value);
        mean(&mut self.saturated, inside.full / inside.count);
        mean(&mut self.contrast, (own - around).abs() / (own + around).max(1e-6));
        mean(&mut self.diameter_px, ball.diameter_px);
        mean(&mut self.others, others as f64);
        mean(&mut self.hue_apart_deg, apart_deg);
    }
}

#[derive(Default)]
struct Sum {
    count: f64,
    full: f64,
    light: f64,
}

impl Sum {
    fn add(&mut self, rgb: [u8; 3]) {
        let [r, g, b] = to_linear(rgb).map(f64::from);
        self.count += 1.0;
        self.full += f64::from(u8::from(rgb.iter().any(|c| *c >= FULL_CODE)));
        self.light += 0.2126 * r + 0.7152 * g + 0.0722 * b;
    }
}

/// Whether a frame shows next to nothing: no sample of a grid has light for a colour.
pub(crate) fn is_dark(frame: &Frame) -> bool {
    let (width, height) = (frame.size.width_px as usize, frame.size.height_px as usize);
    let at = |k: usize, count: usize| (2 * k + 1) * count / (2 * GRID);
    let dark = |(i, j): (usize, usize)| frame.rgb(at(i, width), at(j, height)).iter().all(|c| *c < DARK_CODE);
    width > 0 && height > 0 && (0..GRID * GRID).all(|k| dark((k % GRID, k / GRID)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BallColor, ImageSize, Matrix2, Vector2};

    const SIZE: ImageSize = ImageSize { width_px: 40, height_px: 40 };

    fn drawn(ball: [u8; 3], around: [u8; 3]) -> Frame {
        let pixel = |k: usize| {
            let away = ((k % 40) as f64 - 20.0).hypot((k / 40) as f64 - 20.0);
            if away <= 5.0 { ball } else { around }
        };
        Frame::from_rgb(SIZE, (0..1600).flat_map(pixel).collect()).unwrap()
    }

    fn health(ball: [u8; 3], around: [u8; 3]) -> BallHealth {
        let model = ColorModel::new(&[BallColor { name: "red".into(), rgb: [200, 40, 40] }]).unwrap();
        let seen = Detection {
            pixel: Vector2::new(20.0, 20.0),
            covariance_px2: Matrix2::identity(),
            area_px: 78.0,
            diameter_px: 10.0,
            score: 1.0,
            color: ball,
        };
        let mut out = BallHealth::default();
        out.look(&drawn(ball, around), &model, 0, &seen, 1);
        out
    }

    #[test]
    fn exposure_contrast_and_hues_are_those_of_the_drawing() {
        let plain = health([200, 40, 40], [100; 3]);
        assert_eq!((plain.looks, plain.saturated, plain.hue_apart_deg, plain.others), (1, 0.0, 180.0, 1.0));
        let light = |rgb| Seen::of(to_linear(rgb));
        assert!(light([200, 40, 40]).is_colored());
        // Rec. 709 luminance of the two sRGB colours, by hand.
        assert!((plain.contrast - (0.1391 - 0.1274) / (0.1391 + 0.1274)).abs() < 0.01, "{}", plain.contrast);
        assert_eq!(health([255, 60, 60], [100; 3]).saturated, 1.0);
        assert!(health([200, 40, 40], [150, 30, 30]).hue_apart_deg < 2.0);
        assert!((health([200, 40, 40], [30, 30, 150]).hue_apart_deg - 120.0).abs() < 2.0);
    }

    #[test]
    fn only_a_frame_without_light_is_dark() {
        assert!(is_dark(&drawn([10; 3], [16; 3])) && !is_dark(&drawn([10; 3], [60; 3])));
        assert!(!is_dark(&Frame::from_rgb(ImageSize { width_px: 0, height_px: 0 }, vec![]).unwrap()));
    }
}
