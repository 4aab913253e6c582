//! Sending in the stead of a process that is gone: the keeper gets a copy of the descriptor of each medium, and makes a
//! medium of it that only sends.

use std::io::{self, ErrorKind};
use std::os::fd::{BorrowedFd, OwnedFd};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};

use hil_config::port::MediumKind;

use super::can::{Cannelloni, Interface};
use super::datagram::{Udp, Unix};
use super::file::File;
use super::stream::Stream;
use super::{Cut, Medium};

/// Makes a medium that sends on the copy of a descriptor, to a receiver in the form of [`To::bytes`](super::To::bytes).
///
/// # Errors
/// If the descriptor and the receiver are none of such a medium.
pub fn adopt(kind: &MediumKind, fd: OwnedFd, to: &[u8]) -> io::Result<Box<dyn Medium>> {
    let udp = |fd: OwnedFd| {
        let address = std::str::from_utf8(to).ok();
        let address = address.and_then(|text| text.parse().ok());
        Ok::<_, io::Error>(Udp::adopt(
            fd.into(),
            address.ok_or(ErrorKind::InvalidData)?,
        ))
    };
    Ok(match kind {
        MediumKind::Udp { .. } => Box::new(udp(fd)?),
        MediumKind::Cannelloni { .. } => Box::new(Cannelloni::new(udp(fd)?)),
        MediumKind::Unix {
            is_stream: false, ..
        } => {
            let path = PathBuf::from(std::ffi::OsStr::from_bytes(to));
            Box::new(Unix::adopt(fd.into(), path))
        }
        MediumKind::Tcp { .. } => Box::new(Stream::tcp_end(fd.into())),
        MediumKind::Unix { .. } => Box::new(Stream::unix_end(fd.into())),
        MediumKind::Serial { .. } => Box::new(Stream::serial(fd.into(), no_cut())),
        MediumKind::File { .. } => Box::new(File::adopt(fd.into())),
        MediumKind::Can { .. } => Box::new(Interface::adopt(fd)),
    })
}

/// Opens a medium of which there is no descriptor, if that one connects to its peer by itself.
pub fn connecting(kind: &MediumKind, folder: &Path) -> Option<Box<dyn Medium>> {
    match kind {
        MediumKind::Tcp {
            address,
            listens: false,
        } => Some(Box::new(Stream::tcp(*address, no_cut()))),
        MediumKind::Unix {
            path,
            is_stream: true,
            listens: false,
        } => Some(Box::new(Stream::unix(folder.join(path), no_cut()))),
        _ => None,
    }
}

/// Returns the path that a killed process leaves of a medium, on whose descriptor the process sent.
pub fn path_of(kind: &MediumKind, folder: &Path, fd: Option<BorrowedFd<'_>>) -> Option<PathBuf> {
    match kind {
        MediumKind::Unix {
            path,
            listens: true,
            ..
        } => Some(folder.join(path)),
        MediumKind::Unix {
            is_stream: false, ..
        } => {
            let socket = UnixDatagram::from(fd?.try_clone_to_owned().ok()?);
            Some(socket.local_addr().ok()?.as_pathname()?.to_owned())
        }
        _ => None,
    }
}

/// Returns the ends of frames on a stream that is only written.
const fn no_cut() -> Cut {
    Cut::Lengths(Vec::new())
}
