//! Files that hold one frame: Linux gives converters and PWM outputs as files of text.

use std::fs::{File as Opened, OpenOptions};
use std::io::{self, ErrorKind};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::fs::{FileExt, FileTypeExt};
use std::path::Path;

use hil_codec::frame::CanId;
use rustix::io::Errno;

use super::notes::Notes;
use super::{Arrival, Medium, Note, NoteKind, Outlet, Tally, To};

/// File that is read and written from its beginning.
///
/// Each read is an arrival, also of a text that is equal to the one before: a converter measures when it is read, and
/// equal values are as good as different ones. A read that fails is an empty frame, which is refused and counted.
#[derive(Debug)]
pub(super) struct File {
    reader: Option<Opened>,
    writer: Option<Opened>,
    /// `true` if the file has been read since the last call that returned nothing.
    is_read: bool,
    /// `true` if frames are lines, whose end is none of a value.
    is_text: bool,
    counts: Tally,
    notes: Notes,
}

impl File {
    /// Opens a file for what its owner allows: a converter can only be read, and some outputs only be written.
    ///
    /// # Errors
    /// If it can be neither read nor written, or is a folder or pipe.
    pub(super) fn open(path: &Path, is_text: bool) -> io::Result<Self> {
        let kind = std::fs::metadata(path)?.file_type();
        if kind.is_dir() || kind.is_fifo() || kind.is_socket() {
            let why = "it is a folder, pipe or socket; this medium is for files that hold a frame";
            return Err(io::Error::new(ErrorKind::InvalidInput, why));
        }
        let reader = OpenOptions::new().read(true).open(path);
        let writer = OpenOptions::new().write(true).open(path);
        match (reader, writer) {
            (Err(error), Err(_)) => Err(error),
            (reader, writer) => Ok(Self {
                reader: reader.ok(),
                writer: writer.ok(),
                is_read: false,
                is_text,
                counts: Tally::default(),
                notes: Notes::default(),
            }),
        }
    }

    /// Makes a medium that writes to an open file.
    pub(super) fn adopt(writer: Opened) -> Self {
        Self {
            reader: None,
            writer: Some(writer),
            is_read: false,
            is_text: false,
            counts: Tally::default(),
            notes: Notes::default(),
        }
    }
}

impl Medium for File {
    fn send(&mut self, _: Option<CanId>, bytes: &[u8]) -> io::Result<bool> {
        let writer = self.writer.as_ref().ok_or(ErrorKind::PermissionDenied)?;
        match writer.write_all_at(bytes, 0) {
            Err(error) if is_passing(&error) => {
                self.counts.unsent += 1;
                return Ok(false);
            }
            result => result?,
        }
        // An ordinary file would keep the end of a longer frame; a device's has no length.
        if writer.metadata()?.len() > bytes.len() as u64 {
            let _ = writer.set_len(bytes.len() as u64);
        }
        Ok(true)
    }

    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<Option<Arrival>> {
        self.is_read = !self.is_read;
        let Some(reader) = self.reader.as_ref().filter(|_| self.is_read) else {
            return Ok(None);
        };
        let length = match reader.read_at(buffer, 0) {
            Ok(length) => length,
            Err(error) if is_gone(&error) => return Err(error),
            Err(error) => {
                self.counts.unreadable += 1;
                (self.notes).add(NoteKind::Unreadable, &[], || {
                    format!("it cannot be read: {error}")
                });
                0
            }
        };
        let length = match self.is_text {
            true => buffer[..length].trim_ascii_end().len(),
            false => length,
        };
        Ok(Some(Arrival::whole(length, None)))
    }

    fn readable(&self) -> Option<BorrowedFd<'_>> {
        None
    }

    fn outlet(&self) -> Option<Outlet<'_>> {
        Some(Outlet {
            fd: self.writer.as_ref()?.as_fd(),
            to: To::Connected,
            connection: 0,
        })
    }

    fn counts(&self) -> Tally {
        self.counts
    }

    fn take_notes(&mut self) -> Vec<Note> {
        self.notes.take()
    }
}

/// Returns `true` if the device behind a file is gone.
fn is_gone(error: &io::Error) -> bool {
    let gone = [Errno::NODEV, Errno::NXIO, Errno::STALE, Errno::BADF];
    Errno::from_io_error(error).is_some_and(|errno| gone.contains(&errno))
}

/// Returns `true` if a later attempt to write may succeed.
fn is_passing(error: &io::Error) -> bool {
    let passing = [
        Errno::AGAIN,
        Errno::BUSY,
        Errno::INTR,
        Errno::IO,
        Errno::TIMEDOUT,
    ];
    Errno::from_io_error(error).is_some_and(|errno| passing.contains(&errno))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shorter_frame_leaves_no_end_of_the_longer_one() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("duty cycle");
        std::fs::write(&path, "1000").expect("written");
        let mut file = super::File::open(&path, true).expect("opened");
        file.send(None, b"25\n").expect("sent");
        assert_eq!(std::fs::read(&path).expect("read"), b"25\n");
        let mut buffer = [0; 8];
        let arrival = file.receive(&mut buffer).expect("received");
        assert_eq!(arrival.map(|one| one.length), Some(2));
        assert_eq!(file.receive(&mut buffer).expect("received"), None);
    }
}
