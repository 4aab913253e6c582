//! Handling of Ctrl-C and similar signals: a command without side effects ends immediately, others check a flag. Also
//! handles SIGBUS, after which nothing can continue.
//!
//! A command that starts processes or writes files first calls [`Interruption::listen`] and checks the flag where it
//! waits; parts that only compute, possibly for long, run inside [`Interruption::at_once`]. SIGHUP stays ignored if the
//! process was started with SIGHUP ignored, as by `nohup`; SIGINT does not, because scripts use it to end their
//! background jobs.

use std::io::{self, ErrorKind, PipeWriter, Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use hil_session::session;
use rustix::fs::{OFlags, fcntl_setfl};
use rustix::process::Signal;
use signal_hook::consts::{SIGBUS, SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
use signal_hook::low_level::{emulate_default_handler, pipe};

use crate::terminal::exit::{Exit, Failure};
use crate::terminal::ignored::is_ignored;
use crate::terminal::output;

/// Set while a signal ends the process immediately.
static AT_ONCE: LazyLock<Arc<AtomicBool>> = LazyLock::new(Arc::default);

/// Makes Ctrl-C end this process immediately, with the proper exit code, until a command listens.
///
/// # Errors
/// If the handler cannot be registered.
pub fn end_at_once() -> Result<(), Failure> {
    AT_ONCE.store(true, Ordering::SeqCst);
    end_on(SIGINT)
}

/// Ignores the signals that would end this process while it writes its result, because the summary and the exit code
/// must agree.
pub fn pass_over_ends() {
    const ENDS: [Signal; 9] = [
        Signal::QUIT,
        Signal::USR1,
        Signal::USR2,
        Signal::ALARM,
        Signal::VTALARM,
        Signal::PROF,
        Signal::IO,
        Signal::POWER,
        Signal::XCPU,
    ];
    for signal in ENDS {
        // One that cannot be passed over ends this process as before.
        let _ = signal_hook::flag::register(signal.as_raw(), Arc::default());
    }
}

fn end_on(signal: i32) -> Result<(), Failure> {
    let (status, condition) = (Exit::Interrupted as i32, Arc::clone(&AT_ONCE));
    signal_hook::flag::register_conditional_shutdown(signal, status, condition)
        .map_err(Failure::infrastructure)?;
    Ok(())
}

/// Flag that is set when the user wants the command to end.
#[derive(Clone, Debug, Default)]
pub struct Interruption(Arc<AtomicBool>);

impl Interruption {
    /// Starts listening to the signals. The handlers with their descriptors and thread are created once per process,
    /// and all listeners share one flag.
    ///
    /// # Errors
    /// If a handler cannot be registered.
    pub fn listen() -> Result<Self, Failure> {
        static OF_PROCESS: Mutex<Option<Interruption>> = Mutex::new(None);
        let mut of_process = OF_PROCESS.lock().unwrap_or_else(PoisonError::into_inner);
        let interruption = match &*of_process {
            Some(interruption) => interruption.clone(),
            None => of_process.insert(Self::register()?).clone(),
        };
        AT_ONCE.store(false, Ordering::SeqCst);
        Ok(interruption)
    }

    /// Registers the handlers, which stay for the lifetime of the process.
    fn register() -> Result<Self, Failure> {
        let flag = Arc::new(AtomicBool::new(false));
        let ends = [SIGINT, SIGTERM, SIGHUP].into_iter();
        for signal in ends.filter(|signal| *signal != SIGHUP || !is_ignored(SIGHUP)) {
            end_on(signal)?;
            signal_hook::flag::register(signal, Arc::clone(&flag))
                .map_err(Failure::infrastructure)?;
        }
        // A file at its size limit must give an error to its writer instead of ending the process.
        signal_hook::flag::register(SIGXFSZ, Arc::default()).map_err(Failure::infrastructure)?;
        end_without_shared_memory().map_err(Failure::infrastructure)?;
        Ok(Self(flag))
    }

    /// Sets the flag as a signal does, for callers that have handlers of their own.
    pub fn request(&self) {
        self.0.store(true, Ordering::Release);
    }

    /// Returns `true` if a signal has arrived.
    #[must_use]
    pub fn came(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }

    /// Returns an error if a signal has arrived.
    ///
    /// # Errors
    /// [`Failure::Interrupted`] after a signal.
    pub fn check(&self) -> Result<(), Failure> {
        match self.came() {
            true => Err(Failure::Interrupted),
            false => Ok(()),
        }
    }

    /// Performs work that checks no flag, waits for nothing and can be stopped anywhere: a signal ends the process
    /// immediately.
    ///
    /// # Errors
    /// If a signal arrived earlier.
    pub fn at_once<T>(&self, work: impl FnOnce() -> T) -> Result<T, Failure> {
        AT_ONCE.store(true, Ordering::SeqCst);
        // An earlier signal has set the flag; a later one ends the process.
        let done = (!self.came()).then(work);
        AT_ONCE.store(false, Ordering::SeqCst);
        done.ok_or(Failure::Interrupted)
    }
}

/// Ends the process in an orderly way when shared memory disappears (SIGBUS): prints a message, ends the child
/// processes and removes the sessions. A process with a guard leaves that to the guard, which holds none of its locks,
/// and dies of the signal, by which the guard recognises the cause.
fn end_without_shared_memory() -> io::Result<()> {
    let (mut receiver, sender) = UnixStream::pair()?;
    pipe::register(SIGBUS, sender)?;
    // The faulting thread would fault again immediately and die with the whole process, because the standard
    // library's handler has restored the default action by then. Writing to a full pipe blocks it.
    let (held_open, full) = io::pipe()?;
    let blocking = full.try_clone()?;
    pipe::register(SIGBUS, OwnedFd::from(full))?;
    fill(&blocking)?;
    fcntl_setfl(&blocking, OFlags::empty())?;
    std::thread::spawn(move || {
        if receiver.read_exact(&mut [0]).is_err() {
            return;
        }
        output::tell(
            "error: shared memory in use has become inaccessible (SIGBUS): a file of the session in /dev/shm was truncated, or /dev/shm is full. `hil recover` makes a complete recording of the written part",
        );
        if session::guard::own().is_some() {
            let _ = emulate_default_handler(SIGBUS); // it does not return
        }
        session::abandon();
        // Not dropped earlier: the pipe blocks only while it has a reader.
        let _held_open = held_open;
        std::process::exit(Exit::Infrastructure as i32);
    });
    Ok(())
}

/// Fills a non-blocking pipe.
fn fill(mut pipe: &PipeWriter) -> io::Result<()> {
    for size in [4096, 1] {
        loop {
            match pipe.write(&[0; 4096][..size]) {
                Ok(_) => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) => return Err(error),
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::fs::read_dir;

    use super::*;

    /// Counts descriptors of pipes and sockets, which handlers use.
    fn pipes_and_sockets() -> usize {
        let descriptors = read_dir("/proc/self/fd")
            .expect("own descriptors")
            .flatten();
        let targets =
            descriptors.filter_map(|descriptor| std::fs::read_link(descriptor.path()).ok());
        targets
            .filter(|target| {
                let target = target.to_string_lossy();
                target.starts_with("pipe:") || target.starts_with("socket:")
            })
            .count()
    }

    #[test]
    fn repeated_listening_uses_no_more_descriptors_and_threads() {
        const CALLS: usize = 300;
        let threads = || read_dir("/proc/self/task").expect("own threads").count();
        let first = Interruption::listen().expect("listens");
        let before = (pipes_and_sockets(), threads());
        for _ in 0..CALLS {
            let next = Interruption::listen().expect("listens");
            assert!(
                Arc::ptr_eq(&first.0, &next.0),
                "signals reach every listener"
            );
        }
        let after = (pipes_and_sockets(), threads());
        // Concurrent tests open and close some of their own.
        assert!(after.0 < before.0 + CALLS / 2, "{before:?}, {after:?}");
        assert!(after.1 < before.1 + CALLS / 2, "{before:?}, {after:?}");
    }
}
