//! The keeper: a process that sends the safe values of a port, however the port ends.
//!
//! A dead process has no timer. So the port starts a copy of its program, gives it its sockets and one end of a pair of
//! sockets, and writes the counters of its frames into a shared memory file. When the pair closes, at an orderly end,
//! after a crash or after `kill -9`, the keeper sends every frame of safe values some times and ends. The keeper never
//! reads from a medium, and never sends anything before the port's end.

mod process;

use std::fs::File;
use std::io::{IoSlice, IoSliceMut};
use std::mem::MaybeUninit;
use std::net::SocketAddr;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::fs::FileExt;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use hil_session::process::MARK;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::fs::{MemfdFlags, memfd_create};
use rustix::io::Errno;
use rustix::net::{
    AddressFamily, RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, SendAncillaryBuffer,
    SendAncillaryMessage, SendFlags, SocketFlags, SocketType, recvmsg, send, sendmsg, socketpair,
};
use rustix::time::Timespec;

use crate::media::Socket;

pub use process::main;

/// First argument of the program as a keeper.
pub const KEEPER: &str = "keeper";
/// Longest message between port and keeper.
const LONGEST: usize = 512;
/// Largest number of media.
const MOST_MEDIA: usize = 32;
/// Answer of a keeper that is ready; any other answer is the reason why the keeper is not.
const READY: &[u8] = b"ready";
/// Message that the port ends in order.
const END: &[u8] = b"end";
/// First byte of a message with the address of a peer, before the index of the medium and the address.
const PEER: u8 = b'p';
/// Bytes of a counter in the memory file.
const COUNTER_BYTES: usize = size_of::<u64>();
/// Longest time until a keeper is ready.
const START_LIMIT: Timespec = Timespec {
    tv_sec: 4,
    tv_nsec: 0,
};

/// Keeper of a port.
#[derive(Debug)]
pub struct Keeper {
    process: Child,
    pair: OwnedFd,
    counters: File,
}

impl Keeper {
    /// Starts a keeper for these sockets of a port file.
    ///
    /// # Errors
    /// If the keeper cannot be started, or is not ready.
    pub fn start(path: &Path, sockets: &[Socket]) -> Result<Self, String> {
        let cannot = |error: std::io::Error| format!("cannot start the keeper: {error}");
        if sockets.len() > MOST_MEDIA {
            return Err(format!(
                "a port in front of a plant has at most {MOST_MEDIA} media"
            ));
        }
        let (pair, theirs) = socketpair(
            AddressFamily::UNIX,
            SocketType::SEQPACKET,
            SocketFlags::CLOEXEC,
            None,
        )
        .map_err(|error| cannot(error.into()))?;
        let counters =
            memfd_create("counters", MemfdFlags::CLOEXEC).map_err(|error| cannot(error.into()))?;
        let program = std::env::current_exe().map_err(cannot)?;
        let mut command = Command::new(program);
        command.arg(KEEPER).arg(path);
        // Whoever ends the port and all that it started, by group or by mark, does not end its keeper.
        command.env_remove(MARK).process_group(0);
        command.stdin(Stdio::from(theirs)).stdout(Stdio::null());
        let process = command.spawn().map_err(cannot)?;
        drop(command); // and with it this process's copy of the other end
        let fds: Vec<BorrowedFd<'_>> = std::iter::once(counters.as_fd())
            .chain(sockets.iter().map(|socket| socket.socket.as_fd()))
            .collect();
        send_descriptors(&pair, &fds).map_err(|error| cannot(error.into()))?;
        let mut keeper = Self {
            process,
            pair,
            counters: counters.into(),
        };
        keeper.await_ready()?;
        for (index, socket) in sockets.iter().enumerate() {
            keeper.tell_peer(index, socket.peer)?;
        }
        Ok(keeper)
    }

    fn await_ready(&mut self) -> Result<(), String> {
        let mut readable = [PollFd::new(&self.pair, PollFlags::IN)];
        while poll(&mut readable, Some(&START_LIMIT)) == Err(Errno::INTR) {}
        let mut answer = [0; LONGEST];
        match rustix::net::recv(&self.pair, &mut answer, RecvFlags::DONTWAIT) {
            Ok((length, _)) if &answer[..length] == READY => Ok(()),
            Ok((0, _)) => Err("the keeper ended at its start".into()),
            Ok((length, _)) => Err(String::from_utf8_lossy(&answer[..length]).into_owned()),
            Err(error) => {
                let _ = self.process.kill();
                Err(format!("the keeper is not ready: {error}"))
            }
        }
    }

    /// Tells the address of the peer of a medium.
    ///
    /// # Errors
    /// If the keeper is gone.
    pub fn tell_peer(&self, medium: usize, peer: Option<SocketAddr>) -> Result<(), String> {
        let Some(peer) = peer else {
            return Ok(());
        };
        let mut message = vec![PEER, medium as u8];
        message.extend(peer.to_string().bytes());
        send(&self.pair, &message, SendFlags::NOSIGNAL)
            .map(|_| ())
            .map_err(|error| format!("the keeper of the safe values is gone: {error}"))
    }

    /// Notes the next counter of a frame, by its place among the frames of commands.
    pub fn note_counter(&self, frame: usize, counter: u64) {
        // Without room in memory the keeper goes on from the counter before.
        let _ =
            (self.counters).write_all_at(&counter.to_ne_bytes(), (frame * COUNTER_BYTES) as u64);
    }

    /// Returns `true` if the keeper has ended.
    #[must_use]
    pub fn is_gone(&self) -> bool {
        let mut answer = [0; 1];
        let result = rustix::net::recv(&self.pair, &mut answer, RecvFlags::DONTWAIT);
        result != Err(Errno::AGAIN) && result != Err(Errno::INTR)
    }

    /// Tells the keeper of an orderly end, and waits until it has sent the safe values.
    pub fn end(mut self) {
        let _ = send(&self.pair, END, SendFlags::NOSIGNAL);
        // Its number of frames is limited, so it ends by itself.
        let _ = self.process.wait();
    }
}

/// Sends descriptors in one message.
fn send_descriptors(pair: &OwnedFd, fds: &[BorrowedFd<'_>]) -> Result<(), Errno> {
    let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(MOST_MEDIA + 1))];
    let mut ancillary = SendAncillaryBuffer::new(&mut space);
    ancillary.push(SendAncillaryMessage::ScmRights(fds));
    let content = [IoSlice::new(b"fds")];
    sendmsg(pair, &content, &mut ancillary, SendFlags::NOSIGNAL).map(|_| ())
}

/// Receives descriptors, and the content of the message.
fn receive_descriptors(pair: &OwnedFd) -> Result<Vec<OwnedFd>, Errno> {
    let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(MOST_MEDIA + 1))];
    let mut ancillary = RecvAncillaryBuffer::new(&mut space);
    let mut content = [0; LONGEST];
    let mut parts = [IoSliceMut::new(&mut content)];
    recvmsg(pair, &mut parts, &mut ancillary, RecvFlags::CMSG_CLOEXEC)?;
    let messages = ancillary.drain();
    Ok(messages
        .filter_map(|message| match message {
            RecvAncillaryMessage::ScmRights(fds) => Some(fds),
            _ => None,
        })
        .flatten()
        .collect())
}
