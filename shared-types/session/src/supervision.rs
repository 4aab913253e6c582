//! Messages from `hil` to a process of a session that it started: stop, the peer is gone, another controller follows,
//! another job is ready, or no more messages.
//!
//! Messages arrive as lines on standard input, or through the lifeline of a side that was [started
//! manually](crate::manual_start). The end of the input means that `hil` is gone and nobody will clean up, so the
//! process ends too: in order if it can, otherwise by SIGKILL. Any program that speaks the protocol may ignore the
//! lines, but should end with its input.

use std::io::{BufRead, BufReader};
use std::os::fd::AsFd;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, OnceLock, PoisonError};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;
use rustix::process::{Signal, getpid, kill_process};

use crate::link::bell::Bell;

/// Line that requests the end of the run.
pub const STOP: &str = "stop";
/// Line that reports the end of the peer's process, followed by the controller's epoch if sent to a plant.
pub const PEER_GONE: &str = "peer-gone";
/// Line that announces another controller to a plant, followed by its epoch.
pub const EXPECT: &str = "expect";
/// Line that announces the next job, in the session's folder, to a persistent process.
pub const NEXT: &str = "next";

/// Grace period in which a process without its `hil` may end in order. Longer than a bridge waits for its target.
const GRACE: Duration = Duration::from_secs(4);

/// Ends this process by SIGKILL after a grace period: an orderly end can be blocked for ever by a thread that waits for
/// another thread, by exit handlers, or by a panic that holds a lock.
fn end_after_grace() {
    std::thread::sleep(GRACE);
    let _ = kill_process(getpid(), Signal::KILL); // cannot fail for its own process
}

/// Ends this process once the other end of a pipe or socket closes, whatever its other threads are waiting for and even
/// if unread data remains; the process has a grace period for an orderly end.
pub fn end_with(channel: impl AsFd + Send + 'static) {
    std::thread::spawn(move || {
        let mut closes = [PollFd::new(&channel, PollFlags::RDHUP)];
        while poll(&mut closes, None) == Err(Errno::INTR) {}
        end_after_grace();
    });
}

/// Maximum number of controllers in one run.
pub const MOST_EPOCHS: u32 = 63;

/// Set of the controllers that are gone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gone(u64);

impl Gone {
    /// Returns `true` if any controller is gone.
    #[must_use]
    #[inline]
    pub const fn any(self) -> bool {
        self.0 != 0
    }

    /// Returns `true` if the controller of this epoch is gone.
    #[must_use]
    #[inline]
    pub const fn is(self, epoch: u32) -> bool {
        self.0 & bit(epoch) != 0
    }

    /// Returns `true` if the other side is gone, whatever its epoch.
    #[must_use]
    #[inline]
    pub const fn is_everybody(self) -> bool {
        self.0 & bit(0) != 0
    }
}

#[inline]
const fn bit(epoch: u32) -> u64 {
    if epoch > MOST_EPOCHS { 0 } else { 1 << epoch }
}

/// External requests, polled by the loop at the cost of one load each.
#[derive(Clone, Debug, Default)]
pub struct Supervision(Arc<State>);

#[derive(Debug, Default)]
struct State {
    stop: AtomicBool,
    /// Bits of the epochs whose controller is gone; the first bit stands for the other side in any epoch.
    gone: AtomicU64,
    /// Latest epoch whose controller was announced; 0 for none.
    expected: AtomicU32,
    why: OnceLock<String>,
    /// Announced jobs that have not begun.
    jobs: Mutex<u64>,
    /// Wakes a process that waits for a job or the end.
    news: Condvar,
    /// Bell on which the loop sleeps.
    bell: OnceLock<Bell>,
}

impl Supervision {
    /// Creates a supervision without requests.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Listens to standard input on its own thread, for the rest of the process.
    #[must_use]
    pub fn from_stdin() -> Self {
        Self::from_words(BufReader::new(std::io::stdin()))
    }

    /// Listens to lines on its own thread. The end of the lines ends the process, by SIGKILL after a grace period.
    #[must_use]
    pub fn from_words(words: impl BufRead + Send + 'static) -> Self {
        let supervision = Self::new();
        let listener = supervision.clone();
        std::thread::spawn(move || {
            for line in words.lines() {
                match line {
                    Ok(line) => listener.hear(&line),
                    Err(_) => break,
                }
            }
            listener.stop("hil is gone");
            end_after_grace();
        });
        supervision
    }

    fn hear(&self, line: &str) {
        let mut words = line.split_ascii_whitespace();
        let word = words.next();
        let epoch = words.next().map(str::parse);
        match (word, epoch) {
            (Some(STOP), None) => self.stop("asked to stop"),
            (Some(NEXT), None) => self.announce_job(),
            (Some(PEER_GONE), None) => self.peer_gone(0),
            (Some(PEER_GONE), Some(Ok(epoch))) => self.peer_gone(epoch),
            (Some(EXPECT), Some(Ok(epoch))) => self.expect(epoch),
            _ => {}
        }
    }

    /// Requests the end of the run.
    pub fn stop(&self, why: &str) {
        let _ = self.0.why.set(why.into()); // the first reason stands
        self.0.stop.store(true, Ordering::Release);
        self.ring();
        drop(self.jobs()); // who is about to wait has looked before, or sees it
        self.0.news.notify_all();
    }

    /// Announces another job.
    pub fn announce_job(&self) {
        *self.jobs() += 1;
        self.0.news.notify_all();
    }

    /// Waits for another job; returns `false` if the process should end instead. The wait is limited only by the end of
    /// `hil`.
    #[must_use]
    pub fn next_job(&self) -> bool {
        let is_idle = |jobs: &mut u64| *jobs == 0 && !self.wants_stop();
        let jobs = self.0.news.wait_while(self.jobs(), is_idle);
        let mut jobs = jobs.unwrap_or_else(PoisonError::into_inner);
        if self.wants_stop() {
            return false;
        }
        *jobs -= 1;
        true
    }

    fn jobs(&self) -> std::sync::MutexGuard<'_, u64> {
        self.0.jobs.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Records that the other side is gone: the controller of this epoch or, for 0, the other side in any epoch.
    pub fn peer_gone(&self, epoch: u32) {
        self.0.gone.fetch_or(bit(epoch), Ordering::Release);
        self.ring();
    }

    /// Announces the controller of this epoch.
    pub fn expect(&self, epoch: u32) {
        self.0.expected.fetch_max(epoch, Ordering::Release);
        self.ring();
    }

    /// Rings this bell from now on at each new request.
    pub fn ring_at_news(&self, bell: Bell) {
        let _ = self.0.bell.set(bell); // a loop sleeps on one bell all the time
    }

    fn ring(&self) {
        if let Some(bell) = self.0.bell.get() {
            bell.ring();
        }
    }

    /// Returns `true` if the run should end.
    #[must_use]
    #[inline]
    pub fn wants_stop(&self) -> bool {
        self.0.stop.load(Ordering::Acquire)
    }

    /// Returns `true` if the other side is gone.
    #[must_use]
    #[inline]
    pub fn is_peer_gone(&self) -> bool {
        self.gone().any()
    }

    /// Returns the controllers that are gone.
    #[must_use]
    #[inline]
    pub fn gone(&self) -> Gone {
        Gone(self.0.gone.load(Ordering::Acquire))
    }

    /// Returns the latest epoch whose controller was announced; 0 for none.
    #[must_use]
    #[inline]
    pub fn expected(&self) -> u32 {
        self.0.expected.load(Ordering::Acquire)
    }

    /// Returns the reason to end the run.
    #[must_use]
    pub fn why(&self) -> Option<&str> {
        self.0.why.get().map(String::as_str)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::bell::Owner;
    use crate::session::Session;
    use shared_types::wait::Sleeper;

    #[test]
    fn the_first_reason_is_kept() {
        let supervision = Supervision::new();
        assert!(!supervision.wants_stop() && !supervision.is_peer_gone());
        supervision.stop("first");
        supervision.stop("second");
        assert!(supervision.wants_stop());
        assert_eq!(supervision.why(), Some("first"));
    }

    #[test]
    fn news_rings_the_bell_that_a_loop_sleeps_on() {
        let session = Session::create(None).expect("a session");
        let bell = Bell::create(session.info(), Owner::Plant).expect("creates");
        let supervision = Supervision::new();
        supervision.ring_at_news(bell.clone());
        for line in ["expect 2", "peer-gone 2", "stop"] {
            let rings = bell.announce();
            supervision.hear(line);
            assert_eq!(bell.announce(), rings + 1, "{line}");
        }
    }

    #[test]
    fn each_announced_job_starts_once_and_a_stop_ends_the_wait() {
        let supervision = Supervision::new();
        supervision.hear("next");
        supervision.hear("next");
        assert!(supervision.next_job() && supervision.next_job());
        let waits = supervision.clone();
        let (sender, ended) = std::sync::mpsc::channel();
        std::thread::spawn(move || sender.send(waits.next_job()));
        let limit = std::time::Duration::from_millis(50);
        assert!(
            ended.recv_timeout(limit).is_err(),
            "no third job was announced"
        );
        supervision.hear("stop");
        let limit = std::time::Duration::from_secs(60);
        assert_eq!(ended.recv_timeout(limit), Ok(false));
        supervision.hear("next");
        assert!(!supervision.next_job(), "after a stop no job begins");
    }

    #[test]
    fn valid_lines_take_effect_and_others_are_ignored() {
        let supervision = Supervision::new();
        for nonsense in ["", "expect", "expect x", "peer-gone -1", "stop now", "halt"] {
            supervision.hear(nonsense);
        }
        let state = |s: &Supervision| (s.wants_stop(), s.is_peer_gone(), s.expected());
        assert_eq!(state(&supervision), (false, false, 0));
        // A later one first: each is remembered.
        for line in ["expect 2", "peer-gone 2", "peer-gone 1", " stop "] {
            supervision.hear(line);
        }
        assert_eq!(state(&supervision), (true, true, 2));
        let gone_epochs = supervision.gone();
        assert!(
            gone_epochs.is(1) && gone_epochs.is(2) && !gone_epochs.is(3) && !gone_epochs.is(64)
        );
        assert!(!gone_epochs.is_everybody());
        supervision.hear("peer-gone");
        assert!(supervision.gone().is_everybody());
    }
}
