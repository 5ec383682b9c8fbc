//! Refusals of the steps from observations to motion, with reasons and remedies.

use crate::RatesRefusal;
use mavsight_geometry::GeometryError;
use thiserror::Error;

/// A calibration, a pose or a motion that the observations do not determine.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PoseError {
    /// One camera's control points do not make a camera.
    #[error("camera {camera}: {source}")]
    Calibration {
        /// The camera.
        camera: String,
        /// The reason.
        source: GeometryError,
    },
    /// A table whose columns differ in length.
    #[error(
        "camera {camera}: {points} control points but {given} values of {what}: give one for each point (0 where there is none)"
    )]
    ControlLengths {
        /// The camera.
        camera: String,
        /// Points given.
        points: usize,
        /// Which column.
        what: &'static str,
        /// Length of the column.
        given: usize,
    },
    /// A name that is no camera model's.
    #[error("{model:?} is no camera model: use one of {known}")]
    UnknownModel {
        /// The name.
        model: String,
        /// Names of the models.
        known: String,
    },
    /// Control points that contradict the others, which are too few to decide without them.
    #[error(
        "control point {suspects} does not agree with the others, and too few others remain to decide which is wrong: check its place, its colour and its name in the table, or add control points"
    )]
    SuspectControlPoints {
        /// Names.
        suspects: String,
    },
    /// Control points whose images and places in the table disagree.
    #[error(
        "camera {camera}: the control points miss by {rms_px:.1} px (at most {gate_px:.1} px is a calibration), {worst} most, by {worst_px:.1} px: check places and names in the table, and that the still shows this control frame"
    )]
    ControlMisfit {
        /// The camera.
        camera: String,
        /// Root mean square residual.
        rms_px: f64,
        /// The gate.
        gate_px: f64,
        /// The point that misses most.
        worst: String,
        /// Residual of that point.
        worst_px: f64,
    },
    /// No camera at all.
    #[error("the rig has {found} camera(s): a pose needs at least 1 and an accurate one at least 2")]
    NoCameras {
        /// Cameras given.
        found: usize,
    },
    /// Too few control balls were found by colour.
    #[error(
        "{found} of {wanted} control balls have a candidate, but a camera needs at least 6; without one: {missing}"
    )]
    TooFewControlBalls {
        /// Balls with a candidate.
        found: usize,
        /// Balls in the table.
        wanted: usize,
        /// Those without.
        missing: String,
    },
    /// No assignment of candidates to control balls looks like one camera.
    #[error(
        "the candidates of the control balls fit no camera: the best choice agrees on {agreeing} of {found} balls within {gate_px:.1} px and disagrees on {disagreeing}; check their colours and positions in the table"
    )]
    InconsistentControlBalls {
        /// Balls that agree with the best camera.
        agreeing: usize,
        /// Balls with a candidate.
        found: usize,
        /// Names of those that do not.
        disagreeing: String,
        /// The gate.
        gate_px: f64,
    },
    /// An observation of a camera or marker that does not exist, or not finite.
    #[error("observation of marker {marker} by camera {camera} cannot be used: {reason}")]
    BadObservation {
        /// Camera index.
        camera: usize,
        /// Marker index.
        marker: usize,
        /// The reason.
        reason: &'static str,
    },
    /// The cameras that see the body take no part.
    #[error(
        "{cameras} cameras see the aircraft, and all of them are left out, as what they see contradicts: a camera was moved, or its clock or \
         delay changed; calibrate again, or begin the flight again"
    )]
    AllLeftOut {
        /// How many.
        cameras: usize,
    },
    /// Too few markers were observed.
    #[error(
        "{seen} of {markers} markers seen ({observations} observations in all): a pose needs 3, all of them in one camera or each in two"
    )]
    TooFewMarkers {
        /// Markers seen.
        seen: usize,
        /// Markers of the body.
        markers: usize,
        /// Observations in all.
        observations: usize,
    },
    /// The observed markers do not fit the body.
    #[error(
        "the markers seen do not fit the body: residual {residual_px:.2} px, {times:.0} times what their noise explains; check the markers' positions in the vehicle file"
    )]
    NotRigid {
        /// Root mean square residual.
        residual_px: f64,
        /// Root of the reduced chi-square.
        times: f64,
    },
    /// More than one pose explains the observations.
    #[error(
        "{poses} poses explain the {markers} markers seen (chi-square {chi_square:.1} and {next_chi_square:.1}) and no previous pose decides: add a second camera, or a marker off the plane of the others"
    )]
    AmbiguousPose {
        /// Poses about as likely as the best.
        poses: usize,
        /// Markers seen.
        markers: usize,
        /// Chi-square of the best.
        chi_square: f64,
        /// Chi-square of the next.
        next_chi_square: f64,
    },
    /// Markers of one colour whose arrangement looks the same after a turn.
    #[error(
        "the markers {markers} have one colour and change places when the body is turned, so that no image determines its attitude: move one of them by more than {needed_mm:.1} mm, so that all distances differ, or paint one in another colour"
    )]
    SymmetricMarkers {
        /// Names.
        markers: String,
        /// Shift that exceeds the errors of the markers' places.
        needed_mm: f64,
    },
    /// Balls that make a body no likelier than chance does.
    #[error(
        "{balls} balls of the markers' colours are seen, but odds of e^{log_odds:.1} that they are the body's are too low for a pose (e^{needed:.1} needed): show three markers to two cameras, or four to one"
    )]
    UnconvincingPose {
        /// Balls seen by all cameras.
        balls: usize,
        /// Logarithm of the odds of the best assignment.
        log_odds: f64,
        /// Least that is believed.
        needed: f64,
    },
    /// Two assignments of balls to markers that are about as likely.
    #[error(
        "{balls} balls of the markers' colours fit the body in two ways, the better one likelier by only e^{lead:.1}: cover objects of a marker's colour in the room, or place the markers less symmetrically"
    )]
    AmbiguousIdentity {
        /// Balls seen by all cameras.
        balls: usize,
        /// Logarithm of the odds between the two.
        lead: f64,
    },
    /// A pose that no aircraft reaches from the ones before.
    #[error(
        "the balls near the predicted markers give a pose {times:.1} standard deviations from the prediction of the previous poses: they are not all the body's"
    )]
    UnlikelyPose {
        /// Root of the mean square.
        times: f64,
    },
    /// An image is repeated that may be of another time: it contradicts another camera, or none sees the moving body anew.
    #[error(
        "{repeated} of {cameras} camera(s) repeat an image that may be of another time, and too few see the aircraft anew: check the cable, the bandwidth and the driver of those in whose images the balls stand still"
    )]
    RepeatedImage {
        /// Cameras that repeat an image.
        repeated: usize,
        /// Cameras that see a ball.
        cameras: usize,
    },
    /// What was seen says nothing of the attitude about an axis.
    #[error(
        "what was seen leaves the attitude unknown about an axis (standard deviation {std_deg:.0}°): show more markers, or let another camera see them"
    )]
    AttitudeUnknown {
        /// Largest standard deviation of a turn, about any axis.
        std_deg: f64,
    },
    /// What was seen is not the body that is described, or may as well be another.
    #[error("what was seen is not decidedly the body of the vehicle file ({0}): correct the file")]
    AnotherBody(&'static str),
    /// Recordings are exchanged between cameras, mirrored or turned.
    #[error(
        "the cameras' images are exchanged, mirrored or turned: correct the session file and start again"
    )]
    MixedUp,
    /// The uncertainty of the markers' positions does not belong to these markers.
    #[error(
        "the uncertainty of the markers has {rows} rows or is not finite: give 3 rows a marker, {needed} in all"
    )]
    MarkerUncertainty {
        /// Rows given.
        rows: usize,
        /// Rows needed.
        needed: usize,
    },
    /// A standard deviation of the centres that is negative or not finite.
    #[error("the centres' standard deviation of {std_px} px must be zero or above")]
    BadBias {
        /// The value given.
        std_px: f64,
    },
    /// A prior standard deviation of the markers that is not above zero.
    #[error(
        "the markers' standard deviation of {std_m} m is not above zero: a ruler is good to 0.001 or 0.002"
    )]
    BadPrior {
        /// The value given.
        std_m: f64,
    },
    /// A wand or board whose points make no shape.
    #[error("the {object} cannot calibrate: {detail}")]
    BadObject {
        /// Name.
        object: String,
        /// The reason.
        detail: &'static str,
    },
    /// A camera that no moved object links to the others.
    #[error(
        "camera {camera} shares {places} places of the {objects} with the other cameras: it needs {needed}, with both balls or four corners seen by two cameras; move the {objects} where two cameras see it at once, or give each camera five control points"
    )]
    NotLinked {
        /// The camera.
        camera: String,
        /// The objects.
        objects: String,
        /// Places shared.
        places: usize,
        /// Places needed.
        needed: usize,
    },
    /// A camera with too few control points, whose place the other cameras do not determine either.
    #[error(
        "camera {camera} sees {points} control points of the {needed} that it needs by itself, and {places} places of the {objects} that two other cameras see too, which do not determine it: fly through its view where two others look on, or turn it so that it sees {needed} control points"
    )]
    FewControlPoints {
        /// The camera.
        camera: String,
        /// Control points in its view.
        points: usize,
        /// The objects.
        objects: String,
        /// Places that it shares with two other cameras.
        places: usize,
        /// Control points that it needs.
        needed: usize,
    },
    /// Control points that do not fix the world's axes.
    #[error(
        "{found} control points are seen by two cameras and not on one line: the world's axes need {needed}; survey more of them, or leave all out and have the axes of the first camera"
    )]
    WorldAxes {
        /// Points that two cameras see.
        found: usize,
        /// Points needed.
        needed: usize,
    },
    /// A moved object whose images disagree with its stated shape.
    #[error(
        "camera {camera}: the residuals of the {objects} are {rms_px:.1} px (at most {gate_px:.1} px is a calibration): check its length or squares, its colours, and that the recordings run in step"
    )]
    ObjectMisfit {
        /// The camera.
        camera: String,
        /// The objects.
        objects: String,
        /// Root mean square residual.
        rms_px: f64,
        /// The gate.
        gate_px: f64,
    },
    /// Views of an object that leave a focal length undetermined.
    #[error(
        "camera {camera}: {places} views of the {objects} determine the focal length to {percent:.0} % only: its tilts differ by {tilt_deg:.0}° at most and it covers {covered_percent:.0} % of the image; add views tilted by 30° or more about both axes and near the corners of the image"
    )]
    FocalUndetermined {
        /// The camera.
        camera: String,
        /// Standard deviation of the focal length.
        percent: f64,
        /// The objects.
        objects: String,
        /// Views.
        places: usize,
        /// Largest angle between two attitudes.
        tilt_deg: f64,
        /// Part of the image around all views of the object.
        covered_percent: f64,
    },
    /// A flight of so many frames has refined the cameras already.
    #[error(
        "{0} frames of a flight have refined the cameras already, and their information must not count twice: calibrate again from the control points"
    )]
    AlreadyRefined(usize),
    /// The flight determines the body's shape no better than the ruler did.
    #[error(
        "the flight determines the markers' positions to {:.1} mm only, no better than the {:.1} mm of the vehicle file: the aircraft turned by {:.0}° and centres may have a constant error of {systematic_px:.2} px; turn it further, or keep the positions of the file",
        1e3 * .std_m, 1e3 * .prior_std_m, .turned_rad.to_degrees()
    )]
    ShapeNotShown {
        /// Standard deviation after the flight, root mean square over the directions of the shape.
        std_m: f64,
        /// Standard deviation of the vehicle file.
        prior_std_m: f64,
        /// Largest angle between two attitudes.
        turned_rad: f64,
        /// Of the systematic errors of centres.
        systematic_px: f64,
    },
    /// A pose that is not known, as one read from a table.
    #[error("not measured")]
    NotMeasured,
    /// A time at which the table of poses has no row.
    #[error("the row is missing")]
    MissingRow,
    /// The iteration found no minimum.
    #[error("the pose did not converge in {steps} steps: residual {residual_px:.2} px")]
    NotConverged {
        /// Steps taken.
        steps: usize,
        /// Root mean square residual.
        residual_px: f64,
    },
    /// A geometric degeneracy within one instant.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// Too short a flight for a motion.
    #[error("{measured} measured poses of {samples}: the smoother needs at least {needed}")]
    TooFewPoses {
        /// Poses with an estimate.
        measured: usize,
        /// Samples in all.
        samples: usize,
        /// Poses needed.
        needed: usize,
    },
    /// Rates of a gyroscope that the smoother cannot use.
    #[error(transparent)]
    Rates(#[from] RatesRefusal),
    /// Time must increase.
    #[error("sample {index} at {t_s:.6} s does not come after the one before it: sort the poses by time")]
    TimeNotIncreasing {
        /// Row.
        index: usize,
        /// Time of the row.
        t_s: f64,
    },
    /// A pose, covariance or constant that is not usable.
    #[error(
        "{what} at sample {index} is not usable (not finite, or a covariance that is not positive definite): correct that sample, or leave it out"
    )]
    BadPose {
        /// Row.
        index: usize,
        /// The quantity.
        what: &'static str,
    },
}
