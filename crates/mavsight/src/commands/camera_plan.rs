//! What a search for camera places has found, for terminal, tables and report.

use mavsight_plan::{Planner, Ranked, StudyRow};

/// What a search has found.
pub(crate) struct CameraPlan<'a> {
    pub(crate) planner: &'a Planner,
    pub(crate) ranked: &'a [Ranked],
    /// Against angle, and against distance; empty where not asked for.
    pub(crate) study: [Vec<StudyRow>; 2],
}

/// Angle between the optical axes of the first two cameras.
pub(crate) fn angle_deg(ranked: &Ranked) -> f64 {
    let axis = |k: usize| {
        let p = &ranked.placed[k];
        (p.aim_m - p.centre_m).normalize()
    };
    axis(0).dot(&axis(1)).clamp(-1.0, 1.0).acos().to_degrees()
}

/// The row of least error among those that meet all limits, or among all.
pub(crate) fn least(rows: &[StudyRow]) -> Option<&StudyRow> {
    let figure = |r: &&StudyRow| r.prediction.figure;
    let feasible = rows.iter().filter(|r| r.prediction.is_feasible());
    feasible.min_by(|a, b| figure(a).total_cmp(&figure(b)))
}
