//! The keeper's own process.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

use hil_codec::frame::CanId;
use hil_codec::pack::Packer;
use hil_config::port::{Carries, Port};
use hil_session::program::say;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::fs::OFlags;
use rustix::io::Errno;
use rustix::net::{SendFlags, send};
use rustix::time::Timespec;
use shared_types::quality::SignalSet;

use super::{COUNTER_BYTES, END, LONGEST, MEDIUM, READY, receive};
use crate::medium::{self, Medium, adopt, connecting, path_of, remove_if_left};

/// Time from one feed of the watchdog to the next. Hardware watchdogs have limits of several seconds.
const FEED: Timespec = Timespec {
    tv_sec: 0,
    tv_nsec: 500_000_000,
};
/// Byte that tells a watchdog device that its closing is meant (Linux, watchdog-api).
const MAGIC_CLOSE: &[u8] = b"V";

/// Safe frame.
struct Safe {
    packer: Packer,
    id: Option<CanId>,
    medium: usize,
}

/// State of a keeper.
struct Holder {
    folder: PathBuf,
    port: Port,
    counters: File,
    /// Descriptor and receiver of each medium, by its place in the port file.
    ends: Vec<Option<(OwnedFd, Vec<u8>)>>,
    frames: Vec<Safe>,
    values: Vec<f64>,
    watchdog: Option<File>,
}

/// Runs the keeper of a port file, whose other end is standard input.
///
/// # Errors
/// If it cannot begin; the port gets the reason as well.
pub fn main(path: &Path) -> Result<(), String> {
    let pair = std::io::stdin().as_fd().try_clone_to_owned();
    let pair = pair.map_err(|error| error.to_string())?;
    let holder = Holder::new(path, &pair).inspect_err(|reason| {
        let length = reason.len().min(LONGEST);
        let _ = send(&pair, &reason.as_bytes()[..length], SendFlags::NOSIGNAL);
    })?;
    holder.keep(&pair);
    Ok(())
}

impl Holder {
    fn new(path: &Path, pair: &OwnedFd) -> Result<Self, String> {
        await_message(pair, None);
        let counters = match receive(pair, &mut [0; LONGEST]) {
            Ok((_, Some(counters))) => counters,
            _ => return Err("the keeper is started by hil-port".into()),
        };
        let port = Port::read(path, None).map_err(|problems| problems.to_string())?;
        let table = port.table(Carries::Command);
        let mut frames = Vec::new();
        for one in { port.frames.iter() }.filter(|one| one.carries == Carries::Command) {
            frames.push(Safe {
                packer: Packer::new(&one.frame, &table).map_err(|error| error.to_string())?,
                id: one.frame.id,
                medium: one.medium.ok_or("a frame has no medium")?,
            });
        }
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        let values = port.safe_row()?;
        let watchdog = match &port.safety.watchdog {
            None => None,
            Some(device) => Some(open_watchdog(&folder.join(device))?),
        };
        Ok(Self {
            ends: port.media.iter().map(|_| None).collect(),
            folder,
            port,
            counters: counters.into(),
            frames,
            values,
            watchdog,
        })
    }

    /// Waits for the end of the port, sends the safe values, and disarms the watchdog after an orderly end.
    fn keep(mut self, pair: &OwnedFd) {
        let _ = send(pair, READY, SendFlags::NOSIGNAL);
        let is_orderly = self.wait(pair);
        let media = self.port.media.iter().zip(&self.ends);
        let paths = media.filter_map(|(medium, end)| {
            let fd = end.as_ref().map(|(fd, _)| fd.as_fd());
            path_of(&medium.kind, &self.folder, fd)
        });
        let paths: Vec<PathBuf> = paths.collect();
        self.send_safe();
        // A port that ends in order still has them open, and removes them itself.
        for path in &paths {
            remove_if_left(path);
        }
        if let Some(watchdog) = self.watchdog.as_mut().filter(|_| is_orderly) {
            let _ = watchdog.write_all(MAGIC_CLOSE);
        }
    }

    /// Waits for the end of the port; returns `true` if it was an orderly one.
    fn wait(&mut self, pair: &OwnedFd) -> bool {
        let mut message = [0; LONGEST];
        loop {
            self.feed();
            if !await_message(pair, self.watchdog.as_ref().map(|_| &FEED)) {
                continue;
            }
            match receive(pair, &mut message) {
                Err(Errno::AGAIN | Errno::INTR) => {}
                Ok((length, fd)) if length > 0 => match &message[..length] {
                    END => return true,
                    [MEDIUM, medium, to @ ..] => {
                        if let Some(end) = self.ends.get_mut(usize::from(*medium)) {
                            *end = fd.map(|fd| (fd, to.to_vec()));
                        }
                    }
                    _ => {}
                },
                _ => return false,
            }
        }
    }

    fn feed(&mut self) {
        if let Some(watchdog) = &mut self.watchdog {
            let _ = watchdog.write_all(&[0]);
        }
    }

    /// Makes media of the descriptors; `None` where nobody can be reached.
    fn media(&mut self) -> Vec<Option<Box<dyn Medium>>> {
        let ends = std::mem::take(&mut self.ends);
        let media = self.port.media.iter().zip(ends);
        let opened = media.map(|(medium, end)| match end {
            Some((fd, to)) => adopt(&medium.kind, fd, &to)
                .inspect_err(|error| {
                    let place = medium::place(&medium.kind);
                    say(&format!(
                        "keeper: medium `{}` ({place}): {error}",
                        medium.name
                    ));
                })
                .ok(),
            None => connecting(&medium.kind, &self.folder),
        });
        opened.collect()
    }

    fn send_safe(&mut self) {
        for (place, frame) in self.frames.iter_mut().enumerate() {
            let mut bytes = [0; COUNTER_BYTES];
            let place = (place * COUNTER_BYTES) as u64;
            if self.counters.read_exact_at(&mut bytes, place).is_ok() {
                frame.packer.continue_at(u64::from_ne_bytes(bytes));
            }
        }
        let mut media = self.media();
        for repeat in 0..self.port.safety.repeats {
            if repeat > 0 {
                std::thread::sleep(Duration::from_secs_f64(self.port.safety.period_s));
            }
            for frame in &mut self.frames {
                let bytes = frame.packer.pack(&self.values, &SignalSet::EMPTY);
                if let Some(medium) = &mut media[frame.medium] {
                    // A full buffer or a lost peer is no reason to give up the others.
                    let _ = medium.send(frame.id, bytes);
                }
            }
            self.feed();
        }
    }
}

/// Waits for a message or the port's end; returns `false` after a time without either.
fn await_message(pair: &OwnedFd, limit: Option<&Timespec>) -> bool {
    let mut readable = [PollFd::new(pair, PollFlags::IN)];
    !matches!(poll(&mut readable, limit), Ok(0) | Err(Errno::INTR))
}

/// Opens a watchdog, which arms it. A pipe without a reader is refused instead of waited for.
fn open_watchdog(device: &Path) -> Result<File, String> {
    let mut options = OpenOptions::new();
    options
        .write(true)
        .custom_flags(OFlags::NONBLOCK.bits().cast_signed());
    options.open(device).map_err(|error| {
        format!(
            "watchdog {}: {error}; check `watchdog` in the port file, and that this user may open it",
            device.display()
        )
    })
}
