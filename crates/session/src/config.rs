//! A session: its file read, and every file that it names.

use crate::error::read_text;
use crate::error::require_file;
use crate::files::{read_toml, write_toml, write_whole};
use crate::foreign::Noted;
use crate::logs::{
    LogGyroscope, LogSection, read_log_gyroscope, read_log_inputs, read_log_sensors, unit_by_model,
};
use crate::session_file::{SessionCamera, SessionFile, is_empty, validate};
use crate::video::{FrameSource, find_clap, is_pattern};
use crate::{SessionError, read_image, read_rig, tables};
use mavsight_flight::{InputSeries, SensorSeries, Vehicle, VehicleFile};
use mavsight_geometry::{CAMERA_PARAMETERS, ImageSize};
use mavsight_identify::EquationFile;
use mavsight_link::LiveSection;
use mavsight_pipeline::{Clap, ControlPixel, ControlPointRow};
use mavsight_pose::Rig;
use std::path::{Path, PathBuf};

/// A session whose files are there.
///
/// Errors name the file, the line, key or cell, and what to do; a camera index beyond the list is one as
/// well.
#[derive(Debug, Clone, PartialEq)]
pub struct Session {
    /// The session file.
    pub path: PathBuf,
    /// What it says, with whole paths; at least two cameras.
    pub file: SessionFile,
    /// The vehicle, validated, with the flight model that the session names in place of the vehicle's.
    pub vehicle: Vehicle,
}

impl Session {
    /// Reads a session file, or the `session.toml` of a folder, and the vehicle, and checks that every file named is
    /// there.
    pub fn load(path: &Path) -> Result<Self, SessionError> {
        let of_folder = path.is_dir().then(|| path.join("session.toml"));
        let path = of_folder.as_deref().unwrap_or(path);
        let mut file: SessionFile = read_toml(path, "session file")?;
        validate(&file, path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        file.vehicle = folder.join(&file.vehicle);
        let vehicle = load_vehicle(&file.vehicle)?;
        for (key, named) in file.files_mut() {
            *named = folder.join(&*named);
            if !is_pattern(named) {
                require_file(named, &format!("{key} in {}", path.display()))?;
            }
        }
        let mut session = Self { path: path.to_owned(), file, vehicle };
        if let Some(equations @ EquationFile::Model(_)) = session.equations()? {
            session.vehicle = equations.vehicle(&session.vehicle);
            let validated = session.vehicle.validate();
            validated.map_err(|source| SessionError::content(&session.file.vehicle, source))?;
        }
        session.require_sensors_once()?;
        Ok(session)
    }

    /// Refuses sensors by both a table and the log.
    fn require_sensors_once(&self) -> Result<(), SessionError> {
        let in_log = self.file.log.as_ref().is_some_and(|log| log.names_sensors(&self.vehicle.model));
        if in_log && self.file.sensors.is_some() {
            let detail = "is given, and the [log] has sensors of the model too: leave one of them out";
            return Err(SessionError::value(&self.path, "sensors", detail));
        }
        Ok(())
    }

    /// The cameras, in the order of the file.
    pub fn cameras(&self) -> &[SessionCamera] {
        &self.file.camera
    }

    /// How it is flown live.
    pub fn live(&self) -> LiveSection {
        self.file.live.clone().unwrap_or_default()
    }

    /// Opens one camera's frames, with the time stamps of the file; fields of an interlaced recording one by
    /// one.
    pub fn open_camera(&self, camera: usize) -> Result<FrameSource, SessionError> {
        let camera = self.camera(camera)?;
        if !camera.is_recorded() {
            let detail = "has no recording: give it `video`, or fly it live (`mavsight live`)";
            return Err(SessionError::value(&self.path, format!("camera {}", camera.name), detail));
        }
        open_film(camera, &camera.video)
    }

    /// Opens one camera's recording of the wand as [`Self::open_camera`] does that of the flight; `None`
    /// where it has none.
    pub fn open_wand(&self, camera: usize) -> Result<Option<FrameSource>, SessionError> {
        let camera = self.camera(camera)?;
        camera.wand.as_ref().map(|path| open_film(camera, path)).transpose()
    }

    /// The clap in the sound of one camera's recording; `None` where the session has no `clap`.
    pub fn clap_of(&self, camera: usize) -> Result<Option<Clap>, SessionError> {
        let camera = self.camera(camera)?;
        let has_sound = camera.frame_rate_hz.is_none();
        let clap = || if has_sound { find_clap(&camera.video) } else { Ok(Clap::Silent) };
        self.file.clap.then(clap).transpose()
    }

    /// Opens one camera's images of the board; `None` where it has none. Images of a sequence are a second
    /// apart.
    pub fn open_board(&self, camera: usize) -> Result<Option<FrameSource>, SessionError> {
        let path = &self.camera(camera)?.board;
        path.as_ref().map(|path| FrameSource::open(path, Some(1.0))).transpose()
    }

    /// The size that a camera films in: as its recording has it; of one that is only flown live, its still,
    /// or its recording of the wand or of the board.
    pub fn image_size(&self, camera: usize) -> Result<ImageSize, SessionError> {
        let own = self.camera(camera)?;
        if own.is_recorded() {
            return Ok(self.open_camera(camera)?.size());
        }
        if let Some(still) = &own.still {
            return Ok(read_image(still)?.size);
        }
        let moved = self.open_wand(camera)?.map_or_else(|| self.open_board(camera), |wand| Ok(Some(wand)))?;
        moved.map(|m| m.size()).ok_or_else(|| {
            let unknown = "has no image of which the size is known: give it `video` or `still`";
            SessionError::value(&self.path, format!("camera {}", own.name), unknown)
        })
    }

    fn camera(&self, camera: usize) -> Result<&SessionCamera, SessionError> {
        let cameras = self.cameras();
        let missing = || format!("there is no camera number {camera}: the session has {}", cameras.len());
        cameras.get(camera).ok_or_else(|| SessionError::value(&self.path, "camera", missing()))
    }

    /// Reads the inputs, from their table or from the log; none where the session names none.
    pub fn inputs(&self) -> Result<Option<InputSeries>, SessionError> {
        Ok(self.noted_inputs()?.map(|inputs| inputs.value))
    }

    /// [`Session::inputs`], with what was left out of a log.
    pub fn noted_inputs(&self) -> Result<Option<Noted<InputSeries>>, SessionError> {
        let model = &self.vehicle.model;
        let log = self.file.log.as_ref().map(|log| log.without_sensors(model));
        if let Some(log) = log.filter(LogSection::has_inputs) {
            return read_log_inputs(&log, &unit_by_model(model)).map(Some);
        }
        let path = Some(&self.file.inputs).filter(|path| !is_empty(path));
        path.map(|path| tables::read_inputs(path, &self.vehicle).map(Noted::plain)).transpose()
    }

    /// Reads the gyroscope of the session's log; none where it names no log, or one without a gyroscope.
    pub fn log_gyroscope(&self) -> Result<Option<LogGyroscope>, SessionError> {
        self.file.log.as_ref().map_or(Ok(None), read_log_gyroscope)
    }

    /// Reads the samples of the model's sensors that the session's log has, by its clock; none where it names none among
    /// its inputs.
    pub fn log_sensors(&self) -> Result<Option<Noted<SensorSeries>>, SessionError> {
        let log = self.file.log.as_ref();
        log.map_or(Ok(None), |log| read_log_sensors(log, &self.vehicle.model))
    }

    /// Reads the samples of the model's sensors, by the clock of the cameras; none where the session has no table of them.
    pub fn sensors(&self) -> Result<Option<SensorSeries>, SessionError> {
        self.file.sensors.as_deref().map(|path| tables::read_sensors(path, &self.vehicle.model)).transpose()
    }

    /// Reads the control points; none where the session has no table of them.
    pub fn control_points(&self) -> Result<Vec<ControlPointRow>, SessionError> {
        self.file.control.as_ref().map_or(Ok(Vec::new()), |c| tables::read_control_points(&c.points))
    }

    /// Reads the control pixels, where the session has a table of them; names are checked against the
    /// session.
    pub fn control_pixels(&self) -> Result<Option<Vec<ControlPixel>>, SessionError> {
        let Some(path) = self.file.control.as_ref().and_then(|c| c.observations.as_ref()) else {
            return Ok(None);
        };
        let points = self.control_points()?;
        let cameras: Vec<&str> = self.cameras().iter().map(|c| c.name.as_str()).collect();
        let names: Vec<&str> = points.iter().map(|p| p.name.as_str()).collect();
        tables::read_control_pixels(path, &cameras, &names).map(Some)
    }

    /// Reads the equations in place of those of the vehicle's model, where the session names them.
    pub fn equations(&self) -> Result<Option<EquationFile>, SessionError> {
        self.file.model.as_deref().map(load_equations).transpose()
    }

    /// The rig that the session names in place of a calibration, its cameras in the session's order; `None`
    /// where it names none. Cameras of the file that the session does not have are left out.
    ///
    /// # Errors
    /// Those of [`read_rig`]; a camera that the file does not have, or that has another image size there than
    /// its recording. Where there is none, as for a camera that is only flown live, the size is the file's.
    pub fn rig(&self) -> Result<Option<Rig>, SessionError> {
        let Some(path) = self.file.rig.as_ref().map(|r| &r.file) else { return Ok(None) };
        let names: Vec<&str> = self.cameras().iter().map(|c| c.name.as_str()).collect();
        let rig = cameras_of(&read_rig(path)?, &names, path)?;
        self.require_sizes(&rig, path)?;
        Ok(Some(rig))
    }

    /// Refuses a rig, which has the session's cameras in their order by what `path` names, where a recording
    /// has another size than its camera was calibrated at.
    ///
    /// # Errors
    /// The first such camera; recordings that cannot be read.
    pub fn require_sizes(&self, rig: &Rig, path: &Path) -> Result<(), SessionError> {
        let recorded = |k: &(usize, _)| self.cameras().get(k.0).is_some_and(SessionCamera::is_recorded);
        for (k, own) in rig.cameras.iter().enumerate().filter(recorded) {
            let (filmed, size) = (self.image_size(k)?, own.camera.size);
            if filmed != size {
                let detail = format!(
                    "is calibrated at {}×{} px, but its recording has {}×{}: calibrate it at the size it films in",
                    size.width_px, size.height_px, filmed.width_px, filmed.height_px
                );
                return Err(SessionError::value(path, format!("camera {}", own.name), detail));
            }
        }
        Ok(())
    }

    /// Refuses images of an object (`board` or `wand`) of another size than the camera films in: pixels of one are not those
    /// of the other.
    ///
    /// # Errors
    /// Both sizes and the remedy; [`Self::image_size`]'s.
    pub fn require_size_of(&self, object: &str, camera: usize, size: ImageSize) -> Result<(), SessionError> {
        let films = self.image_size(camera)?;
        if size == films {
            return Ok(());
        }
        let detail = format!(
            "its {object} was filmed at {}×{} px, but it films at {}×{}: film the {object} anew, with the settings of the flight",
            size.width_px, size.height_px, films.width_px, films.height_px
        );
        Err(SessionError::value(&self.path, format!("camera {}", self.camera(camera)?.name), detail))
    }
}

/// The cameras of a rig that have some names, in the order of these, with what is not known of them.
///
/// # Errors
/// A name that no camera has; the rig was read from `path`.
pub fn cameras_of(rig: &Rig, names: &[&str], path: &Path) -> Result<Rig, SessionError> {
    let places = names
        .iter()
        .map(|name| {
            rig.cameras.iter().position(|c| c.name == *name).ok_or_else(|| {
                let found: Vec<&str> = rig.cameras.iter().map(|c| c.name.as_str()).collect();
                let detail =
                    format!("is missing: the file has {}; rename one or the other", found.join(", "));
                SessionError::value(path, format!("camera {name}"), detail)
            })
        })
        .collect::<Result<Vec<usize>, _>>()?;
    let rows: Vec<usize> =
        places.iter().flat_map(|k| CAMERA_PARAMETERS * k..CAMERA_PARAMETERS * (k + 1)).collect();
    let uncertainty = rig.uncertainty.select_rows(&rows);
    let cameras = places.into_iter().map(|k| rig.cameras[k].clone()).collect();
    Ok(Rig { cameras, uncertainty, ..rig.clone() })
}

/// A recording of a camera, its fields one by one where it is interlaced.
fn open_film(camera: &SessionCamera, path: &Path) -> Result<FrameSource, SessionError> {
    let source = FrameSource::open(path, camera.frame_rate_hz)?;
    Ok(match camera.interlaced {
        Some(order) => source.fields(order),
        None => source,
    })
}

/// Reads a file of equations: output equations (schema 1), of which it is seen when they are used whether
/// their signals exist, or a flight model (schema 2).
///
/// # Errors
/// Names the file and the line or key.
pub fn load_equations(path: &Path) -> Result<EquationFile, SessionError> {
    let text = read_text(path, "model file")?;
    let file = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    EquationFile::parse(&file, &text).map_err(|source| SessionError::content(path, source))
}

/// Reads and validates a vehicle file, with the model file beside it that it names.
///
/// # Errors
/// Names the file and the line or key.
pub fn load_vehicle(path: &Path) -> Result<Vehicle, SessionError> {
    let file: VehicleFile = read_toml(path, "vehicle file")?;
    let beside = path.parent().unwrap_or(Path::new(""));
    let model = |name: &str| read_text(&beside.join(name), "flight model").map_err(|e| e.to_string());
    let vehicle = file.vehicle(model).map_err(|source| SessionError::content(path, source))?;
    vehicle.validate().map_err(|source| SessionError::content(path, source))?;
    Ok(vehicle)
}

/// Writes a vehicle file, and beside it the model that it names unless that is of the shelf.
///
/// # Errors
/// What the file system refuses.
pub fn write_vehicle(path: &Path, vehicle: &Vehicle) -> Result<(), SessionError> {
    let mut file = VehicleFile::from(vehicle.clone());
    let own = |name: &String| mavsight_model::Model::shelf(name).is_none();
    if let Some(name) = file.model.take_if(|name| own(name)) {
        let name = Path::new(&name).file_name().unwrap_or("model.toml".as_ref()).to_owned();
        write_whole(&path.with_file_name(&name), vehicle.model.definition.as_bytes())?;
        file.model = Some(name.to_string_lossy().into_owned());
    }
    write_toml(path, &file)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::{Camera, ImageSize, Intrinsics, Vector3};
    use mavsight_pose::{Lens, Pixels};
    use nalgebra::DMatrix;

    fn rig() -> Rig {
        let size = ImageSize { width_px: 640, height_px: 480 };
        let k = Intrinsics::from_horizontal_fov(size, 1.0);
        let camera = |name: &str, x: f64| {
            let camera = Camera::looking_at(Vector3::new(x, -4.0, 1.0), Vector3::zeros(), k, size);
            let model = mavsight_pose::CameraModel { pixels: Pixels::Square, lens: Lens::Straight };
            mavsight_pose::RigCamera::exact(name.into(), camera, model)
        };
        let cameras = vec![camera("a", -1.0), camera("b", 0.0), camera("c", 1.0)];
        let uncertainty = DMatrix::from_fn(48, 2, |i, j| (i / 16) as f64 + 10.0 * j as f64);
        Rig { cameras, uncertainty, ..Rig::default() }
    }

    #[test]
    fn cameras_come_by_their_names_with_their_own_uncertainty() {
        let got = cameras_of(&rig(), &["c", "a"], Path::new("rig.toml")).unwrap();
        assert_eq!(got.cameras.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["c", "a"]);
        assert_eq!(got.uncertainty.shape(), (32, 2));
        assert!(got.uncertainty[(0, 0)] == 2.0 && got.uncertainty[(31, 1)] == 10.0);
        let refused = cameras_of(&rig(), &["a", "d"], Path::new("rig.toml")).unwrap_err().to_string();
        assert!(refused.contains("camera d") && refused.contains("a, b, c"), "{refused}");
    }
}
