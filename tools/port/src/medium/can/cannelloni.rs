//! CAN frames in UDP datagrams, as cannelloni sends them.

use std::collections::VecDeque;
use std::io;
use std::os::fd::BorrowedFd;

use hil_codec::frame::CanId;

use super::super::datagram::Udp;
use super::super::notes::Notes;
use super::super::{Arrival, Medium, Note, NoteKind, Outlet, Tally};
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
    notes: Notes,
}

impl Cannelloni {
    pub(in crate::medium) fn new(udp: Udp) -> Self {
        Self {
            udp,
            sequence: 0,
            datagram: vec![0; LONGEST_DATAGRAM],
            waiting: VecDeque::new(),
            counts: Tally::default(),
            notes: Notes::default(),
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
            match frames(datagram, &mut self.counts, &mut self.notes) {
                Ok(frames) => self.waiting.extend(frames),
                Err(why) => {
                    self.counts.skipped_bytes += datagram.len() as u64;
                    self.notes.add(NoteKind::NoFrame, datagram, || {
                        format!("a datagram that is none of cannelloni's: {why}")
                    });
                }
            }
        }
        let Some((id, data)) = self.waiting.pop_front() else {
            return Ok(None);
        };
        // At most 127 bytes.
        buffer[..data.len()].copy_from_slice(&data);
        Ok(Some(Arrival::whole(data.len(), Some(id))))
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
            dropped: udp.dropped,
            ..self.counts
        }
    }

    fn first_other(&self) -> Option<&str> {
        self.udp.first_other()
    }

    fn take_notes(&mut self) -> Vec<Note> {
        let mut notes = self.udp.take_notes();
        notes.extend(self.notes.take());
        notes
    }
}

/// Returns the data frames of a datagram.
///
/// # Errors
/// The reason why it is none of cannelloni's.
fn frames(
    datagram: &[u8],
    counts: &mut Tally,
    notes: &mut Notes,
) -> Result<Vec<(CanId, Vec<u8>)>, String> {
    let header = datagram.split_first_chunk::<HEADER>();
    let (header, mut rest) = header.ok_or_else(|| {
        let length = datagram.len();
        format!("it has {length} bytes, and its head alone {HEADER}")
    })?;
    let [version, code, _, count @ ..] = *header;
    if version != VERSION {
        return Err(format!("its version is {version} and not {VERSION}"));
    }
    if code != DATA {
        return Err(format!("its code is {code} and not {DATA}"));
    }
    let count = u16::from_be_bytes(count);
    let mut frames = Vec::new();
    for number in 1..=count {
        let (id, data, after) = frame(rest)
            .ok_or_else(|| format!("it ends in frame {number} of the {count} that it announces"))?;
        rest = after;
        if let Some(id) = data_id(id, data, counts, notes) {
            frames.push((id, data.to_vec()));
        }
    }
    Ok(frames)
}

/// Returns the identifier and data of the first frame, and the bytes behind it; `None` if it is cut.
fn frame(bytes: &[u8]) -> Option<(u32, &[u8], &[u8])> {
    let (id, after) = bytes.split_first_chunk::<4>()?;
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
    Some((id, data, after))
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
        let (mut counts, mut notes) = (Tally::default(), Notes::default());
        assert_eq!(frames(&datagram, &mut counts, &mut notes), Ok(expected));
        assert_eq!((counts.error_frames, counts.remote_requests), (1, 1));
        let mut read = |datagram: &[u8]| frames(datagram, &mut counts, &mut notes);
        for end in 0..datagram.len() {
            let why = read(&datagram[..end]).expect_err("a part");
            let number = match end {
                0..HEADER => {
                    let head = format!("it has {end} bytes, and its head alone 5");
                    assert_eq!(why, head);
                    continue;
                }
                HEADER..12 => 1,
                12..17 => 2,
                17..22 => 3,
                _ => 4,
            };
            let cut = format!("it ends in frame {number} of the 4 that it announces");
            assert_eq!(why, cut, "{end}");
        }
        let why = "its version is 1 and not 2";
        assert_eq!(read(&[1, 0, 7, 0, 0]), Err(why.into()));
        let notes = notes.take();
        let kinds: Vec<NoteKind> = notes.iter().map(|note| note.kind).collect();
        assert_eq!(kinds, [NoteKind::RemoteRequest, NoteKind::ErrorFrame]);
        assert_eq!(notes[0].text, "a remote request for id 0x124");
    }
}
