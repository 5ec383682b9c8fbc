//! Refinement of cameras, markers and systematic errors of centres by the flight itself.

use crate::moving::{Instant, Reduced, Shared};
use crate::reprojection::HUBER_MEAN;
use crate::{BodyMarker, Observations, PoseError, Rig};
use instants::instants_of;
use mavsight_geometry::camera_parameters::CENTRE;
use mavsight_geometry::{CAMERA_PARAMETERS, CameraChange, UnitQuaternion, Vector3};
use nalgebra::{DMatrix, DVector};
use systematic::{LinearFit, SystematicVariance};

mod flight;
mod held_out;
mod instants;
mod systematic;

pub use flight::{FlightPrior, RefinedFlight};
pub use held_out::{HeldOut, hold_out};

/// Constant part of a given systematic variance; all of it would make the cameras too certain.
const CONSTANT_SHARE: f64 = 0.5;

/// Gauss-Newton steps; millimetres in metres converge in three or four.
const MAX_STEPS: usize = 20;

/// A step shorter than this share of the parameters' own uncertainty ends the iteration.
const CONVERGED: f64 = 1e-3;

/// Refines cameras, marker positions and systematic errors of centres by one bundle adjustment of all of them
/// and of the poses (Triggs et al. 2000).
///
/// Priors are the covariance of the cameras and [`FlightPrior`]. Half of the variance of a centre's
/// systematic error is constant over the flight, the other half lasts a second, which bounds the information
/// of many frames; where it is not given, both are estimated. Observations are weighted by their covariances,
/// with bounded influence (Huber 1981), and the scale of their noise is estimated.
///
/// # Errors
/// [`PoseError::BadPrior`]; [`PoseError::BadBias`]; [`PoseError::AlreadyRefined`]; [`PoseError::TooFewPoses`]
/// with fewer than ten frames that have a pose and redundancy; [`PoseError::BadObservation`];
/// [`PoseError::NotConverged`].
pub fn refine_flight(
    observations: &Observations,
    rig: &Rig,
    markers: &[BodyMarker],
    prior: FlightPrior,
) -> Result<RefinedFlight, PoseError> {
    validate(rig, prior)?;
    let instants = instants_of(observations, rig, markers, prior.markers_std_m)?;
    let mut bundle = Bundle::new(rig, markers, prior, instants);
    let found = bundle.fit(prior.centres_std_px.is_none())?;
    bundle.refined(&found)
}

/// Refuses priors that are none, and cameras that a flight has refined.
fn validate(rig: &Rig, prior: FlightPrior) -> Result<(), PoseError> {
    let FlightPrior { markers_std_m, centres_std_px } = prior;
    if !(markers_std_m.is_finite() && markers_std_m > 0.0) {
        return Err(PoseError::BadPrior { std_m: markers_std_m });
    }
    if let Some(std_px) = centres_std_px.filter(|px| !(px.is_finite() && *px >= 0.0)) {
        return Err(PoseError::BadBias { std_px });
    }
    if rig.frames > 0 {
        return Err(PoseError::AlreadyRefined(rig.frames));
    }
    Ok(())
}

/// Parameters by directions: those of the rig's uncertainty, each marker's and each centre's coordinates.
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
    systematic: SystematicVariance,
    directions: DMatrix<f64>,
    instants: Vec<Vec<Instant>>,
    shared: Shared,
    state: DVector<f64>,
    factor: f64,
}

struct Minimum {
    covariance: DMatrix<f64>,
    reduced: Reduced,
    /// Sum of the squared whitened residuals at the start.
    before: f64,
}

impl<'a> Bundle<'a> {
    fn new(rig: &'a Rig, nominal: &'a [BodyMarker], prior: FlightPrior, instants: Vec<Vec<Instant>>) -> Self {
        let mut shared = Shared::new(rig.cameras.iter().map(|c| c.camera).collect(), nominal.to_vec());
        (shared.free_points, shared.free_offsets) = (true, true);
        let directions = directions(&shared, rig);
        let given_px2 = prior.centres_std_px.unwrap_or(0.0).powi(2);
        Self {
            rig,
            nominal,
            markers_std_m: prior.markers_std_m,
            systematic: SystematicVariance {
                constant_px2: CONSTANT_SHARE * given_px2,
                for_a_second_px2: (1.0 - CONSTANT_SHARE) * given_px2,
            },
            state: DVector::zeros(directions.ncols()),
            directions,
            instants,
            shared,
            factor: f64::INFINITY,
        }
    }

    /// The minimum; with the systematic errors of centres estimated where they are not given.
    fn fit(&mut self, estimates_systematic: bool) -> Result<Minimum, PoseError> {
        let found = self.minimise()?;
        if !estimates_systematic {
            return Ok(found);
        }
        self.systematic = self.linear_fit()?.systematic_variance();
        Ok(Minimum { before: found.before, ..self.minimise()? })
    }

    fn minimise(&mut self) -> Result<Minimum, PoseError> {
        let mut before = None;
        for _ in 0..MAX_STEPS {
            let reduced = self.reduced()?;
            let first = *before.get_or_insert(reduced.squares);
            let freedom = (reduced.coordinates - 6 * reduced.instants).max(1) as f64;
            // The first time no residual was bounded.
            let kept = if self.factor.is_finite() { HUBER_MEAN } else { 1.0 };
            self.factor = (reduced.weighted / (freedom * kept)).max(f64::MIN_POSITIVE);
            let (next, covariance) = self.solution(&reduced).ok_or(not_converged(&reduced))?;
            let step = &next - &self.state;
            let variances = covariance.diagonal();
            let converged = step.iter().zip(&variances).all(|(s, v)| s.abs() <= CONVERGED * v.sqrt());
            self.state = next;
            self.move_shared();
            if converged {
                return Ok(Minimum { covariance, reduced, before: first });
            }
        }
        let reduced = self.reduced()?;
        Err(not_converged(&reduced))
    }

    /// The equations with all poses at their minima and the errors of centres that last a second eliminated.
    fn reduced(&mut self) -> Result<Reduced, PoseError> {
        let mut out = Reduced::new(self.shared.rows());
        let first = self.shared.first_offset();
        let variance_px2 = self.systematic.for_a_second_px2;
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

    fn of_second(&mut self, second: usize) -> Result<Reduced, PoseError> {
        let mut own = Reduced::new(self.shared.rows());
        for Instant { observations, world_from_body } in &mut self.instants[second] {
            let pose = self.shared.best_pose(observations, world_from_body, self.factor);
            *world_from_body = pose.ok_or_else(|| not_converged(&own))?;
            let added = own.add(&self.shared, observations, world_from_body, self.factor);
            added.ok_or_else(|| not_converged(&own))?;
        }
        Ok(own)
    }

    /// The fit, linearised, for an estimate of the systematic errors, of which it has none.
    fn linear_fit(&mut self) -> Result<LinearFit<'_>, PoseError> {
        let seconds = (0..self.instants.len()).map(|k| self.of_second(k)).collect::<Result<Vec<_>, _>>()?;
        let observations = || self.instants.iter().flatten().flat_map(|i| &i.observations);
        let information = observations().map(|o| o.whitener.norm_squared() / 2.0).sum::<f64>();
        Ok(LinearFit {
            seconds,
            directions: &self.directions,
            state: &self.state,
            offsets: 2 * self.shared.offsets_px.len(),
            prior: self.prior_information(),
            factor: self.factor,
            stated_px2: observations().count() as f64 / information,
        })
    }

    /// Information on each direction before the flight.
    fn prior_information(&self) -> DVector<f64> {
        let (markers, offsets) = (3 * self.nominal.len(), 2 * self.shared.offsets_px.len());
        let from_offsets = self.state.len() - offsets;
        DVector::from_fn(self.state.len(), |k, _| match k {
            _ if k < from_offsets - markers => 1.0,
            _ if k < from_offsets => self.markers_std_m.powi(-2),
            // Exact centres are those that are off by a millionth of a pixel.
            _ => 1.0 / self.systematic.constant_px2.max(1e-12),
        })
    }

    fn solution(&self, reduced: &Reduced) -> Option<(DVector<f64>, DMatrix<f64>)> {
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
        for (k, (marker, nominal)) in self.shared.points.iter_mut().zip(self.nominal).enumerate() {
            marker.marker_in_body_m = nominal.marker_in_body_m + change.fixed_rows::<3>(first + 3 * k);
        }
        for (k, offset) in self.shared.offsets_px.iter_mut().enumerate() {
            *offset = change.fixed_rows::<2>(offsets + 2 * k).into_owned();
        }
    }

    fn refined(self, found: &Minimum) -> Result<RefinedFlight, PoseError> {
        let Minimum { covariance, reduced, before } = found;
        let factor = covariance.clone().cholesky().ok_or(not_converged(reduced))?.unpack();
        let mut uncertainty = &self.directions * factor;
        // Of the markers the shape: a flight does not determine a common shift or turn.
        let (first, rows) = (self.shared.first_point(), 3 * self.nominal.len());
        let shape = DMatrix::identity(rows, rows) - self.rigid_motions();
        let of_shape = shape * uncertainty.rows(first, rows);
        uncertainty.rows_mut(first, rows).copy_from(&of_shape);
        if !uncertainty.iter().all(|x| x.is_finite()) {
            return Err(not_converged(reduced));
        }
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
            centres_std_px: self.systematic.std_px(),
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

    /// Largest angle between two frames' attitudes, sought from the one farthest from the first.
    fn turned_rad(&self) -> f64 {
        let turns = || self.instants.iter().flatten().map(|i| i.world_from_body.rotation);
        let farthest = |from: UnitQuaternion<f64>| {
            let angles = turns().map(|turn| (turn.angle_to(&from), turn));
            angles.fold((0.0, from), |a, b| if b.0 > a.0 { b } else { a })
        };
        turns().next().map_or(0.0, |first| farthest(farthest(first).1).0)
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

fn not_converged(reduced: &Reduced) -> PoseError {
    let residual_px = (reduced.squares / reduced.coordinates.max(1) as f64).sqrt();
    PoseError::NotConverged { steps: MAX_STEPS, residual_px }
}
