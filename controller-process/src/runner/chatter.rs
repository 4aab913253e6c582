//! The runner against a plant that never falls silent: only a hold extends a wait.

use std::sync::mpsc;
use std::time::Duration;

use hil_session::supervision::Supervision;
use hil_session::waiter::Waiter;
use shared_types::link::in_process::{InProcessLink, pair};
use shared_types::wait::WaitLimit;

use super::tests::{greeted, job, kind};
use super::*;

/// Much longer than any limit here, to allow for a busy machine.
const WATCHDOG: Duration = Duration::from_secs(20);
const WAIT_LIMIT_S: f64 = 0.1;

/// A controller's end of a link whose other end repeats one message whenever it has nothing else to send.
struct Echo {
    inner: InProcessLink,
    message: Option<Vec<u8>>,
    frame: Option<Header>,
    /// Repetitions left, so that a hold, which restarts the wait, ends eventually.
    left: u64,
}

impl Echo {
    fn of(inner: InProcessLink) -> Self {
        Self {
            inner,
            message: None,
            frame: None,
            left: u64::MAX,
        }
    }

    fn again(&mut self) -> bool {
        let goes_on = self.left > 0;
        self.left -= u64::from(goes_on);
        goes_on
    }
}

impl Link for Echo {
    shared_types::pass_on!(self => self.inner; send_control tell expect peer open_frames take_over send rejected);

    fn receive_control(&mut self) -> Result<Option<Vec<u8>>, LinkError> {
        Ok(match self.inner.receive_control()? {
            None if self.message.is_some() && self.again() => self.message.clone(),
            came => came,
        })
    }

    fn receive(&mut self, values: &mut [f64]) -> Result<Option<Header>, LinkError> {
        Ok(match self.inner.receive(values)? {
            None if self.frame.is_some() && self.again() => self.frame,
            came => came,
        })
    }
}

/// Drives a runner to its end, or stops it if it does not end; returns the reason.
fn ends(runner: &mut Runner<&LawKind, Echo>) -> String {
    let supervision = Supervision::new();
    let (over, is_over) = mpsc::channel::<()>();
    let watched = supervision.clone();
    let watchdog = std::thread::spawn(move || {
        if is_over.recv_timeout(WATCHDOG) == Err(mpsc::RecvTimeoutError::Timeout) {
            watched.stop("the controller does not end");
        }
    });
    let waiter = Waiter::new(WaitLimit::from_seconds(WAIT_LIMIT_S));
    crate::program::drive(runner, waiter, &supervision).expect("drives");
    drop(over);
    watchdog.join().expect("ends");
    match runner.end() {
        Some(End::Aborted(abort)) => abort.to_string(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn messages_other_than_welcome_do_not_extend_the_limit_of_hello() {
    let ready = Control::Ready { epoch: 1 }.to_bytes();
    for message in [ready, b"good morning".to_vec()] {
        let (_plant, inner) = pair();
        let kind = kind();
        let mut runner = Runner::new(&kind, job(1, 0), Echo::of(inner)).expect("starts");
        runner.link.message = Some(message);
        let late = "plant did not answer hello within 0.1 s";
        assert_eq!(ends(&mut runner), late);
    }
}

#[test]
fn messages_do_not_extend_the_limit_of_the_first_sample() {
    let kind = kind();
    let (_plant, mut runner) = greeted(&kind, job(1, 0), Echo::of);
    runner.link.message = Some(b"good morning".to_vec());
    let late = "plant did not send step 0 within 0.1 s";
    assert_eq!(ends(&mut runner), late);
}

#[test]
fn an_endlessly_repeated_old_sample_does_not_extend_the_limit() {
    let kind = kind();
    let (mut plant, mut runner) = greeted(&kind, job(1, 0), Echo::of);
    let sample = Header::new(FrameKind::Sample, Step(0));
    plant.send(&sample, &[0.0; 2]).expect("sends");
    assert_eq!(runner.poll().expect("polls"), Progress::Busy);
    runner.link.frame = Some(sample);
    let late = "plant did not send step 1 within 0.1 s";
    assert_eq!(ends(&mut runner), late);
}

#[test]
fn a_hold_extends_the_limit_for_as_long_as_it_is_repeated() {
    let kind = kind();
    let (_plant, mut runner) = greeted(&kind, job(1, 0), Echo::of);
    runner.link.frame = Some(Header::new(FrameKind::Hold, Step(0)));
    // A poll that receives a hold is no pause: these take no time.
    let since_ns = monotonic_ns();
    let mut holds = 0_u64;
    while monotonic_ns() - since_ns < 300_000_000 {
        assert_eq!(runner.poll().expect("polls"), Progress::Held);
        holds += 1;
    }
    // Three limits of holds, then silence.
    runner.link.left = 3 * holds;
    let since_ns = monotonic_ns();
    let late = "plant did not send step 0 within 0.1 s";
    assert_eq!(ends(&mut runner), late);
    assert_eq!(runner.link.left, 0);
    assert!(monotonic_ns() - since_ns >= 100_000_000);
}
