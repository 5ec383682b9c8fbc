//! A short virtual flight on disk, made once a test binary, and copies of it to spoil.

#![allow(dead_code)]

use assert_cmd::Command;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use tempfile::TempDir;

/// Twelve frames of hover: enough to smooth, few enough to film quickly.
const SCENARIO: &str = r#"
duration_s = 0.4
frame_rate_hz = 30.0
input_rate_hz = 100.0
position_m = [0.0, 0.0, 1.5]
heading_deg = 22.5
maneuver = []
"#;

/// The program under test.
pub(crate) fn mavsight() -> Command {
    Command::new(env!("CARGO_BIN_EXE_mavsight"))
}

fn original() -> &'static Path {
    static ORIGINAL: OnceLock<TempDir> = OnceLock::new();
    ORIGINAL.get_or_init(|| filmed(SCENARIO)).path()
}

/// A folder whose `flight` is a session of the paper's vehicle in a scenario.
fn filmed(scenario: &str) -> TempDir {
    let dir = TempDir::new().expect("a folder for the flight");
    let (file, flight) = (dir.path().join("scenario.toml"), dir.path().join("flight"));
    std::fs::write(&file, scenario).expect("the scenario is written");
    mavsight().arg("simulate").arg("--scenario").arg(&file).arg("--out").arg(&flight).assert().success();
    mavsight().arg("film").arg(&flight).arg("--out").arg(&flight).assert().success();
    dir
}

/// A session that may be spoilt.
pub(crate) struct Session {
    dir: TempDir,
}

impl Session {
    /// A fresh copy of the short flight.
    pub(crate) fn new() -> Self {
        let dir = TempDir::new().expect("a folder for the copy");
        copy(&original().join("flight"), dir.path());
        Self { dir }
    }

    /// The short flight at another heading.
    pub(crate) fn with_heading(heading_deg: f64) -> Self {
        let turned = SCENARIO.replace("heading_deg = 22.5", &format!("heading_deg = {heading_deg:?}"));
        let (film, dir) = (filmed(&turned), TempDir::new().expect("a folder for the copy"));
        copy(&film.path().join("flight"), dir.path());
        Self { dir }
    }

    /// A file of it.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// Replaces text that must be there.
    pub(crate) fn replace(&self, file: &str, from: &str, to: &str) -> &Self {
        let text = std::fs::read_to_string(self.path(file)).expect("the file is there");
        assert!(text.contains(from), "{file} does not contain {from:?}:\n{text}");
        std::fs::write(self.path(file), text.replacen(from, to, 1)).expect("the file is written");
        self
    }

    /// Changes the lines of a file.
    pub(crate) fn edit_lines(&self, file: &str, change: impl FnOnce(&mut Vec<String>)) -> &Self {
        let text = std::fs::read_to_string(self.path(file)).expect("the file is there");
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        change(&mut lines);
        std::fs::write(self.path(file), lines.join("\n") + "\n").expect("the file is written");
        self
    }

    /// Runs the chain, which must refuse: one message that holds every given word, status 1 or 2, no result
    /// file.
    pub(crate) fn is_refused(&self, words: &[&str]) {
        self.is_refused_with(words, |command| command);
    }

    /// The same with a changed environment.
    pub(crate) fn is_refused_with(&self, words: &[&str], change: impl FnOnce(&mut Command) -> &mut Command) {
        let out = self.path("results");
        let mut command = mavsight();
        command.arg("run").arg(self.path("session.toml")).arg("--out").arg(&out);
        let assert = change(&mut command).assert().failure();
        let output = assert.get_output();
        let code = output.status.code();
        assert!(matches!(code, Some(1 | 2)), "exit status {code:?}");
        let message = String::from_utf8_lossy(&output.stderr);
        for word in words {
            assert!(message.contains(word), "the message lacks {word:?}: {message}");
        }
        let messages = message.lines().filter(|line| line.starts_with("mavsight: ")).count();
        assert_eq!(messages, 1, "one message, not: {message}");
        let left: Vec<_> =
            std::fs::read_dir(&out).map(|d| d.flatten().map(|e| e.file_name()).collect()).unwrap_or_default();
        assert!(left.is_empty(), "left behind: {left:?}");
    }
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).expect("the folder is made");
    for entry in std::fs::read_dir(from).expect("the folder is read").flatten() {
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &target);
        } else {
            std::fs::copy(entry.path(), target).expect("the file is copied");
        }
    }
}
