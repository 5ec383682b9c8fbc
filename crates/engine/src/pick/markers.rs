//! The colours of markers, by clicks on them in frames of the flight.

use super::{PickError, mean_color};
use crate::EngineError;
use crate::check::Part;
use mavsight_flight::{Color, Vehicle};
use mavsight_geometry::Vector2;
use mavsight_pipeline::{ball_at, balls_of_markers};
use mavsight_session::{FrameSource, Session};
use mavsight_vision::{BallColor, Detection, Detector, Frame, VisionError};

/// Frames of each camera among which one is chosen, evenly spread over the flight: few enough that those of large images are
/// held in memory.
const FRAMES: usize = 24;

/// A marker in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct PickedMarker {
    /// Camera, by its place among [`MarkerPicker::cameras`].
    pub camera: usize,
    /// Frame, by its place among those of the camera.
    pub frame: usize,
    /// Marker, by its place in the vehicle file.
    pub marker: usize,
    /// The ball as it was found about the click.
    pub ball: Detection,
}

/// One camera's flight, of which some frames are kept as they are reached.
struct Reel {
    camera: String,
    source: FrameSource,
    /// Frames from one that is kept to the next.
    every: usize,
    /// Frames to be kept, all together.
    count: usize,
    passed: usize,
    kept: Vec<(i64, Frame)>,
}

impl Reel {
    fn of(camera: String, source: FrameSource) -> Self {
        let length = source.declared_frames().unwrap_or_else(|| Part::Long.frames(source.size())).max(1);
        let every = length.div_ceil(FRAMES);
        Self { camera, source, every, count: length.div_ceil(every), passed: 0, kept: Vec::new() }
    }

    /// Reads on towards a frame for about a second.
    fn read_towards(&mut self, place: usize) -> Result<(), EngineError> {
        for _ in 0..Part::First.frames(self.source.size()) {
            if self.kept.len() > place.min(self.count - 1) {
                return Ok(());
            }
            match self.source.next() {
                Some(Ok(frame)) => {
                    if self.passed.is_multiple_of(self.every) {
                        self.kept.push(frame);
                    }
                    self.passed += 1;
                }
                // What cannot be read in the midst of a film is a note of a run.
                Some(Err(error)) if self.kept.is_empty() => return Err(error.into()),
                Some(Err(_)) => {}
                None => self.count = self.kept.len().max(1),
            }
        }
        Ok(())
    }
}

/// Frames of a flight, the markers that were clicked in them, and the colours that follow.
pub struct MarkerPicker {
    vehicle: Vehicle,
    reels: Vec<Reel>,
    picked: Vec<PickedMarker>,
}

impl MarkerPicker {
    /// The recordings of a session, none of their frames read yet, nothing clicked.
    ///
    /// # Errors
    /// A recording that cannot be opened. Cameras that are only flown live are left out.
    pub fn open(session: &Session) -> Result<Self, EngineError> {
        let filmed = session.cameras().iter().enumerate().filter(|(_, c)| !c.video.as_os_str().is_empty());
        let reels = filmed.map(|(k, camera)| Ok(Reel::of(camera.name.clone(), session.open_camera(k)?)));
        let reels = reels.collect::<Result<_, EngineError>>()?;
        Ok(Self { vehicle: session.vehicle.clone(), reels, picked: Vec::new() })
    }

    /// Names of the cameras, and how many frames of each can be chosen.
    pub fn cameras(&self) -> impl Iterator<Item = (&str, usize)> {
        self.reels.iter().map(|reel| (reel.camera.as_str(), reel.count))
    }

    /// What was clicked.
    pub fn picked(&self) -> &[PickedMarker] {
        &self.picked
    }

    /// Time stamp, ns, and image of a frame, the last one for places beyond it. None where it was not reached yet: each call reads on for about a
    /// second.
    ///
    /// # Errors
    /// A recording without a frame that can be read; [`MarkerPicker::time_read_s`] says how far it was read.
    pub fn frame(&mut self, camera: usize, place: usize) -> Result<Option<&(i64, Frame)>, EngineError> {
        let Some(reel) = self.reels.get_mut(camera) else { return Ok(None) };
        reel.read_towards(place)?;
        Ok(reel.kept.get(place.min(reel.count - 1)))
    }

    /// Time stamp of the last frame that was kept of a camera.
    pub fn time_read_s(&self, camera: usize) -> Option<f64> {
        self.reels.get(camera)?.kept.last().map(|(t_ns, _)| *t_ns as f64 * 1e-9)
    }

    /// Takes the ball about a pixel of a frame that was read for a marker, in place of the one before in that frame.
    ///
    /// # Errors
    /// [`PickError`].
    pub fn pick(
        &mut self,
        camera: usize,
        frame: usize,
        marker: usize,
        at: Vector2<f64>,
    ) -> Result<&PickedMarker, PickError> {
        let reel = self
            .reels
            .get(camera)
            .filter(|_| marker < self.vehicle.marker.len())
            .ok_or(PickError::Unknown)?;
        let (_, image) = reel.kept.get(frame).ok_or(PickError::Unknown)?;
        let name = || reel.camera.clone();
        let found = ball_at(image, at);
        let ball = found.ok_or_else(|| PickError::NoBall { camera: name(), u_px: at.x, v_px: at.y })?;
        let is_same = |p: &&PickedMarker| {
            (p.camera, p.frame) == (camera, frame) && p.marker != marker && is_one(&p.ball, &ball)
        };
        if let Some(other) = self.picked.iter().find(is_same) {
            let other = self.vehicle.marker[other.marker].name.clone();
            return Err(PickError::Taken { camera: name(), name: other });
        }
        self.forget(camera, frame, marker);
        self.picked.push(PickedMarker { camera, frame, marker, ball });
        self.picked.last().ok_or(PickError::Unknown)
    }

    /// Takes a click back.
    pub fn forget(&mut self, camera: usize, frame: usize, marker: usize) {
        self.picked.retain(|p| (p.camera, p.frame, p.marker) != (camera, frame, marker));
    }

    /// The vehicle with the colours that the frames have where its markers were clicked. Markers to which the file gives one
    /// colour keep one, unless their clicks differ by more than the detection needs to distinguish them.
    pub fn vehicle(&self) -> Vehicle {
        let mut groups: Vec<Vec<usize>> = Vec::new();
        for (k, marker) in self.vehicle.marker.iter().enumerate() {
            let Some(own) = self.clicked_color(&[k]) else { continue };
            let is_alike = |group: &&mut Vec<usize>| {
                self.vehicle.marker[group[0]].color == marker.color
                    && self.clicked_color(group).is_some_and(|color| !are_distinct(color, own))
            };
            match groups.iter_mut().find(is_alike) {
                Some(group) => group.push(k),
                None => groups.push(vec![k]),
            }
        }
        let mut vehicle = self.vehicle.clone();
        for (k, marker) in vehicle.marker.iter_mut().enumerate() {
            let mut shared = groups.iter().filter(|g| self.vehicle.marker[g[0]].color == marker.color);
            let own = groups.iter().find(|group| group.contains(&k));
            // One that was not clicked follows those of its colour where these have one.
            let group = own.or_else(|| shared.next().filter(|_| shared.next().is_none()));
            marker.color = group.and_then(|g| self.clicked_color(g)).unwrap_or(marker.color);
        }
        vehicle
    }

    fn clicked_color(&self, markers: &[usize]) -> Option<Color> {
        mean_color(self.picked.iter().filter(|p| markers.contains(&p.marker)).map(|p| p.ball.color))
    }

    /// What the detection finds in a frame that was read, by the colours of [`MarkerPicker::vehicle`]: each ball with the first
    /// marker of its colour.
    ///
    /// # Errors
    /// Colours that cannot be distinguished, or that are none; the markers are named.
    pub fn found(&self, camera: usize, frame: usize) -> Result<Vec<(usize, Detection)>, VisionError> {
        let image = self.reels.get(camera).and_then(|reel| reel.kept.get(frame));
        image.map_or(Ok(Vec::new()), |(_, image)| balls_of_markers(image, &self.vehicle()))
    }

    /// The clicks whose ball is not found in its frame as its marker by the colours of [`MarkerPicker::vehicle`], as that of
    /// another ball.
    ///
    /// # Errors
    /// As [`MarkerPicker::found`].
    pub fn missed(&self) -> Result<Vec<&PickedMarker>, VisionError> {
        let vehicle = self.vehicle();
        let mut missed = Vec::new();
        for place in self.frames_with_clicks() {
            let found = self.found(place.0, place.1)?;
            let is_found = |p: &&PickedMarker| {
                let color = vehicle.marker[p.marker].color;
                found.iter().any(|(m, ball)| vehicle.marker[*m].color == color && is_one(ball, &p.ball))
            };
            let own = self.picked.iter().filter(|p| (p.camera, p.frame) == place);
            missed.extend(own.filter(|p| !is_found(p)));
        }
        Ok(missed)
    }

    fn frames_with_clicks(&self) -> Vec<(usize, usize)> {
        let mut all: Vec<(usize, usize)> = self.picked.iter().map(|p| (p.camera, p.frame)).collect();
        all.sort_unstable();
        all.dedup();
        all
    }
}

/// Whether two detections of one frame are the same ball.
fn is_one(a: &Detection, b: &Detection) -> bool {
    (a.pixel - b.pixel).norm() < 0.5 * a.diameter_px.max(b.diameter_px)
}

/// Whether the detection distinguishes two colours.
fn are_distinct(a: Color, b: Color) -> bool {
    let ball = |color: Color| BallColor { name: color.to_string(), rgb: color.rgb() };
    Detector::new(&[ball(a), ball(b)]).is_ok()
}
