//! A part of an image.

use crate::{Frame, Vector2};
use std::ops::Range;

/// Rectangle of pixels, ends not included.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Window {
    pub(crate) columns: Range<usize>,
    pub(crate) rows: Range<usize>,
}

impl Window {
    pub(crate) fn whole(frame: &Frame) -> Self {
        Self { columns: 0..frame.size.width_px as usize, rows: 0..frame.size.height_px as usize }
    }

    /// A square around a point, cut to the image.
    pub(crate) fn around(frame: &Frame, middle: Vector2<f64>, reach_px: f64) -> Self {
        let span = |centre: f64, count: u32| {
            let from = (centre - reach_px).floor().clamp(0.0, f64::from(count)) as usize;
            let to = ((centre + reach_px).ceil() + 1.0).clamp(0.0, f64::from(count)) as usize;
            from..to.max(from)
        };
        Self { columns: span(middle.x, frame.size.width_px), rows: span(middle.y, frame.size.height_px) }
    }
}
