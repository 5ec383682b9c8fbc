//! The samples around a ball, whatever the layout of the frame, for the fit of its centre.

use crate::frame::{chroma_size, rgb_to_yuv};
use crate::{Frame, Pixels, Vector2};

/// One sample: place from the middle of the patch, values of its channels, and how far it is trusted (0 to 1).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    pub(crate) x_px: f64,
    pub(crate) y_px: f64,
    pub(crate) value: [f64; 3],
    pub(crate) trust: f64,
}

/// Channels that are sampled at the same places.
#[derive(Debug, Clone, Default)]
pub(crate) struct Group {
    pub(crate) samples: Vec<Sample>,
    /// How many entries of [`Sample::value`] are in use.
    pub(crate) channels: usize,
    /// Variance that the sampling aperture adds to the blur of each axis beyond that of a pixel.
    pub(crate) aperture_px2: f64,
    /// Each channel as a combination of coded red, green and blue, and a constant.
    pub(crate) from_coded: [[f64; 4]; 3],
    /// Working space of the fit.
    pub(crate) predicted: Vec<crate::centre::Predicted>,
    /// Working space of the fit.
    pub(crate) residuals: Vec<f64>,
}

/// The samples in a circle around a point. Reused from ball to ball, so that nothing is allocated once it has grown.
#[derive(Debug, Clone, Default)]
pub(crate) struct Patch {
    /// Full resolution (RGB, or luma alone), then half resolution (colour differences, or nothing).
    pub(crate) groups: [Group; 2],
    pub(crate) middle: Vector2<f64>,
}

/// Variance of the two-pixel box over which a colour difference is averaged, less that of a one-pixel box.
const CHROMA_APERTURE_PX2: f64 = (4.0 - 1.0) / 12.0;

impl Patch {
    /// Fills the patch with what the frame holds within `radius_px` of `middle`.
    pub(crate) fn fill(&mut self, frame: &Frame, middle: Vector2<f64>, radius_px: f64) {
        self.middle = middle;
        let width = frame.size.width_px as usize;
        let height = frame.size.height_px as usize;
        for group in &mut self.groups {
            group.samples.clear();
            group.aperture_px2 = 0.0;
            group.channels = 0;
        }
        let [fine, coarse] = &mut self.groups;
        let whole = Grid { columns: width, rows: height, step: 1.0, first: (0.0, 0.0) };
        match &frame.pixels {
            Pixels::Rgb(rgb) => {
                fine.channels = 3;
                fine.from_coded = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
                whole.visit(middle, radius_px, fine, |i| {
                    [0, 1, 2].map(|c| rgb.get(3 * i + c).map_or(0.0, |v| f64::from(*v)))
                });
            }
            Pixels::Yuv420 { y, u, v, full_range, matrix } => {
                let rows = rgb_to_yuv(*full_range, *matrix);
                fine.channels = 1;
                fine.from_coded[0] = rows[0];
                coarse.from_coded = [rows[1], rows[2], [0.0; 4]];
                whole.visit(middle, radius_px, fine, |i| [y.get(i).map_or(0.0, |v| f64::from(*v)), 0.0, 0.0]);
                coarse.channels = 2;
                coarse.aperture_px2 = CHROMA_APERTURE_PX2;
                let (columns, rows) = chroma_size(frame.size);
                // Between two rows; the fit adds the siting along the row.
                let half = Grid { columns, rows, step: 2.0, first: (0.0, 0.5) };
                half.visit(middle, radius_px, coarse, |i| {
                    let at = |plane: &[u8]| plane.get(i).map_or(128.0, |v| f64::from(*v));
                    [at(u), at(v), 0.0]
                });
            }
        }
    }
}

/// Where the samples of a plane lie.
struct Grid {
    columns: usize,
    rows: usize,
    step: f64,
    first: (f64, f64),
}

impl Grid {
    fn visit(
        &self,
        middle: Vector2<f64>,
        radius_px: f64,
        group: &mut Group,
        value: impl Fn(usize) -> [f64; 3],
    ) {
        let span = |centre: f64, first: f64, count: usize| {
            let from = ((centre - radius_px - first) / self.step).ceil().max(0.0) as usize;
            let to = ((centre + radius_px - first) / self.step).floor() + 1.0;
            from..(to.max(0.0) as usize).min(count)
        };
        for row in span(middle.y, self.first.1, self.rows) {
            let y_px = self.first.1 + self.step * row as f64 - middle.y;
            for column in span(middle.x, self.first.0, self.columns) {
                let x_px = self.first.0 + self.step * column as f64 - middle.x;
                if x_px * x_px + y_px * y_px <= radius_px * radius_px {
                    let value = value(row * self.columns + column);
                    group.samples.push(Sample { x_px, y_px, value, trust: 1.0 });
                }
            }
        }
    }
}
