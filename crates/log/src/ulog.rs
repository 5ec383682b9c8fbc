//! PX4's ULog: definitions as text, then messages with a length, a type and a payload.

mod format;

use crate::error::LogError;
use crate::layout::{Kind, Layout};
use crate::log::{Log, Wanted};
use crate::recorder::{Recorder, breaks_off};
use crate::topic::LogFormat;
use crate::window::Window;
use format::{Definitions, Shape};

/// First bytes of the file.
pub(crate) const MAGIC: [u8; 7] = *b"ULog\x01\x12\x35";

/// Bytes before the first message: the magic ones, the version, and the time of the start.
const HEADER: usize = 16;

/// Bytes before a message's payload: its length and its type.
const HEAD: usize = 3;

/// What a message of synchronisation holds, behind its head.
const SYNC: [u8; 11] = [8, 0, b'S', 0x2f, 0x73, 0x13, 0x20, 0x25, 0x0c, 0xbb, 0x12];

/// The flag of data that a later start has appended; any other changes the meaning of the log.
const APPENDED: u8 = 1;

/// A subscription: its topic, and where its time is.
#[derive(Clone, Copy)]
struct Subscription {
    topic: usize,
    time_at: usize,
}

struct Reader<'a, 'b> {
    window: Window<'a>,
    recorder: Recorder<'b>,
    definitions: Definitions,
    subscriptions: Vec<Option<Subscription>>,
    /// Where appended sections begin, in the order of the file.
    appended: Vec<u64>,
    parameters: Vec<(String, String)>,
    notes: Vec<String>,
    dropouts: u64,
    dropped_ms: u64,
}

/// Reads a log that begins with [`MAGIC`].
pub(crate) fn read(mut window: Window<'_>, wanted: &Wanted<'_>) -> Result<Log, LogError> {
    window.next(HEADER)?;
    window.consume(HEADER);
    let mut reader = Reader {
        window,
        recorder: Recorder::new(LogFormat::Ulog, wanted),
        definitions: Definitions::default(),
        subscriptions: Vec::new(),
        appended: Vec::new(),
        parameters: Vec::new(),
        notes: Vec::new(),
        dropouts: 0,
        dropped_ms: 0,
    };
    while reader.message()? {}
    if reader.dropouts > 0 {
        reader.notes.push(format!(
            "the logger lost data {} times, {:.3} s in all, where its card was slow",
            reader.dropouts,
            reader.dropped_ms as f64 * 1e-3
        ));
    }
    let mut log = reader.recorder.finish();
    log.parameters = reader.parameters;
    log.notes.splice(..0, reader.notes);
    Ok(log)
}

impl Reader<'_, '_> {
    /// Reads a message; false at the end.
    fn message(&mut self) -> Result<bool, LogError> {
        let offset = self.window.offset();
        // What was being written when the section ended is cut off there.
        let room = self.appended.first().map_or(u64::MAX, |at| at.saturating_sub(offset));
        let shown = self.window.next(HEAD)?;
        if shown.is_empty() {
            return Ok(false);
        }
        let head = <[u8; HEAD]>::try_from(shown.get(..HEAD).unwrap_or_default()).ok();
        let size = head.map_or(0, |[low, high, _]| usize::from(u16::from_le_bytes([low, high])));
        if room < (HEAD + size) as u64 || room == 0 {
            self.appended.remove(0);
            self.window.next(room as usize)?;
            self.window.consume(room as usize);
            return Ok(true);
        }
        let Some([_, _, kind]) = head else { return Ok(self.breaks_off(offset)) };
        if size == 0 || !b"BFIMPQARDLCSO".contains(&kind) {
            return self.resynchronise(offset);
        }
        let shown = self.window.next(HEAD + size)?;
        let Some(payload) = shown.get(HEAD..HEAD + size) else { return Ok(self.breaks_off(offset)) };
        if let (b'D', [low, high, record @ ..]) = (kind, payload) {
            let subscription = self.subscriptions.get(usize::from(u16::from_le_bytes([*low, *high])));
            if let Some(Some(Subscription { topic, time_at })) = subscription
                && let Some(t_ns) = time_ns(record, *time_at)
            {
                self.recorder.record(*topic, t_ns, record);
            }
        } else {
            let payload = payload.to_vec();
            self.rare(kind, &payload, offset)?;
        }
        self.window.consume(HEAD + size);
        Ok(true)
    }

    fn breaks_off(&mut self, offset: u64) -> bool {
        self.notes.push(breaks_off(offset));
        false
    }

    /// Passes over what is no message to the next message of synchronisation.
    fn resynchronise(&mut self, offset: u64) -> Result<bool, LogError> {
        self.window.consume(1);
        loop {
            let shown = self.window.next(SYNC.len())?;
            if shown.len() < SYNC.len() {
                self.notes.push(format!(
                    "the log is damaged at byte {offset}, and no mark follows from which to go on; what is before is read"
                ));
                return Ok(false);
            }
            if let Some(found) = shown.windows(SYNC.len()).position(|bytes| bytes == SYNC) {
                self.window.consume(found);
                let skipped = self.window.offset() - offset;
                if self.notes.len() < 20 {
                    self.notes.push(format!(
                        "the log is damaged at byte {offset}: {skipped} bytes are passed over"
                    ));
                }
                return Ok(true);
            }
            let passed = shown.len() + 1 - SYNC.len();
            self.window.consume(passed);
        }
    }

    /// A message other than a sample.
    fn rare(&mut self, kind: u8, payload: &[u8], offset: u64) -> Result<(), LogError> {
        let damaged = |detail: String| LogError::Damaged { offset, detail };
        match kind {
            b'B' => {
                let incompatible = payload.get(8..16).unwrap_or_default();
                if incompatible
                    .iter()
                    .enumerate()
                    .any(|(k, flags)| flags & !(if k == 0 { APPENDED } else { 0 }) != 0)
                {
                    return Err(damaged("the log has features that this program does not know".to_owned()));
                }
                let offsets = payload.get(16..40).unwrap_or_default().chunks_exact(8);
                let offsets = offsets.filter_map(|b| b.try_into().ok()).map(u64::from_le_bytes);
                self.appended = offsets.filter(|at| *at > offset).collect();
                self.appended.sort_unstable();
            }
            b'F' => {
                let text = String::from_utf8_lossy(payload);
                let known =
                    text.split_once(':').is_some_and(|(name, fields)| self.definitions.define(name, fields));
                if !known {
                    return Err(damaged(
                        "a definition has no name, or there are more than any log has".to_owned(),
                    ));
                }
            }
            b'A' => self.subscribe(payload, offset)?,
            b'P' | b'I' => {
                if let Some((name, value)) = parameter(payload) {
                    self.parameters.push((name, value));
                }
            }
            b'O' => {
                self.dropouts += 1;
                self.dropped_ms += Kind::U16.number(payload, 0) as u64;
            }
            _ => {}
        }
        Ok(())
    }

    fn subscribe(&mut self, payload: &[u8], offset: u64) -> Result<(), LogError> {
        let [instance, low, high, name @ ..] = payload else {
            self.notes.push(format!("a subscription at byte {offset} is cut short and left out"));
            return Ok(());
        };
        let (number, name) = (usize::from(u16::from_le_bytes([*low, *high])), String::from_utf8_lossy(name));
        let detail = match self.definitions.shape(&name) {
            Shape::Fields { layout, time_at: Some(time_at) } => {
                self.add(number, u32::from(*instance), &name, layout, time_at)
            }
            Shape::Fields { time_at: None, .. } => Err("has no timestamp of microseconds as uint64_t"),
            Shape::Unknown => Err("has no definition"),
            Shape::TooLarge => Err("is defined larger than a message can be"),
            Shape::OverBudget => {
                let detail = "the definitions of the log need more memory than those of any log".to_owned();
                return Err(LogError::Damaged { offset, detail });
            }
        };
        if let Err(detail) = detail
            && self.notes.len() < 20
        {
            self.notes.push(format!("{name} {instance} {detail}, and is left out"));
        }
        Ok(())
    }

    fn add(
        &mut self,
        number: usize,
        instance: u32,
        name: &str,
        layout: Layout,
        time_at: usize,
    ) -> Result<(), &'static str> {
        let topic = self.recorder.add(name, instance, layout).ok_or("is defined twice, in two ways")?;
        if self.subscriptions.len() <= number {
            self.subscriptions.resize(number + 1, None);
        }
        self.subscriptions[number] = Some(Subscription { topic, time_at });
        Ok(())
    }
}

/// Microseconds as nanoseconds; `None` beyond all clocks.
fn time_ns(record: &[u8], at: usize) -> Option<i64> {
    let bytes = record.get(at..at + 8)?.try_into().ok()?;
    i64::try_from(u64::from_le_bytes(bytes)).ok()?.checked_mul(1000)
}

/// Name and value of a parameter or a piece of information: the length of the key, the key with its type, the
/// value.
fn parameter(payload: &[u8]) -> Option<(String, String)> {
    let (length, rest) = payload.split_first()?;
    let (key, value) = rest.split_at_checked(usize::from(*length))?;
    let key = String::from_utf8_lossy(key);
    let (kind, name) = key.split_once(' ')?;
    let text = match kind {
        "float" => f32::from_le_bytes(value.try_into().ok()?).to_string(),
        _ if kind.starts_with("char[") => String::from_utf8_lossy(value).trim_end_matches('\0').to_owned(),
        _ => {
            let kind = format::kind(kind).filter(|kind| kind.size() == value.len())?;
            kind.number(value, 0).to_string()
        }
    };
    Some((name.to_owned(), text))
}
