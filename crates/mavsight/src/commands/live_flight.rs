//! A flight with its listeners, its page and its figures.

use super::live_links::add_links;
use crate::cli::Live;
use crate::out::out;
use anyhow::{Context, Result};
use mavsight_link::{CameraState, Event, Tracking};
use mavsight_live::{FlightSummary, Latencies, Listener, Recorder, Setup, fly};
use mavsight_pipeline::ControlPointRow;
use mavsight_pose::Rig;
use mavsight_session::{LiveSection, make_folder, write_json};
use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Exit status of a program that Ctrl-C has ended: 128 and the number of the signal.
const INTERRUPTED: i32 = 130;

pub(super) type Begin = Box<dyn Fn(&Path) -> Result<Recorder> + Send>;

/// Adds the listeners, flies, and reports; the page may calibrate from the control points `points`.
pub(super) fn fly_with(
    args: &Live,
    section: &LiveSection,
    points: Vec<ControlPointRow>,
    begin: Begin,
    mut setup: Setup<'_>,
) -> Result<()> {
    setup.listeners.waiting = args.fast;
    if args.json {
        setup.listeners.add(Box::new(Lines { stop: Arc::clone(&setup.stop) }))?;
    }
    setup.listeners.add(Box::new(Words::default()))?;
    add_links(&mut setup.listeners, setup.vehicle, section, args)?;
    #[cfg(feature = "page")]
    if let Some(address) = args.serve {
        super::live_page::add_page(address, points, begin, &mut setup)?;
    }
    #[cfg(not(feature = "page"))]
    drop((points, begin));
    let rig = setup.rig;
    end_at_interrupt(&setup.stop)?;
    let flown = fly(setup)?;
    finish(args, rig, &flown)
}

/// Ctrl-C ends the flight as its time does: with recording, results and figures. A second one ends the program at once.
fn end_at_interrupt(stop: &Arc<AtomicBool>) -> Result<()> {
    let stop = Arc::clone(stop);
    let handler = move || {
        if stop.swap(true, Ordering::Relaxed) {
            std::process::exit(INTERRUPTED);
        }
    };
    ctrlc::set_handler(handler).context("Ctrl-C cannot be handled")
}

struct Lines {
    stop: Arc<AtomicBool>,
}

impl Listener for Lines {
    fn event(&mut self, event: &Event) {
        let Ok(mut line) = serde_json::to_string(event) else { return };
        line.push('\n');
        // Nobody reads any more: the flight has ended.
        if std::io::stdout().lock().write_all(line.as_bytes()).is_err() {
            self.stop.store(true, Ordering::Relaxed);
        }
    }
}

/// Least time between two messages on the state of a camera that comes and goes.
const CALM: Duration = Duration::from_millis(900);

/// What a user should know, on standard error.
#[derive(Default)]
struct Words {
    names: Vec<String>,
    /// What was last said of each camera, and when.
    cameras: Vec<Option<(CameraState, Instant)>>,
    tracking: Option<Tracking>,
    enough: bool,
    fault: Option<String>,
}

impl Listener for Words {
    fn event(&mut self, event: &Event) {
        match event {
            Event::Scene(scene) => {
                self.names = scene.cameras.iter().map(|c| c.name.clone()).collect();
                self.cameras = vec![None; self.names.len()];
            }
            Event::Camera { camera, state, reason, .. } => {
                let Some(said) = self.cameras.get_mut(*camera) else { return };
                if said.is_some_and(|(last, at)| last == *state || at.elapsed() < CALM) {
                    return;
                }
                let why = reason.as_ref().map_or(String::new(), |r| format!(": {r}"));
                eprintln!("mavsight: {} is {}{why}", self.names[*camera], lower(state));
                *said = Some((*state, Instant::now()));
            }
            Event::Pose(pose) if self.tracking != Some(pose.tracking) => {
                eprintln!("mavsight: {:.3} s: {}", pose.t_s, lower(&pose.tracking));
                self.tracking = Some(pose.tracking);
            }
            Event::Note { t_s, text, .. } => eprintln!("mavsight: {t_s:.3} s: {text}"),
            Event::Parameters { t_s, enough, .. } if *enough && !self.enough => {
                eprintln!("mavsight: {t_s:.1} s: all parameters have been seen enough");
                self.enough = true;
            }
            Event::Recording { fault: Some(fault), .. } if self.fault.as_ref() != Some(fault) => {
                eprintln!("mavsight: recording: {fault}");
                self.fault = Some(fault.clone());
            }
            _ => {}
        }
    }
}

fn lower(of: &impl std::fmt::Debug) -> String {
    format!("{of:?}").to_lowercase()
}

/// Prints what became of the flight, and writes it where that was asked for.
fn finish(args: &Live, rig: &Rig, flown: &FlightSummary) -> Result<()> {
    let of = |l: &Latencies| serde_json::json!({"median_ms": l.quantile_ms(0.5), "p99_ms": l.quantile_ms(0.99), "most_ms": l.most_ms()});
    let frames = flown.frames.iter().zip(&flown.missing).zip(&flown.dropped);
    let cameras: Vec<_> = (rig.cameras.iter().zip(frames))
        .map(|(c, ((frames, missing), dropped))| {
            serde_json::json!({"name": c.name, "frames": frames, "missing": missing, "dropped": dropped})
        })
        .collect();
    let figures = serde_json::json!({
        "instants": flown.instants,
        "measured": flown.measured,
        "lost": flown.lost,
        "not_waited_for_a_camera": flown.not_waited,
        "cameras": cameras,
        "latency_to_pose": of(&flown.latency),
        "latency_of_tracking": of(&flown.tracking),
        "unheard": flown.unheard,
        "recording_fault": flown.recording_fault,
    });
    let (missing, dropped) = (flown.missing.iter().sum::<u64>(), flown.dropped.iter().sum::<u64>());
    let mut text = format!(
        "{} instants, {} with a pose, {} lost since the first; {missing} frames missing, {dropped} dropped\n",
        flown.instants, flown.measured, flown.lost,
    );
    // As fast as it goes frames wait for each other: how long has no meaning.
    let latency = format!(
        "From the last frame in hand to the pose: median {:.2} ms, 99 % {:.2} ms, at most {:.2} ms\n",
        flown.latency.quantile_ms(0.5),
        flown.latency.quantile_ms(0.99),
        flown.latency.most_ms(),
    );
    if !args.fast {
        text += &latency;
    }
    if args.json {
        eprint!("{text}");
    } else {
        out!("{text}");
    }
    if let Some(out) = &args.out {
        make_folder(out)?;
        write_json(&out.join("live.json"), &figures)?;
    }
    if let Some(fault) = &flown.recording_fault {
        anyhow::bail!("the recording is not whole: {fault}");
    }
    if flown.instants == 0 {
        anyhow::bail!("no camera has shown anything: what each lacks is said above");
    }
    if flown.measured == 0 {
        anyhow::bail!("none of {} instants has a pose", flown.instants);
    }
    Ok(())
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    /// A flight without `--for` ended without figures, and without the last frames of its recording.
    #[test]
    fn ctrl_c_ends_the_flight_and_not_the_program() {
        let stop = Arc::new(AtomicBool::new(false));
        end_at_interrupt(&stop).unwrap();
        let id = std::process::id().to_string();
        assert!(std::process::Command::new("kill").args(["-INT", &id]).status().unwrap().success());
        while !stop.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}
