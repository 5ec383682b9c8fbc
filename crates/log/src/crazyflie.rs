//! The Crazyflie's µSD card log, usdlog: a header that names events with their variables, then events with
//! their times, then a checksum.

use crate::error::LogError;
use crate::layout::{Budget, Kind, Layout, Place};
use crate::log::{Log, Wanted};
use crate::recorder::{Recorder, breaks_off};
use crate::topic::{Field, LogFormat};
use crate::window::Window;
use std::collections::HashMap;

/// First byte of the file.
pub(crate) const MAGIC: u8 = 0xbc;

/// Bytes of the checksum at the end of the file.
const CHECKSUM: usize = 4;

/// A name is at most so long: the firmware's lines are shorter.
const LONGEST_NAME: usize = 1024;

/// An event: its topic and the length of its variables.
struct Event {
    topic: usize,
    size: usize,
}

struct Reader<'a> {
    window: Window<'a>,
    checksum: crc32fast::Hasher,
    budget: Budget,
}

impl Reader<'_> {
    fn damaged(&self, detail: impl Into<String>) -> LogError {
        LogError::Damaged { offset: self.window.offset(), detail: detail.into() }
    }

    /// Goes on by bytes that were shown.
    fn consume(&mut self, count: usize) -> Result<(), LogError> {
        self.checksum.update(&self.window.next(count)?[..count]);
        self.window.consume(count);
        Ok(())
    }

    fn number(&mut self) -> Result<u16, LogError> {
        let [low, high, ..] = *self.window.next(2)? else {
            return Err(self.damaged("the header ends early"));
        };
        self.consume(2)?;
        Ok(u16::from_le_bytes([low, high]))
    }

    fn name(&mut self) -> Result<String, LogError> {
        let shown = self.window.next(LONGEST_NAME)?;
        let Some(end) = shown.iter().take(LONGEST_NAME).position(|b| *b == 0) else {
            return Err(self.damaged("a name in the header does not end"));
        };
        let name = String::from_utf8_lossy(&shown[..end]).into_owned();
        self.consume(end + 1)?;
        Ok(name)
    }

    /// The variables of an event, named as `gyro.x(f)` with a type of Python's struct module.
    fn layout(&mut self) -> Result<(Layout, usize), LogError> {
        let count = usize::from(self.number()?);
        let (mut fields, mut places, mut at) = (Vec::new(), Vec::new(), 0);
        for _ in 0..count {
            let text = self.name()?;
            let kind = text.strip_suffix(')').and_then(|t| t.rsplit_once('(')).and_then(|(name, kind)| {
                let kind = match kind {
                    "b" => Kind::I8,
                    "B" | "?" => Kind::U8,
                    "h" => Kind::I16,
                    "H" => Kind::U16,
                    "i" | "l" => Kind::I32,
                    "I" | "L" => Kind::U32,
                    "q" => Kind::I64,
                    "Q" => Kind::U64,
                    "e" => Kind::F16,
                    "f" => Kind::F32,
                    "d" => Kind::F64,
                    _ => return None,
                };
                Some((name.to_owned(), kind))
            });
            let Some((name, kind)) = kind else {
                return Err(self.damaged(format!("the variable {text:?} has no known type")));
            };
            if !self.budget.add_field(&name) {
                return Err(self.damaged("the header names more variables than any log has"));
            }
            fields.push(Field { name, unit: None });
            places.push(Place { at, kind, scale: 1.0 });
            at += kind.size();
        }
        Ok((Layout { fields: fields.into(), places: places.into() }, at))
    }
}

/// Reads a log whose first byte is [`MAGIC`].
pub(crate) fn read(window: Window<'_>, wanted: &Wanted<'_>) -> Result<Log, LogError> {
    let mut reader = Reader { window, checksum: crc32fast::Hasher::new(), budget: Budget::default() };
    reader.consume(1)?;
    let version = reader.number()?;
    let time_size = match version {
        1 => 4,
        2 => 8,
        _ => return Err(reader.damaged(format!("version {version} of the format is not known, 1 and 2 are"))),
    };
    let mut recorder = Recorder::new(LogFormat::Crazyflie, wanted);
    let mut events: HashMap<u16, Event> = HashMap::new();
    for _ in 0..reader.number()? {
        let id = reader.number()?;
        let name = reader.name()?;
        let (layout, size) = reader.layout()?;
        let Some(topic) = recorder.add(&name, 0, layout) else {
            return Err(reader.damaged(format!("two events are named {name}")));
        };
        events.insert(id, Event { topic, size });
    }
    let note = read_events(&mut reader, time_size, &events, &mut recorder)?;
    let mut log = recorder.finish();
    log.notes.extend(note);
    Ok(log)
}

/// Reads events to the end; a note where that is not the end of a whole file.
fn read_events(
    reader: &mut Reader<'_>,
    time_size: usize,
    events: &HashMap<u16, Event>,
    recorder: &mut Recorder<'_>,
) -> Result<Option<String>, LogError> {
    let head = 2 + time_size;
    let longest = head + events.values().map(|e| e.size).max().unwrap_or(0) + CHECKSUM;
    loop {
        let offset = reader.window.offset();
        let shown = reader.window.next(longest)?;
        if let Ok(expected) = <[u8; CHECKSUM]>::try_from(shown) {
            let is_whole = reader.checksum.clone().finalize() == u32::from_le_bytes(expected);
            let note =
                "the checksum at the end is not that of the file: it is damaged, or the log was not closed";
            return Ok((!is_whole).then(|| note.to_owned()));
        }
        let broken =
            |what: &str| Ok(Some(format!("the log {what} at byte {offset}; what is before is read")));
        let [low, high, rest @ ..] = shown else { return Ok(Some(breaks_off(offset))) };
        let Some(event) = events.get(&u16::from_le_bytes([*low, *high])) else {
            return broken("is damaged, no event has that number,");
        };
        let Some((time, record)) =
            rest.split_at_checked(time_size).and_then(|(time, rest)| Some((time, rest.get(..event.size)?)))
        else {
            return Ok(Some(breaks_off(offset)));
        };
        let ticks = time.iter().rev().fold(0, |ticks: u64, byte| ticks << 8 | u64::from(*byte));
        // Milliseconds in version 1, microseconds since.
        let tick_ns = if time_size == 4 { 1_000_000 } else { 1000 };
        let Some(t_ns) = i64::try_from(ticks).ok().and_then(|t| t.checked_mul(tick_ns)) else {
            return broken("is damaged, a time is beyond all clocks,");
        };
        recorder.record(event.topic, t_ns, record);
        let size = head + event.size;
        reader.consume(size)?;
    }
}
