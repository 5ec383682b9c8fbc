//! Cameras and body from what was tracked: their refinement, and ball diameters.

use crate::PipelineError;
use crate::markers::{MARKERS_STD_M, body_markers};
use crate::poses::poses_again;
use crate::tracked::Tracked;
use mavsight_flight::Vehicle;
use mavsight_geometry::{Camera, Isometry3, Point3};
use mavsight_pose::{
    BodyMarker, FlightPrior, HeldOut, PoseError, PoseEstimator, RefinedFlight, Rig, hold_out, refine_flight,
};
use serde::{Deserialize, Serialize};

/// Refinement of cameras and markers from the flight itself.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Refinement {
    /// Whether the cameras are refined; they are wherever the markers are. Left out: where seconds of the flight that
    /// the refinement has not seen fit the refined cameras better.
    pub rig: Option<bool>,
    /// Standard deviation of each coordinate in the vehicle file: a ruler is good to 0.001 or 0.002. Left
    /// out: the markers are as in the file.
    pub markers_std_m: Option<f64>,
    /// Whether the balls' diameters are measured too, from their images.
    #[serde(default)]
    pub diameters: bool,
}

impl Refinement {
    /// Whether it asks for a refinement, whatever held-out observations say.
    pub fn is_asked_for(&self) -> bool {
        self.rig == Some(true) || self.markers_std_m.is_some()
    }
}

/// A ball's diameter from its images.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Diameter {
    /// The diameter.
    pub diameter_m: f64,
    /// Its standard deviation; none where no ball was seen by two cameras.
    pub std_m: Option<f64>,
}

/// Cameras and body as a flight has shown them.
#[derive(Debug, Clone, PartialEq)]
pub struct RefinedBody {
    /// Cameras, markers and systematic errors of centres, with their uncertainties.
    pub refined: RefinedFlight,
    /// What decided for the refinement; none where it was asked for.
    pub held_out: Option<HeldOut>,
    /// Why the markers are those of the file although they were to be refined.
    pub kept: Option<PoseError>,
    /// Diameters, by marker: empty where they were not asked for, `None` for a ball that no pose used.
    pub diameters: Vec<Option<Diameter>>,
}

/// Refines the cameras, and if asked the marker positions and the diameters, from what was tracked;
/// estimates the poses again with them. Markers that are not asked for count as known to half a millimetre
/// while the cameras are refined, and as exact for the poses, as they do without a refinement. `None` where the session
/// does not ask for it, and held-out seconds of the flight do not either.
///
/// # Errors
/// Too few frames with a pose, or a standard deviation that is not above zero; the poses are then as before.
pub fn refine(
    tracked: &mut Tracked,
    rig: &Rig,
    vehicle: &Vehicle,
    how: Refinement,
) -> Result<Option<RefinedBody>, PipelineError> {
    let failed = |source| PipelineError::Pose { place: "the flight's refinement".into(), source };
    let mut body = body_markers(vehicle);
    let diameters = if how.diameters { diameters(tracked, rig, &body) } else { Vec::new() };
    for (marker, diameter) in body.iter_mut().zip(&diameters) {
        marker.radius_m = diameter.map_or(marker.radius_m, |d| d.diameter_m / 2.0);
    }
    let markers_std_m = how.markers_std_m.unwrap_or(MARKERS_STD_M);
    let prior = FlightPrior { markers_std_m, centres_std_px: None };
    let mut held_out = None;
    if !how.is_asked_for() {
        let may = how.rig.is_none() && rig.frames == 0;
        let found = may.then(|| hold_out(&tracked.observations, rig, &body, prior).ok()).flatten();
        held_out = found.filter(HeldOut::knows_more);
        if held_out.is_none() {
            return Ok(None);
        }
    }
    let refined = refine_flight(&tracked.observations, rig, &body, prior).map_err(failed)?;
    let kept = how.markers_std_m.and_then(|_| refined.shape_is_shown().err());
    let is_new = how.markers_std_m.is_some() && kept.is_none();
    let markers = (!is_new).then_some(body.as_slice());
    let estimator = PoseEstimator::refined(&refined, markers).map_err(failed)?;
    poses_again(estimator, tracked).map_err(failed)?;
    Ok(Some(RefinedBody { refined, held_out, kept, diameters }))
}

/// Diameters from those of the images and the poses' distances: the mean over cameras of each camera's
/// mean. What a camera's blur and light do to a rim is the same in all its frames, so that the cameras'
/// disagreement is the standard deviation.
fn diameters(tracked: &Tracked, rig: &Rig, body: &[BodyMarker]) -> Vec<Option<Diameter>> {
    let mut sums = vec![vec![(0.0, 0.0); rig.cameras.len()]; body.len()];
    let mut poses = tracked.poses.iter();
    let mut pose = poses.next();
    for (seen, diameter_px) in tracked.observations.iter().zip(&tracked.diameters_px) {
        while pose.is_some_and(|p| p.t_ns < seen.t_ns) {
            pose = poses.next();
        }
        let estimate = pose.filter(|p| p.t_ns == seen.t_ns).and_then(|p| p.estimate.as_ref().ok());
        let Some(estimate) = estimate.filter(|e| e.markers_used.contains(seen.marker)) else { continue };
        let camera = &rig.cameras[seen.camera].camera;
        let marker = &body[seen.marker];
        if let Some(diameter_m) = of_image(camera, &estimate.world_from_body, marker, f64::from(*diameter_px))
        {
            let (sum, count) = &mut sums[seen.marker][seen.camera];
            *sum += diameter_m;
            *count += 1.0;
        }
    }
    means_of_cameras(&sums)
}

/// Diameter of a sphere whose image is as large as a disc of this diameter. Where its centre is seen under
/// an angle α to the optical axis, a small cone's image is enlarged in area by cos⁻³ α.
fn of_image(
    camera: &Camera,
    world_from_body: &Isometry3<f64>,
    marker: &BodyMarker,
    diameter_px: f64,
) -> Option<f64> {
    let centre = camera.cam_from_world * (world_from_body * Point3::from(marker.marker_in_body_m));
    let distance_m = centre.coords.norm();
    let cosine = centre.z / distance_m;
    let focal_px = (camera.intrinsics.fx_px * camera.intrinsics.fy_px).abs().sqrt();
    let diameter_m = 2.0 * distance_m * (0.5 * diameter_px * cosine.max(0.0).powf(1.5) / focal_px).sin();
    (diameter_m.is_finite() && diameter_m > 0.0).then_some(diameter_m)
}

/// Means over cameras of `(sum, count)` by marker and camera. The cameras' disagreement is pooled over all
/// balls: two cameras alone may agree by chance.
fn means_of_cameras(sums: &[Vec<(f64, f64)>]) -> Vec<Option<Diameter>> {
    let means: Vec<Vec<f64>> = sums
        .iter()
        .map(|cameras| cameras.iter().filter(|(_, n)| *n > 0.0).map(|(sum, n)| sum / n).collect())
        .collect();
    let mean = |of: &[f64]| of.iter().sum::<f64>() / of.len() as f64;
    let squares: f64 = means.iter().flat_map(|m| m.iter().map(|d| (d - mean(m)).powi(2))).sum();
    let freedom: usize = means.iter().map(|m| m.len().saturating_sub(1)).sum();
    let variance_m2 = (freedom > 0).then(|| squares / freedom as f64);
    let diameter = |m: &Vec<f64>| Diameter {
        diameter_m: mean(m),
        std_m: variance_m2.map(|v| (v / m.len() as f64).sqrt()),
    };
    means.iter().map(|m| (!m.is_empty()).then(|| diameter(m))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::{ImageSize, Intrinsics, Vector3};

    #[test]
    fn a_sphere_has_the_diameter_that_its_outline_has() {
        let size = ImageSize { width_px: 640, height_px: 480 };
        let k = Intrinsics::from_horizontal_fov(size, 60f64.to_radians());
        let camera = Camera::looking_at(Vector3::new(0.0, -3.0, 0.0), Vector3::zeros(), k, size);
        let marker =
            |radius_m| BodyMarker { name: String::new(), marker_in_body_m: Vector3::zeros(), radius_m };
        for (at, radius_m) in [([0.0, 0.0, 0.0], 0.03), ([1.0, 0.2, 0.4], 0.02)] {
            let pose = Isometry3::translation(at[0], at[1], at[2]);
            // The outline's area by projecting the circle of tangency.
            let line = Vector3::from(at) - camera.centre_in_world();
            let (d, along) = (line.norm(), line.normalize());
            let across = along.cross(&Vector3::z()).normalize();
            let up = along.cross(&across);
            let rim = radius_m * (1.0 - (radius_m / d).powi(2)).sqrt();
            let middle = camera.centre_in_world() + along * (d - radius_m * radius_m / d);
            let corners: Vec<_> = (0..360)
                .map(|deg| f64::from(deg).to_radians())
                .map(|a| camera.project(&(middle + (across * a.cos() + up * a.sin()) * rim)).unwrap().pixel)
                .collect();
            let area_px2 = (0..360)
                .map(|i| corners[i].x * corners[(i + 1) % 360].y - corners[(i + 1) % 360].x * corners[i].y)
                .sum::<f64>()
                .abs()
                / 2.0;
            let diameter_px = 2.0 * (area_px2 / std::f64::consts::PI).sqrt();
            let got = of_image(&camera, &pose, &marker(radius_m), diameter_px).unwrap();
            assert!((got / (2.0 * radius_m) - 1.0).abs() < 1e-3, "{got} against {}", 2.0 * radius_m);
        }
    }

    #[test]
    fn cameras_that_disagree_are_the_standard_deviation() {
        let [a, b, unseen] = means_of_cameras(&[
            vec![(0.5, 10.0), (1.08, 20.0)],
            vec![(0.5, 10.0), (0.5, 10.0)],
            vec![(0.0, 0.0), (0.0, 0.0)],
        ])[..] else {
            panic!("three balls");
        };
        let (a, b) = (a.unwrap(), b.unwrap());
        assert!((a.diameter_m - 0.052).abs() < 1e-12 && (b.diameter_m - 0.05).abs() < 1e-12);
        // Deviations of 2 mm twice, two degrees of freedom, two cameras.
        assert!((a.std_m.unwrap() - 0.002 / 2f64.sqrt()).abs() < 1e-12 && a.std_m == b.std_m);
        assert_eq!(unseen, None);
        assert_eq!(means_of_cameras(&[vec![(0.5, 10.0), (0.0, 0.0)]])[0].unwrap().std_m, None);
    }
}
