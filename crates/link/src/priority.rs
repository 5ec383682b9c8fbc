//! Priority of threads.

/// Increase of niceness: a tenth of the weight of an unchanged thread (Linux's table of weights).
#[cfg(target_os = "linux")]
const PLACES: i32 = 10;

/// Lowers the priority of the calling thread for its whole life: for work on which no pose depends.
///
/// On Linux, where each thread has its own niceness (setpriority(2)) and a higher one needs no privilege;
/// elsewhere nothing changes.
pub fn give_way() {
    // A system that refuses runs the thread as before.
    #[cfg(target_os = "linux")]
    let _ = rustix::process::nice(PLACES);
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn only_the_calling_thread_gets_a_lower_priority() {
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
