//! Causes of faults that a film shows, as values: what a note names is read by programs too.

use std::fmt;

/// A kind of fault of cameras, recordings or files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Cause {
    /// A camera no longer stands as it was calibrated.
    CameraMoved,
    /// A camera repeats one image.
    CameraFrozen,
    /// A camera shows nothing.
    CameraDark,
    /// A camera is blurred, and the others are not.
    OutOfFocus,
    /// The vehicle file gives markers the colours of others.
    ColorsExchanged,
    /// The vehicle file's axes are not forward, right, down.
    BodyAxes,
    /// The world's z, as the control points give it, is not up.
    WorldAxes,
    /// The marker positions of the vehicle file are in another unit than metres.
    BodyScale,
    /// The mass of the vehicle file is in another unit than kilograms.
    Mass,
    /// A camera's clock is not what the session says of it.
    ClockOffset,
    /// A camera's clock was set to another time while it filmed.
    ClockStep,
    /// A camera paused and went on at other times than before.
    CameraPaused,
    /// A recording has another frame rate than its time stamps say.
    FrameRate,
    /// Recordings are given for each other's cameras.
    CamerasExchanged,
    /// A recording is mirrored or turned against the calibration.
    ImageTurned,
    /// Another object has a marker's colour.
    Decoy,
    /// A recording has sound and no picture.
    NoPicture,
    /// A camera exposes so long that balls that move are smeared.
    ExposureLong,
    /// The vehicle file gives a marker a colour that it does not have.
    MarkerColor,
    /// A marker of the vehicle file is not on the aircraft.
    MarkerMissing,
    /// A control point lies outside of a camera's image.
    ControlOutside,
    /// The board is printed with black and white exchanged.
    BoardInverted,
}

impl Cause {
    /// All of them.
    pub const ALL: [Self; 22] = [
        Self::CameraMoved,
        Self::CameraFrozen,
        Self::CameraDark,
        Self::OutOfFocus,
        Self::ColorsExchanged,
        Self::BodyAxes,
        Self::WorldAxes,
        Self::BodyScale,
        Self::Mass,
        Self::ClockOffset,
        Self::ClockStep,
        Self::CameraPaused,
        Self::FrameRate,
        Self::CamerasExchanged,
        Self::ImageTurned,
        Self::Decoy,
        Self::NoPicture,
        Self::ExposureLong,
        Self::MarkerColor,
        Self::MarkerMissing,
        Self::ControlOutside,
        Self::BoardInverted,
    ];

    /// The cause in a few words.
    pub fn words(self) -> &'static str {
        match self {
            Self::CameraMoved => "camera moved",
            Self::CameraFrozen => "camera frozen",
            Self::CameraDark => "camera dark",
            Self::OutOfFocus => "camera out of focus",
            Self::ColorsExchanged => "marker colours exchanged",
            Self::BodyAxes => "body axes turned",
            Self::WorldAxes => "world axes turned",
            Self::BodyScale => "marker positions in another unit",
            Self::Mass => "mass in another unit",
            Self::ClockOffset => "clock offset wrong",
            Self::ClockStep => "clock was set",
            Self::CameraPaused => "camera paused",
            Self::FrameRate => "frame rate wrong",
            Self::CamerasExchanged => "recordings exchanged",
            Self::ImageTurned => "image mirrored or turned",
            Self::Decoy => "decoy in view",
            Self::NoPicture => "no picture",
            Self::ExposureLong => "exposure too long",
            Self::MarkerColor => "marker colour wrong",
            Self::MarkerMissing => "marker missing",
            Self::ControlOutside => "control point outside of the image",
            Self::BoardInverted => "board inverted",
        }
    }
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.words())
    }
}

/// Something that is wrong, with what explains it.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// What explains it: one cause where all alternatives were tried and lost, several where these explain
    /// it alike, none where nothing that was tried does.
    pub causes: Vec<Cause>,
    /// Index of the camera that it is about, where it is one.
    pub camera: Option<usize>,
    /// What was found and what to do, for people.
    pub note: String,
}

impl Finding {
    /// A finding of one cause.
    pub fn of(cause: Cause, camera: Option<usize>, note: String) -> Self {
        Self { causes: vec![cause], camera, note }
    }

    /// The cause, where it is one.
    pub fn cause(&self) -> Option<Cause> {
        match self.causes[..] {
            [cause] => Some(cause),
            _ => None,
        }
    }
}
