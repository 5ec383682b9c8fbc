//! YAML calibration files as trees whose nodes know their line: `saphyr-parser` reads, this file builds the
//! tree.
//!
//! Tags such as `!!opencv-matrix` are passed over, and so is OpenCV 4's first line `%YAML:1.0`, which is not
//! YAML. Anchors, aliases and several documents are refused.

use super::text::Text;
use crate::SessionError;
use saphyr_parser::{Event, Parser};
use std::path::{Path, PathBuf};

/// A node and the line it begins on.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Yaml {
    /// Line, from 1.
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

/// A matrix as OpenCV and ROS write it.
pub(super) struct Matrix {
    rows: usize,
    cols: usize,
    /// Row by row.
    pub(super) data: Vec<f64>,
}

/// Nesting beyond this is no calibration.
const DEEPEST: usize = 32;

/// A file with its path, for messages.
#[derive(Debug, Clone)]
pub(super) struct YamlFile {
    pub(super) path: PathBuf,
    pub(super) root: Yaml,
}

impl YamlFile {
    /// Reads a file.
    pub(super) fn read(path: &Path, role: &str) -> Result<Self, SessionError> {
        let text = Text::read(path, role)?;
        let directive = |line: &str| line.starts_with('%');
        let lines: Vec<&str> = text.lines().map(|l| if directive(l.text) { "#" } else { l.text }).collect();
        let root = tree(&lines.join("\n"), lines.len() as u64).map_err(|wrong| SessionError::Row {
            path: path.to_owned(),
            line: wrong.line,
            detail: wrong.detail,
        })?;
        Ok(Self { path: path.to_owned(), root })
    }

    /// The error for one node.
    pub(super) fn refuse(&self, node: &Yaml, detail: impl Into<String>) -> SessionError {
        SessionError::Row { path: self.path.clone(), line: node.line, detail: detail.into() }
    }

    /// A key that must be there.
    pub(super) fn key<'a>(&self, node: &'a Yaml, key: &str) -> Result<&'a Yaml, SessionError> {
        node.get(key).ok_or_else(|| {
            self.refuse(node, format!("there is no {key:?}; the keys are {}: add it", node.keys().join(", ")))
        })
    }

    /// A node's finite number.
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

    /// The numbers of a matrix with `rows`, `cols` and `data`.
    pub(super) fn matrix(&self, node: &Yaml) -> Result<Matrix, SessionError> {
        let side = |key: &str| -> Result<usize, SessionError> {
            let at = self.key(node, key)?;
            let n = self.number(at)?;
            let whole = n.fract() == 0.0 && (0.0..=1e6).contains(&n);
            if whole {
                Ok(n as usize)
            } else {
                Err(self.refuse(at, format!("{key} is {n}: a whole number is wanted")))
            }
        };
        let (rows, cols) = (side("rows")?, side("cols")?);
        let at = self.key(node, "data")?;
        let data = self.numbers(at)?;
        if data.len() != rows * cols {
            return Err(self.refuse(
                at,
                format!(
                    "{} numbers where {rows} rows of {cols} are announced: the file is damaged",
                    data.len()
                ),
            ));
        }
        Ok(Matrix { rows, cols, data })
    }

    /// A matrix of a shape that is known.
    pub(super) fn shaped(&self, node: &Yaml, rows: usize, cols: usize) -> Result<Vec<f64>, SessionError> {
        let Matrix { rows: r, cols: c, data } = self.matrix(node)?;
        if (r, c) == (rows, cols) {
            Ok(data)
        } else {
            Err(self.refuse(node, format!("a matrix of {r} by {c} where {rows} by {cols} is wanted")))
        }
    }
}

impl Yaml {
    /// A key's node.
    pub(super) fn get(&self, key: &str) -> Option<&Yaml> {
        match &self.value {
            Value::Map(entries) => entries.iter().find(|(k, _)| k == key).map(|(_, v)| v),
            _ => None,
        }
    }

    /// Keys in order; none of what is no map.
    pub(super) fn keys(&self) -> Vec<&str> {
        match &self.value {
            Value::Map(entries) => entries.iter().map(|(k, _)| k.as_str()).collect(),
            _ => Vec::new(),
        }
    }

    /// A scalar's text.
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

/// What is wrong, and where.
struct Wrong {
    line: u64,
    detail: String,
}

/// A list or map that is being read; of a map, the key whose value comes next.
struct Open {
    node: Yaml,
    key: Option<String>,
}

/// Builds the tree of the one document in a text of so many lines.
fn tree(text: &str, lines: u64) -> Result<Yaml, Wrong> {
    let (mut open, mut root): (Vec<Open>, Option<Yaml>) = (Vec::new(), None);
    for event in Parser::new_from_str(text) {
        let (event, span) = event.map_err(|e| {
            let line = (e.marker().line() as u64).min(lines);
            let hint = if line == lines {
                "a bracket or quote is not closed: the file breaks off"
            } else {
                "check brackets, quotes and indentation, which has spaces and no tab"
            };
            Wrong { line, detail: format!("{} ({hint})", e.info()) }
        })?;
        let line = span.start.line() as u64;
        let wrong = |detail: String| Err(Wrong { line, detail });
        let (value, anchor) = match event {
            Event::Scalar(text, _, anchor, _) => (Some(Value::Scalar(text.into_owned())), anchor),
            Event::SequenceStart(anchor, _) => (Some(Value::List(Vec::new())), anchor),
            Event::MappingStart(anchor, _) => (Some(Value::Map(Vec::new())), anchor),
            Event::SequenceEnd | Event::MappingEnd => (None, 0),
            Event::Alias(anchor) => (None, anchor),
            Event::DocumentStart(_) if root.is_some() => {
                return wrong("a second document begins here: one file holds one calibration".into());
            }
            _ => continue,
        };
        if anchor != 0 {
            return wrong("anchors and aliases are not read here: write the value out".into());
        }
        let mut node = match value {
            Some(scalar @ Value::Scalar(_)) => Yaml { line, value: scalar },
            Some(_) if open.len() >= DEEPEST => {
                return wrong(format!("nested more than {DEEPEST} deep: no calibration is"));
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
        match open.last_mut() {
            None => root = Some(node),
            Some(Open { node: Yaml { value: Value::Map(entries), .. }, key }) => {
                match (key.take(), node.value) {
                    (Some(key), value) => {
                        node.value = value;
                        entries.push((key, node));
                    }
                    (None, Value::Scalar(name)) if entries.iter().any(|(k, _)| *k == name) => {
                        return wrong(format!("{name:?} is there twice: keep one"));
                    }
                    (None, Value::Scalar(name)) => *key = Some(name),
                    (None, _) => return wrong("a list or map stands where a key is wanted".into()),
                }
            }
            Some(Open { node: Yaml { value: Value::List(items), .. }, .. }) => items.push(node),
            Some(_) => {}
        }
    }
    root.ok_or_else(|| Wrong { line: 1, detail: "the file is empty".into() })
}
