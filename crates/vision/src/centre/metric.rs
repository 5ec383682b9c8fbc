//! Which way clutter runs beside a ball: a rod or an arm that ends at it, an edge or a seam that goes on
//! behind it.
//!
//! A stationary Gaussian field of variance C whose correlation is exp(-½ dᵀ M d) has a gradient of covariance
//! C M (Adler 1981; Rasmussen & Williams 2006, §4.1), so that variance and structure tensor of what is seen
//! nearby determine the metric M: small along a line, large across it. Across, it is at most I/2w², that of
//! white noise blurred to the width w of an edge; where nothing but noise is seen it is that.

/// Pixels in each direction within which free pixels are looked for.
pub(super) const REACH: usize = 4;
/// Width of the neighbourhood, a Gaussian's standard deviation: half the reach, so that its end weighs e⁻².
const WINDOW_PX: f64 = 0.5 * REACH as f64;
/// Correlation of two pixels two apart below which they are as good as independent: e⁻⁴.
const LEAST_ALIKE: f64 = 0.018;

/// Clutter near a place: its variance and the metric of its correlation, xx, xy, yy, in 1/px².
#[derive(Debug, Clone, Copy)]
pub(super) struct Nearby {
    pub(super) variance: f64,
    pub(super) metric: [f64; 3],
}

impl Nearby {
    /// Correlation by displacement.
    pub(super) fn correlation(&self, (x, y): (f64, f64)) -> f64 {
        let [xx, xy, yy] = self.metric;
        (-0.5 * (xx * x * x + 2.0 * xy * x * y + yy * y * y)).exp()
    }
}

/// Products of a free pixel's gradient (xx, xy, yy), its square and its presence; all 0 where it or a
/// neighbour is not free.
type Moments = [f32; 5];

/// Working space.
#[derive(Debug, Clone, Default)]
pub(super) struct Course {
    moments: Vec<Moments>,
    /// Offsets of a neighbourhood and their weights.
    window: Vec<(usize, f32)>,
}

impl Course {
    /// Takes in the clutter at each free pixel, not a number elsewhere, in rows of `stride` with a margin of
    /// a reach around.
    #[inline(always)]
    pub(super) fn take(&mut self, left: &[f32], stride: usize) {
        self.moments.clear();
        self.moments.resize(left.len(), [0.0; 5]);
        let inner = stride + 1..left.len() - stride - 1;
        for i in inner {
            let x = 0.5 * (left[i + 1] - left[i - 1]);
            let y = 0.5 * (left[i + stride] - left[i - stride]);
            let here = left[i];
            if !(x + y + here).is_nan() {
                self.moments[i] = [x * x, x * y, y * y, here * here, 1.0];
            }
        }
        let reach = REACH as i32;
        self.window.clear();
        for (x, y) in (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (x, y))) {
            let square = f64::from(x * x + y * y);
            if square <= (REACH * REACH) as f64 {
                // From the corner of the square around.
                let offset = ((y + reach) as usize) * stride + (x + reach) as usize;
                self.window.push((offset, (-0.5 * square / (WINDOW_PX * WINDOW_PX)).exp() as f32));
            }
        }
    }

    /// Clutter around the pixel whose neighbourhood's corner is at `corner`; None where all is covered.
    #[inline(always)]
    pub(super) fn nearby(&self, corner: usize, edge_px: f64, noise_variance: f64) -> Option<Nearby> {
        let mut sum = [0.0_f32; 5];
        for (offset, weight) in &self.window {
            let moments = &self.moments[corner + offset];
            sum.iter_mut().zip(moments).for_each(|(sum, value)| *sum += weight * value);
        }
        let [xx, xy, yy, square, count] = sum.map(f64::from);
        let noise = noise_variance * count;
        let left = (square - noise).max(0.0);
        // A central difference halves the noise of the two.
        let tensor = [xx - 0.5 * noise, xy, yy - 0.5 * noise];
        let metric = metric_of(tensor, left, noise, edge_px);
        (count > 0.0).then(|| Nearby { variance: left / count, metric })
    }
}

/// The metric from sums of the gradient's products and of the clutter's squares, both less noise, together
/// with as much blurred white noise as there is noise: so much chance may add.
#[inline(always)]
fn metric_of([xx, xy, yy]: [f64; 3], square: f64, noise: f64, edge_px: f64) -> [f64; 3] {
    let most = 0.5 / (edge_px * edge_px);
    let blurred = differenced(most);
    let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
    let swing = half.hypot(xy);
    let along = |eigenvalue: f64| {
        let part = (eigenvalue.max(0.0) + noise * blurred) / (square + noise).max(f64::MIN_POSITIVE);
        (-0.5 * (1.0 - 2.0 * part).max(LEAST_ALIKE).ln()).min(most)
    };
    let (large, small) = (along(mean + swing), along(mean - swing));
    let (level, part) = (0.5 * (large + small), 0.5 * (large - small) / swing.max(f64::MIN_POSITIVE));
    [level + part * half, part * xy, level - part * half]
}

/// Mean square of a central difference over the variance, where correlation falls with exp(-½ m d²).
fn differenced(metric: f64) -> f64 {
    0.5 * (1.0 - (-2.0 * metric).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDE: usize = 2 * REACH + 9;

    fn metric_in(field: impl Fn(f64, f64) -> f64, noise_variance: f64) -> [f64; 3] {
        let mut left = vec![f32::NAN; WIDE * WIDE];
        for y in REACH..WIDE - REACH {
            for x in REACH..WIDE - REACH {
                left[y * WIDE + x] = field(x as f64, y as f64) as f32;
            }
        }
        let mut course = Course::default();
        course.take(&left, WIDE);
        let middle = WIDE / 2;
        course.nearby((middle - REACH) * WIDE + middle - REACH, 0.6, noise_variance).unwrap().metric
    }

    #[test]
    fn a_line_is_long() {
        let (sin, cos) = 0.5_f64.sin_cos();
        let middle = (WIDE / 2) as f64;
        let [xx, xy, yy] = metric_in(
            |x, y| {
                let across = cos * (y - middle) - sin * (x - middle);
                20.0 * (-across * across).exp()
            },
            0.1,
        );
        let along = cos * cos * xx + 2.0 * sin * cos * xy + sin * sin * yy;
        let across = sin * sin * xx - 2.0 * sin * cos * xy + cos * cos * yy;
        assert!(along < 0.05 && across > 0.5, "{along} {across}");
    }

    #[test]
    fn noise_is_as_short_as_the_blur() {
        let grain = |x: f64, y: f64| ((x * 12.9 + y * 78.2).sin() * 43_758.5).fract();
        let [xx, xy, yy] = metric_in(grain, 1e3);
        let most = 0.5 / 0.36;
        assert!((xx - most).abs() < 1e-9 && (yy - most).abs() < 1e-9 && xy.abs() < 1e-9, "{xx} {xy} {yy}");
    }

    #[test]
    fn a_field_of_known_correlation() {
        for m in [0.2, 0.8] {
            let got = metric_of([differenced(m), 0.0, differenced(0.05)], 1.0, 0.0, 0.3);
            assert!((got[0] - m).abs() < 1e-12 && got[1].abs() < 1e-12 && (got[2] - 0.05).abs() < 1e-12);
        }
    }
}
