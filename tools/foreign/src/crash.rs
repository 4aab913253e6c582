//! Reports the call of foreign code during which this process dies of a signal.
//!
//! Every call of an FMU or a C callback is marked by [`calling`], at the cost of two memory writes. If a fatal signal
//! arrives during a call, a handler writes the names of signal and call to standard error, which is the log of the run,
//! and re-raises the signal, so that exit status and core dump are those of the crash. For SIGKILL, which no handler
//! receives, the name of the call is also kept in a [file](share). A call that ends the process with `exit` is reported
//! in the same way, with the exit code.

use std::ffi::{c_int, c_void};
use std::fs::File;
use std::io;
use std::mem::MaybeUninit;
use std::os::fd::AsRawFd;
use std::ptr::{null, null_mut};
use std::sync::Once;
use std::sync::atomic::{AtomicBool, AtomicPtr, Ordering};

use hil_session::program::{self, CALL_BYTES, CALL_NAME_BYTES};

/// Signals that are caused by the program itself.
const SIGNALS: [(c_int, &str); 6] = [
    (libc::SIGSEGV, "SIGSEGV"),
    (libc::SIGABRT, "SIGABRT"),
    (libc::SIGBUS, "SIGBUS"),
    (libc::SIGFPE, "SIGFPE"),
    (libc::SIGILL, "SIGILL"),
    (libc::SIGTRAP, "SIGTRAP"),
];
/// Size of the handler's stack in bytes, because a stack overflow leaves no space on the ordinary stack.
const STACK_BYTES: usize = 64 << 10;

/// Name of the current call; null outside of calls.
static CALL: AtomicPtr<&'static str> = AtomicPtr::new(null_mut());
/// Prefix of all names, `fmi2` or `fmi3`; null for none.
static FAMILY: AtomicPtr<&'static str> = AtomicPtr::new(null_mut());
/// Memory of a file that outlives this process, with the name of the call; null for none.
static SHARED: AtomicPtr<u8> = AtomicPtr::new(null_mut());
static INSTALLED: Once = Once::new();
/// Set while this process only tries a model without running it.
static IS_TRIAL: AtomicBool = AtomicBool::new(false);
/// Set once the work of a trial is done and the model is only being freed.
static IS_EXCUSED: AtomicBool = AtomicBool::new(false);

/// Guard of a marked call, which removes the mark on drop.
#[must_use]
pub(crate) struct Calling(*mut &'static str);

/// Marks the start of a call of foreign code.
#[inline]
pub(crate) fn calling(name: &'static &'static str) -> Calling {
    let name = std::ptr::from_ref(name).cast_mut();
    // Not an atomic exchange, which would be a barrier at each call: only one thread calls foreign code.
    let before = CALL.load(Ordering::Relaxed);
    CALL.store(name, Ordering::Relaxed);
    publish(name);
    Calling(before)
}

impl Drop for Calling {
    #[inline]
    fn drop(&mut self) {
        CALL.store(self.0, Ordering::Relaxed);
        publish(self.0);
    }
}

/// Stores the name of the call in this file as well, for a signal that no handler receives.
///
/// # Errors
/// If the file cannot be mapped.
pub(crate) fn share(file: &File) -> io::Result<()> {
    file.set_len(CALL_BYTES as u64)?;
    // SAFETY: a new mapping of a file that has so many bytes, which stays as long as the process.
    let page = unsafe {
        libc::mmap(
            null_mut(),
            CALL_BYTES,
            libc::PROT_READ | libc::PROT_WRITE,
            libc::MAP_SHARED,
            file.as_raw_fd(),
            0,
        )
    };
    if page == libc::MAP_FAILED {
        return Err(io::Error::last_os_error());
    }
    SHARED.store(page.cast(), Ordering::Relaxed);
    Ok(())
}

/// Writes the name of a call, or an empty name, to the shared file, if there is one.
#[inline]
fn publish(name: *const &'static str) {
    let page = SHARED.load(Ordering::Relaxed);
    if !page.is_null() {
        // SAFETY: null, or a reference with static lifetime.
        let name = unsafe { name.as_ref() }.map_or("", |name| name);
        // SAFETY: the page has room for two names, of which this is the first, and one thread alone calls foreign code.
        unsafe { write_name(page, name) };
    }
}

/// # Safety
/// `place` has room for a name with its length.
unsafe fn write_name(place: *mut u8, name: &str) {
    let length = name.len().min(CALL_NAME_BYTES - 1);
    // SAFETY: by the caller, for so many bytes.
    unsafe {
        place.add(1).copy_from_nonoverlapping(name.as_ptr(), length);
        place.write_volatile(length as u8);
    }
}

/// Installs the handlers that report fatal signals and exits with the current call. `family` is the prefix of all
/// call names.
pub(crate) fn install(family: &'static &'static str) {
    FAMILY.store(std::ptr::from_ref(family).cast_mut(), Ordering::Relaxed);
    let page = SHARED.load(Ordering::Relaxed);
    if !page.is_null() {
        // SAFETY: the page has room for two names, of which this is the second.
        unsafe { write_name(page.add(CALL_NAME_BYTES), family) };
    }
    INSTALLED.call_once(|| {
        provide_stack();
        // SAFETY: the handler lives as long as the process and ignores its argument.
        unsafe { on_exit(exited, null_mut()) };
        for (signal, _) in SIGNALS {
            // SAFETY: all fields are numbers and pointers, for which zero is valid.
            let mut action: libc::sigaction = unsafe { MaybeUninit::zeroed().assume_init() };
            let handler: extern "C" fn(c_int) = died;
            action.sa_sigaction = handler as libc::sighandler_t;
            // Reset, so that the signal ends the process when it comes again.
            action.sa_flags = libc::SA_RESETHAND | libc::SA_ONSTACK;
            // SAFETY: the handler takes only the number, as required without SA_SIGINFO, and calls only
            // async-signal-safe functions.
            unsafe { libc::sigaction(signal, &raw const action, null_mut()) };
        }
    });
}

/// Marks this process as one that only tries a model. A crash while freeing the model then does not count as a failure,
/// because some models can be freed only after a step.
pub(crate) fn begin_trial() {
    IS_TRIAL.store(true, Ordering::Relaxed);
}

/// Marks the work of a trial as complete.
pub(crate) fn excuse_end() {
    IS_EXCUSED.store(IS_TRIAL.load(Ordering::Relaxed), Ordering::Relaxed);
}

/// Sets up an alternate signal stack for this thread, unless it already has one, as Rust's threads do.
fn provide_stack() {
    // SAFETY: as in `install`.
    let mut present: libc::stack_t = unsafe { MaybeUninit::zeroed().assume_init() };
    // SAFETY: only queries the current stack.
    let answer = unsafe { libc::sigaltstack(null(), &raw mut present) };
    if answer != 0 || present.ss_flags & libc::SS_DISABLE == 0 {
        return;
    }
    let memory = Box::leak(vec![0_u8; STACK_BYTES].into_boxed_slice());
    let stack = libc::stack_t {
        ss_sp: memory.as_mut_ptr().cast(),
        ss_flags: 0,
        ss_size: memory.len(),
    };
    // SAFETY: the memory is never freed or used for anything else.
    unsafe { libc::sigaltstack(&raw const stack, null_mut()) };
}

/// Signal handler: reports the crash and re-raises the signal.
extern "C" fn died(signal: c_int) {
    // SAFETY: null, or a reference with static lifetime.
    let call = unsafe { CALL.load(Ordering::Relaxed).as_ref() };
    // SAFETY: as above.
    let family = unsafe { FAMILY.load(Ordering::Relaxed).as_ref() };
    if IS_EXCUSED.load(Ordering::Relaxed) {
        write("note: the model crashed when it was taken down after the trial\n");
        say_checked();
        // SAFETY: `_exit` is async-signal-safe.
        unsafe { libc::_exit(0) };
    }
    if let Some(call) = call {
        let name = SIGNALS.iter().find(|(number, _)| *number == signal);
        let name = name.map_or("a signal", |(_, name)| name);
        let family = family.unwrap_or(&"");
        for part in ["error: ", name, " in ", family, call, "\n"] {
            write(part);
        }
    }
    // Delivered when the handler returns; the faulting instruction does not fault again first.
    // SAFETY: `raise` is async-signal-safe.
    unsafe { libc::raise(signal) };
}

/// Exit handler: reports the current call, if there is one.
extern "C" fn exited(code: c_int, _: *mut c_void) {
    // SAFETY: null, or a reference with static lifetime.
    let call = unsafe { CALL.load(Ordering::Relaxed).as_ref() };
    let Some(call) = call else { return };
    // SAFETY: as above.
    let family = unsafe { FAMILY.load(Ordering::Relaxed).as_ref() };
    let family = family.unwrap_or(&"");
    // Output of the library is flushed first, because the last line of a log is the reason of an end.
    // SAFETY: flushes all streams of the C library.
    unsafe { libc::fflush(null_mut()) };
    if IS_EXCUSED.load(Ordering::Relaxed) {
        write("note: the model ended its process when it was taken down after the trial\n");
        say_checked();
        // SAFETY: ends the process, whose streams are flushed.
        unsafe { libc::_exit(0) };
    }
    write(&format!(
        "error: exit({code}) was called in {family}{call}\n"
    ));
}

// Like `atexit`, with the exit code; missing in the crate `libc`.
unsafe extern "C" {
    fn on_exit(handler: extern "C" fn(c_int, *mut c_void), argument: *mut c_void) -> c_int;
}

/// Prints that a trial was completed.
pub(crate) fn say_checked() {
    // Behind whatever the library wrote.
    for part in ["\n", program::CHECKED, "\n"] {
        write_to(libc::STDOUT_FILENO, part);
    }
}

fn write(text: &str) {
    write_to(libc::STDERR_FILENO, text);
}

fn write_to(file: c_int, text: &str) {
    // SAFETY: `write` is async-signal-safe, and the text has this length.
    unsafe { libc::write(file, text.as_ptr().cast(), text.len()) };
}
