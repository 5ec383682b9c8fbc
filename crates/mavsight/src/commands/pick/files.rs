//! What was clicked, in the files of the session.

use anyhow::{Context, Result, ensure};
use mavsight_engine::Picker;
use mavsight_session::tables::write_control_pixels;
use mavsight_session::{Session, write_control_points, write_whole};
use std::path::{Path, PathBuf};
use toml_edit::DocumentMut;

/// Writes the clicked pixels, the colours of the control points, and the session's `observations`; each file that was there
/// is kept as `.bak`. What was written, in words.
pub(super) fn save(session: &Session, picker: &Picker) -> Result<String> {
    let solved = picker.solved()?.unwrap_or_default();
    let missing: Vec<&str> = picker
        .stills()
        .iter()
        .map(|still| still.camera.as_str())
        .filter(|name| solved.cameras.iter().all(|c| c.name != *name))
        .collect();
    ensure!(missing.is_empty(), "click six points or more of {} first", missing.join(", "));
    session.require_sizes(&solved, &session.path)?;
    let control = session.file.control.as_ref().context("the session has no control points")?;
    let pixels =
        control.observations.clone().unwrap_or_else(|| session.path.with_file_name("control_pixels.csv"));
    let mut kept = Vec::new();
    for path in [&pixels, &control.points, &session.path] {
        kept.extend(backed_up(path)?);
    }
    write_control_pixels(&pixels, &picker.pixels())?;
    write_control_points(&control.points, &picker.colored_points())?;
    if control.observations.is_none() {
        let mut file: DocumentMut = std::fs::read_to_string(&session.path)?.parse()?;
        file["control"]["observations"] = toml_edit::value("control_pixels.csv");
        write_whole(&session.path, file.to_string().as_bytes())?;
    }
    let names: Vec<String> = kept.iter().map(|p| p.display().to_string()).collect();
    Ok(format!(
        "Saved: {}, and the colours in {}. What was there is kept: {}.",
        pixels.display(),
        control.points.display(),
        names.join(", ")
    ))
}

/// Copies a file beside itself; nothing where there is none.
fn backed_up(path: &Path) -> Result<Option<PathBuf>> {
    if !path.exists() {
        return Ok(None);
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let name_of = |k: usize| if k == 1 { format!("{name}.bak") } else { format!("{name}.bak{k}") };
    let Some(copy) = (1..).map(|k| path.with_file_name(name_of(k))).find(|p| !p.exists()) else {
        return Ok(None);
    };
    std::fs::copy(path, &copy).with_context(|| format!("{}: cannot be copied", path.display()))?;
    Ok(Some(copy))
}
