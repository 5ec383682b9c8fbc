//! Faults of cameras and recordings, each with a time and a strength that are drawn.

use mavsight_geometry::Vector3;
use mavsight_pipeline::Cause;
use mavsight_random::Random;
use serde::Serialize;
use std::ops::Range;

/// A fault that happens in a flight of a campaign.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// Frames of a camera do not arrive, each by chance.
    FramesDropped,
    /// Frames of a camera show the one before them once more.
    FramesDuplicated,
    /// Frames arrive behind frames that were exposed after them.
    FramesLate,
    /// Neighbouring frames of a camera have exchanged their time stamps.
    FramesReordered,
    /// A camera's clock is set to another time.
    ClockStep,
    /// A camera delivers nothing any more.
    CameraDead,
    /// A camera delivers one image over and over.
    CameraFrozen,
    /// A camera is pushed.
    CameraBumped,
    /// Three balls remain to be seen.
    ThreeVisible,
    /// Two balls remain to be seen.
    TwoVisible,
    /// One ball remains to be seen.
    OneVisible,
    /// No ball remains to be seen.
    NoneVisible,
    /// The vehicle file gives two markers each other's colour.
    ColorsExchanged,
    /// A ball of a marker's colour and size is carried through the room.
    Decoy,
    /// Numbers of detections that are none, infinite, or no covariance.
    NotANumber,
}

impl Fault {
    /// All of them.
    pub const ALL: [Self; 15] = [
        Self::FramesDropped,
        Self::FramesDuplicated,
        Self::FramesLate,
        Self::FramesReordered,
        Self::ClockStep,
        Self::CameraDead,
        Self::CameraFrozen,
        Self::CameraBumped,
        Self::ThreeVisible,
        Self::TwoVisible,
        Self::OneVisible,
        Self::NoneVisible,
        Self::ColorsExchanged,
        Self::Decoy,
        Self::NotANumber,
    ];

    /// The fault in a few words.
    pub fn words(self) -> &'static str {
        match self {
            Self::FramesDropped => "frames dropped",
            Self::FramesDuplicated => "frames duplicated",
            Self::FramesLate => "frames late",
            Self::FramesReordered => "frames reordered",
            Self::ClockStep => "clock step",
            Self::CameraDead => "camera dead",
            Self::CameraFrozen => "camera frozen",
            Self::CameraBumped => "camera bumped",
            Self::ThreeVisible => "3 balls visible",
            Self::TwoVisible => "2 balls visible",
            Self::OneVisible => "1 ball visible",
            Self::NoneVisible => "0 balls visible",
            Self::ColorsExchanged => "colours exchanged",
            Self::Decoy => "decoy moves",
            Self::NotANumber => "not a number",
        }
    }

    /// What has to be said of it.
    pub fn expected(self) -> Expected {
        match self {
            Self::FramesDropped => Expected::Note("frame(s) are missing"),
            Self::FramesDuplicated => Expected::Note("repeat the one before"),
            Self::FramesLate => Expected::Note("with a time stamp not after that of the frame before"),
            Self::ClockStep => Expected::Cause(Cause::ClockStep),
            Self::CameraDead => Expected::Note("before the last camera"),
            Self::CameraFrozen => Expected::Cause(Cause::CameraFrozen),
            Self::CameraBumped => Expected::Cause(Cause::CameraMoved),
            Self::ColorsExchanged => Expected::Cause(Cause::ColorsExchanged),
            Self::Decoy => Expected::Cause(Cause::Decoy),
            Self::NotANumber => Expected::Note("not finite"),
            Self::FramesReordered
            | Self::ThreeVisible
            | Self::TwoVisible
            | Self::OneVisible
            | Self::NoneVisible => Expected::Nothing,
        }
    }

    /// How many balls remain to be seen, where it hides any.
    pub(crate) fn visible(self) -> Option<usize> {
        match self {
            Self::ThreeVisible => Some(3),
            Self::TwoVisible => Some(2),
            Self::OneVisible => Some(1),
            Self::NoneVisible => Some(0),
            _ => None,
        }
    }
}

/// What has to be said of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Expected {
    /// A finding of this cause, or of several with this one among them.
    Cause(Cause),
    /// A note with these words.
    Note(&'static str),
    /// Nothing: it is no fault of a camera or a file, or nothing shows it.
    Nothing,
}

/// A fault with its camera, its time and its strength.
#[derive(Debug, Clone)]
pub(crate) struct Injection {
    pub(crate) fault: Fault,
    pub(crate) camera: usize,
    /// Frames in which it is there.
    pub(crate) frames: Range<usize>,
    /// 0 is the weakest, 1 the strongest.
    pub(crate) strength: f64,
    /// One of two kinds of the fault, where there are two.
    pub(crate) is_other_kind: bool,
    /// A direction, for what has one.
    pub(crate) along: Vector3<f64>,
    /// Draws what differs from frame to frame.
    pub(crate) random: Random,
}

/// Shortest and longest time of what passes.
const PASSES_S: [f64; 2] = [0.2, 2.0];

impl Injection {
    /// Draws a fault of a flight of so many frames. It begins in the second to the seventh tenth of it.
    pub(crate) fn draw(
        fault: Fault,
        cameras: usize,
        (frames, rate_hz): (usize, f64),
        random: &mut Random,
    ) -> Self {
        let from = (random.between(0.1, 0.7) * frames as f64) as usize;
        let passes = (random.between(PASSES_S[0], PASSES_S[1]) * rate_hz).round() as usize;
        let strength = random.uniform();
        let is_other_kind = random.uniform() < 0.5;
        let camera = (random.uniform() * cameras as f64) as usize;
        let along = Vector3::from(random.normals()).normalize();
        let until = match fault {
            Fault::ClockStep | Fault::CameraDead | Fault::CameraBumped | Fault::CameraFrozen => frames,
            _ => (from + passes.max(2)).min(frames),
        };
        let range = match fault {
            // A file's fault is there from the beginning to the end.
            Fault::ColorsExchanged => 0..frames,
            _ => from..until,
        };
        // The first camera's clock is what others are compared with: it cannot be wrong.
        let camera =
            if fault == Fault::ClockStep { 1 + camera % (cameras - 1) } else { camera.min(cameras - 1) };
        let random = Random::new(random.next_u64(), 0);
        Self { fault, camera, frames: range, strength, is_other_kind, along, random }
    }

    /// A value from `low` to `high` by the strength, by equal factors.
    pub(crate) fn between(&self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.strength)
    }
}
