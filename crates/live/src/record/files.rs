//! The files of a session, copied into the folder of its recording.

use mavsight_flight::VehicleFile;
use mavsight_session::{SessionFile, load_vehicle, read_toml, write_vehicle};
use std::path::{Path, PathBuf};

/// Copies the files that a session names, its recordings excepted, and makes their paths those of the copies.
pub(super) fn copy_files(session: &mut SessionFile, base: &Path, folder: &Path) -> Result<(), String> {
    let stills = session.camera.iter_mut().filter_map(|c| c.still.as_mut());
    let rig = session.rig.iter_mut().map(|r| &mut r.file);
    let control = session.control.iter_mut().flat_map(|c| {
        let observations = c.observations.as_mut();
        std::iter::once(&mut c.points).chain(observations)
    });
    let log = session.log.iter_mut().map(|log| &mut log.file);
    let tables = std::iter::once(&mut session.inputs).chain(&mut session.sensors).chain(log);
    copy_vehicle(folder, base, &mut session.vehicle)?;
    for path in tables.chain(&mut session.model).chain(rig).chain(control).chain(stills) {
        copy_in(folder, base, path)?;
    }
    for camera in &mut session.camera {
        for path in [&mut camera.wand, &mut camera.board].into_iter().flatten() {
            *path = base.join(&path);
        }
    }
    Ok(())
}

/// Copies the vehicle file, and beside it the model file that it names, if it names one.
fn copy_vehicle(folder: &Path, base: &Path, path: &mut PathBuf) -> Result<(), String> {
    let from = base.join(&path);
    copy_in(folder, base, path)?;
    let to = folder.join(&path);
    let file: VehicleFile = read_toml(&to, "vehicle file").map_err(|e| e.to_string())?;
    let has_model = file.model.is_some_and(|name| from.with_file_name(name).is_file());
    if has_model && to != from {
        let written = load_vehicle(&from).and_then(|vehicle| write_vehicle(&to, &vehicle));
        written.map_err(|e| e.to_string())?;
    }
    Ok(())
}

/// Copies a file, if one is named, into a folder and sets its path to the copy's name.
fn copy_in(folder: &Path, base: &Path, path: &mut PathBuf) -> Result<(), String> {
    if path.as_os_str().is_empty() {
        return Ok(());
    }
    let from = base.join(&path);
    let name = from.file_name().map(PathBuf::from).ok_or_else(|| format!("{} is no file", from.display()))?;
    if from.parent() == Some(folder) {
        *path = name;
        return Ok(());
    }
    let mut to = name;
    for k in 2.. {
        if !folder.join(&to).exists() {
            break;
        }
        to = PathBuf::from(format!("{k}-{}", from.file_name().unwrap_or_default().to_string_lossy()));
    }
    std::fs::copy(&from, folder.join(&to)).map_err(|e| format!("{}: {e}", from.display()))?;
    *path = to;
    Ok(())
}
