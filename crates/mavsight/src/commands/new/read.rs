//! Answers in the form in which people type them.

use mavsight_flight::{Color, Marker};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

/// Colours by their words, about as paints of that name look to a camera; a picture's own are better.
const WORDS: [(&str, &str); 14] = [
    ("red", "#ff0000"),
    ("green", "#008000"),
    ("blue", "#0000ff"),
    ("yellow", "#ffff00"),
    ("magenta", "#ff00ff"),
    ("pink", "#ff1493"),
    ("cyan", "#00ffff"),
    ("turquoise", "#40e0d0"),
    ("orange", "#ff8c00"),
    ("violet", "#8a2be2"),
    ("purple", "#800080"),
    ("lime", "#7fff00"),
    ("brown", "#a0522d"),
    ("teal", "#008080"),
];

/// A colour as `#rrggbb`, or by its word with what follows it, as `red2`.
pub(in crate::commands) fn color(text: &str) -> Result<Color, String> {
    let word = text.trim_end_matches(|c: char| c.is_ascii_digit() || c == '-' || c == '_').to_lowercase();
    let known = WORDS.iter().find(|(name, _)| *name == word).map_or(text, |(_, code)| code);
    Color::parse(known).map_err(|_| {
        let words: Vec<&str> = WORDS.iter().map(|(name, _)| *name).collect();
        format!(
            "{text:?} is no colour: give #rrggbb as picked from a picture, or one of {}",
            words.join(", ")
        )
    })
}

/// Parts between commas or spaces.
pub(super) fn parts(text: &str) -> Vec<&str> {
    text.split([',', ' ', '\t', ';']).filter(|p| !p.is_empty()).collect()
}

/// A number above zero.
pub(super) fn above_zero(text: &str) -> Result<f64, String> {
    let value = text.trim().parse::<f64>().ok().filter(|v| v.is_finite() && *v > 0.0);
    value.ok_or_else(|| format!("{text:?} is not a number above zero"))
}

/// The diameter of a ball, from a millimetre to a metre.
pub(super) fn diameter_mm(text: &str) -> Result<f64, String> {
    within(text, 1.0..=1000.0, "mm")
}

/// The mass of an aircraft that flies indoors, from a gram to 100 kg.
pub(super) fn mass_kg(text: &str) -> Result<f64, String> {
    within(text, 1e-3..=100.0, "kg")
}

fn within(text: &str, range: RangeInclusive<f64>, unit: &str) -> Result<f64, String> {
    let value = above_zero(text)?;
    let wrong =
        || format!("{value} {unit} is not {} to {} {unit}: check the unit", range.start(), range.end());
    range.contains(&value).then_some(value).ok_or_else(wrong)
}

/// Three numbers above zero.
pub(super) fn three(text: &str) -> Result<[f64; 3], String> {
    let values: Vec<f64> = parts(text).into_iter().map(above_zero).collect::<Result<_, _>>()?;
    <[f64; 3]>::try_from(values).map_err(|v| format!("{} numbers where three must be", v.len()))
}

/// A ball on the aircraft: `red 225 225 100`, in mm, with a colour as picked from a picture where one follows.
pub(super) fn ball(text: &str, before: &[Marker]) -> Result<Marker, String> {
    let example =
        "write a ball as red,225,225,100: colour, forward, right, down of the centre of gravity in mm";
    let (name, place, picked) = match parts(text)[..] {
        [name, x, y, z] => (name, [x, y, z], None),
        [name, x, y, z, picked] => (name, [x, y, z], Some(picked)),
        _ => return Err(example.to_owned()),
    };
    if before.iter().any(|m| m.name == name) {
        return Err(format!("there is a ball {name} already: give each a name of its own, such as {name}2"));
    }
    let mut position_m = [0.0; 3];
    for (to, from) in position_m.iter_mut().zip(place) {
        let mm = from.parse::<f64>().ok().filter(|v| v.is_finite());
        *to = 1e-3 * mm.ok_or_else(|| format!("{from:?} is no number: {example}"))?;
    }
    let farthest_m = position_m.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    if farthest_m > 0.0 && !(1e-3..5.0).contains(&farthest_m) {
        let mm = 1e3 * farthest_m;
        return Err(format!(
            "a ball {mm} mm from the centre of gravity is not 1 to 5000 mm from it: check the unit"
        ));
    }
    Ok(Marker { name: name.to_owned(), position_m, diameter_m: 0.0, color: color(picked.unwrap_or(name))? })
}

/// A path that is there.
pub(super) fn file(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    if path.is_file() { Ok(path) } else { Err(format!("there is no file {text:?}")) }
}

/// The same, or none.
pub(super) fn file_or_none(text: &str) -> Result<Option<PathBuf>, String> {
    if text == "none" { Ok(None) } else { file(text).map(Some) }
}

/// The image beside a video whose name begins with the video's, where there is one alone.
pub(super) fn still_beside(video: &Path) -> Option<PathBuf> {
    let stem = video.file_stem()?.to_string_lossy().into_owned();
    let folder = video.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let is_still = |path: &PathBuf| {
        let is_image = path
            .extension()
            .is_some_and(|e| ["png", "jpg", "jpeg"].iter().any(|known| e.eq_ignore_ascii_case(known)));
        is_image && path.file_stem().is_some_and(|s| s.to_string_lossy().starts_with(&stem))
    };
    let mut found = std::fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path()).filter(is_still);
    match (found.next(), found.next()) {
        (Some(one), None) => Some(one),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn balls_and_colours_are_read_as_people_write_them() {
        let red = ball("red 225 -225 100", &[]).unwrap();
        assert_eq!((red.position_m, red.color.rgb()), ([0.225, -0.225, 0.1], [255, 0, 0]));
        let picked = ball("red2,1,2,3,#d02a2a", std::slice::from_ref(&red)).unwrap();
        assert_eq!(picked.color.rgb(), [0xd0, 0x2a, 0x2a]);
        assert!(ball("red,1,2,3", std::slice::from_ref(&red)).unwrap_err().contains("red2"));
        assert!(ball("red,1,2", &[]).unwrap_err().contains("forward"));
        assert!(color("reddish").unwrap_err().contains("#rrggbb"));
        // Metres for millimetres, and grams for kilograms.
        assert!(ball("red,0.225,0.225,0.1", &[]).unwrap_err().contains("check the unit"));
        assert!(diameter_mm("0.05").unwrap_err().contains("0.05 mm is not 1 to 1000 mm"));
        assert!(mass_kg("800").unwrap_err().contains("check the unit") && mass_kg("0.8") == Ok(0.8));
        assert!(above_zero("0").is_err() && three("1,2").is_err() && three("1, 2, 3").is_ok());
    }
}
