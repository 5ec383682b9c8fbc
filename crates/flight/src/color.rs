//! Colours of markers.

use crate::FlightError;
use serde::{Deserialize, Serialize};

/// An sRGB colour, written `#rrggbb`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Color {
    r: u8,
    g: u8,
    b: u8,
}

impl Color {
    /// From 8-bit sRGB components.
    pub const fn new(r: u8, g: u8, b: u8) -> Self {
        Self { r, g, b }
    }

    /// Reads `#rrggbb`.
    ///
    /// # Errors
    /// [`FlightError::UnknownColor`] for anything else.
    pub fn parse(text: &str) -> Result<Self, FlightError> {
        let unknown = || FlightError::UnknownColor(text.to_owned());
        let digits = text.trim().strip_prefix('#').ok_or_else(unknown)?;
        if digits.len() != 6 || !digits.bytes().all(|b| b.is_ascii_hexdigit()) {
            return Err(unknown());
        }
        let value = u32::from_str_radix(digits, 16).map_err(|_| unknown())?;
        let [_, r, g, b] = value.to_be_bytes();
        Ok(Self { r, g, b })
    }

    /// 8-bit sRGB components.
    pub const fn rgb(&self) -> [u8; 3] {
        [self.r, self.g, self.b]
    }

    /// Linear-light components in 0..=1 (IEC 61966-2-1).
    pub fn to_linear(&self) -> [f64; 3] {
        self.rgb().map(|c| {
            let s = f64::from(c) / 255.0;
            if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
        })
    }
}

impl TryFrom<String> for Color {
    type Error = FlightError;
    fn try_from(text: String) -> Result<Self, FlightError> {
        Self::parse(&text)
    }
}

impl From<Color> for String {
    fn from(color: Color) -> Self {
        color.to_string()
    }
}

impl std::fmt::Display for Color {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "#{:02x}{:02x}{:02x}", self.r, self.g, self.b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_survive_the_round_trip() {
        let color = Color::parse("#db1203").expect("a colour");
        assert_eq!(color.rgb(), [0xdb, 0x12, 0x03]);
        assert_eq!(color.to_string(), "#db1203");
        assert!((Color::new(188, 188, 188).to_linear()[0] - 0.5).abs() < 0.005, "sRGB 188 is half the light");
    }

    #[test]
    fn a_colour_that_is_none_is_named() {
        for text in ["reddish", "#12345", "#gg0000", "", "#1234567", "#éé00"] {
            assert_eq!(Color::parse(text), Err(FlightError::UnknownColor(text.to_owned())));
        }
    }
}
