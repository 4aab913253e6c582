//! State of the requirements of a running session, for observers.
//!
//! The `hil` that runs a session listens on a socket of its own. Asked, it has the recorder, which
//! judges every record from step 0 on, say what came of each requirement so far: one who joined late
//! could not know. The loop is not asked; the recorder looks at one atomic at each waking.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use hil_config::evaluation::Evaluation;
use serde::{Deserialize, Serialize};
use shared_types::live::{self, Listening, LiveError, Refusal};
use shared_types::session::SessionInfo;

use crate::terminal::exit::Failure;

/// Name of the socket in the session's folder.
const SOCKET: &str = "standing";
/// Limit for the recorder's answer.
const ANSWER_LIMIT: Duration = Duration::from_secs(1);
/// Limit of the asking side's wait.
const ASK_LIMIT: Duration = Duration::from_secs(2);

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
pub(crate) fn of(evaluation: &Evaluation) -> Vec<Standing> {
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

/// Queue of questions to the recorder.
#[derive(Debug, Default)]
pub struct Board {
    is_asked: AtomicBool,
    askers: Mutex<Vec<Sender<Vec<Standing>>>>,
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
struct Request {}

/// Answer; `None` if the recorder is busy or has ended.
#[derive(Debug, Serialize, Deserialize)]
struct Response {
    standings: Option<Vec<Standing>>,
}

/// Answers whoever asks, as long as what it returns is kept.
///
/// # Errors
/// If the socket cannot be made.
pub(crate) fn listen(session: &SessionInfo, board: Arc<Board>) -> Result<Listening, Failure> {
    let listening = live::listen(session, SOCKET, move |client| {
        // A client that went away needs no answer.
        let _ = live::answer(client, |request: Result<Request, Refusal>| Response {
            standings: request.ok().and_then(|_| board.ask()),
        });
    });
    listening.map_err(Failure::infrastructure)
}

/// Asks a session; `None` if its recorder had no answer.
///
/// # Errors
/// If nobody listens, as in a session that is starting, or `hil` is stopped.
pub(crate) fn ask(session: &SessionInfo) -> Result<Option<Vec<Standing>>, LiveError> {
    let response: Response = live::ask_at(session, SOCKET, &Request {}, ASK_LIMIT)?;
    Ok(response.standings)
}

#[cfg(test)]
mod tests {
    use super::*;

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
