//! Parts of a flight: those that the inputs cover, and those without a gap.

use mavsight_flight::{InputSeries, Vehicle};
use mavsight_pose::{Motion, MotionSample, median};
use std::ops::Range;

/// Calls a function on a part of a motion alone. Nothing is copied: of a long flight a copy would be large.
pub(crate) fn with_part<T>(
    motion: &mut Motion,
    part: Range<usize>,
    of_part: impl FnOnce(&mut Motion) -> T,
) -> T {
    let after = motion.samples.split_off(part.end);
    let before: Vec<MotionSample> = motion.samples.drain(..part.start).collect();
    let result = of_part(motion);
    motion.samples.splice(0..0, before);
    motion.samples.extend(after);
    result
}

/// The longest part without a gap too long to interpolate: rotors depend on all that they did before.
pub(crate) fn longest_without_gap(motion: &Motion) -> Range<usize> {
    let longest_ns = (1e9 * motion.longest_step_s()) as i64;
    let mut parts = motion.samples.chunk_by(|a, b| b.t_ns - a.t_ns <= longest_ns).scan(0, |at, part| {
        let from = std::mem::replace(at, *at + part.len());
        Some(from..*at)
    });
    let first = parts.next().unwrap_or(0..0);
    parts.fold(first, |best, part| if part.len() > best.len() { part } else { best })
}

pub(crate) fn part_without_gap(part: &[MotionSample]) -> String {
    let (from_s, to_s) = span_s(part);
    format!(
        "Equation error has the flight from {from_s:.3} to {to_s:.3} s alone: next to it is a gap in which the motion is \
         not known."
    )
}

pub(crate) fn part_covered(inputs: &InputSeries, motion: &Motion) -> String {
    let (from_s, to_s) = span_s(&motion.samples);
    format!(
        "The inputs cover {:.3} to {:.3} s of a flight from {from_s:.3} to {to_s:.3} s: the parameters are of that part.",
        inputs.start_s(),
        inputs.end_s(),
    )
}

fn span_s(samples: &[MotionSample]) -> (f64, f64) {
    let t_s = |sample: Option<&MotionSample>| sample.map_or(0.0, |s| s.t_ns as f64 * 1e-9);
    (t_s(samples.first()), t_s(samples.last()))
}

/// Time without a row up to which none is noted as missing, at any rate: a person takes as long to react.
const LONG_S: f64 = 0.2;
/// Usual intervals up to which none is missing: of rows that come at random, as in a log of changes, one interval in
/// 2¹⁰ is longer than ten medians.
const MANY: f64 = 10.0;

/// A note on missing rows of inputs that were logged at an even rate; a log of changes has none.
pub(crate) fn held_long(inputs: &InputSeries) -> Option<String> {
    let times_s = inputs.times_s();
    let step_s = |w: &[f64]| w[1] - w[0];
    let usual_s = median(times_s.windows(2).map(step_s).collect())?;
    let longest = times_s.windows(2).max_by(|a, b| step_s(a).total_cmp(&step_s(b)))?;
    let (from, to) = (longest[0], longest[1]);
    if to - from <= LONG_S.max(MANY * usual_s) {
        return None;
    }
    Some(format!(
        "The inputs have no row from {from:.3} to {to:.3} s, where one every {usual_s:.3} s is usual: the last one counts as held."
    ))
}

/// Whether inputs of the vehicle's model move before a time.
pub(crate) fn moves_before(inputs: &InputSeries, vehicle: &Vehicle, t_ns: i64) -> bool {
    let before = inputs.times_s().partition_point(|t_s| *t_s < t_ns as f64 * 1e-9);
    let moves = |column: Vec<f64>| column[..before].iter().any(|value| *value != column[0]);
    vehicle.input_columns().into_iter().filter_map(|name| inputs.column(name)).any(moves)
}

/// That equation error takes the model's further states as in trim where they are not.
pub(crate) fn begun_in_flight(
    inputs: &InputSeries,
    motion: &[MotionSample],
    vehicle: &Vehicle,
) -> Option<String> {
    let first = motion.first().filter(|s| moves_before(inputs, vehicle, s.t_ns))?;
    let states = &vehicle.model.states;
    let further: Vec<&str> = states.iter().map(|s| s.name.as_str()).collect();
    let sizes: Vec<String> = states
        .iter()
        .map(|s| format!("{} {}", s.size, s.unit.map_or_else(String::new, |unit| unit.to_string())))
        .collect();
    (!further.is_empty()).then(|| {
        format!(
            "The inputs move before the first pose at {:.3} s, where equation error takes {} as in trim: its parameters are off. \
             Give poses from the flight's beginning, or take output error or filter error: they let each begin away from trim by its \
             `size` in the model ({}), which has to be what it is in flight.",
            first.t_ns as f64 * 1e-9,
            further.join(", "),
            sizes.join(", ")
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::{Isometry3, Vector3};
    use mavsight_pose::MotionCovariance;

    fn motion(frames: impl Iterator<Item = i64>) -> Motion {
        let sample = |k: i64| MotionSample {
            t_ns: k * 33_333_333,
            world_from_body: Isometry3::identity(),
            velocity_in_body_m_s: Vector3::zeros(),
            rates_rad_s: Vector3::zeros(),
            specific_force_m_s2: Vector3::zeros(),
            angular_acceleration_rad_s2: Vector3::zeros(),
            covariance: MotionCovariance::default(),
        };
        Motion {
            samples: frames.map(sample).collect(),
            unknown_ns: Vec::new(),
            doubts: mavsight_pose::Doubts::default(),
            translation_bandwidth_hz: 4.0,
            rotation_bandwidth_hz: 5.0,
            sample_interval_s: 1.0 / 30.0,
        }
    }

    #[test]
    fn the_longest_part_is_taken_out_and_put_back() {
        let mut motion = motion((0..40).chain(80..150).chain(152..170).chain(200..230));
        let before = motion.samples.clone();
        // Two frames that are missing are no gap; those before 80 and after 169 are.
        let longest = longest_without_gap(&motion);
        assert_eq!(longest, 40..128);
        assert!(part_without_gap(&motion.samples[longest.clone()]).contains("2.667 to 5.633 s"));
        let part = with_part(&mut motion, longest, |part| part.samples.clone());
        assert_eq!(part[..], before[40..128]);
        assert_eq!(motion.samples, before);
    }

    #[test]
    fn a_gap_in_an_even_log_is_noted_and_a_log_of_changes_has_none() {
        let inputs = |times_s: &mut dyn Iterator<Item = f64>| {
            InputSeries::new([], times_s.collect(), Vec::new()).expect("inputs")
        };
        let even = |k: i32| f64::from(k) * 0.01;
        assert_eq!(held_long(&inputs(&mut (0..500).map(even))), None);
        let note = held_long(&inputs(&mut (0..200).chain(400..500).map(even))).expect("a note");
        assert!(note.contains("from 1.990 to 4.000 s") && note.contains("0.010 s is usual"), "{note}");
        assert_eq!(held_long(&inputs(&mut [0.0, 2.0, 3.0, 5.5].into_iter())), None);
    }

    /// Poses that began in mid flight were taken as begun in trim: a time constant of 3 s came out as 29 ± 2.6.
    #[test]
    fn inputs_that_moved_before_the_first_pose_have_moved_the_aircraft() {
        let vehicle = Vehicle::paper();
        let own = vehicle.input_columns().into_iter().map(str::to_owned);
        // A column that the model does not have moves from the beginning.
        let columns: Vec<String> = own.chain(["battery_v".to_owned()]).collect();
        let moved_at = |moved: usize| {
            let times_s = (0..100).map(|k| f64::from(k) / 100.0).collect();
            let last = columns.len() - 1;
            let moves = |(k, column): (usize, usize)| {
                if column == last {
                    k as f64
                } else if k >= moved {
                    0.1
                } else {
                    0.0
                }
            };
            let values = (0..100).flat_map(|k| (0..=last).map(move |column| (k, column))).map(moves);
            InputSeries::new(columns.clone(), times_s, values.collect()).unwrap()
        };
        let motion = motion(15..30);
        let note = |inputs: &InputSeries| begun_in_flight(inputs, &motion.samples, &vehicle);
        assert_eq!(note(&moved_at(50)), None);
        let said = note(&moved_at(20)).unwrap();
        assert!(said.contains("before the first pose at 0.500 s") && said.contains("as in trim"), "{said}");
    }
}
