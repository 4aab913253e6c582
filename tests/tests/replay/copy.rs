//! Modified copy of a recording.

use std::collections::BTreeMap;
use std::path::Path;

use hil_recording::compression::Compression;
use hil_recording::reader::RunReader;
use hil_recording::writer::{Attachment, Provenance, Recording};
use shared_types::record::RecordLayout;
use shared_types::table::Field;

/// Copy of a recording, written by the code that writes all recordings.
pub(super) struct Copy {
    pub(super) layout: RecordLayout,
    pub(super) records: Vec<Vec<u64>>,
    pub(super) columns: Vec<String>,
    pub(super) provenance: Provenance,
}

impl Copy {
    pub(super) fn of(path: &Path) -> Self {
        let mut reader = RunReader::open(path).expect("opens");
        let fields = |group: &str| -> Vec<Field> {
            let of_group = |name: &str| {
                name.strip_prefix(group)?
                    .strip_prefix('.')
                    .map(str::to_owned)
            };
            (reader.columns().iter())
                .filter_map(|column| {
                    Some(Field::signal(&of_group(&column.name)?, &column.unit, "x"))
                })
                .collect()
        };
        let (command, internal) = (fields("command"), fields("internal"));
        let layout = RecordLayout {
            truth: fields("truth"),
            measured: fields("measured"),
            reference: fields("reference"),
            command_signals: command.len() + internal.len(),
            command_places: (0..command.len()).collect(),
            command,
            internal,
            input: Vec::new(),
            parameter: fields("parameter"),
            sensor: fields("sensor"),
            actuator: fields("actuator"),
            cut: Vec::new(),
        };
        let columns = reader
            .columns()
            .iter()
            .map(|column| column.name.clone())
            .collect();
        let attached = |name, media_type| Attachment {
            name,
            media_type,
            text: reader.attachment(name).expect("enclosed").into(),
        };
        let facts = ["rate_hz", "controller_blake3"];
        let fact = |name: &str| Some((name.to_owned(), reader.fact(name)?.to_owned()));
        let provenance = Provenance {
            facts: facts.into_iter().filter_map(fact).collect(),
            attachments: vec![
                attached("scenario.toml", "application/toml"),
                attached("plant-description.json", "application/json"),
                attached("controller-description.json", "application/json"),
            ],
        };
        let mut records = Vec::new();
        while reader.advance().expect("reads") {
            records.push(reader.words().to_vec());
        }
        Self {
            layout,
            records,
            columns,
            provenance,
        }
    }

    /// Replaces a name in the recorded description of the controller.
    pub(super) fn describe(&mut self, before: &str, now: &str) {
        let description = self.provenance.attachments.last_mut().expect("three");
        description.text = description.text.replace(before, now);
    }

    pub(super) fn write(&self, path: &Path, change: impl Fn(&mut Vec<u64>, &[String])) {
        let recording =
            Recording::create(path, Compression::Lz4, &self.layout, &self.provenance, None);
        let mut recording = recording.expect("created");
        for words in &self.records {
            let mut words = words.clone();
            change(&mut words, &self.columns);
            let view = self.layout.view(&words);
            recording.record(&words, &view).expect("written");
        }
        recording.finish(BTreeMap::new()).expect("finished");
    }
}
