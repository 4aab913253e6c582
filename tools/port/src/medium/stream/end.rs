//! Connected ends of streams.

use std::fs::File;
use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;

use rustix::net::sockopt::socket_peercred;

/// Connected end.
#[derive(Debug)]
pub(super) enum End {
    Tcp(TcpStream),
    Unix(UnixStream),
    Line(File),
}

impl End {
    /// Makes reading and writing return at once; returns `false` if the end is connected to itself, as happens on a port
    /// of this machine without a listener.
    pub(super) fn prepare(&self) -> io::Result<bool> {
        match self {
            Self::Tcp(stream) => {
                if stream.local_addr()? == stream.peer_addr()? {
                    return Ok(false);
                }
                // A frame must not wait for the next one.
                stream.set_nodelay(true)?;
                stream.set_nonblocking(true)?;
            }
            Self::Unix(stream) => stream.set_nonblocking(true)?,
            Self::Line(_) => {}
        }
        Ok(true)
    }

    pub(super) fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => stream.read(buffer),
            Self::Unix(stream) => stream.read(buffer),
            Self::Line(line) => line.read(buffer),
        }
    }

    pub(super) fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => stream.write(bytes),
            Self::Unix(stream) => stream.write(bytes),
            Self::Line(line) => line.write(bytes),
        }
    }

    pub(super) fn fd(&self) -> BorrowedFd<'_> {
        match self {
            Self::Tcp(stream) => stream.as_fd(),
            Self::Unix(stream) => stream.as_fd(),
            Self::Line(line) => line.as_fd(),
        }
    }

    /// Returns the program at the other end as a text: its address, or its process on this machine.
    pub(super) fn other(&self) -> String {
        let name = match self {
            Self::Tcp(stream) => stream.peer_addr().ok().map(|address| address.to_string()),
            Self::Unix(stream) => (socket_peercred(stream).ok())
                .map(|peer| format!("process {}", peer.pid.as_raw_nonzero())),
            Self::Line(_) => None,
        };
        name.unwrap_or_else(|| "a program without an address".into())
    }
}
