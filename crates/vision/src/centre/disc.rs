//! A disc with a soft edge.

use super::model::{EDGE, Model, RADIUS};

/// Middle, radius, and width of the edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct Disc {
    pub(super) x_px: f64,
    pub(super) y_px: f64,
    pub(super) radius_px: f64,
    pub(super) edge_px: f64,
}

impl Disc {
    pub(super) fn of(model: &Model) -> Self {
        let p = &model.p;
        Self { x_px: p[0], y_px: p[1], radius_px: p[RADIUS], edge_px: p[EDGE] }
    }
}
