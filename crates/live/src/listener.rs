//! Listeners of a flight, each at its own pace.

use crate::LiveError;
use crate::queue::Queue;
use crate::worker::Worker;
use mavsight_link::{Event, Fix};
use std::sync::Arc;

/// Messages that may wait for one listener: some seconds of a flight.
const WAITING: usize = 2048;

/// Receives the instants and events of a flight on a thread of its own.
pub trait Listener: Send {
    /// One instant, measured or not.
    fn fix(&mut self, _fix: &Fix) {}

    /// An event.
    fn event(&mut self, _event: &Event) {}

    /// Sends buffered data: nothing has come for a while, or the flight has ended.
    fn flush(&mut self) {}
}

#[derive(Clone)]
enum Message {
    Fix(Arc<Fix>),
    Event(Arc<Event>),
}

/// All listeners of a flight. A slow one loses its oldest messages and delays nobody.
#[derive(Default)]
pub struct Listeners {
    connected: Vec<Worker<Message>>,
    /// Whether the flight waits for slow listeners that are added from now on, instead of losing messages:
    /// for runs that are not in real time.
    pub waiting: bool,
}

impl Listeners {
    /// Adds a listener.
    ///
    /// # Errors
    /// The system has no thread for it.
    pub fn add(&mut self, mut listener: Box<dyn Listener>) -> Result<(), LiveError> {
        let listen = move |message| match message {
            Some(Message::Fix(fix)) => listener.fix(&fix),
            Some(Message::Event(event)) => listener.event(&event),
            None => listener.flush(),
        };
        let queue = Queue::new(WAITING, self.waiting);
        self.connected.push(Worker::start("listener", queue, false, listen)?);
        Ok(())
    }

    fn push(&self, message: &Message) {
        for listener in &self.connected {
            listener.queue.push(message.clone());
        }
    }

    /// Sends an instant to all.
    pub fn fix(&self, fix: Fix) {
        self.push(&Message::Fix(Arc::new(fix)));
    }

    /// Sends an event to all.
    pub fn event(&self, event: Event) {
        self.push(&Message::Event(Arc::new(event)));
    }

    /// Number of messages that each listener lost.
    pub fn dropped(&self) -> Vec<u64> {
        self.connected.iter().map(|l| l.queue.dropped()).collect()
    }

    /// Delivers all waiting messages, and ends.
    pub fn finish(self) {
        self.connected.iter().for_each(|l| l.queue.close());
        self.connected.iter().for_each(Worker::finish);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;
    use std::sync::mpsc::{Receiver, channel};
    use std::time::Duration;

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
