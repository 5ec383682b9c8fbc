//! Columns as an Arrow IPC stream (Arrow columnar format 1.5: Schema.fbs, Message.fbs).

use super::flat::{Flat, buffer};

/// Values of a column, none of them missing.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Array {
    F32(Vec<f32>),
    F64(Vec<f64>),
    Bytes(Vec<u8>),
    Words(Vec<u32>),
    /// Nanoseconds of the UNIX epoch.
    Timestamp(Vec<i64>),
    /// Nanoseconds.
    Duration(Vec<i64>),
    /// Sixteen bytes each.
    Id(Vec<[u8; 16]>),
    Text(Vec<String>),
    /// Where each row's items begin, and where the last one's end.
    List(Vec<i32>, Box<Array>),
    /// So many items in each.
    Fixed(i32, Box<Array>),
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
    /// One list for each row.
    pub(super) fn lists(rows: impl IntoIterator<Item = usize>, items: Self) -> Self {
        let mut ends = vec![0];
        ends.extend(rows.into_iter().scan(0, |end, n| {
            *end += n as i32;
            Some(*end)
        }));
        Self::List(ends, Box::new(items))
    }

    fn len(&self) -> usize {
        match self {
            Self::F32(v) => v.len(),
            Self::F64(v) => v.len(),
            Self::Bytes(v) => v.len(),
            Self::Words(v) => v.len(),
            Self::Timestamp(v) | Self::Duration(v) => v.len(),
            Self::Id(v) => v.len(),
            Self::Text(v) => v.len(),
            Self::List(ends, _) => ends.len() - 1,
            Self::Fixed(n, items) => items.len() / (*n).max(1) as usize,
        }
    }

    /// Member of Arrow's union of types, and that type.
    fn kind(&self) -> (i64, Vec<(u16, Flat)>) {
        let int = |bits: i64| (2, vec![(0, Flat::Number(bits)), (1, Flat::Number(0))]);
        match self {
            Self::F32(_) => (3, vec![(0, Flat::Number(1))]),
            Self::F64(_) => (3, vec![(0, Flat::Number(2))]),
            Self::Bytes(_) => int(8),
            Self::Words(_) => int(32),
            Self::Timestamp(_) => (10, vec![(0, Flat::Number(3))]),
            Self::Duration(_) => (18, vec![(0, Flat::Number(3))]),
            Self::Id(_) => (15, vec![(0, Flat::Number(16))]),
            Self::Text(_) => (5, Vec::new()),
            Self::List(..) => (12, Vec::new()),
            Self::Fixed(n, _) => (16, vec![(0, Flat::Number(i64::from(*n)))]),
        }
    }

    /// Items of a fixed number are never missing, by Rerun's types.
    fn field(&self, name: &str, nullable: bool, about: &[(&'static str, String)]) -> Flat {
        let (kind, of) = self.kind();
        let children = match self {
            Self::List(_, items) => vec![items.field("item", true, &[])],
            Self::Fixed(_, items) => vec![items.field("item", false, &[])],
            _ => Vec::new(),
        };
        Flat::Table(vec![
            (0, Flat::Text(name.to_owned())),
            (1, Flat::Number(i64::from(nullable))),
            (2, Flat::Number(kind)),
            (3, Flat::Table(of)),
            (5, Flat::List(children)),
            (6, pairs(about)),
        ])
    }

    fn put(&self, body: &mut Body) {
        body.nodes.push([self.len() as i64, 0]);
        body.push(&[]);
        match self {
            Self::F32(v) => body.push(&le(v, |n| n.to_le_bytes())),
            Self::F64(v) => body.push(&le(v, |n| n.to_le_bytes())),
            Self::Bytes(v) => body.push(v),
            Self::Words(v) => body.push(&le(v, |n| n.to_le_bytes())),
            Self::Timestamp(v) | Self::Duration(v) => body.push(&le(v, |n| n.to_le_bytes())),
            Self::Id(v) => body.push(v.as_flattened()),
            Self::Text(v) => {
                let ends = v.iter().scan(0, |end, text| {
                    *end += text.len() as i32;
                    Some(*end)
                });
                let ends: Vec<u8> = std::iter::once(0).chain(ends).flat_map(i32::to_le_bytes).collect();
                body.push(&ends);
                body.push(v.concat().as_bytes());
            }
            Self::List(ends, items) => {
                body.push(&le(ends, |n| n.to_le_bytes()));
                items.put(body);
            }
            Self::Fixed(_, items) => items.put(body),
        }
    }
}

fn le<T, const N: usize>(values: &[T], bytes: impl Fn(&T) -> [u8; N]) -> Vec<u8> {
    values.iter().flat_map(bytes).collect()
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
    let fields = columns.iter().map(|c| {
        let is_id = matches!(c.array, Array::Id(_));
        c.array.field(&c.name, !is_id, &c.about)
    });
    let schema = Flat::Table(vec![(1, Flat::List(fields.collect())), (2, pairs(about))]);
    let mut body = Body::default();
    columns.iter().for_each(|c| c.array.put(&mut body));
    let rows = columns.first().map_or(0, |c| c.array.len());
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
