//! Small recordings for the unit tests of this package and of `tools`.

use std::collections::BTreeMap;
use std::ops::Deref;
use std::path::Path;

use hil_recording::compression::Compression;
use hil_recording::reader::RECORDING;
use hil_recording::writer::{Attachment, Provenance, Recording};
use shared_types::record::{Event, FaultBegun, RecordLayout, Timing};
use shared_types::table::Field;
use tempfile::TempDir;

/// Layout of a small run: `truth.x_m`, `measured.x_m`, `command.u_n`, and the columns derived from them.
pub(crate) fn layout() -> RecordLayout {
    RecordLayout {
        truth: vec![Field::signal("x_m", "m", "Place.")],
        measured: vec![Field::signal("x_m", "m", "Place [as seen].")],
        command: vec![Field::signal("u_n", "N", "Force.")],
        command_signals: 1,
        parameter: vec![Field::signal("mass_kg", "kg", "Mass.")],
        ..RecordLayout::default()
    }
}

/// Builds a record: step, both validity words, then truth, measured, command, applied, sensed and parameter, then
/// timing.
pub(crate) fn record(step: u64, truth: f64, command: f64) -> Vec<u64> {
    let values = [truth, truth, command, command, truth, 1.0].map(f64::to_bits);
    let mut timing = [0; Timing::WORDS];
    (timing[0], timing[1], timing[4]) = (step.wrapping_mul(1000), 1, 77);
    [&[step, 0, 0][..], &values, &timing].concat()
}

pub(crate) fn taken(step: u64) -> Event {
    Event::Fault(FaultBegun {
        id: 1,
        effect: 0,
        step,
        kind: "bias".into(),
        target: "measured.x_m".into(),
        parameter: "x_m".into(),
        canonical: "bias=0 step".into(),
        wall_only: false,
    })
}

/// Item of a recording, in order.
#[expect(clippy::large_enum_variant, reason = "a test has few of them")]
pub(crate) enum Content {
    Record(Vec<u64>),
    Event(Event),
}

/// Temporary folder of a recording, removed on drop.
pub(crate) struct Folder(TempDir);

impl Deref for Folder {
    type Target = Path;

    fn deref(&self) -> &Path {
        self.0.path()
    }
}

/// Writes the recording of a complete run into a new folder.
pub(crate) fn recorded(
    layout: &RecordLayout,
    contents: &[Content],
    attachments: Vec<Attachment>,
) -> Folder {
    chunked(layout, contents, attachments, Compression::Lz4, u64::MAX)
}

/// Writes the same with this number of records in each chunk.
pub(crate) fn chunked(
    layout: &RecordLayout,
    contents: &[Content],
    attachments: Vec<Attachment>,
    compression: Compression,
    chunk: u64,
) -> Folder {
    let folder = Folder(TempDir::new().expect("a folder"));
    let provenance = Provenance {
        facts: BTreeMap::from([("rate_hz".into(), "1000".into())]),
        attachments,
    };
    let path = folder.join(RECORDING);
    let mut recording =
        Recording::create(&path, compression, layout, &provenance, None).expect("created");
    let mut records = 0;
    for content in contents {
        match content {
            Content::Record(words) => {
                let view = layout.view(words);
                recording.record(words, &view).expect("written");
                records += 1;
                if records % chunk == 0 {
                    recording.close().expect("written");
                }
            }
            Content::Event(event) => recording.event(event, None, 0).expect("written"),
        }
    }
    let result = BTreeMap::from([("outcome".into(), "completed".into())]);
    recording.finish(result).expect("finished");
    folder
}
