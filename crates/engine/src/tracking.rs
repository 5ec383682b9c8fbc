//! What the cameras of a session saw of the aircraft.

use crate::{EngineError, camera_feeds};
use mavsight_flight::Vehicle;
use mavsight_pipeline::{PipelineError, Progress, RefinedBody, Tracked, refine};
use mavsight_pose::{BodyMarker, HeldOut, MarkerObservation, Observations, Rig};
use mavsight_session::{MarkerAsBuilt, RunResults, Session};

/// Cameras, markers and poses of a flight before it is smoothed.
#[derive(Debug, Clone)]
pub struct TrackedFlight {
    /// Cameras: as calibrated, or as refined from the flight.
    pub rig: Rig,
    /// Observations and poses.
    pub tracked: Tracked,
    /// Markers as refined from the flight; empty where they are those of the vehicle file.
    pub body: Vec<MarkerAsBuilt>,
}

/// Tracks the markers through all recordings of a session, associates them and estimates one pose an
/// instant. Where the session asks for it, cameras and markers are refined from the flight, and the cameras also where
/// held-out observations show that the flight knows them better; a note says so, or why they could not be.
///
/// # Errors
/// Recordings that cannot be read, and what [`mavsight_pipeline::track`] refuses.
pub fn track(session: &Session, rig: Rig, progress: &dyn Progress) -> Result<TrackedFlight, EngineError> {
    let mut tracked = mavsight_pipeline::track(camera_feeds(session)?, &rig, &session.vehicle, progress)?;
    tracked.notes.splice(0..0, rig.notes());
    let how = session.file.refine.unwrap_or_default();
    match refine(&mut tracked, &rig, &session.vehicle, how) {
        Ok(None) => Ok(TrackedFlight { rig, tracked, body: Vec::new() }),
        Ok(Some(refined)) => {
            tracked.notes.extend(refined.held_out.as_ref().map(of_held_out));
            let has_markers = how.markers_std_m.is_some() && refined.kept.is_none();
            let body = if has_markers { as_built(&refined) } else { Vec::new() };
            let note = refined.kept.map(|why| format!("The markers are those of the vehicle file: {why}."));
            tracked.notes.extend(note);
            Ok(TrackedFlight { rig: refined.refined.rig, tracked, body })
        }
        Err(PipelineError::Pose { source, .. }) => {
            tracked.notes.push(format!("Cameras and markers are not refined from the flight: {source}."));
            Ok(TrackedFlight { rig, tracked, body: Vec::new() })
        }
        Err(other) => Err(other.into()),
    }
}

fn of_held_out(HeldOut { seconds, gain, gain_std }: &HeldOut) -> String {
    format!(
        "The cameras are refined from the flight: its {seconds} seconds fit better where they were held out (chi-square falls by \
         {gain:.1} ± {gain_std:.1} in a second). To keep the calibration, set rig = false in [refine]."
    )
}

fn as_built(body: &RefinedBody) -> Vec<MarkerAsBuilt> {
    let row = |(k, marker): (usize, &BodyMarker)| MarkerAsBuilt {
        name: marker.name.clone(),
        position_m: marker.marker_in_body_m,
        position_std_m: body.refined.markers_std_m[k],
        diameter_m: 2.0 * marker.radius_m,
        diameter_std_m: body.diameters.get(k).copied().flatten().and_then(|d| d.std_m),
    };
    body.refined.markers.iter().enumerate().map(row).collect()
}

impl TrackedFlight {
    /// The results so far, with all observations and without motion and parameters.
    pub fn into_results(self, session: &str, vehicle: &Vehicle) -> RunResults {
        let (mut results, observations) = self.split(session, vehicle);
        results.markers = observations.iter().collect::<Vec<MarkerObservation>>();
        results
    }

    /// The results so far, and the observations, which are many.
    pub(crate) fn split(self, session: &str, vehicle: &Vehicle) -> (RunResults, Observations) {
        let Self { rig, tracked, body } = self;
        let centres = tracked.centre_quality();
        let results = RunResults {
            session: session.to_owned(),
            camera_names: rig.cameras.iter().map(|c| c.name.clone()).collect(),
            marker_names: vehicle.marker.iter().map(|m| m.name.clone()).collect(),
            rig: Some(rig),
            body,
            poses: tracked.poses,
            camera_clocks: tracked.clocks,
            camera_health: tracked.health,
            centres,
            notes: tracked.notes.into_iter().chain(tracked.findings.iter().map(|f| f.note.clone())).collect(),
            findings: tracked.findings,
            pictures: tracked.pictures,
            ..RunResults::default()
        };
        (results, tracked.observations)
    }
}
