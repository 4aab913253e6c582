//! Answers of programs on this machine, and the parts of an answer that are reported.

use std::ffi::OsStr;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;

use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_session::asking::{NoAnswer, ask};
use hil_session::program::CHECKED;
use hil_target::contact::Answer;
use serde_json::Value;
use shared_types::text;
use signal_hook::low_level::signal_name;

/// Prefix of the line with which a program of the framework reports its reason.
const REASON: &str = "error: ";

/// Returns the reason for a refusal by a program of the framework; other programs have no such line.
pub(super) fn refusal(stderr: &str) -> Option<&str> {
    let begins = |line: &str| line.starts_with(REASON);
    let before = stderr
        .split_inclusive('\n')
        .take_while(|line| !begins(line));
    let begin: usize = before.map(str::len).sum();
    Some(stderr[begin..].strip_prefix(REASON)?.trim())
}

/// Returns the reason why an answer has no description, if it has none.
pub(super) fn silence(answer: &Answer) -> Option<String> {
    let is_silent = answer.stdout.trim().is_empty();
    // A library of somebody else may write there too.
    let is_described = answer.stdout.trim_start().starts_with('{');
    match refusal(&answer.stderr) {
        Some(reason) if !answer.is_success || !is_described => Some(text::printable(reason).into()),
        None if answer.is_success && is_silent => {
            Some("the program does not speak the protocol: it ended without a description".into())
        }
        _ => None,
    }
}

/// Returns the reason why a job was refused; `None` if it was accepted. A host of foreign code must state that the
/// check was completed.
pub(super) fn objection(answer: &Answer, is_host: bool) -> Option<String> {
    let is_done = || answer.stdout.lines().any(|line| line == CHECKED);
    if answer.is_success {
        let why = refusal(&answer.stderr).map_or_else(String::new, |why| format!(": {why}"));
        return (is_host && !is_done())
            .then(|| format!("the process ended with exit code 0 during the check{why}"));
    }
    let reason = answer.stderr.trim().trim_start_matches("error: ");
    // A user's library may print its reason to either stream.
    let why = format!("{reason}\n{}", answer.stdout);
    Some(why.trim().to_owned())
}

/// Runs a program on this machine and returns its answer; the inner error is the program's own.
pub(super) fn asked<S: AsRef<OsStr>>(
    path: &Path,
    arguments: &[S],
    interruption: &Interruption,
) -> Result<Result<Answer, String>, Failure> {
    match ask(path, arguments, &|| interruption.came()) {
        Ok(answer) => {
            let stderr = String::from_utf8_lossy(&answer.stderr).into_owned();
            if let Some(signal) = answer.status.signal() {
                return Ok(Err(killed(signal, &stderr)));
            }
            Ok(Ok(Answer {
                is_success: answer.status.success(),
                stdout: String::from_utf8_lossy(&answer.stdout).into_owned(),
                stderr,
            }))
        }
        Err(NoAnswer::Interrupted) => Err(Failure::Interrupted),
        Err(NoAnswer::Failed(why)) => Ok(Err(why)),
    }
}

/// Describes the signal that killed a program, with its last message.
fn killed(signal: i32, stderr: &str) -> String {
    let name = signal_name(signal).unwrap_or("a signal");
    let last = stderr.lines().rfind(|line| !line.trim().is_empty());
    let words = last.map_or_else(String::new, |line| {
        let line = line.strip_prefix(REASON).unwrap_or(line);
        format!(": {}", text::printable(&text::line(line)))
    });
    format!("the process was killed by {name} ({signal}){words}")
}

/// Returns the first text of a description that contains terminal control characters.
pub(super) fn unprintable(described: &Value) -> Option<&str> {
    match described {
        Value::String(text) => (text::printable(text) != *text).then_some(text),
        Value::Array(all) => all.iter().find_map(unprintable),
        Value::Object(all) => (all.keys())
            .find(|name| text::printable(name) != **name)
            .map(String::as_str)
            .or_else(|| all.values().find_map(unprintable)),
        Value::Null | Value::Bool(_) | Value::Number(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn the_reason_of_a_program_is_the_text_after_its_prefix() {
        for (stderr, reason) in [
            (
                "error: `x_m` is defined twice\n",
                Some("`x_m` is defined twice"),
            ),
            ("a library speaks\nerror: no\nunit\n", Some("no\nunit")),
            ("who are you", None),
            ("an error: none", None),
            ("", None),
        ] {
            assert_eq!(refusal(stderr), reason, "{stderr}");
        }
    }

    #[test]
    fn death_by_a_signal_is_reported_with_the_last_message() {
        let words = "a library speaks\nerror: SIGSEGV in fmi2DoStep\n\n";
        assert_eq!(
            killed(11, words),
            "the process was killed by SIGSEGV (11): SIGSEGV in fmi2DoStep"
        );
        assert_eq!(killed(9, ""), "the process was killed by SIGKILL (9)");
    }

    #[test]
    fn a_description_with_control_characters_is_found_wherever_they_are() {
        let sound = json!({"plants": [{"name": "a", "truth": [{"unit": "m", "text": "a\nb"}]}]});
        assert_eq!(unprintable(&sound), None);
        let wrong = json!({"protocol": 4, "plants": [{"truth": [{"unit": "m\u{1b}[2J"}]}]});
        assert_eq!(unprintable(&wrong), Some("m\u{1b}[2J"));
    }
}
