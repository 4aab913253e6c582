//! A running session as another terminal sees it: which one is meant, asking it, and its refusals.
//!
//! Used by every command and view that asks a running session. Talks to the plant's socket only; the loop
//! does not notice.

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

/// Limit for the plant's answer: longer than it waits for its own loop.
const ANSWER_LIMIT: Duration = Duration::from_secs(20);
/// Limit for a live session to start listening.
const START_LIMIT: Duration = Duration::from_secs(2);
/// Interval between two looks for its socket.
const LOOK: Duration = Duration::from_millis(10);

/// Reason for which a request could not be made or was not met.
#[derive(Debug)]
pub enum RequestError {
    /// The request was wrong, by a check here or by the plant's word. Nothing was changed.
    Refused(Vec<Refusal>),
    /// The machine or a process is in the way.
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
    /// Tells it; with `json`, refusals go to standard output too, for machines.
    #[must_use]
    pub fn tell(self, json: bool) -> Failure {
        let problems = match self {
            Self::Failed(failure) => return failure,
            Self::Refused(problems) => problems,
        };
        let text = refused_text(&problems);
        if json {
            let told =
                to_json(&Response::Refused { problems }).and_then(|json| output::write(&json));
            if let Err(failure) = told {
                return failure;
            }
        }
        Failure::Usage(text)
    }
}

/// Sends a request to a session and tells the answer, in the words of `describe`, which has none for an answer to
/// something else.
///
/// # Errors
/// If there is no session to ask, or it refuses the request or does not answer.
pub(crate) fn tell_answer(
    choice: &SessionChoice,
    request: &Request,
    describe: impl FnOnce(&Response) -> Option<String>,
) -> Result<Exit, Failure> {
    let answer = find(choice).and_then(|session| ask(&session, request));
    let answer = answer.and_then(|answer| match describe(&answer) {
        Some(told) => Ok((answer, told)),
        None => Err(unexpected(&answer)),
    });
    let (answer, told) = answer.map_err(|error| error.tell(choice.json))?;
    output::write(&if choice.json { to_json(&answer)? } else { told })?;
    Ok(Exit::Pass)
}

/// Refuses what was given for a key, and says what is expected.
pub(crate) fn refusal(key: &str, message: String, expected: String) -> Refusal {
    Refusal {
        key: key.into(),
        expected: Some(expected),
        ..Refusal::new(message)
    }
}

/// Lists the names that are closest to an unknown one.
pub(crate) fn closest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Vec<String> {
    nearest(name, known).into_iter().map(Into::into).collect()
}

/// Refusals as a person reads them.
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

/// An answer as a line of JSON.
///
/// # Errors
/// If it cannot be written as JSON.
pub fn to_json(answer: &impl serde::Serialize) -> Result<String, Failure> {
    let json = serde_json::to_string(answer).map_err(Failure::infrastructure)?;
    Ok(json + "\n")
}

/// The session that is meant.
///
/// # Errors
/// If there is none, or if it is not clear which.
pub fn find(choice: &SessionChoice) -> Result<SessionInfo, RequestError> {
    choose(
        session::list().map_err(Failure::infrastructure)?,
        choice.session.as_deref(),
    )
    .map_err(RequestError::from)
}

/// Chooses among the running sessions.
fn choose(mut running: Vec<SessionInfo>, wanted: Option<&str>) -> Result<SessionInfo, Refusal> {
    let names: Vec<String> = running.iter().map(|session| session.name.clone()).collect();
    let expected = if names.is_empty() {
        "a running session; start one with `hil run SCENARIO.toml`, held with --pause-at TIME"
            .into()
    } else {
        format!("--session with one of {}", listed(&names))
    };
    let place = match wanted {
        Some(wanted) => names.iter().position(|name| name == wanted),
        None => (names.len() == 1).then_some(0),
    };
    if let Some(place) = place {
        return Ok(running.swap_remove(place));
    }
    let message = match wanted {
        Some(wanted) => format!("no session `{wanted}` is running"),
        None if names.is_empty() => "no session is running".into(),
        None => {
            let told: Vec<String> = running.iter().map(describe).collect();
            format!("{} sessions are running: {}", names.len(), told.join("; "))
        }
    };
    let near = wanted.map(|wanted| closest(wanted, names.iter().map(String::as_str)));
    Err(Refusal {
        nearest: near.unwrap_or_default(),
        ..refusal("session", message, expected)
    })
}

/// A session among others: its name, its scenario, for how long it has run, and where to.
fn describe(session: &SessionInfo) -> String {
    let name = &session.name;
    let Some(notice) = Notice::read(session) else {
        return format!("`{name}`, which is starting");
    };
    let mut told = format!("`{name}`");
    if let Some(scenario) = notice.scenario_name() {
        told += &format!(" with {scenario}");
    }
    if let Some(age) = Notice::age(session) {
        let age = humantime::format_duration(Duration::from_secs(age.as_secs()));
        told += &format!(" for {age}");
    }
    if let Some(folder) = &session.run_dir {
        told += &format!(" in {}", folder.display());
    }
    told
}

/// Asks a session. One that is starting is given a moment.
///
/// # Errors
/// If it refused, has ended or does not answer.
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
    let expected = "a running session; one started with --pause-at TIME waits";
    refusal("session", message, expected.into())
}

/// An answer that does not belong to what was asked.
#[must_use]
pub fn unexpected(response: &Response) -> RequestError {
    let told = serde_json::to_string(response).unwrap_or_default();
    Failure::infrastructure(format!(
        "the plant gave an answer to something else: {told}"
    ))
    .into()
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
    fn a_session_is_chosen_by_name_or_by_being_the_only_one() {
        let running = |names: &[&str]| names.iter().map(|name| session(name)).collect::<Vec<_>>();
        for (names, wanted, chosen) in [
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
                    "no session is running; a running session; start one with `hil run SCENARIO.toml`, held with --pause-at TIME; ",
                ),
            ),
        ] {
            let found = choose(running(names), wanted)
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
                found.as_deref().map_err(String::as_str),
                chosen,
                "{names:?}"
            );
        }
    }

    #[test]
    fn a_refusal_says_what_is_wrong_and_what_is_possible() {
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
