//! Columns as an Arrow IPC stream (Arrow columnar format 1.5: Schema.fbs, Message.fbs).

use super::flat::{Flat, buffer};

/// Values of a column, none of them missing.
pub(super) struct Array {
    /// Member of Arrow's union of types.
    kind: i64,
    /// Fields of that type by their number.
    fields: Vec<(u16, i64)>,
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
/// Members of its union of types that are treated in a way of their own.
const BINARY: i64 = 15;
const FIXED_LIST: i64 = 16;

impl Array {
    fn plain<T: Copy, const N: usize>(
        kind: i64,
        fields: &[(u16, i64)],
        values: &[T],
        bytes: fn(T) -> [u8; N],
    ) -> Self {
        let buffer = values.iter().flat_map(|v| bytes(*v)).collect();
        Self { kind, fields: fields.into(), len: values.len(), buffers: vec![buffer], items: None }
    }

    pub(super) fn f32(values: &[f32]) -> Self {
        Self::plain(3, &[(0, 1)], values, f32::to_le_bytes)
    }

    pub(super) fn f64(values: &[f64]) -> Self {
        Self::plain(3, &[(0, 2)], values, f64::to_le_bytes)
    }

    pub(super) fn bytes(values: &[u8]) -> Self {
        Self::plain(2, &[(0, 8), (1, 0)], values, u8::to_le_bytes)
    }

    pub(super) fn words(values: &[u32]) -> Self {
        Self::plain(2, &[(0, 32), (1, 0)], values, u32::to_le_bytes)
    }

    /// Nanoseconds of the UNIX epoch.
    pub(super) fn timestamps(ns: &[i64]) -> Self {
        Self::plain(10, &[(0, 3)], ns, i64::to_le_bytes)
    }

    /// Nanoseconds.
    pub(super) fn durations(ns: &[i64]) -> Self {
        Self::plain(18, &[(0, 3)], ns, i64::to_le_bytes)
    }

    pub(super) fn ids(ids: &[u128]) -> Self {
        Self::plain(BINARY, &[(0, 16)], ids, u128::to_be_bytes)
    }

    pub(super) fn texts(texts: &[String]) -> Self {
        let buffers = vec![ends(texts.iter().map(String::len)), texts.concat().into_bytes()];
        Self { kind: 5, fields: Vec::new(), len: texts.len(), buffers, items: None }
    }

    /// One list for each row.
    pub(super) fn lists(rows: &[usize], items: Self) -> Self {
        let buffers = vec![ends(rows.iter().copied())];
        Self { kind: 12, fields: Vec::new(), len: rows.len(), buffers, items: Some(Box::new(items)) }
    }

    /// Lists of so many items each.
    pub(super) fn fixed(count: usize, items: Self) -> Self {
        let (fields, len) = (vec![(0, count as i64)], items.len / count.max(1));
        Self { kind: FIXED_LIST, fields, len, buffers: Vec::new(), items: Some(Box::new(items)) }
    }

    /// Items of a fixed number are never missing, by Rerun's types.
    fn field(&self, name: &str, nullable: bool, about: &[(&'static str, String)]) -> Flat {
        let item = |items: &Box<Self>| items.field("item", self.kind != FIXED_LIST, &[]);
        let fields = self.fields.iter().map(|(slot, n)| (*slot, Flat::Number(*n)));
        Flat::Table(vec![
            (0, Flat::Text(name.to_owned())),
            (1, Flat::Number(i64::from(nullable))),
            (2, Flat::Number(self.kind)),
            (3, Flat::Table(fields.collect())),
            (5, Flat::List(self.items.iter().map(item).collect())),
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
    let fields = columns.iter().map(|c| c.array.field(&c.name, c.array.kind != BINARY, &c.about));
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
