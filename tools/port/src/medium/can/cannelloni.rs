//! CAN frames in UDP datagrams, as cannelloni sends them.

use std::collections::VecDeque;
use std::io;
use std::os::fd::BorrowedFd;

use hil_codec::frame::CanId;

use super::super::datagram::Udp;
use super::super::{Arrival, Medium, Outlet, Tally};
use super::{CLASSIC, REMOTE, data_id, raw_id};

/// Format version of cannelloni datagrams.
const VERSION: u8 = 2;
/// Code of a datagram with frames.
const DATA: u8 = 0;
/// Length of the header: version, code, sequence number and number of frames.
const HEADER: usize = 5;
/// Bytes of the header in front of the number of frames; the sequence number differs each time.
const SEQUENCE_END: usize = 3;
/// Flag in the length of a frame of CAN FD, which is followed by a byte of flags.
const FD: u8 = 0x80;
/// Longest datagram of UDP.
const LONGEST_DATAGRAM: usize = 65_535;

/// CAN frames in UDP datagrams, after the format of cannelloni: a header, then identifier, length and data of each
/// frame, numbers in network order.
#[derive(Debug)]
pub(in crate::medium) struct Cannelloni {
    udp: Udp,
    sequence: u8,
    /// Last datagram.
    datagram: Vec<u8>,
    /// Frames of the last datagram that wait to be read.
    waiting: VecDeque<(CanId, Vec<u8>)>,
    counts: Tally,
}

impl Cannelloni {
    pub(in crate::medium) fn new(udp: Udp) -> Self {
        Self {
            udp,
            sequence: 0,
            datagram: vec![0; LONGEST_DATAGRAM],
            waiting: VecDeque::new(),
            counts: Tally::default(),
        }
    }
}

/// Returns the datagram of one frame.
fn encode(sequence: u8, id: Option<CanId>, bytes: &[u8]) -> Vec<u8> {
    let mut datagram = Vec::with_capacity(HEADER + 6 + bytes.len());
    datagram.extend([VERSION, DATA, sequence, 0, 1]);
    datagram.extend(raw_id(id).to_be_bytes());
    // At most 64 bytes; the check of a port file limits the frames of CAN.
    let length = u8::try_from(bytes.len()).unwrap_or(64);
    match bytes.len() > CLASSIC {
        true => datagram.extend([length | FD, 0]),
        false => datagram.push(length),
    }
    datagram.extend(bytes);
    datagram
}

impl Medium for Cannelloni {
    fn send(&mut self, id: Option<CanId>, bytes: &[u8]) -> io::Result<bool> {
        let datagram = encode(self.sequence, id, bytes);
        self.sequence = self.sequence.wrapping_add(1);
        self.udp.send(None, &datagram)
    }

    fn has_reached_nobody(&self, id: Option<CanId>, bytes: &[u8]) -> bool {
        let datagram = encode(0, id, bytes);
        self.udp.has_lost(&datagram, SEQUENCE_END)
    }

    fn forget_lost(&mut self) {
        self.udp.forget_lost();
    }

    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<Option<Arrival>> {
        if self.waiting.is_empty() {
            let Some(arrival) = self.udp.receive(&mut self.datagram)? else {
                return Ok(None);
            };
            let datagram = &self.datagram[..arrival.length];
            match frames(datagram, &mut self.counts) {
                Some(frames) => self.waiting.extend(frames),
                None => self.counts.skipped_bytes += datagram.len() as u64,
            }
        }
        let Some((id, data)) = self.waiting.pop_front() else {
            return Ok(None);
        };
        // At most 127 bytes.
        buffer[..data.len()].copy_from_slice(&data);
        Ok(Some(Arrival {
            length: data.len(),
            id: Some(id),
        }))
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
        let udp = self.udp.counts();
        Tally {
            strangers: udp.strangers,
            new_peers: udp.new_peers,
            unsent: udp.unsent,
            ..self.counts
        }
    }
}

/// Returns the data frames of a datagram; `None` if it is none of cannelloni's.
fn frames(datagram: &[u8], counts: &mut Tally) -> Option<Vec<(CanId, Vec<u8>)>> {
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
        if let Some(id) = data_id(id, counts) {
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
        // Two frames: 0x123 with two bytes, and 0x18FF10 (29 bits) of CAN FD with one; a remote request and an error
        // frame without data between them.
        let datagram = [
            2, 0, 7, 0, 4, 0, 0, 1, 0x23, 2, 0xAB, 0xCD, 0x40, 0, 1, 0x24, 8, 0x20, 0, 0, 4, 0,
            0x80, 0x18, 0xFF, 0x10, 0x81, 0, 0x55,
        ];
        let expected = vec![
            (CanId::Standard(0x123), vec![0xAB, 0xCD]),
            (CanId::Extended(0x0018_FF10), vec![0x55]),
        ];
        let mut counts = Tally::default();
        assert_eq!(frames(&datagram, &mut counts), Some(expected));
        assert_eq!((counts.error_frames, counts.remote_requests), (1, 1));
        for end in 0..datagram.len() {
            assert_eq!(frames(&datagram[..end], &mut counts), None, "{end}");
        }
        assert_eq!(frames(&[1, 0, 7, 0, 0], &mut counts), None);
    }
}
