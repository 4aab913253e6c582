//! Evidence as JSON that the directive `needimport` of sphinx-needs reads: a need of type `test` for each test, linked
//! to the requirements that it verifies.

use std::collections::BTreeMap;

use hil_console::terminal::exit::Failure;
use hil_console::terminal::output;
use serde_json::{Value, json};

use super::run::{RecordedRun, Test};

/// Version under which the needs are stored.
const VERSION: &str = "1.0";

/// Writes the needs. The time is that of the newest run, so that the same runs give the same text.
pub(super) fn of(runs: &[RecordedRun]) -> Result<String, Failure> {
    let created = (runs.iter().filter_map(|run| run.started_utc.as_deref())).max();
    let mut needs = BTreeMap::new();
    for run in runs {
        for test in &run.requirements {
            let mut id = identifier(run, test);
            let mut number = 1;
            while needs.contains_key(&id) {
                number += 1;
                id = format!("{}_{number}", identifier(run, test));
            }
            let need = need(&id, run, test);
            needs.insert(id, need);
        }
    }
    let all = json!({
        "created": created,
        "current_version": VERSION,
        "project": "hil",
        "versions": {VERSION: {"created": created, "needs_amount": needs.len(), "needs": needs}},
    });
    output::pretty(&all)
}

/// Returns an identifier of the form that sphinx-needs asks for by default: at least five of `A` to `Z`, `0` to `9`
/// and `_`.
fn identifier(run: &RecordedRun, test: &Test) -> String {
    let name = test.id.as_deref().unwrap_or(&test.name);
    let legal = |c: char| match c.to_ascii_uppercase() {
        c if c.is_ascii_alphanumeric() => c,
        _ => '_',
    };
    let name = format!("TEST_{}_{name}", run.scenario);
    name.chars().map(legal).collect()
}

fn need(id: &str, run: &RecordedRun, test: &Test) -> Value {
    let robustness = test
        .robustness
        .map(|margin| format!("{margin} {}", test.unit));
    json!({
        "id": id,
        "type": "test",
        "title": format!("{}: {}", run.scenario, test.name),
        "status": test.outcome(),
        "links": test.verifies,
        "tags": [run.evidence],
        "content": format!(
            "``{}``\n\nMargin: {}. Run: ``{}``, digest ``{}``.",
            test.formula,
            robustness.as_deref().unwrap_or("none"),
            run.folder.display(),
            run.digest.as_deref().unwrap_or("none")
        ),
    })
}
