//! ArduPilot's DataFlash log, `.bin`: records that begin with two bytes and a type, whose layouts are
//! records themselves (FMT), as are their units and multipliers (FMTU, UNIT, MULT).

mod format;

use crate::error::LogError;
use crate::layout::Kind;
use crate::log::{Log, Wanted};
use crate::recorder::{Recorder, breaks_off};
use crate::topic::LogFormat;
use crate::window::Window;
use format::Format;
use std::collections::HashMap;

/// First bytes of every record.
pub(crate) const MAGIC: [u8; 2] = [0xa3, 0x95];

/// Bytes before a record's fields: the magic ones and its type.
const HEAD: usize = 3;

/// Type and length of the record that defines records, with its head.
const FMT: (u8, usize) = (128, 89);

/// Length of a record at most, with its head: it is written in eight bits.
const LONGEST: usize = 255;

struct Reader<'a> {
    recorder: Recorder<'a>,
    formats: Vec<Option<Format>>,
    /// Topics by type and instance.
    topics: HashMap<(u8, u8), usize>,
    units: HashMap<u8, String>,
    multipliers: HashMap<u8, f64>,
    parameters: Vec<(String, String)>,
    notes: Vec<String>,
}

/// Reads a log that begins with [`MAGIC`].
pub(crate) fn read(mut window: Window<'_>, wanted: &Wanted<'_>) -> Result<Log, LogError> {
    let mut reader = Reader {
        recorder: Recorder::new(LogFormat::Dataflash, wanted),
        formats: (0..=u8::MAX).map(|_| None).collect(),
        topics: HashMap::new(),
        units: HashMap::new(),
        multipliers: HashMap::new(),
        parameters: Vec::new(),
        notes: Vec::new(),
    };
    let (mut passed, mut first_passed) = (0_u64, None);
    loop {
        let offset = window.offset();
        let shown = window.next(LONGEST)?;
        if shown.is_empty() {
            break;
        }
        let length = match shown {
            [m0, m1, kind, ..] if [*m0, *m1] == MAGIC => reader.length_of(*kind),
            _ => None,
        };
        match length.map(|length| (length, shown.get(HEAD..length))) {
            Some((length, Some(record))) => {
                reader.record(shown[HEAD - 1], record);
                window.consume(length);
            }
            // Records are at least as long as their head: what is shorter, or longer than the file, is its end.
            Some((_, None)) => {
                reader.notes.push(breaks_off(offset));
                break;
            }
            None => {
                let next = shown.iter().skip(1).position(|b| *b == MAGIC[0]).map_or(shown.len(), |k| k + 1);
                passed += next as u64;
                first_passed.get_or_insert(offset);
                window.consume(next);
            }
        }
    }
    if let Some(offset) = first_passed {
        reader
            .notes
            .push(format!("{passed} bytes that are no records are passed over, the first at byte {offset}"));
    }
    let mut log = reader.recorder.finish();
    log.parameters = reader.parameters;
    log.notes.splice(..0, reader.notes);
    Ok(log)
}

impl Reader<'_> {
    /// Length of a record of a type, with its head; `None` of one that is not defined.
    fn length_of(&self, kind: u8) -> Option<usize> {
        if kind == FMT.0 {
            return Some(FMT.1);
        }
        self.formats[usize::from(kind)].as_ref().map(|format| format.length)
    }

    /// Takes a record without its head.
    fn record(&mut self, kind: u8, record: &[u8]) {
        if kind == FMT.0 {
            self.define(record);
            return;
        }
        let Some(format) = &self.formats[usize::from(kind)] else { return };
        match format.name.as_str() {
            "UNIT" => {
                if let (Some(id), Some(label)) = (format.byte(record, "Id"), format.text(record, "Label")) {
                    self.units.insert(id, unit(&label));
                }
            }
            "MULT" => {
                if let (Some(id), Some(mult)) = (format.byte(record, "Id"), format.number(record, "Mult")) {
                    self.multipliers.insert(id, mult);
                }
            }
            "PARM" => {
                if let (Some(name), Some(value)) =
                    (format.text(record, "Name"), format.number(record, "Value"))
                {
                    self.parameters.push((name, value.to_string()));
                }
            }
            "FMTU" => {
                let ids = ["UnitIds", "MultIds"].map(|name| format.bytes(record, name).map(<[u8]>::to_vec));
                if let (Some(of), [Some(units), multipliers]) = (format.byte(record, "FmtType"), ids) {
                    self.set_units(of, &units, &multipliers.unwrap_or_default());
                }
            }
            _ => self.sample(kind, record),
        }
    }

    fn define(&mut self, record: &[u8]) {
        let Some(format) = Format::parse(record) else { return };
        match format {
            Ok((kind, format)) if kind != FMT.0 => {
                let place = &mut self.formats[usize::from(kind)];
                // A second start may define all again; what differs would be read wrongly.
                if place.as_ref().is_none_or(|before| before.definition != format.definition) {
                    *place = Some(format);
                    self.topics.retain(|(of, _), _| *of != kind);
                }
            }
            Ok(_) => {}
            Err(name) if self.notes.len() < 20 => {
                self.notes
                    .push(format!("the definition of {name:?} does not fit its length; it is left out"));
            }
            Err(_) => {}
        }
    }

    fn set_units(&mut self, kind: u8, units: &[u8], multipliers: &[u8]) {
        let Some(format) = &mut self.formats[usize::from(kind)] else { return };
        format.set_units(units, multipliers, (&self.units, &self.multipliers));
        // Samples that came before are of the first instance; their scales are those of all.
        if let Some(topic) = self.topics.get(&(kind, 0)) {
            self.recorder.rescale(*topic, &format.layout);
        }
    }

    fn sample(&mut self, kind: u8, record: &[u8]) {
        let Some(format) = &self.formats[usize::from(kind)] else { return };
        let Some(t_ns) = format.time_ns(record) else { return };
        let instance = format.instance_at.and_then(|at| record.get(at)).copied().unwrap_or(0);
        let topic = match self.topics.get(&(kind, instance)) {
            Some(topic) => *topic,
            None => {
                let Some(topic) = self.recorder.add(&format.name, u32::from(instance), format.layout.clone())
                else {
                    return;
                };
                self.topics.insert((kind, instance), topic);
                topic
            }
        };
        self.recorder.record(topic, t_ns, record);
    }
}

/// ArduPilot's labels, where other programs write the unit otherwise.
fn unit(label: &str) -> String {
    match label {
        "m/s/s" => "m/s2",
        "deglatitude" | "deglongitude" | "degheading" => "deg",
        other => other,
    }
    .to_owned()
}

/// The number of a character of a format; with what it is multiplied.
fn number_of(character: u8) -> Option<(Kind, f64)> {
    Some(match character {
        b'b' => (Kind::I8, 1.0),
        b'B' | b'M' => (Kind::U8, 1.0),
        b'h' => (Kind::I16, 1.0),
        b'H' => (Kind::U16, 1.0),
        b'i' => (Kind::I32, 1.0),
        b'I' => (Kind::U32, 1.0),
        b'q' => (Kind::I64, 1.0),
        b'Q' => (Kind::U64, 1.0),
        b'g' => (Kind::F16, 1.0),
        b'f' => (Kind::F32, 1.0),
        b'd' => (Kind::F64, 1.0),
        b'c' => (Kind::I16, 1e-2),
        b'C' => (Kind::U16, 1e-2),
        b'e' => (Kind::I32, 1e-2),
        b'E' => (Kind::U32, 1e-2),
        b'L' => (Kind::I32, 1e-7),
        _ => return None,
    })
}

/// Bytes of a text or of a list.
fn text_length(character: u8) -> Option<usize> {
    match character {
        b'n' => Some(4),
        b'N' => Some(16),
        b'Z' | b'a' => Some(64),
        _ => None,
    }
}
