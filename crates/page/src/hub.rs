//! Where the producer and the listeners meet.

use std::collections::HashMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use mavsight_link::Event;
use tokio::sync::Notify;
use tokio_tungstenite::tungstenite::{Bytes, Message};

use crate::Command;
use crate::queue::{Kind, Queue};

/// A lock whose holder cannot have left it half done: each holds it for one push or pop.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What waits for one listener.
#[derive(Debug, Default)]
pub(crate) struct Mailbox {
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

    /// Poses that this listener was too slow for.
    pub(crate) fn dropped(&self) -> u64 {
        lock(&self.queue).dropped
    }
}

/// All listeners, what those who come later must know, and the way back to the producer.
#[derive(Debug)]
pub(crate) struct Hub {
    listeners: Mutex<Vec<Arc<Mailbox>>>,
    count: AtomicUsize,
    lasting: Mutex<Queue>,
    commands: SyncSender<Command>,
    previewed: Mutex<HashMap<usize, i64>>,
}

/// Least time between two pictures of one camera: ten a second show what is seen, and cost the producer little. A little less than a
/// tenth of a second, as every third frame at 30 Hz comes now a nanosecond early, now late.
const PREVIEW_INTERVAL_NS: i64 = 95_000_000;

impl Hub {
    pub(crate) fn new(commands: SyncSender<Command>) -> Self {
        Self {
            listeners: Mutex::default(),
            count: AtomicUsize::new(0),
            lasting: Mutex::default(),
            commands,
            previewed: Mutex::default(),
        }
    }

    pub(crate) fn listeners(&self) -> usize {
        self.count.load(Ordering::Relaxed)
    }

    pub(crate) fn publish(&self, event: &Event) {
        let kind = Kind::of(event);
        if !kind.lasts() && self.listeners() == 0 {
            return;
        }
        // Numbers, texts and lists of them always have a JSON form.
        let Ok(text) = serde_json::to_string(event) else { return };
        let message = Message::text(text);
        // Held to the end, so that who joins meanwhile gets the event once.
        let mut lasting = lock(&self.lasting);
        if kind == Kind::Scene {
            lasting.forget_cameras();
        }
        if kind.lasts() {
            lasting.push(kind, message.clone());
        }
        self.send(kind, &message);
    }

    pub(crate) fn preview(&self, camera: u8, t_ns: i64, jpeg: &[u8]) {
        if self.listeners() == 0 {
            return;
        }
        let mut bytes = Vec::with_capacity(9 + jpeg.len());
        bytes.push(camera);
        bytes.extend(t_ns.to_le_bytes());
        bytes.extend(jpeg);
        self.send(Kind::Preview(camera), &Message::Binary(Bytes::from(bytes)));
    }

    /// Whether a picture is due; if so, the next is not before an interval has gone by.
    pub(crate) fn wants_preview(&self, camera: usize, t_ns: i64) -> bool {
        if self.listeners() == 0 {
            return false;
        }
        let mut previewed = lock(&self.previewed);
        let is_due = previewed
            .get(&camera)
            .is_none_or(|&last| t_ns.abs_diff(last) >= PREVIEW_INTERVAL_NS.unsigned_abs());
        if is_due {
            previewed.insert(camera, t_ns);
        }
        is_due
    }

    fn send(&self, kind: Kind, message: &Message) {
        for mailbox in lock(&self.listeners).iter() {
            mailbox.push(kind, message.clone());
        }
    }

    /// A new listener, which first gets all that lasts; none where there are `most` already.
    pub(crate) fn join(&self, most: usize) -> Option<Arc<Mailbox>> {
        let lasting = lock(&self.lasting);
        let mut listeners = lock(&self.listeners);
        if listeners.len() >= most {
            return None;
        }
        let mailbox = Arc::new(Mailbox { queue: Mutex::new(lasting.clone()), filled: Notify::new() });
        listeners.push(Arc::clone(&mailbox));
        self.count.store(listeners.len(), Ordering::Relaxed);
        Some(mailbox)
    }

    pub(crate) fn leave(&self, mailbox: &Arc<Mailbox>) {
        let mut listeners = lock(&self.listeners);
        listeners.retain(|other| !Arc::ptr_eq(other, mailbox));
        self.count.store(listeners.len(), Ordering::Relaxed);
    }

    /// Hands a command to the producer.
    ///
    /// # Errors
    /// A sentence for the user where too many wait, or nobody takes them any more.
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

    fn note(text: &str) -> Event {
        Event::Note { t_s: 0.0, fault: false, text: text.to_owned() }
    }

    fn texts(mailbox: &Mailbox) -> Vec<String> {
        let mut queue = lock(&mailbox.queue);
        std::iter::from_fn(|| queue.pop()).map(|message| message.to_text().unwrap().to_owned()).collect()
    }

    #[test]
    fn who_comes_late_gets_what_lasts_and_no_old_pictures() {
        let hub = Hub::new(sync_channel(1).0);
        hub.publish(&note("first"));
        hub.publish(&Event::Detections { camera: 0, t_s: 0.0, seen: Vec::new() });
        hub.preview(0, 0, b"jpeg");
        hub.publish(&Event::Recording { folder: None, seconds: 0.0, bytes: 0, fault: None });
        hub.publish(&Event::Camera {
            camera: 0,
            state: CameraState::Running,
            rate_hz: 60.0,
            latency_ms: 0.0,
            dropped: 0,
            markers: Vec::new(),
            reason: None,
        });
        let (name, volume_m) = ("other".to_owned(), [[0.0; 3], [1.0; 3]]);
        hub.publish(&Event::Scene(Scene { name, cameras: Vec::new(), markers: Vec::new(), volume_m }));
        let mailbox = hub.join(1).unwrap();
        let texts = texts(&mailbox);
        assert_eq!(texts.len(), 3, "{texts:?}");
        for (text, what) in texts.iter().zip(["first", "recording", "scene"]) {
            assert!(text.contains(what), "{texts:?}");
        }
        assert!(hub.join(1).is_none());
        hub.leave(&mailbox);
        assert_eq!(hub.listeners(), 0);
    }

    #[test]
    fn pictures_are_wanted_ten_times_a_second_while_somebody_looks() {
        let hub = Hub::new(sync_channel(1).0);
        assert!(!hub.wants_preview(0, 0));
        let _mailbox = hub.join(1).unwrap();
        let wanted = |camera, rate_hz| {
            (0..rate_hz).filter(|k| hub.wants_preview(camera, k * 1_000_000_000 / rate_hz)).count()
        };
        assert_eq!((wanted(0, 60), wanted(1, 30), wanted(2, 120)), (10, 10, 10));
        assert!(hub.wants_preview(0, -5_000_000_000), "a replay that begins anew");
    }

    #[test]
    fn commands_that_nobody_takes_are_answered() {
        let (sender, receiver) = sync_channel(1);
        let hub = Hub::new(sender);
        assert_eq!(hub.ask(Command::Calibrate), Ok(()));
        assert!(hub.ask(Command::Calibrate).unwrap_err().contains("Too many"));
        drop(receiver);
        assert!(hub.ask(Command::Calibrate).unwrap_err().contains("ended"));
    }
}
