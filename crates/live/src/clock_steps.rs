//! Clocks of cameras that are set while they film.

use mavsight_pose::MAD_TO_STD;
use std::collections::VecDeque;

/// Frames by which it is known how regularly a camera's frames are stamped and arrive: a second of video.
const KEPT: usize = 31;
/// Standard deviations beyond which a stamp leaves the beat of those before it: more is noise once in five hundred million frames.
const GATE: f64 = 6.0;
/// Logarithm of the odds, 999 to 1, at which it was the clock and not the camera that left the beat.
const DECISIVE_LOG_ODDS: f64 = 6.907;
/// A stamp in whole milliseconds is off by up to this.
const RESOLUTION_NS: f64 = 1e6;

/// Standard deviations of arrivals from which on a step shows in two frames: one in its beat gives half of the decisive odds by
/// Student's density, 2 ln(1 + 3.7²/3) = 3.4.
const CLEAR: f64 = 3.7;
/// Frames within which it is decided what it was.
const MOST_FRAMES: u32 = 8;
/// Degrees of freedom of Student's density, as which arrivals are distributed: some are very late (Lange, Little & Taylor 1989).
const ARRIVAL_DEGREES: f64 = 3.0;
/// Frames over which the time on the way is averaged where stamps are in whole milliseconds: a minute of video.
const LONG: f64 = 1800.0;

/// A camera's time stamps, by its clock as it was at first.
///
/// Where the frames go on to arrive in their beat while the stamps leave theirs, once and by as much as each stamp since
/// then is nearer to its arrival or farther from it, it is the clock that was set. By how much is known as well as one
/// interval is from the next. What is late on its way arrives late with a stamp in the beat; what is filmed late
/// arrives late with its stamp; a step by whole intervals, which looks like frames that are missing or out of order, is
/// not corrected, nor is one that is small beside how unevenly frames arrive.
#[derive(Debug)]
pub(crate) struct ClockSteps {
    /// By how much the clock is ahead of what it was at first.
    ahead_ns: i64,
    /// Latest stamps, corrected, and the time from each to its arrival.
    latest_ns: VecDeque<(i64, i64)>,
    /// That time in the long run.
    usual: Option<Usual>,
    suspected: Option<Suspected>,
}

impl Default for ClockSteps {
    fn default() -> Self {
        Self { ahead_ns: 0, latest_ns: VecDeque::with_capacity(KEPT), usual: None, suspected: None }
    }
}

/// When a frame was filmed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Stamped {
    /// Its stamp by the clock as it was at first; none where it is open whether that was set.
    pub(crate) stamp_ns: Option<i64>,
    /// By how much the clock is found to have been set.
    pub(crate) step_ns: Option<i64>,
}

/// What is expected of the next frame by the latest ones.
struct Expected {
    last_ns: i64,
    interval_ns: i64,
    /// How far a stamp may be from what is expected.
    uneven_ns: f64,
    beat: Beat,
}

/// The time from a stamp to its arrival, and its standard deviation beside the interval's.
#[derive(Debug, Clone, Copy)]
struct Beat {
    underway_ns: i64,
    std_ns: f64,
}

/// The time from a stamp to its arrival in the long run, and its variance.
#[derive(Debug, Clone, Copy)]
struct Usual {
    underway_ns: f64,
    variance_ns2: f64,
}

/// A step that a stamp shows, while it is open whether it is the clock's.
#[derive(Debug, Clone, Copy)]
struct Suspected {
    step_ns: i64,
    beat: Beat,
    frames: u32,
    /// Of a clock that was set against a camera that filmed out of its beat.
    log_odds: f64,
}

impl ClockSteps {
    /// When the next frame was filmed.
    pub(crate) fn stamped(&mut self, stamp_ns: i64, received_ns: i64) -> Stamped {
        if let Some(by_ns) = self.corrected_in_vain() {
            self.latest_ns.iter_mut().for_each(|frame| *frame = (frame.0 - by_ns, frame.1 + by_ns));
            (self.ahead_ns, self.suspected) = (0, None);
            return self.keep(stamp_ns, received_ns, Some(by_ns));
        }
        let own_ns = stamp_ns - self.ahead_ns;
        let underway_ns = received_ns - own_ns;
        let Some(mut suspected) = self.suspected.take().or_else(|| self.suspect(own_ns)) else {
            return self.keep(own_ns, received_ns, None);
        };
        suspected.weigh(underway_ns);
        let step_ns = suspected.step_ns;
        if suspected.log_odds >= DECISIVE_LOG_ODDS && self.is_news(step_ns, underway_ns) {
            self.ahead_ns += step_ns;
            return self.keep(own_ns - step_ns, received_ns, Some(step_ns));
        }
        if suspected.frames >= MOST_FRAMES {
            return self.keep(own_ns, received_ns, None);
        }
        self.suspected = Some(suspected);
        let is_of_camera = suspected.log_odds <= -DECISIVE_LOG_ODDS;
        Stamped { stamp_ns: is_of_camera.then_some(own_ns), step_ns: None }
    }

    /// The step back to the clock as it was at first, where most frames of a second arrived as they do in the long run by
    /// stamps that are not corrected, and not by those that are: when the clock was right again arrivals were too uneven to show it.
    fn corrected_in_vain(&self) -> Option<i64> {
        if self.ahead_ns == 0 {
            return None;
        }
        let Beat { underway_ns, std_ns } = self.expected()?.beat;
        let is_clear = self.ahead_ns.abs() as f64 >= CLEAR * std_ns;
        (is_clear && self.is_news(-self.ahead_ns, underway_ns)).then_some(-self.ahead_ns)
    }

    fn keep(&mut self, corrected_ns: i64, received_ns: i64, step_ns: Option<i64>) -> Stamped {
        if self.latest_ns.len() == KEPT {
            self.latest_ns.pop_front();
        }
        self.latest_ns.push_back((corrected_ns, received_ns - corrected_ns));
        Stamped { stamp_ns: Some(corrected_ns), step_ns }
    }

    fn expected(&self) -> Option<Expected> {
        let (last_ns, _) = *self.latest_ns.back().filter(|_| self.latest_ns.len() == KEPT)?;
        let stamps_ns = || self.latest_ns.iter().map(|f| f.0);
        let apart_ns = stamps_ns().skip(1).zip(stamps_ns()).map(|(to, from)| to - from);
        let (interval_ns, interval_std_ns) = middle_and_std(apart_ns);
        let (underway_ns, late_std_ns) = middle_and_std(self.latest_ns.iter().map(|f| f.1));
        let std_ns = late_std_ns.hypot(interval_std_ns).max(RESOLUTION_NS / GATE);
        Some(Expected {
            last_ns,
            interval_ns,
            uneven_ns: (GATE * interval_std_ns).max(RESOLUTION_NS),
            beat: Beat { underway_ns, std_ns },
        })
    }

    /// A step, where a stamp is not in the beat, and no frames that are missing, come twice or out of order make it so.
    fn suspect(&mut self, own_ns: i64) -> Option<Suspected> {
        let Expected { last_ns, interval_ns, uneven_ns, beat } = self.expected()?;
        self.usual = Some(Usual::with(self.usual, beat));
        let suspected = |step_ns| Some(Suspected { step_ns, beat, frames: 0, log_odds: 0.0 });
        let step_ns = own_ns - last_ns - interval_ns;
        // To within what frames are uneven the clock is right again.
        if self.ahead_ns != 0 && (self.ahead_ns + step_ns).abs() as f64 <= uneven_ns {
            return suspected(-self.ahead_ns);
        }
        let off_whole_ns = step_ns.rem_euclid(interval_ns.max(1));
        let is_whole = off_whole_ns.min(interval_ns - off_whole_ns) as f64 <= uneven_ns;
        let is_too_soon = own_ns > last_ns && (-step_ns) as f64 > uneven_ns;
        let is_clear = step_ns.abs() as f64 >= CLEAR * beat.std_ns;
        if is_clear && (!is_whole || is_too_soon) { suspected(step_ns) } else { None }
    }

    /// Whether a step leads nearer to the time on the way in the long run: after a step that was not seen the clock is right
    /// again by what another one seems.
    fn is_news(&self, step_ns: i64, underway_ns: i64) -> bool {
        let usual_ns = self.usual.map_or(0.0, |usual| usual.underway_ns);
        let from_usual_ns = |ns: i64| (usual_ns - ns as f64).abs();
        from_usual_ns(underway_ns + step_ns) < from_usual_ns(underway_ns)
    }
}

impl Usual {
    /// After another second of frames: a level that wanders slowly (Harvey 1989, section 2.3), so that seconds in which frames
    /// arrive unevenly hardly count.
    fn with(before: Option<Self>, beat: Beat) -> Self {
        let (found_ns, found_ns2) = (beat.underway_ns as f64, beat.std_ns * beat.std_ns);
        let Some(Self { underway_ns, variance_ns2 }) = before else {
            return Self { underway_ns: found_ns, variance_ns2: found_ns2 };
        };
        let wandered_ns2 = variance_ns2 + (RESOLUTION_NS / LONG).powi(2);
        let gain = wandered_ns2 / (wandered_ns2 + found_ns2);
        // What is beyond chance counts as much as chance allows (Huber 1981).
        let news_ns = (found_ns - underway_ns).clamp(-beat.std_ns, beat.std_ns);
        Self { underway_ns: underway_ns + gain * news_ns, variance_ns2: wandered_ns2 * (1.0 - gain) }
    }
}

impl Suspected {
    fn weigh(&mut self, underway_ns: i64) {
        let surprise = |ns: i64| {
            let off = (ns - self.beat.underway_ns) as f64 / self.beat.std_ns;
            0.5 * (ARRIVAL_DEGREES + 1.0) * (off * off / ARRIVAL_DEGREES).ln_1p()
        };
        self.log_odds += surprise(underway_ns) - surprise(underway_ns + self.step_ns);
        self.frames += 1;
    }
}

/// Median, and the standard deviation that the median absolute deviation from it is of (Huber 1981, section 5.1).
fn middle_and_std(values_ns: impl Iterator<Item = i64>) -> (i64, f64) {
    let middle = |values_ns: &mut Vec<i64>| {
        let at = values_ns.len() / 2;
        *values_ns.select_nth_unstable(at).1
    };
    let mut values_ns: Vec<i64> = values_ns.collect();
    let middle_ns = middle(&mut values_ns);
    values_ns.iter_mut().for_each(|value_ns| *value_ns = (*value_ns - middle_ns).abs());
    (middle_ns, MAD_TO_STD * middle(&mut values_ns) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_random::Random;

    const INTERVAL: i64 = 33_333_333;

    /// A camera at 30 Hz whose frames arrive 5 ms and up to 1 ms more after they were filmed.
    struct Film {
        steps: ClockSteps,
        random: Random,
        number: i64,
    }

    impl Film {
        fn new() -> Self {
            let mut film = Self { steps: ClockSteps::default(), random: Random::new(3, 0), number: 0 };
            (0..40).for_each(|_| assert_eq!(film.next(0, 0, 0).1, None));
            film
        }

        /// How far the next frame's stamp is from the time at which it was filmed, and the step; filmed late and on its way
        /// for longer than others.
        fn next(
            &mut self,
            ahead_ns: i64,
            filmed_late_ns: i64,
            underway_ns: i64,
        ) -> (Option<i64>, Option<i64>) {
            self.number += 1;
            let jitter_ns = (1e5 * self.random.normal()) as i64;
            let filmed_ns = self.number * INTERVAL + filmed_late_ns;
            let arrives_ns = filmed_ns + 5_000_000 + underway_ns + (1e6 * self.random.uniform()) as i64;
            let Stamped { stamp_ns, step_ns } =
                self.steps.stamped(filmed_ns + jitter_ns + ahead_ns, arrives_ns);
            (stamp_ns.map(|ns| ns - filmed_ns), step_ns)
        }
    }

    fn is_right(off_ns: &Option<i64>) -> bool {
        off_ns.is_some_and(|ns| ns.abs() < 1_000_000)
    }

    #[test]
    fn a_clock_that_is_set_and_right_again_is_corrected_both_times() {
        for ahead_ns in [
            3_000_000,
            -4_000_000,
            12_000_000,
            -20_000_000,
            -32_800_000,
            35_000_000,
            480_000_000,
            -480_000_000,
        ] {
            let mut film = Film::new();
            for (ahead_ns, frames) in [(ahead_ns, 50), (0, 50), (2 * ahead_ns, 9)] {
                let steps = (0..frames).filter(|k| {
                    let (off_ns, step_ns) = film.next(ahead_ns, 0, 0);
                    assert!(
                        off_ns.is_none_or(|ns| ns.abs() < 1_000_000),
                        "step {ahead_ns}: {off_ns:?} ns off"
                    );
                    assert!(off_ns.is_some() || *k < 3, "step {ahead_ns}: frame {k} is passed over");
                    step_ns.is_some()
                });
                assert_eq!(steps.count(), 1, "step {ahead_ns}");
            }
        }
    }

    /// Where the first frame after a step is late by chance, the next ones decide.
    #[test]
    fn a_step_is_found_though_its_first_frame_is_late_on_its_way() {
        for late_ns in [4_000_000, 12_000_000, 20_000_000] {
            let mut film = Film::new();
            for ahead_ns in [12_000_000, 0] {
                let first = film.next(ahead_ns, 0, late_ns);
                assert!((0..8).any(|_| film.next(ahead_ns, 0, 0).1.is_some()) || first.1.is_some());
                assert!(film.next(ahead_ns, 0, 0).0.is_some_and(|ns| ns.abs() < 1_000_000));
            }
        }
    }

    /// A step that was seen and whose end was not, or the other way round, left the stamps wrong to the end of the flight.
    #[test]
    fn a_clock_that_is_right_again_is_not_corrected_for_good() {
        let mut random = Random::new(8, 1);
        let mut film = Film::new();
        let mut seen = 0;
        for _ in 0..400 {
            let size_ns = 3e6 * (500.0_f64 / 3.0).powf(random.uniform());
            let ahead_ns = (size_ns * (random.uniform() - 0.5).signum()) as i64;
            // Some frames are on their way for long.
            let mut underway_ns =
                || i64::from(random.uniform() < 0.05) * (-6e6 * random.uniform().ln()) as i64;
            let steps = (0..60).filter(|_| film.next(ahead_ns, 0, underway_ns()).1.is_some()).count();
            seen += usize::from(steps > 0);
            for _ in 0..60 {
                film.next(0, 0, underway_ns());
            }
            let off_ns = (0..3).find_map(|_| film.next(0, 0, 0).0);
            assert!(is_right(&off_ns), "{off_ns:?} after a step of {ahead_ns}");
        }
        assert!(seen > 360, "{seen} of 400 steps");
    }

    /// A clock that was right again while the computer was busy was corrected to the end of the flight.
    #[test]
    fn a_clock_that_is_right_again_while_arrivals_are_uneven_is_found_when_they_are_even() {
        let mut random = Random::new(9, 1);
        for ahead_ns in [18_640_000, -18_640_000, 5_000_000, -300_000_000] {
            let mut film = Film::new();
            for k in 0..72 {
                let is_uneven = k >= 60;
                let underway_ns = if is_uneven { (9e7 * random.uniform()) as i64 } else { 0 };
                film.next(if is_uneven { 0 } else { ahead_ns }, 0, underway_ns);
            }
            let found: Vec<_> = (0..40).map(|_| film.next(0, 0, 0).0).collect();
            assert!(found[31..].iter().all(is_right), "{ahead_ns}: {found:?}");
        }
    }

    /// After minutes in which the computer was busy, their time on the way was the usual one: no clock was found to be right again.
    #[test]
    fn minutes_of_uneven_arrivals_leave_the_time_on_the_way_as_it_was() {
        let mut random = Random::new(10, 1);
        for ahead_ns in [12_000_000, -12_000_000, 310_000_000, -310_000_000] {
            let mut film = Film::new();
            for _ in 0..6000 {
                film.next(0, 0, (3e8 * random.uniform().powi(3)) as i64);
            }
            for round in 0..4 {
                for (ahead_ns, frames) in [(0, 90), (ahead_ns, 60)] {
                    let found: Vec<_> = (0..frames).map(|_| film.next(ahead_ns, 0, 0).0).collect();
                    assert!(found[40..].iter().all(is_right), "{ahead_ns}, round {round}: {found:?}");
                }
            }
        }
    }

    #[test]
    fn frames_that_are_missing_filmed_late_or_on_their_way_for_long_are_no_step() {
        let mut film = Film::new();
        let mut is_no_step = |number: i64, filmed_late_ns, underway_ns| {
            film.number += number;
            let found = film.next(0, filmed_late_ns, underway_ns).1;
            assert_eq!(
                found, None,
                "{number} missing, filmed {filmed_late_ns} late, {underway_ns} on the way"
            );
            (0..9).for_each(|_| assert_eq!(film.next(0, 0, 0).1, None));
        };
        for by_ns in [3_000_000, 8_000_000, 15_000_000, 33_333_333, 90_000_000] {
            is_no_step(0, 0, by_ns);
            is_no_step(0, by_ns.min(25_000_000), 0);
            is_no_step(by_ns / 10_000_000, 0, 0);
        }
        // A frame that waited behind another one until that was lost.
        (0..40).for_each(|_| assert_eq!(film.next(0, 0, INTERVAL).1, None));
        film.number += 1;
        assert_eq!(film.next(0, 0, 0).1, None);
        // Frames that arrive unevenly leave a small step open, and none is passed over for what may be one.
        let mut network = Film::new();
        for k in 0..200 {
            let is_late = k > 40 && k % 7 == 0;
            let (late_ns, underway_ns) = (i64::from(is_late) * 4_000_000, i64::from(k % 10) * 2_000_000);
            let found = network.next(0, late_ns, underway_ns);
            assert!(found.0.is_some() && found.1.is_none(), "frame {k}: {found:?}");
        }
        // A step that is less than frames are uneven is not seen, and neither is its end.
        let mut uneven = Film::new();
        (0..90).for_each(|k| assert_eq!(uneven.next(700_000 * i64::from(k / 30 % 2), 0, 0).1, None));
    }
}
