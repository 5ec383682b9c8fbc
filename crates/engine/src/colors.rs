//! Colours of balls as pictures have them, by what people call them.

use mavsight_flight::Color;
use mavsight_vision::{BallColor, Detection, Detector, Frame, LEAST_HUE_APART_DEG, hue};

/// Hues that are looked for, degrees apart: half of it is more than the least gate of the detection.
const PROBES_DEG: usize = 10;
/// Difference of hue that counts as much as a shape that is no ball at all: words for colours are as wide.
const WORD_DEG: f64 = 30.0;
/// Difference of hue beyond which a colour has another name.
const OTHER_WORD_DEG: f64 = 60.0;

/// A ball that may be one of those that have names.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    rgb: [u8; 3],
    score: f64,
}

/// For each nominal colour, that of the ball in the pictures that goes by it: all together, by least differences of hue,
/// balls that every picture shows before others. None where no ball is left that may be called so.
pub fn colors_in_pictures(pictures: &[Frame], nominal: &[Color]) -> Vec<Option<Color>> {
    let seen: Vec<Vec<Candidate>> = pictures.iter().map(candidates).collect();
    let Some((first, others)) = seen.split_first() else { return vec![None; nominal.len()] };
    let in_others = |own: &Candidate| {
        // Nearer ones the detection does not distinguish.
        let is_same = |c: &Candidate| apart_deg(c.rgb, own.rgb) < LEAST_HUE_APART_DEG;
        let is_there = |all: &&Vec<Candidate>| all.iter().any(is_same);
        others.iter().filter(is_there).count() as f64 / others.len().max(1) as f64
    };
    let doubts: Vec<f64> = first
        .iter()
        .map(|c| (1.0 - c.score) + if others.is_empty() { 0.0 } else { 1.0 - in_others(c) })
        .collect();
    let cost = |name: usize, ball: usize| {
        let apart = apart_deg(first[ball].rgb, nominal[name].rgb());
        if apart > OTHER_WORD_DEG { NOT_AT_ALL } else { (apart / WORD_DEG).powi(2) + doubts[ball] }
    };
    let chosen = assigned(nominal.len(), first.len(), cost);
    let color = |ball: usize| {
        let [r, g, b] = first[ball].rgb;
        Color::new(r, g, b)
    };
    chosen.into_iter().map(|ball| ball.map(color)).collect()
}

/// More than all else together: rather no ball than one of another colour.
const NOT_AT_ALL: f64 = 10.0;

/// A ball for each name at the least sum of costs that exchanges of two reach; none where it would cost too much.
fn assigned(names: usize, balls: usize, cost: impl Fn(usize, usize) -> f64) -> Vec<Option<usize>> {
    let of =
        |name: usize, ball: usize| if ball < balls { cost(name, ball).min(NOT_AT_ALL) } else { NOT_AT_ALL };
    // Places beyond the balls are for names without one.
    let mut places: Vec<usize> = (0..balls.max(names) + names).collect();
    let mut is_better = true;
    while is_better {
        is_better = false;
        for name in 0..names {
            for other in name + 1..places.len() {
                let now = of(name, places[name]) + if other < names { of(other, places[other]) } else { 0.0 };
                let then =
                    of(name, places[other]) + if other < names { of(other, places[name]) } else { 0.0 };
                if then < now - 1e-12 {
                    places.swap(name, other);
                    is_better = true;
                }
            }
        }
    }
    let ball = |name: usize| Some(places[name]).filter(|b| *b < balls && cost(name, *b) < NOT_AT_ALL);
    (0..names).map(ball).collect()
}

/// Balls of any saturated hue in a picture.
fn candidates(picture: &Frame) -> Vec<Candidate> {
    let mut found: Vec<Detection> = Vec::new();
    for from_deg in [0, PROBES_DEG / 2] {
        let probe = |deg: usize| BallColor { name: deg.to_string(), rgb: of_hue((deg as f64).to_radians()) };
        let probes: Vec<BallColor> = (from_deg..360).step_by(PROBES_DEG).map(probe).collect();
        let Ok(mut detector) = Detector::new(&probes) else { continue };
        let range_px = 3.0..=f64::from(picture.size.width_px) / 10.0;
        for ball in detector.detect(picture, range_px).into_iter().flatten() {
            let is_same = |s: &&mut Detection| (s.pixel - ball.pixel).norm() < 0.5 * s.diameter_px;
            match found.iter_mut().find(is_same) {
                Some(known) if known.score < ball.score => *known = ball,
                Some(_) => {}
                None => found.push(ball),
            }
        }
    }
    found.into_iter().map(|ball| Candidate { rgb: ball.color, score: ball.score }).collect()
}

/// A saturated colour of an angle in the plane perpendicular to grey.
fn of_hue(angle: f64) -> [u8; 3] {
    let (x, y) = (angle.cos(), angle.sin());
    // Red less the mean of green and blue is x, green less blue y·2/√3.
    let (green, blue) = (y / 3.0_f64.sqrt() - x / 3.0, -y / 3.0_f64.sqrt() - x / 3.0);
    let all = [2.0 * x / 3.0, green, blue];
    let least = all.iter().copied().fold(f64::INFINITY, f64::min);
    let most = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    all.map(|light| crate::check::coded_light((light - least) / (most - least) * 0.6))
}

/// Angle between two hues, degrees.
fn apart_deg(a: [u8; 3], b: [u8; 3]) -> f64 {
    let angle = |rgb: [u8; 3]| {
        let own = hue(Color::new(rgb[0], rgb[1], rgb[2]).to_linear());
        own.y.atan2(own.x).to_degrees()
    };
    let apart = (angle(a) - angle(b)).rem_euclid(360.0);
    apart.min(360.0 - apart)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_vision::ImageSize;

    /// Discs of given colours on grey.
    fn picture(colors: &[[u8; 3]]) -> Frame {
        let size = ImageSize { width_px: 320, height_px: 240 };
        let pixel = |k: usize| {
            let (x, y) = ((k % 320) as f64, (k / 320) as f64);
            let is_in = |i: usize| {
                let (u, v) = (30.0 + 65.0 * (i % 4) as f64, 60.0 + 100.0 * (i / 4) as f64);
                (x - u).hypot(y - v) < 7.0
            };
            (0..colors.len()).find(|i| is_in(*i)).map_or([120; 3], |i| colors[i])
        };
        Frame::from_rgb(size, (0..size.area_px()).flat_map(pixel).collect()).unwrap()
    }

    #[test]
    fn hues_of_probes_are_those_asked_for() {
        for deg in (0..360).step_by(15) {
            let rgb = of_hue(f64::from(deg).to_radians());
            let next = of_hue(f64::from(deg + 10).to_radians());
            assert!((apart_deg(rgb, next) - 10.0).abs() < 1.0, "{deg}: {rgb:?} {next:?}");
        }
    }

    #[test]
    fn words_get_the_colours_that_the_picture_has() {
        // Paints of a workshop, whose orange is nearer to red than the word's.
        let paints = [[0xc8, 0x30, 0x30], [0xb0, 0x50, 0x20], [0x30, 0x38, 0xb0]];
        let words = ["#0000ff", "#ff8c00", "#ff0000", "#008000"].map(|c| Color::parse(c).unwrap());
        let got = colors_in_pictures(&[picture(&paints), picture(&paints)], &words);
        let near = |got: Option<Color>, want: [u8; 3]| got.is_some_and(|c| apart_deg(c.rgb(), want) < 4.0);
        assert!(near(got[0], paints[2]) && near(got[1], paints[1]) && near(got[2], paints[0]), "{got:?}");
        assert_eq!(got[3], None);
    }
}
