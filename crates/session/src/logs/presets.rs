//! Inputs of known programs.

use super::LogInput;
use mavsight_log::{Log, Topic};
use serde::{Deserialize, Serialize};

/// Fields of a known program that are inputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// PX4's `actuator_outputs`, as they went to the outputs: `output_1` and so on.
    Px4Outputs,
    /// PX4's `actuator_motors`, 0 to 1: `motor_1` and so on.
    Px4Motors,
    /// PX4's `actuator_servos`, -1 to 1: `servo_1` and so on.
    Px4Servos,
    /// PX4's `esc_status`, measured speeds: `rotor_1_rad_s` and so on.
    Px4Esc,
    /// ArduPilot's `RCOU`, microseconds: `output_1` and so on.
    ArdupilotOutputs,
    /// ArduPilot's `ESC`, measured speeds: `rotor_1_rad_s` and so on.
    ArdupilotEsc,
    /// The Crazyflie's `motor.m1` to `motor.m4`, 0 to 1: `motor_1` and so on.
    Crazyflie,
}

/// What a preset takes.
struct Pattern {
    /// Topic; empty: any.
    topic: &'static str,
    /// Around the number in a field's name; where there is none, the instance is the number.
    field: (&'static str, Option<&'static str>),
    /// Number of the first.
    first: u32,
    column: (&'static str, &'static str),
    scale: Option<f64>,
}

impl Preset {
    /// All of them, with their names.
    pub const ALL: [(&'static str, Self); 7] = [
        ("px4-outputs", Self::Px4Outputs),
        ("px4-motors", Self::Px4Motors),
        ("px4-servos", Self::Px4Servos),
        ("px4-esc", Self::Px4Esc),
        ("ardupilot-outputs", Self::ArdupilotOutputs),
        ("ardupilot-esc", Self::ArdupilotEsc),
        ("crazyflie", Self::Crazyflie),
    ];

    /// Its name in files and on the command line.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, preset)| *preset == self).map_or("", |(name, _)| name)
    }

    fn pattern(self) -> Pattern {
        let of = |topic, field, first, column| Pattern { topic, field, first, column, scale: None };
        match self {
            Self::Px4Outputs => of("actuator_outputs", ("output[", Some("]")), 0, ("output_", "")),
            Self::Px4Motors => of("actuator_motors", ("control[", Some("]")), 0, ("motor_", "")),
            Self::Px4Servos => of("actuator_servos", ("control[", Some("]")), 0, ("servo_", "")),
            Self::Px4Esc => of("esc_status", ("esc[", Some("].esc_rpm")), 0, ("rotor_", "_rad_s")),
            Self::ArdupilotOutputs => of("RCOU", ("C", Some("")), 1, ("output_", "")),
            Self::ArdupilotEsc => of("ESC", ("RPM", None), 0, ("rotor_", "_rad_s")),
            Self::Crazyflie => {
                Pattern { scale: Some(1.0 / 65535.0), ..of("", ("motor.m", Some("")), 1, ("motor_", "")) }
            }
        }
    }

    /// The number, from 1, of a field that the preset takes; `None` of another.
    pub(crate) fn number(self, topic: &str, instance: u32, field: &str) -> Option<u32> {
        let Pattern { topic: of, field: (start, end), first, .. } = self.pattern();
        if !of.is_empty() && of != topic {
            return None;
        }
        let rest = field.strip_prefix(start)?;
        let number = match end {
            None if rest.is_empty() => instance,
            None => return None,
            Some(end) => rest.strip_suffix(end)?.parse().ok()?,
        };
        number.checked_sub(first)?.checked_add(1)
    }

    /// Whether a log has what the preset takes.
    pub fn is_of(self, log: &Log) -> bool {
        let takes = |t: &Topic| t.fields.iter().any(|f| self.number(&t.name, t.instance, &f.name).is_some());
        log.topics.iter().any(takes)
    }

    /// The inputs that the preset takes of a log, in the order of their numbers.
    pub(crate) fn inputs(self, log: &Log, instance: Option<u32>) -> Vec<LogInput> {
        let Pattern { column: (start, end), scale, field: (_, in_name), .. } = self.pattern();
        let mut found: Vec<(u32, LogInput)> = Vec::new();
        for topic in &log.topics {
            for field in &topic.fields {
                let Some(number) = self.number(&topic.name, topic.instance, &field.name) else { continue };
                if found.iter().any(|(n, _)| *n == number) {
                    continue;
                }
                let input = LogInput {
                    column: format!("{start}{number}{end}"),
                    topic: Some(topic.name.clone()),
                    // Where the field is numbered, an instance that is not said is asked for.
                    instance: if in_name.is_none() { Some(topic.instance) } else { instance },
                    field: field.name.clone(),
                    scale,
                    ..LogInput::default()
                };
                found.push((number, input));
            }
        }
        found.sort_by_key(|(number, _)| *number);
        found.into_iter().map(|(_, input)| input).collect()
    }
}
