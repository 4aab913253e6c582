//! CAN: identifiers and their flags, which an interface of the kernel and cannelloni write alike.

mod cannelloni;
mod socket;

use hil_codec::frame::CanId;

pub(super) use cannelloni::Cannelloni;
pub(super) use socket::Interface;

use super::notes::Notes;
use super::{NoteKind, Tally};

/// Flag of an identifier of 29 bits.
const EXTENDED: u32 = 1 << 31;
/// Flag of a remote request, which has no data.
const REMOTE: u32 = 1 << 30;
/// Flag of an error frame.
const ERROR: u32 = 1 << 29;
/// Most bytes of a frame of CAN 2.0.
const CLASSIC: usize = 8;

/// Returns an identifier with its flags.
fn raw_id(id: Option<CanId>) -> u32 {
    match id {
        Some(CanId::Standard(id)) => u32::from(id),
        Some(CanId::Extended(id)) => id | EXTENDED,
        None => 0,
    }
}

/// Returns the identifier of a data frame. Error frames and remote requests are counted and have none.
fn data_id(raw: u32, data: &[u8], counts: &mut Tally, notes: &mut Notes) -> Option<CanId> {
    if raw & ERROR != 0 {
        counts.error_frames += 1;
        notes.add(NoteKind::ErrorFrame, data, || {
            format!(
                "an error frame of class {:#x} (linux/can/error.h)",
                raw & 0x1FFF_FFFF
            )
        });
        return None;
    }
    if raw & REMOTE != 0 {
        counts.remote_requests += 1;
        notes.add(NoteKind::RemoteRequest, data, || {
            format!("a remote request for id {:#x}", raw & 0x1FFF_FFFF)
        });
        return None;
    }
    Some(match raw & EXTENDED {
        0 => CanId::Standard((raw & 0x7FF) as u16),
        _ => CanId::Extended(raw & 0x1FFF_FFFF),
    })
}
