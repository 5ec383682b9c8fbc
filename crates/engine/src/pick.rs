//! Balls that a person points at: control points in the stills, markers in frames of the flight.

mod markers;

pub use markers::{MarkerPicker, PickedMarker};

use crate::EngineError;
use crate::error::input;
use mavsight_flight::Color;
use mavsight_geometry::{ImageSize, Vector2};
use mavsight_pipeline::{
    ControlPixel, ControlPointRow, ControlStill, PipelineError, REACH_PX, ball_at,
    calibrate_from_observations,
};
use mavsight_pose::Rig;
use mavsight_session::{Session, read_image};
use mavsight_vision::Detection;

/// Points that determine a camera by themselves: two equations each, eleven unknowns.
const LEAST_POINTS: usize = 6;

/// A control point in one still.
#[derive(Debug, Clone, PartialEq)]
pub struct PickedBall {
    /// Camera, by its place among [`Picker::stills`].
    pub camera: usize,
    /// Control point, by its place among [`Picker::points`].
    pub point: usize,
    /// The ball as it was found about the click.
    pub ball: Detection,
}

/// Why a click names no ball.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PickError {
    /// No such camera, frame, control point or marker.
    #[error("there is no such camera, frame or ball: load the page again")]
    Unknown,
    /// Nothing coloured, or nothing round, is there.
    #[error(
        "{camera} shows no ball of one colour, 3 px wide or more, within {REACH_PX} px of ({u_px:.0}, {v_px:.0}): click on a ball"
    )]
    NoBall {
        /// Camera name.
        camera: String,
        /// Where the click was.
        u_px: f64,
        /// Row.
        v_px: f64,
    },
    /// The ball bears another name.
    #[error("that ball of {camera} is {name} already: take that back first, or click on another")]
    Taken {
        /// Camera name.
        camera: String,
        /// The other control point or marker.
        name: String,
    },
}

/// Stills of a session and the control points that were clicked in them.
///
/// A click gives what the detection finds about it: the centre by the same fit as in a run, and the colour that the picture has.
pub struct Picker {
    points: Vec<ControlPointRow>,
    stills: Vec<ControlStill>,
    picked: Vec<PickedBall>,
}

impl Picker {
    /// The stills and control points of a session, nothing clicked yet.
    ///
    /// # Errors
    /// Files that are wrong. Without control points or stills both lists are empty.
    pub fn open(session: &Session) -> Result<Self, EngineError> {
        let points = input(session.control_points())?;
        let with_still = session.cameras().iter().filter_map(|c| Some((c.name.clone(), c.still.as_ref()?)));
        let stills = with_still
            .map(|(camera, path)| Ok(ControlStill { camera, frame: input(read_image(path))? }))
            .collect::<Result<_, EngineError>>()?;
        Ok(Self { points, stills, picked: Vec::new() })
    }

    /// The control points, in the order of their table.
    pub fn points(&self) -> &[ControlPointRow] {
        &self.points
    }

    /// The stills, in the order of the session's cameras.
    pub fn stills(&self) -> &[ControlStill] {
        &self.stills
    }

    /// What was clicked.
    pub fn picked(&self) -> &[PickedBall] {
        &self.picked
    }

    /// Takes the ball about a pixel for a control point, in place of the one before.
    ///
    /// # Errors
    /// [`PickError`].
    pub fn pick(&mut self, camera: usize, point: usize, at: Vector2<f64>) -> Result<&PickedBall, PickError> {
        let still =
            self.stills.get(camera).filter(|_| point < self.points.len()).ok_or(PickError::Unknown)?;
        let name = || still.camera.clone();
        let found = ball_at(&still.frame, at);
        let ball = found.ok_or_else(|| PickError::NoBall { camera: name(), u_px: at.x, v_px: at.y })?;
        let is_same = |p: &&PickedBall| {
            p.camera == camera
                && p.point != point
                && (p.ball.pixel - ball.pixel).norm() < 0.5 * ball.diameter_px
        };
        if let Some(other) = self.picked.iter().find(is_same) {
            let other = self.points[other.point].name.clone();
            return Err(PickError::Taken { camera: name(), name: other });
        }
        self.forget(camera, point);
        self.picked.push(PickedBall { camera, point, ball });
        self.picked.last().ok_or(PickError::Unknown)
    }

    /// Takes a click back.
    pub fn forget(&mut self, camera: usize, point: usize) {
        self.picked.retain(|p| (p.camera, p.point) != (camera, point));
    }

    /// The cameras that six clicks or more determine; none before that.
    ///
    /// # Errors
    /// What the calibration refuses.
    pub fn solved(&self) -> Result<Option<Rig>, PipelineError> {
        let count = |camera: usize| self.picked.iter().filter(|p| p.camera == camera).count();
        let cameras: Vec<(String, ImageSize)> = self
            .stills
            .iter()
            .enumerate()
            .filter(|(k, _)| count(*k) >= LEAST_POINTS)
            .map(|(_, still)| (still.camera.clone(), still.frame.size))
            .collect();
        if cameras.is_empty() {
            return Ok(None);
        }
        calibrate_from_observations(&cameras, &self.points, &self.pixels(), &[]).map(Some)
    }

    /// What was clicked, as a session's table has it.
    pub fn pixels(&self) -> Vec<ControlPixel> {
        let pixel = |p: &PickedBall| ControlPixel {
            camera: self.stills[p.camera].camera.clone(),
            name: self.points[p.point].name.clone(),
            u_px: p.ball.pixel.x,
            v_px: p.ball.pixel.y,
            std_px: (0.5 * p.ball.covariance_px2.trace()).sqrt(),
        };
        self.picked.iter().map(pixel).collect()
    }

    /// The control points with the colours that the stills have where they were clicked.
    pub fn colored_points(&self) -> Vec<ControlPointRow> {
        let mut points = self.points.clone();
        for (k, row) in points.iter_mut().enumerate() {
            let seen = self.picked.iter().filter(|p| p.point == k).map(|p| p.ball.color);
            row.color = mean_color(seen).unwrap_or(row.color);
        }
        points
    }
}

/// The mean of colours as pictures have them; none of none.
fn mean_color(seen: impl Iterator<Item = [u8; 3]>) -> Option<Color> {
    let (mut sums, mut count) = ([0_usize; 3], 0);
    for rgb in seen {
        sums.iter_mut().zip(rgb).for_each(|(sum, code)| *sum += usize::from(code));
        count += 1;
    }
    let [r, g, b] = sums.map(|sum| sum.checked_div(count).map(|mean| mean as u8));
    Some(Color::new(r?, g?, b?))
}
