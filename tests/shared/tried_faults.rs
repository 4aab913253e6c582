//! Faults of every kind, as `studies/faults-drhas.toml` tries them, for scenarios that combine them.

use hil_config::study::Study;
use toml::{Table, Value};

use crate::support::programs::workspace;

/// The laws of the hydraulic system.
pub(crate) const LAWS: [&str; 3] = ["pid", "nrsc", "ftsc"];
/// The study.
pub(crate) const STUDY: &str = "studies/faults-drhas.toml";

/// A fault without its time.
pub(crate) struct Fault {
    /// Kind.
    pub(crate) kind: String,
    table: Table,
}

/// Returns the faults of the study.
pub(crate) fn faults() -> Vec<Fault> {
    let study = Study::read(workspace().join(STUDY)).expect("a study");
    let tried = study.faults.expect("a table of faults").tried();
    let fault = |flag: String| {
        let (_, table) = flag.split_once('=').expect("a flag");
        let mut table: Table = format!("fault = {table}").parse().expect("TOML");
        let Some(Value::Table(mut table)) = table.remove("fault") else {
            panic!("{flag} is no table")
        };
        // Two events may not share a name.
        table.remove("name");
        table
    };
    let with_kind = tried.iter().map(|one| Fault {
        kind: one.kind.clone(),
        table: fault(one.flag()),
    });
    with_kind.collect()
}

/// Returns a scenario with one more fault.
pub(crate) fn with_fault(scenario: &str, fault: &Fault, at_s: f64) -> String {
    let mut table: Table = scenario.parse().expect("TOML");
    let mut fault = fault.table.clone();
    fault.insert("at_s".into(), Value::Float(at_s));
    let faults = table["faults"].as_array_mut().expect("a list");
    faults.push(Value::Table(fault));
    table.to_string()
}
