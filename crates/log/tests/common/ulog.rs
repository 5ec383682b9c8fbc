//! ULog by <https://docs.px4.io/main/en/dev_log/ulog_file_format.html>.

/// A log while it is written.
pub(crate) struct Ulog(pub(crate) Vec<u8>);

impl Ulog {
    pub(crate) fn new() -> Self {
        let mut log = Self([b"ULog\x01\x12\x35\x01".as_slice(), &1_000_u64.to_le_bytes()].concat());
        log.message(b'B', &[0; 40]);
        log
    }

    pub(crate) fn message(&mut self, kind: u8, payload: &[u8]) {
        self.0.extend((payload.len() as u16).to_le_bytes());
        self.0.push(kind);
        self.0.extend(payload);
    }

    pub(crate) fn format(&mut self, definition: &str) {
        self.message(b'F', definition.as_bytes());
    }

    pub(crate) fn value(&mut self, kind: u8, key: &str, value: &[u8]) {
        self.message(kind, &[&[key.len() as u8], key.as_bytes(), value].concat());
    }

    pub(crate) fn subscribe(&mut self, number: u16, instance: u8, name: &str) {
        self.message(b'A', &[&[instance], &number.to_le_bytes()[..], name.as_bytes()].concat());
    }

    pub(crate) fn sample(&mut self, number: u16, t_us: u64, rest: &[u8]) {
        self.message(b'D', &[&number.to_le_bytes()[..], &t_us.to_le_bytes(), rest].concat());
    }
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Two gyroscopes at unlike rates, motor outputs, and the report of two ESCs within a message.
pub(crate) fn small() -> Vec<u8> {
    let mut log = Ulog::new();
    log.value(b'I', "char[3] sys_name", b"PX4");
    log.format(
        "sensor_gyro:uint64_t timestamp;uint32_t device_id;float x;float y;float z;uint8_t[4] _padding0;",
    );
    log.format("actuator_outputs:uint64_t timestamp;uint32_t noutputs;float[4] output;uint8_t[4] _padding0;");
    log.format("esc_report:uint64_t timestamp;int32_t esc_rpm;float esc_voltage;int8_t esc_temperature;uint8_t[7] _padding0;");
    log.format(
        "esc_status:uint64_t timestamp;uint16_t counter;esc_report[2] esc;char[6] text;bool is_online;",
    );
    log.value(b'P', "float MC_ROLL_P", &6.5_f32.to_le_bytes());
    log.value(b'P', "int32_t SYS_AUTOSTART", &4001_i32.to_le_bytes());
    log.subscribe(0, 0, "sensor_gyro");
    log.subscribe(1, 1, "sensor_gyro");
    log.subscribe(2, 0, "actuator_outputs");
    log.subscribe(7, 0, "esc_status");
    for k in 0..200_u64 {
        let t_us = 2_000_000 + 1250 * k;
        let wave = (k as f32 * 0.1).sin();
        log.sample(0, t_us, &[&77_u32.to_le_bytes()[..], &floats(&[wave, -wave, 0.5 * wave])].concat());
        if k % 2 == 0 {
            log.sample(
                1,
                t_us + 100,
                &[&78_u32.to_le_bytes()[..], &floats(&[wave + 0.01, 0.0, 1.0])].concat(),
            );
        }
        if k % 4 == 0 && !(80..120).contains(&k) {
            let outputs = [1100.0 + k as f32, 1200.0, 1300.0 - k as f32, 1400.0];
            log.sample(2, t_us + 300, &[&4_u32.to_le_bytes()[..], &floats(&outputs)].concat());
        }
        if k % 20 == 0 {
            let mut rest = (k as u16).to_le_bytes().to_vec();
            for esc in 0..2_i32 {
                rest.extend(t_us.to_le_bytes());
                rest.extend((5000 + 100 * esc - k as i32).to_le_bytes());
                rest.extend(floats(&[11.5]));
                rest.extend((-3_i8).to_le_bytes());
                rest.extend([0; 7]);
            }
            rest.extend(b"nimble\x01");
            log.sample(7, t_us + 500, &rest);
        }
        if k == 100 {
            log.message(b'S', &[0x2f, 0x73, 0x13, 0x20, 0x25, 0x0c, 0xbb, 0x12]);
            log.message(b'O', &20_u16.to_le_bytes());
            log.value(b'P', "float MC_ROLL_P", &7.0_f32.to_le_bytes());
        }
    }
    log.0
}
