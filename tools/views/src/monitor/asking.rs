//! Background thread that queries the session: status, faults, requirements and events, and that sends the requests
//! of keys.
//!
//! Answers may take as long as the plant's wait limit, and drawing must not wait for them. For the loop, these
//! queries cost the same as `hil inject --active` once a second.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use hil_facts::session::live::{RequestError, refused_text};
use hil_facts::session::{clock, inject, set, standing};
use hil_session::live;
use hil_session::session::SessionInfo;
use shared_types::live::{Request, Response};

use super::SharedModel;

/// Interval between status requests, which cost the loop nothing.
const STATUS: Duration = Duration::from_millis(250);
/// Interval between requests for the faults.
const FAULTS: Duration = Duration::from_secs(1);
/// Time limit for the answer to a periodic request.
const SHORT_LIMIT: Duration = Duration::from_secs(2);
/// Time limit for the answer to a user's request: longer than the plant waits for its own loop.
pub(crate) const LIMIT: Duration = Duration::from_secs(20);

/// Handle of the thread.
pub(crate) struct Asking {
    requests: Sender<Request>,
    answers: Receiver<String>,
}

impl Asking {
    /// Starts querying a session, until it ends or this handle is dropped.
    pub(crate) fn start(session: SessionInfo, model: SharedModel) -> Self {
        let (requests, receiver) = channel();
        let (answer, answers) = channel();
        // Not joined: it may still wait for an answer that is no longer needed.
        std::thread::spawn(move || Thread { session, model }.work(&receiver, &answer));
        Self { requests, answers }
    }

    /// Queues a request.
    pub(crate) fn ask(&self, request: Request) {
        let _ = self.requests.send(request); // the end of the session is reported elsewhere
    }

    /// Returns the newest answer to a queued request, formatted for the user.
    pub(crate) fn answer(&self) -> Option<String> {
        self.answers.try_iter().last()
    }
}

struct Thread {
    session: SessionInfo,
    model: SharedModel,
}

impl Thread {
    fn work(&self, requests: &Receiver<Request>, answer: &Sender<String>) {
        let mut faults_at = Instant::now();
        loop {
            if Instant::now() >= faults_at {
                ask_faults(&self.session, &self.model, SHORT_LIMIT);
                self.ask_standings();
                faults_at = Instant::now() + FAULTS;
            } else {
                self.ask_status();
            }
            match requests.recv_timeout(STATUS) {
                Ok(request) => {
                    let text = met(&self.session, &self.model, &request);
                    if answer.send(text.unwrap_or_else(|text| text)).is_err() {
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

/// Requests the faults of a session and passes them to its model; without an answer nothing changes.
pub(crate) fn ask_faults(session: &SessionInfo, model: &SharedModel, limit: Duration) {
    let answer = live::ask(session, &Request::Active, limit);
    if let Ok(Response::Active { status, faults }) = answer {
        let mut model = model.lock();
        model.hear_status(status);
        model.hear_faults(faults);
    }
}

/// Sends a user's request and formats the answer in one line.
///
/// # Errors
/// If the request was not carried out; the error states the reason.
pub(crate) fn met(
    session: &SessionInfo,
    model: &SharedModel,
    request: &Request,
) -> Result<String, String> {
    let text = match live::ask(session, request, LIMIT) {
        Ok(Response::Refused { problems }) => Err(refused_text(&problems)),
        Ok(Response::Status(status)) => {
            let text = clock::describe(&status);
            model.lock().hear_status(status);
            Ok(text)
        }
        Ok(Response::Changed(changed)) => Ok(set::describe(&changed)),
        Ok(Response::Marked { step, at_s }) => Ok(format!("marked step {step} ({at_s} s)")),
        Ok(response) => inject::describe(&response).map_err(|error| match error {
            RequestError::Failed(failure) => failure.to_string(),
            RequestError::Refused(problems) => refused_text(&problems),
        }),
        Err(error) => Err(format!("error: {error}")),
    };
    text.map(|text| in_one_line(&text))
        .map_err(|text| in_one_line(&text))
}

/// Joins lines into one.
pub(crate) fn in_one_line(text: &str) -> String {
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    lines.join("; ")
}
