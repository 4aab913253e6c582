//! A plot as `[[plots]]` of a scenario.

use std::fmt::Write;

use super::{Written, list, string};
use crate::plan::{Plot, Scale};

pub(super) fn plot(text: &mut String, plot: &Plot) -> Written {
    writeln!(text, "\n[[plots]]")?;
    writeln!(text, "title = {}", string(&plot.title))?;
    writeln!(text, "signals = {}", strings(&plot.signals))?;
    if !plot.laws.is_empty() {
        writeln!(text, "laws = {}", strings(&plot.laws))?;
    }
    if plot.scale != Scale::Linear {
        writeln!(text, "scale = \"{}\"", plot.scale.name())?;
    }
    if !plot.lines.is_empty() {
        writeln!(text, "lines = {}", list(&plot.lines))?;
    }
    Ok(())
}

fn strings(texts: &[String]) -> String {
    let texts: Vec<String> = texts.iter().map(|text| string(text)).collect();
    format!("[{}]", texts.join(", "))
}
