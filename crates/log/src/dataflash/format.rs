//! A type of record, as its FMT and FMTU define it.

use super::{HEAD, number_of, text_length};
use crate::layout::{Layout, Place};
use crate::topic::Field;
use std::collections::HashMap;

/// The unit of a field that says which of several sensors a record is of.
const INSTANCE: u8 = b'#';

/// A type of record.
pub(super) struct Format {
    pub(super) name: String,
    /// With the head.
    pub(super) length: usize,
    /// The FMT that defined it.
    pub(super) definition: Vec<u8>,
    pub(super) layout: Layout,
    /// Which column each field of the layout is.
    columns: Vec<usize>,
    time: Option<(Place, i64)>,
    texts: Vec<(String, std::ops::Range<usize>)>,
    pub(super) instance_at: Option<usize>,
}

/// A text up to its end.
fn text_of(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes.split(|b| *b == 0).next().unwrap_or_default()).into_owned()
}

impl Format {
    /// Reads a FMT without its head: type, length, name, characters, names of the columns; `None` where it is
    /// cut short, the name where its length is not that of its fields.
    pub(super) fn parse(record: &[u8]) -> Option<Result<(u8, Self), String>> {
        let (kind, length) = (*record.first()?, usize::from(*record.get(1)?));
        let name = text_of(record.get(2..6)?);
        let characters = text_of(record.get(6..22)?);
        let names = text_of(record.get(22..86)?);
        let (mut fields, mut places, mut columns, mut texts) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let (mut at, mut time) = (0, None);
        for (k, (character, column)) in characters.bytes().zip(names.split(',')).enumerate() {
            let column = column.trim();
            if let Some((kind, scale)) = number_of(character) {
                let place = Place { at, kind, scale };
                match column {
                    "TimeUS" => time = Some((place, 1000)),
                    "TimeMS" if time.is_none() => time = Some((place, 1_000_000)),
                    _ => {
                        fields.push(Field { name: column.to_owned(), unit: None });
                        places.push(place);
                        columns.push(k);
                    }
                }
                at += kind.size();
            } else if let Some(length) = text_length(character) {
                texts.push((column.to_owned(), at..at + length));
                at += length;
            } else {
                return Some(Err(name));
            }
        }
        if length != HEAD + at || names.split(',').filter(|n| !n.is_empty()).count() != characters.len() {
            return Some(Err(name));
        }
        let layout = Layout { fields: fields.into(), places: places.into() };
        let definition = record.to_vec();
        Some(Ok((kind, Self { name, length, definition, layout, columns, time, texts, instance_at: None })))
    }

    /// Gives the fields their units. A field whose character has a factor has been multiplied by it; others
    /// have that of the multiplier.
    pub(super) fn set_units(
        &mut self,
        units: &[u8],
        multipliers: &[u8],
        (known_units, known_multipliers): (&HashMap<u8, String>, &HashMap<u8, f64>),
    ) {
        let (mut fields, mut places) = (self.layout.fields.to_vec(), self.layout.places.to_vec());
        let characters = text_of(self.definition.get(6..22).unwrap_or_default()).into_bytes();
        for ((field, place), column) in fields.iter_mut().zip(&mut places).zip(&self.columns) {
            let Some(unit) = units.get(*column) else { continue };
            if *unit == INSTANCE && place.kind.size() == 1 {
                self.instance_at = Some(place.at);
                continue;
            }
            field.unit =
                known_units.get(unit).filter(|label| !label.is_empty() && **label != "UNKNOWN").cloned();
            let own = characters.get(*column).and_then(|c| number_of(*c)).map_or(1.0, |(_, scale)| scale);
            let multiplier = multipliers.get(*column).and_then(|id| known_multipliers.get(id));
            let multiplier = multiplier.copied().filter(|m| m.is_finite() && *m > 0.0).unwrap_or(1.0);
            place.scale = if own == 1.0 && field.unit.is_some() { multiplier } else { own };
        }
        self.layout = Layout { fields: fields.into(), places: places.into() };
    }

    /// The time of a record; `None` of a type without, and beyond all clocks.
    pub(super) fn time_ns(&self, record: &[u8]) -> Option<i64> {
        let (place, unit_ns) = self.time?;
        let ticks = place.kind.number(record, place.at);
        // Whole numbers are exact in a double up to there.
        let is_exact = (0.0..9e15).contains(&ticks);
        (ticks as i64).checked_mul(unit_ns).filter(|_| is_exact)
    }

    /// A number by its column.
    pub(super) fn number(&self, record: &[u8], column: &str) -> Option<f64> {
        let place = self.layout.fields.iter().position(|f| f.name == column)?;
        Some(self.layout.places[place].number(record))
    }

    /// A number of one byte by its column.
    pub(super) fn byte(&self, record: &[u8], column: &str) -> Option<u8> {
        let place = self.layout.fields.iter().position(|f| f.name == column)?;
        record.get(self.layout.places[place].at).copied()
    }

    /// The bytes of a text by its column.
    pub(super) fn bytes<'a>(&self, record: &'a [u8], column: &str) -> Option<&'a [u8]> {
        record.get(self.texts.iter().find(|(name, _)| name == column)?.1.clone())
    }

    /// A text by its column.
    pub(super) fn text(&self, record: &[u8], column: &str) -> Option<String> {
        self.bytes(record, column).map(text_of)
    }
}
