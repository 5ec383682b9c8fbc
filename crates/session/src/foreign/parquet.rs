//! Parquet tables ↔ our CSV tables: whole numbers, numbers, true and false, or text, a column each; empty
//! cells are null.

use super::text::decimal_from_ns;
use crate::{SessionError, error::require_file, write_whole};
use csv::StringRecord;
use parquet::basic::{ConvertedType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::record::Field;
use parquet::schema::types::Type;
use std::path::Path;
use std::sync::Arc;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Whole,
    Number,
    Boolean,
    Text,
}

/// A table's header and rows, as a CSV reader would give them.
pub(crate) fn records(path: &Path) -> Result<(Vec<String>, Vec<StringRecord>), SessionError> {
    require_file(path, "Parquet table")?;
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

/// Reads a Parquet table and writes it as CSV.
///
/// # Errors
/// Not Parquet, damaged, or with columns that are lists or maps; what the file system refuses.
pub fn to_csv(from: &Path, to: &Path) -> Result<(), SessionError> {
    let (header, rows) = records(from)?;
    let mut writer = csv::Writer::from_writer(Vec::new());
    let failed =
        |e: csv::Error| SessionError::io(to, "express it as CSV", std::io::Error::other(e.to_string()));
    writer.write_record(&header).map_err(failed)?;
    for row in rows {
        writer.write_record(&row).map_err(failed)?;
    }
    write_whole(to, &writer.into_inner().unwrap_or_default())
}

/// Reads a CSV table with a header and writes it as Parquet.
///
/// # Errors
/// A table without rows or with rows of unequal length, named by line; a name that is there twice.
pub fn from_csv(from: &Path, to: &Path) -> Result<(), SessionError> {
    let table = crate::table::Table::read(from, "table")?;
    let header: Vec<String> = table.names().map(str::to_owned).collect();
    if let Some(twice) =
        header.iter().enumerate().find(|(k, name)| name.is_empty() || header[..*k].contains(name))
    {
        return Err(SessionError::value(
            from,
            "header",
            format!("column {} is {:?}, empty or there twice: rename it", twice.0 + 1, twice.1),
        ));
    }
    let columns: Vec<Vec<&str>> =
        (0..header.len()).map(|k| table.rows_if_any().map(|row| row.text(k)).collect()).collect();
    let kinds: Vec<Kind> = columns.iter().map(|c| kind_of(c)).collect();
    let bytes =
        encode(&header, &kinds, &columns).map_err(|e| SessionError::value(to, "Parquet", e.to_string()))?;
    write_whole(to, &bytes)
}

fn kind_of(cells: &[&str]) -> Kind {
    let mut filled = cells.iter().filter(|c| !c.is_empty()).peekable();
    if filled.peek().is_none() {
        return Kind::Number;
    }
    let all = |test: fn(&str) -> bool| cells.iter().filter(|c| !c.is_empty()).all(|c| test(c));
    match () {
        () if all(|c| c.parse::<i64>().is_ok_and(|n| n.to_string() == c)) => Kind::Whole,
        () if all(|c| c.parse::<f64>().is_ok()) => Kind::Number,
        () if all(|c| c == "true" || c == "false") => Kind::Boolean,
        () => Kind::Text,
    }
}

fn encode(header: &[String], kinds: &[Kind], columns: &[Vec<&str>]) -> Result<Vec<u8>, ParquetError> {
    let field = |(name, kind): (&String, &Kind)| {
        let physical = match kind {
            Kind::Whole => Physical::INT64,
            Kind::Number => Physical::DOUBLE,
            Kind::Boolean => Physical::BOOLEAN,
            Kind::Text => Physical::BYTE_ARRAY,
        };
        let converted = if *kind == Kind::Text { ConvertedType::UTF8 } else { ConvertedType::NONE };
        let built = Type::primitive_type_builder(name, physical)
            .with_repetition(Repetition::OPTIONAL)
            .with_converted_type(converted)
            .build();
        built.map(Arc::new)
    };
    let fields = header.iter().zip(kinds).map(field).collect::<Result<Vec<_>, _>>()?;
    let schema = Arc::new(Type::group_type_builder("table").with_fields(fields).build()?);
    let mut writer =
        SerializedFileWriter::new(Vec::new(), schema, Arc::new(WriterProperties::builder().build()))?;
    let mut group = writer.next_row_group()?;
    for (kind, cells) in kinds.iter().zip(columns) {
        let Some(mut column) = group.next_column()? else { break };
        write_column(&mut column, *kind, cells)?;
        column.close()?;
    }
    group.close()?;
    writer.into_inner()
}

fn write_column(
    column: &mut SerializedColumnWriter<'_>,
    kind: Kind,
    cells: &[&str],
) -> Result<(), ParquetError> {
    let levels: Vec<i16> = cells.iter().map(|c| i16::from(!c.is_empty())).collect();
    let filled = || cells.iter().filter(|c| !c.is_empty());
    // What is written was seen to parse by `kind_of`.
    match kind {
        Kind::Whole => {
            let values: Vec<i64> = filled().filter_map(|c| c.parse().ok()).collect();
            column.typed::<Int64Type>().write_batch(&values, Some(&levels), None)?;
        }
        Kind::Number => {
            let values: Vec<f64> = filled().filter_map(|c| c.parse().ok()).collect();
            column.typed::<DoubleType>().write_batch(&values, Some(&levels), None)?;
        }
        Kind::Boolean => {
            let values: Vec<bool> = filled().map(|c| *c == "true").collect();
            column.typed::<BoolType>().write_batch(&values, Some(&levels), None)?;
        }
        Kind::Text => {
            let values: Vec<ByteArray> = filled().map(|c| ByteArray::from(*c)).collect();
            column.typed::<ByteArrayType>().write_batch(&values, Some(&levels), None)?;
        }
    }
    Ok(())
}
