//! Asking the session, on a thread of its own: where the run is, its faults, how its requirements
//! stand, what happened, and what keys ask for.
//!
//! An answer may take as long as the plant's own wait limit, and a drawing must not wait for it. The
//! loop sees of this what it sees of `hil inject --active`, once a second.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use hil_facts::session::live::{RequestError, refused_text};
use hil_facts::session::{clock, inject, set, standing};
use hil_session::live;
use hil_session::session::SessionInfo;
use shared_types::live::{Request, Response};

use super::SharedModel;

/// Interval between two requests for the run's status, which cost the loop nothing.
const STATUS: Duration = Duration::from_millis(250);
/// Interval between two requests for the faults.
const FAULTS: Duration = Duration::from_secs(1);
/// Limit for the answer to a regular request.
const SHORT_LIMIT: Duration = Duration::from_secs(2);
/// Limit for the answer to a person: longer than the plant waits for its own loop.
pub(crate) const LIMIT: Duration = Duration::from_secs(20);

/// The thread as its owner sees it.
pub(crate) struct Asking {
    requests: Sender<Request>,
    answers: Receiver<String>,
}

impl Asking {
    /// Asks a session from now on, until it ends or this is dropped.
    #[must_use]
    pub(crate) fn start(session: SessionInfo, model: SharedModel) -> Self {
        let (requests, asked) = channel();
        let (answer, answers) = channel();
        // Not joined: it may be in the middle of a long question when nobody wants the answer any more.
        std::thread::spawn(move || Thread { session, model }.work(&asked, &answer));
        Self { requests, answers }
    }

    /// Asks for something.
    pub(crate) fn ask(&self, request: Request) {
        let _ = self.requests.send(request); // a session that ended is told of elsewhere
    }

    /// The newest answer to what was asked for, as a person reads it.
    #[must_use]
    pub(crate) fn answer(&self) -> Option<String> {
        self.answers.try_iter().last()
    }
}

struct Thread {
    session: SessionInfo,
    model: SharedModel,
}

impl Thread {
    fn work(&self, asked: &Receiver<Request>, answer: &Sender<String>) {
        let mut faults_at = Instant::now();
        loop {
            if Instant::now() >= faults_at {
                ask_faults(&self.session, &self.model, SHORT_LIMIT);
                self.ask_standings();
                faults_at = Instant::now() + FAULTS;
            } else {
                self.ask_status();
            }
            match asked.recv_timeout(STATUS) {
                Ok(request) => {
                    let told = met(&self.session, &self.model, &request);
                    if answer.send(told.unwrap_or_else(|told| told)).is_err() {
                        return;
                    }
                    faults_at = Instant::now();
                }
                Err(RecvTimeoutError::Timeout) if self.session.is_there() => {}
                Err(_) => return,
            }
        }
    }

    fn ask_status(&self) {
        let answer = live::ask(&self.session, &Request::Status, SHORT_LIMIT);
        if let Ok(Response::Status(status)) = answer {
            self.model.lock().hear_status(status);
        }
    }

    fn ask_standings(&self) {
        let known = self.model.lock().log().known();
        let answer = standing::ask(&self.session, known).unwrap_or_default();
        let mut model = self.model.lock();
        model.hear_standings(answer.standings);
        model.hear_account(known, answer.account);
    }
}

/// Asks for the faults of a session and lets its model hear them; without an answer nothing changes.
pub(crate) fn ask_faults(session: &SessionInfo, model: &SharedModel, limit: Duration) {
    let answer = live::ask(session, &Request::Active, limit);
    if let Ok(Response::Active { status, faults }) = answer {
        let mut model = model.lock();
        model.hear_status(status);
        model.hear_faults(faults);
    }
}

/// Asks what a person asks for, and tells the answer in one line.
///
/// # Errors
/// Reason for which it was not done.
pub(crate) fn met(
    session: &SessionInfo,
    model: &SharedModel,
    request: &Request,
) -> Result<String, String> {
    let told = match live::ask(session, request, LIMIT) {
        Ok(Response::Refused { problems }) => Err(refused_text(&problems)),
        Ok(Response::Status(status)) => {
            let told = clock::describe(&status);
            model.lock().hear_status(status);
            Ok(told)
        }
        Ok(Response::Changed(changed)) => Ok(set::describe(&changed)),
        Ok(Response::Marked { step, at_s }) => Ok(format!("marked step {step} ({at_s} s)")),
        Ok(response) => inject::describe(&response).map_err(|error| match error {
            RequestError::Failed(failure) => failure.to_string(),
            RequestError::Refused(problems) => refused_text(&problems),
        }),
        Err(error) => Err(format!("error: {error}")),
    };
    told.map(|told| in_one_line(&told))
        .map_err(|told| in_one_line(&told))
}

/// Puts lines behind each other.
pub(crate) fn in_one_line(told: &str) -> String {
    let lines: Vec<&str> = told.lines().map(str::trim).collect();
    lines.join("; ")
}
