//! What is attacked.

/// What an input is made of, which decides how it is mutated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Text: TOML, JSON, YAML.
    Text,
    /// A table of text.
    Table,
    /// A binary format.
    Format,
    /// A film of boxes (ISO/IEC 14496-12).
    Film,
    /// What arrives from a network.
    Packet,
    /// Numbers for an estimator, drawn anew for each input.
    Numbers,
}

/// How an input ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// With a result.
    Read,
    /// With a typed error, of these words.
    Refused(String),
}

impl<T, E: std::fmt::Display> From<Result<T, E>> for Outcome {
    /// An error must say something.
    fn from(result: Result<T, E>) -> Self {
        match result {
            Ok(_) => Self::Read,
            Err(error) => {
                let words = error.to_string();
                assert!(!words.is_empty(), "an error says nothing");
                Self::Refused(words)
            }
        }
    }
}

/// An end of either kind.
pub(crate) fn ends<T, E: std::fmt::Display>(result: Result<T, E>) {
    let _ = Outcome::from(result);
}

/// A function of bytes that must end with a result or a typed error, soon, and in little memory.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// Name.
    pub name: &'static str,
    /// What its input is made of.
    pub kind: Kind,
    /// Small inputs that are right, of which others are mutations.
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// Repairs what a reader would refuse a mutation for before it looks any further: checksums, lengths.
    pub repair: Option<fn(Vec<u8>) -> Vec<u8>>,
    /// What is attacked. It panics where a result breaks its own promise.
    pub run: fn(&[u8]) -> Outcome,
}

impl Target {
    /// A target whose inputs need no repair.
    pub(crate) const fn new(
        name: &'static str,
        kind: Kind,
        seeds: fn() -> Vec<Vec<u8>>,
        run: fn(&[u8]) -> Outcome,
    ) -> Self {
        Self { name, kind, seeds, repair: None, run }
    }

    pub(crate) const fn repaired_by(mut self, repair: fn(Vec<u8>) -> Vec<u8>) -> Self {
        self.repair = Some(repair);
        self
    }
}
