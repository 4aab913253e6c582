//! Plots and panel as `[[plots]]` and `[panel]` of a scenario.

use std::fmt::Write;

use super::{Written, forgotten, list, section, string, strings};
use crate::keys::{PANEL, PLOT, PLOTS};
use crate::plan::{Panel, Plot, PlotKind, Scale, SpectralWindow};
use crate::quantity::toml_float;

pub(super) fn plot(text: &mut String, plot: &Plot) -> Written {
    writeln!(text, "\n[[plots]]")?;
    section(text, PLOT, |key| match key {
        "title" => Some(string(&plot.title)),
        "kind" => (plot.kind != PlotKind::Time).then(|| string(plot.kind.name())),
        "name" => plot.name.as_deref().map(string),
        "caption" => plot.caption.as_deref().map(string),
        "laws" => (!plot.laws.is_empty()).then(|| strings(&plot.laws)),
        other => forgotten(other),
    })?;
    let of_kind = PLOTS.iter().find(|kind| kind.name == plot.kind.name());
    let spectrum = match &plot.kind {
        PlotKind::Spectrum(spectrum) => Some(spectrum),
        _ => None,
    };
    let usual = spectrum.map_or(Scale::Linear, |_| Scale::Log);
    section(
        text,
        of_kind.map_or(&[][..], |kind| kind.keys),
        |key| match (key, &plot.kind) {
            ("signals", _) => Some(strings(&plot.signals)),
            ("scale", _) => (plot.scale != usual).then(|| string(plot.scale.name())),
            ("lines", _) => (!plot.lines.is_empty()).then(|| list(&plot.lines)),
            ("from_s", _) => plot.span_s[0].map(toml_float),
            ("until_s", _) => plot.span_s[1].map(toml_float),
            ("x", PlotKind::Xy { x }) => Some(string(x)),
            ("quantity", _) => (spectrum.filter(|spectrum| spectrum.is_density))
                .map(|spectrum| string(spectrum.quantity())),
            ("window", _) => spectrum
                .map(|spectrum| spectrum.window)
                .filter(|window| *window != SpectralWindow::Hann)
                .map(|window| string(window.name())),
            ("resolution_hz", _) => spectrum?.resolution_hz.map(toml_float),
            ("metric", PlotKind::Bode { metric } | PlotKind::Nichols { metric }) => {
                metric.as_deref().map(string)
            }
            (other, _) => forgotten(other),
        },
    )
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
