//! Units: products of powers of the base units.

use std::fmt;

const BASES: [&str; 5] = ["m", "kg", "s", "A", "K"];
/// Exponents are kept in twelfths, so that roots are exact.
const PART: i16 = 12;

/// A product of powers of metre, kilogram, second, ampere and kelvin; rad counts as one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Unit([i16; 5]);

const KNOWN: [(&str, [i16; 5]); 14] = [
    ("m", [1, 0, 0, 0, 0]),
    ("kg", [0, 1, 0, 0, 0]),
    ("s", [0, 0, 1, 0, 0]),
    ("A", [0, 0, 0, 1, 0]),
    ("K", [0, 0, 0, 0, 1]),
    ("1", [0; 5]),
    ("rad", [0; 5]),
    ("N", [1, 1, -2, 0, 0]),
    ("J", [2, 1, -2, 0, 0]),
    ("W", [2, 1, -3, 0, 0]),
    ("Pa", [-1, 1, -2, 0, 0]),
    ("Hz", [0, 0, -1, 0, 0]),
    ("V", [2, 1, -3, -1, 0]),
    ("C", [0, 0, 1, 1, 0]),
];

impl Unit {
    /// No unit.
    pub const ONE: Self = Self([0; 5]);
    pub(crate) const METRE: Self = Self([PART, 0, 0, 0, 0]);
    pub(crate) const KILOGRAM: Self = Self([0, PART, 0, 0, 0]);
    pub(crate) const SECOND: Self = Self([0, 0, PART, 0, 0]);

    /// Reads a product such as `N m s/rad` or `kg m^2`; each `/` divides by the one factor behind it.
    ///
    /// # Errors
    /// The part that is no unit.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut out = Self::ONE;
        let spaced = text.replace(['*', '·'], " ").replace('/', " / ");
        let mut sign = 1;
        for part in spaced.split_whitespace() {
            if part == "/" && sign == 1 {
                sign = -1;
                continue;
            }
            let (name, power) = part.split_once('^').unwrap_or((part, "1"));
            let known = KNOWN.iter().find(|(known, _)| *known == name);
            let power: Option<i16> = power.parse().ok().filter(|n: &i16| n.abs() <= 12);
            let (Some((_, exponents)), Some(power)) = (known, power) else { return Err(part.to_owned()) };
            out = out.times(Self(exponents.map(|e| e * PART)).to_the(f64::from(sign * power)));
            sign = 1;
        }
        if sign == 1 { Ok(out) } else { Err("/".to_owned()) }
    }

    /// As messages write it.
    pub(crate) fn words(self) -> String {
        if self == Self::ONE { "without unit".to_owned() } else { self.to_string() }
    }

    pub(crate) fn times(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k].saturating_add(other.0[k])))
    }

    pub(crate) fn over(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k].saturating_sub(other.0[k])))
    }

    /// A power; exponents are rounded to twelfths.
    pub(crate) fn to_the(self, power: f64) -> Self {
        Self(self.0.map(|e| (f64::from(e) * power).round() as i16))
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // A unit with a name of its own, alone or times others: "N s" is read sooner than "m kg/s".
        // A moment is N m, not J, and a rate 1/s, not Hz.
        for (name, exponents) in KNOWN.iter().skip(5).filter(|(name, _)| !["J", "Hz"].contains(name)) {
            let own = Self(exponents.map(|e| e * PART));
            if *self == own {
                return f.write_str(name);
            }
        }
        let newton = Self([PART, PART, -2 * PART, 0, 0]);
        let rest = self.over(newton);
        if self.0[1] == PART && self.0[2] < 0 && rest.0[3..] == [0, 0] {
            f.write_str("N")?;
            return rest.write_factors(f, true);
        }
        self.write_factors(f, false)
    }
}

impl Unit {
    fn write_factors(self, f: &mut fmt::Formatter<'_>, mut begun: bool) -> fmt::Result {
        let write = |f: &mut fmt::Formatter<'_>, name: &str, e: i16| match e {
            PART => f.write_str(name),
            e if e % PART == 0 => write!(f, "{name}^{}", e / PART),
            e => write!(f, "{name}^{:.2}", f64::from(e) / f64::from(PART)),
        };
        for (name, e) in BASES.iter().zip(self.0).filter(|(_, e)| *e > 0) {
            f.write_str(if begun { " " } else { "" })?;
            write(f, name, e)?;
            begun = true;
        }
        if !begun {
            f.write_str("1")?;
        }
        for (name, e) in BASES.iter().zip(self.0).filter(|(_, e)| *e < 0) {
            f.write_str("/")?;
            write(f, name, -e)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_read_and_written() {
        for (text, written) in [
            ("N m s/rad", "N m s"),
            ("kg m^2", "m^2 kg"),
            ("1/s", "1/s"),
            ("Hz", "1/s"),
            ("J", "N m"),
            ("V s/rad", "V s"),
            ("kg m/s^2", "N"),
            ("rad", "1"),
            ("s/m", "s/m"),
            ("N s", "N s"),
            ("kg/m^3", "kg/m^3"),
            ("kg / m^3", "kg/m^3"),
        ] {
            let unit = Unit::parse(text).expect(text);
            assert_eq!(Unit::parse(&unit.to_string()), Ok(unit), "{text}");
            assert_eq!(unit.to_string(), written);
        }
        assert_eq!(Unit::parse("N parsec"), Err("parsec".to_owned()));
        assert_eq!(Unit::parse("m^x"), Err("m^x".to_owned()));
        assert_eq!(Unit::parse("m//s"), Err("/".to_owned()));
        assert_eq!(Unit::parse("m/"), Err("/".to_owned()));
    }
}
