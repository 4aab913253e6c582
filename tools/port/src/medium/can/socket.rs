//! CAN interfaces of the kernel: `SocketCAN`.

use std::io::{self, ErrorKind, Read, Write};
use std::num::NonZero;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use hil_codec::frame::CanId;
use rustix::io::Errno;
use rustix::net::{AddressFamily, Protocol, SocketType, socket};
use socketcan::{CanFdSocket, Socket, SocketOptions};

use super::super::datagram::{enlarge, nothing};
use super::super::notes::Notes;
use super::super::{Arrival, Medium, Note, NoteKind, Outlet, Tally, To};
use super::{CLASSIC, data_id, raw_id};

/// Protocol of raw frames in the family of CAN.
const CAN_RAW: u32 = 1;
/// Bytes of a frame in front of its data: identifier, length, flags and two that are reserved.
const HEADER: usize = 8;
/// Bytes of a frame of CAN 2.0.
const CLASSIC_FRAME: usize = HEADER + CLASSIC;
/// Most bytes of a frame's data.
const MOST_DATA: usize = 64;
/// Bytes of a frame of CAN FD.
const FD_FRAME: usize = HEADER + MOST_DATA;
/// Most frames without data of the port that are read before one with. More are read on at the next step.
const MOST_OTHERS: usize = 256;

/// CAN interface.
#[derive(Debug)]
pub(in crate::medium) struct Interface {
    socket: CanFdSocket,
    counts: Tally,
    notes: Notes,
}

impl Interface {
    /// Opens an interface for frames of CAN 2.0 and CAN FD; its error frames arrive, too, and are counted.
    ///
    /// # Errors
    /// If the kernel has no CAN or no such interface.
    pub(in crate::medium) fn open(name: &str) -> io::Result<Self> {
        let in_words = |kind, text: &str| io::Error::new(kind, text);
        let raw = NonZero::new(CAN_RAW).map(Protocol::from_raw);
        if let Err(Errno::AFNOSUPPORT | Errno::PROTONOSUPPORT) =
            socket(AddressFamily::CAN, SocketType::RAW, raw)
        {
            let text = "this kernel has no CAN; load its modules `can` and `can_raw`, or use a medium `cannelloni` and the program of that name";
            return Err(in_words(ErrorKind::Unsupported, text));
        }
        let socket =
            CanFdSocket::open(name).map_err(|error| match Errno::from_io_error(&error) {
                Some(Errno::NODEV) => in_words(
                    ErrorKind::NotFound,
                    "there is no such interface; `ip link` lists those of this machine",
                ),
                _ => error,
            })?;
        socket.set_nonblocking(true)?;
        socket.set_error_filter_accept_all()?;
        enlarge(&socket);
        Ok(Self {
            socket,
            counts: Tally::default(),
            notes: Notes::default(),
        })
    }

    /// Makes a medium that sends on an open interface.
    pub(in crate::medium) fn adopt(socket: OwnedFd) -> Self {
        Self {
            socket: socket.into(),
            counts: Tally::default(),
            notes: Notes::default(),
        }
    }
}

/// Returns the bytes of a frame as the kernel reads them.
fn encode(id: Option<CanId>, bytes: &[u8]) -> ([u8; FD_FRAME], usize) {
    let mut frame = [0; FD_FRAME];
    // The check of a port file limits the frames of CAN.
    let data = &bytes[..bytes.len().min(MOST_DATA)];
    frame[..4].copy_from_slice(&raw_id(id).to_ne_bytes());
    frame[4] = data.len() as u8;
    frame[HEADER..][..data.len()].copy_from_slice(data);
    match data.len() > CLASSIC {
        true => (frame, FD_FRAME),
        false => (frame, CLASSIC_FRAME),
    }
}

/// Returns identifier and data of a frame of the kernel; `None` for one that is shorter than it says.
fn decode(frame: &[u8]) -> Option<(u32, &[u8])> {
    let (id, rest) = frame.split_first_chunk::<4>()?;
    let length = usize::from(*rest.first()?);
    let data = frame.get(HEADER..)?.get(..length)?;
    Some((u32::from_ne_bytes(*id), data))
}

impl Medium for Interface {
    fn send(&mut self, id: Option<CanId>, bytes: &[u8]) -> io::Result<bool> {
        let (frame, length) = encode(id, bytes);
        match self.socket.write(&frame[..length]) {
            Ok(_) => Ok(true),
            // The queue of the interface is full, because nobody acknowledges its frames.
            Err(error)
                if error.kind() == ErrorKind::WouldBlock
                    || Errno::from_io_error(&error) == Some(Errno::NOBUFS) =>
            {
                self.counts.unsent += 1;
                Ok(false)
            }
            Err(error) => Err(in_words(error)),
        }
    }

    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<Option<Arrival>> {
        let mut frame = [0; FD_FRAME];
        for _ in 0..MOST_OTHERS {
            let length = match self.socket.read(&mut frame) {
                Ok(length) => length,
                Err(error) => return nothing(error).map_err(in_words),
            };
            let Some((id, data)) = decode(&frame[..length]) else {
                self.counts.skipped_bytes += length as u64;
                self.notes.add(NoteKind::NoFrame, &frame[..length], || {
                    "a frame that is shorter than it says".into()
                });
                continue;
            };
            if let Some(id) = data_id(id, data, &mut self.counts, &mut self.notes) {
                buffer[..data.len()].copy_from_slice(data);
                return Ok(Some(Arrival::whole(data.len(), Some(id))));
            }
        }
        Ok(None)
    }

    fn readable(&self) -> Option<BorrowedFd<'_>> {
        Some(self.socket.as_fd())
    }

    fn outlet(&self) -> Option<Outlet<'_>> {
        Some(Outlet {
            fd: self.socket.as_fd(),
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

/// Says how to mend an error of an interface, where that is known.
fn in_words(error: io::Error) -> io::Error {
    let text = match Errno::from_io_error(&error) {
        Some(Errno::NETDOWN) => "the interface is down; `ip link set NAME up` starts it",
        Some(Errno::INVAL) => {
            "the interface refuses the frame; one of more than 8 bytes needs an interface of CAN FD"
        }
        _ => return error,
    };
    io::Error::new(error.kind(), text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_have_the_layout_of_the_kernel() {
        // struct can_frame of linux/can.h: can_id, len, pad, res0, len8_dlc, data[8].
        let (frame, length) = encode(Some(CanId::Extended(0x18_FF10)), &[1, 2]);
        assert_eq!(length, 16);
        assert_eq!(frame[..4], 0x8018_FF10_u32.to_ne_bytes());
        assert_eq!(frame[4..16], [2, 0, 0, 0, 1, 2, 0, 0, 0, 0, 0, 0]);
        // struct canfd_frame: can_id, len, flags, res0, res1, data[64].
        let (frame, length) = encode(Some(CanId::Standard(0x123)), &[7; 12]);
        assert_eq!((length, frame[4]), (72, 12));
        let expected = (0x123, &[7; 12][..]);
        assert_eq!(decode(&frame[..length]), Some(expected));
        // Its length says 12 bytes in a frame of 8.
        assert_eq!(decode(&frame[..CLASSIC_FRAME]), None);
    }

    #[test]
    fn frames_pass_between_two_ends_of_an_interface() {
        let (mut one, mut other) = match (Interface::open("vcan0"), Interface::open("vcan0")) {
            (Ok(one), Ok(other)) => (one, other),
            (Err(error), _) | (_, Err(error)) => {
                let is_demanded = std::env::var_os("HIL_TEST_VCAN").is_some();
                assert!(!is_demanded, "HIL_TEST_VCAN is set, but vcan0: {error}");
                eprintln!("SKIPPED: vcan0: {error}");
                return;
            }
        };
        let mut buffer = [0; 4097];
        let mut pass = |id, bytes: &[u8]| {
            assert!(one.send(Some(id), bytes).expect("sent"));
            let arrival = other.receive(&mut buffer).expect("received")?;
            Some((arrival.id, buffer[..arrival.length].to_vec()))
        };
        let id = CanId::Extended(0x18_FF10);
        assert_eq!(pass(id, &[1, 2, 3]), Some((Some(id), vec![1, 2, 3])));
        let id = CanId::Standard(0x123);
        assert_eq!(pass(id, &[]), Some((Some(id), Vec::new())));
        assert_eq!(pass(id, &[7; 12]), Some((Some(id), vec![7; 12])));
        // An error frame and a remote request carry no data.
        for (raw, length) in [(0x2000_0004_u32, 8), (0x4000_0123, 0)] {
            let mut frame = [0; CLASSIC_FRAME];
            frame[..4].copy_from_slice(&raw.to_ne_bytes());
            frame[4] = length;
            one.socket.write_all(&frame).expect("sent");
        }
        assert_eq!(other.receive(&mut buffer).expect("read"), None);
        let counts = other.counts();
        assert_eq!((counts.error_frames, counts.remote_requests), (1, 1));
    }

    #[test]
    fn an_interface_that_is_not_there_is_named_with_what_to_do() {
        let error = Interface::open("hil-none").expect_err("no interface has this name");
        let text = error.to_string();
        match error.kind() {
            ErrorKind::Unsupported => assert!(text.contains("use a medium `cannelloni`"), "{text}"),
            _ => assert!(text.contains("`ip link` lists those"), "{text}"),
        }
    }
}
