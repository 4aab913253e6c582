//! Room on a disk that is kept for the end of a run.
//!
//! A run that fills the disk must still end its recording and write its summary. So each keeps some room
//! from the start and gives it back before it writes its last. The file that holds it has no name:
//! whatever happens, nothing of it is left.

use std::fs::File;
use std::path::Path;

use rustix::fs::{FallocateFlags, fallocate};

/// Room in the file system of a folder.
#[derive(Debug, Default)]
pub struct Reserve(Option<File>);

impl Reserve {
    /// Keeps N bytes. If they cannot be kept, the reserve is empty: the run may need no more than
    /// there is.
    #[must_use]
    pub fn of(folder: &Path, bytes: u64) -> Self {
        let file = tempfile::tempfile_in(folder).ok();
        Self(file.filter(|file| fallocate(file, FallocateFlags::empty(), 0, bytes).is_ok()))
    }

    /// Gives the room back.
    pub fn release(&mut self) {
        self.0 = None;
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::MetadataExt;

    use super::*;

    #[test]
    fn the_room_is_really_taken_and_has_no_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let reserve = Reserve::of(folder.path(), 1 << 20);
        let file = reserve.0.as_ref().expect("there is room");
        assert!(file.metadata().expect("open").blocks() * 512 >= 1 << 20);
        assert_eq!(std::fs::read_dir(folder.path()).expect("read").count(), 0);
    }
}
