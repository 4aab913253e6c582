//! Disk space that is reserved for the end of a run.
//!
//! A run that fills the disk must still complete its recording and write its summary. Therefore each run reserves
//! some space at its start and releases it before its final writes. The file that holds the space has no name, so
//! nothing is left behind in any case.

use std::fs::File;
use std::path::Path;

use rustix::fs::{FallocateFlags, fallocate};

/// Reserved space in the file system of a folder.
#[derive(Debug, Default)]
pub struct Reserve(Option<File>);

impl Reserve {
    /// Reserves `bytes` bytes. If that fails, the reserve is empty: the run may manage with the available space.
    #[must_use]
    pub fn of(folder: &Path, bytes: u64) -> Self {
        let file = tempfile::tempfile_in(folder).ok();
        Self(file.filter(|file| fallocate(file, FallocateFlags::empty(), 0, bytes).is_ok()))
    }

    /// Releases the space.
    pub fn release(&mut self) {
        self.0 = None;
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::MetadataExt;

    use super::*;

    #[test]
    fn the_space_is_allocated_to_a_file_without_a_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let reserve = Reserve::of(folder.path(), 1 << 20);
        let file = reserve.0.as_ref().expect("there is room");
        assert!(file.metadata().expect("open").blocks() * 512 >= 1 << 20);
        assert_eq!(std::fs::read_dir(folder.path()).expect("read").count(), 0);
    }
}
