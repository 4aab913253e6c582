//! A running session as seen from another terminal: selection, requests and refusals.
//!
//! Used by every command and view that queries a running session. Uses only the plant's socket; the loop is not
//! affected.

use std::fmt::Write as _;
use std::time::{Duration, Instant};

use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use hil_session::live::{self, LiveError};
use hil_session::session::{self, SessionInfo};
use shared_types::live::{Refusal, Request, Response};
use shared_types::table::{listed, nearest};

use crate::arguments::SessionChoice;
use crate::session::observer::Notice;

/// Time limit for the plant's answer: longer than the plant's wait for its own loop.
const ANSWER_LIMIT: Duration = Duration::from_secs(20);
/// Time limit for a live session to start listening.
const START_LIMIT: Duration = Duration::from_secs(2);
/// Polling interval for the session's socket.
const LOOK: Duration = Duration::from_millis(10);

/// Error of a request.
#[derive(Debug)]
pub enum RequestError {
    /// The request was refused, by a check here or by the plant. Nothing was changed.
    Refused(Vec<Refusal>),
    /// The machine or a process failed.
    Failed(Failure),
}

impl From<Failure> for RequestError {
    fn from(failure: Failure) -> Self {
        Self::Failed(failure)
    }
}

impl From<Refusal> for RequestError {
    fn from(refusal: Refusal) -> Self {
        Self::Refused(vec![refusal])
    }
}

impl RequestError {
    /// Reports the error; with `json`, refusals are also written to standard output as JSON.
    #[must_use]
    pub fn tell(self, json: bool) -> Failure {
        let problems = match self {
            Self::Failed(failure) => return failure,
            Self::Refused(problems) => problems,
        };
        let text = refused_text(&problems);
        if json {
            let result =
                to_json(&Response::Refused { problems }).and_then(|json| output::write(&json));
            if let Err(failure) = result {
                return failure;
            }
        }
        Failure::Usage(text)
    }
}

/// Sends a request to a session and prints the answer as formatted by `describe`, which returns `None` for an
/// unexpected answer.
///
/// # Errors
/// If there is no session, or the session refuses the request or does not answer.
pub(crate) fn tell_answer(
    choice: &SessionChoice,
    request: &Request,
    describe: impl FnOnce(&Response) -> Option<String>,
) -> Result<Exit, Failure> {
    let answer = find(choice).and_then(|session| ask(&session, request));
    let answer = answer.and_then(|answer| match describe(&answer) {
        Some(text) => Ok((answer, text)),
        None => Err(unexpected(&answer)),
    });
    let (answer, text) = answer.map_err(|error| error.tell(choice.json))?;
    output::write(&if choice.json { to_json(&answer)? } else { text })?;
    Ok(Exit::Pass)
}

/// Creates the refusal of a key's value, with the expected values.
pub(crate) fn refusal(key: &str, message: String, expected: String) -> Refusal {
    Refusal {
        key: key.into(),
        expected: Some(expected),
        ..Refusal::new(message)
    }
}

/// Lists the names closest to an unknown one.
pub(crate) fn closest<'a>(name: &str, names: impl IntoIterator<Item = &'a str>) -> Vec<String> {
    nearest(name, names).into_iter().map(Into::into).collect()
}

/// Formats refusals for the user.
pub fn refused_text(problems: &[Refusal]) -> String {
    let mut text = String::new();
    for problem in problems {
        if !text.is_empty() {
            text.push('\n');
        }
        // Writing to a string cannot fail.
        let _ = write!(text, "error: {}", problem.message);
        if let Some(expected) = &problem.expected {
            let _ = write!(text, "\n  = expected: {expected}");
        }
        if !problem.nearest.is_empty() {
            let _ = write!(text, "\n  = nearest: {}", listed(&problem.nearest));
        }
    }
    text
}

/// Formats an answer as a line of JSON.
///
/// # Errors
/// If the answer cannot be serialised.
pub fn to_json(answer: &impl serde::Serialize) -> Result<String, Failure> {
    let json = serde_json::to_string(answer).map_err(Failure::infrastructure)?;
    Ok(json + "\n")
}

/// Finds the selected session.
///
/// # Errors
/// If there is none, or the selection is ambiguous.
pub fn find(choice: &SessionChoice) -> Result<SessionInfo, RequestError> {
    choose(
        session::list().map_err(Failure::infrastructure)?,
        choice.session.as_deref(),
    )
    .map_err(RequestError::from)
}

/// Selects one of the running sessions.
fn choose(mut running: Vec<SessionInfo>, requested: Option<&str>) -> Result<SessionInfo, Refusal> {
    let names: Vec<String> = running.iter().map(|session| session.name.clone()).collect();
    let expected = if names.is_empty() {
        "a running session; start one with `hil run SCENARIO.toml`, paused with --pause-at TIME"
            .into()
    } else {
        format!("--session with one of {}", listed(&names))
    };
    let place = match requested {
        Some(requested) => names.iter().position(|name| name == requested),
        None => (names.len() == 1).then_some(0),
    };
    if let Some(place) = place {
        return Ok(running.swap_remove(place));
    }
    let message = match requested {
        Some(requested) => format!("no session `{requested}` is running"),
        None if names.is_empty() => "no session is running".into(),
        None => {
            let descriptions: Vec<String> = running.iter().map(describe).collect();
            format!(
                "{} sessions are running: {}",
                names.len(),
                descriptions.join("; ")
            )
        }
    };
    let near = requested.map(|requested| closest(requested, names.iter().map(String::as_str)));
    Err(Refusal {
        nearest: near.unwrap_or_default(),
        ..refusal("session", message, expected)
    })
}

/// Describes a session in a list: its name, its scenario, its age, and its folder.
fn describe(session: &SessionInfo) -> String {
    let name = &session.name;
    let Some(notice) = Notice::read(session) else {
        return format!("`{name}`, which is starting");
    };
    let mut text = format!("`{name}`");
    if let Some(scenario) = notice.scenario_name() {
        text += &format!(" with {scenario}");
    }
    if let Some(age) = Notice::age(session) {
        let age = humantime::format_duration(Duration::from_secs(age.as_secs()));
        text += &format!(" for {age}");
    }
    if let Some(folder) = &session.run_dir {
        text += &format!(" in {}", folder.display());
    }
    text
}

/// Sends a request to a session. A session that is starting is given a moment.
///
/// # Errors
/// If the session refuses, has ended or does not answer.
pub fn ask(session: &SessionInfo, request: &Request) -> Result<Response, RequestError> {
    let since = Instant::now();
    loop {
        match live::ask(session, request, ANSWER_LIMIT) {
            Ok(Response::Refused { problems }) => return Err(RequestError::Refused(problems)),
            Ok(response) => return Ok(response),
            Err(error) => {
                if !is_running(session)? {
                    return Err(ended(session, &error).into());
                }
                let absent = matches!(error, LiveError::Absent(_));
                if !absent || since.elapsed() > START_LIMIT {
                    return Err(Failure::infrastructure(error).into());
                }
            }
        }
        std::thread::sleep(LOOK);
    }
}

fn is_running(session: &SessionInfo) -> Result<bool, Failure> {
    let running = session::list().map_err(Failure::infrastructure)?;
    Ok(running.iter().any(|running| running.id == session.id))
}

fn ended(session: &SessionInfo, error: &LiveError) -> Refusal {
    let name = &session.name;
    let message = match error {
        LiveError::Absent(_) => format!("session `{name}` has ended"),
        _ => format!("session `{name}` ended before it answered"),
    };
    let expected = "a running session; start one with --pause-at TIME to have it wait";
    refusal("session", message, expected.into())
}

/// Returns the error for an answer that does not belong to the request.
#[must_use]
pub fn unexpected(response: &Response) -> RequestError {
    let text = serde_json::to_string(response).unwrap_or_default();
    Failure::infrastructure(format!("unexpected answer from the plant: {text}")).into()
}

#[cfg(test)]
mod tests {
    use hil_session::process::ProcessId;

    use super::*;

    fn session(name: &str) -> SessionInfo {
        SessionInfo {
            schema: 1,
            name: name.into(),
            id: 1,
            folder: "/nowhere".into(),
            prefix: "hil_".into(),
            owner: ProcessId::own(),
            guard: None,
            children: Vec::new(),
            controller: None,
            run_dir: None,
        }
    }

    #[test]
    fn a_session_is_selected_by_name_or_because_it_is_the_only_one() {
        let running = |names: &[&str]| names.iter().map(|name| session(name)).collect::<Vec<_>>();
        for (names, requested, expected_choice) in [
            (&["a"][..], None, Ok("a")),
            (&["a", "b"], Some("b"), Ok("b")),
            (
                &["demo", "x"],
                None,
                Err(
                    "2 sessions are running: `demo`, which is starting; `x`, which is starting; --session with one of `demo`, `x`; ",
                ),
            ),
            (
                &["demo"],
                Some("dem"),
                Err("no session `dem` is running; --session with one of `demo`; demo"),
            ),
            (
                &[],
                None,
                Err(
                    "no session is running; a running session; start one with `hil run SCENARIO.toml`, paused with --pause-at TIME; ",
                ),
            ),
        ] {
            let result = choose(running(names), requested)
                .map(|session| session.name)
                .map_err(|refusal| {
                    let expected = refusal.expected.unwrap_or_default();
                    format!(
                        "{}; {expected}; {}",
                        refusal.message,
                        refusal.nearest.join(" ")
                    )
                });
            assert_eq!(
                result.as_deref().map_err(String::as_str),
                expected_choice,
                "{names:?}"
            );
        }
    }

    #[test]
    fn a_refusal_states_the_problem_and_the_alternatives() {
        let problems = [
            Refusal {
                key: "faults[0].kind".into(),
                message: "no fault `leek`".into(),
                expected: Some("a kind that --list shows".into()),
                nearest: vec!["leakage".into()],
            },
            Refusal::new("the time is past"),
        ];
        let expected = "\
error: no fault `leek`
  = expected: a kind that --list shows
  = nearest: `leakage`
error: the time is past";
        assert_eq!(refused_text(&problems), expected);
    }
}
