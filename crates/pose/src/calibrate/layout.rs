//! What an adjustment moves, and what moved objects say of it.

use super::adjust::Equations;
use super::model::CameraModel;
use super::moved::Moved;
use super::problem::{Choice, Problem};
use crate::moving::Reduced;
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, CameraChange, Isometry3, Vector3};
use nalgebra::DMatrix;

/// Where each free parameter stands.
#[derive(Clone)]
pub(super) struct Layout {
    pub(super) cameras: Vec<Option<Columns>>,
    pub(super) points: Vec<Option<usize>>,
    /// The moved objects' sizes, where they are not exact.
    pub(super) scales: Vec<Option<usize>>,
    /// Parameters of cameras and sizes, which come first.
    pub(super) of_cameras: usize,
    pub(super) size: usize,
}

/// The parameters of one camera.
#[derive(Clone)]
pub(super) struct Columns {
    pub(super) at: usize,
    pub(super) basis: Vec<CameraChange>,
    /// Columns of the model's basis that are held: those of the pose, where this camera's axes are the world's.
    pub(super) held: usize,
}

/// What is adjusted.
#[derive(Clone)]
pub(super) struct State {
    pub(super) cameras: Vec<Camera>,
    pub(super) places: Vec<Vector3<f64>>,
    pub(super) poses: Vec<Vec<Isometry3<f64>>>,
    pub(super) scales: Vec<f64>,
}

impl Layout {
    pub(super) fn new(problem: &Problem, choice: &Choice, models: &[CameraModel]) -> Self {
        let mut size = 0;
        let mut cameras = vec![None; problem.sizes.len()];
        let mut points = vec![None; problem.points.len()];
        let used = || (0..problem.sights.len()).filter(|k| choice.used[*k]);
        let sees = |camera: usize| {
            used().any(|k| problem.sights[k].camera == camera)
                || problem.moved.iter().any(|m| m.is_seen_by(camera))
        };
        for (camera, model) in models.iter().enumerate().filter(|(c, _)| sees(*c)) {
            let held = if problem.held == Some(camera) { 6 } else { 0 };
            let basis = model.basis().split_off(held);
            let at = size;
            size += basis.len();
            cameras[camera] = Some(Columns { at, basis, held });
        }
        let mut scales = vec![None; problem.moved.len()];
        for (at, _) in scales.iter_mut().zip(&problem.moved).filter(|(_, m)| m.scale_std > 0.0) {
            *at = Some(size);
            size += 1;
        }
        let of_cameras = size;
        for sight in used() {
            let row = choice.place[sight];
            if problem.points[row].std_m > 0.0 && points[row].is_none() {
                points[row] = Some(size);
                size += 3;
            }
        }
        Self { cameras, points, scales, of_cameras, size }
    }
}

/// The equations of one moved object: its poses follow the cameras, and are eliminated.
pub(super) fn add_moved(
    (problem, layout): (&Problem, &Layout),
    k: usize,
    state: &mut State,
    factor: f64,
    out: &mut Equations,
) -> Option<()> {
    let object: &Moved = &problem.moved[k];
    let shared = object.shared(&state.cameras, state.scales[k]);
    let mut reduced = Reduced::new(shared.rows());
    for (sights, pose) in object.sights.iter().zip(&mut state.poses[k]) {
        *pose = shared.settled(sights, pose, factor)?;
        reduced.add(&shared, (sights.as_slice(), pose), factor)?;
    }
    // From the rows of what is shared to the free parameters.
    let mut directions = DMatrix::zeros(shared.rows(), layout.size);
    for (camera, own) in layout.cameras.iter().enumerate() {
        let Some(own) = own else { continue };
        for (j, direction) in own.basis.iter().enumerate() {
            directions
                .fixed_view_mut::<CAMERA_PARAMETERS, 1>(CAMERA_PARAMETERS * camera, own.at + j)
                .copy_from(direction);
        }
    }
    if let Some(at) = layout.scales[k] {
        for (p, point) in object.body.iter().enumerate() {
            let row = shared.first_point() + 3 * p;
            directions.fixed_view_mut::<3, 1>(row, at).copy_from(&point.marker_in_body_m);
        }
        let off = (state.scales[k] - 1.0) / object.scale_std;
        out.normal[(at, at)] += object.scale_std.powi(-2);
        out.gradient[at] -= off / object.scale_std;
        out.prior += off * off;
        out.log_prior_weight -= object.scale_std.ln();
    }
    out.normal += directions.tr_mul(&reduced.normal) * &directions / factor;
    out.gradient += directions.tr_mul(&reduced.gradient) / factor;
    out.squares += reduced.loss;
    let of_poses = object.pose_parameters() * reduced.instants;
    out.moved.0 += reduced.coordinates;
    out.moved.1 += of_poses;
    out.moved.2 += reduced.log_determinant - of_poses as f64 * factor.ln();
    Some(())
}
