//! Commands of the user.

use serde::Deserialize;

/// A command of the user; on the wire `{"command":"start_recording"}`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Command {
    /// Record what is received, detected and sent from now on.
    StartRecording,
    /// End the recording.
    StopRecording,
    /// Calibrate the cameras.
    Calibrate,
    /// Check the rig.
    SelfCheck,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Ask {
    command: Command,
}

impl Command {
    /// The command of a message; none where it is no command.
    pub(crate) fn parse(text: &str) -> Option<Self> {
        serde_json::from_str::<Ask>(text).ok().map(|ask| ask.command)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_whole_commands_are_understood() {
        assert_eq!(Command::parse(r#"{"command":"start_recording"}"#), Some(Command::StartRecording));
        assert_eq!(Command::parse(r#"{"command":"stop_recording"}"#), Some(Command::StopRecording));
        assert_eq!(Command::parse(r#"{"command":"calibrate"}"#), Some(Command::Calibrate));
        assert_eq!(Command::parse(r#"{"command":"self_check"}"#), Some(Command::SelfCheck));
        for other in
            ["", "{}", "[]", r#""calibrate""#, r#"{"command":"format"}"#, r#"{"command":"calibrate","x":1}"#]
        {
            assert_eq!(Command::parse(other), None, "{other}");
        }
    }
}
