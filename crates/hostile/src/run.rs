//! Inputs by their numbers, and how they end.

use crate::{Mutator, Outcome, Target};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The input of a number under a seed, from the target's own small inputs. It depends on nothing else, so that
/// a fault is found again by these three.
pub fn input(target: &Target, seeds: &[Vec<u8>], seed: u64, number: u64) -> Vec<u8> {
    let mut mutator = Mutator::new(seed, number);
    let mut bytes = mutator.mutated(target.kind, seeds);
    if let Some(repair) = target.repair
        && !mutator.chance(4)
    {
        bytes = repair(bytes);
    }
    bytes
}

/// Where the newest panic of any thread was.
static PLACE: Mutex<String> = Mutex::new(String::new());

/// Keeps panics from the standard error and remembers where they were, for [`attempt`].
pub fn remember_panics() {
    std::panic::set_hook(Box::new(|panic| {
        let place = panic.location().map_or_else(String::new, ToString::to_string);
        *PLACE.lock().unwrap_or_else(PoisonError::into_inner) = place;
    }));
}

/// Runs a target on an input; `Err` has the words of a panic, and its place if those are remembered.
///
/// # Errors
/// The target has panicked.
pub fn attempt(target: &Target, bytes: &[u8]) -> Result<Outcome, String> {
    catch_unwind(AssertUnwindSafe(|| (target.run)(bytes))).map_err(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no words");
        format!("{text} {}", PLACE.lock().unwrap_or_else(PoisonError::into_inner))
    })
}

/// How many inputs ended how.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Tally {
    /// With a result.
    pub read: u64,
    /// With a typed error.
    pub refused: u64,
    /// Numbers of the inputs that panicked, with the words.
    pub panics: Vec<(u64, String)>,
    /// The slowest, with its number.
    pub slowest: (Duration, u64),
}

impl Tally {
    /// Runs a target on the inputs of some numbers, until it is to end.
    pub fn of(
        target: &Target,
        seed: u64,
        numbers: impl Iterator<Item = u64>,
        mut goes_on: impl FnMut(u64, &Self) -> bool,
    ) -> Self {
        let seeds = (target.seeds)();
        let mut tally = Self::default();
        for number in numbers {
            if !goes_on(number, &tally) {
                break;
            }
            let bytes = input(target, &seeds, seed, number);
            let begun = Instant::now();
            match attempt(target, &bytes) {
                Ok(Outcome::Read) => tally.read += 1,
                Ok(Outcome::Refused(_)) => tally.refused += 1,
                Err(words) => tally.panics.push((number, words)),
            }
            tally.slowest = tally.slowest.max((begun.elapsed(), number));
        }
        tally
    }
}
