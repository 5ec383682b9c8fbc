//! Columns as an Arrow IPC stream (Arrow columnar format 1.5: Schema.fbs, Message.fbs).

use super::flat::{Flat, buffer};

/// A type: its member of Arrow's union, its fields by their number, and the bytes of a value.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Type(i64, &'static [(u16, i64)], usize);

impl Type {
    pub(super) const F32: Self = Self(3, &[(0, 1)], 4);
    pub(super) const F64: Self = Self(3, &[(0, 2)], 8);
    pub(super) const BYTE: Self = Self(2, &[(0, 8), (1, 0)], 1);
    pub(super) const WORD: Self = Self(2, &[(0, 32), (1, 0)], 4);
    /// Nanoseconds of the UNIX epoch.
    pub(super) const TIMESTAMP: Self = Self(10, &[(0, 3)], 8);
    /// Nanoseconds.
    pub(super) const DURATION: Self = Self(18, &[(0, 3)], 8);
    pub(super) const ID: Self = Self(15, &[(0, 16)], 16);
    const TEXT: Self = Self(5, &[], 1);
    const LIST: Self = Self(12, &[], 4);
    /// Lists of three and of four.
    const THREE: Self = Self(16, &[(0, 3)], 0);
    const FOUR: Self = Self(16, &[(0, 4)], 0);
}

/// Values of a column, none of them missing.
pub(super) struct Array {
    of: Type,
    len: usize,
    /// The values, in little-endian bytes.
    buffers: Vec<Vec<u8>>,
    /// The items of lists.
    items: Option<Box<Array>>,
}

/// A column with what it means.
pub(super) struct Column {
    pub(super) name: String,
    pub(super) about: Vec<(&'static str, String)>,
    pub(super) array: Array,
}

const V5: i64 = 4;
/// Members of Arrow's union of messages.
const SCHEMA: i64 = 1;
const RECORD_BATCH: i64 = 3;

impl Array {
    /// Values of one width, by their bytes.
    pub(super) fn plain(of: Type, bytes: impl Iterator<Item = u8>) -> Self {
        let buffer: Vec<u8> = bytes.collect();
        Self { of, len: buffer.len() / of.2, buffers: vec![buffer], items: None }
    }

    pub(super) fn texts<'a>(texts: impl Iterator<Item = &'a str> + Clone) -> Self {
        let (ends, bytes) = (ends(texts.clone().map(str::len)), texts.flat_map(str::bytes));
        Self { of: Type::TEXT, len: ends.len() / 4 - 1, buffers: vec![ends, bytes.collect()], items: None }
    }

    /// One list for each row.
    pub(super) fn lists(rows: impl IntoIterator<Item = usize>, items: Self) -> Self {
        let ends = ends(rows.into_iter());
        Self { of: Type::LIST, len: ends.len() / 4 - 1, buffers: vec![ends], items: Some(Box::new(items)) }
    }

    pub(super) fn threes(items: Self) -> Self {
        Self { of: Type::THREE, len: items.len / 3, buffers: Vec::new(), items: Some(Box::new(items)) }
    }

    pub(super) fn fours(items: Self) -> Self {
        Self { of: Type::FOUR, len: items.len / 4, buffers: Vec::new(), items: Some(Box::new(items)) }
    }

    /// Items of a fixed number are never missing, by Rerun's types.
    fn field(&self, name: &str, nullable: bool, about: &[(&'static str, String)]) -> Flat {
        let item = |items: &Self| items.field("item", self.of == Type::LIST, &[]);
        let fields = self.of.1.iter().map(|(slot, n)| (*slot, Flat::Number(*n)));
        Flat::Table(vec![
            (0, Flat::Text(name.to_owned())),
            (1, Flat::Number(i64::from(nullable))),
            (2, Flat::Number(self.of.0)),
            (3, Flat::Table(fields.collect())),
            (5, Flat::List(self.items.as_deref().map(item).into_iter().collect())),
            (6, pairs(about)),
        ])
    }

    fn put(&self, body: &mut Body) {
        body.nodes.push([self.len as i64, 0]);
        body.push(&[]);
        self.buffers.iter().for_each(|bytes| body.push(bytes));
        self.items.iter().for_each(|items| items.put(body));
    }
}

/// Where the first list begins and where each ends.
fn ends(lengths: impl Iterator<Item = usize>) -> Vec<u8> {
    let ends = lengths.scan(0, |end, length| {
        *end += length as i32;
        Some(*end)
    });
    std::iter::once(0).chain(ends).flat_map(i32::to_le_bytes).collect()
}

fn pairs(about: &[(&'static str, String)]) -> Flat {
    let pair = |(key, value): &(&'static str, String)| {
        Flat::Table(vec![(0, Flat::Text((*key).to_owned())), (1, Flat::Text(value.clone()))])
    };
    Flat::List(about.iter().map(pair).collect())
}

#[derive(Default)]
struct Body {
    nodes: Vec<[i64; 2]>,
    buffers: Vec<[i64; 2]>,
    bytes: Vec<u8>,
}

impl Body {
    fn push(&mut self, bytes: &[u8]) {
        self.buffers.push([self.bytes.len() as i64, bytes.len() as i64]);
        self.bytes.extend(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(8), 0);
    }
}

/// The stream of one record batch.
pub(super) fn stream(columns: &[Column], about: &[(&'static str, String)]) -> Vec<u8> {
    let fields = columns.iter().map(|c| c.array.field(&c.name, c.array.of != Type::ID, &c.about));
    let schema = Flat::Table(vec![(1, Flat::List(fields.collect())), (2, pairs(about))]);
    let mut body = Body::default();
    columns.iter().for_each(|c| c.array.put(&mut body));
    let rows = columns.first().map_or(0, |c| c.array.len);
    let batch = Flat::Table(vec![
        (0, Flat::Number(rows as i64)),
        (1, Flat::Pairs(body.nodes)),
        (2, Flat::Pairs(body.buffers)),
    ]);
    let mut out = Vec::new();
    message(&mut out, SCHEMA, schema, &[]);
    message(&mut out, RECORD_BATCH, batch, &body.bytes);
    out.extend([0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0]);
    out
}

fn message(out: &mut Vec<u8>, kind: i64, header: Flat, body: &[u8]) {
    let whole =
        [(0, Flat::Number(V5)), (1, Flat::Number(kind)), (2, header), (3, Flat::Number(body.len() as i64))];
    let mut head = buffer(&Flat::Table(whole.into()));
    head.resize(head.len().next_multiple_of(8), 0);
    out.extend([0xff; 4]);
    out.extend((head.len() as i32).to_le_bytes());
    out.extend(head);
    out.extend(body);
}
