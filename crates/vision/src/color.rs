//! Colours of balls, compared in a way that neither shading nor white light nor a neutral background changes.
//!
//! Shading multiplies linear RGB; a pixel that only partly shows the ball, and a glossy or hazy one, adds
//! nearly neutral light. Both leave the direction within the plane perpendicular to the grey axis, the hue,
//! where it is. So a hue is compared as an angle in that plane, and saturation serves only as a floor.

use crate::VisionError;
use mavsight_geometry::Vector2;
use nalgebra::{RealField, convert};
use std::sync::LazyLock;

/// A marker's name and the colour a person would pick for it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BallColor {
    /// Name for messages.
    pub name: String,
    /// Nominal colour, sRGB-coded. Brightness is not relied on.
    pub rgb: [u8; 3],
}

/// Smallest angle between two hues that are distinguished, degrees.
///
/// Noise of two grey levels turns the hue of one pixel of a ball by about two degrees, that of the nine
/// pixels inside the smallest ball by 0.7; the half angle must hold four standard deviations of that.
pub const LEAST_HUE_APART_DEG: f64 = 6.0;

/// Furthest that a surface's hue is taken to move with the colour of the light (lamp to daylight) and
/// neighbours' reflections, degrees.
const GREATEST_HUE_CHANGE_DEG: f64 = 25.0;

/// Saturation (one less the ratio of weakest to strongest linear channel) from which a pixel shows more ball
/// than neutral light.
pub(crate) const LEAST_PURITY: f32 = 0.5;

/// Chroma, the length of a [`hue()`] of linear light, that stands out of the noise: four deviations of two grey
/// levels at the dark end, where a level is 0.0025 at most.
pub const LEAST_CHROMA: f32 = 0.02;

/// Linear light of an sRGB code, 1 that of the greatest (IEC 61966-2-1).
pub fn linear_light(code: u8) -> f64 {
    let s = f64::from(code) / 255.0;
    if s <= 0.040_45 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
}

/// [`linear_light`] of each code.
static LINEAR: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|code| linear_light(code as u8) as f32));

/// Least code that a channel of a coloured pixel has: chroma is at most the difference of its strongest and
/// weakest channel.
pub(crate) fn least_colored_code() -> u8 {
    (0..=u8::MAX).find(|code| LINEAR[usize::from(*code)] >= LEAST_CHROMA).unwrap_or(u8::MAX)
}

/// Linear light of an sRGB-coded colour.
pub(crate) fn to_linear(rgb: [u8; 3]) -> [f32; 3] {
    let table = &*LINEAR;
    rgb.map(|code| table[code as usize])
}

/// A colour seen: hue as a vector in the plane perpendicular to grey, its length (chroma) and the saturation.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seen {
    pub(crate) hue: [f32; 2],
    pub(crate) chroma: f32,
    pub(crate) purity: f32,
}

impl Seen {
    pub(crate) fn of(linear: [f32; 3]) -> Self {
        let [r, g, b] = linear;
        let most = r.max(g).max(b);
        let purity = if most > 0.0 { 1.0 - r.min(g).min(b).max(0.0) / most } else { 0.0 };
        Self { purity, ..Self::pure(hue(linear).into()) }
    }

    /// A saturated colour by its hue.
    pub(crate) fn pure(hue: [f32; 2]) -> Self {
        Self { hue, chroma: (hue[0] * hue[0] + hue[1] * hue[1]).sqrt(), purity: 1.0 }
    }

    /// Whether the colour is saturated and bright enough to have a hue.
    pub(crate) fn is_colored(&self) -> bool {
        self.chroma >= LEAST_CHROMA && self.purity >= LEAST_PURITY
    }

    /// Cosine of the angle to a unit hue.
    pub(crate) fn cosine(&self, hue: [f32; 2]) -> f32 {
        (self.hue[0] * hue[0] + self.hue[1] * hue[1]) / self.chroma.max(f32::MIN_POSITIVE)
    }

    /// Angle to a unit hue.
    fn angle_rad(&self, hue: [f32; 2]) -> f32 {
        self.cosine(hue).clamp(-1.0, 1.0).acos()
    }

    pub(crate) fn unit_hue(&self) -> [f32; 2] {
        let scale = 1.0 / self.chroma.max(f32::MIN_POSITIVE);
        [self.hue[0] * scale, self.hue[1] * scale]
    }
}

/// The hue of a colour that is saturated and bright enough to have one: as [`Seen`] has it, without its root
/// and its quotient.
#[inline(always)]
pub(crate) fn colored_hue([r, g, b]: [f32; 3]) -> Option<[f32; 2]> {
    let hue: [f32; 2] = hue([r, g, b]).into();
    let (high, low) = if r > g { (r, g) } else { (g, r) };
    let (most, least) = (if b > high { b } else { high }, if b < low { b } else { low });
    let is_pure = least <= (1.0 - LEAST_PURITY) * most;
    let is_strong = hue[0] * hue[0] + hue[1] * hue[1] >= LEAST_CHROMA * LEAST_CHROMA;
    (is_pure & is_strong).then_some(hue)
}

/// Linear light, red, green and blue, in the plane perpendicular to grey: along the hue of red, and a right angle from it. Its
/// direction is the hue, whatever the brightness; its length is the chroma.
#[inline(always)]
pub fn hue<T: RealField + Copy>([r, g, b]: [T; 3]) -> Vector2<T> {
    let (half, sine_60_deg): (T, T) = (convert(0.5_f64), convert(0.866_025_403_784_438_6_f64));
    Vector2::new(r - half * (g + b), sine_60_deg * (g - b))
}

/// One marker's place among the hues.
#[derive(Debug, Clone)]
struct Target {
    nominal: [f32; 2],
    /// As it was last measured; the nominal one before that.
    hue: [f32; 2],
    /// Half the angle to the nearest other hue, or the physical cap, radians.
    gate_rad: f32,
}

/// The hues that are looked for.
#[derive(Debug, Clone)]
pub(crate) struct ColorModel {
    targets: Vec<Target>,
    cap_cosine: f32,
}

impl ColorModel {
    pub(crate) fn new(colors: &[BallColor]) -> Result<Self, VisionError> {
        if colors.is_empty() {
            return Err(VisionError::NoMarkers);
        }
        let seen: Vec<Seen> = colors.iter().map(|c| Seen::of(to_linear(c.rgb))).collect();
        for (color, seen) in colors.iter().zip(&seen) {
            if !seen.is_colored() {
                let purity = f64::from(seen.purity);
                return Err(VisionError::ColorTooGrey {
                    name: color.name.clone(),
                    purity,
                    needed: f64::from(LEAST_PURITY),
                });
            }
        }
        let cap_rad = (GREATEST_HUE_CHANGE_DEG as f32).to_radians();
        let target = |hue| Target { nominal: hue, hue, gate_rad: cap_rad };
        let mut targets: Vec<Target> = seen.iter().map(|s| target(s.unit_hue())).collect();
        for i in 0..colors.len() {
            for j in 0..i {
                let apart_rad = seen[i].cosine(targets[j].hue).clamp(-1.0, 1.0).acos();
                let apart_deg = f64::from(apart_rad.to_degrees());
                if apart_deg < LEAST_HUE_APART_DEG {
                    return Err(VisionError::ColorsTooClose {
                        first: colors[j].name.clone(),
                        second: colors[i].name.clone(),
                        apart_deg,
                        needed_deg: LEAST_HUE_APART_DEG,
                    });
                }
                for k in [i, j] {
                    targets[k].gate_rad = targets[k].gate_rad.min(apart_rad / 2.0);
                }
            }
        }
        Ok(Self { targets, cap_cosine: cap_rad.cos() })
    }

    /// Number of markers.
    pub(crate) fn len(&self) -> usize {
        self.targets.len()
    }

    /// Whether a pixel may belong to a marker: coloured and within the physical cap of its hue. Pixels at an
    /// edge mix with the background, so the finer decision is made on whole balls.
    pub(crate) fn may_be(&self, marker: usize, [x, y]: [f32; 2]) -> bool {
        let hue = self.targets[marker].hue;
        // The cap is below a right angle.
        let along = x * hue[0] + y * hue[1];
        (along >= 0.0) & (along * along >= self.cap_cosine * self.cap_cosine * (x * x + y * y))
    }

    /// Angle of a colour to a marker's hue as a fraction of the marker's gate, or of the angle to another
    /// marker's hue where that is more; above one it is not that marker.
    pub(crate) fn gate_fraction(&self, marker: usize, seen: &Seen) -> f64 {
        let target = &self.targets[marker];
        let own_rad = seen.angle_rad(target.hue);
        let others = self.targets.iter().enumerate().filter(|(other, _)| *other != marker);
        let nearest_rad = others.map(|(_, t)| seen.angle_rad(t.hue)).fold(target.gate_rad, f32::min);
        f64::from(own_rad / nearest_rad.max(f32::MIN_POSITIVE))
    }

    /// Angle of a colour to a marker's hue, degrees.
    pub(crate) fn apart_deg(&self, marker: usize, seen: &Seen) -> f64 {
        f64::from(seen.angle_rad(self.targets[marker].hue).to_degrees())
    }

    /// Replaces a marker's hue by the one that was measured, when that lies within the gate about the nominal
    /// one: a ball behind another shows a mixture of both, and followed from mixture to mixture one hue
    /// would become the other.
    pub(crate) fn learn(&mut self, marker: usize, seen: &Seen) {
        let target = &mut self.targets[marker];
        if seen.is_colored() && seen.angle_rad(target.nominal) <= target.gate_rad {
            target.hue = seen.unit_hue();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn color(name: &str, rgb: [u8; 3]) -> BallColor {
        BallColor { name: name.into(), rgb }
    }

    #[test]
    fn linear_light_follows_the_standard() {
        let [black, middle, white] = to_linear([0, 188, 255]);
        assert_eq!((black, white), (0.0, 1.0));
        // IEC 61966-2-1: code 188 is 50.3 % of white.
        assert!((middle - 0.5029).abs() < 1e-4);
    }

    #[test]
    fn hue_ignores_shading_and_neutral_light() {
        let base = to_linear([208, 42, 42]);
        let model = ColorModel::new(&[color("red", [208, 42, 42]), color("yellow", [216, 188, 48])]).unwrap();
        for (shade, haze) in [(1.0, 0.0), (0.1, 0.0), (0.7, 0.2), (0.3, 0.05)] {
            let seen = Seen::of(base.map(|c| c * shade + haze));
            assert!(model.gate_fraction(0, &seen) < 1e-2);
            assert!(model.gate_fraction(1, &seen) > 1.0);
        }
    }

    /// A yellow ball that was followed behind a red one became red: the red ball was both.
    #[test]
    fn a_hue_that_is_learned_from_mixtures_does_not_become_another() {
        let (red, yellow) = ([208, 42, 42], [216, 188, 48]);
        let mut model = ColorModel::new(&[color("red", red), color("yellow", yellow)]).unwrap();
        let mixed = |share: f32| {
            let (red, yellow) = (to_linear(red), to_linear(yellow));
            Seen::of(std::array::from_fn(|k| share * red[k] + (1.0 - share) * yellow[k]))
        };
        (0..=100).for_each(|k| model.learn(1, &mixed(0.01 * k as f32)));
        assert!(model.gate_fraction(1, &mixed(1.0)) > 1.0 && model.gate_fraction(0, &mixed(1.0)) < 1e-3);
        assert!(model.gate_fraction(1, &mixed(0.0)) <= 1.0 && model.gate_fraction(0, &mixed(0.0)) > 1.0);
        for share in [0.2, 0.4, 0.6, 0.8] {
            let owners = (0..2).filter(|m| model.gate_fraction(*m, &mixed(share)) <= 1.0).count();
            assert!(owners <= 1, "{share} red is both");
        }
    }

    #[test]
    fn colors_that_cannot_be_distinguished_are_named() {
        let error = ColorModel::new(&[
            color("left", [200, 40, 40]),
            color("x", [0, 0, 200]),
            color("right", [120, 20, 22]),
        ])
        .unwrap_err();
        let text = error.to_string();
        assert!(text.contains("left") && text.contains("right"), "{text}");
        assert!(matches!(
            ColorModel::new(&[color("grey", [100, 100, 110])]),
            Err(VisionError::ColorTooGrey { .. })
        ));
        assert_eq!(ColorModel::new(&[]).unwrap_err(), VisionError::NoMarkers);
    }
}
