//! A planner from a room file and what it names.

use crate::{PlanError, Planner, Room};
use mavsight_flight::Vehicle;
use mavsight_pipeline::body_markers;
use mavsight_session::{load_vehicle, read_control_points, read_toml};
use std::path::Path;

impl Planner {
    /// Reads a room file, its vehicle (the paper's where it names none) and its control points; paths are
    /// relative to it.
    ///
    /// # Errors
    /// [`PlanError::Session`] and [`PlanError::Room`] name the file and what is wrong in it.
    pub fn load(path: &Path) -> Result<(Self, Vehicle), PlanError> {
        let room: Room = read_toml(path, "room file")?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let vehicle = match &room.vehicle {
            Some(file) => load_vehicle(&folder.join(file))?,
            None => Vehicle::paper(),
        };
        let control = match &room.control {
            Some(section) => read_control_points(&folder.join(&section.points))?,
            None => Vec::new(),
        };
        let named = |source| PlanError::Room { path: path.to_owned(), source: Box::new(source) };
        Ok((Self::new(room, body_markers(&vehicle), control).map_err(named)?, vehicle))
    }
}
