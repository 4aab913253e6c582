//! The properties that every link must have, checked for this link.

use shared_types::conformance;
use shared_types::conformance::link::{Fixture, Opener};
use tempfile::TempDir;
use unix_socket_link::link::UnixSocketLink;

/// Folder in which sockets meet.
struct Folder(TempDir);

impl Fixture for Folder {
    type Link = UnixSocketLink;

    fn new() -> Self {
        Self(tempfile::tempdir().expect("a folder"))
    }

    fn plant(&mut self) -> UnixSocketLink {
        UnixSocketLink::create(self.0.path()).expect("the plant's end")
    }

    fn controller(&mut self, epoch: u32) -> UnixSocketLink {
        UnixSocketLink::open(self.0.path(), epoch).expect("a controller's end")
    }

    fn controller_elsewhere(&mut self) -> Option<Opener<UnixSocketLink>> {
        let folder = self.0.path().to_owned();
        let opens = move || UnixSocketLink::open(&folder, 1).expect("a controller's end");
        Some(Box::new(opens))
    }
}

conformance!(link: Folder);
