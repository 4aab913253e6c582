//! Names the call of foreign code in which this process dies by a signal.
//!
//! Every call of an FMU or a C callback is marked by [`calling`], two writes to memory. If a signal that ends the
//! process comes meanwhile, a handler writes its name and that of the call to standard error, the log of the run, and
//! lets the signal do its work: exit status and core dump are those of the crash. For a signal that no handler gets the
//! name is kept in a [file](share) too. A call that ends the process by `exit`
//! is named in the same way, with the exit code.

use std::ffi::{c_int, c_void};
use std::fs::File;
use std::io;
use std::mem::MaybeUninit;
use std::os::fd::AsRawFd;
use std::ptr::{null, null_mut};
use std::sync::Once;
use std::sync::atomic::{AtomicBool, AtomicPtr, Ordering};

use shared_types::program::{self, CALL_BYTES, CALL_NAME_BYTES};

/// Signals by which a program ends itself.
const SIGNALS: [(c_int, &str); 6] = [
    (libc::SIGSEGV, "SIGSEGV"),
    (libc::SIGABRT, "SIGABRT"),
    (libc::SIGBUS, "SIGBUS"),
    (libc::SIGFPE, "SIGFPE"),
    (libc::SIGILL, "SIGILL"),
    (libc::SIGTRAP, "SIGTRAP"),
];
/// Bytes of the stack of the handler where there is none: an overflow leaves none of the ordinary one.
const STACK_BYTES: usize = 64 << 10;

/// Name of the call that is going on; null if none is.
static CALL: AtomicPtr<&'static str> = AtomicPtr::new(null_mut());
/// Name of the version in front of all names, `fmi2` or `fmi3`; null for none.
static FAMILY: AtomicPtr<&'static str> = AtomicPtr::new(null_mut());
/// Memory of a file that outlives this process, with the name of the call; null for none.
static SHARED: AtomicPtr<u8> = AtomicPtr::new(null_mut());
static INSTALLED: Once = Once::new();
/// True while this process only tries a model, without running it.
static IS_TRIAL: AtomicBool = AtomicBool::new(false);
/// True once the work of a trial is done and the model is only taken down.
static IS_EXCUSED: AtomicBool = AtomicBool::new(false);

/// Mark of a call, taken back when dropped.
#[must_use]
pub(crate) struct Calling(*mut &'static str);

/// Marks the begin of a call of foreign code.
#[inline]
pub(crate) fn calling(name: &'static &'static str) -> Calling {
    let name = std::ptr::from_ref(name).cast_mut();
    // Not one exchange, which would be a barrier at each call: one thread alone calls foreign code.
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

/// Keeps the name of the call in this file as well, for a signal that no handler gets.
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

/// Writes the name of a call, or none, to the shared file, if there is one.
#[inline]
fn publish(name: *const &'static str) {
    let page = SHARED.load(Ordering::Relaxed);
    if !page.is_null() {
        // SAFETY: null, or a reference that lives for ever.
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

/// Lets a signal that ends this process be named with the call from now on. All calls have this text in front.
pub(crate) fn install(family: &'static &'static str) {
    FAMILY.store(std::ptr::from_ref(family).cast_mut(), Ordering::Relaxed);
    let page = SHARED.load(Ordering::Relaxed);
    if !page.is_null() {
        // SAFETY: the page has room for two names, of which this is the second.
        unsafe { write_name(page.add(CALL_NAME_BYTES), family) };
    }
    INSTALLED.call_once(|| {
        provide_stack();
        // SAFETY: the handler lives as long as the process and takes no argument.
        unsafe { on_exit(exited, null_mut()) };
        for (signal, _) in SIGNALS {
            // SAFETY: a struct of numbers and pointers, for which zero is a value of each.
            let mut action: libc::sigaction = unsafe { MaybeUninit::zeroed().assume_init() };
            let handler: extern "C" fn(c_int) = died;
            action.sa_sigaction = handler as libc::sighandler_t;
            // Reset, so that the signal ends the process when it comes again.
            action.sa_flags = libc::SA_RESETHAND | libc::SA_ONSTACK;
            // SAFETY: the handler takes the number alone, as without SA_SIGINFO, and calls only what may be called
            // in one.
            unsafe { libc::sigaction(signal, &raw const action, null_mut()) };
        }
    });
}

/// Marks this process as one that only tries a model. A crash in taking down what it made is then no failure: there are
/// models that can be freed only after a step.
pub(crate) fn begin_trial() {
    IS_TRIAL.store(true, Ordering::Relaxed);
}

/// Marks the work of a trial as done.
pub(crate) fn excuse_end() {
    IS_EXCUSED.store(IS_TRIAL.load(Ordering::Relaxed), Ordering::Relaxed);
}

/// Gives the handler a stack of its own on this thread, unless there is one, as on every thread of Rust.
fn provide_stack() {
    // SAFETY: as in `install`.
    let mut present: libc::stack_t = unsafe { MaybeUninit::zeroed().assume_init() };
    // SAFETY: asks only.
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
    // SAFETY: the memory is never freed or used otherwise.
    unsafe { libc::sigaltstack(&raw const stack, null_mut()) };
}

/// Handler: writes what happened and lets it happen.
extern "C" fn died(signal: c_int) {
    // SAFETY: null, or a reference that lives for ever.
    let call = unsafe { CALL.load(Ordering::Relaxed).as_ref() };
    // SAFETY: as above.
    let family = unsafe { FAMILY.load(Ordering::Relaxed).as_ref() };
    if IS_EXCUSED.load(Ordering::Relaxed) {
        write("note: the model crashed when it was taken down after the trial\n");
        say_checked();
        // SAFETY: `_exit` may be called in a handler.
        unsafe { libc::_exit(0) };
    }
    if let Some(call) = call {
        let name = SIGNALS.iter().find(|(number, _)| *number == signal);
        let name = name.map_or("a signal", |(_, name)| name);
        let family = family.unwrap_or(&"");
        for part in ["error: ", name, " came in ", family, call, "\n"] {
            write(part);
        }
    }
    // Delivered when the handler returns, where the faulting instruction does not fault again.
    // SAFETY: `raise` may be called in a handler.
    unsafe { libc::raise(signal) };
}

/// Handler of an exit: names the call that it came in, if one is going on.
extern "C" fn exited(code: c_int, _: *mut c_void) {
    // SAFETY: null, or a reference that lives for ever.
    let call = unsafe { CALL.load(Ordering::Relaxed).as_ref() };
    let Some(call) = call else { return };
    // SAFETY: as above.
    let family = unsafe { FAMILY.load(Ordering::Relaxed).as_ref() };
    let family = family.unwrap_or(&"");
    // What the library said comes first, as the reason of an end is the last line of a log.
    // SAFETY: writes out what the C library holds of all streams.
    unsafe { libc::fflush(null_mut()) };
    if IS_EXCUSED.load(Ordering::Relaxed) {
        write("note: the model ended its process when it was taken down after the trial\n");
        say_checked();
        // SAFETY: ends the process, whose streams are written out.
        unsafe { libc::_exit(0) };
    }
    write(&format!(
        "error: exit({code}) was called in {family}{call}\n"
    ));
}

// As `atexit`, with the exit code; not among the functions of the crate `libc`.
unsafe extern "C" {
    fn on_exit(handler: extern "C" fn(c_int, *mut c_void), argument: *mut c_void) -> c_int;
}

/// Says that a trial was done to its end.
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
    // SAFETY: `write` may be called in a handler, and the text has so many bytes.
    unsafe { libc::write(file, text.as_ptr().cast(), text.len()) };
}
