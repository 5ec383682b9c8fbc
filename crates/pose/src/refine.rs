//! Cameras, markers and centres as the flight itself shows them.

use crate::estimate::HUBER_MEAN;
use crate::moving::{Instant, Reduced, Shared};
use crate::{BodyMarker, Observations, PoseError, Rig};
use instants::instants_of;
use mavsight_geometry::camera_parameters::CENTRE;
use mavsight_geometry::{CAMERA_PARAMETERS, CameraChange, UnitQuaternion, Vector2, Vector3};
use nalgebra::{DMatrix, DVector};
use staying::{Staying, Stays};

mod instants;
mod staying;

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
    /// What stays of the centres' errors, as it was given or found.
    pub centres_std_px: f64,
    markers_prior_m: f64,
}

/// What is known before a flight tells more.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlightPrior {
    /// Standard deviation of each coordinate of the markers' positions: a ruler is good to 1 or 2 mm, to half a millimetre where it
    /// was read with care.
    pub markers_std_m: f64,
    /// Standard deviation of what stays of a centre's error, each coordinate of each marker in each camera by its own; 0 for none,
    /// `None` to find it from what of the residuals stays.
    pub centres_std_px: Option<f64>,
}

/// Part of a given variance of what stays that is taken to stay all the flight; the rest is anew in each second. The one would be too sure
/// of the cameras where the other is true.
const STAYS_ALL_THE_WHILE: f64 = 0.5;

/// Gauss-Newton steps; millimetres beside metres settle in three or four.
const MAX_STEPS: usize = 20;

/// A step shorter than this share of the parameters' own uncertainty ends the iteration.
const SETTLED: f64 = 1e-3;

/// Refines cameras, marker positions and the lasting errors of centres by one bundle adjustment of all of them and of the poses.
///
/// What is known before: the cameras by their covariance, which is what the control points have left, and [`FlightPrior`]. A centre
/// may be off in the same way in many frames, by light from one side or what is behind the ball: half of the variance of that is
/// taken to stay all the flight, the other half for a second, which bounds what many frames tell; where it is not given, both are found.
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
    if let Some(std_px) = centres_std_px.filter(|px| !(px.is_finite() && *px >= 0.0)) {
        return Err(PoseError::BadBias { std_px });
    }
    if rig.frames > 0 {
        return Err(PoseError::AlreadyRefined { frames: rig.frames });
    }
    let instants = instants_of(observations, rig, markers, markers_std_m)?;
    let mut shared = Shared::new(rig.cameras.iter().map(|c| c.camera).collect(), markers.to_vec());
    (shared.free_points, shared.free_offsets) = (true, true);
    let directions = directions(&shared, rig);
    let state = DVector::zeros(directions.ncols());
    let given_px2 = centres_std_px.unwrap_or(0.0).powi(2);
    let mut bundle = Bundle {
        rig,
        nominal: markers,
        markers_std_m,
        stays: Stays {
            all_the_while_px2: STAYS_ALL_THE_WHILE * given_px2,
            for_a_second_px2: (1.0 - STAYS_ALL_THE_WHILE) * given_px2,
        },
        directions,
        instants,
        shared,
        state,
        factor: f64::INFINITY,
    };
    let mut settled = bundle.settled()?;
    if centres_std_px.is_none() {
        bundle.stays = bundle.staying()?;
        settled = Settled { before: settled.before, ..bundle.settled()? };
    }
    bundle.finished(&settled)
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

struct Bundle<'a> {
    rig: &'a Rig,
    nominal: &'a [BodyMarker],
    markers_std_m: f64,
    stays: Stays,
    directions: DMatrix<f64>,
    /// By seconds.
    instants: Vec<Vec<Instant>>,
    shared: Shared,
    /// Along the directions.
    state: DVector<f64>,
    factor: f64,
}

/// Where a bundle came to rest.
struct Settled {
    /// Of the state.
    covariance: DMatrix<f64>,
    reduced: Reduced,
    /// Sum of the squared whitened residuals at first.
    before: f64,
}

impl Bundle<'_> {
    fn settled(&mut self) -> Result<Settled, PoseError> {
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
                return Ok(Settled { covariance, reduced, before: first });
            }
        }
        let reduced = self.reduced()?;
        Err(not_converged(&reduced))
    }

    /// The equations with all poses at their minima, and with what stays of the centres' errors for a second eliminated.
    fn reduced(&mut self) -> Result<Reduced, PoseError> {
        let mut out = Reduced::new(self.shared.rows());
        let first = self.shared.first_offset();
        let variance_px2 = self.stays.for_a_second_px2;
        let scale = if self.factor.is_finite() { self.factor } else { 1.0 };
        for k in 0..self.instants.len() {
            let mut own = self.of_second(k)?;
            if variance_px2 > 0.0 {
                own.eliminate_changes(first, scale / variance_px2).ok_or(not_converged(&own))?;
            }
            out.join(&own);
        }
        Ok(out)
    }

    /// Those of one second, with its poses at their minima.
    fn of_second(&mut self, second: usize) -> Result<Reduced, PoseError> {
        let mut own = Reduced::new(self.shared.rows());
        for instant in &mut self.instants[second] {
            let (shared, factor) = (&self.shared, self.factor);
            let settled = shared.settled(&instant.sights, &instant.world_from_body, factor);
            instant.world_from_body = settled.ok_or_else(|| not_converged(&own))?;
            let at = (instant.sights.as_slice(), &instant.world_from_body);
            own.add(shared, at, factor).ok_or_else(|| not_converged(&own))?;
        }
        Ok(own)
    }

    /// How much of the centres' errors stays, of a fit in which none was allowed for.
    fn staying(&mut self) -> Result<Stays, PoseError> {
        let seconds = (0..self.instants.len()).map(|k| self.of_second(k)).collect::<Result<Vec<_>, _>>()?;
        let sights = || self.instants.iter().flatten().flat_map(|i| &i.sights);
        let information = sights().map(|s| s.whitener.norm_squared() / 2.0).sum::<f64>();
        let staying = Staying {
            seconds,
            directions: &self.directions,
            state: &self.state,
            offsets: 2 * self.shared.offsets_px.len(),
            prior: self.prior_information(),
            factor: self.factor,
            claimed_px2: sights().count() as f64 / information,
        };
        Ok(staying.found())
    }

    /// Information on each direction before the flight.
    fn prior_information(&self) -> DVector<f64> {
        let (markers, offsets) = (3 * self.nominal.len(), 2 * self.shared.offsets_px.len());
        let from_offsets = self.state.len() - offsets;
        DVector::from_fn(self.state.len(), |k, _| match k {
            _ if k < from_offsets - markers => 1.0,
            _ if k < from_offsets => self.markers_std_m.powi(-2),
            // Exact centres are those that are off by a millionth of a pixel.
            _ => 1.0 / self.stays.all_the_while_px2.max(1e-12),
        })
    }

    /// State and covariance.
    fn solved(&self, reduced: &Reduced) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let mut information = self.directions.tr_mul(&reduced.normal) * &self.directions / self.factor;
        let pull = self.directions.tr_mul(&reduced.gradient) / self.factor + &information * &self.state;
        information.set_diagonal(&(information.diagonal() + self.prior_information()));
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

    fn finished(self, settled: &Settled) -> Result<RefinedFlight, PoseError> {
        let Settled { covariance, reduced, before } = settled;
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
            chi_square: (*before, reduced.squares),
            variance_factor: self.factor,
            frames: reduced.instants,
            markers_prior_m: self.markers_std_m,
            centres_std_px: self.stays.std_px(),
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
        if std_m < SHOWN * self.markers_prior_m {
            return Ok(());
        }
        let (prior_std_m, stays_px) = (self.markers_prior_m, self.centres_std_px);
        Err(PoseError::ShapeNotShown { std_m, prior_std_m, turned_rad: self.turned_rad, stays_px })
    }
}

/// A shape that is not known better than to this part of the file's standard deviation is not worth a change of the body.
const SHOWN: f64 = 0.9;

fn not_converged(reduced: &Reduced) -> PoseError {
    let residual_px = (reduced.squares / reduced.coordinates.max(1) as f64).sqrt();
    PoseError::NotConverged { steps: MAX_STEPS, residual_px }
}
