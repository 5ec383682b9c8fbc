//! Fewer instants than the cameras have.

/// Lets at most so many instants a second through, evenly.
pub(super) struct Pace {
    interval_ns: i64,
    due_ns: Option<i64>,
}

impl Pace {
    /// A rate that is positive and finite.
    pub(super) fn new(rate_hz: f64) -> Self {
        Self { interval_ns: (1e9 / rate_hz).round() as i64, due_ns: None }
    }

    /// Whether the instant goes through. Instants are counted against a grid, so that 60 Hz gives 50 Hz and
    /// not 30; the grid begins again after a gap, or where the clock was set back.
    pub(super) fn due(&mut self, at_ns: i64) -> bool {
        let due = self.due_ns.unwrap_or(at_ns);
        let off = at_ns.saturating_sub(due);
        if off < 0 && off > -2 * self.interval_ns {
            return false;
        }
        let restart = off.abs() >= 2 * self.interval_ns;
        self.due_ns = Some(if restart { at_ns } else { due }.saturating_add(self.interval_ns));
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn through(rate_hz: f64, camera_hz: f64, jitter_ns: i64, seconds: f64) -> Vec<i64> {
        let mut pace = Pace::new(rate_hz);
        let at = |k: i64| (k as f64 * 1e9 / camera_hz) as i64 + jitter_ns * ((k * 7919) % 11 - 5) / 5;
        (0..(seconds * camera_hz) as i64).map(at).filter(|&t| pace.due(t)).collect()
    }

    #[test]
    fn no_more_than_asked_for_and_no_fewer_than_there_are() {
        for (rate, camera, want) in
            [(50.0, 60.0, 500), (50.0, 30.0, 300), (30.0, 60.0, 300), (50.0, 120.0, 500)]
        {
            for jitter_ns in [0, 3_000_000] {
                let count = through(rate, camera, jitter_ns, 10.0).len();
                assert!(count <= want + 1 && count + 3 >= want, "{camera} Hz at {rate}: {count}");
            }
        }
    }

    #[test]
    fn after_a_gap_or_a_step_back_it_goes_on_at_once() {
        let mut pace = Pace::new(50.0);
        assert!(pace.due(1_000_000_000));
        assert!(!pace.due(1_010_000_000));
        assert!(pace.due(9_000_000_000));
        assert!(!pace.due(9_010_000_000));
        assert!(pace.due(500_000_000));
        assert!(!pace.due(510_000_000));
        assert!(pace.due(520_000_000));
    }
}
