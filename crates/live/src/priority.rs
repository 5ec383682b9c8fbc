//! Who goes first where processors are scarce.

/// Places that a thread steps back by: a tenth of the weight of a thread that has not (Linux's table of weights).
#[cfg(target_os = "linux")]
const PLACES: i32 = 10;

/// Makes the calling thread one that lets others go first: for work that no pose waits for.
///
/// On Linux, where niceness is a thread's own (setpriority(2)) and more of it needs no right; elsewhere nothing changes. It lasts as
/// long as the thread.
pub fn give_way() {
    // A system that refuses runs the thread as before.
    #[cfg(target_os = "linux")]
    let _ = rustix::process::nice(PLACES);
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn only_the_thread_that_asks_steps_back() {
        let niceness = || rustix::process::getpriority_process(None).unwrap();
        let before = niceness();
        let after = std::thread::spawn(move || {
            give_way();
            niceness()
        });
        assert_eq!(after.join().unwrap(), (before + PLACES).min(19));
        assert_eq!(niceness(), before);
    }
}
