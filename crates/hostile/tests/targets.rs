//! Each target ends on some thousand mutated inputs with a result or a typed error.

#![allow(clippy::unwrap_used, clippy::panic)]

use mavsight_hostile::{Kind, Outcome, TARGETS, Tally, Target, attempt, input};
use std::time::{Duration, Instant};

const SEED: u64 = 1;

/// Inputs of each target, and how long it is given for them: a slow machine tries fewer.
const INPUTS: u64 = 2000;
const GIVEN: Duration = Duration::from_millis(400);

/// So many are always tried of what is read, so that some of them are; an estimator may take long.
const LEAST: u64 = 200;

#[test]
fn what_is_right_is_read() {
    for target in TARGETS.iter().filter(|target| target.kind != Kind::Numbers) {
        let outcomes: Vec<Outcome> =
            (target.seeds)().iter().map(|seed| attempt(target, seed).unwrap()).collect();
        println!("{}: {outcomes:?}", target.name);
        assert!(outcomes.contains(&Outcome::Read), "{}: {outcomes:?}", target.name);
    }
}

fn attack(target: &Target) -> Tally {
    let begun = Instant::now();
    let least = if target.kind == Kind::Numbers { 1 } else { LEAST };
    Tally::of(target, SEED, 0..INPUTS, |number, _| number < least || begun.elapsed() < GIVEN)
}

#[test]
fn mutated_inputs_end_with_a_result_or_a_typed_error() {
    // Half of the list each.
    let tallies: Vec<(&Target, Tally)> = std::thread::scope(|scope| {
        let half = |of: usize| move || TARGETS.iter().skip(of).step_by(2).map(|t| (t, attack(t))).collect();
        let halves: Vec<std::thread::ScopedJoinHandle<'_, Vec<_>>> =
            (0..2).map(|of| scope.spawn(half(of))).collect();
        halves.into_iter().flat_map(|half| half.join().unwrap()).collect()
    });
    for (target, Tally { read, refused, panics, slowest }) in &tallies {
        println!("{}: {read} read, {refused} refused, slowest {slowest:?}", target.name);
        assert_eq!(panics, &[], "{}", target.name);
        // Attacks that are all refused at the first look, or never, attack nothing.
        let all = read + refused;
        let is_seen = *read > all / 50 && *refused > all / 50;
        assert!(is_seen || target.kind == Kind::Numbers, "{}: {read} read, {refused} refused", target.name);
    }
}

/// Targets and numbers of inputs that once ended in a panic, and what they hold.
const FOUND: [(&str, u64, &str); 3] = [
    ("equation-error", 76, "motion whose times run backwards"),
    ("equation-error", 124, "motion whose times run backwards"),
    ("bundle-adjustment", 81, "an uncertainty beyond the largest number"),
];

#[test]
fn what_once_ended_in_a_panic_is_refused() {
    for (name, number, what) in FOUND {
        let target = TARGETS.iter().find(|target| target.name == name).unwrap();
        let outcome = attempt(target, &input(target, &[], SEED, number));
        assert!(matches!(outcome, Ok(Outcome::Refused(_))), "{name} {number}, {what}: {outcome:?}");
    }
}

#[test]
fn names_are_unique() {
    for (k, target) in TARGETS.iter().enumerate() {
        assert!(TARGETS[..k].iter().all(|other| other.name != target.name), "{}", target.name);
    }
}
