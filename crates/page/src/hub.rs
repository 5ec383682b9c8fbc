//! The producer's side of all open pages.

use std::collections::HashMap;
use std::sync::mpsc::{SyncSender, TrySendError};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};

use mavsight_link::Event;
use tokio::sync::{Notify, watch};
use tokio_tungstenite::tungstenite::{Bytes, Message};

use crate::access::Right;
use crate::queue::{Kind, Queue};
use crate::site::Site;
use crate::{Command, Limits};

/// Locks a mutex. No holder leaves its value half changed, so a poisoned one is sound.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[derive(Debug)]
pub(crate) struct Mailbox {
    pub(crate) right: Right,
    queue: Mutex<Queue>,
    filled: Notify,
}

impl Mailbox {
    pub(crate) fn push(&self, kind: Kind, message: Message) {
        lock(&self.queue).push(kind, message);
        self.filled.notify_one();
    }

    /// The oldest message, as soon as there is one.
    pub(crate) async fn next(&self) -> Message {
        loop {
            if let Some(message) = lock(&self.queue).pop() {
                return message;
            }
            self.filled.notified().await;
        }
    }

    pub(crate) fn dropped(&self) -> u64 {
        lock(&self.queue).dropped
    }
}

/// The place of an open page, which it leaves when this is dropped.
#[derive(Debug)]
pub(crate) struct Seat {
    pub(crate) hub: Arc<Hub>,
    pub(crate) mailbox: Arc<Mailbox>,
}

impl Drop for Seat {
    fn drop(&mut self) {
        lock(&self.hub.pages).mailboxes.retain(|other| !Arc::ptr_eq(other, &self.mailbox));
    }
}

/// All open pages, the state for those that open later, and the way back to the producer.
#[derive(Debug)]
pub(crate) struct Hub {
    pages: Mutex<Pages>,
    /// What permits commands.
    pub(crate) token: String,
    /// Whether nothing is served without the token.
    pub(crate) is_private: bool,
    pub(crate) limits: Limits,
    commands: SyncSender<Command>,
    /// The page, where it is not that of a flight.
    pub(crate) site: Option<Site>,
    /// Becomes true when the server ends.
    ended: watch::Receiver<bool>,
}

#[derive(Debug, Default)]
struct Pages {
    mailboxes: Vec<Arc<Mailbox>>,
    state: Queue,
    previewed: HashMap<usize, i64>,
}

/// Least time between two pictures of one camera. Ten a second cost the producer little. A little less than a
/// tenth of a second, because every third frame at 30 Hz comes a nanosecond early or late.
const PREVIEW_INTERVAL_NS: u64 = 95_000_000;

impl Hub {
    pub(crate) fn new(
        token: String,
        is_private: bool,
        limits: Limits,
        commands: SyncSender<Command>,
        site: Option<Site>,
        ended: watch::Receiver<bool>,
    ) -> Self {
        Self { pages: Mutex::default(), token, is_private, limits, commands, site, ended }
    }

    pub(crate) async fn end(&self) {
        // An error means that the server is gone, which is its end too.
        let _ = self.ended.clone().wait_for(|&ended| ended).await;
    }

    pub(crate) fn listeners(&self) -> usize {
        lock(&self.pages).mailboxes.len()
    }

    pub(crate) fn publish(&self, event: &Event) {
        let kind = Kind::of(event);
        if !kind.is_state() && self.listeners() == 0 {
            return;
        }
        // Numbers, texts and lists of them always have a JSON form.
        let Ok(text) = serde_json::to_string(event) else { return };
        let message = Message::text(text);
        let mut pages = lock(&self.pages);
        if kind == Kind::Scene {
            pages.state.forget_cameras();
        }
        if kind.is_state() {
            pages.state.push(kind, message.clone());
        }
        pages.mailboxes.iter().for_each(|mailbox| mailbox.push(kind, message.clone()));
    }

    pub(crate) fn preview(&self, camera: u8, t_ns: i64, jpeg: &[u8]) {
        let pages = lock(&self.pages);
        if pages.mailboxes.is_empty() {
            return;
        }
        let bytes = [&[camera], &t_ns.to_le_bytes()[..], jpeg].concat();
        let message = Message::Binary(Bytes::from(bytes));
        pages.mailboxes.iter().for_each(|mailbox| mailbox.push(Kind::Preview(camera), message.clone()));
    }

    /// Whether a picture is due; if so, the next is due an interval later. A camera never waits here: while
    /// another thread is at the pages, none is due.
    pub(crate) fn wants_preview(&self, camera: usize, t_ns: i64) -> bool {
        let mut pages = match self.pages.try_lock() {
            Ok(pages) => pages,
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) => return false,
        };
        let last = pages.previewed.get(&camera);
        let is_due = !pages.mailboxes.is_empty()
            && last.is_none_or(|&last| t_ns.abs_diff(last) >= PREVIEW_INTERVAL_NS);
        if is_due {
            pages.previewed.insert(camera, t_ns);
        }
        is_due
    }

    /// Adds a page, which gets the state first; none where there are as many as may be.
    pub(crate) fn join(self: &Arc<Self>, right: Right) -> Option<Seat> {
        let mut pages = lock(&self.pages);
        let lookers = pages.mailboxes.iter().filter(|other| other.right == Right::Look).count();
        let is_full = match right {
            Right::Look => lookers >= self.limits.listeners.div_ceil(2),
            Right::Command => false,
        };
        if is_full || pages.mailboxes.len() >= self.limits.listeners {
            return None;
        }
        let queue = Mutex::new(pages.state.clone());
        let mailbox = Arc::new(Mailbox { right, queue, filled: Notify::new() });
        pages.mailboxes.push(Arc::clone(&mailbox));
        Some(Seat { hub: Arc::clone(self), mailbox })
    }

    /// Passes a command to the producer; the error is a sentence for the user.
    pub(crate) fn ask(&self, command: Command) -> Result<(), &'static str> {
        self.commands.try_send(command).map_err(|error| match error {
            TrySendError::Full(_) => {
                "Too many requests wait to be carried out: this one was left out, try again."
            }
            TrySendError::Disconnected(_) => "The flight has ended: nobody carries out requests any more.",
        })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::sync_channel;

    use mavsight_link::{CameraState, Scene};

    use super::*;

    fn hub() -> Arc<Hub> {
        hub_for(sync_channel(1).0)
    }

    fn hub_for(commands: SyncSender<Command>) -> Arc<Hub> {
        let limits = Limits { listeners: 3, ..Limits::default() };
        Arc::new(Hub::new(String::new(), false, limits, commands, None, watch::channel(false).1))
    }

    fn note(text: &str) -> Event {
        Event::Note { t_s: 0.0, fault: false, text: text.to_owned() }
    }

    fn texts(mailbox: &Mailbox) -> Vec<String> {
        let mut queue = lock(&mailbox.queue);
        std::iter::from_fn(|| queue.pop()).map(|message| message.to_text().unwrap().to_owned()).collect()
    }

    #[test]
    fn a_late_page_gets_the_state_and_no_old_pictures() {
        let hub = hub();
        hub.publish(&note("first"));
        hub.publish(&Event::Detections { camera: 0, t_s: 0.0, seen: Vec::new() });
        hub.preview(0, 0, b"jpeg");
        hub.publish(&Event::Recording { folder: None, seconds: 0.0, bytes: 0, fault: None });
        hub.publish(&Event::Camera {
            camera: 0,
            state: CameraState::Running,
            rate_hz: 60.0,
            latency_ms: 0.0,
            missing: 0,
            dropped: 0,
            markers: Vec::new(),
            reason: None,
        });
        let (name, volume_m) = ("other".to_owned(), [[0.0; 3], [1.0; 3]]);
        hub.publish(&Event::Scene(Scene { name, cameras: Vec::new(), markers: Vec::new(), volume_m }));
        let page = hub.join(Right::Look).unwrap();
        let texts = texts(&page.mailbox);
        assert_eq!(texts.len(), 3, "{texts:?}");
        for (text, what) in texts.iter().zip(["first", "recording", "scene"]) {
            assert!(text.contains(what), "{texts:?}");
        }
        drop(page);
        assert_eq!(hub.listeners(), 0);
    }

    #[test]
    fn pages_that_only_look_leave_places_for_those_with_the_token() {
        let hub = hub();
        let lookers: Vec<_> = std::iter::from_fn(|| hub.join(Right::Look)).collect();
        assert_eq!(lookers.len(), 2);
        let page = hub.join(Right::Command).unwrap();
        assert!(hub.join(Right::Command).is_none());
        drop((lookers, page));
        let pages: Vec<_> = std::iter::from_fn(|| hub.join(Right::Command)).collect();
        assert_eq!(pages.len(), 3);
        assert!(hub.join(Right::Look).is_none());
    }

    #[test]
    fn pictures_are_wanted_ten_times_a_second_while_somebody_looks() {
        let hub = hub();
        assert!(!hub.wants_preview(0, 0));
        let _page = hub.join(Right::Look).unwrap();
        let wanted = |camera, rate_hz| {
            (0..rate_hz).filter(|k| hub.wants_preview(camera, k * 1_000_000_000 / rate_hz)).count()
        };
        assert_eq!((wanted(0, 60), wanted(1, 30), wanted(2, 120)), (10, 10, 10));
        assert!(hub.wants_preview(0, -5_000_000_000), "a replay that begins again");
        let _busy = lock(&hub.pages);
        assert!(!hub.wants_preview(0, 0), "a camera does not wait");
    }

    #[test]
    fn commands_that_nobody_takes_get_an_answer() {
        let (sender, receiver) = sync_channel(1);
        let hub = hub_for(sender);
        assert_eq!(hub.ask(Command::Calibrate), Ok(()));
        assert!(hub.ask(Command::Calibrate).unwrap_err().contains("Too many"));
        drop(receiver);
        assert!(hub.ask(Command::Calibrate).unwrap_err().contains("ended"));
    }
}
