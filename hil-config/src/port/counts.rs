//! Counts of a port at the end of a run, as `hil-port` writes them and the summary shows them.

use serde::{Deserialize, Serialize};
use shared_types::text;

/// Name of the file in the session's folder with the counts of a port.
pub const COUNTS_FILE: &str = "port.json";
/// Name of the file in the session's folder with the counts of a port in front of the plant.
pub const PLANT_COUNTS_FILE: &str = "plant-port.json";

/// Counts of a port.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counts {
    /// `false` if the far end keeps a clock of its own, so that equal runs differ.
    pub repeatable: bool,
    /// Frames, in the order of the port file.
    pub frames: Vec<FrameCounts>,
    /// Media, in the order of the port file.
    pub media: Vec<MediumCounts>,
}

/// Counts of one frame.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrameCounts {
    /// Name.
    #[serde(deserialize_with = "text::line_of")]
    pub name: String,
    /// Times it was sent.
    pub sent: u64,
    /// Times it was sent once more because nothing had answered the first sample.
    #[serde(default)]
    pub resent: u64,
    /// Values that were sent as the limit of their field.
    pub saturated: u64,
    /// Times it arrived and was accepted.
    pub accepted: u64,
    /// Times it arrived with the same counter as the frame before.
    pub repeated: u64,
    /// Times it arrived and was refused for another reason.
    pub refused: u64,
    /// Times that a gap in its counter shows it is missing.
    pub lost: u64,
    /// Fields that were refused in accepted frames.
    pub refused_fields: u64,
    /// Times it arrived before the sample that it should answer.
    pub unasked: u64,
}

/// Counts of one medium.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MediumCounts {
    /// Name.
    #[serde(deserialize_with = "text::line_of")]
    pub name: String,
    /// Frames that are none of the port's.
    pub foreign: u64,
    /// Frames from a sender other than the peer; on a stream, its connections.
    pub strangers: u64,
    /// Address, path or process of the first such sender.
    #[serde(
        default,
        skip_serializing_if = "Option::is_none",
        deserialize_with = "text::line_if_any"
    )]
    pub first_stranger: Option<String>,
    /// Times that another sender took the place of the peer.
    pub new_peers: u64,
    /// Bytes that belong to no frame.
    pub skipped_bytes: u64,
    /// Attempts to send that reached nobody.
    pub unsent: u64,
    /// Error frames, on CAN.
    #[serde(default)]
    pub error_frames: u64,
    /// Remote requests, on CAN.
    #[serde(default)]
    pub remote_requests: u64,
    /// Reads that failed, of a file.
    #[serde(default)]
    pub unreadable: u64,
    /// Frames that the kernel dropped because its buffer was full.
    #[serde(default)]
    pub dropped: u64,
}

impl Counts {
    /// Describes what went wrong on the wire; empty if nothing did.
    #[must_use]
    pub fn describe(&self) -> Vec<String> {
        let list = |counts: &[(u64, &str)]| {
            let counts = counts.iter().filter(|(count, _)| *count > 0);
            let texts: Vec<String> = counts
                .map(|(count, what)| format!("{count} {what}"))
                .collect();
            texts.join(", ")
        };
        let frames = self.frames.iter().map(|one| {
            let counts = [
                (one.resent, "sent once more before the first answer"),
                (one.saturated, "saturated values"),
                (one.repeated, "repeated"),
                (one.refused, "refused"),
                (one.lost, "lost"),
                (one.refused_fields, "refused fields"),
                (one.unasked, "before their sample"),
            ];
            (format!("frame {}", one.name), list(&counts))
        });
        let media = self.media.iter().map(|one| {
            let of_others = match &one.first_stranger {
                Some(first) => format!("frames of other senders (the first is {first})"),
                None => "frames of other senders".into(),
            };
            let counts = [
                (one.foreign, "foreign frames"),
                (one.strangers, &*of_others),
                (one.new_peers, "new peers"),
                (one.skipped_bytes, "bytes of no frame"),
                (one.unsent, "attempts to send that reached nobody"),
                (one.error_frames, "error frames"),
                (one.remote_requests, "remote requests"),
                (one.unreadable, "reads that failed"),
                (one.dropped, "dropped by the kernel"),
            ];
            (format!("medium {}", one.name), list(&counts))
        });
        { frames.chain(media) }
            .filter(|(_, counts)| !counts.is_empty())
            .map(|(name, counts)| format!("port: {name}: {counts}"))
            .collect()
    }
}
