//! How sharp a camera's picture is by the edges of the room, for a camera that sees no ball.

use mavsight_vision::Frame;

/// Rows that are looked at: one in so many.
const EVERY_ROW: usize = 3;

/// Pixels to either side of an edge between which its step is.
const REACH: usize = 7;

/// Least step of an edge, sRGB codes: ten times and more the noise of a picture.
const LEAST_STEP: f64 = 50.0;

/// Code from which a pixel may be clipped, which makes an edge look sharper.
const CLIPPED: f64 = 245.0;

/// Edges from which their sharpness is that of the picture.
const LEAST_EDGES: usize = 30;

/// Standard deviation of the blur of the sharper edges of a picture, in pixels, pixel included: of a step C that a
/// Gaussian of σ blurs the greatest slope is C/(σ √2π). The lower quartile, as edges that are no steps or are
/// oblique to the rows are wider; `None` for a picture with few edges.
pub fn edge_px(frame: &Frame) -> Option<f64> {
    let (width, height) = (frame.size.width_px as usize, frame.size.height_px as usize);
    let mut widths_px = Vec::new();
    for y in (1..height.saturating_sub(1)).step_by(EVERY_ROW) {
        // Three rows together have less noise.
        let light = |x: usize| (y - 1..=y + 1).map(|y| f64::from(frame.rgb(x, y)[1])).sum::<f64>() / 3.0;
        let row: Vec<f64> = (0..width).map(light).collect();
        widths_px.extend((REACH + 2..width.saturating_sub(REACH + 2)).filter_map(|x| edge(&row, x)));
    }
    if widths_px.len() < LEAST_EDGES {
        return None;
    }
    widths_px.sort_by(f64::total_cmp);
    widths_px.get(widths_px.len() / 4).copied()
}

/// The width of the edge that has its greatest slope at a place of a row.
fn edge(row: &[f64], x: usize) -> Option<f64> {
    let slope = |x: usize| 0.5 * (row[x + 1] - row[x - 1]);
    let around = x - REACH..=x + REACH;
    let own = slope(x).abs();
    let is_greatest = around.clone().all(|k| k == x || slope(k).abs() < own);
    let is_clipped = || row[x - REACH..=x + REACH].iter().any(|light| *light > CLIPPED);
    if !is_greatest || is_clipped() {
        return None;
    }
    let mean = |from: usize| row[from..from + 3].iter().sum::<f64>() / 3.0;
    let step = (mean(x + REACH - 2) - mean(x - REACH)).abs();
    (step > LEAST_STEP).then(|| step / (own * std::f64::consts::TAU.sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_vision::ImageSize;

    /// Stripes 40 px wide whose edges a smooth step of this width blurs.
    fn stripes(sigma_px: f64) -> Frame {
        let size = ImageSize { width_px: 320, height_px: 60 };
        let light = |x: f64| {
            let from_edge = (x % 80.0 - 40.0).abs() - 20.0;
            // The logistic function of this argument is within a hundredth of the normal distribution's.
            120.0 + 100.0 * (1.0 / (1.0 + (1.702 * from_edge / sigma_px).exp()) - 0.5)
        };
        let pixel = |k: usize| [light((k % 320) as f64) as u8; 3];
        Frame::from_rgb(size, (0..size.area_px()).flat_map(pixel).collect()).unwrap()
    }

    #[test]
    fn edges_are_as_wide_as_they_were_drawn() {
        for sigma_px in [1.0, 1.5, 2.0, 2.8] {
            let found_px = edge_px(&stripes(sigma_px)).expect("edges");
            assert!((found_px / sigma_px - 1.0).abs() < 0.25, "{sigma_px}: {found_px}");
        }
        let plain =
            Frame::from_rgb(ImageSize { width_px: 64, height_px: 48 }, vec![90; 3 * 64 * 48]).unwrap();
        assert_eq!(edge_px(&plain), None);
    }
}
