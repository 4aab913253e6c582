//! Refused frames: printed once for each kind, with their bytes.

use std::mem::Discriminant;

use hil_codec::row::Refusal;
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
    let beginning = &bytes[..bytes.len().min(MOST_BYTES)];
    let hex: Vec<String> = beginning.iter().map(|byte| format!("{byte:02x}")).collect();
    let rest = match bytes.len() > beginning.len() {
        true => " ..",
        false => "",
    };
    hil_session::program::say(&format!(
        "medium `{}`: refused: {why}; bytes: {}{rest} (further ones of this kind are counted only)",
        port.media[medium].name,
        hex.join(" ")
    ));
}
