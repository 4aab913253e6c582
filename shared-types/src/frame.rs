//! The frame: the common form of samples and commands on the link.
//!
//! A checksum, a header and a row of `f64` described by a [`SignalTable`](crate::layout::SignalTable). Links copy
//! frames; the lockstep machines look at headers only.

use std::mem::offset_of;

use rapidhash::v3::rapidhash_v3;
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::table::canonical;
use crate::time::Step;

/// Maximum number of signals in one frame.
pub const MAX_SIGNALS: usize = 512;

/// Words of validity bits in a header, one bit per signal.
pub const VALIDITY_WORDS: usize = MAX_SIGNALS / 64;

/// Purpose of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u16)]
pub enum FrameKind {
    /// Plant to controller: measured and reference signals of a step.
    Sample = 1,
    /// Controller to plant: command and internals that answer the sample of the same step.
    Command = 2,
    /// Plant to controller: no more steps; `step` is the number of steps exchanged.
    End = 3,
    /// Controller to plant: confirms that `step` steps were executed here too.
    EndConfirmed = 4,
    /// Either way: the sender aborts; `directive` is the reason ([`AbortCode`](crate::lockstep::AbortCode)).
    Abort = 5,
    /// Plant to controller: the sample of `step` is delayed; restart the wait. Sent while a run is paused.
    Hold = 6,
}

impl FrameKind {
    /// Decodes a kind from its wire number.
    #[must_use]
    #[inline]
    pub const fn from_wire(number: u16) -> Option<Self> {
        Some(match number {
            1 => Self::Sample,
            2 => Self::Command,
            3 => Self::End,
            4 => Self::EndConfirmed,
            5 => Self::Abort,
            6 => Self::Hold,
            _ => return None,
        })
    }
}

/// Frame header: 152 bytes, little-endian, no padding.
///
/// A [`Frame`] carries only as many words of validity bits as its values need.
#[derive(Clone, Copy, Debug, PartialEq, Eq, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(C)]
pub struct Header {
    /// Random number of the session.
    pub session: u64,
    /// Hash of the two signal tables agreed at hello.
    pub layout: u64,
    /// Step.
    pub step: u64,
    /// Sequence number of the sender's frames, from 1.
    pub sequence: u64,
    /// Simulated time in ns.
    pub time_ns: u64,
    /// Time that the sender spent on the content of this frame, in ns of the monotonic clock.
    pub work_ns: u64,
    /// In a sample, instructions to the controller's runner, never to a law
    /// ([`Directive`](crate::directive::Directive)); in a command, the samples answered before it
    /// ([`Answered`](crate::directive::Answered)); in an abort, the reason.
    pub directive: u64,
    /// Statistics of the sender's thread ([`ThreadStatistics`](crate::thread::ThreadStatistics)).
    pub surroundings: u64,
    /// In a sample, the number of preceding messages with changed law parameters ([`Tuned`](crate::tuning::Tuned)); 0
    /// while none has changed.
    pub tuning: u64,
    /// Number of the controller in the session: 1 for the first, incremented at each replacement.
    pub epoch: u32,
    /// Age of the content in steps.
    pub age_steps: u32,
    /// In a sample, the number of steps for which the plant has held the last applied command because a newer one
    /// missed its deadline; 0 while the controller is in time.
    pub held_steps: u32,
    /// [`FrameKind`] as a number.
    pub kind: u16,
    /// Number of values in use; the rest are zero.
    pub count: u16,
    /// Bit `i % 64` of word `i / 64` set: signal `i` is invalid. Bits beyond `count` mean nothing.
    pub invalid: [u64; VALIDITY_WORDS],
}

/// Bytes of a header before its validity bits.
const HEAD_BYTES: usize = offset_of!(Header, invalid);
/// `HEAD_BYTES` in words.
const HEAD_WORDS: usize = word(HEAD_BYTES);

/// Returns the index of the header word that contains the byte at an offset.
const fn word(offset: usize) -> usize {
    offset / size_of::<u64>()
}

impl Header {
    /// Creates a header of a kind at a step, all else zero.
    #[must_use]
    #[inline]
    pub const fn new(kind: FrameKind, step: Step) -> Self {
        Self {
            session: 0,
            layout: 0,
            step: step.0,
            sequence: 0,
            time_ns: 0,
            work_ns: 0,
            directive: 0,
            surroundings: 0,
            tuning: 0,
            epoch: 0,
            age_steps: 0,
            held_steps: 0,
            kind: kind as u16,
            count: 0,
            invalid: [0; VALIDITY_WORDS],
        }
    }

    /// Returns the kind, or `None` if it is unknown.
    #[must_use]
    #[inline]
    pub const fn kind(&self) -> Option<FrameKind> {
        FrameKind::from_wire(self.kind)
    }

    /// Returns `true` if signal `index` is valid.
    #[must_use]
    #[inline]
    pub const fn is_valid(&self, index: usize) -> bool {
        self.invalid[index / 64] >> (index % 64) & 1 == 0
    }
}

/// A frame: a checksum, a [`Header`] up to the last word of validity bits that its values need, and the values.
///
/// `WORDS` is [`words`] of the number of values that fit. The checksum is rapidhash (version 3, 64 bits, standard seed)
/// over header and values, not over unused room.
///
/// Any bytes of the right size form a frame, because the memory is also writable by another process; [`Frame::open`]
/// decides whether the frame is valid.
#[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(C)]
pub struct Frame<const WORDS: usize> {
    words: [u64; WORDS],
}

// `sealed` and `count` read and write words that hold several fields.
const _: () = assert!(
    cfg!(target_endian = "little")
        && HEAD_BYTES.is_multiple_of(8)
        && offset_of!(Header, epoch).is_multiple_of(8)
        && offset_of!(Header, held_steps).is_multiple_of(8)
        && offset_of!(Header, age_steps) == offset_of!(Header, epoch) + 4
        && offset_of!(Header, kind) == offset_of!(Header, held_steps) + 4
        && offset_of!(Header, count) == offset_of!(Header, kind) + 2
);

/// Returns the number of words of a [`Frame`] with room for so many values.
#[must_use]
#[inline]
pub const fn words(values: usize) -> usize {
    1 + HEAD_WORDS + values.div_ceil(64) + values
}

/// Reason why a frame is rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// Wrong checksum.
    #[error("the frame's checksum is wrong")]
    Corrupt,
    /// Frame of another session.
    #[error("the frame belongs to another session")]
    Session,
    /// Frame from or for another controller of this session.
    #[error("the frame belongs to another epoch")]
    Epoch,
    /// Signal layout that differs from the agreed one.
    #[error("the frame's signal layout differs from the agreed one")]
    Layout,
    /// Number of values that differs from the agreed one.
    #[error("the number of values in the frame differs from the agreed number")]
    Count,
    /// Unknown kind.
    #[error("the frame's kind is unknown")]
    Kind,
}

/// Header fields that every frame of one direction must carry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameIdentity {
    /// Session.
    pub session: u64,
    /// Layout hash.
    pub layout: u64,
    /// Epoch.
    pub epoch: u32,
}

impl FrameIdentity {
    /// Checks that a header belongs to this session, epoch and layout, and has `count` values if its kind carries any.
    ///
    /// # Errors
    /// The first mismatch.
    #[inline]
    pub fn check(&self, header: &Header, count: usize) -> Result<(), FrameError> {
        let kind = header.kind().ok_or(FrameError::Kind)?;
        if header.session != self.session {
            return Err(FrameError::Session);
        }
        if header.epoch != self.epoch {
            return Err(FrameError::Epoch);
        }
        if header.layout != self.layout {
            return Err(FrameError::Layout);
        }
        let carries = matches!(kind, FrameKind::Sample | FrameKind::Command);
        if header.count as usize != if carries { count } else { 0 } {
            return Err(FrameError::Count);
        }
        Ok(())
    }
}

impl<const WORDS: usize> Default for Frame<WORDS> {
    fn default() -> Self {
        Self { words: [0; WORDS] }
    }
}

impl<const WORDS: usize> Frame<WORDS> {
    /// Interprets words as a frame, without checking them.
    #[must_use]
    #[inline]
    pub fn from_words(words: &[u64; WORDS]) -> &Self {
        zerocopy::transmute_ref!(words)
    }

    /// Returns the words of the frame.
    #[must_use]
    #[inline]
    pub const fn into_words(self) -> [u64; WORDS] {
        self.words
    }

    /// Returns the frame's sequence number; 0 if nothing was ever sent.
    #[must_use]
    #[inline]
    pub const fn sequence(&self) -> u64 {
        self.words[1 + word(offset_of!(Header, sequence))]
    }

    /// Creates a sealed frame of these values, with its checksum. Values are made [`canonical`].
    ///
    /// # Panics
    /// If the values do not fit; the size class chosen at hello prevents this.
    #[must_use]
    pub fn sealed(header: &Header, values: &[f64], identity: FrameIdentity) -> Self {
        let mut frame = Self::default();
        let content = &mut frame.words[1..words(values.len())];
        let (head, row) = content.split_at_mut(content.len() - values.len());
        let (head, invalid) = head.split_at_mut(HEAD_WORDS);
        head.as_mut_bytes()
            .copy_from_slice(&header.as_bytes()[..HEAD_BYTES]);
        // Whole words: a checksum over a word that was written in parts would stall on store forwarding.
        head[word(offset_of!(Header, session))] = identity.session;
        head[word(offset_of!(Header, layout))] = identity.layout;
        head[word(offset_of!(Header, epoch))] =
            u64::from(identity.epoch) | u64::from(header.age_steps) << 32;
        head[word(offset_of!(Header, count))] = u64::from(header.held_steps)
            | u64::from(header.kind) << 32
            | (values.len() as u64) << 48;
        // One by one: a copy whose length the compiler does not know is a call.
        for (to, from) in invalid.iter_mut().zip(&header.invalid) {
            *to = *from;
        }
        for (to, from) in row.iter_mut().zip(values) {
            *to = canonical(*from).to_bits();
        }
        frame.words[0] = rapidhash_v3(content.as_bytes());
        frame
    }

    /// Inverts one bit, as noise on a wire does. Bits count from the start of the checksum and wrap around at the
    /// frame's end.
    pub fn flip(&mut self, bit: u64) {
        let bit = bit % (64 * WORDS as u64);
        self.words[(bit / 64) as usize] ^= 1 << (bit % 64);
    }

    /// Number of significant bits of checksum, header and values.
    #[must_use]
    pub fn bits(&self) -> u64 {
        64 * words(self.count()).min(WORDS) as u64
    }

    /// Number of values, according to the header.
    fn count(&self) -> usize {
        (self.words[1 + word(offset_of!(Header, count))] >> 48) as usize
    }

    /// Checks the frame and copies its values out.
    ///
    /// A frame of a kind without values leaves `values` unchanged.
    ///
    /// # Errors
    /// The first mismatch; `values` is then unchanged.
    pub fn open(&self, identity: FrameIdentity, values: &mut [f64]) -> Result<Header, FrameError> {
        let count = self.count();
        let content = self.words.get(1..words(count)).ok_or(FrameError::Count)?;
        if self.words[0] != rapidhash_v3(content.as_bytes()) {
            return Err(FrameError::Corrupt);
        }
        let (head, row) = content.split_at(content.len() - count);
        let (head, invalid) = head.split_at(HEAD_WORDS);
        let mut header = Header::new(FrameKind::Sample, Step(0));
        header.as_mut_bytes()[..HEAD_BYTES].copy_from_slice(head.as_bytes());
        for (to, from) in header.invalid.iter_mut().zip(invalid) {
            *to = *from;
        }
        identity.check(&header, values.len())?;
        if !row.is_empty() {
            values.as_mut_bytes().copy_from_slice(row.as_bytes());
        }
        Ok(header)
    }
}

/// Size classes of frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SizeClass {
    /// Up to 16 values.
    N16,
    /// Up to 32 values.
    N32,
    /// Up to 64 values.
    N64,
    /// Up to 128 values.
    N128,
    /// Up to 256 values.
    N256,
    /// Up to 512 values.
    N512,
}

impl SizeClass {
    /// Returns the smallest class for N values; `None` beyond [`MAX_SIGNALS`].
    #[must_use]
    pub const fn for_count(count: usize) -> Option<Self> {
        Some(match count {
            0..=16 => Self::N16,
            17..=32 => Self::N32,
            33..=64 => Self::N64,
            65..=128 => Self::N128,
            129..=256 => Self::N256,
            257..=MAX_SIGNALS => Self::N512,
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const IDENTITY: FrameIdentity = FrameIdentity {
        session: 7,
        layout: 8,
        epoch: 1,
    };

    fn frame(values: &[f64]) -> Frame<{ words(16) }> {
        Frame::sealed(&Header::new(FrameKind::Sample, Step(3)), values, IDENTITY)
    }

    #[test]
    fn a_frame_opens_to_the_sealed_values() {
        let mut values = [0.0; 3];
        let header = frame(&[1.0, -2.0, 3.5])
            .open(IDENTITY, &mut values)
            .expect("opens");
        assert_eq!((values, header.step), ([1.0, -2.0, 3.5], 3));
    }

    #[test]
    fn every_single_bit_flip_is_detected() {
        let frame = frame(&[1.0, -2.0, 3.5]);
        assert_eq!(frame.bits(), 64 * (1 + 11 + 1 + 3));
        for bit in 0..frame.bits() {
            let mut broken = frame;
            broken.flip(bit);
            let mut out = [9.0; 3];
            assert!(broken.open(IDENTITY, &mut out).is_err(), "bit {bit}");
            assert_eq!(out, [9.0; 3], "bit {bit}");
            broken.flip(bit);
            assert!(broken.open(IDENTITY, &mut out).is_ok(), "bit {bit}");
        }
    }

    #[test]
    fn exactly_the_validity_bits_of_the_values_cross() {
        for count in [0, 1, 64, 65, 128, 129, 511, 512] {
            let header = Header {
                invalid: [u64::MAX; VALIDITY_WORDS],
                ..Header::new(FrameKind::Sample, Step(3))
            };
            let values = vec![1.0; count];
            let frame = Frame::<{ words(512) }>::sealed(&header, &values, IDENTITY);
            let mut out = vec![0.0; count];
            let opened = frame.open(IDENTITY, &mut out).expect("opens");
            assert_eq!(out, values);
            let (carried, rest) = opened.invalid.split_at(count.div_ceil(64));
            assert!(carried.iter().all(|word| *word == u64::MAX), "{count}");
            assert!(rest.iter().all(|word| *word == 0), "{count}");
        }
    }

    #[test]
    fn foreign_frames_are_refused_with_their_reason() {
        let frame = frame(&[1.0]);
        let mut out = [0.0];
        for (identity, error) in [
            (
                FrameIdentity {
                    session: 1,
                    ..IDENTITY
                },
                FrameError::Session,
            ),
            (
                FrameIdentity {
                    epoch: 2,
                    ..IDENTITY
                },
                FrameError::Epoch,
            ),
            (
                FrameIdentity {
                    layout: 1,
                    ..IDENTITY
                },
                FrameError::Layout,
            ),
        ] {
            assert_eq!(frame.open(identity, &mut out), Err(error));
        }
        assert_eq!(frame.open(IDENTITY, &mut [0.0; 2]), Err(FrameError::Count));
    }

    #[test]
    fn zeroed_memory_is_not_a_frame() {
        assert_eq!(
            Frame::<{ words(16) }>::default().open(IDENTITY, &mut [0.0]),
            Err(FrameError::Corrupt)
        );
    }

    #[test]
    fn negative_zero_and_odd_nans_do_not_cross() {
        let mut values = [1.0; 2];
        frame(&[-0.0, f64::from_bits(0xfff8_0000_0000_0001)])
            .open(IDENTITY, &mut values)
            .expect("opens");
        assert_eq!(values.map(f64::to_bits), [0, f64::NAN.to_bits()]);
    }

    #[test]
    fn classes_grow_with_the_count() {
        assert_eq!(SizeClass::for_count(0), Some(SizeClass::N16));
        assert_eq!(SizeClass::for_count(17), Some(SizeClass::N32));
        assert_eq!(SizeClass::for_count(512), Some(SizeClass::N512));
        assert_eq!(SizeClass::for_count(513), None);
    }
}
