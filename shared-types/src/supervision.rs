//! What a process of a session hears from the `hil` that started it: stop, the other side is gone,
//! or nothing any more.
//!
//! Words arrive as lines on standard input; its end means that `hil` is gone and nobody will clean
//! up, so the process ends too. Any program that speaks the protocol may ignore the lines, but should
//! end with its input.

use std::io::BufRead;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

/// Line that asks a process to end the run.
pub const STOP: &str = "stop";
/// Line that tells a process that the other side's process ended.
pub const PEER_GONE: &str = "peer-gone";

/// Requests from outside, polled by the loop: one load each.
#[derive(Clone, Debug, Default)]
pub struct Supervision(Arc<State>);

#[derive(Debug, Default)]
struct State {
    stop: AtomicBool,
    peer_gone: AtomicBool,
    why: OnceLock<String>,
}

impl Supervision {
    /// Nobody asks for anything, until told.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Listens to standard input on a thread of its own, for the rest of the process.
    #[must_use]
    pub fn from_stdin() -> Self {
        let supervision = Self::new();
        let heard = supervision.clone();
        std::thread::spawn(move || {
            for line in std::io::stdin().lock().lines() {
                match line.as_deref().map(str::trim) {
                    Ok(STOP) => heard.stop("asked to stop"),
                    Ok(PEER_GONE) => heard.0.peer_gone.store(true, Ordering::Release),
                    Ok(_) => {}
                    Err(_) => break,
                }
            }
            heard.stop("hil is gone");
        });
        supervision
    }

    /// Asks for the end of the run.
    pub fn stop(&self, why: &str) {
        let _ = self.0.why.set(why.into()); // the first reason stands
        self.0.stop.store(true, Ordering::Release);
    }

    /// Tells that the other side is gone.
    pub fn peer_gone(&self) {
        self.0.peer_gone.store(true, Ordering::Release);
    }

    /// Whether the run is to end.
    #[must_use]
    pub fn wants_stop(&self) -> bool {
        self.0.stop.load(Ordering::Acquire)
    }

    /// Whether the other side is gone.
    #[must_use]
    pub fn is_peer_gone(&self) -> bool {
        self.0.peer_gone.load(Ordering::Acquire)
    }

    /// Why the run is to end.
    #[must_use]
    pub fn why(&self) -> Option<&str> {
        self.0.why.get().map(String::as_str)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_reason_stands() {
        let supervision = Supervision::new();
        assert!(!supervision.wants_stop() && !supervision.is_peer_gone());
        supervision.stop("first");
        supervision.stop("second");
        assert!(supervision.wants_stop());
        assert_eq!(supervision.why(), Some("first"));
    }
}
