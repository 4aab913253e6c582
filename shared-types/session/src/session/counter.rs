//! The node counter, the only file of a session that iceoryx2 would leave open to everybody.
//!
//! The session creates the file before iceoryx2 looks for it, so that iceoryx2 uses it as is and the file is never open
//! to others. Its name and content match the version of iceoryx2 that the workspace pins.

use std::fs::File;
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use super::{SHARED_MEMORY, SessionInfo};

/// File name after the session's prefix: a hash of the content's type, the name, the version and the kind.
const NAME: &str = "9204dd183d1c4d8e1ff592a30766ffa6765aa8b5_node.0_10_0.global_mgmt";
/// Version 0.10.0 as a 64-bit number, a 32-bit counter, and padding.
const CONTENT: [u8; 16] = [0, 0, 10, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];

impl SessionInfo {
    /// Returns the path of the session's node counter.
    pub(super) fn node_counter(&self) -> PathBuf {
        Path::new(SHARED_MEMORY).join(format!("{}{NAME}", self.prefix))
    }

    /// Creates the node counter, closed to other users.
    pub(super) fn make_node_counter(&self) -> io::Result<()> {
        let mut options = File::options();
        // A new file, no link: an existing one may be another user's.
        options.write(true).create_new(true).mode(0o600);
        options.open(self.node_counter())?.write_all(&CONTENT)
    }

    /// Fails unless the node counter is the session's only file outside its folder.
    pub(super) fn check_node_counter(&self) -> io::Result<()> {
        let counter = self.node_counter();
        let others = self.segments().into_iter().find(|path| *path != counter);
        others.map_or(Ok(()), |other| {
            let reason = format!(
                "iceoryx2 created {} instead of using the existing file; is it another version?",
                other.display()
            );
            Err(io::Error::new(ErrorKind::Unsupported, reason))
        })
    }
}
