//! Definitions of ULog's messages, flattened to numbers with their places.

use crate::layout::{Budget, Kind, Layout, Place};
use crate::topic::Field;
use std::collections::HashMap;

/// Types within types: PX4 has two.
const DEEPEST: usize = 8;

/// Length of a message's payload at most: it is written in sixteen bits.
const LONGEST: usize = u16::MAX as usize;

/// The definitions of a log, as text.
#[derive(Default)]
pub(super) struct Definitions {
    texts: HashMap<String, String>,
    budget: Budget,
}

/// What a definition comes to.
pub(super) enum Shape {
    /// The numbers of a message, and where its time is.
    Fields { layout: Layout, time_at: Option<usize> },
    /// It, or a type in it, is not defined.
    Unknown,
    /// It is larger than a message.
    TooLarge,
    /// It needs more memory than there is for definitions.
    OverBudget,
}

/// The number of a type of ULog.
pub(super) fn kind(name: &str) -> Option<Kind> {
    Some(match name {
        "int8_t" => Kind::I8,
        "uint8_t" | "bool" | "char" => Kind::U8,
        "int16_t" => Kind::I16,
        "uint16_t" => Kind::U16,
        "int32_t" => Kind::I32,
        "uint32_t" => Kind::U32,
        "int64_t" => Kind::I64,
        "uint64_t" => Kind::U64,
        "float" => Kind::F32,
        "double" => Kind::F64,
        _ => return None,
    })
}

/// A message while it is flattened.
#[derive(Default)]
struct Flat {
    fields: Vec<Field>,
    places: Vec<Place>,
    at: usize,
}

impl Definitions {
    /// Takes a definition; whether there is room for it.
    pub(super) fn define(&mut self, name: &str, fields: &str) -> bool {
        let has_room = self.budget.add(2 * (name.len() + fields.len()) + 64);
        if has_room {
            self.texts.insert(name.to_owned(), fields.to_owned());
        }
        has_room && !name.is_empty()
    }

    /// Flattens a definition: elements of lists are fields by their index, those of types within it have its
    /// name before theirs. Texts and what fills up to a multiple of eight bytes are not among them.
    pub(super) fn shape(&mut self, name: &str) -> Shape {
        let mut flat = Flat::default();
        if let Err(reason) = flatten(&self.texts, &mut self.budget, (name, "", 0), &mut flat) {
            return reason;
        }
        let time = flat.fields.iter().position(|f| f.name == "timestamp").map(|k| flat.places[k]);
        let time_at = time.filter(|place| place.kind == Kind::U64).map(|place| place.at);
        // The time of a sample is no value of it.
        let kept = flat.fields.into_iter().zip(flat.places).filter(|(field, _)| field.name != "timestamp");
        let (fields, places): (Vec<Field>, Vec<Place>) = kept.unzip();
        Shape::Fields { layout: Layout { fields: fields.into(), places: places.into() }, time_at }
    }
}

/// Adds the fields of a type, of a name with what stands before it and a depth.
fn flatten(
    texts: &HashMap<String, String>,
    budget: &mut Budget,
    (name, before, depth): (&str, &str, usize),
    flat: &mut Flat,
) -> Result<(), Shape> {
    if depth > DEEPEST {
        return Err(Shape::TooLarge);
    }
    let text = texts.get(name).ok_or(Shape::Unknown)?;
    for definition in text.split(';').map(str::trim).filter(|d| !d.is_empty()) {
        if !budget.add(before.len() + definition.len() + 8) {
            return Err(Shape::OverBudget);
        }
        let (of, field) = definition.split_once(' ').ok_or(Shape::Unknown)?;
        let (of, count) = match of.split_once('[') {
            None => (of, None),
            Some((of, count)) => {
                let count =
                    count.strip_suffix(']').and_then(|c| c.parse::<usize>().ok()).ok_or(Shape::Unknown)?;
                (of, Some(count))
            }
        };
        let kind = kind(of);
        if let Some(kind) = kind.filter(|_| of == "char" || field.starts_with("_padding")) {
            flat.at = flat.at.saturating_add(count.unwrap_or(1).saturating_mul(kind.size()));
        } else {
            for k in 0..count.unwrap_or(1) {
                let index = count.map_or(String::new(), |_| format!("[{k}]"));
                let whole = format!("{before}{field}{index}");
                let begun = flat.at;
                match kind {
                    Some(kind) => flat.number(budget, whole, kind)?,
                    None => flatten(texts, budget, (of, &(whole + "."), depth + 1), flat)?,
                }
                if flat.at > LONGEST || flat.at == begun {
                    break;
                }
            }
        }
        if flat.at > LONGEST {
            return Err(Shape::TooLarge);
        }
    }
    Ok(())
}

impl Flat {
    fn number(&mut self, budget: &mut Budget, name: String, kind: Kind) -> Result<(), Shape> {
        if !budget.add_field(&name) {
            return Err(Shape::OverBudget);
        }
        self.fields.push(Field { name, unit: None });
        self.places.push(Place { at: self.at, kind, scale: 1.0 });
        self.at += kind.size();
        Ok(())
    }
}
