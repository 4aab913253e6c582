//! Limit of open files of a process: if it is too low, operations on shared memory fail with misleading errors.

use hil_console::terminal::exit::Failure;
use hil_console::terminal::output;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Minimum limit: without handover, 48 files were too few for a process in a run, and 52 were enough.
const LEAST: u64 = 64;
/// Limit sufficient for many handovers and any number of monitors.
const ENOUGH: u64 = 512;

/// Address space below which a run may fail: 70 MiB were too little, and each thread takes some.
const AMPLE_ADDRESSES: u64 = 512 << 20;

/// Warns of a limit of the address space that is too low, because exceeding it fails with misleading errors.
pub(crate) fn warn_of_few_addresses() {
    if let Some(most) = getrlimit(Resource::As)
        .current
        .filter(|most| *most < AMPLE_ADDRESSES)
    {
        output::tell(&format!(
            "warning: the address space of a process is limited to {} MiB, and a run may fail with less than {}: `ulimit -v unlimited`",
            most >> 20,
            AMPLE_ADDRESSES >> 20
        ));
    }
}

/// Ensures that this process and its children may open the files of a run.
///
/// # Errors
/// If the limit is too low, with advice.
pub fn ensure() -> Result<(), Failure> {
    // Inherited files are inherited by children too.
    let open = std::fs::read_dir("/proc/self/fd").map_or(0, |all| all.count() as u64);
    let limit = getrlimit(Resource::Nofile);
    let Some(soft) = limit.current.filter(|soft| *soft < open + ENOUGH) else {
        return Ok(());
    };
    let target = limit
        .maximum
        .map_or(open + ENOUGH, |most| most.min(open + ENOUGH));
    let raised = Rlimit {
        current: Some(target),
        maximum: limit.maximum,
    };
    let granted = setrlimit(Resource::Nofile, raised).map_or(soft, |()| target);
    let least = open + LEAST;
    if granted < least {
        return Err(Failure::infrastructure(format!(
            "at most {granted} files may be open at once, but a run needs up to {least}: `ulimit -n {}`",
            least.next_multiple_of(256)
        )));
    }
    Ok(())
}
