//! Why a run may have failed that had too little shared memory.
//!
//! Used where a run failed: a process that wants more than there is gets an error without a word of its
//! cause, or is killed by the system when it touches what it was promised.

use std::path::Path;

use crate::recording::size;

/// Where shared memory lives.
const SHARED_MEMORY: &str = "/dev/shm";
/// Less than this is none: the segments of a run take a few MiB.
const LITTLE_BYTES: u64 = 8 << 20;

/// What to say of shared memory that is nearly full.
pub(super) fn shortage() -> Option<String> {
    told(free_bytes(Path::new(SHARED_MEMORY))?)
}

fn free_bytes(folder: &Path) -> Option<u64> {
    let there = rustix::fs::statvfs(folder).ok()?;
    Some(there.f_bavail.saturating_mul(there.f_frsize))
}

fn told(free_bytes: u64) -> Option<String> {
    (free_bytes < LITTLE_BYTES).then(|| {
        let free = size::shown(free_bytes);
        format!(
            "{SHARED_MEMORY} has only {free} free, which may be why: `hil sessions --clean` removes what dead sessions left, `mount -o remount,size=256m {SHARED_MEMORY}` makes it larger"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_shortage_is_told() {
        assert_eq!(told(LITTLE_BYTES), None);
        let said = told(4096).expect("a shortage");
        assert!(said.contains("/dev/shm has only"), "{said}");
        assert!(said.contains("hil sessions --clean"), "{said}");
        assert!(free_bytes(Path::new("/nowhere")).is_none());
    }
}
