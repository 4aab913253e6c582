//! Checks of memory: mechanisms that move it, and the space that sessions need.

use hil_session::shared_memory::{LEAST_INODES, SharedMemory};
use shared_types::number::counted;

use super::checks::{HUGE_PAGES, SHARED_MEMORY, SWAP};
use super::finding::{Finding, known};
use super::tree::Tree;

const MIB: u64 = 1 << 20;
/// Sufficient for sessions of a thousand signals, whose records have 8 KiB and whose four observers may lag 8192
/// records each.
const AMPLE_BYTES: u64 = 512 * MIB;
/// Sufficient for a session of about fifty signals, which takes half of it.
const ENOUGH_BYTES: u64 = 64 * MIB;

/// Checks for transparent huge pages.
pub(crate) fn huge_pages(tree: &dyn Tree) -> Finding {
    const FILE: &str = "sys/kernel/mm/transparent_hugepage/enabled";
    let text = match tree.read(FILE) {
        Ok(text) => text,
        Err(_) if tree.has("sys/kernel/mm") => {
            return HUGE_PAGES.good("the kernel has no transparent ones");
        }
        Err(unread) => return HUGE_PAGES.unread(&unread),
    };
    let mode = (text.split_once('[')).and_then(|(_, rest)| rest.split_once(']'));
    match mode {
        Some(("always", _)) => HUGE_PAGES
            .fair("transparent: always")
            .mend(format!("echo madvise | sudo tee /{FILE}")),
        Some((mode, _)) => HUGE_PAGES.good(format!("transparent: {mode}")),
        None => HUGE_PAGES.unknown(text),
    }
}

/// Checks for memory that is or may be swapped out.
pub(crate) fn swap(tree: &dyn Tree) -> Finding {
    let text = match tree.read("proc/swaps") {
        Ok(text) => text,
        // Kernels without swap support lack the file.
        Err(_) if tree.has("proc/version") => return SWAP.good("the kernel cannot swap"),
        Err(unread) => return SWAP.unread(&unread),
    };
    let mut total_kib = 0;
    let mut used_kib = 0;
    for row in text.lines().skip(1) {
        // Parsed from the end, since a file name may contain spaces.
        let mut fields = row.split_ascii_whitespace().rev().skip(1);
        let mut number = || fields.next().and_then(|field| field.parse::<u64>().ok());
        let (Some(used), Some(size)) = (number(), number()) else {
            return SWAP.unknown(format!("/proc/swaps contains `{row}`"));
        };
        total_kib += size;
        used_kib += used;
    }
    let text = format!("{} of {} MiB in use", used_kib / 1024, total_kib / 1024);
    match (total_kib, used_kib) {
        (0, _) => SWAP.good("none"),
        (_, 0) => SWAP.fair(text).mend("sudo swapoff -a"),
        _ => SWAP.poor(text).mend("sudo swapoff -a"),
    }
}

/// Checks that `/dev/shm` is in memory and has space for this user; `state` is the state of the file system.
pub(crate) fn shared_memory(tree: &dyn Tree, state: Option<SharedMemory>) -> Finding {
    let mounts = known!(SHARED_MEMORY, tree.read("proc/self/mounts"));
    let mount = "sudo mount -t tmpfs -o mode=1777,nosuid,nodev tmpfs /dev/shm";
    // The last mount hides earlier ones.
    let kind = mounts.lines().rev().find_map(|line| {
        let mut fields = line.split_ascii_whitespace().skip(1);
        (fields.next() == Some("/dev/shm")).then(|| fields.next().unwrap_or_default())
    });
    match kind {
        None => SHARED_MEMORY.poor("/dev/shm is not mounted").mend(mount),
        Some("tmpfs") => {
            let Some(shared) = state else {
                return SHARED_MEMORY.unknown("tmpfs, but its free space is unknown");
            };
            room(shared)
        }
        Some(other) => SHARED_MEMORY
            .poor(format!("/dev/shm is {other}, not memory"))
            .mend(mount),
    }
}

/// Checks permissions and space for a run.
fn room(shared: SharedMemory) -> Finding {
    if shared.is_read_only {
        let mend = "sudo mount -o remount,rw /dev/shm";
        return SHARED_MEMORY.poor("tmpfs, read-only").mend(mend);
    }
    if !shared.is_open {
        let text = "tmpfs, but this user may not write to it";
        return (SHARED_MEMORY.poor(text)).mend("sudo chmod 1777 /dev/shm");
    }
    if let Some(count) = shared.free_inodes.filter(|count| *count < LEAST_INODES) {
        let text = format!(
            "tmpfs, {}; a run takes up to {LEAST_INODES}",
            counted(count, "free inode")
        );
        return (SHARED_MEMORY.poor(text)).mend("sudo mount -o remount,nr_inodes=1m /dev/shm");
    }
    let text = format!("tmpfs, {} MiB free", shared.free_bytes / MIB);
    let grow = "sudo mount -o remount,size=1G /dev/shm";
    match shared.free_bytes {
        AMPLE_BYTES.. => SHARED_MEMORY.good(text),
        ENOUGH_BYTES.. => SHARED_MEMORY.fair(text).mend(grow),
        _ => SHARED_MEMORY.poor(text).mend(grow),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Grade;
    use crate::tree::Fake;

    #[test]
    fn transparent_huge_pages_are_fair() {
        let file = "sys/kernel/mm/transparent_hugepage/enabled";
        let off = format!("echo madvise | sudo tee /{file}");
        for (text, grade, mend) in [
            ("always madvise [never]", Grade::Good, None),
            ("always [madvise] never", Grade::Good, None),
            ("[always] madvise never", Grade::Fair, Some(off.as_str())),
            ("sometimes", Grade::Unknown, None),
        ] {
            let finding = huge_pages(&Fake::new(&[(file, text)]));
            assert_eq!((finding.grade, finding.mend.as_deref()), (grade, mend));
        }
        let without = Fake::new(&[("sys/kernel/mm/ksm/run", "0")]);
        assert_eq!(huge_pages(&without).grade, Grade::Good);
        assert_eq!(huge_pages(&Fake::default()).grade, Grade::Unknown);
    }

    #[test]
    fn used_swap_is_poor_and_unused_swap_fair() {
        let header = "Filename\t\t\t\tType\t\tSize\t\tUsed\t\tPriority\n";
        for (rows, grade, expected) in [
            ("", Grade::Good, "none"),
            (
                "/dev/nvme0n1p3                          partition\t8388604\t\t0\t\t-2\n",
                Grade::Fair,
                "0 of 8191 MiB in use",
            ),
            (
                "/dev/zram0 partition\t4194300\t\t0\t\t100\n/my swap file file\t2097148\t\t524288\t\t-3\n",
                Grade::Poor,
                "512 of 6143 MiB in use",
            ),
            ("/dev/sda partition much\n", Grade::Unknown, "much"),
        ] {
            let finding = swap(&Fake::new(&[("proc/swaps", format!("{header}{rows}"))]));
            assert_eq!(finding.grade, grade, "{rows}");
            assert!(finding.found.contains(expected), "{}", finding.found);
        }
        let without = Fake::new(&[("proc/version", "Linux version 6.1.0")]);
        assert_eq!(swap(&without).grade, Grade::Good);
    }

    #[test]
    fn shared_memory_must_be_in_memory_and_have_space() {
        let tmpfs = "proc /proc proc rw 0 0\ntmpfs /dev/shm tmpfs rw,nosuid,nodev 0 0\n";
        let disk = "tmpfs /dev/shm tmpfs rw 0 0\n/dev/sda1 /dev/shm ext4 rw 0 0\n";
        for (mounts, free_mib, grade) in [
            (tmpfs, Some(12_000), Grade::Good),
            (tmpfs, Some(512), Grade::Good),
            (tmpfs, Some(511), Grade::Fair),
            (tmpfs, Some(64), Grade::Fair),
            (tmpfs, Some(63), Grade::Poor),
            (tmpfs, None, Grade::Unknown),
            (disk, Some(12_000), Grade::Poor),
            ("proc /proc proc rw 0 0\n", Some(12_000), Grade::Poor),
        ] {
            let machine = Fake::new(&[("proc/self/mounts", mounts)]);
            let state = free_mib.map(|mib: u64| SharedMemory {
                free_bytes: mib * 1024 * 1024,
                ..AMPLE
            });
            let finding = shared_memory(&machine, state);
            assert_eq!(finding.grade, grade, "{mounts} {free_mib:?}");
            let mends = matches!(grade, Grade::Fair | Grade::Poor);
            assert_eq!(finding.mend.is_some(), mends);
        }
    }

    const AMPLE: SharedMemory = SharedMemory {
        is_read_only: false,
        is_open: true,
        free_bytes: AMPLE_BYTES,
        free_inodes: Some(1 << 20),
    };

    #[test]
    fn unusable_shared_memory_is_poor_at_any_size() {
        let (is_read_only, free_inodes) = (true, Some(3));
        for (state, expected, mend) in [
            (
                SharedMemory {
                    is_read_only,
                    ..AMPLE
                },
                "read-only",
                "remount,rw",
            ),
            (
                SharedMemory {
                    is_open: false,
                    ..AMPLE
                },
                "may not write",
                "chmod",
            ),
            (
                SharedMemory {
                    free_inodes,
                    ..AMPLE
                },
                "3 free inodes",
                "nr_inodes",
            ),
        ] {
            let finding = room(state);
            assert_eq!(finding.grade, Grade::Poor, "{expected}");
            assert!(finding.found.contains(expected), "{}", finding.found);
            assert!(finding.mend.unwrap_or_default().contains(mend));
        }
        let unlimited = SharedMemory {
            free_inodes: None,
            ..AMPLE
        };
        assert_eq!(room(unlimited).grade, Grade::Good);
    }
}
