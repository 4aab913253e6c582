//! Signals of a guard: blocked from its start, so that none is lost or arrives at the wrong moment, and read one at a
//! time. Signals that are ignored at the start remain ignored in the guard and its child, except SIGINT and SIGTERM.
//!
//! A stop signal is peeked and left to the kernel, which discards the signal as soon as a continuation follows: so a
//! guard stops if and only if no continuation has arrived since.

use std::io;
use std::os::fd::AsFd;
use std::sync::Arc;

use hil_console::terminal::ignored::is_ignored;
use nix::sys::signal::{SigSet, Signal, raise};
use nix::sys::signalfd::{SfdFlags, SignalFd};
use rustix::event::{PollFd, PollFlags, poll};

/// Signals for job control and about the child.
const OTHERS: [Signal; 2] = [Signal::SIGCHLD, Signal::SIGCONT];
/// Signals that terminate a process by default, except those caused by its own faults.
pub(super) const ENDS: [Signal; 12] = [
    Signal::SIGINT,
    Signal::SIGTERM,
    Signal::SIGHUP,
    Signal::SIGQUIT,
    Signal::SIGUSR1,
    Signal::SIGUSR2,
    Signal::SIGALRM,
    Signal::SIGVTALRM,
    Signal::SIGPROF,
    Signal::SIGIO,
    Signal::SIGPWR,
    Signal::SIGXCPU,
];

/// Unblocks the signals in the child, which inherits the mask; pending signals are delivered now.
pub(super) fn release() {
    let all: SigSet = (ENDS.into_iter().chain(OTHERS))
        .chain([Signal::SIGTSTP])
        .collect();
    let _ = all.thread_unblock(); // all are valid signals
}

/// Signals of this process. One thread reads them; all other threads must block all signals.
pub(super) struct Signals {
    /// Signals that are consumed.
    received: SignalFd,
    /// Stop signals, which stay pending.
    stop: SignalFd,
    /// Set of the stop signals.
    stops: SigSet,
}

impl Signals {
    /// Blocks the signals from now on.
    ///
    /// # Errors
    /// If the kernel does not allow it.
    pub(super) fn hold() -> io::Result<Self> {
        // An ignored SIGCHLD would discard the child's exit status. It is blocked and never handled.
        signal_hook::flag::register(Signal::SIGCHLD as i32, Arc::default())?;
        let mut received = SigSet::from_iter(OTHERS);
        // A shell without job control starts background processes with SIGINT ignored, but scripts end a run by it.
        let always = [Signal::SIGINT, Signal::SIGTERM];
        let is_wanted = |signal: &Signal| always.contains(signal) || !is_ignored(*signal as i32);
        received.extend(ENDS.into_iter().filter(is_wanted));
        let stops: SigSet = Some(Signal::SIGTSTP)
            .into_iter()
            .filter(is_wanted)
            .collect();
        for signals in [&received, &stops] {
            signals.thread_block()?;
        }
        let flags = SfdFlags::SFD_CLOEXEC | SfdFlags::SFD_NONBLOCK;
        Ok(Self {
            received: SignalFd::with_flags(&received, flags)?,
            stop: SignalFd::with_flags(&stops, flags)?,
            stops,
        })
    }

    /// Waits for the next signal. A stop signal is returned again until it is [obeyed](Self::stop).
    ///
    /// # Errors
    /// If signals cannot be read.
    pub(super) fn next(&self) -> io::Result<Signal> {
        loop {
            let signal = self.received.read_signal()?;
            let signal = signal.and_then(|signal| i32::try_from(signal.ssi_signo).ok());
            if let Some(signal) = signal.and_then(|signal| Signal::try_from(signal).ok()) {
                return Ok(signal);
            }
            let mut news = [self.received.as_fd(), self.stop.as_fd()]
                .map(|signals| PollFd::from_borrowed_fd(signals, PollFlags::IN));
            match poll(&mut news, None) {
                Ok(_) if news[0].revents().is_empty() => return Ok(Signal::SIGTSTP),
                Ok(_) | Err(rustix::io::Errno::INTR) => {}
                Err(error) => return Err(error.into()),
            }
        }
    }

    /// Stops this process, unless it was continued since the stop signal, and returns when it resumes.
    ///
    /// # Errors
    /// If the kernel does not allow it.
    pub(super) fn stop(&self) -> io::Result<()> {
        // It stops within the first call.
        self.stops.thread_unblock()?;
        Ok(self.stops.thread_block()?)
    }

    /// Ends this process by a blocked signal.
    pub(super) fn end_by(&self, signal: Signal) {
        let _ = raise(signal).and_then(|()| SigSet::from(signal).thread_unblock());
    }
}
