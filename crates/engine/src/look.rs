//! What a recording shows of itself, before anything is known of the session.

use mavsight_geometry::ImageSize;
use mavsight_pipeline::{picture_edge_px, usual_interval_ns};
use mavsight_session::{FrameSource, SessionError};
use mavsight_vision::Frame;
use std::path::Path;

/// Frames that are looked at: enough for a median interval, few enough to be decoded at once.
const LOOKED_AT: usize = 9;

/// What a recording shows of itself.
#[derive(Debug, Clone, PartialEq)]
pub struct FilmLook {
    /// Size of its frames, the right way up.
    pub size: ImageSize,
    /// The first frame.
    pub first: Frame,
    /// Frames that it announces.
    pub frames: Option<usize>,
    /// Frames a second by the time stamps of the first ones; none of a single frame.
    pub rate_hz: Option<f64>,
    /// Standard deviation of the blur of the sharper edges, pixel included; none where edges are few.
    pub edge_px: Option<f64>,
    /// Mean sRGB code of the green channel, 0 to 255.
    pub brightness: f64,
}

/// Looks at the first frames of a recording.
///
/// # Errors
/// Those of [`FrameSource::open`], and of its first frame.
pub fn look_at(path: &Path) -> Result<FilmLook, SessionError> {
    let mut source = FrameSource::open(path, None)?;
    let (size, frames) = (source.size(), source.declared_frames());
    let mut times_ns = Vec::new();
    let mut first = None;
    for item in source.by_ref().take(LOOKED_AT) {
        match item {
            Ok((t_ns, frame)) => {
                first.get_or_insert(frame);
                times_ns.push(t_ns);
            }
            Err(error) if times_ns.is_empty() => return Err(error),
            Err(_) => {}
        }
    }
    let rate_hz = usual_interval_ns(times_ns).filter(|step| *step > 0).map(|step| 1e9 / step as f64);
    let first = first.ok_or_else(|| SessionError::NoFrames(path.to_owned()))?;
    let (edge_px, brightness) = (picture_edge_px(&first), mean_code(&first.to_rgb()));
    Ok(FilmLook { size, first, frames, rate_hz, edge_px, brightness })
}

fn mean_code(rgb: &[u8]) -> f64 {
    let greens = rgb.iter().skip(1).step_by(3);
    greens.clone().map(|code| f64::from(*code)).sum::<f64>() / greens.len().max(1) as f64
}

impl FilmLook {
    /// Length by the number of frames and their rate, s.
    pub fn length_s(&self) -> Option<f64> {
        Some(self.frames? as f64 / self.rate_hz?)
    }

    /// What was seen, in a line.
    pub fn words(&self) -> String {
        let mut words = format!("{}×{} px", self.size.width_px, self.size.height_px);
        if let Some(rate_hz) = self.rate_hz {
            words += &format!(", {rate_hz:.2} frames/s");
        }
        if let Some(length_s) = self.length_s() {
            words += &format!(", {length_s:.1} s");
        }
        if let Some(edge_px) = self.edge_px {
            words += &format!(", edges blurred by {edge_px:.1} px");
        }
        words + &format!(", mean brightness {:.0} of 255", self.brightness)
    }
}
