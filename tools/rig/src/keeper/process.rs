//! The keeper's own process.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::net::{SocketAddr, UdpSocket};
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::time::Duration;

use hil_codec::pack::Packer;
use hil_config::port::Port;
use hil_session::program::say;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;
use rustix::net::{RecvFlags, SendFlags, recv, send};
use rustix::time::Timespec;
use shared_types::quality::SignalSet;

use super::{COUNTER_BYTES, END, LONGEST, PEER, READY, receive_descriptors};
use crate::description::packers;

/// Time from one feed of the watchdog to the next. Hardware watchdogs have limits of several seconds.
const FEED: Timespec = Timespec {
    tv_sec: 0,
    tv_nsec: 500_000_000,
};
/// Byte that tells a watchdog device that its closing is meant (Linux, watchdog-api).
const MAGIC_CLOSE: &[u8] = b"V";

/// State of a keeper.
struct Holder {
    pair: OwnedFd,
    counters: File,
    sockets: Vec<UdpSocket>,
    peers: Vec<Option<SocketAddr>>,
    packers: Vec<(Packer, usize)>,
    safe: Vec<f64>,
    repeats: u32,
    period: Duration,
    watchdog: Option<File>,
}

/// Runs the keeper of a port file, whose other end is standard input.
///
/// # Errors
/// If it cannot begin; the port gets the reason as well.
pub fn main(path: &Path) -> Result<(), String> {
    let pair = std::io::stdin().as_fd().try_clone_to_owned();
    let pair = pair.map_err(|error| error.to_string())?;
    let holder = match Holder::new(path, pair) {
        Ok(holder) => holder,
        Err((pair, reason)) => {
            let length = reason.len().min(LONGEST);
            let _ = send(&pair, &reason.as_bytes()[..length], SendFlags::NOSIGNAL);
            return Err(reason);
        }
    };
    holder.keep();
    Ok(())
}

impl Holder {
    fn new(path: &Path, pair: OwnedFd) -> Result<Self, (OwnedFd, String)> {
        match Self::parts(path, &pair) {
            Ok((counters, sockets, port, packers, safe, watchdog)) => Ok(Self {
                pair,
                counters,
                peers: vec![None; sockets.len()],
                sockets,
                packers,
                safe,
                repeats: port.safety.repeats,
                period: Duration::from_secs_f64(port.safety.period_s),
                watchdog,
            }),
            Err(reason) => Err((pair, reason)),
        }
    }

    #[expect(clippy::type_complexity, reason = "named by the only caller")]
    fn parts(
        path: &Path,
        pair: &OwnedFd,
    ) -> Result<
        (
            File,
            Vec<UdpSocket>,
            Port,
            Vec<(Packer, usize)>,
            Vec<f64>,
            Option<File>,
        ),
        String,
    > {
        let descriptors = receive_descriptors(pair);
        let mut descriptors = descriptors.map_err(|error| error.to_string())?.into_iter();
        let counters = descriptors.next().ok_or("the port sent no descriptors")?;
        let port = Port::read(path, None).map_err(|problems| problems.to_string())?;
        let watchdog = match &port.safety.watchdog {
            None => None,
            Some(device) => Some(open_watchdog(device)?),
        };
        let (packers, safe) = (packers(&port)?, port.safe_row()?);
        let sockets = descriptors.map(UdpSocket::from).collect();
        Ok((counters.into(), sockets, port, packers, safe, watchdog))
    }

    /// Waits for the end of the port, sends the safe values, and disarms the watchdog after an orderly end.
    fn keep(mut self) {
        let _ = send(&self.pair, READY, SendFlags::NOSIGNAL);
        let is_orderly = self.wait();
        self.send_safe();
        if let Some(watchdog) = self.watchdog.as_mut().filter(|_| is_orderly) {
            let _ = watchdog.write_all(MAGIC_CLOSE);
        }
    }

    /// Waits for the end of the port; returns `true` if it was an orderly one.
    fn wait(&mut self) -> bool {
        let mut message = [0; LONGEST];
        loop {
            self.feed();
            let limit = self.watchdog.as_ref().map(|_| &FEED);
            let mut readable = [PollFd::new(&self.pair, PollFlags::IN)];
            match poll(&mut readable, limit) {
                Ok(0) | Err(Errno::INTR) => continue,
                _ => {}
            }
            match recv(&self.pair, &mut message, RecvFlags::DONTWAIT) {
                Err(Errno::AGAIN | Errno::INTR) => {}
                Ok((length, _)) if length > 0 => {
                    let message = &message[..length];
                    if message == END {
                        return true;
                    }
                    self.note_peer(message);
                }
                _ => return false,
            }
        }
    }

    fn note_peer(&mut self, message: &[u8]) {
        if let [PEER, medium, address @ ..] = message
            && let Some(peer) = self.peers.get_mut(usize::from(*medium))
        {
            *peer = std::str::from_utf8(address)
                .ok()
                .and_then(|text| text.parse().ok());
        }
    }

    fn feed(&mut self) {
        if let Some(watchdog) = &mut self.watchdog {
            let _ = watchdog.write_all(&[0]);
        }
    }

    fn send_safe(&mut self) {
        for (frame, (packer, _)) in self.packers.iter_mut().enumerate() {
            let mut bytes = [0; COUNTER_BYTES];
            let place = (frame * COUNTER_BYTES) as u64;
            if self.counters.read_exact_at(&mut bytes, place).is_ok() {
                packer.continue_at(u64::from_ne_bytes(bytes));
            }
        }
        for repeat in 0..self.repeats {
            if repeat > 0 {
                std::thread::sleep(self.period);
            }
            for (packer, medium) in &mut self.packers {
                let bytes = packer.pack(&self.safe, &SignalSet::EMPTY);
                if let (Some(socket), Some(Some(peer))) =
                    (self.sockets.get(*medium), self.peers.get(*medium))
                {
                    // The port left it non-blocking; a full buffer is no reason to give up the others.
                    let _ = socket.send_to(bytes, peer);
                }
            }
            self.feed();
        }
    }
}

fn open_watchdog(device: &str) -> Result<File, String> {
    let opened = OpenOptions::new().write(true).open(device);
    opened.map_err(|error| {
        let text = format!("watchdog {device}: {error}; check `watchdog` in the port file, and that this user may open it");
        say(&text);
        text
    })
}
