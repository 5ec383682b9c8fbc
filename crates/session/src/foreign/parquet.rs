//! Parquet tables ↔ our CSV tables: whole numbers, numbers, true and false, or text, a column each; empty
//! cells are null.

use crate::{SessionError, parquet_rows, write_csv, write_whole};
use parquet::basic::{ConvertedType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::types::Type;
use std::path::Path;
use std::sync::Arc;

/// Reads a Parquet table and writes it as CSV.
///
/// # Errors
/// Not Parquet, damaged, or with columns that are lists or maps; what the file system refuses.
pub fn to_csv(from: &Path, to: &Path) -> Result<(), SessionError> {
    let (header, rows) = parquet_rows::read(from, "Parquet table")?;
    write_csv(to, header, rows.iter().map(|row| row.iter().collect::<Vec<_>>()))
}

/// Reads a CSV table with a header and writes it as Parquet.
///
/// # Errors
/// A table without rows or with rows of unequal length, named by line; a name that is there twice.
pub fn from_csv(from: &Path, to: &Path) -> Result<(), SessionError> {
    let table = crate::table::Table::read(from, "table")?;
    let header: Vec<String> = table.names().map(str::to_owned).collect();
    let is_wrong = |(k, name): &(usize, &String)| name.is_empty() || header[..*k].contains(name);
    if let Some((k, name)) = header.iter().enumerate().find(is_wrong) {
        let detail = format!("column {} is {name:?}, empty or there twice: rename it", k + 1);
        return Err(SessionError::value(from, "header", detail));
    }
    let columns: Vec<Vec<&str>> =
        (0..header.len()).map(|k| table.rows_if_any().map(|row| row.text(k)).collect()).collect();
    let bytes = encode(&header, &columns).map_err(|e| SessionError::value(to, "Parquet", e.to_string()))?;
    write_whole(to, &bytes)
}

/// The type that holds all cells of a column; empty ones are null.
fn type_of(cells: &[&str]) -> Physical {
    let all = |test: fn(&str) -> bool| cells.iter().filter(|c| !c.is_empty()).all(|c| test(c));
    match () {
        () if all(|_| false) => Physical::DOUBLE,
        () if all(|c| c.parse::<i64>().is_ok_and(|n| n.to_string() == c)) => Physical::INT64,
        () if all(|c| c.parse::<f64>().is_ok()) => Physical::DOUBLE,
        () if all(|c| c == "true" || c == "false") => Physical::BOOLEAN,
        () => Physical::BYTE_ARRAY,
    }
}

fn encode(header: &[String], columns: &[Vec<&str>]) -> Result<Vec<u8>, ParquetError> {
    let types: Vec<Physical> = columns.iter().map(|c| type_of(c)).collect();
    let field = |(name, physical): (&String, &Physical)| {
        let is_text = *physical == Physical::BYTE_ARRAY;
        let built = Type::primitive_type_builder(name, *physical)
            .with_repetition(Repetition::OPTIONAL)
            .with_converted_type(if is_text { ConvertedType::UTF8 } else { ConvertedType::NONE })
            .build();
        built.map(Arc::new)
    };
    let fields = header.iter().zip(&types).map(field).collect::<Result<Vec<_>, _>>()?;
    let schema = Arc::new(Type::group_type_builder("table").with_fields(fields).build()?);
    let mut writer =
        SerializedFileWriter::new(Vec::new(), schema, Arc::new(WriterProperties::builder().build()))?;
    let mut group = writer.next_row_group()?;
    for (physical, cells) in types.iter().zip(columns) {
        let Some(mut column) = group.next_column()? else { break };
        match physical {
            Physical::INT64 => write::<Int64Type>(&mut column, cells, |c| c.parse().ok()),
            Physical::DOUBLE => write::<DoubleType>(&mut column, cells, |c| c.parse().ok()),
            Physical::BOOLEAN => write::<BoolType>(&mut column, cells, |c| Some(c == "true")),
            _ => write::<ByteArrayType>(&mut column, cells, |c| Some(ByteArray::from(c))),
        }?;
        column.close()?;
    }
    group.close()?;
    writer.into_inner()
}

fn write<T: DataType>(
    column: &mut SerializedColumnWriter<'_>,
    cells: &[&str],
    value: fn(&str) -> Option<T::T>,
) -> Result<usize, ParquetError> {
    let levels: Vec<i16> = cells.iter().map(|c| i16::from(!c.is_empty())).collect();
    let values: Vec<T::T> = cells.iter().filter(|c| !c.is_empty()).filter_map(|c| value(c)).collect();
    column.typed::<T>().write_batch(&values, Some(&levels), None)
}
