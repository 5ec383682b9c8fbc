//! Takes the records of a log as its reader finds them.

use crate::layout::{Layout, Place};
use crate::log::{Column, Log, Stream, Wanted};
use crate::roles;
use crate::statistics::Intervals;
use crate::topic::{Field, LogFormat, Topic};
use crate::values::Values;
use std::collections::HashMap;

/// The topics of a log while it is read.
pub(crate) struct Recorder<'a> {
    format: LogFormat,
    wanted: &'a Wanted<'a>,
    topics: Vec<Recorded>,
    places: HashMap<(String, u32), usize>,
}

/// A topic while it is read.
struct Recorded {
    name: String,
    instance: u32,
    layout: Layout,
    /// Which fields are kept.
    kept: Vec<usize>,
    times_ns: Vec<i64>,
    values: Vec<Values>,
    samples: u64,
    span_ns: Option<[i64; 2]>,
    intervals: Intervals,
    left_out: u64,
    first_left_out_ns: Option<[i64; 2]>,
}

impl<'a> Recorder<'a> {
    pub(crate) fn new(format: LogFormat, wanted: &'a Wanted<'a>) -> Self {
        Self { format, wanted, topics: Vec::new(), places: HashMap::new() }
    }

    /// Adds a topic; its number is for [`Recorder::record`]. One that is there already is that; `None` where
    /// it has another layout.
    pub(crate) fn add(&mut self, name: &str, instance: u32, layout: Layout) -> Option<usize> {
        if let Some(place) = self.places.get(&(name.to_owned(), instance)) {
            return Some(*place).filter(|place| self.topics[*place].layout == layout);
        }
        self.places.insert((name.to_owned(), instance), self.topics.len());
        let is_kept = |k: &usize| (self.wanted)(name, instance, &layout.fields[*k].name);
        let kept: Vec<usize> = (0..layout.fields.len()).filter(is_kept).collect();
        self.topics.push(Recorded {
            name: name.to_owned(),
            instance,
            values: kept
                .iter()
                .map(|k| Values::new(layout.places.get(*k).is_some_and(|p| p.is_single())))
                .collect(),
            kept,
            layout,
            times_ns: Vec::new(),
            samples: 0,
            span_ns: None,
            intervals: Intervals::default(),
            left_out: 0,
            first_left_out_ns: None,
        });
        Some(self.topics.len() - 1)
    }

    /// Replaces the layout of a topic by one with other units and scales, also of what has been recorded.
    pub(crate) fn rescale(&mut self, topic: usize, layout: &Layout) {
        let Some(topic) = self.topics.get_mut(topic) else { return };
        for (values, field) in topic.values.iter_mut().zip(&topic.kept) {
            if let (Some(before), Some(now)) = (topic.layout.places.get(*field), layout.places.get(*field)) {
                values.scale(now.scale / before.scale);
            }
        }
        topic.layout = layout.clone();
    }

    /// Takes a sample of a topic; one that does not come after the one before is counted and left out.
    pub(crate) fn record(&mut self, topic: usize, t_ns: i64, record: &[u8]) {
        let Some(topic) = self.topics.get_mut(topic) else { return };
        if topic.is_after(t_ns) && !topic.kept.is_empty() {
            topic.times_ns.push(t_ns);
            for (values, field) in topic.values.iter_mut().zip(&topic.kept) {
                let place = topic.layout.places.get(*field);
                values.push(place.map_or(f64::NAN, |place: &Place| place.number(record)));
            }
        }
    }

    /// The log, with a note of what was left out; topics without a sample are not in it.
    pub(crate) fn finish(self) -> Log {
        let mut notes = Vec::new();
        let format = self.format;
        let recorded = self.topics.into_iter().filter_map(|topic| topic.finish(format, &mut notes)).collect();
        let mut log = Log::assemble(format, recorded);
        log.notes = notes;
        log
    }
}

/// What is said of a log that ends within a record.
pub(crate) fn breaks_off(offset: u64) -> String {
    format!("the log breaks off at byte {offset}; what is before is read: copy it again if the card has more")
}

/// A log of one topic whose samples are there already.
pub(crate) fn of_columns(format: LogFormat, name: &str, times_ns: &[i64], columns: Vec<Column>) -> Log {
    let mut recorder = Recorder::new(format, &|_, _, _| true);
    let field = |column: &Column| Field { name: column.name.clone(), unit: column.unit.clone() };
    let fields = columns.iter().map(field).collect();
    recorder.add(name, 0, Layout { fields, ..Layout::default() });
    let topic = &mut recorder.topics[0];
    let taken: Vec<bool> = times_ns.iter().map(|t_ns| topic.is_after(*t_ns)).collect();
    let rows = || (0..times_ns.len()).filter(|k| taken[*k]);
    topic.times_ns = rows().map(|k| times_ns[k]).collect();
    let kept = |column: &Column| Values::Double(rows().map(|k| column.value(k)).collect());
    topic.values = columns.iter().map(kept).collect();
    recorder.finish()
}

impl Recorded {
    /// Counts a sample; whether it comes after the one before.
    fn is_after(&mut self, t_ns: i64) -> bool {
        self.samples += 1;
        let Some([_, last_ns]) = &mut self.span_ns else {
            self.span_ns = Some([t_ns, t_ns]);
            return true;
        };
        let length_ns = t_ns.saturating_sub(*last_ns);
        if length_ns <= 0 {
            self.left_out += 1;
            self.first_left_out_ns.get_or_insert([t_ns, *last_ns]);
            return false;
        }
        self.intervals.add(*last_ns, length_ns);
        *last_ns = t_ns;
        true
    }

    fn finish(mut self, format: LogFormat, notes: &mut Vec<String>) -> Option<(Topic, Option<Stream>)> {
        let [first_ns, last_ns] = self.span_ns?;
        if let Some([t_ns, before_ns]) = self.first_left_out_ns {
            let [t_s, before_s] = [t_ns, before_ns].map(|t| t as f64 * 1e-9);
            notes.push(format!(
                "{} {}: {} of {} samples do not come after the one before and are left out, the first at {t_s:.6} s \
                 after {before_s:.6} s",
                self.name, self.instance, self.left_out, self.samples
            ));
        }
        let found = self.intervals.regularity();
        self.times_ns.shrink_to_fit();
        let fields = roles::with_units(format, &self.name, &self.layout.fields);
        let columns = self.kept.iter().zip(self.values).map(|(k, mut values)| {
            let Field { name, unit } = fields[*k].clone();
            values.shrink();
            Column { name, unit, values }
        });
        let columns: Vec<Column> = columns.collect();
        let stream = (!columns.is_empty()).then(|| Stream {
            name: self.name.clone(),
            instance: self.instance,
            times_ns: self.times_ns,
            columns,
        });
        let topic = Topic {
            serves: roles::serves(format, &self.name, &fields),
            name: self.name,
            instance: self.instance,
            fields,
            samples: self.samples,
            first_ns,
            last_ns,
            rate_hz: found.rate_hz,
            gaps: found.gaps,
            longest_gap: found.longest_gap,
            left_out: self.left_out,
            first_left_out_ns: self.first_left_out_ns,
        };
        Some((topic, stream))
    }
}
