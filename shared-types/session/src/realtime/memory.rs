//! Memory that is there when the loop comes to it.
//!
//! Locking is the one call that reaches all of it: code, stacks, heap, the shared memory that is
//! mapped and that which is mapped later. So memory is also fetched beforehand by locking it, and both
//! settings need the same right.

use std::hint::black_box;

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, capabilities};

use crate::thread::look;

/// Depth to which the stack of the loop's thread is touched, in bytes; a step needs far less.
const STACK: usize = 256 << 10;
/// Bytes of new memory that show whether memory is at hand; more than the heap keeps in stock.
const PROBE: usize = 4 << 20;

/// Locks what there is and what will come; with `fetch` it is also brought in before it is used.
pub(super) fn keep(lock: bool, fetch: bool) -> Result<(), String> {
    if !(lock || fetch) {
        return Ok(());
    }
    may_lock()?;
    if fetch {
        touch_stack();
    }
    let mut flags = MlockAllFlags::CURRENT | MlockAllFlags::FUTURE;
    flags.set(MlockAllFlags::ONFAULT, !fetch);
    mlockall(flags).map_err(|error| std::io::Error::from(error).to_string())
}

/// A limit would be met in the middle of things: by the next mapping, which would then fail.
fn may_lock() -> Result<(), String> {
    let privileged =
        capabilities(None).is_ok_and(|held| held.effective.contains(CapabilitySet::IPC_LOCK));
    match getrlimit(Resource::Memlock).current {
        Some(bytes) if !privileged => Err(format!(
            "only {bytes} bytes may be locked, and all memory of the process must"
        )),
        _ => Ok(()),
    }
}

#[inline(never)]
fn touch_stack() {
    black_box(&mut [1_u8; STACK]);
}

/// Checks whether the process has locked memory.
pub(super) fn is_locked() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let locked = (status.lines()).find_map(|line| line.strip_prefix("VmLck:"));
    locked.is_some_and(|locked| locked.trim() != "0 kB")
}

/// Checks whether the calling thread can touch new memory without a page fault.
pub(super) fn is_at_hand() -> bool {
    let mut probe: Vec<u8> = Vec::with_capacity(PROBE);
    let before = look();
    probe.resize(PROBE, 1);
    black_box(&probe);
    let (_, faults) = look().since(before);
    faults == 0
}
