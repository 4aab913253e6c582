//! State of the requirements of a running session, and the account of it, for observers.
//!
//! The `hil` that runs a session listens on a socket of its own. Asked, it has the recorder, which
//! judges every record from step 0 on, say what came of each requirement so far, and tells what
//! [happened](super::happening): one who joined late could not know. The loop is not asked; the recorder
//! looks at one atomic at each waking.

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

/// Name of the socket in the session's folder.
const SOCKET: &str = "standing";
/// Limit for the recorder's answer.
const ANSWER_LIMIT: Duration = Duration::from_secs(1);
/// Limit of the asking side's wait.
const ASK_LIMIT: Duration = Duration::from_secs(2);
/// Most events in an answer.
const MOST_EVENTS: usize = 2000;

/// State of a requirement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Standing {
    /// Name.
    pub name: String,
    /// `pass`, `fail` or `undecided`.
    pub verdict: String,
    /// The margin in `unit`, once everything that the formula looks at has come.
    pub robustness: Option<f64>,
    /// Lower bound of the margin.
    pub at_least: Option<f64>,
    /// Upper bound of the margin: of an `always`, the least margin so far.
    pub at_most: Option<f64>,
    /// Unit of the margin.
    pub unit: String,
    /// The simulated time in s that made the verdict certain.
    pub decided_at_s: Option<f64>,
}

/// Every requirement of a run, in the scenario's order.
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
        })
        .collect()
}

/// Queue of questions to the recorder, and its account.
#[derive(Debug, Default)]
pub struct Board {
    is_asked: AtomicBool,
    askers: Mutex<Vec<Sender<Vec<Standing>>>>,
    account: Mutex<Vec<Happening>>,
}

impl Board {
    /// Answers whoever asked; called by the recorder between records.
    pub fn answer(&self, standings: impl FnOnce() -> Vec<Standing>) {
        if !self.is_asked.swap(false, Ordering::AcqRel) {
            return;
        }
        let standings = standings();
        let mut askers = self.askers.lock().unwrap_or_else(PoisonError::into_inner);
        for asker in askers.drain(..) {
            let _ = asker.send(standings.clone()); // it may have given up
        }
    }

    /// Notes an event; called by the recorder, in the order of the events.
    pub fn note(&self, happening: Happening) {
        let account = self.account.lock();
        (account.unwrap_or_else(PoisonError::into_inner)).push(happening);
    }

    /// The account behind its first `after` events, or the next part of it.
    fn account(&self, after: usize) -> Vec<Happening> {
        let account = self.account.lock().unwrap_or_else(PoisonError::into_inner);
        let rest = account.get(after..).unwrap_or_default();
        rest[..rest.len().min(MOST_EVENTS)].to_vec()
    }

    fn ask(&self) -> Option<Vec<Standing>> {
        let (answer, answered) = channel();
        (self.askers.lock())
            .unwrap_or_else(PoisonError::into_inner)
            .push(answer);
        self.is_asked.store(true, Ordering::Release);
        answered.recv_timeout(ANSWER_LIMIT).ok()
    }
}

/// Question.
#[derive(Debug, Serialize, Deserialize)]
struct Request {
    /// Number of events of the account that are known.
    #[serde(default)]
    after: usize,
}

/// Answer.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Answer {
    /// State of each requirement; `None` if the recorder is busy or has ended.
    pub standings: Option<Vec<Standing>>,
    /// The account after the events that are known.
    #[serde(default)]
    pub account: Vec<Happening>,
}

/// Answers whoever asks, as long as what it returns is kept.
///
/// # Errors
/// If the socket cannot be made.
pub fn listen(session: &SessionInfo, board: Arc<Board>) -> Result<Listening, Failure> {
    let listening = live::listen(session, SOCKET, move |client| {
        // A client that went away needs no answer.
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

/// Asks a session for its standing, with the account behind the first `after` events.
///
/// # Errors
/// If nobody listens, as in a session that is starting, or `hil` is stopped.
pub fn ask(session: &SessionInfo, after: usize) -> Result<Answer, LiveError> {
    live::ask_at(session, SOCKET, &Request { after }, ASK_LIMIT)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_account_is_told_in_parts_from_what_is_known() {
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
    fn everybody_who_asked_is_answered_and_nobody_else_costs_anything() {
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
        };
        while askers.iter().any(|asker| !asker.is_finished()) {
            board.answer(|| vec![standing.clone()]);
            std::thread::sleep(Duration::from_millis(1));
        }
        for asker in askers {
            let heard = asker.join().expect("no panic");
            assert_eq!(heard, Some(vec![standing.clone()]));
        }
    }
}
