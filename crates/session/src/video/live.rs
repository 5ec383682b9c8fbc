//! A running camera, by the ffmpeg program with as little delay as it can do.

use super::ffmpeg::{Listener, Process, start};
use super::y4m::{Piece, Y4mFrames};
use crate::SessionError;
use mavsight_vision::{Frame, Pixels};
use std::io::BufReader;
use std::path::PathBuf;
use std::process::{Child, ChildStdout, Command};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Stamps further than this from the system's clock are not by it: no camera is so late.
const MOST_APART_NS: i64 = 60_000_000_000;

/// Looks whether a program has ended whose pictures have: it has only its last words to say then, even on a busy computer.
const MOMENTS: usize = 25;
const MOMENT: Duration = Duration::from_millis(20);

/// What a camera's `live = "…"` asks ffmpeg for. A text that begins with a dash is its options and input, to
/// which is only added that Video4Linux shall stamp by the system's clock; anything else is the input, whose
/// kind follows from its name: `/dev/video…` is Video4Linux, `rtsp://` goes by TCP.
fn input_arguments(live: &str) -> Vec<String> {
    let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
    if live.starts_with('-') {
        let mut all = words(live);
        if !all.iter().any(|w| w == "-i") {
            all.insert(all.len().saturating_sub(1), "-i".into());
        }
        let is_v4l2 = all.windows(2).any(|w| w[0] == "-f" && matches!(&*w[1], "v4l2" | "video4linux2"));
        if is_v4l2 && !all.iter().any(|w| w == "-ts" || w == "-timestamps") {
            all.splice(0..0, words("-ts abs"));
        }
        return all;
    }
    let mut all = if live.starts_with("/dev/video") {
        // The driver's stamps are nearer to the exposure than the arrival of the data.
        words("-f v4l2 -ts abs")
    } else if live.starts_with("rtsp://") {
        words("-use_wallclock_as_timestamps 1 -rtsp_transport tcp")
    } else {
        words("-use_wallclock_as_timestamps 1")
    };
    all.extend(["-i".to_owned(), live.to_owned()]);
    all
}

/// A camera that ffmpeg reads while it runs.
pub struct LiveVideo {
    place: PathBuf,
    child: Arc<Mutex<Child>>,
    /// The program's pictures, before their header has come.
    stdout: Option<ChildStdout>,
    frames: Option<Y4mFrames<BufReader<ChildStdout>>>,
    listener: Listener,
    /// Whether the first stamp has been held against the system's clock.
    is_checked: bool,
    /// Whether it was ended by its stopper.
    is_stopped: Arc<AtomicBool>,
}

impl LiveVideo {
    /// Starts the program on what a camera's `live` names; whether it can open that shows itself with the
    /// first frame.
    ///
    /// # Errors
    /// A program that cannot be started.
    pub fn open(live: &str, program: &str) -> Result<Self, SessionError> {
        let place = PathBuf::from(live);
        let mut command = Command::new(program);
        command
            .args(["-hide_banner", "-nostdin", "-nostats", "-loglevel", "info"])
            .args(["-fflags", "nobuffer", "-flags", "low_delay"])
            .args(["-probesize", "500000", "-analyzeduration", "0", "-threads", "1"])
            .args(input_arguments(live))
            .args(["-map", "0:v:0", "-an", "-sn", "-copyts", "-fps_mode", "passthrough"])
            .args(["-vf", "showinfo=checksum=0,format=pix_fmts=yuv420p|yuvj420p", "-flush_packets", "1"])
            .args(["-strict", "-1", "-f", "yuv4mpegpipe", "pipe:1"]);
        let Process { child, stdout, stderr } = start(command, &place, "a running camera is read by it")?;
        let (child, listener) = (Arc::new(Mutex::new(child)), Listener::new(stderr));
        let is_stopped = Arc::default();
        Ok(Self { place, child, stdout: Some(stdout), frames: None, listener, is_checked: false, is_stopped })
    }

    /// What ends the program from another thread, so that a read that waits for it returns.
    pub fn stopper(&self) -> impl Fn() + Send + Sync + 'static {
        let (child, is_stopped) = (Arc::clone(&self.child), Arc::clone(&self.is_stopped));
        move || {
            is_stopped.store(true, Ordering::Relaxed);
            stop(&child);
        }
    }

    /// Waits for the next frame: its time by the system's clock, nanoseconds of the UNIX epoch.
    ///
    /// # Errors
    /// The end: [`SessionError::Ended`] where ffmpeg found nothing wrong, [`SessionError::Silent`] of one that its
    /// stopper ended, and otherwise ffmpeg's last words.
    pub fn next_frame(&mut self) -> Result<(i64, Arc<Frame>), SessionError> {
        if let Some(stdout) = self.stdout.take() {
            // Without a header the reason is among the program's words.
            self.frames = Y4mFrames::new(BufReader::with_capacity(1 << 20, stdout)).ok();
        }
        let piece = self.frames.as_mut().map(Y4mFrames::piece);
        let (Some(Piece::Frame(_, mut frame)), Ok(shown)) = (piece, self.listener.shown.recv()) else {
            return Err(self.end());
        };
        if let Pixels::Yuv420 { matrix, .. } = &mut frame.pixels {
            *matrix = shown.matrix;
        }
        let t_ns = shown.t_ns.ok_or_else(|| self.failed("its frames have no time stamps".into()))?;
        if !std::mem::replace(&mut self.is_checked, true) {
            self.check_clock(t_ns)?;
        }
        Ok((t_ns, Arc::new(frame)))
    }

    /// Why there are no more pictures.
    fn end(&self) -> SessionError {
        // The program and the thread that listens to it may be a moment behind the end of the pictures.
        let mut status = None;
        for _ in 0..MOMENTS {
            std::thread::sleep(MOMENT);
            status = self.child.lock().unwrap_or_else(PoisonError::into_inner).try_wait().ok().flatten();
            if status.is_some() {
                break;
            }
        }
        // What the program said before it was ended here is no reason.
        if self.is_stopped.load(Ordering::Relaxed) {
            return SessionError::Silent { place: self.place.clone() };
        }
        let last = self.listener.words().last();
        if last.is_empty() || status.is_some_and(|s| s.success()) {
            return SessionError::Ended { place: self.place.clone() };
        }
        self.failed(last)
    }

    fn check_clock(&self, t_ns: i64) -> Result<(), SessionError> {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let now_ns = i64::try_from(since.as_nanos()).unwrap_or(i64::MAX);
        let apart_ns = now_ns.saturating_sub(t_ns);
        if apart_ns.saturating_abs() <= MOST_APART_NS {
            return Ok(());
        }
        Err(self.failed(format!(
            "its time stamps are {:.0} s off this computer's clock: put `-use_wallclock_as_timestamps 1` (of Video4Linux `-ts abs`) \
             before the input",
            apart_ns as f64 * 1e-9
        )))
    }

    fn failed(&self, detail: String) -> SessionError {
        SessionError::ffmpeg(&self.place, detail)
    }
}

impl Drop for LiveVideo {
    fn drop(&mut self) {
        stop(&self.child);
    }
}

fn stop(child: &Mutex<Child>) {
    let mut child = child.lock().unwrap_or_else(PoisonError::into_inner);
    // A program that has ended already cannot be killed: nothing is left to do then.
    drop(child.kill());
    drop(child.wait());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_input_follows_from_the_name() {
        let joined = |live: &str| input_arguments(live).join(" ");
        assert_eq!(joined("/dev/video2"), "-f v4l2 -ts abs -i /dev/video2");
        assert!(joined("rtsp://cam/1").ends_with("-rtsp_transport tcp -i rtsp://cam/1"));
        assert_eq!(
            joined("-f v4l2 -framerate 60 /dev/video0"),
            "-ts abs -f v4l2 -framerate 60 -i /dev/video0"
        );
        assert_eq!(joined("-f v4l2 -ts mono2abs /dev/video0"), "-f v4l2 -ts mono2abs -i /dev/video0");
        assert_eq!(joined("-f lavfi -i testsrc"), "-f lavfi -i testsrc");
    }

    /// A source that ffmpeg makes itself, at the rate of its own clock.
    #[test]
    fn frames_come_with_the_systems_time() {
        let program = super::super::ffmpeg::program();
        if Command::new(&program).arg("-version").output().is_err() {
            println!("skipped: no ffmpeg");
            return;
        }
        let live = "-use_wallclock_as_timestamps 1 -f lavfi -i testsrc=size=64x48:rate=50,realtime";
        let mut video = LiveVideo::open(live, &program).unwrap();
        let (first_ns, frame) = video.next_frame().unwrap();
        assert_eq!((frame.size.width_px, frame.size.height_px, frame.check().is_ok()), (64, 48, true));
        let now_ns =
            std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap().as_nanos() as i64;
        // This source counts in fiftieths of a second.
        assert!((-20_000_000..5_000_000_000).contains(&(now_ns - first_ns)), "{first_ns} at {now_ns}");
        drop(frame);
        let stamps: Vec<i64> = (0..20).map(|_| video.next_frame().unwrap().0).collect();
        assert!(stamps.windows(2).all(|w| w[1] >= w[0]), "{stamps:?}");
        assert!((200_000_000..4_000_000_000).contains(&(stamps[19] - stamps[0])), "{stamps:?}");
        let stopper = video.stopper();
        std::thread::spawn(move || {
            std::thread::sleep(std::time::Duration::from_millis(50));
            stopper();
        });
        let end = (0..1000).find_map(|_| video.next_frame().err());
        // It was said that ffmpeg had failed, with what it says of any stream.
        assert!(matches!(end, Some(SessionError::Silent { .. })), "{end:?}");
        // What ended it was ffmpeg's statistics.
        let live = "-use_wallclock_as_timestamps 1 -f lavfi -i testsrc=size=64x48:rate=50:duration=0.2";
        let mut short = LiveVideo::open(live, &program).unwrap();
        let end = (0..1000).find_map(|_| short.next_frame().err());
        assert!(matches!(end, Some(SessionError::Ended { .. })), "{end:?}");
        let by_another =
            LiveVideo::open("-f lavfi -i testsrc=size=64x48:rate=50", &program).unwrap().next_frame();
        assert!(by_another.unwrap_err().to_string().contains("-use_wallclock_as_timestamps"));
        let refused = LiveVideo::open("/nowhere/at-all", &program).unwrap().next_frame().unwrap_err();
        assert!(refused.to_string().contains("No such file"), "{refused}");
        assert!(LiveVideo::open("x", "/no/such/ffmpeg").is_err());
    }
}
