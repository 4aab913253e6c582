//! Memory that is resident when the loop touches it.
//!
//! Locking is the only call that covers all memory: code, stacks, heap, and shared memory mapped now or later. Faulting
//! memory in therefore also uses locking, and both settings need the same privilege.

use std::hint::black_box;

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, capabilities};

use crate::thread::look;

/// Depth in bytes to which the stack of the loop's thread is touched; a step needs far less.
const STACK: usize = 256 << 10;
/// Bytes of new memory with which residency is probed; more than the heap keeps in reserve.
const PROBE: usize = 4 << 20;

/// Locks present and future memory; with `fetch`, also faults the memory in before use.
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

/// Checks the limit in advance, because otherwise a later mapping would fail.
fn may_lock() -> Result<(), String> {
    let privileged =
        capabilities(None).is_ok_and(|sets| sets.effective.contains(CapabilitySet::IPC_LOCK));
    match getrlimit(Resource::Memlock).current {
        Some(bytes) if !privileged => Err(format!(
            "the limit for locked memory is {bytes} bytes, but all memory of the process must be locked; raise the limit as shown"
        )),
        _ => Ok(()),
    }
}

#[inline(never)]
fn touch_stack() {
    black_box(&mut [1_u8; STACK]);
}

/// Returns `true` if the process has locked memory.
pub(super) fn is_locked() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let locked = (status.lines()).find_map(|line| line.strip_prefix("VmLck:"));
    locked.is_some_and(|locked| locked.trim() != "0 kB")
}

/// Returns `true` if the calling thread can touch new memory without a page fault.
pub(super) fn is_at_hand() -> bool {
    let mut probe: Vec<u8> = Vec::with_capacity(PROBE);
    let before = look();
    probe.resize(PROBE, 1);
    black_box(&probe);
    let (_, faults) = look().since(before);
    faults == 0
}
