//! Who is told of a flight, each at its own pace.

use crate::{LiveError, Popped, Queue};
use mavsight_link::{Event, Fix};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

/// What may wait for one listener: some seconds of a flight.
const WAITING: usize = 2048;

/// Hears of a flight on a thread of its own.
pub trait Listener: Send {
    /// One instant, measured or not.
    fn fix(&mut self, _fix: &Fix) {}

    /// Whatever else there is to see; called where [`Listener::wants_events`].
    fn event(&mut self, _event: &Event) {}

    /// Whether it hears of events.
    fn wants_events(&self) -> bool {
        false
    }

    /// The flight has ended, or nothing has come for a while: what waits in buffers goes out.
    fn flush(&mut self) {}
}

enum Heard {
    Fix(Arc<Fix>),
    Event(Arc<Event>),
}

struct Ear {
    queue: Arc<Queue<Heard>>,
    wants_events: bool,
    thread: JoinHandle<()>,
}

/// All listeners of a flight. A slow one loses the oldest of what waits for it and holds nobody up.
#[derive(Default)]
pub struct Listeners {
    ears: Vec<Ear>,
    /// Whether the chain waits for listeners rather than that anything is lost: for runs that are not in real time.
    pub waiting: bool,
}

impl Listeners {
    /// Adds one.
    ///
    /// # Errors
    /// A system without threads left.
    pub fn add(&mut self, mut listener: Box<dyn Listener>) -> Result<(), LiveError> {
        let queue = Arc::new(Queue::new(WAITING));
        let (own, wants_events) = (Arc::clone(&queue), listener.wants_events());
        let listen = move || {
            loop {
                match own.pop(Duration::from_millis(100)) {
                    Popped::Item(Heard::Fix(fix)) => listener.fix(&fix),
                    Popped::Item(Heard::Event(event)) => listener.event(&event),
                    Popped::Nothing => listener.flush(),
                    Popped::Closed => break listener.flush(),
                }
            }
        };
        let thread = std::thread::Builder::new()
            .name("listener".into())
            .spawn(listen)
            .map_err(|source| LiveError::Thread { what: "a listener", source })?;
        self.ears.push(Ear { queue, wants_events, thread });
        Ok(())
    }

    /// Whether anybody hears of events.
    pub fn want_events(&self) -> bool {
        self.ears.iter().any(|e| e.wants_events)
    }

    fn push(&self, ear: &Ear, heard: Heard) {
        if self.waiting {
            ear.queue.push_waiting(heard);
        } else {
            ear.queue.push(heard);
        }
    }

    /// Tells all of an instant.
    pub fn fix(&self, fix: Fix) {
        if self.ears.is_empty() {
            return;
        }
        let fix = Arc::new(fix);
        self.ears.iter().for_each(|ear| self.push(ear, Heard::Fix(Arc::clone(&fix))));
    }

    /// Tells those who want it of an event.
    pub fn event(&self, event: Event) {
        if !self.want_events() {
            return;
        }
        let event = Arc::new(event);
        let wanting = self.ears.iter().filter(|e| e.wants_events);
        wanting.for_each(|ear| self.push(ear, Heard::Event(Arc::clone(&event))));
    }

    /// How much was lost to slow listeners, one by one.
    pub fn dropped(&self) -> Vec<u64> {
        self.ears.iter().map(|e| e.queue.dropped()).collect()
    }

    /// Lets all hear what waits for them, and ends.
    pub fn finish(self) {
        self.ears.iter().for_each(|e| e.queue.close());
        for ear in self.ears {
            // A listener that panicked has said so on its thread.
            let _ = ear.thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;
    use std::sync::mpsc::{Receiver, channel};

    /// Notes what it hears, after it was told to go on or has waited for that in vain.
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
    fn a_slow_listener_holds_nobody_up() {
        let (slow, quick) = (Arc::new(Mutex::new(Vec::new())), Arc::new(Mutex::new(Vec::new())));
        let (go_on, told) = channel();
        let mut all = Listeners::default();
        all.add(Box::new(Noting(Arc::clone(&slow), Some(told)))).unwrap();
        all.add(Box::new(Noting(Arc::clone(&quick), None))).unwrap();
        assert!(!all.want_events());
        for k in 0..6000 {
            all.fix(fix(k));
            // No more is told than the quick one has room for.
            while k as usize >= quick.lock().unwrap().len() + WAITING / 2 {
                std::thread::yield_now();
            }
        }
        // The slow one has not heard its first to the end yet, and its oldest are lost.
        assert!(slow.lock().unwrap().is_empty());
        let dropped = all.dropped();
        go_on.send(()).unwrap();
        all.finish();
        let (slow, quick) = (slow.lock().unwrap(), quick.lock().unwrap());
        assert_eq!((quick.len(), slow.len() as u64 + dropped[0]), (6000, 6000), "{dropped:?}");
        assert!(dropped[0] > 0 && slow.is_sorted() && slow.last() == Some(&5999));
    }
}
