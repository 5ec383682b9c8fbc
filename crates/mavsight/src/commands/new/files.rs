//! The files of a new session, with comments for who reads them.

use super::Answers;
use anyhow::Result;
use mavsight_session::{make_folder, write_control_points, write_whole};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Standard air at sea level and 20 °C, and standard gravity.
const ENVIRONMENT: &str = "\n[environment]\nair_density_kg_m3 = 1.204      # at 20 °C and 1013 hPa; 1.16 at 30 °C\n\
                           gravity_m_s2 = 9.807\n";

/// Writes session.toml, vehicle.toml and control_points.csv.
pub(super) fn write(folder: &Path, answers: &Answers) -> Result<()> {
    make_folder(folder)?;
    write_whole(&folder.join("vehicle.toml"), vehicle(folder, answers)?.as_bytes())?;
    write_control_points(&folder.join("control_points.csv"), &answers.control)?;
    write_whole(&folder.join("session.toml"), session(folder, answers)?.as_bytes())?;
    Ok(())
}

/// What was written, in a line.
pub(super) fn written(folder: &Path) -> String {
    let name = |file: &str| folder.join(file).display().to_string();
    format!("Written: {}, {}, {}", name("session.toml"), name("vehicle.toml"), name("control_points.csv"))
}

/// A path as a file in the folder names it.
fn seen_from(folder: &Path, path: &Path) -> String {
    let whole = |p: &Path| p.canonicalize().unwrap_or_else(|_| p.to_owned());
    quoted(&relative(&whole(folder), &whole(path)).to_string_lossy())
}

/// A path from a folder, both whole; as it is where they have nothing but the root in common.
fn relative(folder: &Path, path: &Path) -> PathBuf {
    let is_common = |folder: &&Path| folder.file_name().is_some() && path.starts_with(folder);
    let Some((up, common)) = folder.ancestors().enumerate().find(|(_, folder)| is_common(folder)) else {
        return path.to_owned();
    };
    let below = path.strip_prefix(common).unwrap_or(path);
    std::iter::repeat_n("..", up).map(Path::new).chain([below]).collect()
}

/// A text as TOML has it.
fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

fn session(folder: &Path, answers: &Answers) -> Result<String> {
    let mut out = String::new();
    writeln!(out, "# Every key: docs/session.md. `mavsight check` says whether all is ready.\nschema = 1")?;
    writeln!(out, "name = {}", quoted(&answers.name))?;
    writeln!(out, "vehicle = \"vehicle.toml\"")?;
    match &answers.inputs {
        Some(path) => writeln!(out, "inputs = {}", seen_from(folder, path))?,
        None => writeln!(
            out,
            "# inputs = \"inputs.csv\"           # without it no parameters, but of a model without inputs"
        )?,
    }
    writeln!(out, "\n[control]\npoints = \"control_points.csv\"")?;
    for camera in &answers.cameras {
        writeln!(out, "\n# {}", camera.look.words())?;
        writeln!(out, "[[camera]]\nname = {}", quoted(&camera.name))?;
        writeln!(out, "video = {}", seen_from(folder, &camera.video))?;
        if let Some(still) = &camera.still {
            writeln!(out, "still = {}", seen_from(folder, still))?;
        }
        writeln!(
            out,
            "# line_time_s = 0            # for a global shutter; else the flight shows the time from row to row"
        )?;
    }
    Ok(out)
}

fn vehicle(folder: &Path, answers: &Answers) -> Result<String> {
    let mut out = String::new();
    let [xx, yy, zz] = answers.inertia_kg_m2;
    writeln!(out, "# Body axes: x forward, y right, z down, from the centre of gravity.")?;
    writeln!(out, "name = {}\nmass_kg = {}", quoted(&answers.name), answers.mass_kg)?;
    writeln!(out, "inertia_kg_m2 = [{xx:e}, {yy:e}, {zz:e}]      # I_xx, I_yy, I_zz")?;
    match &answers.model {
        Some(model) if Path::new(model).is_file() => {
            writeln!(out, "model = {}", seen_from(folder, Path::new(model)))?;
        }
        Some(model) => writeln!(out, "model = {}", quoted(model))?,
        None => {
            writeln!(out, "# model = \"coaxial\"              # of docs/shelf, or a file: docs/models.md")?
        }
    }
    for ball in &answers.markers {
        let [x, y, z] = ball.position_m.map(|m| (1e6 * m).round() / 1e6);
        writeln!(out, "\n[[marker]]\nname = {}\nposition_m = [{x:?}, {y:?}, {z:?}]", quoted(&ball.name))?;
        writeln!(out, "diameter_m = {:?}\ncolor = \"{}\"", ball.diameter_m, ball.color)?;
    }
    out.push_str(ENVIRONMENT);
    if answers.model.is_some() {
        out.push_str("\n# Values of the model's parameters for this aircraft; those of its file where left out.\n# [parameters]\n");
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_video_beside_the_folder_is_named_from_it() {
        let named = |folder: &str, path: &str| relative(Path::new(folder), Path::new(path));
        assert_eq!(named("/rec/me/flight", "/rec/me/flight/a.mp4"), Path::new("a.mp4"));
        assert_eq!(named("/rec/me/new/flight", "/rec/me/videos/a.mp4"), Path::new("../../videos/a.mp4"));
        assert_eq!(named("/rec/me", "/media/card/a.mp4"), Path::new("/media/card/a.mp4"));
    }
}
