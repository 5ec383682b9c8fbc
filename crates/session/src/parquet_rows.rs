//! The rows of a Parquet table, as a CSV reader would give them.

use crate::SessionError;
use crate::decimal::decimal_from_ns;
use crate::error::require_file;
use csv::StringRecord;
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use std::path::Path;

pub(crate) fn read(path: &Path, role: &str) -> Result<(Vec<String>, Vec<StringRecord>), SessionError> {
    require_file(path, role)?;
    let broken = |e: ParquetError| {
        SessionError::value(path, "Parquet", format!("{e}: write the file again, or convert it to CSV"))
    };
    let file = std::fs::File::open(path).map_err(|e| SessionError::io(path, "read it", e))?;
    let reader = SerializedFileReader::new(file).map_err(broken)?;
    let schema = reader.metadata().file_metadata().schema().clone();
    let fields = schema.get_fields();
    if let Some(nested) = fields.iter().find(|f| !f.is_primitive()) {
        return Err(SessionError::value(
            path,
            nested.name(),
            "is a list or a map: write its parts as columns of their own",
        ));
    }
    let header = fields.iter().map(|f| f.name().to_owned()).collect();
    let mut rows = Vec::new();
    for row in reader.get_row_iter(None).map_err(broken)? {
        let row = row.map_err(broken)?;
        rows.push(row.get_column_iter().map(|(_, field)| text_of(field)).collect::<StringRecord>());
    }
    Ok((header, rows))
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
