//! Signals to a guard: held back from its start, so that none is lost and none comes at the wrong moment, and read one
//! after another. Those that it was started to ignore stay ignored, for it and for its child, but for SIGINT and SIGTERM.
//!
//! The signal to stop is looked at and left to the kernel, which forgets it as soon as a continuation follows: so a guard
//! stops exactly if no continuation came since.

use std::io;
use std::os::fd::AsFd;
use std::sync::Arc;

use hil_console::terminal::ignored::is_ignored;
use nix::sys::signal::{SigSet, Signal, raise};
use nix::sys::signalfd::{SfdFlags, SignalFd};
use rustix::event::{PollFd, PollFlags, poll};

/// Signals of job control and of the child.
const OTHERS: [Signal; 2] = [Signal::SIGCHLD, Signal::SIGCONT];
/// Signals that end a process which does nothing about them. Not those that the process causes itself by a fault.
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

/// Ends the holding back in the child, which inherits it; those that came meanwhile come now.
pub(super) fn release() {
    let all: SigSet = (ENDS.into_iter().chain(OTHERS))
        .chain([Signal::SIGTSTP])
        .collect();
    let _ = all.thread_unblock(); // all are signals
}

/// The signals to this process, of which one thread does the work and any other blocks all signals.
pub(super) struct Signals {
    /// Those that are read.
    received: SignalFd,
    /// Those to stop, which stay where they are.
    stop: SignalFd,
    /// Set of the signals to stop.
    stops: SigSet,
}

impl Signals {
    /// Holds signals back from now on.
    ///
    /// # Errors
    /// If the kernel does not allow it.
    pub(super) fn hold() -> io::Result<Self> {
        // Where it is ignored, nobody can know how a child ended. Held back, it is never handled.
        signal_hook::flag::register(Signal::SIGCHLD as i32, Arc::default())?;
        let mut received = SigSet::from_iter(OTHERS);
        // A shell without job control lets what it starts in the background ignore SIGINT, by which a script ends a run.
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

    /// Waits for the next signal. One to stop comes again and again until it is [obeyed](Self::stop).
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

    /// Stops this process, unless it was continued since it was to stop, and returns once it goes on.
    ///
    /// # Errors
    /// If the kernel does not allow it.
    pub(super) fn stop(&self) -> io::Result<()> {
        // It stops within the first call.
        self.stops.thread_unblock()?;
        Ok(self.stops.thread_block()?)
    }

    /// Ends this process by a signal that was held back.
    pub(super) fn end_by(&self, signal: Signal) {
        let _ = raise(signal).and_then(|()| SigSet::from(signal).thread_unblock());
    }
}
