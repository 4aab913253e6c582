//! `main` of a program in C.

use std::ffi::{CStr, OsStr, OsString, c_char, c_int};
use std::os::unix::ffi::OsStrExt;
use std::panic::{AssertUnwindSafe, catch_unwind};

use hil_session::program::{UNUSABLE, say};
use shared_types::describe::Invalid;

use crate::crash::install;

use super::interface::{Controller, Plant};
use super::tables::text;
use super::{law, plant};
use crate::float_modes;

/// Exit code of a program of Rust that panicked.
const PANICKED: c_int = 101;

/// Steps of the start of a program in Rust that a program in C lacks.
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

    /// Writes standard output line by line, so that a crash takes no line of the log with it.
    pub(super) fn write_lines() {
        // SAFETY: called at the start of `main`, before another thread or a write; the stream is the library's own.
        unsafe { setvbuf(stdout, ptr::null_mut(), LINES, 0) };
    }

    /// Makes a write to a pipe that nobody reads an error instead of the end.
    pub(super) fn outlive_readers() {
        // SAFETY: the number is a signal that may be ignored.
        unsafe { signal(BROKEN_PIPE, IGNORED) };
    }
}

/// Runs a program of C with its arguments. A panic ends it as it does one of Rust.
///
/// # Safety
/// `argv` points to `argc` texts, as `main` gets them.
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
        // SAFETY: the place is one of the arguments, each of which is a text.
        let argument = unsafe { CStr::from_ptr(*argv.add(place)) };
        OsStr::from_bytes(argument.to_bytes()).to_owned()
    });
    let arguments = arguments.collect();
    // A program that was linked with -ffast-math or crtfastmath.o starts with flush-to-zero.
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

/// Version of a program that may say none.
///
/// # Safety
/// The text is null or ends with a zero.
unsafe fn version(told: *const c_char) -> Result<String, Invalid> {
    match told.is_null() {
        true => Ok("0".into()),
        // SAFETY: the caller says so.
        false => unsafe { text(told, "the version") },
    }
}

/// `hil_plant_main` of the header.
///
/// # Safety
/// The arguments are those of `main`; the plant is null or as [`plant::kind`] asks for.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn hil_plant_main(
    argc: c_int,
    argv: *const *const c_char,
    plant: *const Plant,
) -> c_int {
    let body = |arguments| {
        // SAFETY: the caller says so.
        let plant = unsafe { plant.as_ref() };
        let plant = plant.ok_or_else(|| Invalid("hil_plant_main got a null pointer".into()))?;
        // SAFETY: the caller says so.
        let (kind, version) = unsafe { (plant::kind(plant)?, version(plant.version)?) };
        let program = kind.description.name.clone();
        let plants = vec![kind];
        Ok(plant_process::program::answer(
            arguments, program, version, plants,
        ))
    };
    // SAFETY: the caller says so.
    unsafe { run(argc, argv, body) }
}

/// `hil_controller_main` of the header.
///
/// # Safety
/// The arguments are those of `main`; the controller is null or as [`law::kind`] asks for.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn hil_controller_main(
    argc: c_int,
    argv: *const *const c_char,
    controller: *const Controller,
) -> c_int {
    let body = |arguments| {
        // SAFETY: the caller says so.
        let law = unsafe { controller.as_ref() };
        let law = law.ok_or_else(|| Invalid("hil_controller_main got a null pointer".into()))?;
        // SAFETY: the caller says so.
        let (kind, version) = unsafe { (law::kind(law)?, version(law.version)?) };
        let program = kind.description.name.clone();
        let laws = vec![kind];
        Ok(controller_process::program::answer(
            arguments, program, version, laws,
        ))
    };
    // SAFETY: the caller says so.
    unsafe { run(argc, argv, body) }
}
