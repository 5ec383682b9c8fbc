//! What to mend, with its cause and its harm.

use super::{CameraCheck, is_without_picture};
use crate::EngineError;
use mavsight_pipeline::{Cause, Finding, PipelineError};
use mavsight_session::SessionError;
use mavsight_vision::VisionError;

/// How harmful something is, the worst first: what lets nothing be measured, what makes poses wrong, what loses poses
/// or makes them worse, what one should know.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Harm {
    /// There is nothing to measure by.
    Stops,
    /// Poses would be wrong.
    Falsifies,
    /// Poses are lost, or less certain, for a reason that explains others further down.
    Weakens,
    /// The same, where it may follow from what stands above.
    Follows,
    /// To know.
    Remark,
}

/// Something to mend.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckItem {
    /// How harmful it is.
    pub harm: Harm,
    /// What explains it: one cause where the alternatives were tried and lost, several where these explain it alike.
    pub causes: Vec<Cause>,
    /// Index of the camera that it is about, where it is one.
    pub camera: Option<usize>,
    /// What was found, and the remedy.
    pub text: String,
    /// Whether it may be mended by pointing at balls in the pictures: of control points that were not found, or of markers
    /// whose colours may be others than the file says.
    pub by_click: bool,
}

impl CheckItem {
    /// An item without a cause.
    pub(super) fn of_note(text: String) -> Self {
        Self { harm: Harm::Weakens, causes: Vec::new(), camera: None, text, by_click: false }
    }

    /// An item with one cause.
    pub(super) fn of_cause(cause: Cause, camera: Option<usize>, text: String) -> Self {
        Self { harm: harm_of(cause), causes: vec![cause], camera, text, by_click: is_of_colors(cause) }
    }

    /// The cause, where it is one.
    pub fn cause(&self) -> Option<Cause> {
        match self.causes[..] {
            [cause] => Some(cause),
            _ => None,
        }
    }
}

/// How harmful a cause is.
fn harm_of(cause: Cause) -> Harm {
    match cause {
        Cause::NoPicture | Cause::BoardInverted | Cause::CamerasExchanged | Cause::ImageTurned => Harm::Stops,
        Cause::CameraDark => Harm::Stops,
        Cause::CameraMoved
        | Cause::CameraFrozen
        | Cause::ColorsExchanged
        | Cause::BodyAxes
        | Cause::WorldAxes
        | Cause::BodyScale
        | Cause::Mass
        | Cause::ClockOffset
        | Cause::ClockStep
        | Cause::CameraPaused
        | Cause::FrameRate => Harm::Falsifies,
        Cause::OutOfFocus
        | Cause::ExposureLong
        | Cause::MarkerColor
        | Cause::MarkerMissing
        | Cause::ControlOutside => Harm::Weakens,
        Cause::Decoy => Harm::Follows,
    }
}

/// Whether a cause is that colours are not those of the files, or may be.
fn is_of_colors(cause: Cause) -> bool {
    matches!(cause, Cause::MarkerColor | Cause::MarkerMissing | Cause::ColorsExchanged)
}

pub(super) fn of_finding(finding: &Finding) -> CheckItem {
    CheckItem {
        harm: finding.causes.iter().map(|c| harm_of(*c)).min().unwrap_or(Harm::Follows),
        causes: finding.causes.clone(),
        camera: finding.camera,
        by_click: finding.causes.iter().any(|c| is_of_colors(*c)),
        ..CheckItem::of_note(finding.note.clone())
    }
}

/// That a part of a film was looked at.
pub(super) fn of_part(camera: &CameraCheck) -> Option<CheckItem> {
    let announced = camera.announced.filter(|n| *n > camera.frames && camera.rate_hz > 0.0)?;
    let s = |frames: usize| frames as f64 / camera.rate_hz;
    let (looked_s, all_s) = (s(camera.frames), s(announced));
    let text = format!("{}: the first {looked_s:.1} s of {all_s:.1} s were looked at.", camera.name);
    Some(CheckItem { harm: Harm::Remark, ..CheckItem::of_note(text) })
}

/// That cameras are flown live, and that no markers were looked for.
pub(super) fn of_unfilmed(names: &[&str]) -> CheckItem {
    let text = format!(
        "{}: flown live, without a recording to look at: the calibration was looked at, and no markers were. They are looked for in the \
         flight (`mavsight live`).",
        names.join(", ")
    );
    CheckItem { harm: Harm::Remark, ..CheckItem::of_note(text) }
}

/// A recording that cannot be read.
pub(super) fn of_file(name: &str, camera: usize, error: &SessionError) -> CheckItem {
    let causes = if is_without_picture(error) { vec![Cause::NoPicture] } else { Vec::new() };
    CheckItem {
        harm: Harm::Stops,
        causes,
        camera: Some(camera),
        ..CheckItem::of_note(format!("{name}: {error}."))
    }
}

/// What a run would be refused with.
pub(super) fn of_error(error: &EngineError) -> CheckItem {
    let causes = match error {
        EngineError::Pipeline(PipelineError::MixedUp { causes, .. }) => causes.clone(),
        EngineError::File(source) | EngineError::Input(source) if is_without_picture(source) => {
            vec![Cause::NoPicture]
        }
        _ => Vec::new(),
    };
    let by_click = matches!(
        error,
        EngineError::BeforeFlight { .. }
            | EngineError::Pipeline(
                PipelineError::ControlBalls { .. }
                    | PipelineError::Vision {
                        source: VisionError::ColorsTooClose { .. } | VisionError::ColorTooGrey { .. },
                        ..
                    }
            )
    );
    CheckItem { harm: Harm::Stops, causes, by_click, ..CheckItem::of_note(format!("{error}.")) }
}
