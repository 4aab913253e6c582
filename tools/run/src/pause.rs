//! Detection of a paused run: the run's own terminal shows the step at which the run is paused and how to resume it.
//! The plant is queried only after a while without new records.

use std::time::{Duration, Instant, SystemTime};

use hil_console::terminal::progress::Progress;
use hil_session::live;
use hil_session::session::SessionInfo;
use shared_types::live::{Request, Response};

/// Time without a new record after which the plant is queried.
const QUIET: Duration = Duration::from_secs(1);
/// Time limit for the plant's answer; the query is repeated.
const ANSWER_LIMIT: Duration = Duration::from_millis(100);

/// Pause detection for one run.
pub(super) struct PauseLookout {
    next_step: u64,
    /// Time of the latest record.
    since: SystemTime,
    requested_at: Instant,
    is_known: bool,
}

impl PauseLookout {
    pub(crate) fn new() -> Self {
        Self {
            next_step: 0,
            since: SystemTime::now(),
            requested_at: Instant::now(),
            is_known: false,
        }
    }

    /// Shows the executed steps, and any pause that has lasted for a while.
    pub(crate) fn look(&mut self, next_step: u64, session: &SessionInfo, progress: &mut Progress) {
        progress.set(next_step);
        if next_step != self.next_step {
            *self = Self {
                next_step,
                ..Self::new()
            };
        } else if !self.is_known && self.requested_at.elapsed() > QUIET {
            // A plant that has not begun, or is busy, answers later.
            if let Ok(Response::Status(status)) = live::ask(session, &Request::Status, ANSWER_LIMIT)
            {
                self.is_known = status.paused;
                if status.paused {
                    progress.tell_pause(status.step, self.since, &session.name);
                }
            }
            self.requested_at = Instant::now();
        }
    }
}
