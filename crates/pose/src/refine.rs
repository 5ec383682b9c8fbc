//! The body as built: marker positions from the flight itself.

use crate::estimate::noise_weight;
use crate::{BodyMarker, MarkerObservation, PoseError, PoseEstimator, Rig};
use mavsight_geometry::attitude::matrix_of;
use mavsight_geometry::camera::d_pixel_d_pose;
use mavsight_geometry::{
    CAMERA_PARAMETERS, Isometry3, Matrix2, Matrix6, Point3, UnitQuaternion, Vector2, Vector3,
};
use nalgebra::{DMatrix, DVector, Dyn, OMatrix, Translation3, U2, U6, Vector6};

/// Marker positions that a flight has told, with what it leaves open.
///
/// A film shows the shape of the body, not where its axes lie in it: the markers are given in the body axes for which their
/// displacements from the vehicle file have no common shift and no common turn (Procrustes). If the ruler was off by σ in
/// each coordinate, these axes are off from the file's true ones by about σ/√n, for every pose alike; a comparison with
/// poses in other axes has to allow for one constant motion of the body frame.
#[derive(Debug, Clone, PartialEq)]
pub struct RefinedMarkers {
    /// The body with the refined positions.
    pub markers: Vec<BodyMarker>,
    /// What remains unknown of the shape: 3 rows a marker, each column one standard deviation along an independent direction.
    pub uncertainty_m: DMatrix<f64>,
    /// What one standard deviation along each direction of the rig's uncertainty has done to the positions: 3 rows a
    /// marker, columns as in [`Rig::uncertainty`].
    pub by_rig_m: DMatrix<f64>,
    /// What a centre that is off by a pixel in all frames alike does to the positions, m/px: 3 rows a marker, a column for
    /// each coordinate of each marker in each camera (camera by camera, marker by marker, u then v).
    pub by_centres_m: DMatrix<f64>,
    /// Standard deviation of each coordinate of each marker with all that is not known: noise, cameras, and centres that
    /// are off for the whole flight by what they claim for one frame.
    pub std_m: Vec<Vector3<f64>>,
    /// Largest angle between the attitudes of two frames.
    pub turned_rad: f64,
    /// Sum of the squared whitened residuals with the positions of the file, and with the refined ones.
    pub chi_square: (f64, f64),
    /// Coordinates less what was estimated.
    pub redundancy: usize,
    /// Instants that entered.
    pub frames: usize,
}

/// Frames needed for the shape to rest on more than the noise of a few.
const NEEDED_FRAMES: usize = 10;

/// Gauss-Newton steps; millimetres beside metres settle in three or four.
const MAX_STEPS: usize = 20;

/// A step shorter than this share of the positions' own uncertainty ends the iteration.
const SETTLED: f64 = 1e-3;

struct Frame {
    sights: Vec<(usize, usize, Vector2<f64>, Matrix2<f64>)>,
    pose: Isometry3<f64>,
}

type PoseByMarkers = OMatrix<f64, U6, Dyn>;

/// Normal equations of the positions once the poses are eliminated (Schur complement; Triggs et al. 2000, section 6.1).
struct Reduced {
    normal: DMatrix<f64>,
    gradient: DVector<f64>,
    by_rig: DMatrix<f64>,
    by_centres: DMatrix<f64>,
    /// Sum of the claimed variances of the coordinates.
    claimed_px2: f64,
    chi_square: f64,
    weighted: f64,
    coordinates: usize,
    /// For each frame: inverse of the pose's block, its coupling with the markers, its gradient.
    poses: Vec<(Matrix6<f64>, PoseByMarkers, Vector6<f64>)>,
}

/// Refines the marker positions of a body by a bundle adjustment of all poses and positions, with the positions of the file
/// as a prior: `prior_std_m` is the standard deviation of each of their coordinates (a ruler: 1 to 2 mm).
///
/// Sights are weighted by their covariances, with bounded influence (Huber 1981). The scale of their noise is estimated,
/// as the claimed covariances may be off.
///
/// A centre may be off in the same way in all frames, by light from one side or what is behind the ball. While the aircraft keeps its
/// attitude that looks like a marker elsewhere; where it turns, it does not. A flight that turns so little that the positions
/// would be no better than those of the file is refused.
///
/// # Errors
/// [`PoseError::BadPrior`]; [`PoseError::TooFewPoses`] with fewer than ten frames that have a pose and redundancy;
/// [`PoseError::ShapeNotShown`] for a flight that turns too little;
/// [`PoseError::BadObservation`]; [`PoseError::NotConverged`].
pub fn refine_markers(
    observations: &[MarkerObservation],
    rig: &Rig,
    markers: &[BodyMarker],
    prior_std_m: f64,
) -> Result<RefinedMarkers, PoseError> {
    if !(prior_std_m.is_finite() && prior_std_m > 0.0) {
        return Err(PoseError::BadPrior { std_m: prior_std_m });
    }
    let mut bundle = Bundle::new(observations, rig, markers, prior_std_m)?;
    let mut factor = f64::INFINITY;
    let mut before = None;
    for _ in 0..MAX_STEPS {
        let reduced = bundle.reduced(factor)?;
        let redundancy = (reduced.coordinates - 6 * bundle.frames.len()).max(1) as f64;
        let first = *before.get_or_insert(reduced.chi_square);
        factor = (reduced.weighted / redundancy).max(f64::MIN_POSITIVE);
        let information =
            &reduced.normal / factor + DMatrix::identity(bundle.size(), bundle.size()) / prior_std_m.powi(2);
        let pull = &reduced.gradient / factor - bundle.displacement() / prior_std_m.powi(2);
        let covariance = information.cholesky().ok_or(bundle.not_converged(&reduced))?.inverse();
        let step = &covariance * pull;
        let settled =
            step.iter().zip(covariance.diagonal().iter()).all(|(s, v)| s.abs() <= SETTLED * v.sqrt());
        bundle.take(&step, &reduced);
        if settled {
            return bundle.finished((&covariance, prior_std_m), &reduced, factor, first);
        }
    }
    let reduced = bundle.reduced(factor)?;
    Err(bundle.not_converged(&reduced))
}

struct Bundle<'a> {
    rig: &'a Rig,
    nominal: &'a [BodyMarker],
    markers: Vec<BodyMarker>,
    frames: Vec<Frame>,
}

impl<'a> Bundle<'a> {
    fn new(
        observations: &[MarkerObservation],
        rig: &'a Rig,
        markers: &'a [BodyMarker],
        prior_std_m: f64,
    ) -> Result<Self, PoseError> {
        let mut sorted: Vec<&MarkerObservation> = observations.iter().collect();
        sorted.sort_by_key(|o| o.t_ns);
        // The prior tells the estimator how far markers may be off before they count as false.
        let size = 3 * markers.len();
        let unsure = DMatrix::identity(size, size) * prior_std_m;
        let estimator = PoseEstimator::new(rig, markers).with_marker_uncertainty(&unsure)?;
        let (mut frames, mut previous, mut instants) = (Vec::new(), None, 0);
        for group in sorted.chunk_by(|a, b| a.t_ns == b.t_ns) {
            instants += 1;
            let own: Vec<MarkerObservation> = group.iter().map(|o| (*o).clone()).collect();
            let pose = match estimator.estimate(own[0].t_ns, &own, previous.as_ref()) {
                Ok(estimate) => estimate.world_from_body,
                Err(bad @ PoseError::BadObservation { .. }) => return Err(bad),
                Err(_) => continue,
            };
            previous = Some(pose);
            let whitened = |o: &MarkerObservation| {
                let whitener = o.covariance_px2.cholesky()?.l().try_inverse()?;
                Some((o.camera, o.marker, o.pixel, whitener))
            };
            let sights: Vec<_> = own.iter().filter_map(whitened).collect();
            if sights.len() > 3 {
                frames.push(Frame { sights, pose });
            }
        }
        if frames.len() < NEEDED_FRAMES {
            let measured = frames.len();
            return Err(PoseError::TooFewPoses { measured, samples: instants, needed: NEEDED_FRAMES });
        }
        Ok(Self { rig, nominal: markers, markers: markers.to_vec(), frames })
    }

    fn size(&self) -> usize {
        3 * self.markers.len()
    }

    fn displacement(&self) -> DVector<f64> {
        DVector::from_fn(self.size(), |i, _| {
            self.markers[i / 3].marker_in_body_m[i % 3] - self.nominal[i / 3].marker_in_body_m[i % 3]
        })
    }

    fn not_converged(&self, reduced: &Reduced) -> PoseError {
        PoseError::NotConverged { steps: MAX_STEPS, residual_px: error_px(reduced) }
    }

    fn reduced(&self, factor: f64) -> Result<Reduced, PoseError> {
        let (size, columns) = (self.size(), self.rig.uncertainty.ncols());
        let mut out = Reduced {
            normal: DMatrix::zeros(size, size),
            gradient: DVector::zeros(size),
            by_rig: DMatrix::zeros(size, columns),
            by_centres: DMatrix::zeros(size, 2 * self.rig.cameras.len() * self.markers.len()),
            claimed_px2: 0.0,
            chi_square: 0.0,
            weighted: 0.0,
            coordinates: 0,
            poses: Vec::with_capacity(self.frames.len()),
        };
        for frame in &self.frames {
            self.add_frame(frame, factor, &mut out)?;
        }
        Ok(out)
    }

    fn add_frame(&self, frame: &Frame, factor: f64, out: &mut Reduced) -> Result<(), PoseError> {
        let turn = matrix_of(&frame.pose.rotation);
        let mut own = Matrix6::zeros();
        let mut gradient = Vector6::zeros();
        let mut coupling = PoseByMarkers::zeros(self.size());
        let mut rig_to_pose = PoseByMarkers::zeros(out.by_rig.ncols());
        let mut centres_to_pose = PoseByMarkers::zeros(out.by_centres.ncols());
        for (camera, marker, pixel, whitener) in &frame.sights {
            let ball = &self.markers[*marker];
            let centre = (frame.pose * Point3::from(ball.marker_in_body_m)).coords;
            let view = &self.rig.cameras[*camera].camera;
            let seen = view.project_ball(&centre, ball.radius_m)?;
            let error = whitener * (pixel - seen.pixel);
            let weight = noise_weight(error.norm_squared(), factor);
            let by_pose = whitener * d_pixel_d_pose(&seen, &frame.pose, &ball.marker_in_body_m);
            let by_marker = whitener * seen.d_pixel_d_point_in_world * turn;
            let parameters = CAMERA_PARAMETERS * camera;
            let by_rig: OMatrix<f64, U2, Dyn> = whitener
                * view.d_pixel_d_camera(&centre)?
                * self.rig.uncertainty.fixed_rows::<CAMERA_PARAMETERS>(parameters);
            let at = 3 * marker;
            own += by_pose.transpose() * by_pose * weight;
            gradient += by_pose.transpose() * error * weight;
            let mut block = coupling.fixed_columns_mut::<3>(at);
            block += by_pose.transpose() * by_marker * weight;
            let mut block = out.normal.fixed_view_mut::<3, 3>(at, at);
            block += by_marker.transpose() * by_marker * weight;
            let mut block = out.gradient.fixed_rows_mut::<3>(at);
            block += by_marker.transpose() * error * weight;
            rig_to_pose += by_pose.transpose() * &by_rig * weight;
            let mut block = out.by_rig.fixed_rows_mut::<3>(at);
            block += by_marker.transpose() * &by_rig * weight;
            let centre_at = 2 * (camera * self.markers.len() + marker);
            let mut block = centres_to_pose.fixed_columns_mut::<2>(centre_at);
            block += by_pose.transpose() * whitener * weight;
            let mut block = out.by_centres.fixed_view_mut::<3, 2>(at, centre_at);
            block += by_marker.transpose() * whitener * weight;
            out.claimed_px2 += (whitener.transpose() * whitener).try_inverse().map_or(0.0, |c| c.trace());
            out.chi_square += error.norm_squared();
            out.weighted += error.norm_squared() * weight;
            out.coordinates += 2;
        }
        let residual_px = error_px(out);
        let inverse =
            own.cholesky().ok_or(PoseError::NotConverged { steps: MAX_STEPS, residual_px })?.inverse();
        let eliminated = inverse * &coupling;
        out.normal -= coupling.tr_mul(&eliminated);
        out.gradient -= eliminated.tr_mul(&gradient);
        out.by_rig -= eliminated.tr_mul(&rig_to_pose);
        out.by_centres -= eliminated.tr_mul(&centres_to_pose);
        out.poses.push((inverse, coupling, gradient));
        Ok(())
    }

    fn take(&mut self, step: &DVector<f64>, reduced: &Reduced) {
        for (frame, (inverse, coupling, gradient)) in self.frames.iter_mut().zip(&reduced.poses) {
            let by: Vector6<f64> = inverse * (gradient - coupling * step);
            let pose = &frame.pose;
            frame.pose = Isometry3::from_parts(
                Translation3::from(pose.translation.vector + by.fixed_rows::<3>(0)),
                pose.rotation * UnitQuaternion::from_scaled_axis(by.fixed_rows::<3>(3).into_owned()),
            );
        }
        for (marker, by) in self.markers.iter_mut().zip(step.as_slice().chunks_exact(3)) {
            marker.marker_in_body_m += Vector3::new(by[0], by[1], by[2]);
        }
    }

    /// The shape's uncertainty: the covariance without common shift and turn.
    fn finished(
        &self,
        (covariance, prior_std_m): (&DMatrix<f64>, f64),
        reduced: &Reduced,
        factor: f64,
        before: f64,
    ) -> Result<RefinedMarkers, PoseError> {
        let shape = DMatrix::identity(self.size(), self.size()) - self.rigid_motions();
        let of_shape = &shape * covariance * &shape;
        let eigen = ((&of_shape + of_shape.transpose()) * 0.5).symmetric_eigen();
        let largest = eigen.eigenvalues.max();
        let kept: Vec<usize> = (0..self.size()).filter(|k| eigen.eigenvalues[*k] > 1e-9 * largest).collect();
        let uncertainty_m = DMatrix::from_fn(self.size(), kept.len(), |i, j| {
            eigen.eigenvectors[(i, kept[j])] * eigen.eigenvalues[kept[j]].sqrt()
        });
        let gain = &shape * covariance / factor;
        let (by_rig_m, by_centres_m) = (&gain * &reduced.by_rig, &gain * &reduced.by_centres);
        let stays_px = (factor * reduced.claimed_px2 / reduced.coordinates.max(1) as f64).sqrt();
        let variance = |i: usize| {
            uncertainty_m.row(i).norm_squared()
                + by_rig_m.row(i).norm_squared()
                + by_centres_m.row(i).norm_squared() * stays_px * stays_px
        };
        let std_m: Vec<Vector3<f64>> = (0..self.markers.len())
            .map(|m| Vector3::from_fn(|axis, _| variance(3 * m + axis).sqrt()))
            .collect();
        let turned_rad = self.turned_rad();
        // The ruler leaves its variance in each direction but those of the whole body's motion.
        let (left_m2, ruler_m2) =
            (std_m.iter().map(Vector3::norm_squared).sum::<f64>(), shape.trace() * prior_std_m.powi(2));
        if left_m2 >= ruler_m2 {
            let std_m = prior_std_m * (left_m2 / ruler_m2).sqrt();
            return Err(PoseError::ShapeNotShown { std_m, prior_std_m, turned_rad, stays_px });
        }
        Ok(RefinedMarkers {
            markers: self.markers.clone(),
            uncertainty_m,
            by_rig_m,
            by_centres_m,
            std_m,
            turned_rad,
            chi_square: (before, reduced.chi_square),
            redundancy: reduced
                .coordinates
                .saturating_sub(6 * self.frames.len() + self.size().saturating_sub(6)),
            frames: self.frames.len(),
        })
    }

    /// Largest angle between the attitude of one frame and that of another, found from both ends: the frame farthest from the
    /// first, and the one farthest from that.
    fn turned_rad(&self) -> f64 {
        let farthest = |from: &UnitQuaternion<f64>| {
            self.frames
                .iter()
                .map(|f| (f.pose.rotation.angle_to(from), f.pose.rotation))
                .fold((0.0, *from), |a, b| if b.0 > a.0 { b } else { a })
        };
        self.frames.first().map_or(0.0, |f| farthest(&farthest(&f.pose.rotation).1).0)
    }

    /// Projector on the displacements that a motion of the whole body makes.
    fn rigid_motions(&self) -> DMatrix<f64> {
        let mut motions = DMatrix::zeros(self.size(), 6);
        for (k, marker) in self.nominal.iter().enumerate() {
            motions.fixed_view_mut::<3, 3>(3 * k, 0).fill_with_identity();
            motions.fixed_view_mut::<3, 3>(3 * k, 3).copy_from(&-marker.marker_in_body_m.cross_matrix());
        }
        let basis = motions.qr().q();
        &basis * basis.transpose()
    }
}

fn error_px(reduced: &Reduced) -> f64 {
    (reduced.chi_square / reduced.coordinates.max(1) as f64).sqrt()
}
