//! How far a track moves in its image.

use mavsight_geometry::Vector2;

/// What moves less in an image (root mean square) stands: half a pixel, which is more than centres err.
pub(crate) const STANDS_PX: f64 = 0.5;

/// Places in an image: their number, their mean, and how far they lie from it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Spread {
    count: usize,
    sum_px: Vector2<f64>,
    square_px2: f64,
}

impl Spread {
    pub(crate) fn add(&mut self, pixel: &Vector2<f64>) {
        self.count += 1;
        self.sum_px += pixel;
        self.square_px2 += pixel.norm_squared();
    }

    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// The mean of the places.
    pub(crate) fn middle(&self) -> Vector2<f64> {
        self.sum_px / self.count as f64
    }

    /// Root mean square distance from the mean.
    pub(crate) fn std_px(&self) -> f64 {
        (self.square_px2 / self.count as f64 - self.middle().norm_squared()).max(0.0).sqrt()
    }

    /// Whether what is seen stands.
    pub(crate) fn stands(&self) -> bool {
        self.std_px() < STANDS_PX
    }
}
