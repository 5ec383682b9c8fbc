//! Questions on a terminal; flags in a script.

use super::NO_FRAME;
use crate::cli::WrongCall;
use anyhow::{Context, Result};
use std::io::{BufRead, IsTerminal};

/// Asks for what no flag has said. In a script nothing is asked, and what is missing is gathered.
pub(super) struct Asker {
    answers: Option<Box<dyn BufRead>>,
    missing: Vec<&'static str>,
    asked: usize,
}

/// One question.
pub(super) struct Question<'a> {
    /// The flag that answers it.
    pub(super) flag: &'static str,
    /// What is asked, with the unit.
    pub(super) text: &'a str,
    /// What an empty answer, or a script without the flag, means; none where an answer is needed.
    pub(super) default: Option<&'a str>,
}

impl Asker {
    /// One that asks where standard input is a terminal.
    pub(super) fn new() -> Self {
        let answers: Option<Box<dyn BufRead>> =
            std::io::stdin().is_terminal().then(|| Box::new(std::io::stdin().lock()) as _);
        Self { answers, missing: Vec::new(), asked: 0 }
    }

    #[cfg(test)]
    pub(super) fn with_answers(answers: &'static str) -> Self {
        Self { answers: Some(Box::new(answers.as_bytes())), missing: Vec::new(), asked: 0 }
    }

    #[cfg(test)]
    pub(super) fn in_a_script() -> Self {
        Self { answers: None, missing: Vec::new(), asked: 0 }
    }

    /// The answer to a question: what a flag gave, or what is typed until it can be read; none in a script where it is
    /// missing, which is noted.
    ///
    /// # Errors
    /// A flag whose value cannot be read; the end of what is typed.
    pub(super) fn ask<T>(
        &mut self,
        given: Option<&str>,
        question: &Question<'_>,
        read: impl Fn(&str) -> Result<T, String>,
    ) -> Result<Option<T>> {
        let flag = question.flag;
        if let Some(given) = given {
            return read(given).map(Some).map_err(|e| WrongCall(format!("{flag}: {e}")).into());
        }
        if self.answers.is_none() {
            let Some(default) = question.default else {
                self.missing.push(flag);
                return Ok(None);
            };
            return read(default).map(Some).map_err(|e| WrongCall(format!("{flag}: {e}")).into());
        }
        self.asked += 1;
        loop {
            let default = question.default.map_or_else(String::new, |d| format!(" [{d}]"));
            eprint!("{}. {}{default}: ", self.asked, question.text);
            let typed = self.line()?;
            let answer = match (typed.as_str(), question.default) {
                ("", Some(default)) => default,
                (typed, _) => typed,
            };
            match read(answer) {
                Ok(value) => return Ok(Some(value)),
                Err(error) => eprintln!("   {error}"),
            }
        }
    }

    /// Answers of several lines, up to an empty one, each read as it comes.
    ///
    /// # Errors
    /// As [`Self::ask`].
    pub(super) fn ask_lines(
        &mut self,
        given: &[String],
        question: &Question<'_>,
        mut read: impl FnMut(&str) -> Result<(), String>,
    ) -> Result<()> {
        let flag = question.flag;
        for line in given {
            read(line).map_err(|e| WrongCall(format!("{flag} {line}: {e}")))?;
        }
        if !given.is_empty() {
            return Ok(());
        }
        if self.answers.is_none() {
            self.missing.push(flag);
            return Ok(());
        }
        self.asked += 1;
        eprintln!("{}. {}; an empty line ends", self.asked, question.text);
        loop {
            eprint!("   ");
            match self.line()?.as_str() {
                "" => return Ok(()),
                typed => {
                    if let Err(error) = read(typed) {
                        eprintln!("   {error}: once more");
                    }
                }
            }
        }
    }

    /// Whether questions are asked: not in a script.
    pub(super) fn is_asking(&self) -> bool {
        self.answers.is_some()
    }

    fn line(&mut self) -> Result<String> {
        let mut line = String::new();
        let read = match &mut self.answers {
            Some(answers) => answers.read_line(&mut line).context("standard input")?,
            None => 0,
        };
        if read == 0 {
            return Err(WrongCall("the answers ended before the questions".into()).into());
        }
        Ok(line.trim().to_owned())
    }

    /// Refuses a script that has left out flags, all of which are named.
    ///
    /// # Errors
    /// The flags that are missing.
    pub(super) fn finish(&self) -> Result<()> {
        if self.missing.is_empty() {
            return Ok(());
        }
        let needs_frame = ["--still", "--distances"].iter().any(|flag| self.missing.contains(flag));
        let frame = if needs_frame { format!(". {NO_FRAME}") } else { String::new() };
        let missing = self.missing.join(", ");
        let message = format!(
            "standard input is no terminal, so nothing is asked: give {missing} (see `mavsight help new`){frame}"
        );
        Err(WrongCall(message).into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn question(flag: &'static str, default: Option<&'static str>) -> Question<'static> {
        Question { flag, text: "how many", default }
    }

    fn number(text: &str) -> Result<u32, String> {
        text.parse().map_err(|_| format!("{text:?} is no number"))
    }

    #[test]
    fn a_question_is_asked_until_it_is_answered() {
        let mut asker = Asker::with_answers("many\n7\n\na\nb\n\n");
        assert_eq!(asker.ask(None, &question("--n", None), number).unwrap(), Some(7));
        assert_eq!(asker.ask(None, &question("--m", Some("3")), number).unwrap(), Some(3));
        assert_eq!(asker.ask(Some("5"), &question("--k", None), number).unwrap(), Some(5));
        let mut lines = Vec::new();
        let add = |line: &str| {
            lines.push(line.to_owned());
            Ok(())
        };
        asker.ask_lines(&[], &question("--l", None), add).unwrap();
        assert_eq!(lines, ["a", "b"]);
        assert_eq!(asker.asked, 3);
        assert!(asker.ask(None, &question("--n", None), number).is_err());
    }

    #[test]
    fn a_script_is_refused_with_all_that_is_missing() {
        let mut asker = Asker::in_a_script();
        assert_eq!(asker.ask(None, &question("--n", None), number).unwrap(), None);
        assert_eq!(asker.ask(None, &question("--m", Some("3")), number).unwrap(), Some(3));
        asker.ask_lines(&[], &question("--ball", None), |_| Ok(())).unwrap();
        let refused = asker.finish().unwrap_err().to_string();
        assert!(refused.contains("--n, --ball") && !refused.contains("--m"), "{refused}");
        assert!(!refused.contains("mavsight targets"), "{refused}");
        asker.ask_lines(&[], &question("--distances", None), |_| Ok(())).unwrap();
        assert!(asker.finish().unwrap_err().to_string().contains("mavsight targets"));
    }
}
