//! Comma-separated tables with a header, read by column name.

use crate::{SessionError, error::require_file};
use csv::StringRecord;
use std::borrow::Cow;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

/// What some programs put before UTF-8.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// A cell of a table as readers here have it back: in quotes where it holds a comma, a quote or a line break,
/// or begins with what makes a comment.
pub fn csv_cell(text: &str) -> Cow<'_, str> {
    if text.contains([',', '"', '\n', '\r']) || text.starts_with('#') {
        Cow::Owned(format!("\"{}\"", text.replace('"', "\"\"")))
    } else {
        Cow::Borrowed(text)
    }
}

/// A table in memory; an hour of inputs has some hundred thousand rows, so that cells have no allocations of
/// their own.
pub struct Table {
    path: PathBuf,
    columns: Vec<String>,
    /// All cells, one behind the other, row by row.
    cells: String,
    /// Where each cell ends.
    ends: Vec<usize>,
    /// The file's line of each row.
    lines: Vec<u64>,
}

/// One row of it.
#[derive(Clone, Copy)]
pub struct Row<'a> {
    table: &'a Table,
    index: usize,
}

impl Table {
    /// Reads a table, a Parquet one by its name; spaces around cells do not count, lines that begin with `#`
    /// neither.
    ///
    /// # Errors
    /// A file that is missing, or of which a row is broken.
    pub fn read(path: &Path, role: &str) -> Result<Self, SessionError> {
        require_file(path, role)?;
        #[cfg(feature = "parquet")]
        if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("parquet")) {
            let (columns, rows) = crate::foreign::parquet::records(path)?;
            let mut table = Self::new(path, columns);
            rows.iter().for_each(|row| table.push(row));
            return Ok(table);
        }
        let io = |e| SessionError::io(path, "read it", e);
        let mut text = BufReader::new(File::open(path).map_err(io)?);
        if text.fill_buf().map_err(io)?.starts_with(BYTE_ORDER_MARK) {
            text.consume(BYTE_ORDER_MARK.len());
        }
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(text);
        let broken = |error: csv::Error| SessionError::Row {
            path: path.to_owned(),
            line: error.position().map_or(1, csv::Position::line),
            detail: describe(&error),
        };
        let columns = reader.headers().map_err(broken)?.iter().map(str::to_owned).collect();
        let mut table = Self::new(path, columns);
        let mut row = StringRecord::new();
        while reader.read_record(&mut row).map_err(broken)? {
            table.push(&row);
        }
        Ok(table)
    }

    fn new(path: &Path, columns: Vec<String>) -> Self {
        Self { path: path.to_owned(), columns, cells: String::new(), ends: Vec::new(), lines: Vec::new() }
    }

    /// Adds a row; what it has beyond the columns is left out.
    fn push(&mut self, row: &StringRecord) {
        for column in 0..self.columns.len() {
            self.cells.push_str(row.get(column).unwrap_or(""));
            self.ends.push(self.cells.len());
        }
        let usual = self.lines.len() as u64 + 2;
        self.lines.push(row.position().map_or(usual, csv::Position::line));
    }

    fn cell(&self, row: usize, column: usize) -> &str {
        let at = row * self.columns.len() + column;
        let from = at.checked_sub(1).map_or(0, |before| self.ends[before]);
        if column < self.columns.len() { &self.cells[from..self.ends[at]] } else { "" }
    }

    /// The rows, at least one.
    ///
    /// # Errors
    /// A table without rows.
    pub fn rows(&self) -> Result<impl Iterator<Item = Row<'_>>, SessionError> {
        if self.lines.is_empty() {
            return Err(SessionError::EmptyTable { path: self.path.clone() });
        }
        Ok(self.rows_if_any())
    }

    /// The rows, perhaps none.
    pub fn rows_if_any(&self) -> impl Iterator<Item = Row<'_>> {
        (0..self.lines.len()).map(move |index| Row { table: self, index })
    }

    /// Names of the columns.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.columns.iter().map(String::as_str)
    }

    /// The place of a column that must be there.
    ///
    /// # Errors
    /// Names the columns found.
    pub fn column(&self, name: &str) -> Result<usize, SessionError> {
        self.column_if_any(name).ok_or_else(|| {
            let found = match &self.columns[..] {
                [one] if one.contains([';', '\t']) => format!("{one} (one column: put commas between)"),
                all => all.join(", "),
            };
            let detail = format!("there is no column {name:?}; the columns are {found}: add or rename it");
            SessionError::File { path: self.path.clone(), detail }
        })
    }

    /// The place of a column that may be left out.
    pub fn column_if_any(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|c| c == name)
    }

    /// The places of several columns that must be there.
    ///
    /// # Errors
    /// Names the columns found.
    pub fn columns<const N: usize>(&self, names: [&str; N]) -> Result<[usize; N], SessionError> {
        let mut places = [0; N];
        for (place, name) in places.iter_mut().zip(names) {
            *place = self.column(name)?;
        }
        Ok(places)
    }
}

fn describe(error: &csv::Error) -> String {
    match error.kind() {
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            format!("{len} cells where the header has {expected_len}: complete the row")
        }
        csv::ErrorKind::Utf8 { .. } => "not UTF-8 text: save the table as UTF-8".into(),
        _ => error.to_string(),
    }
}

impl<'a> Row<'a> {
    /// Text of a cell.
    pub fn text(&self, column: usize) -> &'a str {
        self.table.cell(self.index, column)
    }

    /// A finite number.
    ///
    /// # Errors
    /// Names row and column.
    pub fn number(&self, column: usize) -> Result<f64, SessionError> {
        let text = self.text(column);
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ if text.is_empty() => {
                Err(self.refuse(column, "the cell is empty where a number must be".into()))
            }
            _ => {
                Err(self
                    .refuse(column, format!("{text:?} is not a finite number: correct or remove the row")))
            }
        }
    }

    /// A finite number, or nothing in an empty cell.
    ///
    /// # Errors
    /// Names row and column.
    pub fn number_if_any(&self, column: usize) -> Result<Option<f64>, SessionError> {
        if self.text(column).is_empty() { Ok(None) } else { self.number(column).map(Some) }
    }

    /// Several numbers at once.
    ///
    /// # Errors
    /// Names row and column.
    pub fn numbers<const N: usize>(&self, columns: [usize; N]) -> Result<[f64; N], SessionError> {
        let mut values = [0.0; N];
        for (value, column) in values.iter_mut().zip(columns) {
            *value = self.number(column)?;
        }
        Ok(values)
    }

    /// A time in seconds as nanoseconds.
    ///
    /// # Errors
    /// Names row and column.
    pub fn time_ns(&self, column: usize) -> Result<i64, SessionError> {
        let t_s = self.number(column)?;
        if t_s.abs() < 9e9 {
            // Digit by digit where it is a plain decimal: seconds since 1970 have more of them than a double.
            Ok(crate::foreign::text::ns_from_decimal(self.text(column))
                .unwrap_or_else(|| crate::ns_from_s(t_s)))
        } else {
            Err(self.refuse(column, format!("{t_s} s is beyond what nanoseconds can count: give seconds")))
        }
    }

    /// The error for a cell of this row.
    pub fn refuse(&self, column: usize, detail: String) -> SessionError {
        SessionError::Cell {
            path: self.table.path.clone(),
            row: self.index + 1,
            line: self.table.lines[self.index],
            column: self.table.columns.get(column).cloned().unwrap_or_default(),
            detail,
        }
    }
}
