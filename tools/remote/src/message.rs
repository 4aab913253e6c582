//! Messages between desk and agent.

use serde::{Deserialize, Serialize};
use shared_types::describe::Settings;
use shared_types::text::{line_if_any, line_of};

use crate::machine::Findings;

/// Version of everything that desk and agent say to each other.
pub const PROTOCOL: u32 = 3;

/// A reason of the agent to end, and whether the user can mend it where it was typed.
pub(crate) type Refusal = (bool, String);

/// Message of the desk.
#[derive(Debug, Serialize, Deserialize)]
#[serde(tag = "message", rename_all = "kebab-case")]
pub enum ToAgent {
    /// First: this program is meant. Parts of its file follow if the agent wants them.
    Program {
        /// [`PROTOCOL`] of the desk.
        protocol: u32,
        /// Hash of the file.
        blake3: String,
        /// Length in bytes.
        bytes: u64,
    },
    /// Run the program with `--describe`.
    Describe,
    /// Run it with `--check` and this job.
    Check {
        /// The job file.
        job: String,
    },
    /// Run it in a session.
    Run(Box<RunRequest>),
    /// A control message of the plant.
    Control {
        /// The message.
        content: String,
    },
    /// A line for the program's standard input.
    Word {
        /// The line.
        line: String,
    },
    /// Remove the programs that are kept.
    Clean,
    /// Say the same.
    Echo,
    /// The desk lives.
    Beat,
}

/// Request for a run.
#[derive(Debug, Serialize, Deserialize)]
pub struct RunRequest {
    /// The job file.
    pub job: String,
    /// Number of the controller in the session.
    pub epoch: u32,
    /// Longest silence in s; `None` for no limit.
    pub limit_s: Option<f64>,
    /// A fresh key, as hexadecimal digits.
    pub key: String,
    /// First message of the handshake, as hexadecimal digits.
    pub handshake: String,
    /// Rule for a target that hears no sample any more, where the plant waits for nobody.
    pub missed: Missed,
    /// The safe command, by the names of the plant's commands.
    pub safe: Settings,
    /// Random number of the desk's boot.
    pub boot_id: String,
}

/// Rule for a target that hears no sample any more: then its output is the safe command.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Missed {
    /// Sample period in s.
    pub period_s: f64,
    /// Number of periods.
    pub periods: u32,
}

/// Message of the agent.
#[derive(Debug, Serialize, Deserialize)]
#[serde(tag = "message", rename_all = "kebab-case")]
pub enum ToDesk {
    /// First, unasked.
    Here {
        /// [`PROTOCOL`] of the agent.
        protocol: u32,
        /// Findings about its machine.
        findings: Findings,
    },
    /// The program is not here: send its parts.
    Send,
    /// A part of it came; there are more.
    Taken,
    /// The program is here, whole.
    Have,
    /// The program's answer.
    Answer {
        /// Exit code; `None` if it was killed.
        code: Option<i32>,
        /// Standard output.
        stdout: String,
        /// The beginning of its standard error.
        stderr: String,
    },
    /// The program runs.
    Running {
        /// Address on which datagrams are awaited; `None` if they cannot be.
        #[serde(default, deserialize_with = "line_if_any")]
        address: Option<String>,
        /// Answer to the handshake, as hexadecimal digits.
        handshake: String,
    },
    /// A control message of the controller.
    Control {
        /// The message.
        content: String,
    },
    /// Something that the controller wrote.
    Log {
        /// Text of it.
        text: String,
    },
    /// The real-time settings that the controller was granted, a JSON file of its session.
    Realtime {
        /// The file.
        report: String,
    },
    /// The output was switched to the safe command, or is the controller's again.
    Output {
        /// Event in words.
        #[serde(deserialize_with = "line_of")]
        what: String,
        /// Number of times that it was switched in this run.
        switches: u32,
        /// True if the output is the controller's again.
        is_back: bool,
    },
    /// The program ended.
    Ended {
        /// Exit code; `None` if it was killed.
        code: Option<i32>,
        /// Fate of the program, if that was not in order.
        #[serde(default, deserialize_with = "line_if_any")]
        fate: Option<String>,
        /// Number of its last frame.
        said: u64,
    },
    /// The agent refuses, and is about to end.
    Refused {
        /// True if the user can mend it where it was typed.
        is_usage: bool,
        /// Reason for it.
        #[serde(deserialize_with = "line_of")]
        reason: String,
    },
    /// The programs that were kept are removed.
    Cleaned {
        /// Number of them.
        files: u32,
    },
    /// The same was said.
    Echo,
    /// The agent lives.
    Beat,
}

/// Writes what both ends believe about a session; the handshake fails if they do not agree.
#[must_use]
pub fn prologue(blake3: &str, job: &str, epoch: u32) -> Vec<u8> {
    let job = blake3::hash(job.as_bytes()).to_hex();
    format!("hil-target {PROTOCOL} desk-target {epoch} {blake3} {job}").into_bytes()
}

/// Writes bytes as hexadecimal digits.
#[must_use]
pub fn to_hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Reads hexadecimal digits.
#[must_use]
pub fn from_hex(digits: &str) -> Option<Vec<u8>> {
    let pairs = digits.as_bytes().chunks(2);
    pairs
        .map(|pair| {
            u8::from_str_radix(str::from_utf8(pair).ok()?, 16)
                .ok()
                .filter(|_| pair.len() == 2 && pair.iter().all(u8::is_ascii_hexdigit))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hexadecimal_digits_are_read_as_they_are_written_and_nothing_else_is() {
        let bytes: Vec<u8> = (0..=255).collect();
        assert_eq!(from_hex(&to_hex(&bytes)), Some(bytes));
        for wrong in ["0", "0g", "+f", "-1", " 1", "\u{e9}"] {
            assert_eq!(from_hex(wrong), None, "{wrong}");
        }
    }
}
