//! The free parameters of an adjustment.

use super::model::CameraModel;
use super::problem::{Data, Problem};
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, CameraChange, Isometry3, Vector2, Vector3};
use nalgebra::{DMatrix, DVector};

/// The column of each free parameter: cameras, sizes of objects, then three for each point that is not exact.
#[derive(Clone)]
pub(super) struct Layout {
    pub(super) cameras: Vec<Option<Columns>>,
    /// Sizes of the moved objects, where they are not exact.
    pub(super) scales: Vec<Option<usize>>,
    pub(super) points: Vec<Option<usize>>,
    /// The moved objects' points and constant errors of centres, where they are not exact.
    pub(super) shapes: Vec<Option<usize>>,
    pub(super) offsets: Vec<Option<usize>>,
    pub(super) of_cameras: usize,
    pub(super) size: usize,
}

#[derive(Clone)]
pub(super) struct Columns {
    pub(super) first: usize,
    pub(super) basis: Vec<CameraChange>,
    /// Columns of the basis that are held: the pose's, where this camera's axes are the world's.
    pub(super) held: usize,
}

#[derive(Clone)]
pub(super) struct State {
    pub(super) cameras: Vec<Camera>,
    /// Of the table's rows.
    pub(super) places: Vec<Vector3<f64>>,
    /// Of the moved objects, by object and instant.
    pub(super) poses: Vec<Vec<Isometry3<f64>>>,
    /// How late each camera was, by object and instant.
    pub(super) lags_s: Vec<Vec<Vec<f64>>>,
    /// Sizes of the moved objects, relative to what is stated.
    pub(super) scales: Vec<f64>,
    /// Displacements of their points, and constant errors of centres, camera by camera.
    pub(super) shapes_m: Vec<Vec<Vector3<f64>>>,
    pub(super) offsets_px: Vec<Vec<Vector2<f64>>>,
}

impl State {
    pub(super) fn new(problem: &Problem, cameras: &[Camera]) -> Self {
        Self {
            cameras: cameras.to_vec(),
            places: problem.points.iter().map(|p| p.in_world_m).collect(),
            poses: problem
                .moved
                .iter()
                .map(|m| m.places.iter().map(|p| p.world_from_body).collect())
                .collect(),
            lags_s: problem.moved.iter().map(|m| vec![vec![0.0; cameras.len()]; m.places.len()]).collect(),
            scales: vec![1.0; problem.moved.len()],
            shapes_m: problem.moved.iter().map(|m| vec![Vector3::zeros(); m.body.len()]).collect(),
            offsets_px: problem
                .moved
                .iter()
                .map(|m| vec![Vector2::zeros(); cameras.len() * m.body.len()])
                .collect(),
        }
    }

    pub(super) fn stepped(&self, layout: &Layout, step: &DVector<f64>) -> Self {
        let mut out = self.clone();
        for (camera, own) in out.cameras.iter_mut().zip(&layout.cameras) {
            let Some(own) = own else { continue };
            let change = own.basis.iter().zip(own.first..).map(|(b, at)| b * step[at]).sum();
            *camera = camera.moved(&change);
        }
        for (place, at) in out.places.iter_mut().zip(&layout.points) {
            *place += at.map_or_else(Vector3::zeros, |at| step.fixed_rows::<3>(at).into_owned());
        }
        for (shape, at) in out.shapes_m.iter_mut().zip(&layout.shapes) {
            let Some(at) = at else { continue };
            shape.iter_mut().zip((*at..).step_by(3)).for_each(|(p, at)| *p += step.fixed_rows::<3>(at));
        }
        for (offsets, at) in out.offsets_px.iter_mut().zip(&layout.offsets) {
            let Some(at) = at else { continue };
            offsets.iter_mut().zip((*at..).step_by(2)).for_each(|(o, at)| *o += step.fixed_rows::<2>(at));
        }
        for (scale, at) in out.scales.iter_mut().zip(&layout.scales) {
            *scale += at.map_or(0.0, |at| step[at]);
        }
        out
    }
}

impl Layout {
    pub(super) fn new(data: Data, models: &[CameraModel]) -> Self {
        let Data { problem, choice } = data;
        let mut size = 0;
        let mut claim = |n: usize| {
            size += n;
            size - n
        };
        let mut cameras = vec![None; problem.sizes.len()];
        for (camera, model) in models.iter().enumerate() {
            if data.used_by(camera).next().is_some() || problem.moved.iter().any(|m| m.is_seen_by(camera)) {
                let held = if problem.held == Some(camera) { 6 } else { 0 };
                let basis = model.basis().split_off(held);
                cameras[camera] = Some(Columns { first: claim(basis.len()), basis, held });
            }
        }
        let scales = problem.moved.iter().map(|m| (m.scale_std > 0.0).then(|| claim(1))).collect();
        let of_cameras = claim(0);
        let in_doubt =
            |std: f64, n: usize, claim: &mut dyn FnMut(usize) -> usize| (std > 0.0).then(|| claim(n));
        let moved = &problem.moved;
        let shapes =
            moved.iter().map(|m| in_doubt(m.doubt.points_std_m, 3 * m.body.len(), &mut claim)).collect();
        let offsets = moved
            .iter()
            .map(|m| in_doubt(m.doubt.centres_std_px, 2 * m.body.len() * problem.sizes.len(), &mut claim))
            .collect();
        let mut points = vec![None; problem.points.len()];
        for row in choice.used().map(|k| choice.place[k]) {
            if problem.points[row].std_m > 0.0 && points[row].is_none() {
                points[row] = Some(claim(3));
            }
        }
        Self { cameras, points, scales, shapes, offsets, of_cameras, size }
    }

    /// The sixteen parameters of each camera by the free parameters, in a matrix with so many rows.
    pub(super) fn spread(&self, rows: usize) -> DMatrix<f64> {
        let mut out = DMatrix::zeros(rows, self.size);
        for (camera, own) in self.cameras.iter().enumerate() {
            let Some(own) = own else { continue };
            for (direction, at) in own.basis.iter().zip(own.first..) {
                let row = CAMERA_PARAMETERS * camera;
                out.fixed_view_mut::<CAMERA_PARAMETERS, 1>(row, at).copy_from(direction);
            }
        }
        out
    }
}
