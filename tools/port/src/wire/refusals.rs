//! Refused frames, and values beyond the range of their fields: printed once for each kind, with the bytes.

use std::mem::{Discriminant, discriminant};

use hil_codec::pack::Packer;
use hil_codec::row::{FieldResult, Refusal};
use hil_config::port::Port;
use hil_session::program::say;

use super::MOST_AT_ONCE;
use crate::medium::{Note, NoteKind, hex};

/// Most kinds of refusals that are printed; all are counted.
const MOST_PRINTED: usize = 20;

/// Kind of refusal: the frame, if it is known, and the reason.
pub(super) type Kind = (Option<usize>, Discriminant<Refusal>);

/// Returns `true` if bytes are none of a frame, so that a stream has to be searched again.
pub(super) const fn is_no_frame(refusal: &Refusal) -> bool {
    matches!(
        refusal,
        Refusal::Foreign { .. } | Refusal::Constant { .. } | Refusal::Checksum { .. }
    )
}

/// Returns `true` if a refused frame is an answer nevertheless: the peer has sent it, whatever it has counted.
pub(super) const fn is_answer(refusal: &Refusal) -> bool {
    matches!(refusal, Refusal::Jump { .. })
}

/// Prints a refusal with the bytes of the frame, of which the beginning and the size are given, if it is the first of its
/// kind and as far as refusals are printed. The medium and the frame are those that were meant.
pub(super) fn report(
    printed: &mut Vec<Kind>,
    port: &Port,
    (medium, frame): (usize, Option<usize>),
    refusal: &Refusal,
    (bytes, size): (&[u8], usize),
) {
    let kind = (frame, discriminant(refusal));
    if printed.len() == MOST_PRINTED || printed.contains(&kind) {
        return;
    }
    printed.push(kind);
    let why = match frame {
        Some(frame) => of_size(refusal, size).describe(&port.frames[frame].frame),
        None => "no frame is received on this medium".into(),
    };
    say(&format!(
        "medium `{}`: refused: {why}; bytes: {} (further ones of this kind are counted only)",
        port.media[medium].name,
        hex(bytes, size)
    ));
}

/// Returns a refusal with the size of a frame of which only the beginning was received.
const fn of_size(refusal: &Refusal, bytes: usize) -> Refusal {
    match *refusal {
        Refusal::Oversized { expected, .. } => Refusal::Oversized { bytes, expected },
        Refusal::Foreign { .. } => Refusal::Foreign { bytes },
        other => other,
    }
}

/// Prints a note about a medium, on which these frames are received.
pub(super) fn report_note(port: &Port, medium: usize, frames: &[usize], note: &Note) {
    let instead = match (note.kind, frames) {
        (NoteKind::NoFrame, [frame]) => {
            format!(", instead of frame `{}`", port.frames[*frame].frame.name)
        }
        _ => String::new(),
    };
    let bytes = match note.bytes.as_slice() {
        [] => String::new(),
        bytes => format!("; bytes: {}", hex(bytes, note.size)),
    };
    say(&format!(
        "medium `{}`: {}{instead}{bytes} (further ones of this kind are counted only)",
        port.media[medium].name, note.text
    ));
}

/// Prints that a medium brings more frames than a step reads, once.
pub(super) fn report_flood(port: &Port, medium: usize, is_flooded: &mut bool) {
    if !*is_flooded {
        *is_flooded = true;
        let name = &port.media[medium].name;
        say(&format!(
            "medium `{name}`: a flood of more than {MOST_AT_ONCE} frames at once, of which those behind wait or are dropped (said once)"
        ));
    }
}

/// Prints each field of a sent frame that has a value beyond its range for the first time.
pub(super) fn report_saturated(port: &Port, frame: usize, packer: &Packer, bytes: &[u8]) {
    for (place, result) in packer.results().iter().enumerate() {
        let is_first = packer.saturated()[place] == 1;
        if *result != FieldResult::Saturated || !is_first {
            continue;
        }
        let frame = &port.frames[frame].frame;
        let Some((signal, number)) = frame.signals().nth(place) else {
            continue;
        };
        let (low, high) = number.range();
        say(&format!(
            "frame `{}`: `{signal}` is beyond {low:?} to {high:?} and sent as the limit; bytes: {} (further ones are counted only)",
            frame.name,
            hex(bytes, bytes.len())
        ));
    }
}
