//! A plot as `[[plots]]` of a scenario.

use std::fmt::Write;

use super::{Written, forgotten, list, section, string};
use crate::keys::PLOT;
use crate::plan::{Plot, Scale};

pub(super) fn plot(text: &mut String, plot: &Plot) -> Written {
    writeln!(text, "\n[[plots]]")?;
    section(text, PLOT, |key| match key {
        "title" => Some(string(&plot.title)),
        "signals" => Some(strings(&plot.signals)),
        "laws" => (!plot.laws.is_empty()).then(|| strings(&plot.laws)),
        "scale" => (plot.scale != Scale::Linear).then(|| string(plot.scale.name())),
        "lines" => (!plot.lines.is_empty()).then(|| list(&plot.lines)),
        other => forgotten(other),
    })
}

fn strings(texts: &[String]) -> String {
    let texts: Vec<String> = texts.iter().map(|text| string(text)).collect();
    format!("[{}]", texts.join(", "))
}
