//! Ends of frames on a stream of bytes: a line, or a length behind a constant.

use hil_codec::frame::{Body, Content, Frame};

use super::{LONGEST, hex};

/// Ends of frames on a stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Cut {
    /// A frame ends with its line.
    Line,
    /// Frames of fixed lengths, each with the bytes that it begins with.
    Lengths(Vec<(usize, Vec<u8>)>),
}

impl Cut {
    /// Returns the ends of received frames.
    ///
    /// # Errors
    /// If they cannot be told apart in a stream.
    pub fn of<'a>(
        frames: impl Iterator<Item = &'a Frame>,
        is_serial: bool,
    ) -> Result<Self, String> {
        let (mut lines, mut lengths) = (Vec::new(), Vec::new());
        for frame in frames {
            match &frame.body {
                Body::Json(_) => lines.push(&frame.name),
                Body::Bytes { length, .. } => lengths.push((*length, sync(frame))),
            }
        }
        match (lines.as_slice(), lengths.as_slice()) {
            ([], [(_, sync)]) if is_serial && sync.is_empty() => Err("a frame on a serial line must begin with a constant, by which its beginning is found".into()),
            ([], [_] | []) => Ok(Self::Lengths(lengths)),
            ([], _) if are_ambiguous(&lengths) => Err("two frames of different lengths on a stream begin with the same constant; give each its own".into()),
            ([], _) if lengths.iter().all(|(_, sync)| !sync.is_empty()) => Ok(Self::Lengths(lengths)),
            ([], _) => Err("several frames of bytes on a stream must each begin with a constant, by which they are found".into()),
            (_, []) => Ok(Self::Line),
            ([line, ..], _) => Err(format!("frame {line} is a line of JSON and another one on the same stream is bytes; use one format for a stream")),
        }
    }

    /// Describes bytes that are skipped.
    pub(super) fn describe(&self, skipped: &[u8]) -> String {
        let sync = match self {
            Self::Line => return format!("a line of more than {LONGEST} bytes"),
            Self::Lengths(frames) => match frames.as_slice() {
                [(_, sync)] if !sync.is_empty() => sync,
                _ => return "bytes that no frame begins with".into(),
            },
        };
        let is_reversed = |bytes: &[u8]| bytes.iter().eq(sync.iter().rev());
        let order = match sync.len() > 1 && skipped.windows(sync.len()).any(is_reversed) {
            true => ", but have it in the other byte order",
            false => "",
        };
        format!(
            "bytes that do not begin with {}{order}",
            hex(sync, sync.len())
        )
    }

    /// Returns how many bytes to skip, and the length of the frame behind them if it is complete.
    pub(super) fn find(&self, bytes: &[u8]) -> (usize, Option<usize>) {
        match self {
            Self::Line => match bytes.iter().position(|byte| *byte == b'\n') {
                Some(end) if end > LONGEST => (end + 1, None),
                Some(end) => (0, Some(end + 1)),
                None => (0, None),
            },
            Self::Lengths(frames) => {
                for skip in 0..bytes.len() {
                    let rest = &bytes[skip..];
                    for (length, sync) in frames {
                        let known = rest.len().min(sync.len());
                        if rest[..known] == sync[..known] {
                            let is_whole = rest.len() >= *length;
                            return (skip, is_whole.then_some(*length));
                        }
                    }
                }
                (bytes.len(), None)
            }
        }
    }
}

/// Returns `true` if the beginning of a frame does not tell its length.
fn are_ambiguous(frames: &[(usize, Vec<u8>)]) -> bool {
    frames.iter().enumerate().any(|(index, (length, sync))| {
        frames[..index].iter().any(|(other_length, other)| {
            length != other_length && (sync.starts_with(other) || other.starts_with(sync))
        })
    })
}

/// Returns the constant bytes that a frame begins with.
fn sync(frame: &Frame) -> Vec<u8> {
    let Body::Bytes { length, fields } = &frame.body else {
        return Vec::new();
    };
    let (mut image, mut is_constant) = (vec![0; *length], vec![0u8; *length]);
    for field in fields {
        if let Content::Constant(raw) = field.content {
            field.bits.write(&mut image, raw);
            for (byte, mask) in is_constant.iter_mut().enumerate() {
                *mask |= field.bits.mask_of(byte);
            }
        }
    }
    let count = is_constant.iter().take_while(|mask| **mask == 0xFF).count();
    image.truncate(count);
    image
}
