//! Facts about a recording beyond its signals' names: derived signals of its scenario, and the provenance of the
//! exported table.

use std::collections::BTreeMap;

use hil_config::plan;
use hil_facts::results::evaluation::RecordEvaluation;
use hil_facts::results::recorded_run::RecordedRun;
use hil_facts::results::summary::MarkAt;
use hil_recording::reader::RunReader;

use super::cell::Column;

/// Reconstructs the run of a recording; the error is the reason why that is impossible.
pub(super) fn recorded_run(reader: &RunReader) -> Result<RecordedRun, String> {
    RecordedRun::of(reader, reader.path()).map_err(|failure| failure.reason())
}

/// Returns the derived signals of a run's scenario, in the order of the scenario.
pub(super) fn derived(run: RecordedRun, reader: &RunReader) -> Result<Derived, String> {
    let plan = run.plan.clone().without_judgement();
    Ok(Derived {
        evaluation: run.evaluation(reader, &plan)?,
        signals: plan.derived,
    })
}

/// Derived signals of a run, recomputed from its records.
pub(super) struct Derived {
    pub signals: Vec<plan::Derived>,
    evaluation: RecordEvaluation,
}

impl Derived {
    /// Returns the values of the derived signals at the step of a record.
    pub(super) fn of(&mut self, record: &[u64]) -> &[f64] {
        self.evaluation.record(record)
    }
}

/// Returns the provenance of a table and the units of its columns as file metadata.
pub(super) fn metadata(
    reader: &RunReader,
    columns: &[Column],
    marks: &[MarkAt],
) -> Vec<(String, String)> {
    let with_unit = columns.iter().filter(|column| !column.unit.is_empty());
    let units: BTreeMap<&str, &str> = with_unit
        .map(|column| (column.name.as_str(), column.unit.as_str()))
        .collect();
    let facts = [
        ("scenario", "hil.scenario"),
        ("session", "hil.session"),
        ("started_utc", "hil.started_utc"),
        ("evidence", "hil.evidence"),
        ("rate_hz", "hil.rate_hz"),
        ("seed", "hil.seed"),
        ("hil_commit", "hil.commit"),
        ("plant_blake3", "hil.plant_blake3"),
        ("controller_blake3", "hil.controller_blake3"),
    ];
    let facts = facts
        .into_iter()
        .filter_map(|(fact, key)| Some((key.to_owned(), reader.fact(fact)?.to_owned())));
    let mut metadata: Vec<(String, String)> = facts.collect();
    metadata.push(("hil.digest".into(), reader.digest()));
    metadata.push(("hil.whole".into(), reader.is_whole().to_string()));
    if !marks.is_empty() {
        metadata.push(("hil.marks".into(), serde_json::json!(marks).to_string()));
    }
    metadata.push(("units".into(), serde_json::json!(units).to_string()));
    metadata
}
