//! Look-out for a run that somebody paused and left: the run's own terminal says where it is held and how it goes
//! on. The loop is asked only once nothing has happened for a while.

use std::time::{Duration, Instant, SystemTime};

use hil_console::terminal::progress::Progress;
use hil_session::live;
use hil_session::session::SessionInfo;
use shared_types::live::{Request, Response};

/// Time without a new record after which the plant is asked.
const QUIET: Duration = Duration::from_secs(1);
/// Limit of the plant's answer; it is asked again.
const ANSWER_LIMIT: Duration = Duration::from_millis(100);

/// Look-out over one run.
pub(super) struct PauseLookout {
    next_step: u64,
    /// Time of the newest record.
    since: SystemTime,
    asked: Instant,
    is_known: bool,
}

impl PauseLookout {
    pub(crate) fn new() -> Self {
        Self {
            next_step: 0,
            since: SystemTime::now(),
            asked: Instant::now(),
            is_known: false,
        }
    }

    /// Shows the steps that are done, and a pause that has lasted for a while.
    pub(crate) fn look(&mut self, next_step: u64, session: &SessionInfo, progress: &mut Progress) {
        progress.set(next_step);
        if next_step != self.next_step {
            *self = Self {
                next_step,
                ..Self::new()
            };
        } else if !self.is_known && self.asked.elapsed() > QUIET {
            // A plant that has not begun, or is busy, answers later.
            if let Ok(Response::Status(status)) = live::ask(session, &Request::Status, ANSWER_LIMIT)
            {
                self.is_known = status.paused;
                if status.paused {
                    progress.tell_pause(status.step, self.since, &session.name);
                }
            }
            self.asked = Instant::now();
        }
    }
}
