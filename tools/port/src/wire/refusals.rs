//! Refused frames, and values beyond the range of their fields: printed once for each kind, with the bytes.

use std::mem::Discriminant;

use hil_codec::pack::Packer;
use hil_codec::row::{FieldResult, Refusal};
use hil_config::port::Port;

/// Most kinds of refusals that are printed; all are counted.
const MOST_PRINTED: usize = 20;
/// Most bytes of a refused frame that are printed.
const MOST_BYTES: usize = 64;

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

/// Returns `true` for the first refusal of a kind, as far as refusals are printed.
pub(super) fn is_new(printed: &mut Vec<Kind>, kind: Kind) -> bool {
    let is_new = printed.len() < MOST_PRINTED && !printed.contains(&kind);
    if is_new {
        printed.push(kind);
    }
    is_new
}

/// Prints a refusal with the bytes of the frame.
pub(super) fn report(
    port: &Port,
    medium: usize,
    frame: Option<usize>,
    refusal: &Refusal,
    bytes: &[u8],
) {
    let why = match frame {
        Some(frame) => refusal.describe(&port.frames[frame].frame),
        None => "no frame is received on this medium".into(),
    };
    hil_session::program::say(&format!(
        "medium `{}`: refused: {why}; bytes: {} (further ones of this kind are counted only)",
        port.media[medium].name,
        hex(bytes)
    ));
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
        hil_session::program::say(&format!(
            "frame `{}`: `{signal}` is beyond {low:?} to {high:?} and sent as the limit; bytes: {} (further ones are counted only)",
            frame.name,
            hex(bytes)
        ));
    }
}

/// Returns bytes as a text, of long frames the beginning.
fn hex(bytes: &[u8]) -> String {
    let beginning = &bytes[..bytes.len().min(MOST_BYTES)];
    let hex: Vec<String> = beginning.iter().map(|byte| format!("{byte:02x}")).collect();
    let rest = match bytes.len() > beginning.len() {
        true => " ..",
        false => "",
    };
    hex.join(" ") + rest
}
