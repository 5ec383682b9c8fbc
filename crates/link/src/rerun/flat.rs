//! FlatBuffers, as much as Arrow's messages need: tables, texts and lists of them, written from the start to
//! the end, so that every offset but that of a table's layout points forward.

/// A value of a FlatBuffer.
pub(super) enum Flat {
    /// A whole number of any width: each has eight bytes of its table.
    Number(i64),
    Text(String),
    /// Fields by their number.
    Table(Vec<(u16, Flat)>),
    /// Tables.
    List(Vec<Flat>),
    /// Structs of two numbers.
    Pairs(Vec<[i64; 2]>),
}

/// The buffer whose root is a table.
pub(super) fn buffer(root: &Flat) -> Vec<u8> {
    let mut out = vec![0; 4];
    let at = root.write(&mut out);
    patch(&mut out, 0, at);
    out
}

/// Sets an offset to what lies behind it.
fn patch(out: &mut [u8], slot: usize, target: usize) {
    out[slot..slot + 4].copy_from_slice(&((target - slot) as u32).to_le_bytes());
}

fn pad(out: &mut Vec<u8>, to: usize, rest: usize) {
    while out.len() % to != rest {
        out.push(0);
    }
}

impl Flat {
    /// Writes what has a place of its own; where it begins.
    fn write(&self, out: &mut Vec<u8>) -> usize {
        match self {
            Self::Text(text) => {
                pad(out, 4, 0);
                let at = out.len();
                out.extend((text.len() as u32).to_le_bytes());
                out.extend(text.as_bytes());
                out.push(0);
                at
            }
            Self::List(items) => {
                pad(out, 4, 0);
                let at = out.len();
                out.extend((items.len() as u32).to_le_bytes());
                out.resize(out.len() + 4 * items.len(), 0);
                for (k, item) in items.iter().enumerate() {
                    let target = item.write(out);
                    patch(out, at + 4 + 4 * k, target);
                }
                at
            }
            Self::Pairs(pairs) => {
                pad(out, 8, 4);
                let at = out.len();
                out.extend((pairs.len() as u32).to_le_bytes());
                pairs.iter().flatten().for_each(|n| out.extend(n.to_le_bytes()));
                at
            }
            Self::Table(fields) => write_table(fields, out),
            // Numbers lie within their table.
            Self::Number(_) => out.len(),
        }
    }
}

/// Each field in eight bytes, which is aligned for all.
fn write_table(fields: &[(u16, Flat)], out: &mut Vec<u8>) -> usize {
    pad(out, 4, 0);
    let (layout, slots) = (out.len(), fields.iter().map(|f| f.0 + 1).max().unwrap_or(0));
    out.extend((4 + 2 * slots).to_le_bytes());
    out.extend((4 + 8 * fields.len() as u16).to_le_bytes());
    for slot in 0..slots {
        let place = fields.iter().position(|f| f.0 == slot).map_or(0, |k| 4 + 8 * k as u16);
        out.extend(place.to_le_bytes());
    }
    pad(out, 8, 4);
    let at = out.len();
    out.extend(((at - layout) as i32).to_le_bytes());
    for (_, value) in fields {
        let number = if let Flat::Number(n) = value { *n } else { 0 };
        out.extend(number.to_le_bytes());
    }
    for (k, (_, value)) in fields.iter().enumerate() {
        if !matches!(value, Flat::Number(_)) {
            let target = value.write(out);
            patch(out, at + 4 + 8 * k, target);
        }
    }
    at
}
