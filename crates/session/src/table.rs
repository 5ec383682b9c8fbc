//! Comma-separated tables with a header, read by column name.

use crate::{SessionError, error::read_text, files::PartFile};
use csv::StringRecord;
use serde::Serialize;
use std::io;
use std::path::{Path, PathBuf};

/// Lines of a table after its header; cells are quoted where needed, also those that begin like a comment.
pub(crate) fn csv_lines<T: AsRef<[u8]>>(
    out: &mut dyn io::Write,
    header: impl IntoIterator<Item = T>,
) -> io::Result<csv::Writer<&mut dyn io::Write>> {
    let mut lines = csv::WriterBuilder::new().comment(Some(b'#')).has_headers(false).from_writer(out);
    lines.write_record(header)?;
    Ok(lines)
}

/// Writes a table, each row from a list, tuple or struct; cells that need quotes get them.
///
/// # Errors
/// What the file system refuses.
pub fn write_csv<T: AsRef<[u8]>>(
    path: &Path,
    header: impl IntoIterator<Item = T>,
    rows: impl IntoIterator<Item = impl Serialize>,
) -> Result<(), SessionError> {
    let write = |out: &mut dyn io::Write| {
        let mut lines = csv_lines(out, header)?;
        rows.into_iter().try_for_each(|row| lines.serialize(row))?;
        lines.flush()
    };
    PartFile::write(path, write)?.keep()
}

/// A table in memory. Its errors are a file that is missing, a row that is broken, no rows where there must
/// be one, and a column that is not there, with those that are.
pub struct Table {
    path: PathBuf,
    columns: Vec<String>,
    rows: Vec<StringRecord>,
}

/// A row of a [`Table`]. Its errors name row, line and column.
#[derive(Clone, Copy)]
pub struct Row<'a> {
    table: &'a Table,
    index: usize,
}

impl Table {
    /// Reads a table, a Parquet one by its name; spaces around cells do not count, lines that begin with `#`
    /// neither.
    pub fn read(path: &Path, role: &str) -> Result<Self, SessionError> {
        #[cfg(feature = "parquet")]
        if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("parquet")) {
            let (columns, rows) = crate::parquet_rows::read(path, role)?;
            return Ok(Self { path: path.to_owned(), columns, rows });
        }
        let text = read_text(path, role)?;
        let mut reader =
            csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(text.as_bytes());
        let broken = |error: csv::Error| {
            let detail = match error.kind() {
                csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
                    format!("{len} cells where the header has {expected_len}: complete the row")
                }
                _ => error.to_string(),
            };
            SessionError::line(path, error.position().map_or(1, csv::Position::line), detail)
        };
        let columns = reader.headers().map_err(broken)?.iter().map(str::to_owned).collect();
        let rows = reader.records().collect::<Result<_, _>>().map_err(broken)?;
        Ok(Self { path: path.to_owned(), columns, rows })
    }

    /// The rows, at least one.
    pub fn rows(&self) -> Result<impl Iterator<Item = Row<'_>>, SessionError> {
        if self.rows.is_empty() {
            return Err(SessionError::no_rows(&self.path));
        }
        Ok(self.rows_if_any())
    }

    /// The rows, perhaps none.
    pub fn rows_if_any(&self) -> impl Iterator<Item = Row<'_>> {
        (0..self.rows.len()).map(move |index| Row { table: self, index })
    }

    /// The texts of a column, each once, in the order of their first appearance.
    pub(crate) fn distinct(&self, column: usize) -> Vec<String> {
        let mut all: Vec<String> = Vec::new();
        for row in self.rows_if_any() {
            if !all.iter().any(|name| name == row.text(column)) {
                all.push(row.text(column).to_owned());
            }
        }
        all
    }

    /// Names of the columns.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.columns.iter().map(String::as_str)
    }

    /// The place of a column that must be there.
    pub fn column(&self, name: &str) -> Result<usize, SessionError> {
        self.columns.iter().position(|c| c == name).ok_or_else(|| {
            let found = match &self.columns[..] {
                [one] if one.contains([';', '\t']) => format!("{one} (one column: put commas between)"),
                all => all.join(", "),
            };
            let detail = format!("there is no column {name:?}; the columns are {found}: add or rename it");
            SessionError::file(&self.path, detail)
        })
    }

    /// The places of several columns that must be there.
    pub fn columns<const N: usize>(&self, names: [&str; N]) -> Result<[usize; N], SessionError> {
        let mut places = [0; N];
        for (place, name) in places.iter_mut().zip(names) {
            *place = self.column(name)?;
        }
        Ok(places)
    }
}

impl<'a> Row<'a> {
    /// Text of a cell.
    pub fn text(&self, column: usize) -> &'a str {
        self.table.rows[self.index].get(column).unwrap_or("")
    }

    /// A finite number.
    pub fn number(&self, column: usize) -> Result<f64, SessionError> {
        let text = self.text(column);
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ if text.is_empty() => Err(self.refuse(column, "the cell is empty where a number must be")),
            _ => {
                let detail = format!("{text:?} is not a finite number: correct or remove the row");
                Err(self.refuse(column, detail))
            }
        }
    }

    /// A finite number, or nothing in an empty cell.
    pub fn number_if_any(&self, column: usize) -> Result<Option<f64>, SessionError> {
        if self.text(column).is_empty() { Ok(None) } else { self.number(column).map(Some) }
    }

    /// Several numbers at once.
    pub fn numbers<const N: usize>(&self, columns: [usize; N]) -> Result<[f64; N], SessionError> {
        let mut values = [0.0; N];
        for (value, column) in values.iter_mut().zip(columns) {
            *value = self.number(column)?;
        }
        Ok(values)
    }

    /// A time in seconds as nanoseconds.
    pub fn time_ns(&self, column: usize) -> Result<i64, SessionError> {
        let t_s = self.number(column)?;
        // Digit by digit: seconds since 1970 have more of them than a double.
        crate::decimal::ns_from_decimal(self.text(column)).ok_or_else(|| {
            self.refuse(column, format!("{t_s} s is more than 146 years from zero: give seconds"))
        })
    }

    /// The place of a cell's text among the names that it may hold.
    pub fn place_in<T: AsRef<str>>(&self, column: usize, names: &[T]) -> Result<usize, SessionError> {
        let text = self.text(column);
        names.iter().position(|n| n.as_ref() == text).ok_or_else(|| {
            let known: Vec<&str> = names.iter().map(AsRef::as_ref).collect();
            self.refuse(column, format!("{text:?} is not known: use one of {}", known.join(", ")))
        })
    }

    /// The error for a cell of this row.
    pub fn refuse(&self, column: usize, detail: impl Into<String>) -> SessionError {
        let (row, record) = (self.index + 1, &self.table.rows[self.index]);
        let line = record.position().map_or(row as u64 + 1, csv::Position::line);
        let column = self.table.columns.get(column).map_or("", String::as_str);
        let place = format!(", row {row} below the header (line {line}), column {column}");
        SessionError::at(&self.table.path, place, detail)
    }
}
