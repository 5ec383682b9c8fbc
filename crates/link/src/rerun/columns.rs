//! The columns of a chunk, as Rerun's types have them in Arrow.

use arrow_array::types::{DurationNanosecondType, Float32Type, TimestampNanosecondType};
use arrow_array::{
    Array, ArrayRef, ArrowPrimitiveType, FixedSizeBinaryArray, FixedSizeListArray, ListArray, PrimitiveArray,
    RecordBatch,
};
use arrow_buffer::OffsetBuffer;
use arrow_ipc::MetadataVersion;
use arrow_ipc::writer::{IpcWriteOptions, StreamWriter};
use arrow_schema::{ArrowError, Field, Schema};
use std::collections::HashMap;
use std::sync::Arc;

/// A column, and what Rerun reads it as.
pub(super) type Column = (Field, ArrayRef);

/// Key of a column that is a timeline.
pub(super) const INDEX: &str = "rerun:index_name";

fn column(name: &str, array: ArrayRef, nullable: bool, about: &[(&str, &str)]) -> Column {
    let about = HashMap::from_iter(about.iter().map(|(key, value)| ((*key).into(), (*value).into())));
    (Field::new(name, array.data_type().clone(), nullable).with_metadata(about), array)
}

/// A component of an archetype, one list a row.
pub(super) fn component(archetype: &str, field: &str, of: &str, lists: ListArray) -> Column {
    let name = format!("{archetype}:{field}");
    let about = [
        ("rerun:archetype", &*format!("rerun.archetypes.{archetype}")),
        ("rerun:component", &name),
        ("rerun:component_type", &format!("rerun.components.{of}")),
        ("rerun:kind", "data"),
    ];
    column(&name, Arc::new(lists), true, &about)
}

fn index<T: ArrowPrimitiveType>(name: &str, times: impl IntoIterator<Item = T::Native>) -> Column {
    let about = [(INDEX, name), ("rerun:is_sorted", "true"), ("rerun:kind", "index")];
    column(name, Arc::new(PrimitiveArray::<T>::from_iter_values(times)), true, &about)
}

pub(super) fn captured(captured_ns: impl IntoIterator<Item = i64>) -> Column {
    index::<TimestampNanosecondType>("captured", captured_ns)
}

pub(super) fn flight_time(t_s: impl IntoIterator<Item = f64>) -> Column {
    index::<DurationNanosecondType>("t", t_s.into_iter().map(|t_s| (t_s * 1e9).round() as i64))
}

/// The numbers of the rows, 16 bytes each.
pub(super) fn row_ids(ids: Vec<u8>) -> Column {
    let about = [
        ("ARROW:extension:metadata", r#"{"namespace":"row"}"#),
        ("ARROW:extension:name", "rerun.datatypes.TUID"),
        ("rerun:is_sorted", "true"),
        ("rerun:kind", "control"),
    ];
    column("rerun.controls.RowId", Arc::new(FixedSizeBinaryArray::new(16, ids.into(), None)), false, &about)
}

pub(super) fn lists(rows: impl IntoIterator<Item = usize>, items: impl Array + 'static) -> ListArray {
    let item = Field::new_list_field(items.data_type().clone(), true);
    ListArray::new(Arc::new(item), OffsetBuffer::from_lengths(rows), Arc::new(items), None)
}

/// Items by N; those of a fixed number are never missing, by Rerun's types.
pub(super) fn fixed<const N: i32>(items: impl Array + 'static) -> FixedSizeListArray {
    let item = Field::new_list_field(items.data_type().clone(), false);
    FixedSizeListArray::new(Arc::new(item), N, Arc::new(items), None)
}

pub(super) fn floats<'a>(values: impl IntoIterator<Item = &'a f64>) -> PrimitiveArray<Float32Type> {
    PrimitiveArray::from_iter_values(values.into_iter().map(|v| *v as f32))
}

/// The Arrow IPC stream of one record batch.
pub(super) fn stream(columns: Vec<Column>, about: HashMap<String, String>) -> Result<Vec<u8>, ArrowError> {
    let (fields, arrays): (Vec<Field>, Vec<ArrayRef>) = columns.into_iter().unzip();
    let schema = Arc::new(Schema::new_with_metadata(fields, about));
    let batch = RecordBatch::try_new(Arc::clone(&schema), arrays)?;
    let options = IpcWriteOptions::try_new(8, false, MetadataVersion::V5)?;
    let mut writer = StreamWriter::try_new_with_options(Vec::new(), &schema, options)?;
    writer.write(&batch)?;
    writer.into_inner()
}
