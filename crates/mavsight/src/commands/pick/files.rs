//! What was clicked, in the files of the session.

use anyhow::{Context, Result, ensure};
use mavsight_engine::{MarkerPicker, Picker};
use mavsight_flight::Vehicle;
use mavsight_session::tables::write_control_pixels;
use mavsight_session::{Session, write_control_points, write_whole};
use std::path::{Path, PathBuf};
use toml_edit::{DocumentMut, TableLike};

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

/// Writes the colours of the markers that were clicked into the vehicle file, whose other lines and comments are kept; the file that was
/// there is kept as `.bak`. What was written, in words.
pub(super) fn save_colors(session: &Session, picker: &MarkerPicker) -> Result<String> {
    ensure!(!picker.picked().is_empty(), "click on a marker first");
    let missed = picker.missed()?.len();
    let (path, vehicle) = (&session.file.vehicle, picker.vehicle());
    let text =
        std::fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let mut file: DocumentMut =
        text.parse().with_context(|| format!("{}: cannot be read", path.display()))?;
    let changed = recolor(&mut file, &vehicle);
    ensure!(changed > 0, "{} has these colours already", path.display());
    let kept =
        backed_up(path)?.map_or_else(String::new, |p| format!(" What was there is kept: {}.", p.display()));
    write_whole(path, file.to_string().as_bytes())?;
    let doubt = if missed == 0 {
        String::new()
    } else {
        format!(" {missed} of the clicked balls are not found by them: see the list.")
    };
    let (path, session) = (path.display(), session.path.display());
    Ok(format!("Saved: {changed} colours in {path}.{kept}{doubt} Next: mavsight check {session}"))
}

/// Gives the markers of a vehicle file the colours of a vehicle. How many had another.
fn recolor(file: &mut DocumentMut, vehicle: &Vehicle) -> usize {
    let markers = file.get_mut("marker");
    let tables: Vec<&mut dyn TableLike> = match markers {
        Some(toml_edit::Item::ArrayOfTables(all)) => {
            all.iter_mut().map(|t| t as &mut dyn TableLike).collect()
        }
        Some(toml_edit::Item::Value(toml_edit::Value::Array(all))) => {
            let tables = all.iter_mut().filter_map(toml_edit::Value::as_inline_table_mut);
            tables.map(|t| t as &mut dyn TableLike).collect()
        }
        _ => Vec::new(),
    };
    let mut changed = 0;
    for table in tables {
        let name = table.get("name").and_then(|n| n.as_str());
        let Some(own) = vehicle.marker.iter().find(|m| Some(m.name.as_str()) == name) else { continue };
        let color = own.color.to_string();
        let Some(value) = table.get_mut("color").and_then(|item| item.as_value_mut()) else { continue };
        if value.as_str() != Some(&color) {
            // A comment behind it is kept.
            let decor = value.decor().clone();
            *value = color.into();
            *value.decor_mut() = decor;
            changed += 1;
        }
    }
    changed
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
