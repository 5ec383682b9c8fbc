//! A page of another kind on the same server.

use std::fmt;

/// What a page of another kind answers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reply {
    /// Media type.
    pub media_type: &'static str,
    /// The whole answer.
    pub text: String,
}

/// The header without which nothing below `do/` is done, and its value. Scripts of other origins cannot send it: a browser
/// would ask this server for leave, which it does not give (Fetch standard, CORS-preflight).
pub(crate) const OWN_HEADER: (&str, &str) = ("x-mavsight", "page");

/// Answers the path below the page's address and what follows a question mark; none where there is nothing.
type Answer = dyn Fn(&str, &str) -> Option<Reply> + Send + Sync;

/// A page of another kind: its files, and what it asks for.
pub(crate) struct Site(pub(crate) Box<Answer>);

impl fmt::Debug for Site {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("Site")
    }
}
