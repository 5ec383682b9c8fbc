//! Geometric problems without an answer, with reasons and remedies.

use thiserror::Error;

/// A geometric problem without a determined answer.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum GeometryError {
    /// Fewer control points than a camera has parameters for.
    #[error("{found} control points were seen, but a camera of 11 parameters needs at least {needed}: add {} more", needed - found)]
    TooFewControlPoints {
        /// Points given.
        found: usize,
        /// Points needed.
        needed: usize,
    },
    /// All control points lie on one plane.
    #[error(
        "control points are coplanar (smallest spread {spread_mm:.1} mm of {extent_m:.1} m): add one at least {needed_m:.1} m off the plane"
    )]
    CoplanarControlPoints {
        /// Root mean square distance from the best plane.
        spread_mm: f64,
        /// Largest extent of the points.
        extent_m: f64,
        /// A distance off the plane that would do.
        needed_m: f64,
    },
    /// The equations leave more than one camera possible.
    #[error(
        "control points do not determine the camera (condition {condition:.1e}): spread them through the volume and over the image"
    )]
    UndeterminedCamera {
        /// Ratio of the largest to the second smallest singular value of the normalised equations.
        condition: f64,
    },
    /// The fit needs a mirror.
    #[error(
        "the control points are seen as in a mirror: check that u grows to the right and v down, that the world is right handed and that no two points are swapped"
    )]
    MirroredImage,
    /// No camera sees points on both sides of its focal plane.
    #[error(
        "{behind} of {points} control points come to lie behind the camera: two of them are probably swapped or misplaced"
    )]
    PointsOnBothSides {
        /// Points behind.
        behind: usize,
        /// Points given.
        points: usize,
    },
    /// The world's origin has no image, so the eleven parameters, which are scaled to it, do not exist.
    #[error(
        "the world's origin lies in the focal plane of the camera (its depth is {relative_depth:.1e} of the control points'): shift the origin of the world into view"
    )]
    OriginInFocalPlane {
        /// Depth of the origin over that of the control points' centroid.
        relative_depth: f64,
    },
    /// A point behind the camera or in its focal plane has no image.
    #[error("the point lies behind the camera or in its focal plane (depth {depth_m:.3} m): it has no image")]
    BehindCamera {
        /// Depth along the optical axis.
        depth_m: f64,
    },
    /// One ray does not make a point.
    #[error("a point was seen by {found} camera(s), but triangulation needs at least 2")]
    TooFewRays {
        /// Rays given.
        found: usize,
    },
    /// The rays have no common base.
    #[error(
        "the rays are parallel to within {angle_deg:.4}°: move the cameras apart or turn them towards each other"
    )]
    ParallelRays {
        /// Largest angle between two of the rays.
        angle_deg: f64,
    },
    /// A rigid motion needs three points that are not on one line.
    #[error("{found} markers are not enough for a pose: at least 3 that are not on one line must be seen")]
    TooFewMarkers {
        /// Markers given.
        found: usize,
    },
    /// Three points on a line leave the turn about it open.
    #[error(
        "the markers lie on one line (spread across it {spread_mm:.2} mm): mount one at least 50 mm off the line"
    )]
    CollinearMarkers {
        /// Second singular value of the centred points, as a root mean square distance.
        spread_mm: f64,
    },
    /// A number that is not finite.
    #[error("{what} is not a finite number: correct the input")]
    NotFinite {
        /// The quantity.
        what: &'static str,
    },
    /// Errors so large that what they do to a result is no number any more.
    #[error(
        "the covariance of {what} is not finite in {coordinates} coordinate(s): a standard deviation of a centre, a camera or a marker is far beyond any measurement's; correct it"
    )]
    UnboundedCovariance {
        /// The result.
        what: &'static str,
        /// How many of its coordinates.
        coordinates: usize,
    },
    /// A point whose residuals have no least value near its rays.
    #[error(
        "the point still moves by {step_m:.3} m after {steps} steps of its triangulation: its rays do not meet; check that they \
         are of one point, and the calibration of the cameras"
    )]
    TriangulationDiverged {
        /// Length of the last step.
        step_m: f64,
        /// Steps.
        steps: usize,
    },
    /// Distortion so strong that the inverse does not converge.
    #[error(
        "the lens distortion cannot be undone at pixel ({u_px:.1}, {v_px:.1}): it lies outside the calibrated field"
    )]
    UndistortionDiverged {
        /// Pixel column.
        u_px: f64,
        /// Pixel row.
        v_px: f64,
    },
}
