//! A log in memory: what it holds, and the samples that were wanted.

use crate::error::{LogError, nearest};
use crate::roles::{Role, Serves};
use crate::topic::{LogFormat, Topic};
use crate::values::Values;
use crate::window::Window;
use crate::{crazyflie, dataflash, recorder, ulog};
use std::io::Read;

/// Which fields are kept: by topic, instance and field.
pub type Wanted<'a> = dyn Fn(&str, u32, &str) -> bool + 'a;

/// A log that has been read.
#[derive(Debug, Clone)]
pub struct Log {
    /// What kind of log it is.
    pub format: LogFormat,
    /// All topics that have samples, sorted by name and instance.
    pub topics: Vec<Topic>,
    /// Parameters and what else the log says of the aircraft, in the order of the file: name and value.
    pub parameters: Vec<(String, String)>,
    /// What was left out or assumed.
    pub notes: Vec<String>,
    /// Those topics of which fields were wanted.
    streams: Vec<Stream>,
}

/// The samples of a topic, as they were logged.
#[derive(Debug, Clone)]
pub struct Stream {
    /// Name of the topic.
    pub name: String,
    /// Which of several of that name, from 0.
    pub instance: u32,
    /// Times, strictly increasing, ns on the clock of the log.
    pub times_ns: Vec<i64>,
    /// The fields that were wanted, each with a value for every time.
    pub columns: Vec<Column>,
}

/// A field of a stream: a number for each time, NaN where there is none.
#[derive(Debug, Clone)]
pub struct Column {
    /// Name as the log has it.
    pub name: String,
    /// Unit, where it is known.
    pub unit: Option<String>,
    pub(crate) values: Values,
}

impl Column {
    /// A field with its numbers.
    pub fn new(name: &str, unit: Option<&str>, values: Vec<f64>) -> Self {
        Self { name: name.to_owned(), unit: unit.map(str::to_owned), values: Values::Double(values) }
    }

    /// The number at a time, by the place of that in [`Stream::times_ns`]; NaN beyond the last.
    pub fn value(&self, k: usize) -> f64 {
        self.values.get(k).unwrap_or(f64::NAN)
    }

    /// All numbers, in the order of the times.
    pub fn values(&self) -> impl Iterator<Item = f64> + '_ {
        self.values.iter()
    }
}

impl Log {
    /// Reads a log whose kind is seen from its first bytes; what is wanted of it is kept.
    ///
    /// A log that breaks off is read as far as it goes, with a note.
    ///
    /// # Errors
    /// [`LogError::UnknownFormat`], [`LogError::Damaged`] where the header or a definition cannot be read,
    /// [`LogError::Empty`], what the operating system refuses.
    pub fn read(source: &mut dyn Read, wanted: &Wanted<'_>) -> Result<Self, LogError> {
        let mut window = Window::new(source);
        let start = window.next(16)?;
        let log = match start {
            _ if start.starts_with(&ulog::MAGIC) => ulog::read(window, wanted)?,
            _ if start.starts_with(&dataflash::MAGIC) => dataflash::read(window, wanted)?,
            [crazyflie::MAGIC, ..] => crazyflie::read(window, wanted)?,
            _ => {
                let start = start.iter().take(8).map(|b| format!("{b:02x}")).collect::<Vec<_>>();
                return Err(LogError::UnknownFormat { start: start.join(" ") });
            }
        };
        if log.topics.is_empty() { Err(LogError::Empty) } else { Ok(log) }
    }

    /// Whether a file that begins so is a log that [`Log::read`] knows.
    pub fn is_one(start: &[u8]) -> bool {
        let binary = start.first() == Some(&crazyflie::MAGIC) && start.get(2) == Some(&0);
        start.starts_with(&ulog::MAGIC) || start.starts_with(&dataflash::MAGIC) || binary
    }

    /// Reads what a log holds, without samples.
    ///
    /// # Errors
    /// Those of [`Log::read`].
    pub fn list(source: &mut dyn Read) -> Result<Self, LogError> {
        Self::read(source, &|_, _, _| false)
    }

    /// A log from topics that are read already, such as those of a table.
    pub(crate) fn assemble(format: LogFormat, recorded: Vec<(Topic, Option<Stream>)>) -> Self {
        let (mut topics, streams): (Vec<Topic>, Vec<Option<Stream>>) = recorded.into_iter().unzip();
        topics.sort_by(|a, b| (&a.name, a.instance).cmp(&(&b.name, b.instance)));
        let streams = streams.into_iter().flatten().collect();
        Self { format, topics, parameters: Vec::new(), notes: Vec::new(), streams }
    }

    /// A log of one topic whose samples are there already, as a table's are; it is kept whole.
    ///
    /// Samples that do not come after the one before are left out, with a note.
    pub fn of_table(name: &str, times_ns: &[i64], columns: Vec<Column>) -> Self {
        recorder::of_columns(LogFormat::Table, name, times_ns, columns)
    }

    /// The topics that can serve as something, with the fields that do.
    pub fn serving(&self, role: Role) -> impl Iterator<Item = (&Topic, &Serves)> {
        self.topics.iter().flat_map(move |topic| {
            topic.serves.iter().filter(move |s| s.role == role).map(move |s| (topic, s))
        })
    }

    /// A topic by name; the instance may be left out where there is one.
    ///
    /// # Errors
    /// [`LogError::MissingTopic`] with the nearest names, [`LogError::MissingInstance`],
    /// [`LogError::ManyInstances`].
    pub fn topic(&self, name: &str, instance: Option<u32>) -> Result<&Topic, LogError> {
        let known: Vec<&Topic> = self.topics.iter().filter(|t| t.name == name).collect();
        let instances = || known.iter().map(|t| t.instance).collect();
        match (&known[..], instance) {
            ([], _) => {
                let near = nearest(name, self.topics.iter().map(|t| t.name.as_str()));
                Err(LogError::MissingTopic { name: name.to_owned(), near })
            }
            ([one], None) => Ok(one),
            (_, None) => Err(LogError::ManyInstances { topic: name.to_owned(), known: instances() }),
            (_, Some(instance)) => known.iter().find(|t| t.instance == instance).copied().ok_or_else(|| {
                LogError::MissingInstance { topic: name.to_owned(), instance, known: instances() }
            }),
        }
    }

    /// A field, which must have been wanted, with the times of its stream; the topic may be left out where one
    /// alone has such a field, the instance where the topic has one.
    ///
    /// # Errors
    /// Those of [`Log::stream`], [`LogError::MissingField`] with the nearest names,
    /// [`LogError::ManyTopics`].
    pub fn column(
        &self,
        topic: Option<&str>,
        instance: Option<u32>,
        field: &str,
    ) -> Result<(&Stream, &Column), LogError> {
        let has = |topic: &&Topic| topic.fields.iter().any(|f| f.name == field);
        let name = match topic {
            Some(name) => name,
            None => {
                let mut with: Vec<&str> = self.topics.iter().filter(has).map(|t| t.name.as_str()).collect();
                with.dedup();
                match with[..] {
                    [] => {
                        let known = self.topics.iter().flat_map(|t| t.fields.iter().map(|f| f.name.as_str()));
                        let near = nearest(field, known);
                        return Err(LogError::MissingField {
                            topic: "the log".into(),
                            name: field.into(),
                            near,
                        });
                    }
                    [one] => one,
                    _ => {
                        let known = with.iter().map(|name| (*name).to_owned()).collect();
                        return Err(LogError::ManyTopics { field: field.to_owned(), known });
                    }
                }
            }
        };
        let topic = self.topic(name, instance)?;
        if !has(&topic) {
            let near = nearest(field, topic.fields.iter().map(|f| f.name.as_str()));
            return Err(LogError::MissingField { topic: name.to_owned(), name: field.to_owned(), near });
        }
        let stream = self.stream(name, Some(topic.instance))?;
        Ok((stream, stream.column(field)?))
    }

    /// The samples of a topic of which some field was wanted; the instance may be left out where there is one.
    ///
    /// # Errors
    /// Those of [`Log::topic`]; [`LogError::MissingField`] where none of its fields was wanted or is there;
    /// [`LogError::TimeBackwards`] where more than one sample in a hundred does not come after the one before:
    /// fewer are left out, with a note.
    pub fn stream(&self, name: &str, instance: Option<u32>) -> Result<&Stream, LogError> {
        let topic = self.topic(name, instance)?;
        if topic.left_out.saturating_mul(100) > topic.samples {
            let [t_s, before_s] = topic.first_left_out_ns.unwrap_or_default().map(|t| t as f64 * 1e-9);
            let (count, samples) = (topic.left_out, topic.samples);
            return Err(LogError::TimeBackwards { topic: name.to_owned(), count, samples, t_s, before_s });
        }
        let found = self.streams.iter().find(|s| s.name == name && s.instance == topic.instance);
        found.ok_or_else(|| {
            let near = topic.fields.iter().take(3).map(|f| f.name.clone()).collect();
            LogError::MissingField { topic: name.to_owned(), name: "that was asked for".to_owned(), near }
        })
    }
}

impl Stream {
    /// A field by name.
    ///
    /// # Errors
    /// [`LogError::MissingField`] with the nearest names.
    pub fn column(&self, name: &str) -> Result<&Column, LogError> {
        self.columns.iter().find(|c| c.name == name).ok_or_else(|| LogError::MissingField {
            topic: self.name.clone(),
            name: name.to_owned(),
            near: nearest(name, self.columns.iter().map(|c| c.name.as_str())),
        })
    }
}
