//! As much of YAML as calibration files use: block maps and lists, lists and maps in brackets, plain and quoted scalars,
//! comments. Tags such as `!!opencv-matrix` are passed over, and so is OpenCV 4's `%YAML:1.0`, which is not YAML. Anchors, aliases, multi-line text and
//! several documents are refused.

use super::text::Text;
use crate::SessionError;
use std::path::{Path, PathBuf};

/// A node and the line it begins on.
#[derive(Debug, Clone, PartialEq)]
pub struct Yaml {
    /// Line, from 1.
    pub line: u64,
    /// Content.
    pub value: Value,
}

/// What a node holds.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// Text as written, quotes taken off.
    Scalar(String),
    /// A list.
    List(Vec<Yaml>),
    /// Keys in order.
    Map(Vec<(String, Yaml)>),
}

/// Nesting beyond this is no calibration.
const DEEPEST: usize = 32;

struct Logical {
    line: u64,
    indent: usize,
    text: String,
}

/// A file with its path, for messages.
#[derive(Debug, Clone)]
pub struct YamlFile {
    /// Where it is.
    pub path: PathBuf,
    /// Its map.
    pub root: Yaml,
}

impl YamlFile {
    /// Reads a file.
    ///
    /// # Errors
    /// Names the line.
    pub fn read(path: &Path, role: &str) -> Result<Self, SessionError> {
        let text = Text::read(path, role)?;
        let parsed = logical(&text).and_then(|lines| {
            let mut at = 0;
            let Some(indent) = lines.first().map(|l| l.indent) else {
                return Err((1, "the file is empty".to_owned()));
            };
            let root = block(&lines, &mut at, indent, 0)?;
            match lines.get(at) {
                Some(rest) => Err((
                    rest.line,
                    format!(
                        "{:?} does not belong to what stands above: check the indentation",
                        short(&rest.text)
                    ),
                )),
                None => Ok(root),
            }
        });
        match parsed {
            Ok(root) => Ok(Self { path: path.to_owned(), root }),
            Err((line, detail)) => Err(SessionError::Row { path: path.to_owned(), line, detail }),
        }
    }

    /// The error for one node.
    pub fn refuse(&self, node: &Yaml, detail: impl Into<String>) -> SessionError {
        SessionError::Row { path: self.path.clone(), line: node.line, detail: detail.into() }
    }

    /// A key that must be there.
    ///
    /// # Errors
    /// Names the key and those that there are.
    pub fn key<'a>(&self, node: &'a Yaml, key: &str) -> Result<&'a Yaml, SessionError> {
        node.get(key).ok_or_else(|| {
            self.refuse(node, format!("there is no {key:?}; the keys are {}: add it", node.keys().join(", ")))
        })
    }

    /// A node's finite number.
    ///
    /// # Errors
    /// Names the line.
    pub fn number(&self, node: &Yaml) -> Result<f64, SessionError> {
        let number = node.text().and_then(|t| t.parse::<f64>().ok()).filter(|x| x.is_finite());
        number.ok_or_else(|| self.refuse(node, format!("{} is not a finite number", node.describe())))
    }

    /// A node's list of finite numbers; lists in it are strung together.
    ///
    /// # Errors
    /// Names the line.
    pub fn numbers(&self, node: &Yaml) -> Result<Vec<f64>, SessionError> {
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

    /// The same, of a count that is known.
    ///
    /// # Errors
    /// Names the line and both counts.
    pub fn exactly<const N: usize>(&self, node: &Yaml, what: &str) -> Result<[f64; N], SessionError> {
        let all = self.numbers(node)?;
        all.as_slice()
            .try_into()
            .map_err(|_| self.refuse(node, format!("{} numbers where {what} has {N}", all.len())))
    }

    /// The numbers of a matrix with `rows`, `cols` and `data`.
    ///
    /// # Errors
    /// A count of numbers other than rows times columns.
    pub fn matrix(&self, node: &Yaml) -> Result<(usize, usize, Vec<f64>), SessionError> {
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
        Ok((rows, cols, data))
    }

    /// A matrix of a shape that is known.
    ///
    /// # Errors
    /// Another shape.
    pub fn shaped(&self, node: &Yaml, rows: usize, cols: usize) -> Result<Vec<f64>, SessionError> {
        let (r, c, data) = self.matrix(node)?;
        if (r, c) == (rows, cols) {
            Ok(data)
        } else {
            Err(self.refuse(node, format!("a matrix of {r} by {c} where {rows} by {cols} is wanted")))
        }
    }
}

impl Yaml {
    /// A key's node.
    pub fn get(&self, key: &str) -> Option<&Yaml> {
        match &self.value {
            Value::Map(entries) => entries.iter().find(|(k, _)| k == key).map(|(_, v)| v),
            _ => None,
        }
    }

    /// Keys in order; none of what is no map.
    pub fn keys(&self) -> Vec<&str> {
        match &self.value {
            Value::Map(entries) => entries.iter().map(|(k, _)| k.as_str()).collect(),
            _ => Vec::new(),
        }
    }

    /// A scalar's text.
    pub fn text(&self) -> Option<&str> {
        match &self.value {
            Value::Scalar(text) => Some(text),
            _ => None,
        }
    }

    fn describe(&self) -> String {
        match &self.value {
            Value::Scalar(text) => format!("{:?}", short(text)),
            Value::List(_) => "a list".into(),
            Value::Map(_) => "a map".into(),
        }
    }
}

type Parsed<T> = Result<T, (u64, String)>;

fn short(text: &str) -> String {
    text.chars().take(40).collect()
}

/// Lines without comments, those of one bracket joined.
fn logical(text: &Text) -> Parsed<Vec<Logical>> {
    let mut lines: Vec<Logical> = Vec::new();
    let mut depth = 0i32;
    for line in text.lines() {
        let bare = uncommented(line.text);
        let trimmed = bare.trim();
        if depth > 0 {
            if let Some(open) = lines.last_mut() {
                depth += brackets(trimmed);
                open.text.push(' ');
                open.text.push_str(trimmed);
            }
            continue;
        }
        if trimmed.is_empty() || trimmed.starts_with('%') || trimmed == "..." {
            continue;
        }
        if trimmed.starts_with("---") {
            if !lines.is_empty() {
                return Err((
                    line.number,
                    "a second document begins here: one file holds one calibration".into(),
                ));
            }
            continue;
        }
        let indent = bare.len() - bare.trim_start().len();
        if bare[..indent].contains('\t') {
            return Err((line.number, "a tab indents the line: YAML wants spaces".into()));
        }
        depth = brackets(trimmed);
        // A list that begins in a list's item: each dash on a line of its own.
        let (mut indent, mut rest) = (indent, trimmed);
        while let Some(inner) = rest.strip_prefix("- ").map(str::trim_start).filter(|t| t.starts_with("- ")) {
            lines.push(Logical { line: line.number, indent, text: "-".to_owned() });
            indent += rest.len() - inner.len();
            rest = inner;
        }
        lines.push(Logical { line: line.number, indent, text: rest.to_owned() });
    }
    match lines.last() {
        Some(last) if depth > 0 => Err((last.line, "a bracket is not closed: the file breaks off".into())),
        _ => Ok(lines),
    }
}

/// Text outside quotes, with a function of each character and the one before it.
fn outside_quotes(text: &str, mut each: impl FnMut(usize, char, Option<char>) -> bool) {
    let (mut quote, mut before) = (None, None);
    for (at, c) in text.char_indices() {
        match quote {
            Some(q) if c == q => quote = None,
            Some(_) => {}
            // A quote opens where a value may begin; elsewhere it is an apostrophe.
            None if (c == '"' || c == '\'') && before.is_none_or(|b: char| " ,[{:".contains(b)) => {
                quote = Some(c)
            }
            None => {
                if !each(at, c, before) {
                    return;
                }
            }
        }
        before = Some(c);
    }
}

fn uncommented(text: &str) -> &str {
    let mut end = text.len();
    outside_quotes(text, |at, c, before| {
        let comment = c == '#' && before.is_none_or(char::is_whitespace);
        if comment {
            end = at;
        }
        !comment
    });
    &text[..end]
}

fn brackets(text: &str) -> i32 {
    let mut depth = 0;
    outside_quotes(text, |_, c, _| {
        depth += i32::from(c == '[' || c == '{') - i32::from(c == ']' || c == '}');
        true
    });
    depth
}

/// Key and rest of `key: rest`; the colon ends the line or has a space after it.
fn split_key(text: &str) -> Option<(&str, &str)> {
    if text.starts_with(['[', '{']) {
        return None;
    }
    let mut cut = None;
    outside_quotes(text, |at, c, _| {
        if c == ':' && text[at + 1..].chars().next().is_none_or(char::is_whitespace) {
            cut = Some(at);
        }
        cut.is_none()
    });
    cut.map(|at| (unquoted(text[..at].trim()), text[at + 1..].trim()))
}

fn unquoted(text: &str) -> &str {
    let inner = |q: char| text.strip_prefix(q).and_then(|t| t.strip_suffix(q));
    inner('"').or_else(|| inner('\'')).unwrap_or(text)
}

fn untagged(text: &str) -> &str {
    if text.starts_with('!') {
        text.split_once(char::is_whitespace).map_or("", |(_, rest)| rest.trim())
    } else {
        text
    }
}

fn block(lines: &[Logical], at: &mut usize, indent: usize, depth: usize) -> Parsed<Yaml> {
    let first = &lines[*at];
    if depth > DEEPEST {
        return Err((first.line, format!("nested more than {DEEPEST} deep: no calibration is")));
    }
    let is_item = |text: &str| text == "-" || text.starts_with("- ");
    let (mut entries, mut items) = (Vec::new(), Vec::new());
    let list = is_item(&first.text);
    while let Some(line) = lines.get(*at).filter(|l| l.indent == indent && is_item(&l.text) == list) {
        *at += 1;
        if list {
            let rest = untagged(line.text[1..].trim());
            if split_key(rest).is_some() {
                return Err((
                    line.line,
                    "a map within a list item is not read here: write it in braces".into(),
                ));
            }
            items.push(content(lines, at, line, rest, indent, depth)?);
        } else {
            let wrong = || (line.line, format!("{:?} is no \"key: value\"", short(&line.text)));
            let (key, rest) = split_key(&line.text).ok_or_else(wrong)?;
            if entries.iter().any(|(k, _): &(String, Yaml)| k == key) {
                return Err((line.line, format!("{key:?} is there twice: keep one")));
            }
            entries.push((key.to_owned(), content(lines, at, line, untagged(rest), indent, depth)?));
        }
    }
    Ok(Yaml { line: first.line, value: if list { Value::List(items) } else { Value::Map(entries) } })
}

/// What stands behind a key or a dash: on the same line, or in a block below.
fn content(
    lines: &[Logical],
    at: &mut usize,
    line: &Logical,
    rest: &str,
    indent: usize,
    depth: usize,
) -> Parsed<Yaml> {
    if !rest.is_empty() {
        let mut left = rest;
        let node = flow(&mut left, line.line, depth + 1, "")?;
        return if left.trim().is_empty() {
            Ok(node)
        } else {
            Err((line.line, format!("{:?} stands after the value", short(left))))
        };
    }
    match lines.get(*at) {
        Some(next)
            if next.indent > indent
                || (next.indent == indent
                    && (next.text == "-" || next.text.starts_with("- "))
                    && !line.text.starts_with('-')) =>
        {
            block(lines, at, next.indent, depth + 1)
        }
        _ => Ok(Yaml { line: line.line, value: Value::Scalar(String::new()) }),
    }
}

/// A scalar up to one of `stops`, or a list or map in brackets.
fn flow(left: &mut &str, line: u64, depth: usize, stops: &str) -> Parsed<Yaml> {
    let text = left.trim_start();
    let node = |value: Value| Ok(Yaml { line, value });
    let Some(open) = text.chars().next() else { return Err((line, "a value is missing".into())) };
    if depth > DEEPEST {
        return Err((line, format!("nested more than {DEEPEST} deep: no calibration is")));
    }
    match open {
        '[' => {
            *left = &text[1..];
            let mut items = Vec::new();
            while !closed(left, ']', line)? {
                items.push(flow(left, line, depth + 1, ",]")?);
                comma(left, ']', line)?;
            }
            node(Value::List(items))
        }
        '{' => {
            *left = &text[1..];
            let mut entries = Vec::new();
            while !closed(left, '}', line)? {
                let Some((key, rest)) = left.split_once(':') else {
                    return Err((line, "a key without a value in braces".into()));
                };
                *left = rest;
                entries.push((unquoted(key.trim()).to_owned(), flow(left, line, depth + 1, ",}")?));
                comma(left, '}', line)?;
            }
            node(Value::Map(entries))
        }
        '"' | '\'' => {
            let Some(end) = text[1..].find(open) else { return Err((line, "a quote is not closed".into())) };
            *left = &text[end + 2..];
            node(Value::Scalar(text[1..=end].to_owned()))
        }
        '&' | '*' | '|' | '>' => Err((
            line,
            format!("{open} (anchors, aliases, multi-line text) is not read here: write the value out"),
        )),
        _ => {
            let end = text.find(|c| stops.contains(c)).unwrap_or(text.len());
            *left = &text[end..];
            node(Value::Scalar(text[..end].trim().to_owned()))
        }
    }
}

fn closed(left: &mut &str, close: char, line: u64) -> Parsed<bool> {
    *left = left.trim_start();
    if left.is_empty() {
        return Err((line, format!("{close} is missing")));
    }
    Ok(left.strip_prefix(close).map(|rest| *left = rest).is_some())
}

fn comma(left: &mut &str, close: char, line: u64) -> Parsed<()> {
    *left = left.trim_start();
    match left.strip_prefix(',') {
        Some(rest) => *left = rest,
        None if left.starts_with(close) => {}
        None => return Err((line, format!("a comma or {close} is missing before {:?}", short(left)))),
    }
    Ok(())
}
