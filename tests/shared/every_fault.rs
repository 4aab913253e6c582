//! A fault of every kind: the content of the scenarios for the tests of survival.

use toml::{Table, Value};

/// The laws of the hydraulic system.
pub(crate) const LAWS: [&str; 3] = ["pid", "nrsc", "ftsc"];

/// A fault without its time.
pub(crate) struct Fault {
    /// Kind.
    pub(crate) kind: String,
    table: Table,
}

/// Returns the faults of `tests/scenarios/every-fault.toml`.
pub(crate) fn faults() -> Vec<Fault> {
    let text = include_str!("../scenarios/every-fault.toml");
    let table: Table = text.parse().expect("TOML");
    let list = table["faults"].as_array().expect("a list");
    let fault = |fault: &Value| {
        let table = fault.as_table().expect("a table").clone();
        let kind = table["kind"].as_str().expect("a text").to_owned();
        Fault { kind, table }
    };
    list.iter().map(fault).collect()
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
