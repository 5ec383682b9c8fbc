//! A thread that ends with what it serves.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// How long a worker waits for the network before it looks whether to end.
pub(crate) const PATIENCE: Duration = Duration::from_millis(20);

/// What a mutex holds, also where a thread has panicked with it.
pub(crate) fn lock<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A thread that is asked to end, and waited for, when this is dropped.
pub(crate) struct Worker {
    ending: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Worker {
    /// Calls `step` again and again; a step waits for the network for [`PATIENCE`] as a rule.
    pub(crate) fn start(mut step: impl FnMut() + Send + 'static) -> Self {
        let ending = Arc::new(AtomicBool::new(false));
        let asked = Arc::clone(&ending);
        let thread = std::thread::spawn(move || {
            while !asked.load(Ordering::Relaxed) {
                step();
            }
        });
        Self { ending, thread: Some(thread) }
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.ending.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A worker that panicked has nothing left to report.
            let _ = thread.join();
        }
    }
}
