//! What every way out has in common.

use crate::{Event, Fix, LinkError, MarkerView};
use std::sync::OnceLock;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// A way out of mavsight.
///
/// No call waits for a peer, and none fails because a peer is not there: it gets what is sent once it has
/// come (back). An error says that nothing went out this time; the next call tries again. What is sent of a
/// [`Fix`] without a pose is documented at each outlet: nothing, or that there is none; never the pose
/// before.
pub trait Outlet: Send {
    /// Sends an instant, where the outlet carries more than its [`Event::Pose`].
    fn send(&mut self, _fix: &Fix) -> Result<(), LinkError> {
        Ok(())
    }

    /// Sends an event, where the outlet carries any.
    fn event(&mut self, _event: &Event) -> Result<(), LinkError> {
        Ok(())
    }
}

/// The aircraft, as clients know it.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    name: String,
    /// Markers, in body axes.
    pub markers: Vec<MarkerView>,
}

impl Body {
    const LONGEST: usize = 63;

    /// A body of that name. What is no letter of ASCII, digit, `-`, `_` or `.` becomes `_`, as `@`, `/` and
    /// blanks mean something else in one protocol or another; an empty name becomes `body`.
    pub fn new(name: &str, markers: Vec<MarkerView>) -> Self {
        let kept = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' };
        let mut name: String = name.trim().chars().take(Self::LONGEST).map(kept).collect();
        if name.is_empty() {
            name = "body".into();
        }
        Self { name, markers }
    }

    /// The name on every wire.
    pub fn name(&self) -> &str {
        &self.name
    }
}

/// Nanoseconds of the UNIX epoch, by the one clock of all that is sent: what the system's clock showed at the first call,
/// and the time since. Setting the system's clock later does not change it, so that stamps and answers to who asks for
/// the time agree.
pub fn now_ns() -> i64 {
    static BEGAN: OnceLock<(Instant, i64)> = OnceLock::new();
    let (began, unix_ns) = BEGAN.get_or_init(|| {
        let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        (Instant::now(), i64::try_from(unix.as_nanos()).unwrap_or(i64::MAX))
    });
    unix_ns.saturating_add(i64::try_from(began.elapsed().as_nanos()).unwrap_or(i64::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_mean_nothing_else_on_any_wire() {
        let name = |text: &str| Body::new(text, Vec::new()).name().to_owned();
        assert_eq!(name("cf231"), "cf231");
        assert_eq!(name("Lama 400D, modified"), "Lama_400D__modified");
        assert_eq!(name("a/b@c*$#?é\n\0"), "a_b_c_______");
        assert_eq!(name("  "), "body");
        assert_eq!(name(&"x".repeat(500)).len(), 63);
    }
}
