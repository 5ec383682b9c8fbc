//! What a session shows before it is run: whether all is ready, and what to mend first.
//!
//! Nothing is seen here by other means than in a run: the cameras are calibrated, and the frames tracked, by the same
//! calls. Where they refuse, or lose a marker, what may explain it is undone in the frames or in the files and the same
//! calls are made again; a cause is named if that mends it and nothing else does.

mod control;
mod film;
mod items;
mod markers;
mod smear;
mod trials;

pub use control::ControlBall;
pub(crate) use film::{Part, coded as coded_light};
pub use film::{Shot, Spot};
pub use items::{CheckItem, Harm};
pub use smear::Exposure;

use crate::calibration::{rig_of, sizes_of};
use crate::input_range::beyond_range;
use crate::{EngineError, camera_feeds};
use film::{Film, Seen, Tap};
use mavsight_flight::Vehicle;
use mavsight_geometry::ImageSize;
use mavsight_pipeline::{CameraFeed, Progress, Tracked};
use mavsight_pose::Rig;
use mavsight_session::{Session, SessionCamera, SessionError, read_image};
use mavsight_vision::Frame;

/// One camera before a run.
#[derive(Debug, Clone, Default)]
pub struct CameraCheck {
    /// Its name.
    pub name: String,
    /// Size of its frames; none where the recording cannot be read.
    pub size: Option<ImageSize>,
    /// The image of the control points, with those that were found and those that were not.
    pub still: Option<(Frame, Vec<ControlBall>)>,
    /// Some frames, with what was detected where and as what.
    pub shots: Vec<Shot>,
    /// Frames looked at.
    pub frames: usize,
    /// Frames that the recording announces.
    pub announced: Option<usize>,
    /// Frames a second, by the median interval of the time stamps.
    pub rate_hz: f64,
    /// The longest interval between two frames over the median one.
    pub longest_step: f64,
    /// Standard deviation of the blur of edges, pixel included: of the balls, or of the room where none is seen.
    pub edge_px: Option<f64>,
    /// Time of exposure by the smear of moving balls.
    pub exposure: Option<Exposure>,
    /// Its clock, in words.
    pub clock: String,
    /// Residual of the calibration.
    pub calibration_rms_px: Option<f64>,
    /// Share of the frames in which each marker was identified.
    pub seen: Vec<f64>,
}

/// A session before it is run.
#[derive(Debug, Clone, Default)]
pub struct SessionCheck {
    /// Its name.
    pub name: String,
    /// Names and nominal colours of the markers.
    pub markers: Vec<(String, [u8; 3])>,
    /// Its cameras.
    pub cameras: Vec<CameraCheck>,
    /// What to mend, the most harmful first.
    pub items: Vec<CheckItem>,
    /// Median standard deviation of a coordinate of the position, m, and of an angle, rad, of the poses that the frames
    /// gave; none without poses.
    pub pose_std: Option<(f64, f64)>,
    /// Instants with a pose, and all.
    pub instants: (usize, usize),
}

impl SessionCheck {
    /// Whether the films of a flight were looked at; of one that is only flown live, stills and calibration alone are.
    pub fn is_filmed(&self) -> bool {
        self.cameras.iter().any(|camera| camera.frames > 0)
    }

    /// Whether nothing has to be mended before the flight is run.
    pub fn is_ready(&self) -> bool {
        self.items.iter().all(|item| item.harm == Harm::Remark)
    }
}

/// Looks at a session. What is wrong with it is not an error but an item.
pub fn check(session: &Session, progress: &dyn Progress) -> SessionCheck {
    let mut out = SessionCheck {
        name: session.file.name.clone(),
        markers: session.vehicle.marker.iter().map(|m| (m.name.clone(), m.color.rgb())).collect(),
        cameras: session.cameras().iter().map(|c| camera(&c.name)).collect(),
        ..SessionCheck::default()
    };
    look_into(session, progress, &mut out);
    out.items.extend(of_tables(session));
    out.items.sort_by_key(|item| item.harm);
    out
}

/// What a run would refuse of the tables and the log that a session names, or say of the inputs.
fn of_tables(session: &Session) -> Vec<CheckItem> {
    let (inputs, ranges) = match session.inputs() {
        Ok(inputs) => (None, inputs.map_or_else(Vec::new, |own| beyond_range(&own, &session.vehicle.model))),
        Err(error) => (Some(error), Vec::new()),
    };
    let sensors = session.sensors().err();
    let log = inputs
        .is_none()
        .then(|| session.log_gyroscope().err().or_else(|| session.log_sensors().err()))
        .flatten();
    let errors = [inputs, sensors, log].into_iter().flatten();
    let errors = errors.map(|error| items::of_error(&EngineError::Input(error)));
    errors.chain(ranges.into_iter().map(|finding| CheckItem::of_note(finding.note))).collect()
}

fn camera(name: &str) -> CameraCheck {
    CameraCheck { name: name.to_owned(), ..CameraCheck::default() }
}

/// A second look is worth its time where it shows so many times the frames of the first.
const MORE: usize = 2;

/// Each step ends the look where it finds what the next cannot do without.
fn look_into(session: &Session, progress: &dyn Progress, out: &mut SessionCheck) {
    let unfilmed = unfilmed(session);
    for (k, own) in session.cameras().iter().enumerate() {
        if unfilmed.contains(&own.name.as_str()) {
            // A size that is not known is refused with the calibration.
            out.cameras[k].size = session.image_size(k).ok();
        } else {
            match session.open_camera(k) {
                Ok(source) => {
                    (out.cameras[k].size, out.cameras[k].announced) =
                        (Some(source.size()), source.declared_frames());
                }
                Err(error) => out.items.push(items::of_file(&own.name, k, &error)),
            }
        }
        if let Some(still) = &own.still
            && let Ok(frame) = read_image(still)
        {
            out.cameras[k].still = Some((frame, Vec::new()));
        }
    }
    if !out.items.is_empty() {
        return;
    }
    let rig = match rig_of(session, progress) {
        Ok(rig) => rig,
        Err(error) => {
            let explained = trials::of_calibration(session, &error, progress);
            out.items.push(explained.unwrap_or_else(|| items::of_error(&error)));
            return;
        }
    };
    for (camera, own) in out.cameras.iter_mut().zip(&rig.cameras) {
        camera.size.get_or_insert(own.camera.size);
        camera.calibration_rms_px = Some(own.residual_rms_px).filter(|rms| *rms > 0.0);
    }
    out.items.extend(rig.notes().map(|text| CheckItem { harm: Harm::Remark, ..CheckItem::of_note(text) }));
    out.items.extend(control::left_out(&rig));
    out.items.extend(control::look(session, &rig, &mut out.cameras));
    if let Err(error) = sizes_of(session, &rig) {
        let look = Look { session, rig: &rig, part: Part::First, progress };
        let turned = trials::turned_recording(&look);
        out.items.push(turned.unwrap_or_else(|| items::of_error(&EngineError::Input(error))));
        return;
    }
    if !unfilmed.is_empty() {
        out.items.push(items::of_unfilmed(&unfilmed));
        return;
    }
    look_at_films(session, &rig, progress, out);
}

/// Names of the cameras that are flown live and have no recording.
fn unfilmed(session: &Session) -> Vec<&str> {
    let is_unfilmed = |c: &&SessionCamera| c.live.is_some() && !c.is_recorded();
    session.cameras().iter().filter(is_unfilmed).map(|c| c.name.as_str()).collect()
}

/// Looks at the beginnings of the films, longer where something is to be mended.
fn look_at_films(session: &Session, rig: &Rig, progress: &dyn Progress, out: &mut SessionCheck) {
    let before = std::mem::take(out);
    for part in [Part::First, Part::Long] {
        let look = Look { session, rig, part, progress };
        *out = before.clone();
        match look.film(&session.vehicle, |_, feed| feed) {
            Ok(film) => of_film(&look, &film, out),
            Err(error) => out.items.push(items::of_error(&error)),
        }
        let shows_more = |c: &CameraCheck| {
            let longer = c.size.map_or(0, |size| Part::Long.frames(size));
            longer.min(c.announced.unwrap_or(longer)) >= MORE * c.frames
        };
        if out.items.is_empty() || !out.cameras.iter().any(shows_more) {
            break;
        }
    }
    out.items.extend(out.cameras.iter().filter_map(items::of_part));
}

/// A part of the films of a session whose cameras are calibrated.
struct Look<'a> {
    session: &'a Session,
    rig: &'a Rig,
    part: Part,
    progress: &'a dyn Progress,
}

impl Look<'_> {
    /// Tracks all cameras with a vehicle, each feed passed through a function, and keeps some frames.
    fn film(
        &self,
        vehicle: &Vehicle,
        through: impl Fn(usize, CameraFeed<'static>) -> CameraFeed<'static>,
    ) -> Result<Film, EngineError> {
        let cameras = &self.rig.cameras;
        let taps: Vec<Tap> = cameras.iter().map(|_| Tap::default()).collect();
        let feeds = camera_feeds(self.session)?.into_iter().zip(&taps).enumerate();
        let feeds = feeds
            .map(|(k, (feed, tap))| tap.tapped(through(k, self.part.of(feed, cameras[k].camera.size))))
            .collect();
        let mut seen = Vec::new();
        let tracked = mavsight_pipeline::track_with(feeds, self.rig, vehicle, self.progress, |instant| {
            let marker = |index: usize| {
                instant.association.pairs.iter().find(|(of, _)| *of == index).map(|(_, marker)| *marker)
            };
            seen.extend(instant.seen.iter().enumerate().map(|(k, d)| Seen {
                t_ns: instant.t_ns,
                detection: *d,
                marker: marker(k),
            }));
        })?;
        Ok(Film { tracked, seen, taps: taps.into_iter().map(Tap::finish).collect() })
    }
}

fn of_film(look: &Look<'_>, film: &Film, out: &mut SessionCheck) {
    let tracked = &film.tracked;
    for (k, camera) in out.cameras.iter_mut().enumerate() {
        let (Some(tap), Some(health)) = (film.taps.get(k), tracked.health.get(k)) else { continue };
        camera.shots = film.shots(k, &look.session.vehicle, look.rig);
        camera.frames = tap.stamps_ns.len();
        (camera.rate_hz, camera.longest_step) = tap.rate();
        camera.seen = health.markers.iter().map(|m| m.seen).collect();
        let sees_balls = camera.seen.iter().any(|s| *s > 0.0);
        camera.edge_px = if sees_balls { Some(health.edge_px) } else { health.room_edge_px };
        camera.exposure = smear::exposure(k, film);
        camera.clock = tracked.clocks.get(k).map_or_else(String::new, ToString::to_string);
    }
    (out.pose_std, out.instants) = pose_std(tracked);
    let explained: Vec<CheckItem> = tracked.findings.iter().map(items::of_finding).collect();
    out.items.extend(explained);
    out.items.extend(trials::dark_cameras(look, film));
    out.items.extend(smear::items(&out.cameras));
    out.items.extend(markers::never_seen(look, film));
    let remark = |note: &String| CheckItem { harm: Harm::Remark, ..CheckItem::of_note(note.clone()) };
    out.items.extend(tracked.notes.iter().map(remark));
    if out.instants.0 == 0 && out.is_ready() {
        let first = tracked.poses.iter().find_map(|p| p.estimate.as_ref().err()).map(ToString::to_string);
        let sees_all = out.cameras.iter().any(|c| c.seen.iter().all(|share| *share >= markers::SEEN));
        out.items.push(CheckItem {
            harm: Harm::Stops,
            by_click: !sees_all,
            ..CheckItem::of_note(format!("No instant has a pose: {}.", first.unwrap_or_default()))
        });
    }
}

/// Medians of the standard deviations of a coordinate and of an angle, and the instants with a pose among all.
fn pose_std(tracked: &Tracked) -> (Option<(f64, f64)>, (usize, usize)) {
    let root = |sum: f64| (sum / 3.0).max(0.0).sqrt();
    let mut stds: Vec<(f64, f64)> = tracked
        .poses
        .iter()
        .filter_map(|p| p.estimate.as_ref().ok())
        .map(|e| e.covariance())
        .map(|c| (root((0..3).map(|k| c[(k, k)]).sum()), root((3..6).map(|k| c[(k, k)]).sum())))
        .collect();
    let measured = stds.len();
    stds.sort_by(|a, b| a.0.total_cmp(&b.0));
    let middle = stds.get(measured / 2).map(|s| s.0);
    stds.sort_by(|a, b| a.1.total_cmp(&b.1));
    let angle = stds.get(measured / 2).map(|s| s.1);
    (middle.zip(angle), (measured, tracked.poses.len()))
}

/// That a file cannot be read.
pub(crate) fn is_without_picture(error: &SessionError) -> bool {
    matches!(error, SessionError::SoundAlone(_))
}
