//! Units as logs write them.

use mavsight_model::Unit;
use std::f64::consts::PI;

/// Units that are not products of SI units: name, value in SI, the unit of that. The g is that of ISO 80000-3.
const OTHERS: [(&str, f64, &str); 15] = [
    ("deg", PI / 180.0, "rad"),
    ("deg/s", PI / 180.0, "rad/s"),
    ("rpm", 2.0 * PI / 60.0, "rad/s"),
    ("rev/s", 2.0 * PI, "rad/s"),
    ("g", 9.80665, "m/s^2"),
    ("m/s2", 1.0, "m/s^2"),
    ("rad/s2", 1.0, "rad/s^2"),
    ("mm", 1e-3, "m"),
    ("cm", 1e-2, "m"),
    ("us", 1e-6, "s"),
    ("ms", 1e-3, "s"),
    ("%", 1e-2, "1"),
    ("mV", 1e-3, "V"),
    ("mA", 1e-3, "A"),
    // A command of sixteen bits: the whole of it is 1.
    ("pwm16", 1.0 / 65535.0, "1"),
];

/// The value of a unit in SI, with the unit of that; `None` of one that is not known.
pub(crate) fn in_si(text: &str) -> Option<(f64, Unit)> {
    let (factor, si) =
        OTHERS.iter().find(|(name, ..)| *name == text).map_or((1.0, text), |(_, factor, si)| (*factor, si));
    Unit::parse(si).ok().map(|unit| (factor, unit))
}

/// The unit with which a column's name ends, as this program's own do.
pub(crate) fn of_name(name: &str) -> Option<&'static str> {
    const ENDINGS: [(&str, &str); 12] = [
        ("_deg_s", "deg/s"),
        ("_rad_s2", "rad/s2"),
        ("_mm", "mm"),
        ("_rad_s", "rad/s"),
        ("_m_s2", "m/s2"),
        ("_m_s", "m/s"),
        ("_rad", "rad"),
        ("_deg", "deg"),
        ("_rpm", "rpm"),
        ("_us", "us"),
        ("_m", "m"),
        ("_n", "N"),
    ];
    ENDINGS.iter().find(|(ending, _)| name.ends_with(ending)).map(|(_, unit)| *unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Degrees a second were none of a column's units: rad/s went into `q_deg_s` as they were.
    #[test]
    fn a_columns_last_unit_counts() {
        for (name, unit) in
            [("q_deg_s", "deg/s"), ("q_rad_s", "rad/s"), ("a_rad_s2", "rad/s2"), ("h_mm", "mm"), ("h_m", "m")]
        {
            assert_eq!(of_name(name), Some(unit), "{name}");
            assert!(in_si(unit).is_some(), "{unit}");
        }
        assert_eq!(of_name("commands"), None);
    }
}
