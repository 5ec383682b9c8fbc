//! What no log should hold ends with a note or an error, and never with a panic, a loop or all memory.

mod common;

use common::dataflash::Dataflash;
use common::ulog::Ulog;
use mavsight_log::{Log, LogError};

fn read(bytes: &[u8]) -> Result<Log, LogError> {
    Log::read(&mut &bytes[..], &|_, _, _| true)
}

#[test]
fn a_log_that_breaks_off_anywhere_is_read_up_to_there() {
    for (name, whole) in common::small_logs() {
        let all = read(&whole).expect("whole");
        let samples = |log: &Log| log.topics.iter().map(|t| t.samples).sum::<u64>();
        let mut before = 0;
        for length in (whole.len() / 2..whole.len()).step_by(17) {
            let part = read(&whole[..length]).expect("a part");
            assert!(samples(&part) >= before && samples(&part) <= samples(&all), "{name} {length}");
            let noted = part.notes.iter().any(|n| n.contains("breaks off") || n.contains("checksum"));
            // Only between two messages it looks whole.
            assert!(noted || name != "crazyflie", "{name} {length}: {:?}", part.notes);
            before = samples(&part);
        }
    }
}

#[test]
fn definitions_that_multiply_are_refused() {
    let within = Ulog::new().0.len();
    let mut log = Ulog::new();
    log.format("a:uint64_t timestamp;b[65535] x;");
    log.format("b:c[65535] x;");
    log.format("c:d[65535] x;");
    log.format("d:");
    log.subscribe(0, 0, "a");
    log.format("e:uint64_t timestamp;e[9999999999] x;");
    log.subscribe(1, 0, "e");
    log.format("f:uint64_t timestamp;uint8_t[65000] x;");
    for number in 2..100 {
        log.subscribe(number, number as u8, "f");
    }
    let refused = read(&log.0).expect_err("a refusal").to_string();
    assert!(log.0.len() < within + 3000 && refused.contains("need more memory"), "{refused}");
}

#[test]
fn what_cannot_be_read_is_said_with_its_place() {
    let cases: [(&[u8], &str); 5] = [
        (b"", "begins with"),
        (b"\x89PNG\r\n\x1a\n", "begins with 89 50 4e 47"),
        (&Ulog::new().0, "no samples"),
        (b"\xbc\x03\x00\x01\x00", "byte 3: version 3 of the format is not known"),
        (
            b"\xbc\x02\x00\x01\x00\x01\x00ab\0\x01\x00acc.x(y)\0",
            "byte 21: the variable \"acc.x(y)\" has no known type",
        ),
    ];
    for (bytes, said) in cases {
        let refused = read(bytes).expect_err("a refusal").to_string();
        assert!(refused.contains(said), "{refused}");
    }
    let mut newer = Ulog::new();
    newer.0[16 + 3 + 8] = 2;
    assert!(read(&newer.0).expect_err("a refusal").to_string().contains("features"), "unknown flags");
    let mut unlike = Dataflash(Vec::new());
    unlike.format(1, "ABC", "QB", "TimeUS,A,B");
    unlike.record(1, &[&[0; 9]]);
    assert!(matches!(read(&unlike.0), Err(LogError::Empty)));
}

#[test]
fn a_spoilt_place_is_passed_over() {
    for (name, log) in common::small_logs().into_iter().filter(|(name, _)| *name != "crazyflie") {
        let samples = |log: &Log| log.topics.iter().map(|t| t.samples).sum::<u64>();
        let all = samples(&read(&log).expect("whole"));
        let mut spoilt = log.clone();
        // Behind the definitions, and before ULog's mark of synchronisation.
        let at = if name == "ulog" { 2600 } else { 5000 };
        spoilt[at..at + 40].fill(0);
        let found = read(&spoilt).expect("read");
        assert!(samples(&found) > all / 3 && samples(&found) < all, "{name}: {} of {all}", samples(&found));
        assert!(found.notes.iter().any(|n| n.contains("passed over")), "{name}: {:?}", found.notes);
    }
}

#[test]
fn time_that_runs_backwards_is_refused_where_it_is_used() {
    let mut log = Ulog::new();
    log.format("sensor_gyro:uint64_t timestamp;float x;");
    log.subscribe(0, 0, "sensor_gyro");
    log.subscribe(1, 1, "sensor_gyro");
    for k in 0..1000_u64 {
        log.sample(0, 1_000_000 + if k == 500 { 0 } else { 2500 * k }, &[0; 4]);
        log.sample(1, 1_000_000 + if k < 500 { 2500 * k } else { 2500 * (k - 500) }, &[0; 4]);
    }
    let log = read(&log.0).expect("read");
    assert_eq!(log.stream("sensor_gyro", Some(0)).expect("one of a thousand").times_ns.len(), 999);
    assert!(
        log.notes[0].starts_with("sensor_gyro 0: 1 of 1000 samples do not come after"),
        "{:?}",
        log.notes
    );
    let refused = log.stream("sensor_gyro", Some(1)).expect_err("a refusal").to_string();
    assert!(
        refused.contains("500 of 1000") && refused.contains("at 1.000000 s after 2.247500 s"),
        "{refused}"
    );
    let asked = log.stream("sensor_gyro", None).expect_err("a refusal").to_string();
    assert!(asked.contains("instances 0, 1: say which"), "{asked}");
    let missing = log.stream("sensor_gyros", None).expect_err("a refusal").to_string();
    assert!(missing.contains("no topic sensor_gyros; the nearest are sensor_gyro"), "{missing}");
    let missing =
        log.stream("sensor_gyro", Some(0)).expect("it").column("z").expect_err("a refusal").to_string();
    assert!(missing.contains("no field z; the nearest are x"), "{missing}");
    assert!(
        log.stream("sensor_gyro", Some(2)).expect_err("a refusal").to_string().contains("there are: 0, 1")
    );
}
