//! Evidence as CSV: a row for each pair of a requirement and a test that verifies it, and for each without the other.

use hil_console::terminal::exit::Failure;
use serde::Serialize;

use super::listed::Listed;
use super::run::{RecordedRun, Test};

/// Verdict of a listed requirement that no run verifies.
const UNTESTED: &str = "untested";

/// Row of the table; times are in s of the simulation.
#[derive(Default, Serialize)]
struct Row<'a> {
    /// Identifier of the verified requirement.
    requirement: &'a str,
    title: &'a str,
    verdict: &'a str,
    test_id: &'a str,
    test: &'a str,
    robustness: Option<f64>,
    unit: &'a str,
    at_s: Option<f64>,
    decided_at_s: Option<f64>,
    formula: &'a str,
    scenario: &'a str,
    set: String,
    run: String,
    run_verdict: &'a str,
    evidence: &'a str,
    started_utc: &'a str,
    digest: &'a str,
    plant: String,
    controller: String,
}

/// Writes the table.
pub(super) fn of(
    runs: &[RecordedRun],
    listed: &[Listed],
    untested: &[&Listed],
) -> Result<String, Failure> {
    let title = |id: &str| {
        let listed = listed.iter().find(|listed| listed.id == id);
        listed.map_or("", |listed| &listed.title)
    };
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut write = |row: Row<'_>| writer.serialize(row).map_err(Failure::infrastructure);
    for run in runs {
        for test in &run.requirements {
            for id in &test.verifies {
                write(Row {
                    requirement: id,
                    title: title(id),
                    ..row(run, test)
                })?;
            }
            if test.verifies.is_empty() {
                write(row(run, test))?;
            }
        }
    }
    for listed in untested {
        write(Row {
            requirement: &listed.id,
            title: &listed.title,
            verdict: UNTESTED,
            ..Row::default()
        })?;
    }
    let text = writer.into_inner().map_err(Failure::infrastructure)?;
    String::from_utf8(text).map_err(Failure::infrastructure)
}

fn row<'a>(run: &'a RecordedRun, test: &'a Test) -> Row<'a> {
    let program = |program: &super::run::Program| format!("{} {}", program.binary, program.blake3);
    Row {
        verdict: test.outcome(),
        test_id: test.id.as_deref().unwrap_or_default(),
        test: &test.name,
        robustness: test.robustness,
        unit: &test.unit,
        at_s: test.at_s,
        decided_at_s: test.decided_at_s,
        formula: &test.formula,
        scenario: &run.scenario,
        set: run.set.join(" "),
        run: run.folder.display().to_string(),
        run_verdict: &run.verdict,
        evidence: &run.evidence,
        started_utc: run.started_utc.as_deref().unwrap_or_default(),
        digest: run.digest.as_deref().unwrap_or_default(),
        plant: program(&run.plant),
        controller: program(&run.controller),
        ..Row::default()
    }
}
