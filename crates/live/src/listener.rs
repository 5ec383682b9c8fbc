//! Listeners of a flight, each at its own pace.

use crate::LiveError;
use crate::queue::{Popped, Queue};
use mavsight_link::{Event, Fix};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

/// Messages that may wait for one listener: some seconds of a flight.
const WAITING: usize = 2048;

/// Receives the instants and events of a flight on a thread of its own.
pub trait Listener: Send {
    /// One instant, measured or not.
    fn fix(&mut self, _fix: &Fix) {}

    /// An event; called if [`Listener::wants_events`].
    fn event(&mut self, _event: &Event) {}

    /// Whether it receives events.
    fn wants_events(&self) -> bool {
        false
    }

    /// Sends buffered data: nothing has come for a while, or the flight has ended.
    fn flush(&mut self) {}
}

enum Message {
    Fix(Arc<Fix>),
    Event(Arc<Event>),
}

struct Connected {
    queue: Arc<Queue<Message>>,
    wants_events: bool,
    thread: JoinHandle<()>,
}

/// All listeners of a flight. A slow one loses its oldest messages and delays nobody.
#[derive(Default)]
pub struct Listeners {
    connected: Vec<Connected>,
    /// Whether the flight waits for slow listeners instead of losing messages: for runs that are not in real
    /// time.
    pub waiting: bool,
}

impl Listeners {
    /// Adds a listener.
    ///
    /// # Errors
    /// The system has no thread for it.
    pub fn add(&mut self, mut listener: Box<dyn Listener>) -> Result<(), LiveError> {
        let queue = Arc::new(Queue::new(WAITING));
        let (own, wants_events) = (Arc::clone(&queue), listener.wants_events());
        let listen = move || {
            loop {
                match own.pop(Duration::from_millis(100)) {
                    Popped::Item(Message::Fix(fix)) => listener.fix(&fix),
                    Popped::Item(Message::Event(event)) => listener.event(&event),
                    Popped::Nothing => listener.flush(),
                    Popped::Closed => break listener.flush(),
                }
            }
        };
        let thread = std::thread::Builder::new()
            .name("listener".into())
            .spawn(listen)
            .map_err(|source| LiveError::Thread { what: "a listener", source })?;
        self.connected.push(Connected { queue, wants_events, thread });
        Ok(())
    }

    /// Whether any listener receives events.
    pub fn want_events(&self) -> bool {
        self.connected.iter().any(|e| e.wants_events)
    }

    fn push(&self, to: &Connected, message: Message) {
        if self.waiting {
            to.queue.push_waiting(message);
        } else {
            to.queue.push(message);
        }
    }

    /// Sends an instant to all.
    pub fn fix(&self, fix: Fix) {
        if self.connected.is_empty() {
            return;
        }
        let fix = Arc::new(fix);
        self.connected.iter().for_each(|listener| self.push(listener, Message::Fix(Arc::clone(&fix))));
    }

    /// Sends an event to the listeners that want events.
    pub fn event(&self, event: Event) {
        if !self.want_events() {
            return;
        }
        let event = Arc::new(event);
        let wanting = self.connected.iter().filter(|e| e.wants_events);
        wanting.for_each(|listener| self.push(listener, Message::Event(Arc::clone(&event))));
    }

    /// Number of messages that each listener lost.
    pub fn dropped(&self) -> Vec<u64> {
        self.connected.iter().map(|e| e.queue.dropped()).collect()
    }

    /// Delivers all waiting messages, and ends.
    pub fn finish(self) {
        self.connected.iter().for_each(|e| e.queue.close());
        for listener in self.connected {
            // A panic of a listener has been printed by its thread.
            let _ = listener.thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;
    use std::sync::mpsc::{Receiver, channel};

    /// Records the instants, after a signal to go on or a minute.
    struct Noting(Arc<Mutex<Vec<u64>>>, Option<Receiver<()>>);

    impl Listener for Noting {
        fn fix(&mut self, fix: &Fix) {
            if let Some(go_on) = self.1.take() {
                let _ = go_on.recv_timeout(Duration::from_secs(60));
            }
            self.0.lock().unwrap().push(fix.sequence);
        }
    }

    fn fix(sequence: u64) -> Fix {
        Fix { sequence, captured_ns: 0, received_ns: 0, measured: None, resets: 0 }
    }

    #[test]
    fn a_slow_listener_delays_nobody() {
        let (slow, quick) = (Arc::new(Mutex::new(Vec::new())), Arc::new(Mutex::new(Vec::new())));
        let (go_on, signal) = channel();
        let mut all = Listeners::default();
        all.add(Box::new(Noting(Arc::clone(&slow), Some(signal)))).unwrap();
        all.add(Box::new(Noting(Arc::clone(&quick), None))).unwrap();
        assert!(!all.want_events());
        for k in 0..6000 {
            all.fix(fix(k));
            // No more is sent than the quick one has room for.
            while k as usize >= quick.lock().unwrap().len() + WAITING / 2 {
                std::thread::yield_now();
            }
        }
        // The slow one is still busy with its first message, and its oldest are lost.
        assert!(slow.lock().unwrap().is_empty());
        let dropped = all.dropped();
        go_on.send(()).unwrap();
        all.finish();
        let (slow, quick) = (slow.lock().unwrap(), quick.lock().unwrap());
        assert_eq!((quick.len(), slow.len() as u64 + dropped[0]), (6000, 6000), "{dropped:?}");
        assert!(dropped[0] > 0 && slow.is_sorted() && slow.last() == Some(&5999));
    }
}
