//! usdlog by the firmware's `tools/usdlog`: a header with events and variables, events, a CRC-32.

fn named(name: &str) -> Vec<u8> {
    [name.as_bytes(), &[0]].concat()
}

/// A log of an event at a fixed rate, and one that happens now and then.
pub(crate) fn small() -> Vec<u8> {
    let mut log = [&[0xbc_u8][..], &2_u16.to_le_bytes(), &2_u16.to_le_bytes()].concat();
    log.extend([&0xffff_u16.to_le_bytes()[..], &named("fixedFrequency"), &5_u16.to_le_bytes()].concat());
    for variable in ["acc.z(f)", "gyro.x(f)", "motor.m1(I)", "pm.vbat(e)", "baro.temp(h)"] {
        log.extend(named(variable));
    }
    log.extend([&3_u16.to_le_bytes()[..], &named("estTDOA"), &2_u16.to_le_bytes()].concat());
    log.extend([named("idA(B)"), named("distanceDiff(d)")].concat());
    for k in 0..150_u64 {
        let t_us = 26_000_000 + 1000 * k;
        log.extend([&0xffff_u16.to_le_bytes()[..], &t_us.to_le_bytes()].concat());
        log.extend((1.0 + 0.01 * k as f32).to_le_bytes());
        log.extend((-20.0 * (k as f32 * 0.05).sin()).to_le_bytes());
        log.extend((300 * k as u32).to_le_bytes());
        log.extend((0x4000_u16 + k as u16).to_le_bytes());
        log.extend((20 - k as i16).to_le_bytes());
        if k % 7 == 0 {
            log.extend([&3_u16.to_le_bytes()[..], &(t_us + 10).to_le_bytes(), &[k as u8]].concat());
            log.extend((1.0 / (1.0 + k as f64)).to_le_bytes());
        }
    }
    let checksum = crc32fast::hash(&log);
    log.extend(checksum.to_le_bytes());
    log
}
