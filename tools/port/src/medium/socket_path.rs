//! Paths of sockets: made, compared and removed by what they lead to, because other programs use the same names.

use std::fs::Metadata;
use std::io::{self, ErrorKind};
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};

/// Device and inode.
type Identity = (u64, u64);

fn identity(of_path: &Metadata) -> Identity {
    (of_path.dev(), of_path.ino())
}

/// Path of a socket that this port made. At the end it is removed, unless another program has bound it meanwhile.
///
/// Must be dropped before its socket: an open one keeps its inode, which would otherwise name another file.
#[derive(Debug)]
pub(super) struct SocketPath {
    path: PathBuf,
    identity: Option<Identity>,
}

impl SocketPath {
    /// Binds a socket to a path, which may be left of a killed port.
    ///
    /// # Errors
    /// If the path is in use, or cannot be made.
    pub(super) fn bind<S>(
        path: &Path,
        bind: impl FnOnce(&Path) -> io::Result<S>,
    ) -> io::Result<(Self, S)> {
        remove_if_left(path);
        let socket = bind(path)?;
        let of_path = std::fs::symlink_metadata(path).ok();
        let own = Self {
            path: path.into(),
            identity: of_path.as_ref().map(identity),
        };
        Ok((own, socket))
    }

    /// Returns the path of a socket that another process made and removes.
    pub(super) fn of_another() -> Self {
        Self {
            path: PathBuf::new(),
            identity: None,
        }
    }

    /// Returns the path that another socket's name leads to: a relative name is in the folder of this one.
    pub(super) fn resolve(&self, name: &Path) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(name)
    }
}

impl Drop for SocketPath {
    fn drop(&mut self) {
        let of_path = std::fs::symlink_metadata(&self.path).ok();
        if self.identity.is_some() && of_path.as_ref().map(identity) == self.identity {
            // One that is gone already needs no removal.
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// Returns `true` if a path leads to a socket, or to nothing yet.
pub(super) fn is_socket_or_free(path: &Path) -> bool {
    std::fs::metadata(path).map_or(true, |of_path| of_path.file_type().is_socket())
}

/// Returns `true` if two paths lead to one file.
pub(super) fn is_same(one: &Path, other: &Path) -> bool {
    let of = |path| std::fs::metadata(path).ok().as_ref().map(identity);
    one == other || of(one).is_some_and(|one| of(other) == Some(one))
}

/// Removes the path of a socket that nobody has open, as a killed port leaves it.
pub fn remove_if_left(path: &Path) {
    let is_socket =
        std::fs::symlink_metadata(path).is_ok_and(|of_path| of_path.file_type().is_socket());
    // A socket of either type refuses if nobody has it open; else it accepts, or is of the other type.
    let is_left = || {
        UnixDatagram::unbound()
            .and_then(|socket| socket.connect(path))
            .is_err_and(|error| error.kind() == ErrorKind::ConnectionRefused)
    };
    if is_socket && is_left() {
        // Without it `bind` fails, and says so.
        let _ = std::fs::remove_file(path);
    }
}
