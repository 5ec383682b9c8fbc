//! Rerun's file: a header, then messages of `rerun.log_msg.v1alpha1` (Protocol Buffers), each with its kind
//! and length before it.

use super::arrow::{Array, Column, stream};
use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

/// Version of Rerun whose layout this is: 0.41.0. Later ones read it.
const VERSION: [u8; 4] = [0, 41, 0, 0];
/// Not compressed; Protocol Buffers.
const OPTIONS: [u8; 4] = [0, 2, 0, 0];
const SET_STORE_INFO: u64 = 1;
const ARROW_MESSAGE: u64 = 2;

/// A file that grows by chunks. Each is handed to the system as a whole.
pub(super) struct RrdFile {
    file: File,
    store: Vec<u8>,
    begun_ns: u64,
    ids: u64,
}

fn varint(out: &mut Vec<u8>, mut n: u64) {
    while n >= 0x80 {
        out.push(n as u8 | 0x80);
        n >>= 7;
    }
    out.push(n as u8);
}

fn number(out: &mut Vec<u8>, field: u64, n: u64) {
    varint(out, field << 3);
    varint(out, n);
}

fn bytes(out: &mut Vec<u8>, field: u64, of: &[u8]) {
    varint(out, field << 3 | 2);
    varint(out, of.len() as u64);
    out.extend(of);
}

fn id_message(id: [u64; 2]) -> Vec<u8> {
    let field = |(field, n): (u8, u64)| [vec![field << 3 | 1], n.to_le_bytes().into()].concat();
    [1, 2].into_iter().zip(id).flat_map(field).collect()
}

impl RrdFile {
    /// Begins a recording of that application.
    pub(super) fn create(path: &Path, application: &str, begun_ns: i64) -> io::Result<Self> {
        let mut file = File::create(path)?;
        let (mut name, mut store) = (Vec::new(), Vec::new());
        bytes(&mut name, 1, application.as_bytes());
        // A recording, no blueprint.
        number(&mut store, 1, 1);
        bytes(&mut store, 2, format!("{application}-{begun_ns}").as_bytes());
        bytes(&mut store, 3, &name);
        file.write_all(&[b"RRF2".as_slice(), &VERSION, &OPTIONS].concat())?;
        let begun_ns = u64::try_from(begun_ns).unwrap_or(0);
        let mut own = Self { file, store, begun_ns, ids: 0 };
        let (mut info, mut message, mut source) = (Vec::new(), Vec::new(), Vec::new());
        // Written by none of Rerun's own programs.
        number(&mut source, 1, 6);
        bytes(&mut source, 2, &name);
        bytes(&mut info, 2, &own.store);
        bytes(&mut info, 5, &source);
        bytes(&mut message, 1, &id_message(own.id()));
        bytes(&mut message, 2, &info);
        own.put(SET_STORE_INFO, &message)?;
        Ok(own)
    }

    /// Rising numbers, of which no two are the same.
    fn id(&mut self) -> [u64; 2] {
        self.ids += 1;
        [self.begun_ns, self.ids]
    }

    fn put(&mut self, kind: u64, message: &[u8]) -> io::Result<()> {
        let head = [kind.to_le_bytes(), (message.len() as u64).to_le_bytes()].concat();
        self.file.write_all(&[head.as_slice(), message].concat())
    }

    /// Writes rows of one entity; without an index they hold for all times.
    pub(super) fn chunk(&mut self, entity: &str, rows: usize, columns: Vec<Column>) -> io::Result<()> {
        let is_static = !columns.iter().any(|c| matches!(c.array, Array::Timestamp(_) | Array::Duration(_)));
        let row_ids = (0..rows).map(|_| {
            let [time, count] = self.id();
            (u128::from(time) << 64 | u128::from(count)).to_be_bytes()
        });
        let rows = Column {
            name: "rerun.controls.RowId".into(),
            about: vec![
                ("ARROW:extension:metadata", r#"{"namespace":"row"}"#.into()),
                ("ARROW:extension:name", "rerun.datatypes.TUID".into()),
                ("rerun:is_sorted", "true".into()),
                ("rerun:kind", "control".into()),
            ],
            array: Array::Id(row_ids.collect()),
        };
        let [time, count] = self.id();
        let about = [
            ("rerun:entity_path", entity.to_owned()),
            ("rerun:id", format!("chunk_{time:016X}{count:016x}")),
            ("sorbet:version", "0.1.4".to_owned()),
        ];
        let all: Vec<Column> = std::iter::once(rows).chain(columns).collect();
        let payload = stream(&all, &about);
        let mut message = Vec::new();
        bytes(&mut message, 1, &self.store);
        // Not compressed; Arrow IPC.
        number(&mut message, 2, 1);
        number(&mut message, 3, payload.len() as u64);
        number(&mut message, 4, 1);
        bytes(&mut message, 5, &payload);
        bytes(&mut message, 6, &id_message([time, count]));
        number(&mut message, 7, u64::from(is_static));
        self.put(ARROW_MESSAGE, &message)
    }
}
