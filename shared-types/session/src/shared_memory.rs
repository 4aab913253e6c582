//! Obstacles to using shared memory.
//!
//! For most refusals by the system iceoryx2 reports only `InternalError`. This module finds the probable cause and the
//! remedy for such reports. `hil doctor` runs the same checks before a run.

use std::io;

use rustix::fs::{Access, StatVfsMountFlags, access, statvfs};
use rustix::process::{Resource, getrlimit};

/// Folder of shared memory.
pub const FOLDER: &str = "/dev/shm";
/// Minimum free space: the segments of a run take a few MiB.
const LEAST_BYTES: u64 = 8 << 20;
/// Files, folders and sockets of a run: 70 were too few in tests, 90 enough; each handover takes some more.
pub const LEAST_INODES: u64 = 128;
/// Maximum number of bytes that a process of a run maps at once.
const LEAST_ADDRESSES: u64 = 128 << 20;
/// Maximum number of files that a process of a run opens at once.
const LEAST_FILES: u64 = 16;

/// File system of shared memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SharedMemory {
    /// `true` if the file system is mounted read-only.
    pub is_read_only: bool,
    /// `true` if this process may create files there.
    pub is_open: bool,
    /// Free space, in bytes.
    pub free_bytes: u64,
    /// Number of files that can still be created; `None` if unlimited.
    pub free_inodes: Option<u64>,
}

impl SharedMemory {
    /// Inspects the file system.
    ///
    /// # Errors
    /// If it does not exist.
    pub fn look() -> io::Result<Self> {
        let status = statvfs(FOLDER)?;
        Ok(Self {
            is_read_only: status.f_flag.contains(StatVfsMountFlags::RDONLY),
            is_open: access(FOLDER, Access::WRITE_OK | Access::EXEC_OK).is_ok(),
            free_bytes: status.f_bavail.saturating_mul(status.f_frsize),
            free_inodes: (status.f_files > 0).then_some(status.f_favail),
        })
    }

    /// Returns the obstacle in shared memory and its remedy; `None` if a run has enough of everything.
    #[must_use]
    pub fn hindrance(&self) -> Option<String> {
        const CLEAN: &str = "`hil sessions --clean` removes the remains of dead sessions";
        let mib = self.free_bytes >> 20;
        if self.is_read_only {
            return Some(format!(
                "{FOLDER} is read-only: `sudo mount -o remount,rw {FOLDER}`"
            ));
        }
        if !self.is_open {
            return Some(format!(
                "this user may not write to {FOLDER}: `sudo chmod 1777 {FOLDER}`"
            ));
        }
        if let Some(left) = self.free_inodes.filter(|left| *left < LEAST_INODES) {
            return Some(format!(
                "{FOLDER} has {left} free inodes, and a run takes up to {LEAST_INODES}: {CLEAN}, `sudo mount -o remount,nr_inodes=1m {FOLDER}` allows more"
            ));
        }
        (self.free_bytes < LEAST_BYTES).then(|| {
            format!(
                "{FOLDER} has only {mib} MiB free, and a run needs at least {}: {CLEAN}, `sudo mount -o remount,size=256m {FOLDER}` makes it larger",
                LEAST_BYTES >> 20
            )
        })
    }
}

/// Returns the obstacle that keeps this process from using shared memory, and its remedy; `None` if none is known.
#[must_use]
pub fn hindrance() -> Option<String> {
    let obstacle = match SharedMemory::look() {
        Ok(obstacle) => obstacle.hindrance(),
        Err(_) => Some(format!(
            "{FOLDER} does not exist: `sudo mount -t tmpfs -o mode=1777,nosuid,nodev tmpfs {FOLDER}`"
        )),
    };
    obstacle.or_else(limit)
}

/// Returns a limit of this process that is nearly reached.
fn limit() -> Option<String> {
    let limit_of = |resource, used: u64| Some((getrlimit(resource).current?, used));
    let addresses = limit_of(Resource::As, addresses()).filter(|l| is_near(*l, LEAST_ADDRESSES));
    if let Some((most, used)) = addresses {
        return Some(format!(
            "the address space of a process is limited to {} MiB, and this process already uses {}: `ulimit -v unlimited`",
            most >> 20,
            used >> 20
        ));
    }
    let open = std::fs::read_dir("/proc/self/fd").map_or(0, |all| all.count() as u64);
    let files = limit_of(Resource::Nofile, open).filter(|l| is_near(*l, LEAST_FILES));
    if let Some((most, used)) = files {
        return Some(format!(
            "the number of open files of a process is limited to {most}, and this process already has {used} open: `ulimit -n 4096`"
        ));
    }
    let (most, _) = limit_of(Resource::Fsize, 0).filter(|l| is_near(*l, LEAST_BYTES))?;
    Some(format!(
        "the size of a file is limited to {most} bytes: `ulimit -f unlimited`"
    ))
}

/// Returns `true` if less than `least` is left of a limit.
const fn is_near((most, used): (u64, u64), least: u64) -> bool {
    most.saturating_sub(used) < least
}

/// Returns the size of this process's address space in bytes.
fn addresses() -> u64 {
    let status_text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let size = status_text
        .lines()
        .find_map(|line| line.strip_prefix("VmSize:"));
    let kib = size.and_then(|size| size.trim().strip_suffix(" kB")?.parse::<u64>().ok());
    kib.unwrap_or(0) << 10
}

/// Combines an uninformative error of iceoryx2 with its probable cause.
pub(crate) fn refused(error: impl std::fmt::Debug) -> String {
    let hindrance = hindrance().unwrap_or_else(|| {
        "no obstacle to using shared memory was found; try again, then see `hil doctor`".into()
    });
    format!("iceoryx2 reports {error:?}: {hindrance}")
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: SharedMemory = SharedMemory {
        is_read_only: false,
        is_open: true,
        free_bytes: 1 << 30,
        free_inodes: Some(100_000),
    };

    #[test]
    fn missing_requirements_on_shared_memory_are_reported() {
        let (free_inodes, read_only) = (Some(LEAST_INODES - 1), true);
        #[rustfmt::skip] // a table
        let cases = [
            (GOOD, None),
            (SharedMemory { free_inodes: None,..GOOD }, None),
            (SharedMemory { is_read_only: read_only,..GOOD }, Some("remount,rw")),
            (SharedMemory { is_open: false,..GOOD }, Some("chmod 1777")),
            (SharedMemory { free_inodes,..GOOD }, Some("127 free inodes")),
            (SharedMemory { free_bytes: 7 << 20,..GOOD }, Some("only 7 MiB free")),
        ];
        for (state, expected) in cases {
            let obstacle = state.hindrance();
            match expected {
                None => assert_eq!(obstacle, None),
                Some(part) => assert!(
                    obstacle.clone().unwrap_or_default().contains(part),
                    "{obstacle:?}"
                ),
            }
        }
    }

    #[test]
    fn a_limit_counts_by_its_remainder() {
        assert!(is_near((100, 90), 11));
        assert!(!is_near((100, 90), 10));
        assert!(is_near((100, 200), 1));
        assert!(addresses() > 1 << 20);
    }
}
