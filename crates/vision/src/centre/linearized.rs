//! Third stage of a fit: what the model shows at each sample in use, its derivatives, and the residuals.

use super::background::Background;
use super::lanes::GROUP;
use super::layout::Layout;
use super::model::{
    EDGE, Model, NO_COLUMNS, NOTHING, RESIDUAL, Row, SITING, Shown, Values, WIDTH, add_scaled,
};
use super::samples::parts;
use crate::patch::Patch;
use pulp::Simd;

/// Residuals and derivatives where the model is.
#[derive(Debug, Clone, Default)]
pub(super) struct Linearized {
    /// What each pixel in use and each that is shared shows, and its derivatives; behind those of the
    /// brightness of each pixel in use its residual.
    pub(super) values: Values,
    pub(super) shown: Vec<Shown>,
    /// Derivatives of both colours of each block, means over its pixels, and the residuals behind them.
    pub(super) color_rows: Vec<[Row; 2]>,
    /// Width of the model's edge.
    pub(super) edge_px: f64,
}

impl Linearized {
    /// Forms them in the buffers of an earlier one.
    #[inline(always)]
    pub(super) fn at<S: Simd>(
        mut self,
        simd: S,
        patch: &Patch,
        (layout, background): (&Layout, &Background),
        model: &Model,
    ) -> Self {
        let pixels = layout.used.len() + layout.shared.len();
        self.edge_px = model.p[EDGE];
        self.shown.resize(pixels, NOTHING);
        self.values.make_room(pixels);
        let mut columns = NO_COLUMNS;
        for (group, shown) in self.shown.chunks_mut(GROUP).enumerate() {
            let (places, out) = ((&background.places, GROUP * group), (shown, &mut self.values));
            model.show(simd, places, &patch.from_coded, &mut columns, out);
        }
        let constant = patch.from_coded.map(|row| row[3] as f32);
        self.color_rows.clear();
        for block in &layout.blocks {
            let (values, mut rows) =
                self.color_of(patch, (layout, background), *block as usize, model.p[SITING]);
            let seen = patch.colors[*block as usize];
            for (k, row) in rows.iter_mut().enumerate() {
                row[RESIDUAL] = seen[k] - values[k] - constant[k + 1];
            }
            self.color_rows.push(rows);
        }
        let seen = layout.used.iter().map(|pixel| patch.bright[*pixel as usize]);
        for ((shown, seen), value) in self.shown.iter_mut().zip(seen).zip(&self.values.channels[0]) {
            shown[0][RESIDUAL] = seen - value - constant[0];
        }
        self
    }

    /// Colour differences of a block, less their constants, and their derivatives.
    #[inline(always)]
    fn color_of(
        &self,
        patch: &Patch,
        (layout, background): (&Layout, &Background),
        block: usize,
        siting_px: f64,
    ) -> ([f32; 2], [Row; 2]) {
        let channels = &self.values.channels;
        let (mut values, mut rows) = ([0.0; 2], [[0.0; WIDTH]; 2]);
        for part in parts(patch, block, siting_px).into_iter().flatten() {
            let shown = match layout.place(part.pixel) {
                Some(place) => {
                    for (row, channel) in rows.iter_mut().zip(&self.shown[place][1..]) {
                        add_scaled(row, channel, part.weight);
                    }
                    [channels[1][place], channels[2][place]]
                }
                None => {
                    let free = background.colors_at(patch.place(part.pixel));
                    [0, 1].map(|k| (free[k] - patch.from_coded[k + 1][3]) as f32)
                }
            };
            for ((value, row), shown) in values.iter_mut().zip(&mut rows).zip(shown) {
                *value += part.weight * shown;
                row[SITING] += part.by_siting * shown;
            }
        }
        (values, rows)
    }
}
