//! Where an object goes in the image.

use crate::Vector2;

/// Filters by what they take to be steady (1: the velocity, 2: the acceleration) and what a frame keeps of
/// the weight of those before it. Which of them predicts best shows in each flight: long memories rest while
/// it hovers, short ones follow while it turns.
const FILTERS: [(usize, f64); 5] = [(1, 0.0), (1, 0.5), (1, 0.8), (2, 0.3), (2, 0.5)];
/// What a frame keeps of the error that a filter was known for: manoeuvres begin within three frames.
const ERROR_KEPT: f64 = 0.7;

/// Motion of one object, predicted by filters of fading memory (Morrison 1969, ch. 13): polynomials that fit
/// all that was seen, the older the less, of which that which was off least of late is believed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Motion {
    filters: [Filter; FILTERS.len()],
    last_px: Vector2<f64>,
    /// Whether it was seen more than once.
    is_known: bool,
}

#[derive(Debug, Clone, Copy)]
struct Filter {
    pixel: Vector2<f64>,
    velocity_px: Vector2<f64>,
    /// Half of the acceleration.
    bend_px: Vector2<f64>,
    /// Mean square of how far the object was from where it was predicted; None before that was seen.
    error_px2: Option<f64>,
}

impl Filter {
    /// What a step from the last place says.
    fn of(from: Vector2<f64>, to: Vector2<f64>, frames: f64) -> Self {
        Self { pixel: to, velocity_px: (to - from) / frames, bend_px: Vector2::zeros(), error_px2: None }
    }

    fn predicted(&self, frames: f64) -> Vector2<f64> {
        self.pixel + self.velocity_px * frames + self.bend_px * (frames * frames)
    }

    /// Takes what the next frame shows.
    fn advance(&mut self, pixel: Vector2<f64>, (order, kept): (usize, f64)) {
        let predicted = self.predicted(1.0);
        let off = pixel - predicted;
        let square = off.norm_squared();
        self.error_px2 =
            Some(self.error_px2.map_or(square, |e| ERROR_KEPT * e + (1.0 - ERROR_KEPT) * square));
        let lost = 1.0 - kept;
        let (by_place, by_velocity, by_bend) = match order {
            1 => (1.0 - kept * kept, lost * lost, 0.0),
            _ => (1.0 - kept.powi(3), 1.5 * lost * lost * (1.0 + kept), 0.5 * lost.powi(3)),
        };
        self.pixel = predicted + off * by_place;
        self.velocity_px += self.bend_px * 2.0 + off * by_velocity;
        self.bend_px += off * by_bend;
    }
}

impl Motion {
    /// Of what was first seen here.
    pub(super) fn at(pixel: Vector2<f64>) -> Self {
        Self { filters: [Filter::of(pixel, pixel, 1.0); FILTERS.len()], last_px: pixel, is_known: false }
    }

    /// Takes the place where the object was seen so many frames after it was before; behind a gap all begins
    /// anew.
    pub(super) fn advance(&mut self, pixel: Vector2<f64>, frames: u32) {
        if self.is_known && frames == 1 {
            self.filters.iter_mut().zip(FILTERS).for_each(|(filter, kind)| filter.advance(pixel, kind));
        } else {
            self.filters = [Filter::of(self.last_px, pixel, f64::from(frames)); FILTERS.len()];
        }
        (self.last_px, self.is_known) = (pixel, true);
    }

    fn best(&self) -> &Filter {
        let off = |filter: &Filter| filter.error_px2.unwrap_or(0.0);
        let first = &self.filters[0];
        self.filters.iter().fold(first, |best, filter| if off(filter) < off(best) { filter } else { best })
    }

    /// Where the object is, so many frames after it was last seen.
    pub(super) fn predicted(&self, frames: u32) -> Vector2<f64> {
        self.best().predicted(f64::from(frames))
    }

    /// Whether a velocity is known.
    pub(super) fn is_known(&self) -> bool {
        self.is_known
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(frames: i32, at: impl Fn(f64) -> Vector2<f64>) -> Motion {
        let mut motion = Motion::at(at(0.0));
        (1..frames).for_each(|k| motion.advance(at(f64::from(k)), 1));
        motion
    }

    /// Numbers from -1 to 1 (Numerical Recipes' linear congruential generator).
    fn noise() -> impl FnMut() -> f64 {
        let mut state = 1_u32;
        move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state) / f64::from(1_u32 << 31) - 1.0
        }
    }

    #[test]
    fn straight_motion_is_predicted_at_once_and_bent_motion_soon() {
        let straight = |t: f64| Vector2::new(3.0 + 2.0 * t, 9.0 - 0.5 * t);
        assert!((after(2, straight).predicted(1) - straight(2.0)).norm() < 1e-12);
        assert!((after(2, straight).predicted(4) - straight(5.0)).norm() < 1e-12);
        assert_eq!(after(2, straight).best().error_px2, None);
        let bent = |t: f64| straight(t) + Vector2::new(0.1, 0.2) * (t * t);
        let motion = after(30, bent);
        assert!((motion.predicted(1) - bent(30.0)).norm() < 1e-6, "{motion:?}");
        assert!(motion.best().error_px2.is_some_and(|square| square < 1e-4));
    }

    #[test]
    fn noise_at_rest_is_averaged() {
        let (mut noise, mut before) = (noise(), Vector2::zeros());
        let mut motion = Motion::at(before);
        let (mut square, mut of_velocity) = (0.0, 0.0);
        for _ in 0..200 {
            let here = Vector2::new(noise(), noise());
            motion.advance(here, 1);
            square += motion.predicted(1).norm_squared();
            of_velocity += (here * 2.0 - before).norm_squared();
            before = here;
        }
        assert!(square < 0.25 * of_velocity, "{square} {of_velocity}");
    }

    #[test]
    fn behind_a_gap_it_goes_on_as_over_the_gap() {
        let mut motion = after(9, |t| Vector2::new(t * t, 0.0));
        motion.advance(Vector2::new(64.0, 6.0), 3);
        assert!((motion.predicted(2) - Vector2::new(64.0, 10.0)).norm() < 1e-12, "{motion:?}");
    }
}
