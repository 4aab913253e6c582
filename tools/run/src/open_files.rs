//! Limit of open files of a process: without enough of them, what is made of shared memory fails
//! in ways that do not tell why.

use hil_console::terminal::exit::Failure;
use hil_console::terminal::output;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Files that a process of a run opens at most: 48 in all were too few without handover, 52 were enough.
const LEAST: u64 = 64;
/// Enough for many handovers and every monitor.
const ENOUGH: u64 = 512;

/// A run with less may break off: 70 MiB of addresses were too few, and each thread takes some.
const AMPLE_ADDRESSES: u64 = 512 << 20;

/// Warns of a limit of addresses beside which memory may end at any time, in words that tell nothing.
pub(crate) fn warn_of_few_addresses() {
    if let Some(most) = getrlimit(Resource::As)
        .current
        .filter(|most| *most < AMPLE_ADDRESSES)
    {
        output::tell(&format!(
            "warning: a process may have {} MiB of addresses, and a run may break off with less than {}: `ulimit -v unlimited`",
            most >> 20,
            AMPLE_ADDRESSES >> 20
        ));
    }
}

/// Makes sure that this process, and those that it starts, may open the files of a run.
///
/// # Errors
/// If they may not, and what to do.
pub fn ensure() -> Result<(), Failure> {
    // Those that were handed down are handed further.
    let open = std::fs::read_dir("/proc/self/fd").map_or(0, |all| all.count() as u64);
    let limit = getrlimit(Resource::Nofile);
    let Some(soft) = limit.current.filter(|soft| *soft < open + ENOUGH) else {
        return Ok(());
    };
    let wanted = limit
        .maximum
        .map_or(open + ENOUGH, |most| most.min(open + ENOUGH));
    let raised = Rlimit {
        current: Some(wanted),
        maximum: limit.maximum,
    };
    let granted = setrlimit(Resource::Nofile, raised).map_or(soft, |()| wanted);
    let least = open + LEAST;
    if granted < least {
        return Err(Failure::infrastructure(format!(
            "{granted} files may be open at once, and a run takes up to {least}: `ulimit -n {}`",
            least.next_multiple_of(256)
        )));
    }
    Ok(())
}
