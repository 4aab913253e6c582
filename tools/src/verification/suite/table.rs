//! The verdicts of several runs as a person reads them in a terminal.

use std::fmt::Write;

use shared_types::number::short_in;

use super::case::Row;
use crate::terminal::output;

pub(super) fn of(rows: &[Row]) -> String {
    output::text(|text| write(text, rows))
}

fn write(text: &mut String, rows: &[Row]) -> std::fmt::Result {
    let width = |of: fn(&Row) -> &str| rows.iter().map(|row| of(row).len()).max().unwrap_or(0);
    let (label, law) = (width(|row| &row.label).max(3), width(|row| &row.law).max(3));
    writeln!(
        text,
        "  {:<label$}  {:<law$}  {:<7}  {:>12}  {:>8}  {:<8}  folder",
        "run", "law", "verdict", "requirements", "speed", "digest"
    )?;
    for row in rows {
        let verdict = row.verdict();
        write!(
            text,
            "  {:<label$}  {:<law$}  {verdict:<7}",
            row.label, row.law
        )?;
        let Some(ran) = &row.ran else {
            writeln!(text)?;
            continue;
        };
        let summary = &ran.summary;
        let passed = summary
            .requirements
            .iter()
            .filter(|one| one.verdict == "pass");
        let met = match summary.requirements.len() {
            0 => "-".into(),
            all => format!("{} of {all}", passed.count()),
        };
        let speed = format!("{:.1}x", summary.realtime_factor);
        let digest = summary.digest.as_deref().map_or("-", |digest| &digest[..8]);
        let folder = ran.folder.display();
        writeln!(text, "  {met:>12}  {speed:>8}  {digest:<8}  {folder}")?;
    }
    writeln!(text)?;
    for row in rows {
        for reason in row.reasons() {
            writeln!(text, "  {}: {reason}", row.label)?;
        }
        for one in row.ran.iter().flat_map(|ran| &ran.summary.requirements) {
            if one.verdict != "pass" {
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
    let count = |verdict: &str| rows.iter().filter(|row| row.verdict() == verdict).count();
    let counts = ["pass", "fail", "aborted", "not run"].map(|verdict| (count(verdict), verdict));
    let counts: Vec<String> = (counts.iter())
        .filter(|(count, _)| *count > 0)
        .map(|(count, verdict)| format!("{count} {verdict}"))
        .collect();
    writeln!(text, "  {} runs: {}", rows.len(), counts.join(", "))
}
