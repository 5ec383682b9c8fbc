//! Other objects in the virtual room, and disturbances of its cameras.

use crate::SimulatorError;
use mavsight_flight::Color;
use serde::{Deserialize, Serialize};

/// Objects in view of the cameras, and disturbances; all lists may be empty. A film shows them, no estimator
/// knows them.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Staging {
    /// Balls that stand in the room.
    pub decoy: Vec<Decoy>,
    /// Coloured panels.
    pub poster: Vec<Poster>,
    /// People who walk through.
    pub walker: Vec<Walker>,
    /// Light that falls into a lens.
    pub glare: Vec<Glare>,
    /// Cameras that show nothing.
    pub black: Vec<Black>,
    /// Cameras that are pushed.
    pub bump: Vec<Bump>,
}

/// A ball that stands in the room.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Decoy {
    /// Centre, world.
    pub position_m: [f64; 3],
    /// Diameter.
    pub diameter_m: f64,
    /// Colour.
    pub color: Color,
}

/// An upright coloured panel of a centimetre.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Poster {
    /// Centre, world.
    pub position_m: [f64; 3],
    /// Width and height.
    pub size_m: [f64; 2],
    /// Direction of its width, from world +X towards +Y.
    pub heading_deg: f64,
    /// Colour.
    pub color: Color,
}

/// A person of 1.75 m who walks along a line, there and back, from `start_s` on, and stands until then.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Walker {
    /// Where, world x and y.
    pub from_m: [f64; 2],
    /// Where to.
    pub to_m: [f64; 2],
    /// When.
    pub start_s: f64,
    /// How fast.
    pub speed_m_s: f64,
    /// Colour of the clothes.
    pub color: Color,
}

impl Walker {
    /// Where the person is at a time, world x and y.
    pub fn place_m(&self, t_s: f64) -> [f64; 2] {
        let way = [self.to_m[0] - self.from_m[0], self.to_m[1] - self.from_m[1]];
        let length_m = way[0].hypot(way[1]).max(1e-9);
        let walked = ((t_s - self.start_s).max(0.0) * self.speed_m_s / length_m) % 2.0;
        let share = if walked > 1.0 { 2.0 - walked } else { walked };
        [self.from_m[0] + share * way[0], self.from_m[1] + share * way[1]]
    }
}

/// A round veil of white light in the image that moves along a line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Glare {
    /// Name of the camera.
    pub camera: String,
    /// When it begins.
    pub from_s: f64,
    /// When it ends.
    pub to_s: f64,
    /// Where it is at the beginning, as shares of the image's width and height.
    pub from: [f64; 2],
    /// Where it is at the end.
    pub to: [f64; 2],
    /// Radius at which it is weaker by e^-½, as a share of the image's width.
    pub radius: f64,
    /// Light in its middle, 1 fills a pixel.
    pub strength: f64,
}

/// A camera whose images are black.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Black {
    /// Name of the camera.
    pub camera: String,
    /// From when on.
    pub from_s: f64,
    /// Until when; left out: for good.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to_s: Option<f64>,
}

/// A camera that is pushed once and keeps its new attitude.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bump {
    /// Name of the camera.
    pub camera: String,
    /// When.
    pub at_s: f64,
    /// Turn about the camera's x (right), y (down) and z (forward).
    pub turn_deg: [f64; 3],
}

impl Staging {
    /// Whether nothing is staged.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// [`SimulatorError::Scenario`].
    pub fn check(&self) -> Result<(), SimulatorError> {
        let finite = |values: &[f64]| values.iter().all(|v| v.is_finite());
        let positive = |values: &[f64]| values.iter().all(|v| v.is_finite() && *v > 0.0);
        let stands = |d: &Decoy| finite(&d.position_m) && positive(&[d.diameter_m]);
        let hangs = |p: &Poster| finite(&p.position_m) && positive(&p.size_m) && p.heading_deg.is_finite();
        let walks = |w: &Walker| finite(&w.from_m) && finite(&w.to_m) && finite(&[w.start_s, w.speed_m_s]);
        let shines = |g: &Glare| {
            finite(&g.from) && finite(&g.to) && positive(&[g.radius, g.strength]) && g.to_s > g.from_s
        };
        let turns = |b: &Bump| finite(&b.turn_deg) && b.at_s.is_finite();
        let needs = [
            (self.decoy.iter().all(stands), "a decoy needs a finite position_m and a diameter_m above zero"),
            (
                self.poster.iter().all(hangs),
                "a poster needs a finite position_m and heading_deg and a size_m above zero",
            ),
            (self.walker.iter().all(walks), "a walker needs finite from_m, to_m, start_s and speed_m_s"),
            (
                self.glare.iter().all(shines),
                "a glare needs finite from and to, radius and strength above zero, and to_s after from_s",
            ),
            (self.bump.iter().all(turns), "a bump needs a finite at_s and turn_deg"),
        ];
        let unmet = needs.into_iter().find(|(is_met, _)| !is_met);
        unmet.map_or(Ok(()), |(_, what)| Err(SimulatorError::Scenario(what)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_person_walks_there_and_back() {
        let walker = Walker {
            from_m: [0.0, 1.0],
            to_m: [3.0, 5.0],
            start_s: 1.0,
            speed_m_s: 0.5,
            color: Color::new(1, 2, 3),
        };
        assert_eq!(walker.place_m(0.0), [0.0, 1.0]);
        for (t_s, share) in [(6.0, 0.5), (11.0, 1.0), (16.0, 0.5), (21.0, 0.0)] {
            let [x, y] = walker.place_m(t_s);
            assert!(
                (x - 3.0 * share).abs() < 1e-9 && (y - 1.0 - 4.0 * share).abs() < 1e-9,
                "{t_s}: {x}, {y}"
            );
        }
    }

    #[test]
    fn bad_numbers_are_refused_by_name() {
        let bad = [
            "[[decoy]]\nposition_m = [0, 0, nan]\ndiameter_m = 0.1\ncolor = \"#ff0000\"",
            "[[poster]]\nposition_m = [0, 0, 1]\nsize_m = [1, 0]\nheading_deg = 0\ncolor = \"#ff0000\"",
            "[[walker]]\nfrom_m = [0, 0]\nto_m = [1, inf]\nstart_s = 0\nspeed_m_s = 1\ncolor = \"#ff0000\"",
            "[[glare]]\ncamera = \"a\"\nfrom_s = 2\nto_s = 1\nfrom = [0, 0]\nto = [1, 1]\nradius = 0.1\nstrength = 1",
            "[[bump]]\ncamera = \"a\"\nat_s = nan\nturn_deg = [0, 0, 0]",
        ];
        for text in bad {
            let staging: Staging = toml::from_str(text).expect("it is TOML");
            let section = &text[2..text.find(']').expect("a name")];
            let refused = staging.check().expect_err(text).to_string();
            assert!(refused.contains(section), "{refused}");
        }
        assert!(Staging::default().check().is_ok() && Staging::default().is_empty());
    }
}
