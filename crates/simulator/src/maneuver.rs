//! Movements of the inputs.

use crate::SimulatorError;
use mavsight_model::Input;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// What the amplitude of an input's manoeuvre is given in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AmplitudeUnit {
    /// Degrees, of an input in radians.
    Degrees,
    /// Per cent of the value in steady flight, of another input that has one.
    PercentOfTrim {
        /// The value in steady flight, in the input's unit.
        trim: f64,
    },
    /// The input's own unit.
    Own,
}

impl AmplitudeUnit {
    /// That of an input with this value in steady flight.
    pub fn of(input: &Input, trim: f64) -> Self {
        match (input.is_angle, trim) {
            (true, _) => Self::Degrees,
            (false, 0.0) => Self::Own,
            (false, trim) => Self::PercentOfTrim { trim },
        }
    }

    /// An amplitude in the input's own unit.
    pub fn in_own_unit(self, amplitude: f64) -> f64 {
        match self {
            Self::Degrees => amplitude.to_radians(),
            Self::PercentOfTrim { trim } => amplitude / 100.0 * trim,
            Self::Own => amplitude,
        }
    }

    /// A change of the input, in its own unit, as an amplitude.
    pub fn of_change(self, change: f64) -> f64 {
        match self {
            Self::Degrees => change.to_degrees(),
            Self::PercentOfTrim { trim } => change / trim * 100.0,
            Self::Own => change,
        }
    }
}

/// One movement of one input, added to its value in steady flight. Amplitudes are in degrees where the input
/// is in radians, in per cent of the value in steady flight where there is one, and else in the input's unit
/// ([`AmplitudeUnit`]).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Maneuver {
    /// One pulse up and one down, each `pulse_s` long; a negative amplitude begins down.
    Doublet {
        /// Name of the input moved, as the vehicle's model has it.
        channel: String,
        /// Begin.
        start_s: f64,
        /// Length of each pulse.
        pulse_s: f64,
        /// Amplitude.
        amplitude: f64,
    },
    /// Pulses of 3, 2, 1 and 1 units of `unit_s` with changing sign.
    #[serde(rename = "3-2-1-1")]
    ThreeTwoOneOne {
        /// Name of the input moved, as the vehicle's model has it.
        channel: String,
        /// Begin.
        start_s: f64,
        /// Length of the shortest pulse.
        unit_s: f64,
        /// Amplitude.
        amplitude: f64,
    },
    /// A step that is held.
    Step {
        /// Name of the input moved, as the vehicle's model has it.
        channel: String,
        /// Begin.
        start_s: f64,
        /// Amplitude.
        amplitude: f64,
    },
    /// Sines of equal amplitude at multiples of the lowest frequency, phases after Schroeder (1970) for a low
    /// peak.
    Multisine {
        /// Name of the input moved, as the vehicle's model has it.
        channel: String,
        /// Begin.
        start_s: f64,
        /// Length; also the period of the lowest frequency.
        length_s: f64,
        /// Harmonics of 1/`length_s`.
        harmonics: Vec<u32>,
        /// Root of the sum of squares over two, that is the effective value.
        amplitude: f64,
    },
    /// Sines whose amplitudes and phases are given: what an optimised multisine consists of.
    Sines {
        /// Name of the input moved, as the vehicle's model has it.
        channel: String,
        /// Begin.
        start_s: f64,
        /// Length; also the period of the first harmonic.
        length_s: f64,
        /// What is added.
        sine: Vec<Sine>,
    },
}

/// amplitude · sin(2π harmonic t/length + phase)
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sine {
    /// Multiple of 1/`length_s`.
    pub harmonic: u32,
    /// Amplitude.
    pub amplitude: f64,
    /// Phase at the begin.
    pub phase_rad: f64,
}

impl Maneuver {
    /// Name of the input moved.
    pub fn channel(&self) -> &str {
        match self {
            Self::Doublet { channel, .. }
            | Self::ThreeTwoOneOne { channel, .. }
            | Self::Step { channel, .. }
            | Self::Multisine { channel, .. }
            | Self::Sines { channel, .. } => channel,
        }
    }

    /// This movement with its amplitudes multiplied.
    pub fn scaled(&self, by: f64) -> Self {
        let mut out = self.clone();
        match &mut out {
            Self::Doublet { amplitude, .. }
            | Self::ThreeTwoOneOne { amplitude, .. }
            | Self::Step { amplitude, .. }
            | Self::Multisine { amplitude, .. } => *amplitude *= by,
            Self::Sines { sine, .. } => sine.iter_mut().for_each(|s| s.amplitude *= by),
        }
        out
    }

    /// The manoeuvre's value at a time, in its own unit.
    pub(crate) fn value(&self, t_s: f64) -> f64 {
        // A sample that belongs to the start of a pulse may be a rounding error before it.
        let t = t_s + 1e-9;
        match self {
            Self::Doublet { start_s, pulse_s, amplitude, .. } => {
                pulses(&[1.0, 1.0], (t - start_s) / pulse_s) * amplitude
            }
            Self::ThreeTwoOneOne { start_s, unit_s, amplitude, .. } => {
                pulses(&[3.0, 2.0, 1.0, 1.0], (t - start_s) / unit_s) * amplitude
            }
            Self::Step { start_s, amplitude, .. } if t >= *start_s => *amplitude,
            Self::Step { .. } => 0.0,
            Self::Multisine { start_s, length_s, harmonics, amplitude, .. } => {
                let n = harmonics.len() as f64;
                let sine = |(k, harmonic): (usize, &u32)| Sine {
                    harmonic: *harmonic,
                    amplitude: amplitude * (2.0 / n).sqrt(),
                    phase_rad: -PI * (k as f64) * (k as f64 + 1.0) / n,
                };
                sum_of_sines(harmonics.iter().enumerate().map(sine), (t_s - start_s) / length_s)
            }
            Self::Sines { start_s, length_s, sine, .. } => {
                sum_of_sines(sine.iter().copied(), (t_s - start_s) / length_s)
            }
        }
    }

    pub(crate) fn check(&self) -> Result<(), SimulatorError> {
        let numbers = match self {
            Self::Doublet { start_s, pulse_s: length, amplitude, .. }
            | Self::ThreeTwoOneOne { start_s, unit_s: length, amplitude, .. }
            | Self::Multisine { start_s, length_s: length, amplitude, .. } => [*start_s, *length, *amplitude],
            Self::Step { start_s, amplitude, .. } => [*start_s, 1.0, *amplitude],
            Self::Sines { start_s, length_s, sine, .. } => {
                let sum = sine.iter().map(|s| s.amplitude.abs() + s.phase_rad.abs()).sum();
                [*start_s, *length_s, sum]
            }
        };
        if numbers.iter().any(|v| !v.is_finite()) || numbers[1] <= 0.0 {
            return Err(SimulatorError::Maneuver(format!("{self:?}")));
        }
        let no_sine = match self {
            Self::Multisine { harmonics, .. } => harmonics.is_empty() || harmonics.contains(&0),
            Self::Sines { sine, .. } => sine.is_empty() || sine.iter().any(|s| s.harmonic == 0),
            _ => false,
        };
        if no_sine {
            return Err(SimulatorError::Scenario("a multisine needs harmonics of 1 or more"));
        }
        Ok(())
    }
}

/// The sum at a share of the length; zero outside.
fn sum_of_sines(sines: impl Iterator<Item = Sine>, share: f64) -> f64 {
    if !(0.0..=1.0).contains(&share) {
        return 0.0;
    }
    let turn = 2.0 * PI * share;
    sines.map(|s| s.amplitude * (f64::from(s.harmonic) * turn + s.phase_rad).sin()).sum()
}

/// Sign of a train of pulses of the given lengths at `t` units after its start; zero outside.
fn pulses(lengths: &[f64], t: f64) -> f64 {
    let (mut edge, mut sign) = (0.0, 1.0);
    if t < 0.0 {
        return 0.0;
    }
    for length in lengths {
        edge += length;
        if t < edge {
            return sign;
        }
        sign = -sign;
    }
    0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_two_one_one_has_those_lengths() {
        let m = Maneuver::ThreeTwoOneOne {
            channel: "delta_lat".into(),
            start_s: 1.0,
            unit_s: 0.5,
            amplitude: 2.0,
        };
        let value = |t| m.value(t);
        assert_eq!(
            [0.9, 1.1, 2.4, 2.6, 3.4, 3.6, 4.1, 4.6].map(value),
            [0.0, 2.0, 2.0, -2.0, -2.0, 2.0, -2.0, 0.0]
        );
    }

    #[test]
    fn a_multisine_has_the_effective_value_asked_for_and_a_low_peak() {
        let harmonics: Vec<u32> = (1..=8).collect();
        let m = Maneuver::Multisine {
            channel: "omega_u".into(),
            start_s: 0.0,
            length_s: 10.0,
            harmonics,
            amplitude: 3.0,
        };
        let values: Vec<f64> = (0..1000).map(|k| m.value(0.01 * f64::from(k))).collect();
        let rms = (values.iter().map(|v| v * v).sum::<f64>() / 1000.0).sqrt();
        let peak = values.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
        assert!((rms - 3.0).abs() < 1e-6, "{rms}");
        assert!(peak / rms < 2.2, "a sum of sines in phase would peak at 4: {}", peak / rms);
    }

    #[test]
    fn given_sines_are_added_and_scaled() {
        let sine = |harmonic, amplitude, phase_rad| Sine { harmonic, amplitude, phase_rad };
        let m = Maneuver::Sines {
            channel: "delta_lon".into(),
            start_s: 1.0,
            length_s: 4.0,
            sine: vec![sine(1, 2.0, 0.0), sine(3, 1.0, PI / 2.0)],
        };
        // At a quarter of the period the first is at its top, and the third has turned by 3π/2 + π/2.
        for (t, wanted) in [(0.9, 0.0), (1.0, 1.0), (2.0, 2.0), (5.1, 0.0)] {
            assert!((m.value(t) - wanted).abs() < 1e-12, "{t}");
            assert!((m.scaled(-0.5).value(t) + 0.5 * wanted).abs() < 1e-12);
        }
        let none = Maneuver::Sines { channel: "delta_lon".into(), start_s: 0.0, length_s: 1.0, sine: vec![] };
        assert!(none.check().is_err());
    }
}
