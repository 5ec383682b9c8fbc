//! Reprojection errors of a flight under given clocks, and how they change with these.

use super::path::{PathVelocity, PixelPath};
use super::types::{CameraClock, CameraStream};
use crate::reprojection::{PointObservation, PoseFit, Scene, huber};
use crate::statistics::median;
use crate::{BodyMarker, PoseEstimator, Rig};
use mavsight_geometry::Isometry3;
use nalgebra::{DMatrix, DVector};
use std::collections::HashSet;

/// Instants that are looked at: beyond these more add little.
pub(super) const MOST_INSTANTS: usize = 2000;

/// Parts of the flight over which errors may last.
const BLOCKS: usize = 24;

/// Standard deviation of the systematic error of a centre for the whole flight: far above what it is.
const SYSTEMATIC_STD_PX: f64 = 1.0;

/// Whitened residuals longer than this many times the flight's scale weigh no more than one of that length.
pub(super) const BOUND: f64 = 2.5;

/// Steps to a pose, which is taken as far as it has come, and the drop of chi-square that ends them.
const MOST_STEPS: usize = 12;
const CONVERGED: f64 = 1e-4;

/// A camera and a part of its clock.
pub(super) type Unknown = (usize, usize);

/// An observation of a marker, by its index in its path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct InPath {
    camera: usize,
    marker: usize,
    index: usize,
}

/// Speeds of an observation's path and of the pose at its place.
struct Speeds {
    of: InPath,
    path_px_s: f64,
    pose_px_s: f64,
}

pub(super) struct View {
    pub(super) seen: PointObservation,
    of: InPath,
    velocity: PathVelocity,
    rows_px: f64,
}

impl View {
    /// Change of the pixel with a part of the clock, over its velocity.
    fn factor(&self, part: usize, t_s: f64) -> f64 {
        [1.0, t_s, -self.rows_px][part]
    }
}

#[derive(Default)]
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
    pub(super) poses: Vec<Option<Isometry3<f64>>>,
    /// By camera: sum of squared speeds, px²/s², corrected for noise; observations; redundancy in whitened
    /// units; distance over focal length.
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

/// Agreement of cameras under some clocks.
pub(super) struct Misfit {
    /// Instants with a pose.
    pub(super) instants: u32,
    /// Mean over them of the root of chi-square over redundancy: small where the clocks are right, whatever a
    /// few bad instants do.
    pub(super) mean: f64,
}

pub(super) struct Problem<'a> {
    pub(super) streams: &'a [CameraStream],
    estimator: PoseEstimator,
    pub(super) instants: Vec<f64>,
    pub(super) poses: Vec<Option<Isometry3<f64>>>,
    /// Observations whose paths leap.
    pub(super) leaping: HashSet<InPath>,
    /// Systematic error of each centre: camera by camera, two a marker.
    pub(super) systematic_px: DVector<f64>,
    /// Factor on the claimed variances.
    pub(super) scale: f64,
}

impl<'a> Problem<'a> {
    pub(super) fn new(rig: &Rig, markers: &[BodyMarker], streams: &'a [CameraStream]) -> Self {
        let fastest = streams
            .iter()
            .filter(|s| !s.observations.is_empty())
            .min_by(|a, b| a.interval_s.total_cmp(&b.interval_s));
        let times = |s: &CameraStream| {
            s.observations.iter().map(|x| s.prior.clock.time_s(x.t_ns, 0.0)).collect::<Vec<f64>>()
        };
        let mut instants = fastest.map_or_else(Vec::new, times);
        instants.dedup();
        let stride = instants.len().div_ceil(MOST_INSTANTS).max(1);
        let instants: Vec<f64> = instants.into_iter().step_by(stride).collect();
        Self {
            streams,
            estimator: PoseEstimator::new(rig, markers),
            poses: vec![None; instants.len()],
            leaping: HashSet::new(),
            systematic_px: DVector::zeros(2 * streams.len() * markers.len()),
            instants,
            scale: 1.0,
        }
    }

    pub(super) fn paths(&self, clocks: &[CameraClock]) -> Vec<Vec<PixelPath>> {
        let Scene { cameras, points } = self.scene();
        let one = |k: usize| self.streams[k].paths(cameras[k].size, points.len(), &clocks[k]);
        (0..self.streams.len()).map(one).collect()
    }

    pub(super) fn views(&self, paths: &[Vec<PixelPath>], t_s: f64, cameras: &[usize], out: &mut Vec<View>) {
        out.clear();
        for &camera in cameras {
            for (marker, path) in paths[camera].iter().enumerate() {
                let Some(at) = path.at(t_s) else { continue };
                let of = InPath { camera, marker, index: at.index };
                if self.leaping.contains(&of) {
                    continue;
                }
                let Some(velocity) = at.velocity else { continue };
                let pixel = at.pixel - self.systematic_px.fixed_rows::<2>(self.row(camera, marker));
                let seen = PointObservation::new(camera, marker, pixel, at.covariance_px2);
                let rows_px = self.streams[camera].rows_px(self.scene().cameras[camera].size, &at.pixel);
                out.extend(seen.map(|seen| View { seen, of, velocity, rows_px }));
            }
        }
    }

    /// Where the systematic error of a centre begins.
    pub(super) fn row(&self, camera: usize, marker: usize) -> usize {
        2 * (camera * self.scene().points.len() + marker)
    }

    /// First poses: of all cameras together, or of one of them where their clocks are too far apart for that.
    pub(super) fn find_poses(&mut self, clocks: &[CameraClock]) {
        let paths = self.paths(clocks);
        let all: Vec<usize> = (0..self.streams.len()).collect();
        let (mut views, mut previous) = (Vec::new(), None::<Isometry3<f64>>);
        for k in 0..self.instants.len() {
            self.views(&paths, self.instants[k], &all, &mut views);
            let of = |only: Option<usize>| {
                let own = views.iter().map(|v| v.seen).filter(|o| only.is_none_or(|c| c == o.camera));
                self.estimator.estimate_views(&own.collect::<Vec<_>>(), previous.as_ref()).ok()
            };
            let found = of(None).or_else(|| all.iter().find_map(|c| of(Some(*c)))).map(|e| e.world_from_body);
            previous = found.or(previous);
            self.poses[k] = previous;
        }
    }

    /// The pose of an instant, where two cameras determine it with redundancy, and its views.
    pub(super) fn pose_of(
        &self,
        paths: &[Vec<PixelPath>],
        instant: usize,
        cameras: &[usize],
        views: &mut Vec<View>,
    ) -> Option<PoseFit> {
        self.views(paths, self.instants[instant], cameras, views);
        let is_other = |v: &View| v.seen.camera != views[0].seen.camera;
        let start = self.poses[instant].filter(|_| views.len() > 3 && views.iter().any(is_other))?;
        self.fitted_pose(views, &start)
    }

    /// How well some cameras agree under some clocks at every so many instants. Left off where the mean is
    /// above a bound.
    pub(super) fn misfit(
        &self,
        clocks: &[CameraClock],
        cameras: &[usize],
        stride: usize,
        most: f64,
    ) -> Misfit {
        let (paths, mut views) = (self.paths(clocks), Vec::new());
        let tried = self.instants.len().div_ceil(stride) as f64;
        let (mut instants, mut sum) = (0, 0.0);
        for k in (0..self.instants.len()).step_by(stride) {
            if let Some(fit) = self.pose_of(&paths, k, cameras, &mut views) {
                instants += 1;
                sum += (fit.loss / fit.redundancy() as f64).sqrt();
            }
            if sum > most * tried {
                break;
            }
        }
        Misfit { instants, mean: sum / f64::from(instants).max(1.0) }
    }

    /// The sums under some clocks.
    pub(super) fn sums(&self, clocks: &[CameraClock], unknowns: &[Unknown]) -> Sums {
        let paths = self.paths(clocks);
        let all: Vec<usize> = (0..self.streams.len()).collect();
        let size = unknowns.len() + self.systematic_px.len();
        let mut sums = Sums {
            normal: DMatrix::zeros(size, size),
            gradient: DVector::zeros(size),
            blocks: vec![DVector::zeros(size); BLOCKS],
            by_noise: vec![0.0; unknowns.len()],
            poses: self.poses.clone(),
            by_camera: vec![CameraSums::default(); self.streams.len()],
            ..Default::default()
        };
        let mut views = Vec::new();
        for k in 0..self.instants.len() {
            let Some(fit) = self.pose_of(&paths, k, &all, &mut views) else { continue };
            sums.poses[k] = Some(fit.world_from_body);
            let redundancy = fit.redundancy() as f64;
            // The median of a chi-square over its degrees of freedom is below one (Wilson & Hilferty 1931).
            sums.factors.push(fit.loss / redundancy / (1.0 - 2.0 / (9.0 * redundancy)).powi(3));
            self.add(&mut sums, &views, unknowns, k);
        }
        sums
    }

    /// The pose nearest to a start that fits the views best, with bounded influence.
    fn fitted_pose(&self, views: &[View], start: &Isometry3<f64>) -> Option<PoseFit> {
        let seen: Vec<_> = views.iter().map(|v| v.seen).collect();
        self.scene().descend(&seen, start, self.bound2(), CONVERGED, MOST_STEPS).ok()
    }

    pub(super) fn scene(&self) -> Scene<'_> {
        self.estimator.scene()
    }

    pub(super) fn bound2(&self) -> f64 {
        BOUND * BOUND * self.scale
    }

    /// One instant's share of the normal equations, its pose eliminated.
    fn add(&self, sums: &mut Sums, views: &[View], unknowns: &[Unknown], instant: usize) {
        let (Some(pose), t_s) = (sums.poses[instant], self.instants[instant]) else { return };
        let mut columns = DMatrix::zeros(2 * views.len(), sums.gradient.len());
        let mut jacobians = DMatrix::zeros(2 * views.len(), 6);
        let mut residuals = DMatrix::zeros(2 * views.len(), 1);
        for (i, v) in views.iter().enumerate() {
            let Ok(at) = self.scene().at(&v.seen, &pose) else { return };
            let root = huber(at.whitened.norm_squared(), self.bound2()).0.sqrt();
            jacobians.fixed_view_mut::<2, 6>(2 * i, 0).copy_from(&(at.by_pose * root));
            residuals.fixed_view_mut::<2, 1>(2 * i, 0).copy_from(&(at.whitened * root));
            let own = unknowns.len() + self.row(v.seen.camera, v.seen.point);
            columns.fixed_view_mut::<2, 2>(2 * i, own).copy_from(&(v.seen.whitener * -root));
            for (u, (_, part)) in unknowns.iter().enumerate().filter(|(_, u)| u.0 == v.seen.camera) {
                let slope = v.seen.whitener * v.velocity.px_s * (root * v.factor(*part, t_s));
                columns.fixed_view_mut::<2, 1>(2 * i, u).copy_from(&slope);
            }
        }
        let Some(factor) = jacobians.tr_mul(&jacobians).cholesky() else { return };
        let inverse = factor.inverse();
        // Less what the pose explains of them.
        let left = |m: DMatrix<f64>| &m - &jacobians * factor.solve(&jacobians.tr_mul(&m));
        let gradient = columns.tr_mul(&left(residuals)).column(0).into_owned();
        sums.normal += columns.tr_mul(&left(columns.clone()));
        sums.blocks[instant * BLOCKS / self.instants.len()] += &gradient;
        sums.gradient += gradient;
        for (i, v) in views.iter().enumerate() {
            // What remains of a unit error of each coordinate beside the pose.
            let own = jacobians.fixed_rows::<2>(2 * i);
            let left = 2.0 - (own * &inverse * own.transpose()).trace();
            let white2 = 0.5 * v.seen.whitener.norm_squared();
            let (camera, gain_per_s2) = (&mut sums.by_camera[v.seen.camera], v.velocity.gain_per_s2);
            camera.at_unit_speed += 0.5 * left * white2;
            camera.observations += 1.0;
            camera.speed2 += v.velocity.px_s.norm_squared() - 2.0 * self.scale * gain_per_s2 / white2;
            let filmed_by = &self.scene().cameras[v.seen.camera];
            let depth_m = (filmed_by.centre_in_world() - pose.translation.vector).norm();
            camera.metres_a_pixel += depth_m / filmed_by.intrinsics.fx_px.abs();
            for (u, (_, part)) in unknowns.iter().enumerate().filter(|(_, u)| u.0 == v.seen.camera) {
                sums.by_noise[u] += gain_per_s2 * left * v.factor(*part, t_s).powi(2);
            }
        }
    }

    /// Adds what is known of the unknowns and of the systematic errors beforehand.
    pub(super) fn add_priors(&self, sums: &mut Sums, clocks: &[CameraClock], unknowns: &[Unknown]) {
        for (u, (camera, part)) in unknowns.iter().enumerate() {
            let prior = &self.streams[*camera].prior;
            let (std, mut start, mut now) = (prior.stds()[*part], prior.clock, clocks[*camera]);
            if std.is_finite() {
                sums.normal[(u, u)] += self.scale / (std * std);
                sums.gradient[u] += self.scale * (*now.parts()[*part] - *start.parts()[*part]) / (std * std);
            }
        }
        for (at, px) in (unknowns.len()..).zip(self.systematic_px.iter()) {
            sums.normal[(at, at)] += self.scale / SYSTEMATIC_STD_PX.powi(2);
            sums.gradient[at] += self.scale * px / SYSTEMATIC_STD_PX.powi(2);
        }
    }
}

impl Sums {
    /// Factor on the claimed variances: the median over instants, which a few wrong ones do not raise.
    pub(super) fn scale(&self) -> f64 {
        median(self.factors.clone()).map_or(1.0, |usual| usual.max(1e-6))
    }
}

/// A path so many times as fast as the poses, at the time and on the whole, does not show the marker.
const LEAP: f64 = 3.0;

impl Problem<'_> {
    /// Leaves out observations whose paths move much faster than the poses.
    ///
    /// A path through a few frames of another object has a hundred times the marker's speed, and the
    /// information on a clock goes with the square of that; bounded residuals do not help, as observations
    /// next to a leap have none (leverage points, Rousseeuw & Leroy 1987).
    pub(super) fn leave_out_leaps(&mut self, clocks: &[CameraClock]) {
        let paths = self.paths(clocks);
        let all: Vec<usize> = (0..self.streams.len()).collect();
        let apart_s = self.streams.iter().map(|s| s.interval_s).fold(f64::INFINITY, f64::min);
        let (mut views, mut beside) = (Vec::new(), Vec::new());
        let mut speeds: Vec<Speeds> = Vec::new();
        for k in 0..self.instants.len() {
            let Some(near) = self.poses[k] else { continue };
            let mut pose_at = |t_s: f64| {
                self.views(&paths, t_s, &all, &mut beside);
                let fit = self.fitted_pose(&beside, &near).filter(|_| beside.len() > 3);
                fit.map(|fit| fit.world_from_body)
            };
            let t_s = self.instants[k];
            let (before, after) = (pose_at(t_s - 0.5 * apart_s), pose_at(t_s + 0.5 * apart_s));
            let Some((before, after)) = before.zip(after) else { continue };
            self.views(&paths, t_s, &all, &mut views);
            for v in &views {
                let seen = |pose| self.scene().at(&v.seen, pose).ok().map(|at| at.projection.pixel);
                let Some((from, to)) = seen(&before).zip(seen(&after)) else { continue };
                let (path_px_s, pose_px_s) = (v.velocity.px_s.norm(), (to - from).norm() / apart_s);
                speeds.push(Speeds { of: v.of, path_px_s, pose_px_s });
            }
        }
        for camera in all {
            let own = || speeds.iter().filter(|s| s.of.camera == camera);
            let mut usual: Vec<f64> = own().map(|s| s.pose_px_s).collect();
            usual.sort_by(f64::total_cmp);
            // Nine tenths of the flight is slower; the rest may be what wrong observations do to poses.
            let Some(fast) = usual.get(usual.len() * 9 / 10).copied() else { continue };
            let leaps = own().filter(|s| s.path_px_s > LEAP * (s.pose_px_s + fast));
            self.leaping.extend(leaps.map(|s| s.of));
        }
    }
}
