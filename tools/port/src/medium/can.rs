//! CAN: frames in UDP datagrams as cannelloni sends them. An interface of the kernel is not opened yet.

use std::collections::VecDeque;
use std::io;
use std::os::fd::BorrowedFd;

use hil_codec::frame::CanId;

use super::datagram::Udp;
use super::{Arrival, LONGEST, Medium, Outlet, Tally};

/// Format version of cannelloni datagrams.
const VERSION: u8 = 2;
/// Code of a datagram with frames.
const DATA: u8 = 0;
/// Length of the header: version, code, sequence number and number of frames.
const HEADER: usize = 5;
/// Flag of an identifier of 29 bits.
const EXTENDED: u32 = 1 << 31;
/// Flag of a remote request, which has no data.
const REMOTE: u32 = 1 << 30;
/// Flag of an error frame.
const ERROR: u32 = 1 << 29;
/// Flag in the length of a frame of CAN FD, which is followed by a byte of flags.
const FD: u8 = 0x80;
/// Most frames of received datagrams that wait to be read.
const MOST_WAITING: usize = 1024;

/// CAN frames in UDP datagrams, after the format of cannelloni: a header, then identifier, length and data of each
/// frame, numbers in network order.
#[derive(Debug)]
pub(super) struct Cannelloni {
    udp: Udp,
    sequence: u8,
    waiting: VecDeque<(CanId, Vec<u8>)>,
    /// Bytes of datagrams that are not cannelloni's.
    skipped: u64,
}

impl Cannelloni {
    pub(super) fn new(udp: Udp) -> Self {
        Self {
            udp,
            sequence: 0,
            waiting: VecDeque::new(),
            skipped: 0,
        }
    }
}

impl Medium for Cannelloni {
    fn send(&mut self, id: Option<CanId>, bytes: &[u8]) -> io::Result<bool> {
        let mut datagram = Vec::with_capacity(HEADER + 6 + bytes.len());
        datagram.extend([VERSION, DATA, self.sequence, 0, 1]);
        let id = match id {
            Some(CanId::Standard(id)) => u32::from(id),
            Some(CanId::Extended(id)) => id | EXTENDED,
            None => 0,
        };
        datagram.extend(id.to_be_bytes());
        // At most 64 bytes; the check of a port file limits the frames of CAN.
        let length = u8::try_from(bytes.len()).unwrap_or(64);
        match length > 8 {
            true => datagram.extend([length | FD, 0]),
            false => datagram.push(length),
        }
        datagram.extend(bytes);
        self.sequence = self.sequence.wrapping_add(1);
        self.udp.send(None, &datagram)
    }

    fn has_reached_nobody(&mut self) -> bool {
        self.udp.has_reached_nobody()
    }

    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<Option<Arrival>> {
        if self.waiting.is_empty() {
            let Some(arrival) = self.udp.receive(buffer)? else {
                return Ok(None);
            };
            let datagram = &buffer[..arrival.length];
            match frames(datagram) {
                Some(frames) => self.waiting.extend(frames),
                None => self.skipped += datagram.len() as u64,
            }
            self.waiting.truncate(MOST_WAITING);
        }
        let Some((id, data)) = self.waiting.pop_front() else {
            return Ok(None);
        };
        let length = data.len().min(LONGEST);
        buffer[..length].copy_from_slice(&data[..length]);
        let id = Some(id);
        Ok(Some(Arrival { length, id }))
    }

    fn readable(&self) -> Option<BorrowedFd<'_>> {
        // Frames of a datagram that was read already do not wake a waiter.
        match self.waiting.is_empty() {
            true => self.udp.readable(),
            false => None,
        }
    }

    fn outlet(&self) -> Option<Outlet<'_>> {
        self.udp.outlet()
    }

    fn counts(&self) -> Tally {
        Tally {
            skipped_bytes: self.skipped,
            ..self.udp.counts()
        }
    }
}

/// Returns the data frames of a datagram; `None` if it is none of cannelloni's.
fn frames(datagram: &[u8]) -> Option<Vec<(CanId, Vec<u8>)>> {
    let (header, mut rest) = datagram.split_first_chunk::<HEADER>()?;
    let [version, code, _, count @ ..] = *header;
    if version != VERSION || code != DATA {
        return None;
    }
    let mut frames = Vec::new();
    for _ in 0..u16::from_be_bytes(count) {
        let (id, after) = rest.split_first_chunk::<4>()?;
        let id = u32::from_be_bytes(*id);
        let (length, mut after) = after.split_first()?;
        if length & FD != 0 {
            (_, after) = after.split_first()?;
        }
        let length = match id & REMOTE {
            0 => usize::from(length & !FD),
            _ => 0,
        };
        let (data, after) = after.split_at_checked(length)?;
        rest = after;
        if id & (REMOTE | ERROR) == 0 {
            let id = match id & EXTENDED {
                0 => CanId::Standard((id & 0x7FF) as u16),
                _ => CanId::Extended(id & 0x1FFF_FFFF),
            };
            frames.push((id, data.to_vec()));
        }
    }
    Some(frames)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_datagram_of_cannelloni_is_read_as_its_frames() {
        // Two frames: 0x123 with two bytes, and 0x18FF10 (29 bits) of CAN FD with one; a remote request between them.
        let datagram = [
            2, 0, 7, 0, 3, 0, 0, 1, 0x23, 2, 0xAB, 0xCD, 0x40, 0, 1, 0x24, 8, 0x80, 0x18, 0xFF,
            0x10, 0x81, 0, 0x55,
        ];
        let expected = vec![
            (CanId::Standard(0x123), vec![0xAB, 0xCD]),
            (CanId::Extended(0x0018_FF10), vec![0x55]),
        ];
        assert_eq!(frames(&datagram), Some(expected));
        for end in 0..datagram.len() {
            assert_eq!(frames(&datagram[..end]), None, "{end}");
        }
        assert_eq!(frames(&[1, 0, 7, 0, 0]), None);
    }
}
