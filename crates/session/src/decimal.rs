//! Times as decimal seconds, digit by digit.

/// The latest time that is read, either way, so that the difference of two is one too: 146 years.
pub(crate) const LATEST_NS: i64 = i64::MAX / 2;

/// Nanoseconds from decimal seconds: a binary number of seconds since 1970 is good to 0.1 µs only. `None` for what is no
/// number, and beyond 146 years.
pub(crate) fn ns_from_decimal(text: &str) -> Option<i64> {
    let (sign, digits) = match text.strip_prefix('-') {
        Some(rest) => (-1, rest),
        None => (1, text.strip_prefix('+').unwrap_or(text)),
    };
    let (whole, part) = digits.split_once('.').unwrap_or((digits, ""));
    let is_plain = |t: &str| t.bytes().all(|b| b.is_ascii_digit());
    if is_plain(whole) && is_plain(part) && !(whole.is_empty() && part.is_empty()) {
        let tenths: i128 = format!("{whole}{part:0<10.10}").parse().ok()?;
        return i64::try_from((tenths + 5) / 10)
            .ok()
            .filter(|t_ns| *t_ns <= LATEST_NS)
            .map(|t_ns| sign * t_ns);
    }
    let t_s = digits.parse::<f64>().ok().filter(|t_s| (0.0..crate::s_from_ns(LATEST_NS)).contains(t_s))?;
    Some(sign * crate::ns_from_s(t_s))
}

pub(crate) fn decimal_from_ns(t_ns: i64) -> String {
    let sign = if t_ns < 0 { "-" } else { "" };
    let t = t_ns.unsigned_abs();
    format!("{sign}{}.{:09}", t / 1_000_000_000, t % 1_000_000_000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimal_times_are_exact() {
        for t_ns in [0, 1, -1, 999_999_999, 1_403_636_579_763_555_584, -12_345_678_901] {
            assert_eq!(ns_from_decimal(&decimal_from_ns(t_ns)), Some(t_ns));
        }
        assert_eq!(ns_from_decimal("1.5e-3"), Some(1_500_000));
        assert_eq!(ns_from_decimal(".0000000015"), Some(2));
        for text in ["", ".", "x", "1e30", "nan", "99999999999999", "-9100000000.0", "5e9"] {
            assert_eq!(ns_from_decimal(text), None, "{text}");
        }
    }
}
