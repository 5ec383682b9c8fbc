//! Rerun's file: a header, then messages of `rerun.log_msg.v1alpha1` (Protocol Buffers), each with its kind
//! and length before it.

use super::columns::{Column, INDEX, row_ids, stream};
use std::collections::HashMap;
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

#[derive(Default)]
struct Message(Vec<u8>);

impl Message {
    fn varint(&mut self, mut n: u64) {
        while n >= 0x80 {
            self.0.push(n as u8 | 0x80);
            n >>= 7;
        }
        self.0.push(n as u8);
    }

    fn number(mut self, field: u64, n: u64) -> Self {
        self.varint(field << 3);
        self.varint(n);
        self
    }

    fn bytes(mut self, field: u64, of: &[u8]) -> Self {
        self.varint(field << 3 | 2);
        self.varint(of.len() as u64);
        self.0.extend(of);
        self
    }

    fn fixed(mut self, field: u64, n: u64) -> Self {
        self.varint(field << 3 | 1);
        self.0.extend(n.to_le_bytes());
        self
    }

    fn id(self, field: u64, [time, count]: [u64; 2]) -> Self {
        self.bytes(field, &Self::default().fixed(1, time).fixed(2, count).0)
    }
}

impl RrdFile {
    pub(super) fn create(path: &Path, application: &str, begun_ns: i64) -> io::Result<Self> {
        let mut file = File::create(path)?;
        file.write_all(&[b"RRF2".as_slice(), &VERSION, &OPTIONS].concat())?;
        let name = Message::default().bytes(1, application.as_bytes());
        // A recording, no blueprint.
        let recording = format!("{application}-{begun_ns}");
        let store = Message::default().number(1, 1).bytes(2, recording.as_bytes()).bytes(3, &name.0).0;
        // Written by none of Rerun's own programs.
        let source = Message::default().number(1, 6).bytes(2, &name.0);
        let info = Message::default().bytes(2, &store).bytes(5, &source.0);
        let mut own = Self { file, store, begun_ns: u64::try_from(begun_ns).unwrap_or(0), ids: 0 };
        let message = Message::default().id(1, own.id()).bytes(2, &info.0);
        own.put(SET_STORE_INFO, &message.0)?;
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
        let is_static = !columns.iter().any(|(field, _)| field.metadata().contains_key(INDEX));
        let ids = (0..rows).flat_map(|_| self.id().map(u64::to_be_bytes).concat()).collect();
        let id = self.id();
        let about = HashMap::from([
            ("rerun:entity_path".to_owned(), entity.to_owned()),
            ("rerun:id".to_owned(), format!("chunk_{:016X}{:016x}", id[0], id[1])),
            ("sorbet:version".to_owned(), "0.1.4".to_owned()),
        ]);
        let all = std::iter::once(row_ids(ids)).chain(columns).collect();
        let payload = stream(all, about).map_err(io::Error::other)?;
        // Not compressed; Arrow IPC.
        let message = Message::default()
            .bytes(1, &self.store)
            .number(2, 1)
            .number(3, payload.len() as u64)
            .number(4, 1)
            .bytes(5, &payload)
            .id(6, id)
            .number(7, u64::from(is_static));
        self.put(ARROW_MESSAGE, &message.0)
    }
}
