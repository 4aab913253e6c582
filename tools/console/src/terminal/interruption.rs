//! Ctrl-C and its like: the end of a command that leaves nothing behind, and else a flag to look at; and
//! the one signal after which nothing can go on.
//!
//! A command that has begun nothing ends at once. One that starts processes or writes files listens
//! before that and looks at the flag where it waits; the parts of it that only compute, which may take
//! long and look at nothing, are done with [`Interruption::at_once`]. SIGHUP stays ignored if the process was
//! started to ignore it, as by `nohup`; SIGINT does not, since a script ends its background job by it.

use std::io::{self, ErrorKind, PipeWriter, Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use rustix::fs::{OFlags, fcntl_setfl};
use rustix::process::Signal;
use shared_types::session;
use signal_hook::consts::{SIGBUS, SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
use signal_hook::low_level::{emulate_default_handler, pipe};

use crate::terminal::exit::{Exit, Failure};
use crate::terminal::ignored::is_ignored;
use crate::terminal::output;

/// A signal ends the process at once.
static AT_ONCE: LazyLock<Arc<AtomicBool>> = LazyLock::new(Arc::default);

/// Makes Ctrl-C the end of this process, with its exit code, until a command listens.
///
/// # Errors
/// If the signal cannot be listened to.
pub fn end_at_once() -> Result<(), Failure> {
    AT_ONCE.store(true, Ordering::SeqCst);
    end_on(SIGINT)
}

/// Passes over the signals that would end this process before it could give its result, which is being written: a
/// summary and the exit code are to say the same.
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

/// Wish of the user that the command ends.
#[derive(Clone, Debug, Default)]
pub struct Interruption(Arc<AtomicBool>);

impl Interruption {
    /// Listens to the signals from now on. They are those of the process: whoever listens shares one flag, and the
    /// handlers with their descriptors and their thread are made once.
    ///
    /// # Errors
    /// If they cannot be listened to.
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

    /// Registers the handlers of the process, which stay as long as it.
    fn register() -> Result<Self, Failure> {
        let flag = Arc::new(AtomicBool::new(false));
        let ends = [SIGINT, SIGTERM, SIGHUP].into_iter();
        for signal in ends.filter(|signal| *signal != SIGHUP || !is_ignored(SIGHUP)) {
            end_on(signal)?;
            signal_hook::flag::register(signal, Arc::clone(&flag))
                .map_err(Failure::infrastructure)?;
        }
        // A file that may grow no more is an error to whoever writes it, not the end of the process.
        signal_hook::flag::register(SIGXFSZ, Arc::default()).map_err(Failure::infrastructure)?;
        end_without_shared_memory().map_err(Failure::infrastructure)?;
        Ok(Self(flag))
    }

    /// Reports a signal that came.
    #[must_use]
    pub fn came(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }

    /// Ends a command that a signal came to.
    ///
    /// # Errors
    /// If one came.
    pub fn check(&self) -> Result<(), Failure> {
        match self.came() {
            true => Err(Failure::Interrupted),
            false => Ok(()),
        }
    }

    /// Does work that looks at no flag, waits for nobody and leaves nothing behind wherever it stops:
    /// a signal ends the process at once.
    ///
    /// # Errors
    /// If a signal came before.
    pub fn at_once<T>(&self, work: impl FnOnce() -> T) -> Result<T, Failure> {
        AT_ONCE.store(true, Ordering::SeqCst);
        // One that came until then has set the flag, any later one ends the process.
        let done = (!self.came()).then(work);
        AT_ONCE.store(false, Ordering::SeqCst);
        done.ok_or(Failure::Interrupted)
    }
}

/// Ends the process in order when memory that it shares is taken away under it: it says so, ends what it
/// started and removes its sessions. One with a guard leaves that to the guard, which holds none of its locks, and
/// dies of the signal, by which the guard knows the cause.
fn end_without_shared_memory() -> io::Result<()> {
    let (mut heard, told) = UnixStream::pair()?;
    pipe::register(SIGBUS, told)?;
    // The thread that met the hole would meet it again at once, and die of it with the process: the
    // standard library's own handler has put the default back by then. A full pipe holds it.
    let (held_open, full) = io::pipe()?;
    let blocking = full.try_clone()?;
    pipe::register(SIGBUS, OwnedFd::from(full))?;
    fill(&blocking)?;
    fcntl_setfl(&blocking, OFlags::empty())?;
    std::thread::spawn(move || {
        if heard.read_exact(&mut [0]).is_err() {
            return;
        }
        output::tell(
            "error: shared memory that is in use cannot be read or written any more (SIGBUS): a file of the session in /dev/shm was cut short, or /dev/shm is full. `hil recover` makes a whole recording of what was written",
        );
        if session::guard::own().is_some() {
            let _ = emulate_default_handler(SIGBUS); // it does not return
        }
        session::abandon();
        // Not before: without a reader the pipe holds nobody.
        let _held_open = held_open;
        std::process::exit(Exit::Infrastructure as i32);
    });
    Ok(())
}

/// Fills a pipe that does not block.
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

    /// Counts descriptors that lead to a pipe or a socket, as those of handlers do.
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
    fn listening_again_and_again_takes_no_more_descriptors_and_threads() {
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
        // Tests beside this one open and close some of their own.
        assert!(after.0 < before.0 + CALLS / 2, "{before:?}, {after:?}");
        assert!(after.1 < before.1 + CALLS / 2, "{before:?}, {after:?}");
    }
}
