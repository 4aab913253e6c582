//! Frames from memory that another process writes to, and items of the record stream.
//!
//! A frame that opens is identical to the sealed one: if any bit of it changes, it is refused and none of it is used.
//! The stream's assembler counts lost items and stores at most one event.

use shared_types::frame::{Frame, FrameIdentity, FrameKind, Header, words};
use shared_types::stream::{Assembler, Item};
use shared_types::table::canonical;
use shared_types::zerocopy::FromBytes;

/// Number of values that fit into a frame.
const ROOM: usize = 16;
/// Number of words in a frame, the first of which is its checksum.
const WORDS: usize = words(ROOM);
/// Size of a frame in bytes.
const BYTES: usize = 8 * WORDS;
/// Words in front of an item: number, kind and length in bytes.
const HEAD_WORDS: usize = 3;

/// Runs the target.
pub fn run(bytes: &[u8]) {
    let mut raw = [0; BYTES];
    let taken = bytes.len().min(BYTES);
    raw[..taken].copy_from_slice(&bytes[..taken]);
    let frame = Frame::<WORDS>::read_from_bytes(&raw).expect("as many bytes as a frame has");
    let header = Header::read_from_prefix(&raw[8..])
        .expect("more than enough")
        .0;
    let items: Vec<u64> = (bytes.chunks(8))
        .map(|chunk| {
            chunk
                .iter()
                .rev()
                .fold(0, |word, byte| word << 8 | u64::from(*byte))
        })
        .collect();
    foreign(&frame, &header);
    let values: Vec<f64> = (items.iter().skip(WORDS - ROOM).take(ROOM))
        .map(|word| f64::from_bits(*word))
        .collect();
    sealed(&header, &values, items.last().copied().unwrap_or(0));
    assembled(&items);
}

/// Checks that content of shared memory is accepted only if every part of it fits.
fn foreign(frame: &Frame<WORDS>, header: &Header) {
    let identity = FrameIdentity {
        session: header.session,
        layout: header.layout,
        epoch: header.epoch,
    };
    for count in [0, 1, usize::from(header.count).min(2 * ROOM), ROOM] {
        let mut values = vec![7.5; count];
        match frame.open(identity, &mut values) {
            Ok(opened) => {
                let mut carried = *header;
                carried.invalid[usize::from(header.count).div_ceil(64)..].fill(0);
                assert_eq!(opened, carried);
                assert!(usize::from(opened.count) <= ROOM && opened.kind().is_some());
            }
            Err(_) => assert!(values.iter().all(|value| *value == 7.5)),
        }
    }
    let mut twice = *frame;
    twice.flip(header.sequence);
    assert!(twice.bits() <= 8 * BYTES as u64);
}

/// Checks that a sealed frame opens unchanged, and not after a bit has changed.
fn sealed(header: &Header, values: &[f64], salt: u64) {
    let identity = FrameIdentity {
        session: header.session,
        layout: header.layout,
        epoch: header.epoch,
    };
    let kind = header.kind().unwrap_or(FrameKind::Sample);
    let carries = matches!(kind, FrameKind::Sample | FrameKind::Command);
    let values = if carries { values } else { &[] };
    let header = Header {
        kind: kind as u16,
        ..*header
    };
    let frame = Frame::<WORDS>::sealed(&header, values, identity);
    let mut out = vec![7.5; values.len()];
    let opened = frame.open(identity, &mut out).expect("its own identity");
    let given: Vec<u64> = values.iter().map(|v| canonical(*v).to_bits()).collect();
    let got: Vec<u64> = out.iter().map(|v| v.to_bits()).collect();
    assert_eq!(got, given);
    assert_eq!((opened.step, opened.kind()), (header.step, Some(kind)));
    for turn in 0..8 {
        let bit = salt.rotate_left(8 * turn) % frame.bits();
        let mut broken = frame;
        broken.flip(bit);
        let mut out = vec![7.5; values.len()];
        assert!(broken.open(identity, &mut out).is_err(), "bit {bit}");
        assert!(out.iter().all(|value| *value == 7.5), "bit {bit}");
    }
    let other = FrameIdentity {
        epoch: identity.epoch ^ 1,
        ..identity
    };
    assert!(frame.open(other, &mut out).is_err());
}

/// Assembles items with any number, kind and length.
fn assembled(words: &[u64]) {
    let mut assembler = Assembler::default();
    let mut rest = words;
    while let Some((head, after)) = rest.split_at_checked(HEAD_WORDS) {
        let length = (head[2] as usize / 8).min(after.len()).min(32);
        let (item, after) = after.split_at(length);
        // Most numbers and kinds would be no item at all.
        let (sequence, kind) = match head[1] % 8 {
            0 => (head[0], head[1]),
            small => (head[0] % 64, small % 4),
        };
        assembler.take((sequence, kind, head[2]), item, &mut |item| match item {
            Item::Record(record) => assert_eq!(record.len(), length),
            Item::Lost(count) => assert!(count > 0),
            Item::Broken(what) => assert!(!what.is_empty()),
            Item::Event(_) => {}
        });
        rest = after;
    }
}
