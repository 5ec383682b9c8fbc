//! Small logs of each format, written by their documented layouts, and mutations of them.

pub(crate) mod crazyflie;
pub(crate) mod dataflash;
pub(crate) mod ulog;

use mavsight_random::Random;

/// A small log of each format, with the name of its reader.
#[allow(dead_code)]
pub(crate) fn small_logs() -> [(&'static str, Vec<u8>); 3] {
    [("ulog", ulog::small()), ("dataflash", dataflash::small()), ("crazyflie", crazyflie::small())]
}

/// A log with something wrong: bytes that are changed, removed, repeated or swapped, or its end cut off.
#[allow(dead_code)]
pub(crate) fn mutated(log: &[u8], random: &mut Random) -> Vec<u8> {
    let mut log = log.to_vec();
    let below = |count: usize, random: &mut Random| (random.next_u64() % count.max(1) as u64) as usize;
    for _ in 0..1 + below(8, random) {
        // Definitions are at the beginning, and there is more to be spoilt in them.
        let reach = if below(2, random) == 0 { log.len().min(2000) } else { log.len() };
        let at = below(reach, random);
        let length = below(16, random).min(log.len() - at);
        match below(7, random) {
            0 => log.truncate(at),
            1 => drop(log.drain(at..at + length)),
            2 => {
                let again = log[at..at + length].to_vec();
                log.splice(at..at, again);
            }
            3 => {
                let large = [0x00, 0xff, 0x7f, 0x80][below(4, random)];
                log[at..at + length].fill(large);
            }
            4 => {
                let digits: Vec<u8> = (0..length).map(|_| b"0123456789[];: "[below(15, random)]).collect();
                log[at..at + length].copy_from_slice(&digits);
            }
            5 => log.iter_mut().skip(at).take(1).for_each(|byte| *byte ^= 1 << below(8, random)),
            _ => log.iter_mut().skip(at).take(length).for_each(|byte| *byte = below(256, random) as u8),
        }
        if log.is_empty() {
            break;
        }
    }
    log
}
