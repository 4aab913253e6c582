//! Transfer of the list of runs from a guard to its child: a message with the list and the real standard input, on a
//! socket that the child initially has as its standard input.
//!
//! Needs no file system: the `/proc` entries of a process are closed even to its child if the program is
//! privileged.

use std::fs::File;
use std::io::{self, IoSlice, IoSliceMut};
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::net::UnixStream;

use nix::unistd::dup2_stdin;
use rustix::cmsg_space;
use rustix::net::{
    RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, SendAncillaryBuffer,
    SendAncillaryMessage, SendFlags, recvmsg, sendmsg,
};

/// Sends a list and the standard input to the child of a guard; returns the socket on which the child receives
/// them.
///
/// # Errors
/// If the system has no resources for the socket.
pub(super) fn send(guard: &str, list: &File) -> io::Result<OwnedFd> {
    let (own, of_child) = UnixStream::pair()?;
    let input = io::stdin();
    let files = [list.as_fd(), input.as_fd()];
    let mut space = [MaybeUninit::uninit(); cmsg_space!(ScmRights(2))];
    let mut message = SendAncillaryBuffer::new(&mut space);
    message.push(SendAncillaryMessage::ScmRights(&files));
    let content = [IoSlice::new(guard.as_bytes())];
    sendmsg(&own, &content, &mut message, SendFlags::NOSIGNAL)?;
    Ok(of_child.into())
}

/// Receives the list from this guard, and restores the standard input that came with it; `None`, with nothing read, if
/// the standard input is not such a socket.
pub(super) fn receive(guard: &str) -> Option<File> {
    let mut content = vec![0; guard.len()];
    let mut space = [MaybeUninit::uninit(); cmsg_space!(ScmRights(2))];
    let mut message = RecvAncillaryBuffer::new(&mut space);
    // Peeked only, so a foreign message stays for its reader. The socket is closed with the descriptor.
    let flags = RecvFlags::PEEK | RecvFlags::DONTWAIT | RecvFlags::CMSG_CLOEXEC;
    let mut parts = [IoSliceMut::new(&mut content)];
    recvmsg(io::stdin(), &mut parts, &mut message, flags).ok()?;
    let mut files = message.drain().filter_map(|part| match part {
        RecvAncillaryMessage::ScmRights(files) => Some(files),
        _ => None,
    });
    let mut files = files.next()?;
    let (list, input) = (files.next()?, files.next()?);
    if content != guard.as_bytes() {
        return None;
    }
    dup2_stdin(input).ok()?;
    Some(list.into())
}
