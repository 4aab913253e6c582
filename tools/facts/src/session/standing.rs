//! State of a running session's requirements, and its account of events, for observers.
//!
//! The `hil` that runs a session listens on a socket of its own. On request, the recorder, which judges every record
//! from step 0 on, reports the state of each requirement together with the [account](super::happening) of events,
//! neither of which an observer that joined late could know. The loop is not involved; the recorder checks one atomic
//! at each wake-up.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use hil_config::evaluation::Evaluation;
use hil_console::terminal::exit::Failure;
use hil_session::live::{self, Listening, LiveError};
use hil_session::session::SessionInfo;
use serde::{Deserialize, Serialize};
use shared_types::live::Refusal;

use super::happening::Happening;
use crate::results::requirements::VACUOUS;

/// Name of the socket in the session's folder.
const SOCKET: &str = "standing";
/// Time limit for the recorder's answer.
const ANSWER_LIMIT: Duration = Duration::from_secs(1);
/// Time limit of a client's wait.
const ASK_LIMIT: Duration = Duration::from_secs(2);
/// Maximum number of events in an answer.
const MOST_EVENTS: usize = 2000;

/// State of a requirement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Standing {
    /// Name.
    pub name: String,
    /// `pass`, `fail` or `undecided`.
    pub verdict: String,
    /// Margin in `unit`, once all inputs of the formula are known.
    pub robustness: Option<f64>,
    /// Lower bound of the margin.
    pub at_least: Option<f64>,
    /// Upper bound of the margin; for an `always`, the smallest margin so far.
    pub at_most: Option<f64>,
    /// Unit of the margin.
    pub unit: String,
    /// Simulated time in s at which the verdict became certain.
    pub decided_at_s: Option<f64>,
    /// Premise that never called for its conclusion, once it is certain that the pass shows nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vacuous: Option<String>,
}

impl Standing {
    /// Returns the verdict, or `vacuous` for a pass that shows nothing.
    #[must_use]
    pub fn outcome(&self) -> &str {
        match self.vacuous {
            Some(_) => VACUOUS,
            None => &self.verdict,
        }
    }
}

/// Returns the state of every requirement of a run, in the scenario's order.
#[must_use]
pub fn of(evaluation: &Evaluation) -> Vec<Standing> {
    let finite = |size: f64| size.is_finite().then_some(size);
    let values = evaluation.requirements().into_iter();
    (values.zip(evaluation.bounds()))
        .map(|(value, [at_least, at_most])| Standing {
            name: value.name,
            verdict: value.verdict.name().into(),
            robustness: value.robustness.and_then(finite),
            at_least: finite(at_least),
            at_most: finite(at_most),
            unit: value.unit,
            decided_at_s: value.decided_at_s,
            vacuous: value.vacuous,
        })
        .collect()
}

/// Queue of queries to the recorder, and its account.
#[derive(Debug, Default)]
pub struct Board {
    is_asked: AtomicBool,
    askers: Mutex<Vec<Sender<Vec<Standing>>>>,
    account: Mutex<Vec<Happening>>,
}

impl Board {
    /// Answers pending queries; called by the recorder between records.
    pub fn answer(&self, standings: impl FnOnce() -> Vec<Standing>) {
        if !self.is_asked.swap(false, Ordering::AcqRel) {
            return;
        }
        let standings = standings();
        let mut askers = self.askers.lock().unwrap_or_else(PoisonError::into_inner);
        for asker in askers.drain(..) {
            let _ = asker.send(standings.clone()); // the client may have given up
        }
    }

    /// Records an event; called by the recorder, in the order of the events.
    pub fn note(&self, happening: Happening) {
        let account = self.account.lock();
        (account.unwrap_or_else(PoisonError::into_inner)).push(happening);
    }

    /// Returns the account after its first `after` events, or its next part.
    fn account(&self, after: usize) -> Vec<Happening> {
        let account = self.account.lock().unwrap_or_else(PoisonError::into_inner);
        let rest = account.get(after..).unwrap_or_default();
        rest[..rest.len().min(MOST_EVENTS)].to_vec()
    }

    fn ask(&self) -> Option<Vec<Standing>> {
        let (answer, receiver) = channel();
        (self.askers.lock())
            .unwrap_or_else(PoisonError::into_inner)
            .push(answer);
        self.is_asked.store(true, Ordering::Release);
        receiver.recv_timeout(ANSWER_LIMIT).ok()
    }
}

/// Query.
#[derive(Debug, Serialize, Deserialize)]
struct Request {
    /// Number of events of the account that the client already has.
    #[serde(default)]
    after: usize,
}

/// Answer to a query.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Answer {
    /// State of each requirement; `None` if the recorder is busy or has ended.
    pub standings: Option<Vec<Standing>>,
    /// Account after the events that the client already has.
    #[serde(default)]
    pub account: Vec<Happening>,
}

/// Answers queries until the returned value is dropped.
///
/// # Errors
/// If the socket cannot be created.
pub fn listen(session: &SessionInfo, board: Arc<Board>) -> Result<Listening, Failure> {
    let listening = live::listen(session, SOCKET, move |client| {
        // A client that disconnected needs no answer.
        let _ = live::answer(client, |request: Result<Request, Refusal>| match request {
            Ok(Request { after }) => Answer {
                standings: board.ask(),
                account: board.account(after),
            },
            Err(_) => Answer::default(),
        });
    });
    listening.map_err(Failure::infrastructure)
}

/// Queries the state of a session's requirements, with the account after the first `after` events.
///
/// # Errors
/// If nobody is listening, for example while the session is starting, or if `hil` is stopped.
pub fn ask(session: &SessionInfo, after: usize) -> Result<Answer, LiveError> {
    live::ask_at(session, SOCKET, &Request { after }, ASK_LIMIT)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_account_is_sent_in_parts_after_the_known_events() {
        let board = Board::default();
        let event = |step| Happening {
            step,
            text: format!("mark at step {step}"),
            label: None,
            key: None,
        };
        let all: Vec<Happening> = (0..MOST_EVENTS as u64 + 3).map(event).collect();
        all.iter().cloned().for_each(|one| board.note(one));
        assert_eq!(board.account(0), all[..MOST_EVENTS]);
        assert_eq!(board.account(MOST_EVENTS), all[MOST_EVENTS..]);
        assert_eq!(board.account(all.len()), []);
        assert_eq!(board.account(all.len() + 1), [], "of another run");
    }

    #[test]
    fn every_client_is_answered_and_idle_wakeups_cost_nothing() {
        let board = Arc::new(Board::default());
        board.answer(|| panic!("nobody asked"));
        let askers: Vec<_> = (0..3)
            .map(|_| {
                let board = Arc::clone(&board);
                std::thread::spawn(move || board.ask())
            })
            .collect();
        let standing = Standing {
            name: "quick".into(),
            verdict: "undecided".into(),
            robustness: None,
            at_least: None,
            at_most: Some(0.5),
            unit: "m".into(),
            decided_at_s: None,
            vacuous: None,
        };
        while askers.iter().any(|asker| !asker.is_finished()) {
            board.answer(|| vec![standing.clone()]);
            std::thread::sleep(Duration::from_millis(1));
        }
        for asker in askers {
            let answer = asker.join().expect("no panic");
            assert_eq!(answer, Some(vec![standing.clone()]));
        }
    }
}
