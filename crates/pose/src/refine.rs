//! Cameras, markers and centres as the flight itself shows them.

use crate::estimate::HUBER_MEAN;
use crate::moving::{Instant, PointSight, Reduced, Shared};
use crate::{BodyMarker, MarkerObservation, Observations, PoseError, PoseEstimator, Rig};
use mavsight_geometry::camera_parameters::CENTRE;
use mavsight_geometry::{CAMERA_PARAMETERS, CameraChange, UnitQuaternion, Vector2, Vector3};
use nalgebra::{DMatrix, DVector};

/// Cameras, marker positions and lasting errors of centres that a flight has told, with what it leaves open.
///
/// A film shows neither where the world's axes lie nor those of the body. The first stay where the control points have put them.
/// The markers are given in the body axes for which their displacements from the vehicle file have no common shift and no
/// common turn (Procrustes). If the ruler was off by σ in each coordinate, these axes are off from the file's true ones by about
/// σ/√n, for every pose alike; a comparison with poses in other axes has to allow for one constant motion of the body frame.
#[derive(Debug, Clone, PartialEq)]
pub struct RefinedFlight {
    /// The cameras, with what remains unknown of them.
    pub rig: Rig,
    /// The body with the refined positions.
    pub markers: Vec<BodyMarker>,
    /// By how much centres are off all the while, camera by camera, marker by marker.
    pub offsets_px: Vec<Vector2<f64>>,
    /// What remains unknown of all three together: 16 rows a camera, 3 a marker (body axes, m), 2 for each marker in each camera
    /// (camera by camera, px); each column one standard deviation along an independent direction.
    pub uncertainty: DMatrix<f64>,
    /// Standard deviation of each coordinate of each marker.
    pub markers_std_m: Vec<Vector3<f64>>,
    /// Largest angle between the attitudes of two frames.
    pub turned_rad: f64,
    /// Sum of the squared whitened residuals as it was, and with all that was refined.
    pub chi_square: (f64, f64),
    /// Estimated ratio of the residuals' variance to what the centres' covariances claim.
    pub variance_factor: f64,
    /// Instants that entered.
    pub frames: usize,
    prior: FlightPrior,
}

/// What is known before a flight tells more.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlightPrior {
    /// Standard deviation of each coordinate of the markers' positions: a ruler is good to 1 or 2 mm, to half a millimetre where it
    /// was read with care.
    pub markers_std_m: f64,
    /// Standard deviation of what stays of a centre's error, each coordinate of each marker in each camera by its own, as
    /// [`PoseEstimator::centre_bias_px`] finds it; 0 for none.
    pub centres_std_px: f64,
}

/// For so long an error of a centre stays at least: the lags over which [`PoseEstimator::centre_bias_px`] compares residuals.
const STAYS_NS: i64 = 1_000_000_000;

/// Part of the variance of what stays that is taken to stay all the flight; the rest is anew in each second. Residuals that are
/// compared over a second cannot tell them apart, and the one would be too sure of the cameras where the other is true.
const STAYS_ALL_THE_WHILE: f64 = 0.5;

/// Frames needed for what stays to rest on more than the noise of a few.
const NEEDED_FRAMES: usize = 10;

/// Frames that enter, spread over the flight: what is refined stays, and with noise a tenth of that of one frame it is what
/// the control points and the lasting errors leave open that counts.
const MOST_FRAMES: usize = 150;

/// Gauss-Newton steps; millimetres beside metres settle in three or four.
const MAX_STEPS: usize = 20;

/// A step shorter than this share of the parameters' own uncertainty ends the iteration.
const SETTLED: f64 = 1e-3;

/// Refines cameras, marker positions and the lasting errors of centres by one bundle adjustment of all of them and of the poses.
///
/// What is known before: the cameras by their covariance, which is what the control points have left, and [`FlightPrior`]. A centre
/// may be off in the same way in many frames, by light from one side or what is behind the ball: half of the variance of that is
/// taken to stay all the flight, the other half for a second, which bounds what many frames tell.
///
/// Sights are weighted by their covariances, with bounded influence (Huber 1981). The scale of their noise is estimated, as the
/// claimed covariances may be off.
///
/// # Errors
/// [`PoseError::BadPrior`]; [`PoseError::BadBias`]; [`PoseError::AlreadyRefined`]; [`PoseError::TooFewPoses`] with fewer than ten frames that have a pose and redundancy;
/// [`PoseError::BadObservation`]; [`PoseError::NotConverged`].
pub fn refine_flight(
    observations: &Observations,
    rig: &Rig,
    markers: &[BodyMarker],
    prior: FlightPrior,
) -> Result<RefinedFlight, PoseError> {
    let FlightPrior { markers_std_m, centres_std_px } = prior;
    if !(markers_std_m.is_finite() && markers_std_m > 0.0) {
        return Err(PoseError::BadPrior { std_m: markers_std_m });
    }
    if !(centres_std_px.is_finite() && centres_std_px >= 0.0) {
        return Err(PoseError::BadBias { std_px: centres_std_px });
    }
    if rig.frames > 0 {
        return Err(PoseError::AlreadyRefined { frames: rig.frames });
    }
    let instants = instants_of(observations, rig, markers, markers_std_m)?;
    let mut shared = Shared::new(rig.cameras.iter().map(|c| c.camera).collect(), markers.to_vec());
    (shared.free_points, shared.free_offsets) = (true, true);
    let directions = directions(&shared, rig);
    let state = DVector::zeros(directions.ncols());
    Bundle { rig, nominal: markers, prior, directions, instants, shared, state, factor: f64::INFINITY }
        .refined()
}

/// What each parameter changes: a column for each direction of the rig's uncertainty, then one a coordinate of each marker, then
/// one a coordinate of each centre.
fn directions(shared: &Shared, rig: &Rig) -> DMatrix<f64> {
    let (rows, first) = (shared.rows(), shared.first_point());
    let of_rig = if rig.uncertainty.nrows() == first { rig.uncertainty.ncols() } else { 0 };
    let mut out = DMatrix::zeros(rows, of_rig + rows - first);
    out.view_mut((0, 0), (first, of_rig)).copy_from(&rig.uncertainty.columns(0, of_rig));
    out.view_mut((first, of_rig), (rows - first, rows - first)).fill_with_identity();
    out
}

/// Frames with a pose and redundancy, spread over the flight, by the seconds through which errors of centres stay.
fn instants_of(
    observations: &Observations,
    rig: &Rig,
    markers: &[BodyMarker],
    markers_std_m: f64,
) -> Result<Vec<Vec<Instant>>, PoseError> {
    // The prior tells the estimator how far markers may be off before they count as false.
    let unsure = DMatrix::identity(3 * markers.len(), 3 * markers.len()) * markers_std_m;
    let estimator = PoseEstimator::new(rig, markers).with_marker_uncertainty(&unsure)?;
    let times_ns: Vec<i64> = observations.times_ns().collect();
    let (mut out, mut previous, mut measured) = (Vec::<Vec<Instant>>::new(), None, 0);
    let mut second = None;
    let tried = MOST_FRAMES.min(times_ns.len());
    let mut own = Vec::new();
    for t_ns in (0..tried).map(|k| times_ns[(2 * k + 1) * times_ns.len() / (2 * tried)]) {
        observations.at(t_ns, &mut own);
        let estimate = match estimator.estimate(t_ns, &own, previous.as_ref()) {
            Ok(estimate) => estimate,
            Err(bad @ PoseError::BadObservation { .. }) => return Err(bad),
            Err(_) => continue,
        };
        previous = Some(estimate.world_from_body);
        let whitened = |o: &MarkerObservation| {
            let whitener = o.covariance_px2.cholesky()?.l().try_inverse()?;
            Some(PointSight { camera: o.camera, point: o.marker, pixel: o.pixel, whitener })
        };
        let used = own.iter().filter(|o| estimate.markers_used.contains(o.marker));
        let sights: Vec<PointSight> = used.filter_map(whitened).collect();
        if sights.len() > 3 {
            let instant = Instant { sights, world_from_body: estimate.world_from_body };
            measured += 1;
            let own_second = Some((t_ns - times_ns[0]) / STAYS_NS);
            match out.last_mut().filter(|_| own_second == second) {
                Some(same) => same.push(instant),
                None => out.push(vec![instant]),
            }
            second = own_second;
        }
    }
    if measured < NEEDED_FRAMES {
        return Err(PoseError::TooFewPoses { measured, samples: tried, needed: NEEDED_FRAMES });
    }
    Ok(out)
}

struct Bundle<'a> {
    rig: &'a Rig,
    nominal: &'a [BodyMarker],
    prior: FlightPrior,
    directions: DMatrix<f64>,
    /// By seconds.
    instants: Vec<Vec<Instant>>,
    shared: Shared,
    /// Along the directions.
    state: DVector<f64>,
    factor: f64,
}

impl Bundle<'_> {
    fn refined(mut self) -> Result<RefinedFlight, PoseError> {
        let mut before = None;
        for _ in 0..MAX_STEPS {
            let reduced = self.reduced()?;
            let first = *before.get_or_insert(reduced.squares);
            let freedom = (reduced.coordinates - 6 * reduced.instants).max(1) as f64;
            // The first time no residual was bounded.
            let kept = if self.factor.is_finite() { HUBER_MEAN } else { 1.0 };
            self.factor = (reduced.weighted / (freedom * kept)).max(f64::MIN_POSITIVE);
            let (next, covariance) = self.solved(&reduced).ok_or(not_converged(&reduced))?;
            let step = &next - &self.state;
            let settled =
                step.iter().zip(covariance.diagonal().iter()).all(|(s, v)| s.abs() <= SETTLED * v.sqrt());
            self.state = next;
            self.move_shared();
            if settled {
                return self.finished(&covariance, &reduced, first);
            }
        }
        let reduced = self.reduced()?;
        Err(not_converged(&reduced))
    }

    /// The equations with all poses at their minima, and with what stays of the centres' errors for a second eliminated.
    fn reduced(&mut self) -> Result<Reduced, PoseError> {
        let mut out = Reduced::new(self.shared.rows());
        let first = self.shared.first_offset();
        let variance_px2 = (1.0 - STAYS_ALL_THE_WHILE) * self.prior.centres_std_px.powi(2);
        let scale = if self.factor.is_finite() { self.factor } else { 1.0 };
        for second in &mut self.instants {
            let mut own = Reduced::new(self.shared.rows());
            for instant in second {
                let (shared, factor) = (&self.shared, self.factor);
                let settled = shared.settled(&instant.sights, &instant.world_from_body, factor);
                instant.world_from_body = settled.ok_or_else(|| not_converged(&own))?;
                let at = (instant.sights.as_slice(), &instant.world_from_body);
                own.add(shared, at, factor).ok_or_else(|| not_converged(&own))?;
            }
            if variance_px2 > 0.0 {
                own.eliminate_changes(first, scale / variance_px2).ok_or(not_converged(&own))?;
            }
            out.join(&own);
        }
        Ok(out)
    }

    /// State and covariance.
    fn solved(&self, reduced: &Reduced) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let mut information = self.directions.tr_mul(&reduced.normal) * &self.directions / self.factor;
        let pull = self.directions.tr_mul(&reduced.gradient) / self.factor + &information * &self.state;
        let (markers, offsets) = (3 * self.nominal.len(), 2 * self.shared.offsets_px.len());
        let from_markers = self.state.len() - markers - offsets;
        let from_offsets = from_markers + markers;
        let offset_px2 = STAYS_ALL_THE_WHILE * self.prior.centres_std_px.powi(2);
        for k in 0..self.state.len() {
            information[(k, k)] += match k {
                _ if k < from_markers => 1.0,
                _ if k < from_offsets => self.prior.markers_std_m.powi(-2),
                // Exact centres are those that are off by a millionth of a pixel.
                _ => 1.0 / offset_px2.max(1e-12),
            };
        }
        let covariance = information.cholesky()?.inverse();
        Some((&covariance * pull, covariance))
    }

    fn move_shared(&mut self) {
        let change = &self.directions * &self.state;
        for (k, camera) in self.shared.cameras.iter_mut().enumerate() {
            let own: CameraChange =
                change.fixed_rows::<CAMERA_PARAMETERS>(CAMERA_PARAMETERS * k).into_owned();
            *camera = self.rig.cameras[k].camera.moved(&own);
        }
        let (first, offsets) = (self.shared.first_point(), self.shared.first_offset());
        for (k, marker) in self.shared.points.iter_mut().enumerate() {
            marker.marker_in_body_m =
                self.nominal[k].marker_in_body_m + change.fixed_rows::<3>(first + 3 * k);
        }
        for (k, offset) in self.shared.offsets_px.iter_mut().enumerate() {
            *offset = change.fixed_rows::<2>(offsets + 2 * k).into_owned();
        }
    }

    fn finished(
        self,
        covariance: &DMatrix<f64>,
        reduced: &Reduced,
        before: f64,
    ) -> Result<RefinedFlight, PoseError> {
        let factor = covariance.clone().cholesky().ok_or(not_converged(reduced))?.unpack();
        let mut uncertainty = &self.directions * factor;
        // Of the markers the shape: a common shift or turn is none of the film's.
        let (first, rows) = (self.shared.first_point(), 3 * self.nominal.len());
        let shape = DMatrix::identity(rows, rows) - self.rigid_motions();
        let of_shape = shape * uncertainty.rows(first, rows);
        uncertainty.rows_mut(first, rows).copy_from(&of_shape);
        let std_m = |m: usize| Vector3::from_fn(|axis, _| of_shape.row(3 * m + axis).norm());
        Ok(RefinedFlight {
            rig: self.refined_rig(&uncertainty),
            markers_std_m: (0..self.nominal.len()).map(std_m).collect(),
            uncertainty,
            turned_rad: self.turned_rad(),
            markers: self.shared.points,
            offsets_px: self.shared.offsets_px,
            chi_square: (before, reduced.squares),
            variance_factor: self.factor,
            frames: reduced.instants,
            prior: self.prior,
        })
    }

    fn refined_rig(&self, uncertainty: &DMatrix<f64>) -> Rig {
        let mut rig = self.rig.clone();
        rig.frames = self.instants.iter().map(Vec::len).sum();
        rig.uncertainty = uncertainty.rows(0, self.shared.first_point()).into_owned();
        for (k, own) in rig.cameras.iter_mut().enumerate() {
            let moved = self.shared.cameras[k];
            for point in &mut own.points {
                let place = &point.point_in_world_m;
                if let (Ok(was), Ok(is)) = (own.camera.project(place), moved.project(place)) {
                    point.residual_px += was.pixel - is.pixel;
                }
            }
            let used = || own.points.iter().filter(|p| p.used);
            let squares_px2: f64 = used().map(|p| p.residual_px.norm_squared()).sum();
            own.residual_rms_px = (squares_px2 / (2 * used().count().max(1)) as f64).sqrt();
            own.camera = moved;
            let centre = rig.uncertainty.fixed_rows::<3>(CAMERA_PARAMETERS * k + CENTRE);
            own.centre_cov_m2 = centre * centre.transpose();
            own.centre_std_m = own.centre_cov_m2.diagonal().map(f64::sqrt);
        }
        rig
    }

    /// Largest angle between the attitude of one frame and that of another, found from both ends: the frame farthest from the
    /// first, and the one farthest from that.
    fn turned_rad(&self) -> f64 {
        let turn = |i: &Instant| i.world_from_body.rotation;
        let farthest = |from: &UnitQuaternion<f64>| {
            self.instants
                .iter()
                .flatten()
                .map(|i| (turn(i).angle_to(from), turn(i)))
                .fold((0.0, *from), |a, b| if b.0 > a.0 { b } else { a })
        };
        self.instants.iter().flatten().next().map_or(0.0, |i| farthest(&farthest(&turn(i)).1).0)
    }

    /// Projector on the displacements that a motion of the whole body makes.
    fn rigid_motions(&self) -> DMatrix<f64> {
        let mut motions = DMatrix::zeros(3 * self.nominal.len(), 6);
        for (k, marker) in self.nominal.iter().enumerate() {
            motions.fixed_view_mut::<3, 3>(3 * k, 0).fill_with_identity();
            motions.fixed_view_mut::<3, 3>(3 * k, 3).copy_from(&-marker.marker_in_body_m.cross_matrix());
        }
        let basis = motions.qr().q();
        &basis * basis.transpose()
    }
}

impl RefinedFlight {
    /// Whether the flight shows the body's shape better than the vehicle file did. While the aircraft keeps its attitude, centres
    /// that are off look like markers elsewhere; where it turns, they do not.
    ///
    /// # Errors
    /// [`PoseError::ShapeNotShown`] for a flight that turns too little.
    pub fn shape_is_shown(&self) -> Result<(), PoseError> {
        // The ruler leaves its variance in each direction but the six of the whole body's motion.
        let free = (3 * self.markers.len()).saturating_sub(6).max(1) as f64;
        let left_m2: f64 = self.markers_std_m.iter().map(Vector3::norm_squared).sum();
        let std_m = (left_m2 / free).sqrt();
        if std_m < SHOWN * self.prior.markers_std_m {
            return Ok(());
        }
        let FlightPrior { markers_std_m: prior_std_m, centres_std_px: stays_px } = self.prior;
        Err(PoseError::ShapeNotShown { std_m, prior_std_m, turned_rad: self.turned_rad, stays_px })
    }
}

/// A shape that is not known better than to this part of the file's standard deviation is not worth a change of the body.
const SHOWN: f64 = 0.9;

fn not_converged(reduced: &Reduced) -> PoseError {
    let residual_px = (reduced.squares / reduced.coordinates.max(1) as f64).sqrt();
    PoseError::NotConverged { steps: MAX_STEPS, residual_px }
}
