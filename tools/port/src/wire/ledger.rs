//! Counts of a wire, and the sentences about them.

use std::time::Duration;

use hil_config::port::PortFrame;
use hil_config::port::counts::{Counts, FrameCounts, MediumCounts};

use super::Wire;
use crate::medium;

/// Rate in Hz above which frames are a flood: that of the fastest loops.
const FLOOD_HZ: f64 = 10_000.0;

impl Wire {
    /// Returns the counts so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        let named = |one: &PortFrame| FrameCounts {
            name: one.frame.name.clone(),
            ..FrameCounts::default()
        };
        let mut counts = Counts {
            frames: self.port.frames.iter().map(named).collect(),
            media: Vec::new(),
            repeatable: self.port.is_repeatable,
        };
        for one in &self.outgoing {
            let count = &mut counts.frames[one.frame];
            count.sent = one.sent;
            count.resent = one.resent;
            count.saturated = one.packer.saturated().iter().sum();
        }
        for (medium, incoming) in self.port.media.iter().zip(&self.media) {
            for (place, frame) in incoming.frames.iter().enumerate() {
                let (count, received) =
                    (&mut counts.frames[*frame], incoming.receiver.counts(place));
                count.accepted = received.accepted;
                count.repeated = received.repeated;
                count.refused = received.refused;
                count.lost = received.lost;
                count.refused_fields = received.refused_fields;
                count.unasked = self.unasked[*frame];
            }
            let of_medium = incoming.medium.counts();
            counts.media.push(MediumCounts {
                name: medium.name.clone(),
                foreign: incoming.receiver.foreign(),
                strangers: of_medium.strangers,
                first_stranger: incoming.medium.first_other().map(str::to_owned),
                new_peers: of_medium.new_peers,
                skipped_bytes: of_medium.skipped_bytes,
                unsent: of_medium.unsent,
                error_frames: of_medium.error_frames,
                remote_requests: of_medium.remote_requests,
                unreadable: of_medium.unreadable,
                dropped: of_medium.dropped,
            });
        }
        counts
    }

    /// Returns the number of frames that the media have brought, whoever sent them, with those that the kernel dropped.
    #[must_use]
    pub fn traffic(&self) -> u64 {
        let media = self.media.iter().map(|incoming| incoming.medium.counts());
        self.read + media.map(|one| one.strangers + one.dropped).sum::<u64>()
    }

    /// Describes what has arrived instead of a frame that was awaited for some time, with the traffic at its beginning;
    /// begins with a semicolon, and is empty if nothing has arrived.
    #[must_use]
    pub fn others(&self, before: u64, time: Duration) -> String {
        let counts = self.counts();
        let of_media = |count: fn(&MediumCounts) -> u64| counts.media.iter().map(count).sum();
        let refused = counts.frames.iter().map(|frame| frame.refused).sum();
        let repeated = counts.frames.iter().map(|frame| frame.repeated).sum();
        let first = (counts.media.iter()).find_map(|medium| medium.first_stranger.as_deref());
        let of_others = match first {
            Some(first) => format!("of other senders (the first is {first})"),
            None => "of other senders".into(),
        };
        let texts: [(u64, &str); 6] = [
            (refused, "refused"),
            (repeated, "with the counter of the one before"),
            (of_media(|medium| medium.foreign), "of no frame of the port"),
            (of_media(|medium| medium.strangers), &of_others),
            (of_media(|medium| medium.skipped_bytes), "bytes of no frame"),
            (
                of_media(|medium| medium.dropped),
                "dropped by the kernel, whose buffer was full",
            ),
        ];
        let texts: Vec<String> = (texts.iter())
            .filter(|(count, _)| *count > 0)
            .map(|(count, text)| format!("{count} {text}"))
            .collect();
        let rate_hz = (self.traffic() - before) as f64 / time.as_secs_f64();
        let flood = match rate_hz >= FLOOD_HZ {
            true => format!("; a flood of {rate_hz:.0} frames a second"),
            false => String::new(),
        };
        match texts.is_empty() {
            true => flood,
            false => format!("; arrived so far: {}{flood}", texts.join(", ")),
        }
    }

    /// Returns the media as a text for messages.
    #[must_use]
    pub fn places(&self) -> String {
        let places: Vec<String> = { self.port.media.iter() }
            .map(|medium| medium::place(&medium.kind))
            .collect();
        places.join("; ")
    }
}
