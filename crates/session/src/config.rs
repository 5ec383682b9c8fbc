//! A session: its file read, and every file that it names.

use crate::error::require_file;
use crate::session_file::{
    BoardSection, LiveSection, RefineSection, SessionCamera, SessionFile, WandSection, is_empty, validate,
};
use crate::toml_file::read_toml;
use crate::video::{FrameSource, find_clap, is_pattern};
use crate::{SessionError, read_image, tables};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::ImageSize;
use mavsight_identify::Model;
use mavsight_pipeline::{Clap, ControlPixel, ControlPointRow};
use std::path::{Path, PathBuf};

/// A session with every path made whole and every file that it names seen to exist.
#[derive(Debug, Clone, PartialEq)]
pub struct Session {
    /// The session file.
    pub path: PathBuf,
    /// Name of the session.
    pub name: String,
    /// Vehicle file.
    pub vehicle_path: PathBuf,
    /// The vehicle, validated.
    pub vehicle: Vehicle,
    /// Table of inputs.
    pub inputs_path: PathBuf,
    /// Table of truth, for scoring only.
    pub truth_path: Option<PathBuf>,
    /// Output equations to fit.
    pub model_path: Option<PathBuf>,
    /// Table of control points, where there is one.
    pub control_points_path: Option<PathBuf>,
    /// Table of control pixels.
    pub control_pixels_path: Option<PathBuf>,
    /// The wand, where one was waved.
    pub wand: Option<WandSection>,
    /// The board, where one was shown.
    pub board: Option<BoardSection>,
    /// Cameras in place of a calibration.
    pub rig_path: Option<PathBuf>,
    /// Whether a flash is where the estimation of clocks starts.
    pub flash: bool,
    /// Whether a clap is.
    pub clap: bool,
    /// What is refined from the flight, where something is.
    pub refine: Option<RefineSection>,
    /// How it is flown live, with whole paths.
    pub live: LiveSection,
    /// Cameras, at least two, with whole paths.
    pub cameras: Vec<SessionCamera>,
}

impl Session {
    /// Reads a session file and the vehicle, and checks that every file named is there.
    ///
    /// # Errors
    /// Names the file, the line or key, and what to do.
    pub fn load(path: &Path) -> Result<Self, SessionError> {
        let file: SessionFile = read_toml(path, "session file")?;
        let folder = path.parent().unwrap_or(Path::new(""));
        validate(&file, path)?;
        let vehicle_path = folder.join(&file.vehicle);
        let vehicle = load_vehicle(&vehicle_path)?;
        let session = Self {
            path: path.to_owned(),
            name: file.name,
            vehicle_path,
            vehicle,
            inputs_path: if is_empty(&file.inputs) { file.inputs } else { folder.join(file.inputs) },
            truth_path: file.truth.map(|p| folder.join(p)),
            model_path: file.model.map(|p| folder.join(p)),
            control_points_path: file.control.as_ref().map(|c| folder.join(&c.points)),
            control_pixels_path: file.control.and_then(|c| c.observations).map(|p| folder.join(p)),
            wand: file.wand,
            board: file.board,
            rig_path: file.rig.map(|r| folder.join(r.file)),
            flash: file.flash,
            clap: file.clap,
            refine: file.refine,
            live: file
                .live
                .map(|l| LiveSection { poses: l.poses.map(|p| folder.join(p)), ..l })
                .unwrap_or_default(),
            cameras: file
                .camera
                .into_iter()
                .map(|c| SessionCamera {
                    video: if is_empty(&c.video) { c.video.clone() } else { folder.join(&c.video) },
                    still: c.still.as_ref().map(|p| folder.join(p)),
                    wand: c.wand.as_ref().map(|p| folder.join(p)),
                    board: c.board.as_ref().map(|p| folder.join(p)),
                    ..c
                })
                .collect(),
        };
        session.require_files()?;
        Ok(session)
    }

    fn require_files(&self) -> Result<(), SessionError> {
        let require = |path: Option<&PathBuf>, what: &str| {
            let role = || format!("{what} in {}", self.path.display());
            path.map_or(Ok(()), |path| require_file(path, &role()))
        };
        require(self.has_inputs().then_some(&self.inputs_path), "inputs")?;
        require(self.live.poses.as_ref(), "live.poses")?;
        require(self.control_points_path.as_ref(), "control.points")?;
        require(self.truth_path.as_ref(), "truth")?;
        require(self.model_path.as_ref(), "model")?;
        require(self.control_pixels_path.as_ref(), "control.observations")?;
        require(self.rig_path.as_ref(), "rig.file")?;
        for camera in &self.cameras {
            let film = |path: &&PathBuf| !is_empty(path) && !is_pattern(path);
            let of_camera = |what: &str| format!("{what} of camera {}", camera.name);
            require(Some(&camera.video).filter(film), &of_camera("video"))?;
            require(camera.wand.as_ref().filter(film), &of_camera("wand"))?;
            require(camera.board.as_ref().filter(film), &of_camera("board"))?;
            require(camera.still.as_ref(), &of_camera("still"))?;
        }
        Ok(())
    }

    /// Opens one camera's frames, with the time stamps of the file; fields of an interlaced recording one by
    /// one.
    ///
    /// # Errors
    /// A file that cannot be read, or a camera index beyond the list.
    pub fn open_camera(&self, camera: usize) -> Result<FrameSource, SessionError> {
        let camera = self.camera(camera)?;
        Ok(in_fields(camera, FrameSource::open(&camera.video, camera.frame_rate_hz)?))
    }

    /// The clap in the sound of one camera's recording; `None` where the session has no `clap`.
    ///
    /// # Errors
    /// Those of [`find_clap`], or a camera index beyond the list.
    pub fn clap_of(&self, camera: usize) -> Result<Option<Clap>, SessionError> {
        let camera = self.camera(camera)?;
        if !self.clap {
            return Ok(None);
        }
        // Images have no sound.
        if camera.frame_rate_hz.is_some() {
            Ok(Some(Clap::Silent))
        } else {
            find_clap(&camera.video).map(Some)
        }
    }

    /// Opens one camera's recording of the wand as [`Self::open_camera`] does that of the flight; `None`
    /// where it has none.
    ///
    /// # Errors
    /// A file that cannot be read, or a camera index beyond the list.
    pub fn open_wand(&self, camera: usize) -> Result<Option<FrameSource>, SessionError> {
        let camera = self.camera(camera)?;
        let Some(path) = &camera.wand else { return Ok(None) };
        Ok(Some(in_fields(camera, FrameSource::open(path, camera.frame_rate_hz)?)))
    }

    /// Opens one camera's images of the board; `None` where it has none. Images of a sequence are a second
    /// apart.
    ///
    /// # Errors
    /// A file that cannot be read, or a camera index beyond the list.
    pub fn open_board(&self, camera: usize) -> Result<Option<FrameSource>, SessionError> {
        let path = &self.camera(camera)?.board;
        path.as_ref().map(|path| FrameSource::open(path, Some(1.0))).transpose()
    }

    /// The size that a camera films in: as its recording has it; of one that is only flown live, its still,
    /// or its recording of the wand or of the board.
    ///
    /// # Errors
    /// A file that cannot be read, a camera index beyond the list, a camera without any of them.
    pub fn image_size(&self, camera: usize) -> Result<ImageSize, SessionError> {
        let own = self.camera(camera)?;
        if !is_empty(&own.video) {
            return Ok(self.open_camera(camera)?.size());
        }
        if let Some(still) = &own.still {
            return Ok(read_image(still)?.size);
        }
        let moved = self.open_wand(camera)?.map_or_else(|| self.open_board(camera), |wand| Ok(Some(wand)))?;
        let unknown = "has no image of which the size is known: give it `video` or `still`";
        let refuse = || SessionError::value(&self.path, format!("camera {}", own.name), unknown);
        moved.map(|m| m.size()).ok_or_else(refuse)
    }

    fn camera(&self, camera: usize) -> Result<&SessionCamera, SessionError> {
        let missing =
            || format!("there is no camera number {camera}: the session has {}", self.cameras.len());
        self.cameras.get(camera).ok_or_else(|| SessionError::value(&self.path, "camera", missing()))
    }

    /// Whether there is a table of inputs.
    pub fn has_inputs(&self) -> bool {
        !is_empty(&self.inputs_path)
    }

    /// Reads the inputs.
    ///
    /// # Errors
    /// Names row and column; a session without inputs.
    pub fn inputs(&self) -> Result<InputSeries, SessionError> {
        if !self.has_inputs() {
            let detail = "is missing: name the table of what was commanded";
            return Err(SessionError::value(&self.path, "inputs", detail));
        }
        tables::read_inputs(&self.inputs_path)
    }

    /// Reads the control points; none where the session has no table of them.
    ///
    /// # Errors
    /// Names row and column.
    pub fn control_points(&self) -> Result<Vec<ControlPointRow>, SessionError> {
        self.control_points_path.as_deref().map_or_else(|| Ok(Vec::new()), tables::read_control_points)
    }

    /// Reads the control pixels, where the session has a table of them; names are checked against the
    /// session.
    ///
    /// # Errors
    /// Names row and column.
    pub fn control_pixels(&self) -> Result<Option<Vec<ControlPixel>>, SessionError> {
        let Some(path) = &self.control_pixels_path else { return Ok(None) };
        let points = self.control_points()?;
        let cameras: Vec<&str> = self.cameras.iter().map(|c| c.name.as_str()).collect();
        let names: Vec<&str> = points.iter().map(|p| p.name.as_str()).collect();
        tables::read_control_pixels(path, &cameras, &names).map(Some)
    }

    /// Reads the output equations, where the session names them.
    ///
    /// # Errors
    /// Names the file and the line or key.
    pub fn model(&self) -> Result<Option<Model>, SessionError> {
        self.model_path.as_deref().map(load_model).transpose()
    }
}

/// The fields one by one, where a camera is interlaced.
fn in_fields(camera: &SessionCamera, source: FrameSource) -> FrameSource {
    match camera.interlaced {
        Some(order) => source.fields(order),
        None => source,
    }
}

/// Reads a model file. Whether its signals exist is seen when it is used.
///
/// # Errors
/// Names the file and the line or key.
pub fn load_model(path: &Path) -> Result<Model, SessionError> {
    require_file(path, "model file")?;
    let text = std::fs::read_to_string(path).map_err(|e| SessionError::io(path, "read it", e))?;
    Model::parse(&text).map_err(|source| SessionError::Model { path: path.to_owned(), source })
}

/// Reads and validates a vehicle file.
///
/// # Errors
/// Names the file and the line or key.
pub fn load_vehicle(path: &Path) -> Result<Vehicle, SessionError> {
    let vehicle: Vehicle = read_toml(path, "vehicle file")?;
    vehicle.validate().map_err(|source| SessionError::Flight { path: path.to_owned(), source })?;
    Ok(vehicle)
}
