//! A video of what was found in the pictures of a session's cameras.

use super::named;
use super::run::require_a_pose;
use crate::cli::{Overlay, WrongCall};
use crate::out::outln;
use crate::progress::Bars;
use anyhow::Result;
use mavsight_engine::camera_feeds;
use mavsight_pipeline::{CameraFeed, Frames, PipelineError, Progress, TimedFrame};
use mavsight_pose::CameraClock;
use mavsight_report::{FilmShot, OverlayFilm};
use mavsight_session::results::names;
use mavsight_session::{RunResults, Session, VideoWriter};
use std::iter::Peekable;

pub(crate) fn overlay(args: &Overlay) -> Result<()> {
    let session = named(Session::load(&args.session))?;
    if args.out.extension().is_none_or(|e| !e.eq_ignore_ascii_case("mp4")) {
        let message = format!("{}: the video is an MP4: let its name end in .mp4", args.out.display());
        return Err(WrongCall(message).into());
    }
    let bars = Bars::new();
    let rig = mavsight_engine::calibrate(&session, &bars)?;
    let tracked = mavsight_engine::track(&session, rig, &bars)?;
    let results = tracked.into_results(&session.file.name, &session.vehicle);
    require_a_pose(&results)?;
    let enlargement = args.enlarge.map(f64::from);
    let mut film = OverlayFilm::new(&session.vehicle, &results, enlargement)?;
    let mut reels = reels(camera_feeds(&session)?, &results);
    let announced = reels.first().and_then(|reel| reel.announced);
    bars.start("drawing", announced.map(|n| n as u64));
    let mut writer = VideoWriter::create(&args.out, film.size())?;
    let mut written = 0;
    while let Some(t_ns) = next_instant(&mut reels)? {
        bars.step();
        let shots: Vec<_> = reels.iter().map(Reel::shot).collect();
        let (from_s, to_s) = args.within.unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
        let t_s = t_ns as f64 * 1e-9;
        if t_s > to_s {
            break;
        }
        if t_s < from_s {
            film.pass(&shots);
            continue;
        }
        writer.push(t_ns, &film.draw(t_ns, &shots)?)?;
        written += 1;
    }
    bars.done();
    if written == 0 {
        let message =
            format!("{}: no frame lies in the part of the flight that is asked for", args.session.display());
        return Err(WrongCall(message).into());
    }
    writer.finish()?;
    outln!(
        "{written} frames of {} cameras, residuals and 95 % ellipses ×{}: {}",
        reels.len(),
        film.enlargement(),
        args.out.display()
    );
    let report = args.out.with_file_name(names::REPORT);
    if args.out.file_name().is_some_and(|name| name == names::FILM) && report.is_file() {
        outln!("{} plays it", report.display());
    }
    Ok(())
}

/// The frames of one camera, and the one that is shown.
struct Reel<'a> {
    frames: Peekable<Frames<'a>>,
    announced: Option<usize>,
    clock: CameraClock,
    readout: mavsight_geometry::Vector2<f64>,
    shown: Option<TimedFrame>,
}

fn reels<'a>(feeds: Vec<CameraFeed<'a>>, results: &RunResults) -> Vec<Reel<'a>> {
    let clock = |k: usize| results.camera_clocks.get(k).map_or_else(CameraClock::default, |c| c.clock);
    let reel = |(k, feed): (usize, CameraFeed<'a>)| Reel {
        frames: feed.frames.peekable(),
        announced: feed.announced,
        clock: clock(k),
        readout: feed.readout,
        shown: None,
    };
    feeds.into_iter().enumerate().map(reel).collect()
}

/// The time of the first camera's next frame by the common clock; the other cameras are taken on to the frames that are
/// nearest to it.
fn next_instant(reels: &mut [Reel<'_>]) -> Result<Option<i64>, PipelineError> {
    let Some((first, others)) = reels.split_first_mut() else { return Ok(None) };
    if !first.take_on() {
        return Ok(None);
    }
    let Some(t_ns) = first.shown.as_ref().map(|f| first.clock.time_ns(f.t_ns)) else { return Ok(None) };
    for other in others {
        let clock = other.clock;
        let apart_ns = |frame: &TimedFrame| (clock.time_ns(frame.t_ns) - t_ns).abs();
        loop {
            let nearer = match (other.frames.peek(), &other.shown) {
                (Some(Ok(next)), Some(shown)) => apart_ns(next) <= apart_ns(shown),
                (next, _) => next.is_some(),
            };
            if !nearer || !other.take_on() {
                break;
            }
        }
    }
    Ok(Some(t_ns))
}

impl Reel<'_> {
    /// Shows the next frame that can be read; false where there is none. A note of tracking names what cannot be read.
    fn take_on(&mut self) -> bool {
        match self.frames.find_map(Result::ok) {
            Some(frame) => {
                self.shown = Some(frame);
                true
            }
            None => false,
        }
    }

    fn shot(&self) -> Option<FilmShot<'_>> {
        let shown = self.shown.as_ref()?;
        Some(FilmShot { frame: &shown.frame, stamp_ns: shown.t_ns, readout: self.readout })
    }
}
