//! What the fields of known programs are: their units where the log does not say them, and what they serve
//! as. From the message definitions of PX4, the log messages of ArduPilot, and the log groups of the
//! Crazyflie's firmware.

use crate::topic::{Field, LogFormat};
use serde::Serialize;

/// What a topic can serve as.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Rates of the body.
    Gyroscope,
    /// Specific force.
    Accelerometer,
    /// Commands of motors.
    MotorOutputs,
    /// Commands of servos.
    ServoOutputs,
    /// Measured speeds of rotors.
    RotorSpeed,
    /// Attitude as the autopilot has estimated it.
    Attitude,
    /// Position as the autopilot has estimated it.
    Position,
}

impl std::fmt::Display for Role {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Gyroscope => "gyroscope",
            Self::Accelerometer => "accelerometer",
            Self::MotorOutputs => "motor outputs",
            Self::ServoOutputs => "servo outputs",
            Self::RotorSpeed => "rotor speed",
            Self::Attitude => "attitude",
            Self::Position => "position",
        })
    }
}

/// Fields of a topic that can serve as something.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Serves {
    /// As what.
    pub role: Role,
    /// Names of the fields, in the order of axes or of outputs.
    pub fields: Vec<String>,
}

/// Fields of one meaning: in a topic, by name; `#` stands for a number and `*`, at the end of a topic, for
/// anything.
struct Known {
    topic: &'static str,
    fields: &'static [&'static str],
    /// Unit by the documentation; empty where there is none, or where the log says it.
    unit: &'static str,
    role: Option<Role>,
}

const fn known(
    topic: &'static str,
    fields: &'static [&'static str],
    unit: &'static str,
    role: Role,
) -> Known {
    Known { topic, fields, unit, role: Some(role) }
}

const XYZ: &[&str] = &["x", "y", "z"];

const PX4: &[Known] = &[
    known("sensor_combined", &["gyro_rad[#]"], "rad/s", Role::Gyroscope),
    known("sensor_combined", &["accelerometer_m_s2[#]"], "m/s2", Role::Accelerometer),
    known("sensor_gyro", XYZ, "rad/s", Role::Gyroscope),
    known("sensor_accel", XYZ, "m/s2", Role::Accelerometer),
    known("vehicle_angular_velocity", &["xyz[#]"], "rad/s", Role::Gyroscope),
    known("vehicle_acceleration", &["xyz[#]"], "m/s2", Role::Accelerometer),
    known("actuator_outputs", &["output[#]"], "", Role::MotorOutputs),
    known("actuator_motors", &["control[#]"], "1", Role::MotorOutputs),
    known("actuator_servos", &["control[#]"], "1", Role::ServoOutputs),
    known("esc_status", &["esc[#].esc_rpm"], "rpm", Role::RotorSpeed),
    known("rpm", &["rpm_estimate", "indicated_frequency_rpm"], "rpm", Role::RotorSpeed),
    known("vehicle_attitude", &["q[#]"], "1", Role::Attitude),
    known("vehicle_local_position", XYZ, "m", Role::Position),
];

const ARDUPILOT: &[Known] = &[
    known("IMU*", &["GyrX", "GyrY", "GyrZ"], "rad/s", Role::Gyroscope),
    known("IMU*", &["AccX", "AccY", "AccZ"], "m/s2", Role::Accelerometer),
    known("GYR*", &["GyrX", "GyrY", "GyrZ"], "rad/s", Role::Gyroscope),
    known("ACC*", &["AccX", "AccY", "AccZ"], "m/s2", Role::Accelerometer),
    known("RCOU", &["C#", "Ch#"], "us", Role::MotorOutputs),
    known("RCOU", &["C#", "Ch#"], "us", Role::ServoOutputs),
    known("RCO2", &["C#"], "us", Role::ServoOutputs),
    known("RCO3", &["C#"], "us", Role::ServoOutputs),
    known("ESC*", &["RPM"], "rpm", Role::RotorSpeed),
    known("RPM", &["rpm#", "RPM"], "rpm", Role::RotorSpeed),
    known("ATT", &["Roll", "Pitch", "Yaw"], "deg", Role::Attitude),
    known("XKF1", &["PN", "PE", "PD"], "m", Role::Position),
    known("POS", &["Lat", "Lng", "Alt"], "", Role::Position),
];

const CRAZYFLIE: &[Known] = &[
    known("*", &["gyro.x", "gyro.y", "gyro.z"], "deg/s", Role::Gyroscope),
    known("*", &["acc.x", "acc.y", "acc.z"], "g", Role::Accelerometer),
    known("*", &["motor.m#", "pwm.m#_pwm"], "pwm16", Role::MotorOutputs),
    known("*", &["rpm.m#"], "rpm", Role::RotorSpeed),
    known("*", &["stateEstimate.roll", "stateEstimate.pitch", "stateEstimate.yaw"], "deg", Role::Attitude),
    known("*", &["stateEstimate.x", "stateEstimate.y", "stateEstimate.z"], "m", Role::Position),
];

fn table(format: LogFormat) -> &'static [Known] {
    match format {
        LogFormat::Ulog => PX4,
        LogFormat::Dataflash => ARDUPILOT,
        LogFormat::Crazyflie => CRAZYFLIE,
        LogFormat::Table => &[],
    }
}

impl Known {
    fn is_of(&self, topic: &str) -> bool {
        // IMU2 is a second IMU; IMUX would be something else.
        self.topic.strip_suffix('*').map_or(self.topic == topic, |start| {
            topic
                .strip_prefix(start)
                .is_some_and(|rest| start.is_empty() || rest.bytes().all(|b| b.is_ascii_digit()))
        })
    }

    fn has(&self, field: &str) -> bool {
        self.fields.iter().any(|pattern| match pattern.split_once('#') {
            None => *pattern == field,
            Some((start, end)) => field
                .strip_prefix(start)
                .and_then(|rest| rest.strip_suffix(end))
                .is_some_and(|number| !number.is_empty() && number.bytes().all(|b| b.is_ascii_digit())),
        })
    }
}

/// The fields with the units that the documentation gives where the log does not.
pub(crate) fn with_units(format: LogFormat, topic: &str, fields: &[Field]) -> Vec<Field> {
    let own: Vec<&Known> = table(format).iter().filter(|k| !k.unit.is_empty() && k.is_of(topic)).collect();
    let unit =
        |field: &Field| own.iter().find(|known| known.has(&field.name)).map(|known| known.unit.to_owned());
    fields.iter().map(|f| Field { name: f.name.clone(), unit: f.unit.clone().or_else(|| unit(f)) }).collect()
}

/// What a topic can serve as.
pub(crate) fn serves(format: LogFormat, topic: &str, fields: &[Field]) -> Vec<Serves> {
    let own = table(format).iter().filter(|known| known.is_of(topic));
    let serves = own.filter_map(|known| {
        let fields: Vec<String> =
            fields.iter().filter(|f| known.has(&f.name)).map(|f| f.name.clone()).collect();
        known.role.filter(|_| !fields.is_empty()).map(|role| Serves { role, fields })
    });
    serves.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fields(names: &[&str]) -> Vec<Field> {
        names.iter().map(|name| Field { name: (*name).to_owned(), unit: None }).collect()
    }

    #[test]
    fn fields_of_known_topics_have_units_and_roles() {
        let all = fields(&["gyro_rad[0]", "gyro_rad[1]", "gyro_rad[2]", "gyro_integral_dt"]);
        let found = with_units(LogFormat::Ulog, "sensor_combined", &all);
        assert_eq!((found[2].unit.as_deref(), found[3].unit.as_deref()), (Some("rad/s"), None));
        let roles = serves(LogFormat::Ulog, "sensor_combined", &all);
        assert!(roles.len() == 1 && roles[0].role == Role::Gyroscope && roles[0].fields.len() == 3);
        assert!(serves(LogFormat::Ulog, "sensor_mag", &all).is_empty());
        let imu = fields(&["GyrX", "GyrY", "GyrZ"]);
        assert_eq!(serves(LogFormat::Dataflash, "IMU2", &imu).len(), 1);
        assert!(serves(LogFormat::Dataflash, "IMUX", &imu).is_empty());
        assert_eq!(
            serves(LogFormat::Dataflash, "RCOU", &fields(&["C1", "C14", "Chan"]))[0].fields,
            ["C1", "C14"]
        );
    }
}
