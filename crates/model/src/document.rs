//! A TOML document by sections that know where everything is.

use crate::fault::{Fault, ModelError, near};
use crate::unit::Unit;
use std::cell::RefCell;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// The text of a file and its name.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Source<'a> {
    pub(crate) file: &'a str,
    pub(crate) text: &'a str,
}

impl Source<'_> {
    pub(crate) fn fault<T>(&self, at: usize, fault: Fault) -> Result<T, ModelError> {
        Err(ModelError::at(self.file, self.text, at, fault))
    }
}

/// The text of an expression and where it is in the file, in bytes.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Text {
    pub(crate) text: String,
    /// Where its value begins.
    pub(crate) at: usize,
    /// Where its first character is; none where the file writes it otherwise, as with escapes.
    first: Option<usize>,
}

impl Text {
    /// Where a part of the text is in the file.
    pub(crate) fn place(&self, part: usize) -> usize {
        self.first.map_or(self.at, |first| first + part)
    }
}

/// The longest piece of a file that a message repeats, in characters.
const LONGEST_SHOWN: usize = 60;

/// A piece of the file as a message repeats it.
pub(crate) fn shown(piece: &str) -> String {
    let mut out: String = piece.chars().take(LONGEST_SHOWN).collect();
    if out.len() < piece.len() {
        out.push_str("...");
    }
    out
}

/// A value and its key.
#[derive(Debug, Clone)]
pub(crate) struct Entry<'a> {
    pub(crate) key: String,
    pub(crate) key_at: usize,
    pub(crate) at: usize,
    pub(crate) value: &'a DeValue<'a>,
    source: Source<'a>,
}

/// A table of the document that notes which keys were asked for.
#[derive(Debug)]
pub(crate) struct Section<'a> {
    /// As errors name it.
    pub(crate) name: String,
    pub(crate) at: usize,
    entries: Vec<Entry<'a>>,
    asked: RefCell<Vec<&'static str>>,
    source: Source<'a>,
}

impl<'a> Section<'a> {
    pub(crate) fn new(name: String, at: usize, table: &'a DeTable<'a>, source: Source<'a>) -> Self {
        let entry =
            |(key, value): (&'a Spanned<std::borrow::Cow<'a, str>>, &'a Spanned<DeValue<'a>>)| Entry {
                key: key.get_ref().as_ref().to_owned(),
                key_at: key.span().start,
                at: value.span().start,
                value: value.get_ref(),
                source,
            };
        let mut entries: Vec<Entry<'a>> = table.iter().map(entry).collect();
        entries.sort_by_key(|e| e.key_at);
        Self { name, at, entries, asked: RefCell::default(), source }
    }

    /// All entries, in the order of the file.
    pub(crate) fn entries(&self) -> &[Entry<'a>] {
        &self.entries
    }

    pub(crate) fn get(&self, key: &'static str) -> Option<&Entry<'a>> {
        self.asked.borrow_mut().push(key);
        self.entries.iter().find(|e| e.key == key)
    }

    pub(crate) fn require(&self, key: &'static str) -> Result<&Entry<'a>, ModelError> {
        self.get(key).map_or_else(
            || self.source.fault(self.at, Fault::Missing { section: self.name.clone(), key }),
            Ok,
        )
    }

    pub(crate) fn string(&self, key: &'static str) -> Result<Option<String>, ModelError> {
        self.get(key).map(Entry::string).transpose()
    }

    pub(crate) fn number(&self, key: &'static str) -> Result<Option<f64>, ModelError> {
        self.get(key).map(Entry::number).transpose()
    }

    pub(crate) fn expression(&self, key: &'static str) -> Result<Option<Text>, ModelError> {
        self.get(key).map(Entry::expression).transpose()
    }

    pub(crate) fn unit(&self) -> Result<Option<Unit>, ModelError> {
        let Some(entry) = self.get("unit") else { return Ok(None) };
        let text = entry.string()?;
        Unit::parse(&text)
            .map(Some)
            .or_else(|part| self.source.fault(entry.at, Fault::UnknownUnit(shown(&part))))
    }

    /// Refuses keys other than these.
    pub(crate) fn only(&self, keys: &[&'static str]) -> Result<(), ModelError> {
        self.asked.borrow_mut().extend(keys);
        self.finish()
    }

    /// Refuses keys that nobody asked for.
    pub(crate) fn finish(&self) -> Result<(), ModelError> {
        let asked = self.asked.borrow();
        let Some(unknown) = self.entries.iter().find(|e| !asked.contains(&e.key.as_str())) else {
            return Ok(());
        };
        let mut near = near(&unknown.key, asked.iter().copied());
        if near.is_empty() {
            let first = |(k, key): &(usize, &&str)| !asked[..*k].contains(*key);
            near = asked.iter().enumerate().filter(first).map(|(_, key)| (*key).to_owned()).collect();
        }
        let (name, section) = (shown(&unknown.key), self.name.clone());
        self.source.fault(unknown.key_at, Fault::UnknownKey { name, section, near })
    }
}

impl<'a> Entry<'a> {
    fn kind<T>(&self, wanted: &'static str) -> Result<T, ModelError> {
        let (key, found) = (shown(&self.key), self.kind_in_words().to_owned());
        self.source.fault(self.at, Fault::Kind { key, wanted, found })
    }

    /// What kind of value it is.
    pub(crate) fn kind_in_words(&self) -> &'static str {
        match self.value {
            DeValue::String(_) => "text",
            DeValue::Integer(_) | DeValue::Float(_) => "a number",
            DeValue::Boolean(_) => "true or false",
            DeValue::Datetime(_) => "a date",
            DeValue::Array(_) => "a list",
            DeValue::Table(_) => "a table",
        }
    }

    pub(crate) fn string(&self) -> Result<String, ModelError> {
        self.value.as_str().map_or_else(|| self.kind("text"), |s| Ok(s.to_owned()))
    }

    pub(crate) fn bool(&self) -> Option<bool> {
        self.value.as_bool()
    }

    pub(crate) fn number(&self) -> Result<f64, ModelError> {
        let parsed = match self.value {
            DeValue::Integer(n) if n.radix() == 10 => n.as_str().parse().ok(),
            DeValue::Integer(n) => u64::from_str_radix(n.as_str(), n.radix()).ok().map(|n| n as f64),
            DeValue::Float(n) => n.as_str().parse::<f64>().ok(),
            _ => return self.kind("a number"),
        };
        let value = parsed.unwrap_or(f64::INFINITY);
        if value.is_finite() {
            return Ok(value);
        }
        let key = shown(&self.key);
        self.source.fault(self.at, Fault::Number { key, value, must: "be a finite number" })
    }

    pub(crate) fn expression(&self) -> Result<Text, ModelError> {
        if let Some(text) = self.value.as_str() {
            let raw = self.source.text.get(self.at..).unwrap_or_default();
            let quotes = ["\"\"\"\r\n", "\"\"\"\n", "'''\r\n", "'''\n", "\"\"\"", "'''", "\"", "'"];
            let behind = quotes.into_iter().find_map(|q| raw.strip_prefix(q).map(|rest| (q.len(), rest)));
            let first = behind.filter(|(_, rest)| rest.starts_with(text)).map(|(quotes, _)| self.at + quotes);
            return Ok(Text { text: text.to_owned(), at: self.at, first });
        }
        if matches!(self.value, DeValue::Integer(_) | DeValue::Float(_)) {
            return Ok(Text { text: self.number()?.to_string(), at: self.at, first: None });
        }
        self.kind("an expression or a number")
    }

    pub(crate) fn section(&self, name: String) -> Result<Section<'a>, ModelError> {
        match self.value.as_table() {
            Some(table) => Ok(Section::new(name, self.at, table, self.source)),
            None => self.kind("a table"),
        }
    }

    fn items(&self) -> Result<Vec<Entry<'a>>, ModelError> {
        let Some(array) = self.value.as_array() else { return self.kind("a list") };
        let item = |value: &'a Spanned<DeValue<'a>>| Entry {
            key: self.key.clone(),
            key_at: value.span().start,
            at: value.span().start,
            value: value.get_ref(),
            source: self.source,
        };
        Ok(array.iter().map(item).collect())
    }

    pub(crate) fn sections(&self, name: &str) -> Result<Vec<Section<'a>>, ModelError> {
        self.items()?.iter().map(|item| item.section(name.to_owned())).collect()
    }

    pub(crate) fn numbers(&self) -> Result<Vec<f64>, ModelError> {
        self.items()?.iter().map(Entry::number).collect()
    }

    pub(crate) fn strings(&self) -> Result<Vec<String>, ModelError> {
        self.items()?.iter().map(Entry::string).collect()
    }

    pub(crate) fn expressions(&self) -> Result<Vec<Text>, ModelError> {
        self.items()?.iter().map(Entry::expression).collect()
    }
}
