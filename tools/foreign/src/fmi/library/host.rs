//! Loading a library as a C program would: the parts of the C library that FMUs rely on are available to every
//! library, and undefined functions matter only when they are called.
//!
//! [`needs`] lists the dependencies of a library, including missing ones, for `hil describe --load`.

use std::path::Path;
use std::sync::Once;

use hil_session::program;
use libloading::os::unix::{Library, RTLD_GLOBAL, RTLD_LAZY, RTLD_LOCAL, RTLD_NOW};
use shared_types::describe::LibraryNeeds;
use shared_types::text;

use super::LibraryError;
use super::elf::Dynamic;
use crate::crash::{self, calling};

/// Parts of the C library that are usually loaded in C programs, so that libraries rely on them without declaring it.
/// In musl and recent versions of glibc, missing parts belong to the C library itself.
const PARTS: [&str; 4] = ["libm.so.6", "libdl.so.2", "librt.so.1", "libpthread.so.0"];
/// Prefixes of the function names of a Python interpreter.
const PYTHON: [&str; 2] = ["Py", "_Py"];
/// Minor versions of Python 3 that are searched for, in descending order.
const PYTHON_VERSIONS: std::ops::RangeInclusive<u32> = 6..=20;

/// Makes the parts of the C library available to all libraries, once.
fn provide_parts() {
    static DONE: Once = Once::new();
    DONE.call_once(|| {
        for name in PARTS {
            provide(name);
        }
    });
}

/// Makes the symbols of an installed library available to all others; returns `false` if the library does not exist.
fn provide(name: &str) -> bool {
    // SAFETY: system libraries, whose loading has no other effect.
    let library = unsafe { Library::open(Some(name), RTLD_LAZY | RTLD_GLOBAL) };
    // Never unloaded, because its users stay loaded as well.
    library.map(std::mem::forget).is_ok()
}

/// Loads a library. With `needs_tool`, as for an interpreter, its symbols and those of its dependencies become
/// available to everything that it loads.
///
/// # Errors
/// If the library cannot be loaded.
pub(super) fn load(path: &Path, needs_tool: bool) -> Result<Library, LibraryError> {
    provide_parts();
    let scope = if needs_tool { RTLD_GLOBAL } else { RTLD_LOCAL };
    if needs_tool {
        provide_python(path);
    }
    // SAFETY: loading runs code of the library, which the user requested by naming the FMU; no data of this process
    // is passed to it here.
    let open = |binding| unsafe { Library::open(Some(path), binding | scope) };
    open(RTLD_NOW).or_else(|error| {
        // An undefined function does no harm unless it is called.
        let Ok(library) = open(RTLD_LAZY) else {
            return Err(LibraryError::Load(failure(&error)));
        };
        let reason = reason(&error);
        program::say(&format!("fmu: {reason}; calling it would end this process"));
        Ok(library)
    })
}

/// Loads the installed library of Python 3 for a library that calls it without declaring it.
fn provide_python(path: &Path) {
    let Some(dynamic) = Dynamic::read(path) else {
        return;
    };
    let is_python = |name: &String| PYTHON.iter().any(|begin| name.starts_with(begin));
    let is_named = dynamic.needs.iter().any(|name| name.contains("libpython"));
    if is_named || !dynamic.undefined.iter().any(is_python) {
        return;
    }
    let mut names = PYTHON_VERSIONS
        .rev()
        .map(|minor| format!("libpython3.{minor}.so.1.0"));
    let _ = names.any(|name| provide(&name)) || provide("libpython3.so"); // the loader reports a missing one
}

/// Lists the dependencies of a library, including missing ones. Loads the library and its dependencies.
pub(in crate::fmi) fn needs(path: &Path, needs_tool: bool) -> LibraryNeeds {
    crash::install(&"");
    let call = calling(&"dlopen");
    let refusal = load(path, needs_tool).map(std::mem::forget).err();
    drop(call);
    let Some(dynamic) = Dynamic::read(path) else {
        return LibraryNeeds {
            refusal: refusal.map(|error| error.to_string()),
            ..LibraryNeeds::default()
        };
    };
    let beside = path.parent().filter(|_| dynamic.looks_beside_itself);
    let open = |name: &String| {
        // SAFETY: as in `load`: a library that the FMU depends on.
        let open = |file: &Path| unsafe { Library::open(Some(file), RTLD_LAZY | RTLD_LOCAL) };
        let library = open(Path::new(name));
        library.or_else(|error| beside.map_or(Err(error), |folder| open(&folder.join(name))))
    };
    let opened: Vec<(&String, Option<Library>)> = (dynamic.needs.iter())
        .map(|name| (name, open(name).ok()))
        .collect();
    let own = Library::this();
    let is_defined = |symbol: &String| {
        let named = opened.iter().filter_map(|(_, library)| library.as_ref());
        std::iter::once(&own).chain(named).any(|library| {
            let symbol = format!("{symbol}\0");
            // SAFETY: only looked up, never used.
            unsafe { library.get::<*const u8>(symbol.as_bytes()) }.is_ok()
        })
    };
    let undefined = dynamic.undefined.iter();
    let lacks_symbols = undefined.filter(|symbol| !is_defined(symbol)).cloned();
    let lacks_symbols = lacks_symbols.collect();
    let absent = opened.iter().filter(|(_, library)| library.is_none());
    let lacks_libraries = absent.map(|(name, _)| (*name).clone()).collect();
    for library in opened.into_iter().filter_map(|(_, library)| library) {
        std::mem::forget(library); // its exit handlers may be anything
    }
    LibraryNeeds {
        needs: dynamic.needs,
        lacks_libraries,
        lacks_symbols,
        refusal: refusal.map(|error| match error {
            LibraryError::Load(reason) => reason,
            other => other.to_string(),
        }),
    }
}

fn reason(error: &libloading::Error) -> String {
    let source = std::error::Error::source(error);
    text::line(&source.map_or_else(|| error.to_string(), ToString::to_string))
}

/// Returns the system's error, with the usual cause if it is not obvious.
fn failure(error: &libloading::Error) -> String {
    let mut reason = reason(error);
    if reason.contains("failed to map segment") {
        reason.push_str(
            "; is the folder for temporary files mounted noexec? Set TMPDIR to another one",
        );
    } else {
        reason
            .push_str("; run `hil describe --load` to list all dependencies and the missing ones");
    }
    reason
}
