//! How far samples are believed: the less, the worse they fit.

use super::glare::Glare;
use super::stages::Stages;
use crate::patch::Patch;

/// Trust in each sample of a patch.
#[derive(Debug, Clone, Default)]
pub(super) struct Trust {
    pub(super) pixels: Vec<f32>,
    pub(super) blocks: Vec<f32>,
    /// Trust, less what its neighbours spoil.
    pub(super) weight: Vec<f32>,
    pub(super) block_weight: Vec<f32>,
    pub(super) glare: Glare,
}

impl Trust {
    /// Trusts every sample of a new patch.
    #[inline(always)]
    pub(super) fn new(patch: &Patch) -> Self {
        let (pixels, blocks) = (vec![1.0; patch.bright.len()], vec![1.0; patch.colors.len()]);
        Self {
            weight: pixels.clone(),
            block_weight: blocks.clone(),
            pixels,
            blocks,
            glare: Glare::new(patch),
        }
    }

    /// Part of the covered samples that is believed.
    pub(super) fn believed(&self, stages: &Stages<'_>) -> f64 {
        let (mut covered, mut believed) = (0.0, 0.0);
        for ((_, pixel), part) in stages.pixels().zip(&stages.linearized.values.covered) {
            covered += part;
            believed += part * self.pixels[pixel];
        }
        f64::from(believed / covered)
    }

    /// Sets the weights by the trust. An occluder is no sharper than its blur, so neighbours of a sample that
    /// is not believed at all are not believed either.
    pub(super) fn weigh(&mut self, patch: &Patch, spoiled: &[u32]) {
        self.weight.clone_from(&self.pixels);
        self.block_weight.clone_from(&self.blocks);
        for index in spoiled {
            let (x, y) = (*index as usize % patch.columns, *index as usize / patch.columns);
            for (column, row) in [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)] {
                if column >= patch.columns || row >= patch.rows {
                    continue;
                }
                let neighbour = row * patch.columns + column;
                self.weight[neighbour] = 0.0;
                if patch.step == 1 {
                    self.block_weight[neighbour] = 0.0;
                }
            }
        }
        self.forget_dazzled(patch);
    }

    /// Takes the weight of the samples that the brightest light reaches.
    pub(super) fn forget_dazzled(&mut self, patch: &Patch) {
        if self.glare.is_none() {
            return;
        }
        for pixel in (0..self.weight.len()).filter(|i| self.glare.reaches(*i)) {
            self.weight[pixel] = 0.0;
        }
        for block in (0..self.block_weight.len()).filter(|b| self.glare.reaches_block(patch, *b)) {
            self.block_weight[block] = 0.0;
        }
    }
}
