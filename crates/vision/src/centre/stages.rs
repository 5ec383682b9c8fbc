//! The stages of a fit that lie behind it when its samples are weighed.

use super::background::Background;
use super::layout::Layout;
use super::linearized::Linearized;
use crate::patch::Patch;

/// Layout, background and linear form of one step. Whatever takes this cannot be called before they are
/// there.
#[derive(Clone, Copy)]
pub(super) struct Stages<'a> {
    pub(super) patch: &'a Patch,
    pub(super) layout: &'a Layout,
    pub(super) background: &'a Background,
    pub(super) linearized: &'a Linearized,
}

impl Stages<'_> {
    /// Pixels in use by their place and number in the patch.
    pub(super) fn pixels(&self) -> impl Iterator<Item = (usize, usize)> + use<'_> {
        self.layout.used.iter().map(|pixel| *pixel as usize).enumerate()
    }

    /// Colour blocks in use, likewise.
    pub(super) fn blocks(&self) -> impl Iterator<Item = (usize, usize)> + use<'_> {
        self.layout.blocks.iter().map(|block| *block as usize).enumerate()
    }
}
