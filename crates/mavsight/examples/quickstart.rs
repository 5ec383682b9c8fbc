#![doc = "From a session file to its parameters, stage by stage."]

use mavsight::engine::{self, Flight, Options};
use mavsight::pipeline::NoProgress;
use mavsight::session::{RunResults, Session};
use std::error::Error;
use std::path::Path;

/// Calibrates, tracks, estimates poses and motion, and identifies the parameters of a session.
pub(crate) fn quickstart(session_file: &Path) -> Result<RunResults, Box<dyn Error>> {
    let session = Session::load(session_file)?;

    // Calibrate: the cameras from stills of the control frame.
    let rig = engine::calibrate(&session, &NoProgress)?;
    for camera in &rig.cameras {
        println!("{}: {:.3} px", camera.name, camera.residual_rms_px);
    }

    // Track: balls in all videos, which marker each is, and one pose an instant.
    let flight = engine::track(&session, rig, &NoProgress)?;
    for pose in flight.tracked.poses.iter().filter_map(|p| p.estimate.as_ref().ok()).take(3) {
        println!("{:.3} m", pose.world_from_body.translation.vector);
    }

    // Identify: motion from the poses, coefficients and parameters from motion and inputs.
    let inputs = engine::recorded_inputs(&session)?;
    let asked = Flight::of_session(&session, inputs.as_ref(), &Options::default())?;
    let results = engine::solve(&asked, flight, None, &NoProgress)?;
    for fit in results.identification.iter().flat_map(|i| &i.fits) {
        println!("{}", fit.verdict);
    }
    Ok(results)
}

fn main() -> Result<(), Box<dyn Error>> {
    let session_file = std::env::args().nth(1).ok_or("name a session file")?;
    quickstart(Path::new(&session_file)).map(drop)
}
