//! DataFlash by the structures of ArduPilot's logger.

/// A log while it is written.
pub(crate) struct Dataflash(pub(crate) Vec<u8>);

fn padded(text: &str, length: usize) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    bytes.resize(length, 0);
    bytes
}

impl Dataflash {
    pub(crate) fn record(&mut self, kind: u8, fields: &[&[u8]]) {
        self.0.extend([0xa3, 0x95, kind]);
        self.0.extend(fields.concat());
    }

    /// A record of records.
    pub(crate) fn format(&mut self, kind: u8, name: &str, characters: &str, columns: &str) {
        let length = |c| match c {
            'b' | 'B' | 'M' => 1,
            'h' | 'H' | 'c' | 'C' | 'g' => 2,
            'i' | 'I' | 'e' | 'E' | 'L' | 'f' | 'n' => 4,
            'q' | 'Q' | 'd' => 8,
            'N' => 16,
            _ => 64,
        };
        let length = 3 + characters.chars().map(length).sum::<usize>();
        let text = [padded(name, 4), padded(characters, 16), padded(columns, 64)].concat();
        self.record(128, &[&[kind, length as u8], &text]);
    }

    pub(crate) fn units(&mut self, kind: u8, units: &str, multipliers: &str) {
        self.record(131, &[&5_u64.to_le_bytes(), &[kind], &padded(units, 16), &padded(multipliers, 16)]);
    }
}

/// Two IMUs in one message, outputs, ESC telemetry of two ESCs and an attitude with scaled integers.
pub(crate) fn small() -> Vec<u8> {
    let mut log = Dataflash(Vec::new());
    log.format(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns");
    log.format(129, "UNIT", "QbZ", "TimeUS,Id,Label");
    log.format(130, "MULT", "Qbd", "TimeUS,Id,Mult");
    log.format(131, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds");
    log.format(132, "PARM", "QNff", "TimeUS,Name,Value,Default");
    log.format(10, "IMU", "QBffffffB", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,GH");
    log.format(11, "RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4");
    log.format(12, "ESC", "QBfHh", "TimeUS,Instance,RPM,Volt,Temp");
    log.format(13, "ATT", "QccC", "TimeUS,Roll,Pitch,Yaw");
    log.format(14, "MSG", "QZ", "TimeUS,Message");
    for (id, label) in [
        ("s", "s"),
        ("#", "instance"),
        ("E", "rad/s"),
        ("o", "m/s/s"),
        ("Y", "us"),
        ("q", "rpm"),
        ("v", "V"),
        ("O", "degC"),
        ("d", "deg"),
        ("h", "degheading"),
    ] {
        log.record(129, &[&1_u64.to_le_bytes(), id.as_bytes(), &padded(label, 64)]);
    }
    for (id, multiplier) in [("-", 0.0), ("0", 1.0), ("F", 1e-6), ("B", 1e-2)] {
        log.record(130, &[&2_u64.to_le_bytes(), id.as_bytes(), &f64::to_le_bytes(multiplier)]);
    }
    log.units(10, "s#EEEooo-", "F-000000-");
    log.units(11, "sYYYY", "F----");
    log.units(12, "s#qvO", "F-0B0");
    log.units(13, "sddh", "FBBB");
    for (name, value) in [("ATC_RAT_RLL_P", 0.135_f32), ("MOT_PWM_MAX", 2000.0)] {
        log.record(
            132,
            &[&3_u64.to_le_bytes(), &padded(name, 16), &value.to_le_bytes(), &0_f32.to_le_bytes()],
        );
    }
    for k in 0..100_u64 {
        let t_us = 3_000_000 + 2500 * k;
        let wave = (k as f32 * 0.2).cos();
        for imu in 0..2_u8 {
            let values = [wave, 0.1 * wave, -wave, 0.2, f32::from(imu), -9.8];
            let values: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
            log.record(10, &[&t_us.to_le_bytes(), &[imu], &values, &[1]]);
        }
        if k % 2 == 0 {
            let outputs: Vec<u8> =
                [1100 + k as u16, 1200, 1300, 1400].iter().flat_map(|v| v.to_le_bytes()).collect();
            log.record(11, &[&(t_us + 40).to_le_bytes(), &outputs]);
            let attitude = [-1234_i16, 250 + k as i16];
            let attitude: Vec<u8> = attitude.iter().flat_map(|v| v.to_le_bytes()).collect();
            log.record(13, &[&(t_us + 60).to_le_bytes(), &attitude, &35_999_u16.to_le_bytes()]);
        }
        if k % 10 == 0 {
            for esc in 0..2_u8 {
                let rpm = 6000.0 + 100.0 * f32::from(esc) - k as f32;
                let rest = [&1150_u16.to_le_bytes()[..], &(-40_i16).to_le_bytes()].concat();
                log.record(12, &[&(t_us + 80).to_le_bytes(), &[esc], &rpm.to_le_bytes(), &rest]);
            }
            log.record(14, &[&(t_us + 90).to_le_bytes(), &padded("a text", 64)]);
        }
    }
    log.0
}
