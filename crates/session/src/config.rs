//! A session: its file read, and every file that it names.

use crate::error::read_text;
use crate::error::require_file;
use crate::files::read_toml;
use crate::session_file::{LiveSection, SessionCamera, SessionFile, is_empty, validate};
use crate::video::{FrameSource, find_clap, is_pattern};
use crate::{SessionError, read_image, tables};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::ImageSize;
use mavsight_identify::Model;
use mavsight_pipeline::{Clap, ControlPixel, ControlPointRow};
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
    /// The vehicle, validated.
    pub vehicle: Vehicle,
}

impl Session {
    /// Reads a session file and the vehicle, and checks that every file named is there.
    pub fn load(path: &Path) -> Result<Self, SessionError> {
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
        Ok(Self { path: path.to_owned(), file, vehicle })
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
        if !is_empty(&own.video) {
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

    /// Reads the inputs; none where the session has no table of them.
    pub fn inputs(&self) -> Result<Option<InputSeries>, SessionError> {
        let path = Some(&self.file.inputs).filter(|path| !is_empty(path));
        path.map(|path| tables::read_inputs(path)).transpose()
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

    /// Reads the output equations, where the session names them.
    pub fn model(&self) -> Result<Option<Model>, SessionError> {
        self.file.model.as_deref().map(load_model).transpose()
    }
}

/// A recording of a camera, its fields one by one where it is interlaced.
fn open_film(camera: &SessionCamera, path: &Path) -> Result<FrameSource, SessionError> {
    let source = FrameSource::open(path, camera.frame_rate_hz)?;
    Ok(match camera.interlaced {
        Some(order) => source.fields(order),
        None => source,
    })
}

/// Reads a model file. Whether its signals exist is seen when it is used.
///
/// # Errors
/// Names the file and the line or key.
pub fn load_model(path: &Path) -> Result<Model, SessionError> {
    let text = read_text(path, "model file")?;
    Model::parse(&text).map_err(|source| SessionError::content(path, source))
}

/// Reads and validates a vehicle file.
///
/// # Errors
/// Names the file and the line or key.
pub fn load_vehicle(path: &Path) -> Result<Vehicle, SessionError> {
    let vehicle: Vehicle = read_toml(path, "vehicle file")?;
    vehicle.validate().map_err(|source| SessionError::content(path, source))?;
    Ok(vehicle)
}
