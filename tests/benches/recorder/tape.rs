//! The records of a real run, for repeated playback.

use std::path::Path;

use hil_config::plan::Plan;
use hil_config::scenario::Scenario;
use hil_recording::reader::RunReader;
use shared_types::link::LinkError;
use shared_types::record::{Event, RecordLayout};
use shared_types::stream::{Item, RecordSource};
use shared_types::table::Field;

use crate::cpu_ns;

/// Items of one drain.
const BATCH: usize = 1000;

/// A run in memory.
pub(crate) struct Tape {
    /// Plan of the run.
    pub(crate) plan: Plan,
    /// Layout of its records.
    pub(crate) layout: RecordLayout,
    words: Vec<u64>,
    end: Event,
}

impl Tape {
    /// Reads the run from a folder.
    pub(crate) fn read(folder: &Path, arguments: &[String]) -> Self {
        let mut reader = RunReader::open(folder).expect("a run");
        let fields = |group: &str| -> Vec<Field> {
            let prefix = format!("{group}.");
            let columns = reader.columns().iter();
            let signal = |name: &str, unit: &str| Field::signal(name, unit, "");
            columns
                .filter_map(|column| Some(signal(column.name.strip_prefix(&prefix)?, &column.unit)))
                .collect()
        };
        let mut layout = RecordLayout {
            truth: fields("truth"),
            measured: fields("measured"),
            reference: fields("reference"),
            command: fields("command"),
            internal: fields("internal"),
            input: Vec::new(),
            parameter: fields("parameter"),
            sensor: fields("sensor"),
            actuator: fields("actuator"),
            cut: Vec::new(),
            command_signals: 0,
            command_places: Vec::new(),
        };
        layout.command_signals = layout.command.len() + layout.internal.len();
        let mut words = Vec::new();
        while reader.advance().expect("a whole recording") {
            words.extend_from_slice(reader.words());
        }
        assert_eq!(words.len() % layout.words(), 0);
        let end = reader.events().last().expect("an end").clone();
        Self {
            plan: plan(arguments),
            layout,
            words,
            end,
        }
    }

    /// Iterates over the records, each as its words.
    pub(crate) fn records(&self) -> impl ExactSizeIterator<Item = &[u64]> {
        self.words.chunks_exact(self.layout.words())
    }
}

fn plan(settings: &[String]) -> Plan {
    let plants: Vec<_> = (plant_process::models::all().into_iter())
        .map(|kind| kind.description)
        .collect();
    let laws: Vec<_> = (controller_process::laws::all().into_iter())
        .map(|kind| kind.description)
        .collect();
    (Scenario::read(crate::scenario_file()).expect("a scenario"))
        .set(settings)
        .check(&plants, &laws, &[])
        .unwrap_or_else(|problems| panic!("{problems}"))
}

/// Passes a tape to the recorder's thread, and counts the processor time of that thread.
pub(crate) struct Replay {
    tape: std::sync::Arc<Tape>,
    at: usize,
    begun_ns: Option<f64>,
    taken_ns: std::sync::mpsc::Sender<f64>,
}

impl Replay {
    pub(crate) fn new(tape: std::sync::Arc<Tape>, taken_ns: std::sync::mpsc::Sender<f64>) -> Self {
        Self {
            tape,
            at: 0,
            begun_ns: None,
            taken_ns,
        }
    }
}

impl RecordSource for Replay {
    fn drain(&mut self, take: &mut dyn FnMut(Item<'_>)) -> Result<usize, LinkError> {
        let begun_ns = *self.begun_ns.get_or_insert_with(cpu_ns);
        let batch = self.tape.records().skip(self.at).take(BATCH);
        let count = batch.len();
        batch.for_each(|words| take(Item::Record(words)));
        self.at += count;
        if count == 0 {
            let taken_ns = cpu_ns() - begun_ns;
            self.taken_ns.send(taken_ns).expect("somebody listens");
            take(Item::Event(self.tape.end.clone()));
        }
        Ok(count)
    }
}
