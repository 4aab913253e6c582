//! Answers of programs on this machine, and what of an answer is passed on.

use std::ffi::OsStr;
use std::path::Path;

use hil_target::asking::{NoAnswer, ask};
use hil_target::contact::Answer;
use serde_json::Value;
use shared_types::text;

use crate::terminal::exit::Failure;
use crate::terminal::interruption::Interruption;

/// Begin of the line by which a program of the framework gives its reason.
const REASON: &str = "error: ";

/// The reason for which a program of the framework does not answer; others say nothing of the kind.
pub(super) fn refusal(stderr: &str) -> Option<&str> {
    let begins = |line: &str| line.starts_with(REASON);
    let before = stderr
        .split_inclusive('\n')
        .take_while(|line| !begins(line));
    let begin: usize = before.map(str::len).sum();
    Some(stderr[begin..].strip_prefix(REASON)?.trim())
}

/// Asks a program on this machine; the inner error is its own.
pub(super) fn asked<S: AsRef<OsStr>>(
    path: &Path,
    arguments: &[S],
    interruption: &Interruption,
) -> Result<Result<Answer, String>, Failure> {
    match ask(path, arguments, &|| interruption.came()) {
        Ok(answer) => Ok(Ok(Answer {
            is_success: answer.status.success(),
            stdout: String::from_utf8_lossy(&answer.stdout).into_owned(),
            stderr: String::from_utf8_lossy(&answer.stderr).into_owned(),
        })),
        Err(NoAnswer::Interrupted) => Err(Failure::Interrupted),
        Err(NoAnswer::Failed(why)) => Ok(Err(why)),
    }
}

/// The first text of a description that a terminal would do something at.
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
    fn the_reason_of_a_program_is_what_stands_behind_its_mark() {
        for (stderr, reason) in [
            (
                "error: `x_m` is there twice\n",
                Some("`x_m` is there twice"),
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
    fn a_description_with_control_characters_is_found_wherever_they_are() {
        let sound = json!({"plants": [{"name": "a", "truth": [{"unit": "m", "text": "a\nb"}]}]});
        assert_eq!(unprintable(&sound), None);
        let wrong = json!({"protocol": 4, "plants": [{"truth": [{"unit": "m\u{1b}[2J"}]}]});
        assert_eq!(unprintable(&wrong), Some("m\u{1b}[2J"));
    }
}
