//! Receiving: the frames of one medium and direction, the choice among them, and their values in a row.

use shared_types::layout::SignalTable;

use crate::frame::{CanId, Frame};
use crate::pack::Unusable;
use crate::row::{Refusal, Row};
use crate::unpack::Unpacker;

pub use crate::unpack::Counts;

/// Receiver of the frames of one medium and direction.
///
/// On CAN the identifier names the frame. Elsewhere a single frame is meant by all bytes; of several, the first whose
/// length, constants and checksum fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Receiver {
    frames: Vec<(Option<CanId>, Unpacker)>,
    /// Frames that belong to none of these.
    foreign: u64,
}

impl Receiver {
    /// Binds frames to the table of the row that they are unpacked into.
    ///
    /// # Errors
    /// If a frame has mistakes, or the table lacks a signal.
    pub fn new(frames: &[Frame], row: &SignalTable) -> Result<Self, Unusable> {
        let frames = frames
            .iter()
            .map(|frame| Ok((frame.id, Unpacker::new(frame, row)?)));
        Ok(Self {
            frames: frames.collect::<Result<_, Unusable>>()?,
            foreign: 0,
        })
    }

    /// Unpacks the bytes of a frame into a row, and returns the index of the frame if it is one of these.
    ///
    /// A refused frame makes its signals invalid, except one that repeats the counter of the last.
    #[inline]
    pub fn receive(
        &mut self,
        id: Option<CanId>,
        bytes: &[u8],
        row: &mut Row,
    ) -> (Option<usize>, Result<(), Refusal>) {
        let frame = match (id, self.frames.as_mut_slice()) {
            (None, [_]) => Some(0),
            (None, frames) => {
                (frames.iter_mut()).position(|(_, unpacker)| unpacker.check(bytes).is_ok())
            }
            (Some(_), frames) => frames.iter().position(|(known, _)| *known == id),
        };
        let Some(index) = frame else {
            self.foreign += 1;
            let bytes = bytes.len();
            let refusal = id.map_or(Refusal::Foreign { bytes }, Refusal::ForeignId);
            return (None, Err(refusal));
        };
        (Some(index), self.frames[index].1.unpack(bytes, row))
    }

    /// Returns the columns of the signals of a frame.
    #[must_use]
    pub fn columns(&self, frame: usize) -> &[usize] {
        self.frames[frame].1.columns()
    }

    /// Returns the counts of a frame.
    #[must_use]
    pub fn counts(&self, frame: usize) -> Counts {
        self.frames[frame].1.counts
    }

    /// Returns the state between two frames, for a checkpoint: the count of foreign frames, then last counter and counts
    /// of each frame.
    #[must_use]
    pub fn state(&self) -> Vec<u64> {
        let frames = self.frames.iter();
        let frames = frames.flat_map(|(_, unpacker)| unpacker.state());
        std::iter::once(self.foreign).chain(frames).collect()
    }

    /// Restores a state; returns `false` if it is one of other frames.
    #[must_use]
    pub fn restore(&mut self, state: &[u64]) -> bool {
        let Some((foreign, frames)) = state.split_first() else {
            return false;
        };
        let (states, rest) = frames.as_chunks();
        let is_whole = rest.is_empty() && states.len() == self.frames.len();
        if is_whole {
            self.foreign = *foreign;
            for ((_, unpacker), state) in self.frames.iter_mut().zip(states) {
                unpacker.restore(*state);
            }
        }
        is_whole
    }

    /// Returns the number of frames that belong to none of these.
    #[must_use]
    pub const fn foreign(&self) -> u64 {
        self.foreign
    }
}
