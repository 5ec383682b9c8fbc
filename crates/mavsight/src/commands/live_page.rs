//! The browser page of a live flight.

use anyhow::{Context, Result};
use mavsight_link::{Event, PoseEvent, give_way};
use mavsight_live::{Listener, Recorder, RecorderSlot, Setup};
use mavsight_page::{Command, Limits, Reach, Server, encode_preview};
use mavsight_pipeline::{ControlPointRow, ControlStill, calibrate_from_stills};
use mavsight_session::write_rig;
use mavsight_vision::Frame;
use std::collections::BTreeMap;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::mpsc::sync_channel;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Where the page is when nobody says: on this machine.
const PORT: u16 = 8750;

/// Pictures that may wait to be encoded; more are not needed to be ten a second.
const WAITING: usize = 2;

type Latest = Arc<Mutex<BTreeMap<usize, Arc<Frame>>>>;

pub(super) fn add_page(
    address: Option<SocketAddr>,
    points: Vec<ControlPointRow>,
    begin: impl Fn(&Path) -> Result<Recorder> + Send + 'static,
    setup: &mut Setup<'_>,
) -> Result<()> {
    let address = address.unwrap_or_else(|| (Ipv4Addr::LOCALHOST, PORT).into());
    let reach = if address.ip().is_loopback() { Reach::Loopback } else { Reach::Network };
    let server = Arc::new(Server::start(address, reach, Limits::default())?);
    eprintln!("The page is at {}", server.url());
    let (out, pictures) = sync_channel::<(usize, i64, Arc<Frame>)>(WAITING);
    let sink = Arc::clone(&server);
    let encode = move || {
        give_way();
        for (camera, t_ns, frame) in pictures {
            let (size, of) = (frame.size, |x: usize, y: usize| frame.rgb(x, y));
            let (Ok(jpeg), Ok(camera)) =
                (encode_preview(size.width_px, size.height_px, of), u8::try_from(camera))
            else {
                continue;
            };
            sink.preview(camera, t_ns, &jpeg);
        }
    };
    std::thread::Builder::new().name("pictures".into()).spawn(encode)?;
    let (asked, frames) = (Arc::clone(&server), Latest::default());
    let kept = Arc::clone(&frames);
    setup.taps.push(Arc::new(move |camera, t_ns, frame, _| {
        locked(&kept).insert(camera, Arc::clone(frame));
        if asked.wants_preview(camera, t_ns) {
            // A picture that finds no room is not needed: the next is as good.
            let _ = out.try_send((camera, t_ns, Arc::clone(frame)));
        }
    }));
    let slot = Arc::clone(&setup.recorder);
    setup.listeners.add(Box::new(Page {
        server,
        slot,
        begin,
        points,
        frames,
        cameras: Vec::new(),
        latest: None,
    }))?;
    Ok(())
}

fn locked<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}

struct Page<B> {
    server: Arc<Server>,
    slot: Arc<RecorderSlot>,
    begin: B,
    points: Vec<ControlPointRow>,
    frames: Latest,
    /// Name of each camera, and what was last said of it.
    cameras: Vec<(String, Option<String>)>,
    latest: Option<Box<PoseEvent>>,
}

impl<B: Fn(&Path) -> Result<Recorder>> Page<B> {
    fn note(&self, fault: bool, text: String) {
        let t_s = self.latest.as_ref().map_or(0.0, |p| p.t_s);
        self.server.publish(&Event::Note { t_s, fault, text });
    }

    fn obey(&mut self) {
        while let Some(command) = self.server.next_command(Duration::ZERO) {
            match command {
                Command::StartRecording => self.start_recording(),
                Command::StopRecording => {
                    drop(self.slot.replace(None));
                    self.server.publish(&self.slot.event());
                }
                Command::SelfCheck => self.note(false, self.check()),
                Command::Calibrate => match self.calibrate() {
                    Ok(said) => self.note(false, said),
                    Err(error) => self.note(true, format!("{error:#}")),
                },
            }
        }
    }

    /// Into `flight-1`, `flight-2` and so on, beside where the program was started.
    fn start_recording(&self) {
        let unused = (1..).map(|k| PathBuf::from(format!("flight-{k}"))).find(|p| !p.exists());
        let Some(folder) = unused else { return };
        match (self.begin)(&folder) {
            Ok(recorder) => drop(self.slot.replace(Some(recorder))),
            Err(error) => self.note(true, format!("{error:#}")),
        }
        self.server.publish(&self.slot.event());
    }

    /// Calibrates from what the cameras show into a rig of its own: the flight keeps the cameras it has.
    fn calibrate(&self) -> Result<String> {
        if self.points.is_empty() {
            anyhow::bail!("The session has no control points to calibrate from: give it `[control]`.");
        }
        // A copy of the list, so that no camera waits for what takes seconds.
        let frames = locked(&self.frames).clone();
        let still = |(k, frame): (&usize, &Arc<Frame>)| {
            let camera = self.cameras.get(*k)?.0.clone();
            Some(ControlStill { camera, frame: Frame::clone(frame) })
        };
        let rig =
            calibrate_from_stills(&frames.iter().filter_map(still).collect::<Vec<_>>(), &self.points, &[])?;
        let unused = (1..).map(|k| PathBuf::from(format!("rig-{k}.toml"))).find(|p| !p.exists());
        let path = unused.context("all names rig-N.toml are taken")?;
        write_rig(&path, &rig)?;
        let file = path.display();
        Ok(format!(
            "The cameras are calibrated in {file}: the next flight has them by `[rig] file = \"{file}\"` in place of `[control]`."
        ))
    }

    fn check(&self) -> String {
        let cameras: Vec<String> = self
            .cameras
            .iter()
            .map(|(name, said)| format!("{name}: {}", said.as_deref().unwrap_or("nothing yet")))
            .collect();
        format!("{}; {}.", cameras.join("; "), pose_words(self.latest.as_deref()))
    }
}

/// How good a pose is; one without redundancy has no residual.
fn pose_words(pose: Option<&PoseEvent>) -> String {
    let Some(pose) = pose.filter(|p| p.valid) else { return "no pose".to_owned() };
    let residual =
        pose.residual_px.map_or_else(|| "no residual".to_owned(), |px| format!("residual {px:.2} px"));
    format!("{residual}, latency {:.1} ms", pose.latency_ms)
}

impl<B: Fn(&Path) -> Result<Recorder> + Send> Listener for Page<B> {
    fn event(&mut self, event: &Event) {
        match event {
            Event::Scene(scene) => {
                self.cameras = scene.cameras.iter().map(|c| (c.name.clone(), None)).collect();
            }
            Event::Pose(pose) => self.latest = Some(pose.clone()),
            Event::Camera { camera, rate_hz, missing, dropped, markers, .. } => {
                let least = markers.iter().copied().fold(1.0, f64::min);
                if let Some(own) = self.cameras.get_mut(*camera) {
                    own.1 = Some(format!(
                        "{rate_hz:.1} frames/s, {missing} missing, {dropped} dropped, each marker in {:.0} % or more of the frames",
                        100.0 * least
                    ));
                }
            }
            _ => {}
        }
        self.server.publish(event);
        self.obey();
    }

    fn flush(&mut self) {
        self.obey();
    }
}
