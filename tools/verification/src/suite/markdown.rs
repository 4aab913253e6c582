//! The verdicts as Markdown, for a pull request or a wiki.

use std::fmt::Write;

use hil_console::terminal::output;
use hil_facts::results::requirements::WITHOUT_REQUIREMENTS;
use shared_types::number::short_in;

use super::case::Row;

pub(super) fn of(rows: &[Row]) -> String {
    output::text(|text| write(text, rows))
}

fn write(text: &mut String, rows: &[Row]) -> std::fmt::Result {
    let count = |words: &str| (rows.iter().filter(|row| row.verdict_in_words() == words)).count();
    let unjudged = match count(WITHOUT_REQUIREMENTS) {
        0 => String::new(),
        count => format!("; {count} {WITHOUT_REQUIREMENTS}"),
    };
    let passed = count("pass");
    writeln!(
        text,
        "## hil: {passed} of {} runs pass{unjudged}\n",
        rows.len()
    )?;
    writeln!(
        text,
        "| run | law | verdict | requirements | digest | why |"
    )?;
    writeln!(text, "|---|---|---|---|---|---|")?;
    for row in rows {
        let summary = row.ran.as_ref().map(|ran| &ran.summary);
        let passed = summary.map_or_else(String::new, |summary| {
            let all = &summary.requirements;
            let passed = all.iter().filter(|one| one.outcome() == "pass").count();
            format!("{passed} of {}", all.len())
        });
        let digest = summary.and_then(|summary| summary.digest.as_deref());
        let digest = digest.map_or_else(String::new, |digest| format!("`{}`", &digest[..8]));
        let why = cell(&row.reasons().join("; "));
        writeln!(
            text,
            "| {} | {} | **{}** | {passed} | {digest} | {} |",
            cell(&row.label),
            cell(&row.law),
            row.verdict_in_words(),
            why
        )?;
    }
    for row in rows {
        let Some(ran) = &row.ran else { continue };
        let summary = &ran.summary;
        if summary.requirements.is_empty() && summary.metrics.is_empty() {
            continue;
        }
        writeln!(text, "\n### {}\n", cell(&row.label))?;
        if !summary.requirements.is_empty() {
            writeln!(
                text,
                "| requirement | verdict | margin | at [s] | formula |"
            )?;
            writeln!(text, "|---|---|---|---|---|")?;
        }
        for one in &summary.requirements {
            let margin = shown(one.robustness, &one.unit);
            let at_s = one.at_s.map_or_else(|| "-".into(), |at_s| at_s.to_string());
            writeln!(
                text,
                "| {} | **{}** | {margin} | {at_s} | `{}` |",
                cell(&one.name),
                one.outcome(),
                cell(&one.formula)
            )?;
        }
        if !summary.metrics.is_empty() {
            if !summary.requirements.is_empty() {
                writeln!(text)?;
            }
            writeln!(text, "| metric | window [s] | value |")?;
            writeln!(text, "|---|---|---|")?;
        }
        for metric in &summary.metrics {
            let [start_s, end_s] = metric.window_s;
            let (name, value) = (cell(&metric.name), shown(metric.value, &metric.unit));
            writeln!(text, "| {name} | {start_s} to {end_s} | {value} |")?;
        }
    }
    Ok(())
}

/// Formats a number with its unit, or `-`.
fn shown(value: Option<f64>, unit: &str) -> String {
    value.map_or_else(|| "-".into(), |value| cell(&short_in(value, unit)))
}

/// Escapes a text for a table cell.
fn cell(text: &str) -> String {
    text.replace('|', "\\|").replace(['\n', '\r'], " ")
}
