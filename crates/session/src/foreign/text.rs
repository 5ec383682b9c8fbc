//! Text files by lines, with errors that name line and column.

use crate::{SessionError, error::require_file};
use std::path::{Path, PathBuf};

/// A text file in memory.
pub(super) struct Text {
    path: PathBuf,
    content: String,
}

/// One line of it; counted from 1.
#[derive(Clone, Copy)]
pub(super) struct Line<'a> {
    file: &'a Text,
    pub(super) number: u64,
    pub(super) text: &'a str,
}

impl Text {
    pub(super) fn read(path: &Path, role: &str) -> Result<Self, SessionError> {
        require_file(path, role)?;
        let bytes = std::fs::read(path).map_err(|e| SessionError::io(path, "read it", e))?;
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
        let content = String::from_utf8(bytes.to_vec()).map_err(|e| SessionError::Row {
            path: path.to_owned(),
            line: 1 + bytes[..e.utf8_error().valid_up_to()].iter().filter(|b| **b == b'\n').count() as u64,
            detail: format!("not text ({role}): correct the path, or save it as UTF-8"),
        })?;
        Ok(Self { path: path.to_owned(), content })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// All lines, blank ones too.
    pub(super) fn lines(&self) -> impl Iterator<Item = Line<'_>> {
        let numbered = self.content.lines().enumerate();
        numbered.map(|(k, text)| Line { file: self, number: k as u64 + 1, text })
    }

    /// Lines that hold something.
    pub(super) fn filled(&self) -> impl Iterator<Item = Line<'_>> {
        self.lines().filter(|l| !l.text.trim().is_empty())
    }

    /// The error for the file as a whole, at its last line.
    pub(super) fn refuse_end(&self, detail: impl Into<String>) -> SessionError {
        let line = self.content.lines().count().max(1) as u64;
        SessionError::Row { path: self.path.clone(), line, detail: detail.into() }
    }
}

impl<'a> Line<'a> {
    /// The error for this line.
    pub(super) fn refuse(&self, detail: impl Into<String>) -> SessionError {
        SessionError::Row { path: self.file.path.clone(), line: self.number, detail: detail.into() }
    }

    /// Trimmed cells between separators.
    pub(super) fn cells(&self, separator: char) -> Vec<&'a str> {
        self.text.trim_end_matches(['\r', '\n']).split(separator).map(str::trim).collect()
    }

    /// A finite number in a cell; `column` counts from 0.
    pub(super) fn number_in(&self, column: usize, cell: &str) -> Result<f64, SessionError> {
        match cell.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => {
                let detail = "is not a finite number: one separator between numbers, a point before decimals";
                Err(self.refuse(format!("column {}: {cell:?} {detail}", column + 1)))
            }
        }
    }

    /// A finite number, or nothing where the cell is empty or says NaN.
    pub(super) fn number_if_any(&self, column: usize, cell: &str) -> Result<Option<f64>, SessionError> {
        if cell.is_empty() || cell.eq_ignore_ascii_case("nan") {
            return Ok(None);
        }
        self.number_in(column, cell).map(Some)
    }

    /// As many finite numbers as there are cells.
    pub(super) fn numbers(&self, separator: char) -> Result<Vec<f64>, SessionError> {
        self.cells(separator).iter().enumerate().map(|(k, cell)| self.number_in(k, cell)).collect()
    }
}

/// Nanoseconds from decimal seconds, digit by digit: a binary number of seconds since 1970 is good to 0.1 µs
/// only.
pub(crate) fn ns_from_decimal(text: &str) -> Option<i64> {
    let (negative, digits) = match text.strip_prefix('-') {
        Some(rest) => (true, rest),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    };
    let (whole, part) = digits.split_once('.').unwrap_or((digits, ""));
    let plain = |t: &str| t.bytes().all(|b| b.is_ascii_digit());
    let ns = if plain(whole) && plain(part) && !(whole.is_empty() && part.is_empty()) {
        let whole: i64 = if whole.is_empty() { 0 } else { whole.parse().ok()? };
        let first: String = part.chars().chain(std::iter::repeat('0')).take(9).collect();
        let up = i64::from(part.as_bytes().get(9).is_some_and(|b| *b >= b'5'));
        whole.checked_mul(1_000_000_000)?.checked_add(first.parse::<i64>().ok()? + up)?
    } else {
        let t_s: f64 = digits.parse().ok()?;
        if !(0.0..9e9).contains(&t_s) {
            return None;
        }
        crate::ns_from_s(t_s)
    };
    Some(if negative { -ns } else { ns })
}

/// Seconds with nine decimals.
pub(super) fn decimal_from_ns(t_ns: i64) -> String {
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
        for text in ["", ".", "x", "1e30", "nan", "99999999999999"] {
            assert_eq!(ns_from_decimal(text), None, "{text}");
        }
    }
}
