//! Threads of a flight.

use crate::LiveError;
use crate::queue::{Queue, locked};
use mavsight_link::give_way;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

const WAIT: Duration = Duration::from_millis(100);

pub(crate) fn spawn(name: &str, run: impl FnOnce() + Send + 'static) -> Result<JoinHandle<()>, LiveError> {
    let builder = std::thread::Builder::new().name(name.to_owned());
    builder.spawn(run).map_err(|source| LiveError::Thread { name: name.to_owned(), source })
}

pub(crate) struct Worker<T> {
    pub(crate) queue: Arc<Queue<T>>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

impl<T: Send + 'static> Worker<T> {
    /// Starts a thread that passes each item to `take`, and `None` where none has come for a while and at the
    /// end. Work on which no pose depends `gives_way` to other threads.
    pub(crate) fn start(
        name: &str,
        queue: impl Into<Arc<Queue<T>>>,
        gives_way: bool,
        mut take: impl FnMut(Option<T>) + Send + 'static,
    ) -> Result<Self, LiveError> {
        let queue = queue.into();
        let own = Arc::clone(&queue);
        let run = move || {
            if gives_way {
                give_way();
            }
            while !own.is_over() {
                take(own.pop(WAIT));
            }
            take(None);
        };
        Ok(Self { queue, thread: Mutex::new(Some(spawn(name, run)?)) })
    }

    /// Lets the thread take all that waits, and ends it.
    pub(crate) fn finish(&self) {
        self.queue.close();
        if let Some(thread) = locked(&self.thread).take() {
            // A panic has been printed by its thread.
            let _ = thread.join();
        }
    }
}
