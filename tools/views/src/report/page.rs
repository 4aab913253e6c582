//! Page of a report: all parts readable without a script, and the data for the script that draws.

use hil_console::terminal::exit::Failure;
use maud::{Markup, html};
use shared_types::number::unit_shown;

use super::data::Data;
use super::plots::Plot;
use super::run::{Run, Span, distinct};
use super::tables;
use crate::offline_page::{OfflinePage, PAGE};

pub(crate) const UPLOT: &str = include_str!("assets/uplot/uPlot.iife.min.js");
pub(crate) const UPLOT_STYLE: &str = include_str!("assets/uplot/uPlot.min.css");
const SCRIPT: &str = include_str!("assets/report.js");

/// Renders the whole page.
pub(crate) fn page(runs: &[Run], plots: &[Plot], data: &Data) -> Result<String, Failure> {
    let title = title(runs);
    let body = html! {
        header {
            h1 { (title) }
            p { (description(runs)) }
        }
        (toolbar(runs))
        main {
            section #runs { h2 { "Runs" } (tables::runs(runs)) }
            section #requirements { h2 { "Requirements" } (tables::requirements(runs)) }
            section #metrics { h2 { "Metrics" } (tables::metrics(runs)) }
            section #faults { h2 { "Faults and controllers" } (tables::events(runs)) }
            section #plots {
                h2 { "Plots" }
                noscript { p.note { "Plots need a browser with JavaScript; the tables do not." } }
                (sections(plots))
            }
            (picker(data))
            section #latency {
                h2 { "Latency" }
                (tables::latency(runs))
                div.plots #histograms {}
                (tables::spikes(runs))
            }
            section #provenance { h2 { "Provenance" } (tables::provenance(runs)) }
        }
    };
    let page = OfflinePage {
        title: &title,
        styles: [UPLOT_STYLE, ""],
        body,
        credit: Some("Plots by uPlot, MIT licence."),
        data,
        scripts: &[UPLOT, PAGE, SCRIPT],
    };
    page.write()
}

fn title(runs: &[Run]) -> String {
    let scenarios = distinct(runs.iter().map(|run| run.fact("scenario")), |a, b| a == b);
    let laws = runs.iter().map(Run::law).filter(|law| !law.is_empty());
    let laws = distinct(laws, |a, b| a == b);
    format!("{}: {}", scenarios.join(", "), laws.join(", "))
}

fn description(runs: &[Run]) -> String {
    let plans = runs.iter().filter_map(Run::plan);
    let texts = plans.map(|plan| plan.description.as_str());
    distinct(texts.filter(|text| !text.is_empty()), |a, b| a == b).join("; ")
}

fn toolbar(runs: &[Run]) -> Markup {
    html! {
        nav.bar aria-label="Controls" {
            a href="#requirements" { "Requirements" }
            a href="#metrics" { "Metrics" }
            a href="#plots" { "Plots" }
            a href="#latency" { "Latency" }
            a href="#provenance" { "Provenance" }
            span.gap {}
            span.jumps { @for span in jumps(runs) {
                button type="button" data-jump=(span.from_s) title="Zoom in on where it took effect" {
                    "fault " (span.event) " " (span.kind)
                }
            } }
            button #whole type="button" { "Whole run" }
            button #theme type="button" aria-pressed="false" { "Dark" }
            details.keys {
                summary { "Keys" }
                div { "Drag, or on a focused plot: " kbd { "←" } " " kbd { "→" } " move, " kbd { "+" } " " kbd { "-" } " zoom, "
                    kbd { "Shift" } " with arrows moves the cursor, " kbd { "0" } " whole run. Wheel with " kbd { "Ctrl" } " zooms, a double click shows all." }
            }
        }
    }
}

/// Returns all faults; faults common to several runs are listed only once.
fn jumps(runs: &[Run]) -> Vec<&Span> {
    let what = |one: &Span| (one.event, one.kind.clone(), one.from_s.to_bits());
    let spans = runs.iter().flat_map(|run| &run.spans);
    distinct(spans, |a, b| what(a) == what(b))
}

/// Renders figures under the headings of their sections; the script draws into them.
fn sections(plots: &[Plot]) -> Markup {
    let mut last = "";
    let headed = plots.iter().enumerate().map(|(number, plot)| {
        let plot = &plot.chosen;
        let heading = (plot.section != last).then_some(plot.section);
        last = plot.section;
        (number, heading, plot)
    });
    html! {
        @for (number, heading, plot) in headed {
            @if let Some(heading) = heading { h3 { (heading) } }
            figure.plot id={ "plot-" (number) } data-plot=(number) tabindex="0" role="group" aria-label={ "Plot: " (plot.title) } {
                figcaption { (plot.title) @if !unit_shown(&plot.unit).is_empty() { " [" (plot.unit) "]" } }
                div.canvas {}
                div.legend {}
            }
        }
    }
}

/// Renders the list of all signals for plots of the user's choice.
fn picker(data: &Data) -> Markup {
    html! {
        section #signals {
            h2 { "More signals" }
            label for="filter" { "Filter " }
            input #filter type="search" placeholder="truth.*, pressure, ..." autocomplete="off";
            p.hint { "Choose some and plot them together." }
            div.signals {
                @for (name, unit) in data.names() {
                    label { input type="checkbox" name="signal" value=(name); " " (name) " " span.hint { (unit_shown(unit)) } }
                }
            }
            button #plot type="button" { "Plot chosen" }
        }
        div.plots #added {}
    }
}
