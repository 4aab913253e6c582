//! The verdicts of several runs, formatted for a terminal.

use std::fmt::Write;

use hil_console::terminal::output;
use hil_console::terminal::table::{Table, left, right};
use hil_facts::results::requirements::{WITHOUT_REQUIREMENTS, why_vacuous};
use shared_types::number::short_in;

use super::case::Row;

pub(super) fn of(rows: &[Row]) -> String {
    output::text(|text| write(text, rows))
}

fn write(text: &mut String, rows: &[Row]) -> std::fmt::Result {
    let columns = [
        left(0),
        left(0),
        left(7),
        right(0),
        right(8),
        left(8),
        left(0),
    ];
    let mut table = Table::new(2, columns);
    table.cells([
        "run",
        "law",
        "verdict",
        "requirements",
        "speed",
        "digest",
        "folder",
    ]);
    for row in rows {
        let (label, law, verdict) = (&row.label, &row.law, row.verdict_in_words());
        let (passed, all, speed, digest, folder) = match (&row.ran, &row.begun) {
            (Some(ran), _) => {
                let summary = &ran.summary;
                let requirements = &summary.requirements;
                let passed = requirements.iter().filter(|one| one.outcome() == "pass");
                let speed = Some(summary.realtime_factor);
                let all = requirements.len();
                (passed.count(), all, speed, &summary.digest, &ran.folder)
            }
            (None, Some(begun)) => (
                begun.passed,
                begun.requirements,
                begun.realtime_factor,
                &begun.digest,
                &begun.folder,
            ),
            (None, None) => {
                table.row(&[label, law, &verdict]);
                continue;
            }
        };
        let passed: String = match all {
            0 => "-".into(),
            all => format!("{passed} of {all}"),
        };
        let speed = speed.map_or_else(|| "-".into(), |speed| format!("{speed:.1}x"));
        let digest = digest
            .as_deref()
            .and_then(|digest| digest.get(..8))
            .unwrap_or("-");
        let folder = folder.display();
        table.row(&[label, law, &verdict, &passed, &speed, &digest, &folder]);
    }
    writeln!(text, "{table}")?;
    for row in rows {
        for reason in row.reasons() {
            writeln!(text, "  {}: {reason}", row.label)?;
        }
        for one in row.ran.iter().flat_map(|ran| &ran.summary.requirements) {
            if let Some(premise) = &one.vacuous {
                let why = why_vacuous(premise);
                writeln!(text, "  {}: {} {why}", row.label, one.name)?;
            } else if one.verdict != "pass" {
                let margin = one.robustness.map_or_else(String::new, |margin| {
                    format!(", margin {}", short_in(margin, &one.unit))
                });
                let at = one
                    .at_s
                    .map_or_else(String::new, |at_s| format!(" at {at_s} s"));
                writeln!(
                    text,
                    "  {}: {} {}{margin}{at}",
                    row.label, one.name, one.verdict
                )?;
            }
        }
    }
    let count = |words: &str| (rows.iter().filter(|row| row.verdict_in_words() == words)).count();
    let verdicts = ["pass", WITHOUT_REQUIREMENTS, "fail", "aborted", "not run"];
    let counts = verdicts.map(|verdict| (count(verdict), verdict));
    let counts: Vec<String> = (counts.iter())
        .filter(|(count, _)| *count > 0)
        .map(|(count, verdict)| format!("{count} {verdict}"))
        .collect();
    writeln!(text, "  {} runs: {}", rows.len(), counts.join(", "))
}
