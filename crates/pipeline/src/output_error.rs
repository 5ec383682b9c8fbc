//! Output error on what was tracked.

use crate::{PipelineError, Progress, Stage};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_identify::output_error::{FlightFitOptions, FlightFits, Images};
use mavsight_pose::{BodyMarker, MarkerObservation, PoseSample, Rig};

/// Half a millimetre: what a ruler tells of a marker's place where nothing else is said.
pub const MARKERS_STD_M: f64 = 5e-4;

/// Fits the equations of motion to the poses and, where there are cameras, to the images of the markers.
///
/// `markers` are those of the vehicle file or of the flight, each coordinate known to `markers_std_m`.
///
/// # Errors
/// A vehicle that is not valid; what a fit refuses is a sentence in the result.
pub fn output_error_fits(
    vehicle: &Vehicle,
    inputs: &InputSeries,
    poses: &[PoseSample],
    seen: Option<(&Rig, &[BodyMarker], f64, &[MarkerObservation])>,
    options: &FlightFitOptions,
    progress: &dyn Progress,
) -> Result<FlightFits, PipelineError> {
    progress.begin(Stage::Identify, None);
    let images = seen.map(|(rig, markers, markers_std_m, observations)| Images {
        rig,
        markers,
        markers_std_m,
        observations,
    });
    Ok(FlightFits::of_flight(vehicle, inputs, poses, images, options)?)
}
