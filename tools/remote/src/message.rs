//! Messages between desk and agent.

use serde::{Deserialize, Serialize};
use shared_types::describe::Settings;
use shared_types::text::{line_if_any, line_of};

use crate::machine::Findings;

/// Version of the protocol between `hil` on the user's machine and the agent.
pub const PROTOCOL: u32 = 3;

/// Reason for an agent to end, with `true` if it is a usage error that the user can fix on the command line.
pub(crate) type Refusal = (bool, String);

/// Message of the desk.
#[derive(Debug, Serialize, Deserialize)]
#[serde(tag = "message", rename_all = "kebab-case")]
pub(crate) enum ToAgent {
    /// First message: identifies the program. Parts of its file follow if the agent requests them.
    Program {
        /// [`PROTOCOL`] of the desk.
        protocol: u32,
        /// Hash of the file.
        blake3: String,
        /// Length in bytes.
        bytes: u64,
    },
    /// Request to run the program with `--describe`.
    Describe,
    /// Request to run the program with `--check` and this job.
    Check {
        /// Content of the job file.
        job: String,
    },
    /// Request to run the program in a session.
    Run(Box<RunRequest>),
    /// Control message of the plant.
    Control {
        /// Content of the message.
        content: String,
    },
    /// Line for the program's standard input.
    Word {
        /// Content of the line.
        line: String,
    },
    /// Request to remove the cached programs.
    Clean,
    /// Request to answer with an echo.
    Echo,
    /// Sign of life of the desk.
    Beat,
}

/// Request for a run.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct RunRequest {
    /// Content of the job file.
    pub job: String,
    /// Number of the controller in the session.
    pub epoch: u32,
    /// Maximum silence in s; `None` for no limit.
    pub limit_s: Option<f64>,
    /// Fresh key, as hexadecimal digits.
    pub key: String,
    /// First message of the handshake, as hexadecimal digits.
    pub handshake: String,
    /// Rule for missing samples on a target whose plant never waits.
    pub missed: Missed,
    /// Safe command, by the names of the plant's commands.
    pub safe: Settings,
    /// Random number of the desk's boot.
    pub boot_id: String,
}

/// Rule for missing samples: after this time the target's output switches to the safe command.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Missed {
    /// Sample period in s.
    pub period_s: f64,
    /// Number of periods.
    pub periods: u32,
}

/// Message of the agent.
#[derive(Debug, Serialize, Deserialize)]
#[serde(tag = "message", rename_all = "kebab-case")]
pub(crate) enum ToDesk {
    /// First message, sent without a request.
    Here {
        /// [`PROTOCOL`] of the agent.
        protocol: u32,
        /// Findings about the agent's machine.
        findings: Findings,
    },
    /// Request to send the parts of the program, which is not cached.
    Send,
    /// Acknowledgement of a part; more are missing.
    Taken,
    /// The program is complete on the target.
    Have,
    /// Answer of the program.
    Answer {
        /// Exit code; `None` if it was killed.
        code: Option<i32>,
        /// Standard output.
        stdout: String,
        /// Beginning of its standard error.
        stderr: String,
    },
    /// The program is running.
    Running {
        /// Address that receives datagrams; `None` if there is none.
        #[serde(default, deserialize_with = "line_if_any")]
        address: Option<String>,
        /// Answer to the handshake, as hexadecimal digits.
        handshake: String,
    },
    /// Control message of the controller.
    Control {
        /// Content of the message.
        content: String,
    },
    /// Output of the controller.
    Log {
        /// Text of the output.
        text: String,
    },
    /// Real-time settings granted to the controller, a JSON file of its session.
    Realtime {
        /// Content of the file.
        report: String,
    },
    /// The output was switched to the safe command, or back to the controller.
    Output {
        /// Event in words.
        #[serde(deserialize_with = "line_of")]
        what: String,
        /// Number of switches in this run.
        switches: u32,
        /// `true` if the controller has the output again.
        is_back: bool,
    },
    /// The program has ended.
    Ended {
        /// Exit code; `None` if it was killed.
        code: Option<i32>,
        /// Description of the program's end, if it was abnormal.
        #[serde(default, deserialize_with = "line_if_any")]
        fate: Option<String>,
        /// Number of its last frame.
        said: u64,
    },
    /// Refusal of the agent, which is about to end.
    Refused {
        /// `true` for a usage error that the user can fix on the command line.
        is_usage: bool,
        /// Reason.
        #[serde(deserialize_with = "line_of")]
        reason: String,
    },
    /// The cached programs were removed.
    Cleaned {
        /// Their number.
        files: u32,
    },
    /// Answer to an echo request.
    Echo,
    /// Sign of life of the agent.
    Beat,
}

/// Returns the facts about a session on which both ends must agree; the handshake fails otherwise.
pub(crate) fn prologue(blake3: &str, job: &str, epoch: u32) -> Vec<u8> {
    let job = blake3::hash(job.as_bytes()).to_hex();
    format!("hil-target {PROTOCOL} desk-target {epoch} {blake3} {job}").into_bytes()
}

/// Formats bytes as hexadecimal digits.
pub(crate) fn to_hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Parses hexadecimal digits.
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
    fn only_hexadecimal_digits_are_parsed_and_round_trips_are_exact() {
        let bytes: Vec<u8> = (0..=255).collect();
        assert_eq!(from_hex(&to_hex(&bytes)), Some(bytes));
        for wrong in ["0", "0g", "+f", "-1", " 1", "\u{e9}"] {
            assert_eq!(from_hex(wrong), None, "{wrong}");
        }
    }
}
