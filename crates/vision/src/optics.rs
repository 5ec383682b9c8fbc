//! What all balls in all frames of one camera share: the lens's blur and where the encoder puts its colour
//! samples.

/// Mean and variance of something that is known more or less.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Known {
    pub(crate) mean: f64,
    pub(crate) variance: f64,
}

/// Standard deviation by which the blur of one ball differs from the camera's: motion of nine tenths of a
/// pixel (a box of that width has a standard deviation of 0.26 px) beside a lens of 0.6 px, or as much of
/// defocus.
const EDGE_OF_ONE_STD_PX: f64 = 0.05;
/// Standard deviation of the camera's blur from one detection to the next, as focus and exposure drift.
const EDGE_DRIFT_PX: f64 = 0.002;
/// What encoders do: colour samples at the left pixel of their pair (H.264's default) or between the two
/// (JFIF, MPEG-1 and what many converters really do).
const SITINGS_PX: [f64; 2] = [0.0, 0.5];
/// Standard deviation of what a real encoder's filter, not quite a box, and clutter do to the siting that
/// many fits show.
const SITING_OF_ALL_STD_PX: f64 = 0.1;
/// How close a filter that is one of the two comes to it.
const SITING_STD_PX: f64 = 0.02;
/// Odds at which one of the two is believed.
const ODDS: f64 = 100.0;

/// What all balls in all frames of one camera share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Optics {
    /// Columns by which colour differences lie to the right of the left pixel of their pair.
    pub(crate) siting_px: Known,
    /// Standard deviation of the blur, pixel included.
    pub(crate) edge_px: Known,
}

impl Default for Optics {
    /// Siting halfway between the two customs and as uncertain; a lens about as sharp as a pixel, with room
    /// for a soft one and for motion of a pixel or two.
    fn default() -> Self {
        Self {
            siting_px: Known { mean: 0.25, variance: 0.25 * 0.25 },
            edge_px: Known { mean: 0.6, variance: 0.25 * 0.25 },
        }
    }
}

/// The optics of one camera, from what every fit adds to them.
#[derive(Debug, Clone, Default)]
pub(crate) struct Learned {
    camera: Optics,
}

impl Learned {
    /// What the next fit may take as known.
    pub(crate) fn expected(&self) -> Optics {
        let edge = self.camera.edge_px;
        Optics {
            siting_px: one_of_two(self.camera.siting_px),
            edge_px: Known { variance: edge.variance + EDGE_OF_ONE_STD_PX.powi(2), ..edge },
        }
    }

    /// Adds what a fit found beyond what it took as known.
    pub(crate) fn learn(&mut self, taken: Optics, found: Optics) {
        if let Some(siting) = added(taken.siting_px, found.siting_px) {
            self.camera.siting_px = together(self.camera.siting_px, siting);
        }
        if let Some(edge) = added(taken.edge_px, found.edge_px) {
            let now = self.camera.edge_px;
            let drifted = Known { variance: now.variance + EDGE_DRIFT_PX.powi(2), ..now };
            let of_camera = Known { variance: edge.variance + EDGE_OF_ONE_STD_PX.powi(2), ..edge };
            self.camera.edge_px = together(drifted, of_camera);
        }
    }
}

/// The measurement that leads from prior to posterior; None if it adds nothing.
fn added(prior: Known, posterior: Known) -> Option<Known> {
    let information = posterior.variance.recip() - prior.variance.recip();
    // Below a thousandth of the prior's information the difference is rounding.
    (information * prior.variance > 1e-3).then(|| Known {
        mean: (posterior.mean / posterior.variance - prior.mean / prior.variance) / information,
        variance: information.recip(),
    })
}

/// Two independent estimates combined.
fn together(a: Known, b: Known) -> Known {
    let variance = (a.variance.recip() + b.variance.recip()).recip();
    Known { mean: variance * (a.mean / a.variance + b.mean / b.variance), variance }
}

/// The one of the two customs that the estimate clearly points to, else the estimate.
fn one_of_two(siting: Known) -> Known {
    let variance = siting.variance + SITING_OF_ALL_STD_PX.powi(2);
    let square = SITINGS_PX.map(|custom| (siting.mean - custom).powi(2) / variance);
    let odds = (0.5 * (square[0] - square[1]).abs()).exp();
    let nearer = if square[0] < square[1] { 0 } else { 1 };
    if odds > ODDS && square[nearer] < 4.0 {
        Known { mean: SITINGS_PX[nearer], variance: SITING_STD_PX.powi(2) }
    } else {
        Known { variance, ..siting }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fit_of(truth: f64, std: f64, taken: Known) -> Known {
        together(taken, Known { mean: truth, variance: std * std })
    }

    #[test]
    fn a_fit_adds_what_it_measured() {
        let prior = Known { mean: 0.3, variance: 0.04 };
        let measured = Known { mean: 0.7, variance: 0.09 };
        let back = added(prior, together(prior, measured)).expect("it adds");
        assert!((back.mean - 0.7).abs() < 1e-12 && (back.variance - 0.09).abs() < 1e-12);
        assert_eq!(added(prior, prior), None);
    }

    #[test]
    fn the_custom_is_found_though_every_fit_is_off_by_a_tenth() {
        for (truth, custom) in [(0.4, 0.5), (0.1, 0.0)] {
            let mut learned = Learned::default();
            for _ in 0..100 {
                let taken = learned.expected();
                let found = Optics { siting_px: fit_of(truth, 0.2, taken.siting_px), ..taken };
                learned.learn(taken, found);
            }
            assert_eq!(learned.expected().siting_px.mean, custom);
        }
    }

    #[test]
    fn what_lies_between_the_customs_is_taken_as_it_is() {
        let mut learned = Learned::default();
        for _ in 0..100 {
            let taken = learned.expected();
            let found = Optics { siting_px: fit_of(0.25, 0.2, taken.siting_px), ..taken };
            learned.learn(taken, found);
        }
        let siting = learned.expected().siting_px;
        assert!((siting.mean - 0.25).abs() < 0.01 && siting.variance >= 0.01);
    }

    #[test]
    fn the_blur_of_one_ball_remains_less_known_than_the_cameras() {
        let mut learned = Learned::default();
        for _ in 0..200 {
            let taken = learned.expected();
            let found = Optics { edge_px: fit_of(0.8, 0.05, taken.edge_px), ..taken };
            learned.learn(taken, found);
        }
        let edge = learned.expected().edge_px;
        assert!((edge.mean - 0.8).abs() < 0.01);
        assert!(
            edge.variance > EDGE_OF_ONE_STD_PX.powi(2) && learned.camera.edge_px.variance < 0.02_f64.powi(2)
        );
    }
}
