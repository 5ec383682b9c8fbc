//! A queue of bounded length between two threads.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Locks a mutex. No holder leaves its value half changed, so a poisoned one is sound.
pub(crate) fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A queue of bounded length; all its memory is allocated at the start.
#[derive(Debug)]
pub(crate) struct Queue<T> {
    inner: Mutex<Inner<T>>,
    changed: Condvar,
    capacity: usize,
    waits: bool,
}

#[derive(Debug)]
struct Inner<T> {
    items: VecDeque<T>,
    dropped: u64,
    closed: bool,
}

impl<T> Queue<T> {
    /// A queue for `capacity` items. If it is full, adding one `waits` for room, or drops the oldest.
    pub(crate) fn new(capacity: usize, waits: bool) -> Self {
        let capacity = capacity.max(1);
        let inner = Inner { items: VecDeque::with_capacity(capacity), dropped: 0, closed: false };
        Self { inner: Mutex::new(inner), changed: Condvar::new(), capacity, waits }
    }

    fn lock(&self) -> MutexGuard<'_, Inner<T>> {
        locked(&self.inner)
    }

    /// Adds an item; returns the one dropped for it, or the item itself from a closed queue.
    pub(crate) fn push(&self, item: T) -> Option<T> {
        let mut inner = self.lock();
        if self.waits {
            let is_full = |inner: &mut Inner<T>| inner.items.len() == self.capacity && !inner.closed;
            inner = self.changed.wait_while(inner, is_full).unwrap_or_else(PoisonError::into_inner);
        }
        if inner.closed {
            return Some(item);
        }
        let oldest = (inner.items.len() == self.capacity).then(|| inner.items.pop_front()).flatten();
        inner.dropped += u64::from(oldest.is_some());
        inner.items.push_back(item);
        drop(inner);
        self.changed.notify_all();
        oldest
    }

    /// Removes the oldest item, waiting for one at most for `wait`; none if the queue is closed and empty.
    pub(crate) fn pop(&self, wait: Duration) -> Option<T> {
        let is_waiting = |inner: &mut Inner<T>| inner.items.is_empty() && !inner.closed;
        let waited = self.changed.wait_timeout_while(self.lock(), wait, is_waiting);
        let item = waited.unwrap_or_else(PoisonError::into_inner).0.items.pop_front();
        self.changed.notify_all();
        item
    }

    pub(crate) fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }

    pub(crate) fn is_closed(&self) -> bool {
        self.lock().closed
    }

    pub(crate) fn is_over(&self) -> bool {
        let inner = self.lock();
        inner.closed && inner.items.is_empty()
    }

    pub(crate) fn dropped(&self) -> u64 {
        self.lock().dropped
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    #[test]
    fn the_oldest_is_dropped_and_counted() {
        let queue = Queue::new(3, false);
        let back: Vec<i32> = (0..7).filter_map(|k| queue.push(k)).collect();
        assert_eq!((back, queue.dropped()), (vec![0, 1, 2, 3], 4));
        assert!(!queue.is_closed());
        queue.close();
        assert!(queue.is_closed() && queue.push(9) == Some(9));
        assert!(!queue.is_over());
        let rest: Vec<_> = (0..4).map(|_| queue.pop(Duration::ZERO)).collect();
        assert_eq!(rest, [Some(4), Some(5), Some(6), None]);
        assert!(queue.is_over());
        let empty = Queue::<u8>::new(0, false);
        assert!(empty.pop(Duration::ZERO).is_none() && !empty.is_over());
    }

    #[test]
    fn waiting_for_room_loses_nothing() {
        let queue = Arc::new(Queue::new(2, true));
        let own = Arc::clone(&queue);
        let taker = std::thread::spawn(move || {
            let mut got = Vec::new();
            while let Some(k) = own.pop(Duration::from_secs(5)) {
                got.push(k);
                std::thread::sleep(Duration::from_micros(200));
            }
            got
        });
        assert!((0..50).all(|k| queue.push(k).is_none()));
        queue.close();
        assert!(queue.push(99) == Some(99));
        assert_eq!((taker.join().unwrap(), queue.dropped()), ((0..50).collect::<Vec<_>>(), 0));
    }
}
