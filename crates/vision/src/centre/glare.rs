//! What a lamp or a window behind a ball does to its rim.
//!
//! Light beyond what the sensor can show is coded as the brightest there is. How much more it is remains
//! unknown, so where it mixes with the ball's own the model would place the edge too far inside, by about a
//! width of the blur for a lamp ten times as bright: samples within the blur's reach of such light say
//! nothing of the edge.

use super::constants::{CLEAR, NOISE_STD};
use super::model::{EDGE, Parameters, RADIUS};
use crate::patch::Patch;

/// Codes from which light may be beyond the brightest: two standard deviations of a usual pixel's noise below
/// it.
const BRIGHTEST: f32 = 255.0 - 2.0 * NOISE_STD as f32;
/// Edge widths as far as such light reaches: a hundredfold's share of a Gaussian's tail is about a level
/// there.
const REACH_EDGES: f32 = 4.0;

/// Working space and result.
#[derive(Debug, Clone, Default)]
pub(super) struct Glare {
    /// Pixels of the patch that are as bright as there is.
    brightest: Vec<u32>,
    /// Places on the ball's edge behind which they are.
    edge: Vec<(f64, f64)>,
    /// Which pixels are reached; empty where none is.
    reached: Vec<bool>,
}

impl Glare {
    /// Looks for the brightest pixels of a new patch.
    #[inline(always)]
    pub(super) fn new(patch: &Patch) -> Self {
        let mut glare = Self::default();
        for (block, color) in patch.colors.iter().enumerate() {
            let first = patch.first_pixel(block);
            for pixel in (0..patch.step * patch.step)
                .map(|k| first + k / patch.step * patch.columns + k % patch.step)
                .filter(|pixel| is_brightest(patch, [patch.bright[*pixel], color[0], color[1]]))
            {
                glare.brightest.push(pixel as u32);
            }
        }
        glare
    }

    /// Finds the pixels that such light reaches past the disc. Where it is all around it takes of every side
    /// alike and leaves the centre in its place: then none counts as reached.
    pub(super) fn reach(&mut self, patch: &Patch, p: &Parameters, (covered, depth): (&[f32], &[f32])) {
        self.reached.clear();
        self.edge.clear();
        let is_beside = |i: usize| covered[i] < CLEAR && depth[i] > -REACH_EDGES;
        for i in self.brightest.iter().map(|i| *i as usize).filter(|i| is_beside(*i)) {
            let (x, y) = patch.place(i);
            let (x, y) = (x - p[0], y - p[1]);
            let inwards = p[RADIUS] / x.hypot(y).max(p[RADIUS]);
            self.edge.push((p[0] + inwards * x, p[1] + inwards * y));
        }
        let beside = (0..covered.len()).filter(|i| is_beside(*i)).count();
        if self.edge.is_empty() || self.edge.len() == beside {
            return;
        }
        let reach_px2 = (f64::from(REACH_EDGES) * p[EDGE]).powi(2);
        let is_near =
            |(x, y): (f64, f64)| self.edge.iter().any(|e| (e.0 - x).powi(2) + (e.1 - y).powi(2) < reach_px2);
        self.reached.extend((0..covered.len()).map(|i| depth[i] < REACH_EDGES && is_near(patch.place(i))));
    }

    /// Whether such light reaches a pixel.
    pub(super) fn reaches(&self, pixel: usize) -> bool {
        self.reached.get(pixel).copied().unwrap_or(false)
    }

    /// Whether it reaches a colour sample.
    pub(super) fn reaches_block(&self, patch: &Patch, block: usize) -> bool {
        !self.is_none() && self.reaches(patch.first_pixel(block))
    }

    /// Whether it reaches none.
    pub(super) fn is_none(&self) -> bool {
        self.reached.is_empty()
    }
}

/// Whether one of the codes of red, green and blue that these channels are may be beyond what can be shown.
#[inline(always)]
fn is_brightest(patch: &Patch, channels: [f32; 3]) -> bool {
    let [red, green, blue] = patch.coded(channels);
    (red > BRIGHTEST) | (green > BRIGHTEST) | (blue > BRIGHTEST)
}
