//! The keeper: a process that sends the safe values of a port, however the port ends.
//!
//! A dead process has no timer. So the port starts a copy of its program and keeps one end of a pair of sockets to it.
//! Through the pair the keeper gets a copy of the descriptor of each medium, again after each new connection; the port
//! writes the counters of its frames into a shared memory file. When the pair closes, at an orderly end, after a crash or
//! after `kill -9`, the keeper sends every frame of safe values some times and ends. The keeper never reads from a
//! medium, and never sends anything before the port's end.

mod process;

use std::fs::File;
use std::io::{IoSlice, IoSliceMut};
use std::mem::MaybeUninit;
use std::net::SocketAddr;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd, RawFd};
use std::os::unix::fs::FileExt;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use hil_session::process::MARK;
use hil_session::program::say;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::fs::{MemfdFlags, memfd_create};
use rustix::io::Errno;
use rustix::net::{
    AddressFamily, RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, SendAncillaryBuffer,
    SendAncillaryMessage, SendFlags, SocketFlags, SocketType, recvmsg, send, sendmsg, socketpair,
};
use rustix::time::Timespec;

use crate::medium::{Outlet, To};
use crate::wire::Wire;

pub use process::main;

/// First argument of the program as a keeper.
pub const KEEPER: &str = "keeper";
/// Longest message between port and keeper.
const LONGEST: usize = 512;
/// Answer of a keeper that is ready; any other answer is the reason why the keeper is not.
const READY: &[u8] = b"ready";
/// Message that the port ends in order.
const END: &[u8] = b"end";
/// First byte of a message about a medium, before its place in the port file, a byte, and the receiver of its frames.
/// The descriptor comes with the message, and without one nobody is there to read frames.
const MEDIUM: u8 = b'm';
/// Bytes of a counter in the memory file.
const COUNTER_BYTES: usize = size_of::<u64>();
/// Longest time until a keeper is ready.
const START_LIMIT: Timespec = Timespec {
    tv_sec: 4,
    tv_nsec: 0,
};

/// Longest time beyond that of its frames until a keeper has ended, and after its kill.
const END_LIMIT: Duration = Duration::from_secs(1);
/// Time beyond that of its frames from which the end of a keeper is late.
const LATE: Duration = Duration::from_millis(500);

/// Facts by which another end of a medium is noticed.
type End = (RawFd, u64, Option<SocketAddr>);

/// Keeper of a port.
#[derive(Debug)]
pub struct Keeper {
    process: Child,
    pair: OwnedFd,
    counters: File,
    /// Bytes of the counters that were written last.
    counted: Vec<u8>,
    /// End of each medium that the keeper has, by its place in the port file.
    ends: Vec<Option<End>>,
}

impl Keeper {
    /// Starts the keeper of a port file, and gives it what an opened wire has.
    ///
    /// # Errors
    /// If the keeper cannot be started, or is not ready.
    pub fn start(path: &Path, wire: &Wire) -> Result<Self, String> {
        let cannot = |error: std::io::Error| format!("cannot start the keeper: {error}");
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
        let mut keeper = Self {
            process,
            pair,
            counters: counters.into(),
            counted: Vec::new(),
            ends: Vec::new(),
        };
        keeper
            .give(b"counters", Some(keeper.counters.as_fd()))
            .and_then(|()| keeper.await_ready())
            .and_then(|()| keeper.follow(wire))
            .inspect_err(|_| {
                let _ = keeper.process.kill();
                let _ = keeper.process.wait();
            })?;
        Ok(keeper)
    }

    fn await_ready(&self) -> Result<(), String> {
        let mut readable = [PollFd::new(&self.pair, PollFlags::IN)];
        while poll(&mut readable, Some(&START_LIMIT)) == Err(Errno::INTR) {}
        let mut answer = [0; LONGEST];
        match rustix::net::recv(&self.pair, &mut answer, RecvFlags::DONTWAIT) {
            Ok((length, _)) if &answer[..length] == READY => Ok(()),
            Ok((0, _)) => Err("the keeper ended at its start".into()),
            Ok((length, _)) => Err(String::from_utf8_lossy(&answer[..length]).into_owned()),
            Err(error) => Err(format!("the keeper is not ready: {error}")),
        }
    }

    /// Gives the keeper what has changed since the last call: connections, receivers and counters.
    ///
    /// # Errors
    /// If the keeper is gone.
    pub fn follow(&mut self, wire: &Wire) -> Result<(), String> {
        for (medium, outlet) in wire.outlets() {
            let end = outlet.as_ref().map(end_of);
            if self.ends.len() <= medium {
                self.ends.resize(medium + 1, None);
            }
            if self.ends[medium] != end {
                let place = u8::try_from(medium).map_err(|_| "the port has too many media")?;
                let mut message = vec![MEDIUM, place];
                message.extend(outlet.map(|outlet| outlet.to.bytes()).unwrap_or_default());
                self.give(&message, outlet.map(|outlet| outlet.fd))?;
                self.ends[medium] = end;
            }
        }
        self.counted.clear();
        for counter in wire.counters() {
            self.counted.extend(counter.to_ne_bytes());
        }
        // Without room in memory the keeper goes on from the counters before.
        let _ = self.counters.write_all_at(&self.counted, 0);
        Ok(())
    }

    /// Sends a message, with a descriptor if there is one.
    fn give(&self, message: &[u8], fd: Option<BorrowedFd<'_>>) -> Result<(), String> {
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(1))];
        let mut ancillary = SendAncillaryBuffer::new(&mut space);
        let fds = fd.as_slice();
        if !fds.is_empty() {
            ancillary.push(SendAncillaryMessage::ScmRights(fds));
        }
        let content = [IoSlice::new(message)];
        sendmsg(&self.pair, &content, &mut ancillary, SendFlags::NOSIGNAL)
            .map(|_| ())
            .map_err(|error| format!("the keeper of the safe values is gone: {error}"))
    }

    /// Returns `true` if the keeper has ended.
    #[must_use]
    pub fn is_gone(&self) -> bool {
        let mut answer = [0; 1];
        let result = rustix::net::recv(&self.pair, &mut answer, RecvFlags::DONTWAIT);
        result != Err(Errno::AGAIN) && result != Err(Errno::INTR)
    }

    /// Tells the keeper of an orderly end, and waits until it has sent the safe values, which take this long; a keeper
    /// that is late is named in the log.
    ///
    /// # Errors
    /// If it has not ended in time. It is killed then, and the safe values may not have been sent.
    pub fn end(mut self, frames: Duration) -> Result<(), String> {
        let begin = Instant::now();
        let _ = send(&self.pair, END, SendFlags::NOSIGNAL);
        let limit = frames + END_LIMIT;
        let has_ended = self.await_end(begin + limit);
        let (time_s, frames_s) = (begin.elapsed().as_secs_f64(), frames.as_secs_f64());
        if has_ended {
            if begin.elapsed() > frames + LATE {
                say(&format!(
                    "the keeper took {time_s:.3} s for safe values of {frames_s:.3} s"
                ));
            }
            return Ok(());
        }
        let _ = self.process.kill();
        let is_killed = self.await_end(Instant::now() + END_LIMIT);
        let outcome = match is_killed {
            true => "it was killed",
            false => "it cannot be killed, because the system holds it",
        };
        Err(format!(
            "the keeper has not ended within {time_s:.3} s, for safe values of {frames_s:.3} s; {outcome}"
        ))
    }

    /// Waits for the end of the keeper and reaps it; returns `false` if it lives on at a time.
    fn await_end(&mut self, until: Instant) -> bool {
        loop {
            let left = until.saturating_duration_since(Instant::now());
            let limit = Timespec::try_from(left).unwrap_or(START_LIMIT);
            // Its end of the pair closes with it.
            let mut closed = [PollFd::new(&self.pair, PollFlags::empty())];
            match poll(&mut closed, Some(&limit)) {
                Ok(0) => return false,
                Err(Errno::INTR) => {}
                Ok(_) | Err(_) => {
                    let _ = self.process.wait();
                    return true;
                }
            }
        }
    }
}

fn end_of(outlet: &Outlet<'_>) -> End {
    let address = match outlet.to {
        To::Address(address) => Some(address),
        To::Connected | To::Path(_) => None,
    };
    (outlet.fd.as_raw_fd(), outlet.connection, address)
}

/// Receives a message into a buffer; returns its length, 0 at the port's end, and the descriptor that came with it.
fn receive(pair: &OwnedFd, buffer: &mut [u8]) -> Result<(usize, Option<OwnedFd>), Errno> {
    let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(1))];
    let mut ancillary = RecvAncillaryBuffer::new(&mut space);
    let mut parts = [IoSliceMut::new(buffer)];
    let flags = RecvFlags::CMSG_CLOEXEC | RecvFlags::DONTWAIT;
    let length = recvmsg(pair, &mut parts, &mut ancillary, flags)?.bytes;
    let mut fd = None;
    for message in ancillary.drain() {
        if let RecvAncillaryMessage::ScmRights(fds) = message {
            fd = fds.last();
        }
    }
    Ok((length, fd))
}
