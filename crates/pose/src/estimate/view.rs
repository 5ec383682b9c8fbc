//! One marker in one camera, as the iteration sees it.

use mavsight_geometry::{Matrix2, Vector2};
use std::borrow::Cow;

/// An observation with the inverse root of its covariance.
#[derive(Clone, Copy)]
pub(super) struct View {
    pub(super) camera: usize,
    pub(super) marker: usize,
    pub(super) pixel: Vector2<f64>,
    pub(super) whitener: Matrix2<f64>,
}

/// The observations of some markers: mostly of all.
pub(super) fn of_markers<'a>(views: &'a [View], markers: &[usize]) -> Cow<'a, [View]> {
    let wanted = |s: &View| markers.contains(&s.marker);
    if views.iter().all(wanted) {
        return Cow::Borrowed(views);
    }
    Cow::Owned(views.iter().copied().filter(wanted).collect())
}
