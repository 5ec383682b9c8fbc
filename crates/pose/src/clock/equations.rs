//! Reprojection errors of a flight under given clocks, and how they change with these.

use super::part::Part;
use super::path::PixelPath;
use super::types::{CameraClock, CameraStream};
use crate::{BodyMarker, MarkerObservation, PoseEstimator, Rig};
use mavsight_geometry::camera::d_pixel_d_pose;
use mavsight_geometry::{Camera, Isometry3, Matrix2, Point3, UnitQuaternion, Vector2};
use nalgebra::{DMatrix, DVector, Matrix6, Translation3, Vector6};
use std::collections::HashSet;

/// Instants that are looked at: beyond these more add little.
const MOST_INSTANTS: usize = 2000;

/// Parts of the flight over which errors may last.
const BLOCKS: usize = 24;

/// Standard deviation of the systematic error of a centre for the whole flight: far above what it is.
const SYSTEMATIC_STD_PX: f64 = 1.0;

/// Whitened residuals longer than this many times the flight's scale weigh no more than one of that length.
const BOUND: f64 = 2.5;

/// Steps to a pose; one that needs more is taken as far as it has come.
const MOST_STEPS: usize = 12;

/// A part of a camera's clock.
pub(super) type Unknown = (usize, Part);

/// A marker in a camera at an instant.
pub(super) struct View {
    pub(super) camera: usize,
    pub(super) marker: usize,
    /// Index of the observation in its path.
    pub(super) index: usize,
    pixel: Vector2<f64>,
    whitener: Matrix2<f64>,
    pub(super) px_s: Vector2<f64>,
    gain_per_s2: f64,
    rows_px: f64,
}

/// Normal equations of a flight.
pub(super) struct Sums {
    /// Of unknowns, then of the centres' systematic errors.
    pub(super) normal: DMatrix<f64>,
    pub(super) gradient: DVector<f64>,
    /// Gradient of each part of the flight.
    pub(super) blocks: Vec<DVector<f64>>,
    /// What noise of the velocities adds to the normal matrix's diagonal, by unknown.
    pub(super) by_noise: Vec<f64>,
    /// Chi-square over redundancy of each instant with a pose.
    pub(super) factors: Vec<f64>,
    /// Instants with a pose, and the sum over them of the root of chi-square over redundancy: small where
    /// the clocks are right, whatever a few bad instants do.
    pub(super) instants: usize,
    pub(super) misfit: f64,
    /// By camera: sum of squared speeds, px²/s², corrected for noise; observations; redundancy in
    /// whitened units; distance over focal length.
    pub(super) by_camera: Vec<CameraSums>,
}

#[derive(Debug, Clone, Copy, Default)]
pub(super) struct CameraSums {
    pub(super) speed2: f64,
    pub(super) observations: f64,
    /// What the information on the offset would be at 1 px/s.
    pub(super) at_unit_speed: f64,
    pub(super) metres_a_pixel: f64,
}

pub(super) struct Problem<'a> {
    pub(super) streams: &'a [CameraStream],
    pub(super) cameras: Vec<Camera>,
    pub(super) markers: &'a [BodyMarker],
    estimator: PoseEstimator,
    pub(super) instants: Vec<f64>,
    pub(super) poses: Vec<Option<Isometry3<f64>>>,
    /// Camera, marker and index of observations whose paths leap.
    pub(super) leaping: HashSet<(usize, usize, usize)>,
    /// Systematic error of each centre: camera by camera, two a marker.
    pub(super) systematic_px: DVector<f64>,
    /// Factor on the claimed variances.
    pub(super) scale: f64,
}

impl<'a> Problem<'a> {
    pub(super) fn new(rig: &Rig, markers: &'a [BodyMarker], streams: &'a [CameraStream]) -> Self {
        let fastest = streams
            .iter()
            .enumerate()
            .filter(|(_, s)| !s.observations.is_empty())
            .min_by(|a, b| a.1.interval_s.total_cmp(&b.1.interval_s))
            .map_or(0, |(k, _)| k);
        let mut instants: Vec<f64> = streams.get(fastest).map_or(Vec::new(), |s| {
            s.observations.iter().map(|x| s.prior.clock.time_s(x.t_ns, 0.0)).collect()
        });
        instants.dedup();
        let stride = instants.len().div_ceil(MOST_INSTANTS).max(1);
        let instants: Vec<f64> = instants.into_iter().step_by(stride).collect();
        Self {
            streams,
            cameras: rig.cameras.iter().map(|c| c.camera).collect(),
            markers,
            estimator: PoseEstimator::new(rig, markers),
            poses: vec![None; instants.len()],
            leaping: HashSet::new(),
            systematic_px: DVector::zeros(2 * streams.len() * markers.len()),
            instants,
            scale: 1.0,
        }
    }

    pub(super) fn clocks(&self) -> Vec<CameraClock> {
        self.streams.iter().map(|s| s.prior.clock).collect()
    }

    pub(super) fn paths(&self, clocks: &[CameraClock]) -> Vec<Vec<PixelPath>> {
        let one =
            |(k, s): (usize, &CameraStream)| s.paths(self.cameras[k].size, self.markers.len(), &clocks[k]);
        self.streams.iter().enumerate().map(one).collect()
    }

    /// What some cameras see at a time.
    pub(super) fn views(&self, paths: &[Vec<PixelPath>], t_s: f64, cameras: &[usize], out: &mut Vec<View>) {
        out.clear();
        for &camera in cameras {
            for (marker, path) in paths[camera].iter().enumerate() {
                let Some(at) = path.at(t_s) else { continue };
                if self.leaping.contains(&(camera, marker, at.index)) {
                    continue;
                }
                let Some(velocity) = at.velocity else { continue };
                let whitener = at.covariance_px2.cholesky().and_then(|c| c.l().try_inverse());
                let Some(whitener) = whitener else { continue };
                out.push(View {
                    camera,
                    marker,
                    index: at.index,
                    pixel: at.pixel - self.systematic_of(camera, marker),
                    whitener,
                    px_s: velocity.px_s,
                    gain_per_s2: velocity.gain_per_s2,
                    rows_px: self.streams[camera].rows_px(self.cameras[camera].size, &at.pixel),
                });
            }
        }
    }

    fn systematic_of(&self, camera: usize, marker: usize) -> Vector2<f64> {
        let at = 2 * (camera * self.markers.len() + marker);
        Vector2::new(self.systematic_px[at], self.systematic_px[at + 1])
    }

    /// First poses: of all cameras together, or of one of them where their clocks are too far apart for that.
    pub(super) fn find_poses(&mut self, clocks: &[CameraClock]) {
        let paths = self.paths(clocks);
        let all: Vec<usize> = (0..self.cameras.len()).collect();
        let (mut views, mut previous) = (Vec::new(), None::<Isometry3<f64>>);
        for k in 0..self.instants.len() {
            self.views(&paths, self.instants[k], &all, &mut views);
            let seen = |only: Option<usize>| -> Vec<MarkerObservation> {
                let one = |v: &View| MarkerObservation {
                    t_ns: 0,
                    camera: v.camera,
                    marker: v.marker,
                    pixel: v.pixel,
                    covariance_px2: (v.whitener.transpose() * v.whitener).try_inverse().unwrap_or_default(),
                };
                views.iter().filter(|v| only.is_none_or(|c| c == v.camera)).map(one).collect()
            };
            let of = |only| self.estimator.estimate(0, &seen(only), previous.as_ref()).ok();
            let found = of(None).or_else(|| all.iter().find_map(|c| of(Some(*c)))).map(|e| e.world_from_body);
            previous = found.or(previous);
            self.poses[k] = previous;
        }
    }

    /// The sums under some clocks, over some instants and cameras.
    pub(super) fn sums(
        &mut self,
        clocks: &[CameraClock],
        unknowns: &[Unknown],
        (cameras, stride): (&[usize], usize),
        keep_poses: bool,
    ) -> Sums {
        let paths = self.paths(clocks);
        let size = unknowns.len() + self.systematic_px.len();
        let mut sums = Sums {
            normal: DMatrix::zeros(size, size),
            gradient: DVector::zeros(size),
            blocks: vec![DVector::zeros(size); BLOCKS],
            by_noise: vec![0.0; unknowns.len()],
            factors: Vec::new(),
            instants: 0,
            misfit: 0.0,
            by_camera: vec![CameraSums::default(); self.cameras.len()],
        };
        let mut views = Vec::new();
        for k in (0..self.instants.len()).step_by(stride) {
            let t_s = self.instants[k];
            self.views(&paths, t_s, cameras, &mut views);
            let two = views.iter().any(|v| v.camera != views[0].camera);
            let Some(start) = self.poses[k].filter(|_| two && views.len() > 3) else { continue };
            let Some((pose, chi_square)) = self.fitted_pose(&views, start) else { continue };
            if keep_poses {
                self.poses[k] = Some(pose);
            }
            let redundancy = 2.0 * views.len() as f64 - 6.0;
            sums.instants += 1;
            sums.misfit += (chi_square / redundancy).sqrt();
            // The median of a chi-square over its degrees of freedom is below one (Wilson & Hilferty 1931).
            sums.factors.push(chi_square / redundancy / (1.0 - 2.0 / (9.0 * redundancy)).powi(3));
            if !unknowns.is_empty() {
                let block = (k * BLOCKS / self.instants.len()).min(BLOCKS - 1);
                self.add(&mut sums, &views, &pose, (unknowns, t_s, block));
            }
        }
        sums
    }

    /// The pose nearest to a start that fits the views best, and its chi-square (Levenberg 1944;
    /// Marquardt 1963).
    pub(super) fn fitted_pose(&self, views: &[View], start: Isometry3<f64>) -> Option<(Isometry3<f64>, f64)> {
        let (mut pose, mut damping) = (start, 0.0);
        let (mut normal, mut gradient, mut chi_square) = self.pose_equations(views, &pose)?;
        for _ in 0..MOST_STEPS {
            let mut damped = normal;
            (0..6).for_each(|i| damped[(i, i)] *= 1.0 + damping);
            let step = damped.cholesky()?.solve(&gradient);
            let tried = Isometry3::from_parts(
                Translation3::from(pose.translation.vector + step.fixed_rows::<3>(0)),
                pose.rotation * UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(3).into_owned()),
            );
            match self.pose_equations(views, &tried) {
                Some((n, g, c)) if c <= chi_square * (1.0 + 1e-12) => {
                    let drop = step.dot(&gradient);
                    (pose, normal, gradient, chi_square) = (tried, n, g, c);
                    damping *= 0.1;
                    if drop < 1e-4 {
                        return Some((pose, chi_square));
                    }
                }
                _ if step.dot(&gradient) < 1e-4 => return Some((pose, chi_square)),
                _ => damping = if damping == 0.0 { 1e-3 } else { damping * 10.0 },
            }
        }
        Some((pose, chi_square))
    }

    fn pose_equations(
        &self,
        views: &[View],
        pose: &Isometry3<f64>,
    ) -> Option<(Matrix6<f64>, Vector6<f64>, f64)> {
        let (mut normal, mut gradient, mut chi_square) = (Matrix6::zeros(), Vector6::zeros(), 0.0);
        for v in views {
            let (jacobian, residual) = self.linear(v, pose)?;
            let weight = self.weight(residual.norm_squared());
            normal += jacobian.transpose() * jacobian * weight;
            gradient += jacobian.transpose() * residual * weight;
            // Huber's function, so that the steps go down the same slope that the weights describe.
            let bound2 = BOUND * BOUND * self.scale;
            let square = residual.norm_squared();
            chi_square += if square <= bound2 { square } else { 2.0 * (bound2 * square).sqrt() - bound2 };
        }
        Some((normal, gradient, chi_square))
    }

    fn linear(&self, v: &View, pose: &Isometry3<f64>) -> Option<(nalgebra::Matrix2x6<f64>, Vector2<f64>)> {
        let marker = &self.markers[v.marker];
        let centre = (pose * Point3::from(marker.marker_in_body_m)).coords;
        let seen = self.cameras[v.camera].project_ball(&centre, marker.radius_m).ok()?;
        let jacobian = v.whitener * d_pixel_d_pose(&seen, pose, &marker.marker_in_body_m);
        Some((jacobian, v.whitener * (v.pixel - seen.pixel)))
    }

    fn weight(&self, square: f64) -> f64 {
        let bound2 = BOUND * BOUND * self.scale;
        if square <= bound2 { 1.0 } else { (bound2 / square).sqrt() }
    }

    /// One instant's share of the normal equations, its pose eliminated.
    fn add(
        &self,
        sums: &mut Sums,
        views: &[View],
        pose: &Isometry3<f64>,
        (unknowns, t_s, block): (&[Unknown], f64, usize),
    ) {
        let count = unknowns.len();
        let size = count + 2 * views.len();
        let mut columns = DMatrix::zeros(2 * views.len(), size);
        let mut jacobians = DMatrix::zeros(2 * views.len(), 6);
        let mut residuals = DVector::zeros(2 * views.len());
        for (i, v) in views.iter().enumerate() {
            let Some((jacobian, residual)) = self.linear(v, pose) else { return };
            let root = self.weight(residual.norm_squared()).sqrt();
            jacobians.fixed_view_mut::<2, 6>(2 * i, 0).copy_from(&(jacobian * root));
            residuals.fixed_rows_mut::<2>(2 * i).copy_from(&(residual * root));
            columns.fixed_view_mut::<2, 2>(2 * i, count + 2 * i).copy_from(&(v.whitener * -root));
            for (u, (_, part)) in unknowns.iter().enumerate().filter(|(_, u)| u.0 == v.camera) {
                let slope = v.whitener * v.px_s * (root * part.factor(t_s, v.rows_px));
                columns.fixed_view_mut::<2, 1>(2 * i, u).copy_from(&slope);
            }
        }
        let inverse = (jacobians.transpose() * &jacobians).cholesky().map(|c| c.inverse());
        let Some(inverse) = inverse else { return };
        let cross = jacobians.transpose() * &columns;
        let normal = columns.transpose() * &columns - cross.transpose() * &inverse * &cross;
        let gradient = columns.transpose() * &residuals
            - cross.transpose() * (&inverse * (jacobians.transpose() * &residuals));
        let place = |c: usize| {
            if c < count {
                return c;
            }
            let v = &views[(c - count) / 2];
            count + 2 * (v.camera * self.markers.len() + v.marker) + (c - count) % 2
        };
        for a in 0..size {
            sums.gradient[place(a)] += gradient[a];
            sums.blocks[block][place(a)] += gradient[a];
            for b in 0..size {
                sums.normal[(place(a), place(b))] += normal[(a, b)];
            }
        }
        for (i, v) in views.iter().enumerate() {
            // What remains of a unit error of each coordinate beside the pose.
            let own = jacobians.fixed_rows::<2>(2 * i);
            let left = 2.0 - (own * &inverse * own.transpose()).trace();
            let white2 = 0.5 * v.whitener.norm_squared();
            let camera = &mut sums.by_camera[v.camera];
            camera.at_unit_speed += 0.5 * left * white2;
            camera.observations += 1.0;
            camera.speed2 += v.px_s.norm_squared() - 2.0 * self.scale * v.gain_per_s2 / white2;
            let depth_m = (self.cameras[v.camera].centre_in_world() - pose.translation.vector).norm();
            camera.metres_a_pixel += depth_m / self.cameras[v.camera].intrinsics.fx_px.abs();
            for (u, (_, part)) in unknowns.iter().enumerate().filter(|(_, u)| u.0 == v.camera) {
                sums.by_noise[u] += v.gain_per_s2 * left * part.factor(t_s, v.rows_px).powi(2);
            }
        }
    }

    /// Adds what is known of the unknowns and of the systematic errors beforehand.
    pub(super) fn add_priors(&self, sums: &mut Sums, clocks: &[CameraClock], unknowns: &[Unknown]) {
        for (u, (camera, part)) in unknowns.iter().enumerate() {
            let prior = &self.streams[*camera].prior;
            let (std, apart) = part.prior(prior, &clocks[*camera]);
            if std.is_finite() {
                sums.normal[(u, u)] += self.scale / (std * std);
                sums.gradient[u] += self.scale * apart / (std * std);
            }
        }
        for k in 0..self.systematic_px.len() {
            let at = unknowns.len() + k;
            sums.normal[(at, at)] += self.scale / SYSTEMATIC_STD_PX.powi(2);
            sums.gradient[at] += self.scale * self.systematic_px[k] / SYSTEMATIC_STD_PX.powi(2);
        }
    }
}

impl Sums {
    /// Factor on the claimed variances: the median over instants, which a spell of wrong observations
    /// does not raise.
    pub(super) fn scale(&self) -> f64 {
        let mut factors = self.factors.clone();
        factors.sort_by(f64::total_cmp);
        factors.get(factors.len() / 2).map_or(1.0, |f| f.max(1e-6))
    }
}
