//! The flight's clock.

use mavsight_link::now_ns;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Longest sleep between checks of the flight's end.
const CHECK: Duration = Duration::from_millis(20);

/// Time of the flight, relative to the clock of all that is sent ([`now_ns`]): setting the system's clock does not
/// change it.
///
/// Stamps by the system's clock, as of cameras over a network, jump when that clock is set; frames whose
/// stamps go back are skipped and reported. A flight of running cameras begins at 0, a replay at the first
/// stamp of its recording.
#[derive(Debug, Clone, Copy)]
pub struct FlightClock {
    began: Instant,
    /// Flight time at its beginning.
    from_ns: i64,
    /// UNIX time of flight time 0.
    origin_ns: i64,
}

impl FlightClock {
    /// A clock that shows `from_ns` now.
    pub fn starting_at(from_ns: i64) -> Self {
        Self { began: Instant::now(), from_ns, origin_ns: now_ns().saturating_sub(from_ns) }
    }

    /// Flight time now.
    pub fn now_ns(&self) -> i64 {
        self.from_ns.saturating_add(i64::try_from(self.began.elapsed().as_nanos()).unwrap_or(i64::MAX))
    }

    /// Nanoseconds of the UNIX epoch at a flight time.
    pub fn unix_ns(&self, t_ns: i64) -> i64 {
        self.origin_ns.saturating_add(t_ns)
    }

    /// Flight time at nanoseconds of the UNIX epoch.
    pub fn flight_ns(&self, unix_ns: i64) -> i64 {
        unix_ns.saturating_sub(self.origin_ns)
    }

    /// Flight time at its beginning.
    pub fn from_ns(&self) -> i64 {
        self.from_ns
    }

    /// Time left until a flight time; zero if it is past.
    pub fn until(&self, t_ns: i64) -> Duration {
        Duration::from_nanos(u64::try_from(t_ns.saturating_sub(self.now_ns())).unwrap_or(0))
    }

    pub(crate) fn wait_until(&self, t_ns: i64, stop: &AtomicBool) {
        loop {
            let left = self.until(t_ns);
            if left.is_zero() || stop.load(Ordering::Relaxed) {
                return;
            }
            std::thread::sleep(left.min(CHECK));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{SystemTime, UNIX_EPOCH};

    #[test]
    fn it_goes_on_and_knows_the_date() {
        let clock = FlightClock::starting_at(5_000_000_000);
        let first = clock.now_ns();
        assert!((5_000_000_000..5_500_000_000).contains(&first) && clock.now_ns() >= first);
        assert_eq!(clock.flight_ns(clock.unix_ns(77)), 77);
        let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_nanos() as i64;
        assert!((clock.unix_ns(clock.now_ns()) - unix).abs() < 50_000_000);
        // Stamps and answers to TIMESYNC are by one clock.
        assert!((clock.unix_ns(clock.now_ns()) - now_ns()).abs() < 50_000_000);
        assert_eq!(clock.until(0), Duration::ZERO);
        assert!(clock.until(10_000_000_000) > Duration::from_secs(4));
    }
}
