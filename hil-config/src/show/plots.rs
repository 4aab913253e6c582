//! Plots and panel as `[[plots]]` and `[panel]` of a scenario.

use std::fmt::Write;

use super::{Written, forgotten, list, section, string, strings};
use crate::keys::{PANEL, PLOT};
use crate::plan::{Panel, Plot, Scale};
use crate::quantity::toml_float;

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

pub(super) fn panel(text: &mut String, panel: &Panel) -> Written {
    let usual = Panel::default();
    if *panel == usual {
        return Ok(());
    }
    let if_any = |texts: &[String]| (!texts.is_empty()).then(|| strings(texts));
    writeln!(text, "\n[panel]")?;
    section(text, PANEL, |key| match key {
        "window_s" => (panel.window_s != usual.window_s).then(|| toml_float(panel.window_s)),
        "readings" => if_any(&panel.readings),
        "tune" => if_any(&panel.tune),
        "inject" => if_any(&panel.inject),
        other => forgotten(other),
    })
}
