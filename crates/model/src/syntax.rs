//! The text of an expression as a tree.

use crate::document::shown;
use crate::fault::Fault;

/// A part of an expression and where its text begins, in bytes.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Part {
    pub(crate) at: usize,
    pub(crate) kind: Kind,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Kind {
    Number(f64),
    Name(String),
    Negative(Box<Part>),
    /// Terms, each with whether it is subtracted.
    Sum(Vec<(bool, Part)>),
    /// Factors, each with whether it divides.
    Product(Vec<(bool, Part)>),
    Power(Box<Part>, Box<Part>),
    Call(String, Vec<Part>),
}

impl Part {
    /// All names of values in it, each with its place, in the order of the text.
    pub(crate) fn names(&self) -> Vec<(usize, &str)> {
        match &self.kind {
            Kind::Number(_) => Vec::new(),
            Kind::Name(name) => vec![(self.at, name)],
            Kind::Negative(inner) => inner.names(),
            Kind::Sum(parts) | Kind::Product(parts) => {
                parts.iter().flat_map(|(_, part)| part.names()).collect()
            }
            Kind::Power(base, exponent) => base.names().into_iter().chain(exponent.names()).collect(),
            Kind::Call(_, arguments) => arguments.iter().flat_map(Self::names).collect(),
        }
    }
}

/// Parentheses within parentheses, at most: what a person still reads.
const DEEPEST: usize = 60;
/// Parts of one expression, at most.
const LONGEST: usize = 20_000;

#[derive(Debug, Clone, PartialEq)]
enum Token {
    Number(f64),
    Name(String),
    Sign(char),
}

/// A fault and where it is in the text, in bytes.
pub(crate) type Placed<T> = Result<T, (usize, Fault)>;

/// Reads an expression: sums, products, powers (to the right, before a minus), calls and names.
pub(crate) fn parse(text: &str) -> Placed<Part> {
    let tokens = tokens(text)?;
    let mut reader = Reader { tokens: &tokens, next: 0, end: text.len(), depth: 0 };
    let part = reader.sum()?;
    match reader.tokens.get(reader.next) {
        None => Ok(part),
        Some((at, token)) => Err((*at, Fault::Unexpected { found: describe(token) })),
    }
}

fn describe(token: &Token) -> String {
    match token {
        Token::Number(value) => value.to_string(),
        Token::Name(name) => shown(name),
        Token::Sign(c) => c.to_string(),
    }
}

fn tokens(text: &str) -> Placed<Vec<(usize, Token)>> {
    let mut out = Vec::new();
    let mut rest = text.char_indices().peekable();
    while let Some(&(at, c)) = rest.peek() {
        if out.len() > LONGEST {
            return Err((at, Fault::TooLong(LONGEST)));
        }
        let end_of = |taken: &dyn Fn(usize, char) -> bool| {
            let mut own = text[at..].char_indices();
            own.find(|(k, c)| !taken(*k, *c)).map_or(text.len(), |(k, _)| at + k)
        };
        let end = if c.is_whitespace() {
            at + c.len_utf8()
        } else if c.is_ascii_digit() || c == '.' {
            let before = |k: usize| text[at..at + k].chars().next_back();
            let end = end_of(&|k, c| {
                let sign = matches!(c, '+' | '-') && matches!(before(k), Some('e' | 'E'));
                c.is_ascii_digit() || matches!(c, '.' | 'e' | 'E') || sign
            });
            let number: Result<f64, _> = text[at..end].parse();
            let value = number.ok().filter(|v| v.is_finite());
            let value = value.ok_or_else(|| (at, Fault::NotANumber(shown(&text[at..end]))))?;
            out.push((at, Token::Number(value)));
            end
        } else if c.is_alphabetic() || c == '_' {
            let end = end_of(&|_, c| c.is_alphanumeric() || c == '_');
            out.push((at, Token::Name(text[at..end].to_owned())));
            end
        } else if "+-*/^(),".contains(c) {
            out.push((at, Token::Sign(c)));
            at + 1
        } else {
            return Err((at, Fault::Unexpected { found: c.to_string() }));
        };
        while rest.next_if(|(k, _)| *k < end).is_some() {}
    }
    Ok(out)
}

struct Reader<'a> {
    tokens: &'a [(usize, Token)],
    next: usize,
    end: usize,
    depth: usize,
}

impl Reader<'_> {
    fn at(&self) -> usize {
        self.tokens.get(self.next).map_or(self.end, |(at, _)| *at)
    }

    fn takes(&mut self, sign: char) -> bool {
        let found = matches!(self.tokens.get(self.next), Some((_, Token::Sign(c))) if *c == sign);
        self.next += usize::from(found);
        found
    }

    fn sum(&mut self) -> Placed<Part> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err((self.at(), Fault::TooDeep(DEEPEST)));
        }
        let at = self.at();
        let mut terms = vec![(false, self.product()?)];
        loop {
            let minus = self.takes('-');
            if !minus && !self.takes('+') {
                break;
            }
            terms.push((minus, self.product()?));
        }
        self.depth -= 1;
        Ok(one_or(at, terms, Kind::Sum))
    }

    fn product(&mut self) -> Placed<Part> {
        let at = self.at();
        let mut factors = vec![(false, self.signed()?)];
        loop {
            let over = self.takes('/');
            if !over && !self.takes('*') {
                break;
            }
            factors.push((over, self.signed()?));
        }
        Ok(one_or(at, factors, Kind::Product))
    }

    fn signed(&mut self) -> Placed<Part> {
        let at = self.at();
        let mut negative = false;
        loop {
            if self.takes('-') {
                negative = !negative;
            } else if !self.takes('+') {
                break;
            }
        }
        let part = self.power()?;
        Ok(if negative { Part { at, kind: Kind::Negative(Box::new(part)) } } else { part })
    }

    fn power(&mut self) -> Placed<Part> {
        let at = self.at();
        let base = self.atom()?;
        if !self.takes('^') {
            return Ok(base);
        }
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err((self.at(), Fault::TooDeep(DEEPEST)));
        }
        let exponent = self.signed()?;
        self.depth -= 1;
        Ok(Part { at, kind: Kind::Power(Box::new(base), Box::new(exponent)) })
    }

    fn atom(&mut self) -> Placed<Part> {
        let Some((at, token)) = self.tokens.get(self.next) else { return Err((self.end, Fault::Ends)) };
        self.next += 1;
        let kind = match token {
            Token::Number(value) => Kind::Number(*value),
            Token::Name(name) if self.takes('(') => Kind::Call(name.clone(), self.arguments()?),
            Token::Name(name) => Kind::Name(name.clone()),
            Token::Sign('(') => {
                let inner = self.sum()?;
                self.closes()?;
                inner.kind
            }
            Token::Sign(c) => return Err((*at, Fault::Unexpected { found: c.to_string() })),
        };
        Ok(Part { at: *at, kind })
    }

    fn arguments(&mut self) -> Placed<Vec<Part>> {
        let mut out = vec![self.sum()?];
        while self.takes(',') {
            out.push(self.sum()?);
        }
        self.closes()?;
        Ok(out)
    }

    fn closes(&mut self) -> Placed<()> {
        if self.takes(')') {
            return Ok(());
        }
        let found = self.tokens.get(self.next);
        Err((self.at(), found.map_or(Fault::Ends, |(_, t)| Fault::Unexpected { found: describe(t) })))
    }
}

fn one_or(at: usize, mut parts: Vec<(bool, Part)>, kind: fn(Vec<(bool, Part)>) -> Kind) -> Part {
    match parts.pop() {
        Some((false, only)) if parts.is_empty() => only,
        Some(last) => {
            parts.push(last);
            Part { at, kind: kind(parts) }
        }
        None => Part { at, kind: kind(parts) },
    }
}
