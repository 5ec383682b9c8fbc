//! The rows of a Parquet table, as a CSV reader would give them.

use crate::SessionError;
use crate::decimal::decimal_from_ns;
use crate::error::read_bytes;
use crate::parquet_headers::Walked;
use bytes::Bytes;
use csv::StringRecord;
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use std::panic::catch_unwind;
use std::path::Path;

/// Names of the columns, and the rows.
type Rows = (Vec<String>, Vec<StringRecord>);

pub(crate) fn read(path: &Path, role: &str) -> Result<Rows, SessionError> {
    // In memory, as the library reads headers byte by byte.
    let bytes = Bytes::from(read_bytes(path, role)?);
    let broken = |detail: String| {
        SessionError::value(path, "Parquet", format!("{detail}: write the file again, or convert it to CSV"))
    };
    // The library asserts some of what a damaged file may say: a panic is one.
    let rows =
        catch_unwind(|| rows_of(bytes)).map_err(|_| broken("its parts contradict each other".to_owned()))?;
    rows.map_err(|e| broken(e.to_string()))?.map_err(|nested| {
        SessionError::value(path, nested, "is a list or a map: write its parts as columns of their own")
    })
}

/// The rows, or the name of a column that has none of its own in them.
fn rows_of(bytes: Bytes) -> Result<Result<Rows, String>, ParquetError> {
    let reader = SerializedFileReader::new(Walked::new(bytes)?)?;
    let schema = reader.metadata().file_metadata().schema().clone();
    let fields = schema.get_fields();
    if let Some(nested) = fields.iter().find(|f| !f.is_primitive()) {
        return Ok(Err(nested.name().to_owned()));
    }
    let header = fields.iter().map(|f| f.name().to_owned()).collect();
    let mut rows = Vec::new();
    for row in reader.get_row_iter(None)? {
        rows.push(row?.get_column_iter().map(|(_, field)| text_of(field)).collect::<StringRecord>());
    }
    Ok(Ok((header, rows)))
}

fn text_of(field: &Field) -> String {
    match field {
        Field::Null => String::new(),
        Field::Double(x) if x.is_nan() => String::new(),
        Field::Double(x) => format!("{x:?}"),
        Field::Float(x) if x.is_nan() => String::new(),
        Field::Float(x) => format!("{x:?}"),
        Field::Str(text) => text.clone(),
        Field::TimestampMicros(t) => decimal_from_ns(t.saturating_mul(1000)),
        Field::TimestampMillis(t) => decimal_from_ns(t.saturating_mul(1_000_000)),
        other => other.to_string(),
    }
}
