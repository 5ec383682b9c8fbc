//! YAML calibration files as trees whose nodes know their line: `saphyr-parser` reads, this file builds the
//! tree.
//!
//! Tags such as `!!opencv-matrix` are passed over, and so is OpenCV 4's first line `%YAML:1.0`, which is not
//! YAML. Anchors, aliases and several documents are refused.

use super::rigs::checked;
use crate::{SessionError, error::read_text};
use mavsight_geometry::{ImageSize, Intrinsics};
use saphyr_parser::{Event, Parser};
use std::path::{Path, PathBuf};

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Yaml {
    line: u64,
    value: Value,
}

#[derive(Debug, Clone, PartialEq)]
enum Value {
    /// Text without its quotes.
    Scalar(String),
    List(Vec<Yaml>),
    /// Keys in order.
    Map(Vec<(String, Yaml)>),
}

/// Nesting beyond this is no calibration.
const DEEPEST: usize = 32;

#[derive(Debug, Clone)]
pub(super) struct YamlFile {
    pub(super) path: PathBuf,
    pub(super) root: Yaml,
}

impl YamlFile {
    pub(super) fn read(path: &Path, role: &str) -> Result<Self, SessionError> {
        let text = read_text(path, role)?;
        let lines: Vec<&str> = text.lines().map(|l| if l.starts_with('%') { "#" } else { l }).collect();
        let root = tree(path, &lines.join("\n"), lines.len() as u64)?;
        Ok(Self { path: path.to_owned(), root })
    }

    pub(super) fn refuse(&self, node: &Yaml, detail: impl Into<String>) -> SessionError {
        SessionError::line(&self.path, node.line, detail)
    }

    pub(super) fn key<'a>(&self, node: &'a Yaml, key: &str) -> Result<&'a Yaml, SessionError> {
        node.get(key).ok_or_else(|| {
            self.refuse(node, format!("there is no {key:?}; the keys are {}: add it", node.keys().join(", ")))
        })
    }

    /// A key's text, which must be one of those that are known.
    pub(super) fn word<'a>(
        &self,
        node: &'a Yaml,
        key: &str,
        known: &[&str],
        remedy: &str,
    ) -> Result<&'a str, SessionError> {
        let at = self.key(node, key)?;
        let text = at.text().unwrap_or("");
        let wrong = || self.refuse(at, format!("{key} {text:?}: {remedy}"));
        if known.contains(&text) { Ok(text) } else { Err(wrong()) }
    }

    /// The camera matrix of a key, for images of that size.
    pub(super) fn intrinsics(&self, key: &str, size: ImageSize) -> Result<Intrinsics, SessionError> {
        let m = self.matrix(self.key(&self.root, key)?, Some((3, 3)))?;
        let k = Intrinsics { fx_px: m[0], skew_px: m[1], cx_px: m[2], fy_px: m[4], cy_px: m[5] };
        checked(&self.path, key, k, size)
    }

    pub(super) fn number(&self, node: &Yaml) -> Result<f64, SessionError> {
        let number = node.text().and_then(|t| t.parse::<f64>().ok()).filter(|x| x.is_finite());
        number.ok_or_else(|| self.refuse(node, format!("{} is not a finite number", node.describe())))
    }

    /// A node's list of finite numbers; lists in it are strung together.
    pub(super) fn numbers(&self, node: &Yaml) -> Result<Vec<f64>, SessionError> {
        let Value::List(items) = &node.value else {
            return Err(self.refuse(node, format!("{} is not a list of numbers", node.describe())));
        };
        let mut all = Vec::new();
        for item in items {
            match &item.value {
                Value::List(_) => all.extend(self.numbers(item)?),
                _ => all.push(self.number(item)?),
            }
        }
        Ok(all)
    }

    /// A list of exactly N numbers; `what` is what has that many.
    pub(super) fn exactly<const N: usize>(&self, node: &Yaml, what: &str) -> Result<[f64; N], SessionError> {
        let all = self.numbers(node)?;
        all.as_slice()
            .try_into()
            .map_err(|_| self.refuse(node, format!("{} numbers where {what} has {N}", all.len())))
    }

    /// The numbers, row by row, of a matrix with `rows`, `cols` and `data`, of a shape where that is known.
    pub(super) fn matrix(
        &self,
        node: &Yaml,
        shape: Option<(usize, usize)>,
    ) -> Result<Vec<f64>, SessionError> {
        let side = |key: &str| -> Result<usize, SessionError> {
            let at = self.key(node, key)?;
            let n = self.number(at)?;
            let is_whole = n.fract() == 0.0 && (0.0..=1e6).contains(&n);
            let wrong = || self.refuse(at, format!("{key} is {n}: a whole number is wanted"));
            if is_whole { Ok(n as usize) } else { Err(wrong()) }
        };
        let (rows, cols) = (side("rows")?, side("cols")?);
        let at = self.key(node, "data")?;
        let data = self.numbers(at)?;
        if data.len() != rows * cols {
            let announced = format!("{rows} rows of {cols} are announced: the file is damaged");
            return Err(self.refuse(at, format!("{} numbers where {announced}", data.len())));
        }
        match shape.filter(|shape| *shape != (rows, cols)) {
            Some((r, c)) => {
                Err(self.refuse(node, format!("a matrix of {rows} by {cols} where {r} by {c} is wanted")))
            }
            None => Ok(data),
        }
    }
}

impl Yaml {
    pub(super) fn get(&self, key: &str) -> Option<&Yaml> {
        match &self.value {
            Value::Map(entries) => entries.iter().find(|(k, _)| k == key).map(|(_, v)| v),
            _ => None,
        }
    }

    pub(super) fn keys(&self) -> Vec<&str> {
        match &self.value {
            Value::Map(entries) => entries.iter().map(|(k, _)| k.as_str()).collect(),
            _ => Vec::new(),
        }
    }

    pub(super) fn text(&self) -> Option<&str> {
        match &self.value {
            Value::Scalar(text) => Some(text),
            _ => None,
        }
    }

    fn describe(&self) -> String {
        match &self.value {
            Value::Scalar(text) => format!("{:?}", text.chars().take(40).collect::<String>()),
            Value::List(_) => "a list".into(),
            Value::Map(_) => "a map".into(),
        }
    }
}

/// A list or map that is being read; of a map, the key whose value comes next.
struct Open {
    node: Yaml,
    key: Option<String>,
}

/// Builds the tree of the one document in a text of so many lines.
fn tree(path: &Path, text: &str, lines: u64) -> Result<Yaml, SessionError> {
    let (mut open, mut root): (Vec<Open>, Option<Yaml>) = (Vec::new(), None);
    for event in Parser::new_from_str(text) {
        let (event, span) = event.map_err(|e| {
            let line = (e.marker().line() as u64).min(lines);
            let hint = if line == lines {
                "a bracket or quote is not closed: the file breaks off"
            } else {
                "check brackets, quotes and indentation, which has spaces and no tab"
            };
            SessionError::line(path, line, format!("{} ({hint})", e.info()))
        })?;
        let line = span.start.line() as u64;
        let wrong = |detail: &str| Err(SessionError::line(path, line, detail));
        let (value, anchor) = match event {
            Event::Scalar(text, _, anchor, _) => (Some(Value::Scalar(text.into_owned())), anchor),
            Event::SequenceStart(anchor, _) => (Some(Value::List(Vec::new())), anchor),
            Event::MappingStart(anchor, _) => (Some(Value::Map(Vec::new())), anchor),
            Event::SequenceEnd | Event::MappingEnd => (None, 0),
            Event::Alias(anchor) => (None, anchor),
            Event::DocumentStart(_) if root.is_some() => {
                return wrong("a second document begins here: one file holds one calibration");
            }
            _ => continue,
        };
        if anchor != 0 {
            return wrong("anchors and aliases are not read here: write the value out");
        }
        let node = match value {
            Some(value @ Value::Scalar(_)) => Yaml { line, value },
            Some(_) if open.len() >= DEEPEST => {
                return wrong(&format!("nested more than {DEEPEST} deep: no calibration is"));
            }
            Some(value) => {
                open.push(Open { node: Yaml { line, value }, key: None });
                continue;
            }
            None => match open.pop() {
                Some(closed) => closed.node,
                None => continue,
            },
        };
        let Some(Open { node: Yaml { value: parent, .. }, key }) = open.last_mut() else {
            root = Some(node);
            continue;
        };
        match (parent, key.take(), node) {
            (Value::List(items), _, node) => items.push(node),
            (Value::Map(entries), Some(key), node) => entries.push((key, node)),
            (Value::Map(entries), None, Yaml { value: Value::Scalar(name), .. }) => {
                if entries.iter().any(|(k, _)| *k == name) {
                    return wrong(&format!("{name:?} is there twice: keep one"));
                }
                *key = Some(name);
            }
            _ => return wrong("a list or map stands where a key is wanted"),
        }
    }
    root.ok_or_else(|| SessionError::line(path, 1, "the file is empty"))
}
