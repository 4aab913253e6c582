//! The `main` functions of C programs.

use std::ffi::{CStr, OsStr, OsString, c_char, c_int};
use std::mem::{MaybeUninit, offset_of};
use std::os::unix::ffi::OsStrExt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr;

use hil_session::program::{UNUSABLE, say};
use shared_types::describe::Invalid;

use crate::crash::install;

use super::interface::{API, API_WITHOUT_STATE, Controller, Plant};
use super::tables::text;
use super::{law, plant};
use crate::float_modes;

/// Exit code of a Rust program that panicked.
const PANICKED: c_int = 101;

/// Startup steps of a Rust program that a C program lacks.
mod start {
    use std::ffi::{c_char, c_int};
    use std::ptr;

    /// `_IOLBF` of the C libraries of Linux.
    const LINES: c_int = 1;
    /// `SIGPIPE` of Linux.
    const BROKEN_PIPE: c_int = 13;
    /// `SIG_IGN` of the C libraries of Linux.
    const IGNORED: usize = 1;

    unsafe extern "C" {
        static stdout: *mut u8;
        fn signal(number: c_int, handler: usize) -> usize;
        fn setvbuf(stream: *mut u8, buffer: *mut c_char, mode: c_int, size: usize) -> c_int;
    }

    /// Makes standard output line-buffered, so that a crash loses no line of the log.
    pub(super) fn write_lines() {
        // SAFETY: called at the start of `main`, before other threads or writes; the stream belongs to the library.
        unsafe { setvbuf(stdout, ptr::null_mut(), LINES, 0) };
    }

    /// Turns a write to a pipe without a reader into an error instead of a signal.
    pub(super) fn outlive_readers() {
        // SAFETY: the number is that of a signal that may be ignored.
        unsafe { signal(BROKEN_PIPE, IGNORED) };
    }
}

/// Runs a C program with its arguments. A panic ends it like a Rust program.
///
/// # Safety
/// `argv` points to `argc` texts, as passed to `main`.
unsafe fn run(
    argc: c_int,
    argv: *const *const c_char,
    body: impl FnOnce(Vec<OsString>) -> Result<u8, Invalid>,
) -> c_int {
    let count = if argv.is_null() {
        0
    } else {
        usize::try_from(argc).unwrap_or(0)
    };
    let arguments = (0..count).map(|place| {
        // SAFETY: the index is below `argc`, and each argument is a text.
        let argument = unsafe { CStr::from_ptr(*argv.add(place)) };
        OsStr::from_bytes(argument.to_bytes()).to_owned()
    });
    let arguments = arguments.collect();
    // A program linked with -ffast-math or crtfastmath.o starts with flush-to-zero enabled.
    float_modes::settle("main");
    start::write_lines();
    start::outlive_readers();
    install(&"");
    let ended = catch_unwind(AssertUnwindSafe(|| body(arguments)));
    match ended {
        Ok(Ok(code)) => code.into(),
        Ok(Err(wrong)) => {
            say(&format!("error: {wrong}"));
            UNUSABLE.into()
        }
        Err(_) => PANICKED,
    }
}

/// Returns the version of a program, which is optional.
///
/// # Safety
/// The text is null or zero-terminated.
unsafe fn version(version: *const c_char) -> Result<String, Invalid> {
    match version.is_null() {
        true => Ok("0".into()),
        // SAFETY: guaranteed by the caller.
        false => unsafe { text(version, "the version") },
    }
}

/// Copies a struct of the header, of which programs of versions 1 and 2 have only the first of these bytes; the
/// callbacks behind them are null then.
///
/// # Safety
/// `form` points to a struct of the version that its first number states, and all bits zero are a valid `T`.
unsafe fn whole<T>(form: *const T, [bytes_in_1, bytes_in_2]: [usize; 2]) -> T {
    let mut copy = MaybeUninit::<T>::zeroed();
    // SAFETY: guaranteed by the caller; the version comes first.
    let api = unsafe { form.cast::<u32>().read() };
    let bytes = match api {
        API => size_of::<T>(),
        API_WITHOUT_STATE => bytes_in_2,
        _ => bytes_in_1,
    };
    // SAFETY: both have so many bytes, and the rest is zero.
    unsafe {
        ptr::copy_nonoverlapping(form.cast::<u8>(), copy.as_mut_ptr().cast(), bytes);
        copy.assume_init()
    }
}

/// `hil_plant_main` of the header.
///
/// # Safety
/// The arguments are those of `main`; the plant is null or valid as required by [`plant::kind`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn hil_plant_main(
    argc: c_int,
    argv: *const *const c_char,
    plant: *const Plant,
) -> c_int {
    let body = |arguments| {
        if plant.is_null() {
            return Err(Invalid("hil_plant_main got a null pointer".into()));
        }
        // SAFETY: guaranteed by the caller; zero is a null pointer, no callback and no row.
        let plant = unsafe { whole(plant, [offset_of!(Plant, read), offset_of!(Plant, state)]) };
        // SAFETY: guaranteed by the caller.
        let (kind, version) = unsafe { (plant::kind(&plant)?, version(plant.version)?) };
        let program = kind.description.name.clone();
        let plants = vec![kind];
        Ok(plant_process::program::answer(
            arguments, program, version, plants,
        ))
    };
    // SAFETY: guaranteed by the caller.
    unsafe { run(argc, argv, body) }
}

/// `hil_controller_main` of the header.
///
/// # Safety
/// The arguments are those of `main`; the controller is null or valid as required by [`law::kind`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn hil_controller_main(
    argc: c_int,
    argv: *const *const c_char,
    controller: *const Controller,
) -> c_int {
    let body = |arguments| {
        if controller.is_null() {
            return Err(Invalid("hil_controller_main got a null pointer".into()));
        }
        // SAFETY: guaranteed by the caller; zero is a null pointer, no callback and no row.
        let law = unsafe {
            whole(
                controller,
                [
                    offset_of!(Controller, answer),
                    offset_of!(Controller, state),
                ],
            )
        };
        // SAFETY: guaranteed by the caller.
        let (kind, version) = unsafe { (law::kind(&law)?, version(law.version)?) };
        let program = kind.description.name.clone();
        let laws = vec![kind];
        Ok(controller_process::program::answer(
            arguments, program, version, laws,
        ))
    };
    // SAFETY: guaranteed by the caller.
    unsafe { run(argc, argv, body) }
}
