//! Notes about what happens on a medium beside the frames of the port: the first of each kind is printed, all are counted.

use std::mem::take;

/// Most bytes of a frame that are printed.
pub(super) const MOST_BYTES: usize = 64;

/// Kind of note.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoteKind {
    /// Frame or connection of a sender other than the peer.
    OtherSender,
    /// Sender that takes the place of the peer.
    NewPeer,
    /// Bytes that belong to no frame.
    NoFrame,
    /// Frames that the kernel dropped.
    Dropped,
    /// Error frame, on CAN.
    ErrorFrame,
    /// Remote request, on CAN.
    RemoteRequest,
    /// File that cannot be read.
    Unreadable,
}

/// Note about a medium.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    /// Kind.
    pub kind: NoteKind,
    /// Description.
    pub text: String,
    /// Beginning of the bytes that arrived; empty if there are none.
    pub bytes: Vec<u8>,
    /// Number of bytes that arrived.
    pub size: usize,
}

/// Notes that are not printed yet, each the first of its kind.
#[derive(Debug, Default)]
pub(super) struct Notes {
    known: Vec<NoteKind>,
    waiting: Vec<Note>,
}

impl Notes {
    /// Keeps a note if it is the first of its kind; `text` is only then called.
    pub(super) fn add(&mut self, kind: NoteKind, bytes: &[u8], text: impl FnOnce() -> String) {
        if self.known.contains(&kind) {
            return;
        }
        self.known.push(kind);
        self.waiting.push(Note {
            kind,
            text: text(),
            bytes: bytes[..bytes.len().min(MOST_BYTES)].to_vec(),
            size: bytes.len(),
        });
    }

    /// Takes the notes that wait to be printed.
    pub(super) fn take(&mut self) -> Vec<Note> {
        take(&mut self.waiting)
    }
}

/// Returns the beginning of a frame of this size as a text.
pub fn hex(bytes: &[u8], size: usize) -> String {
    let beginning = &bytes[..bytes.len().min(MOST_BYTES)];
    let hex: Vec<String> = beginning.iter().map(|byte| format!("{byte:02x}")).collect();
    let rest = match size > beginning.len() {
        true => format!(" .. ({size} in all)"),
        false => String::new(),
    };
    hex.join(" ") + &rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_note_of_a_kind_has_the_beginning_and_the_size_of_its_bytes() {
        let mut notes = Notes::default();
        notes.add(NoteKind::NoFrame, &[7; 100], || "first".into());
        notes.add(NoteKind::NoFrame, &[8; 2], || unreachable!());
        let [note] = notes.take().try_into().expect("one note");
        assert_eq!(note.bytes, [7; MOST_BYTES]);
        assert!(hex(&note.bytes, note.size).ends_with("07 .. (100 in all)"));
        assert_eq!(hex(&[1, 0xAB], 2), "01 ab");
        assert!(notes.take().is_empty());
    }
}
