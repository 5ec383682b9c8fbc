//! Random numbers for simulations, searches and tests, the same on every machine.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};
use rand_distr::{Distribution, Open01, StandardNormal};

/// A generator with a seed: ChaCha with eight rounds (Bernstein 2008), whose streams under one seed are
/// independent.
///
/// Give each simulated flight a stream of its own: its numbers then depend neither on the order of the
/// flights nor on the number of threads. It is not for secrets.
#[derive(Debug, Clone)]
pub struct Random(ChaCha8Rng);

impl Random {
    /// The stream of a number under a seed, from its beginning.
    pub fn new(seed: u64, stream: u64) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(stream);
        Self(generator)
    }

    /// 64 random bits.
    pub fn next_u64(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// A uniform number above 0 and below 1.
    pub fn uniform(&mut self) -> f64 {
        Open01.sample(&mut self.0)
    }

    /// A uniform number between two others.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// A standard normal number (ziggurat of Marsaglia & Tsang 2000).
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    /// Independent standard normal numbers.
    pub fn normals<const N: usize>(&mut self) -> [f64; N] {
        std::array::from_fn(|_| self.normal())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 200_000;

    /// Means of the first four powers, and of the product with the next number.
    fn moments(numbers: &[f64]) -> [f64; 5] {
        let mean = |f: &dyn Fn(usize) -> f64| (0..N - 1).map(f).sum::<f64>() / (N - 1) as f64;
        let power = |k: i32| mean(&|i| numbers[i].powi(k));
        [power(1), power(2), power(3), power(4), mean(&|i| numbers[i] * numbers[i + 1])]
    }

    fn assert_moments(numbers: &[f64], expected: [f64; 5], stds: [f64; 5]) {
        for ((found, expected), std) in moments(numbers).into_iter().zip(expected).zip(stds) {
            assert!((found - expected).abs() < 4.0 * std / (N as f64).sqrt(), "{found} is not {expected}");
        }
    }

    #[test]
    fn uniform_and_normal_numbers_have_their_moments() {
        let mut random = Random::new(1, 0);
        let uniform: Vec<f64> = (0..N).map(|_| random.uniform()).collect();
        assert!(uniform.iter().all(|x| *x > 0.0 && *x < 1.0));
        let centred: Vec<f64> = uniform.iter().map(|x| x - 0.5).collect();
        assert_moments(
            &centred,
            [0.0, 1.0 / 12.0, 0.0, 1.0 / 80.0, 0.0],
            [0.289, 0.0746, 0.0473, 0.0167, 0.0833],
        );
        let normal: Vec<f64> = (0..N).map(|_| random.normal()).collect();
        assert_moments(&normal, [0.0, 1.0, 0.0, 3.0, 0.0], [1.0, 1.414, 3.873, 9.798, 1.0]);
    }

    #[test]
    fn streams_are_independent_and_repeat() {
        let numbers = |seed, stream| -> Vec<f64> {
            let mut random = Random::new(seed, stream);
            (0..N).map(|_| random.normal()).collect()
        };
        let first = numbers(1, 0);
        assert_eq!(first, numbers(1, 0));
        for other in [numbers(1, 1), numbers(2, 0)] {
            let product: f64 = first.iter().zip(&other).map(|(a, b)| a * b).sum();
            assert!(product.abs() < 4.0 * (N as f64).sqrt(), "{product}");
        }
    }

    /// Figures of simulated campaigns can be compared from version to version only while the numbers stand.
    #[test]
    fn the_first_numbers_are_those_of_every_version() {
        let mut random = Random::new(1, 2);
        assert_eq!(random.next_u64(), 16_166_618_085_559_792_950);
        assert_eq!(random.uniform(), 0.682_740_861_531_275_9);
        assert!((random.normal() + 0.597_895_972_523_619_5).abs() < 1e-14);
    }
}
