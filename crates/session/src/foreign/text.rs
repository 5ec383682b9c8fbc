//! Text files by lines, with errors that name line and column.

use crate::{SessionError, error::read_text};
use std::path::{Path, PathBuf};

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
        Ok(Self { path: path.to_owned(), content: read_text(path, role)? })
    }

    pub(super) fn filled(&self) -> impl Iterator<Item = Line<'_>> {
        let numbered = self.content.lines().zip(1..).filter(|(text, _)| !text.trim().is_empty());
        numbered.map(|(text, number)| Line { file: self, number, text })
    }

    /// The error for the file as a whole, at its last line.
    pub(super) fn refuse_end(&self, detail: impl Into<String>) -> SessionError {
        SessionError::line(&self.path, self.content.lines().count().max(1) as u64, detail)
    }
}

impl<'a> Line<'a> {
    pub(super) fn refuse(&self, detail: impl Into<String>) -> SessionError {
        SessionError::line(&self.file.path, self.number, detail)
    }

    /// Trimmed cells between separators; of a space any number of them separates.
    pub(super) fn cells(&self, separator: char) -> Vec<&'a str> {
        match separator {
            ' ' => self.text.split_whitespace().collect(),
            _ => self.text.split(separator).map(str::trim).collect(),
        }
    }

    /// A finite number in a cell; `column` counts from 0.
    pub(super) fn number_in(&self, column: usize, cell: &str) -> Result<f64, SessionError> {
        cell.parse::<f64>().ok().filter(|value| value.is_finite()).ok_or_else(|| {
            let detail = "is not a finite number: one separator between numbers, a point before decimals";
            self.refuse(format!("column {}: {cell:?} {detail}", column + 1))
        })
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
