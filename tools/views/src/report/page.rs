//! Page of a report: all parts readable without a script, and the data for the script that draws.

use hil_console::terminal::exit::Failure;
use maud::{Markup, html};
use shared_types::number::unit_shown;

use super::data::Data;
use super::found::Found;
use super::plots::Plot;
use super::run::{Run, Span, distinct};
use super::{first, found, tables};
use crate::offline_page::{OfflinePage, PAGE};
use crate::pages::{CLOSER, CLOSER_STYLE, drawer, range_fields};

pub(crate) const UPLOT: &str = include_str!("assets/uplot/uPlot.iife.min.js");
pub(crate) const UPLOT_STYLE: &str = include_str!("assets/uplot/uPlot.min.css");
const SCRIPT: &str = include_str!("assets/report.js");

/// Renders the whole page: the answer first, latency last unless a run asked for timing.
pub(super) fn page(
    runs: &[Run],
    plots: &[Plot],
    found: &[Found],
    figures: &Markup,
    data: &Data,
) -> Result<String, Failure> {
    let title = title(runs);
    let deciding = first::deciding(runs, plots);
    let asks_for_timing = runs.iter().any(Run::asks_for_timing);
    let is_rest = |place: &usize| !deciding.contains(place);
    let is_of_loop = |place: &usize| plots[*place].is_of_loop();
    let all: Vec<usize> = (0..plots.len()).filter(is_rest).collect();
    let (of_loop, rest): (Vec<usize>, Vec<usize>) = all.into_iter().partition(is_of_loop);
    let latency = html! {
        section #latency {
            h2 { "Latency" }
            (sections(plots, &of_loop))
            (tables::latency(runs))
            div.plots #histograms {}
            (tables::spikes(runs))
        }
    };
    let body = html! {
        header {
            h1 { (title) }
            p { (description(runs)) }
        }
        (toolbar(runs, !found.is_empty()))
        main {
            section #first aria-label="Verdict" {
                (first::verdicts(runs, plots))
                @if let Some(label) = data.band() { p #band.hint { "Shaded behind the curves: " (label) } }
                div.plots #deciding { @for place in &deciding { (figure(*place, &plots[*place])) } }
            }
            section #requirements { h2 { "Requirements" } (tables::requirements(runs)) }
            (found::section(found, runs))
            section #metrics { h2 { "Metrics" } (tables::metrics(runs)) }
            section #faults { h2 { "Faults and controllers" } (tables::events(runs)) }
            section #plots {
                h2 { "Plots" }
                noscript { p.note { "Plots need a browser with JavaScript; the tables do not." } }
                (sections(plots, &rest))
                (figures)
            }
            (picker(data))
            @if asks_for_timing { (latency) }
            section #runs { h2 { "Runs" } (tables::runs(runs)) }
            section #provenance { h2 { "Provenance" } (tables::provenance(runs)) }
            @if !asks_for_timing { (latency) }
        }
        (drawer())
    };
    let scripts = [&[UPLOT, PAGE][..], &CLOSER, &[SCRIPT]].concat();
    let page = OfflinePage {
        title: &title,
        styles: [&[UPLOT_STYLE, CLOSER_STYLE].concat(), ""],
        body,
        credit: Some("Plots by uPlot, MIT licence."),
        data,
        scripts: &scripts,
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

fn toolbar(runs: &[Run], has_formulas: bool) -> Markup {
    html! {
        nav.bar aria-label="Controls" {
            a href="#first" { "Verdict" }
            a href="#requirements" { "Requirements" }
            @if has_formulas { a href="#where" { "Where" } }
            a href="#metrics" { "Metrics" }
            a href="#plots" { "Plots" }
            a href="#runs" { "Runs" }
            a href="#provenance" { "Provenance" }
            a href="#latency" { "Latency" }
            span.gap {}
            span.jumps { @for span in jumps(runs) {
                button type="button" data-jump=(span.from_s) title="Zoom in on where it took effect" {
                    "fault " (span.event) " " (span.kind)
                }
            } }
            span #range { (range_fields()) }
            button #find type="button" title="Ctrl-K" { "Find" }
            button #theme type="button" aria-pressed="false" { "Dark" }
            details.keys {
                summary { "Keys" }
                div {
                    "A part of the run: drag over a plot, Ctrl and wheel, two fingers; Shift moves it, a double click shows all; on a plot "
                    kbd { "←" } " " kbd { "→" } " move, " kbd { "+" } " " kbd { "-" } " zoom, " kbd { "Home" } " whole. "
                    br;
                    "Cursors: click twice, or on a plot " kbd { "a" } " " kbd { "b" } " at the pointer; " kbd { "," } " " kbd { "." } " and " kbd { "<" } " " kbd { ">" } " move them, " kbd { "c" } " clears. "
                    br;
                    kbd { "Ctrl" } " " kbd { "K" } " finds everything by its name."
                }
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
fn sections(plots: &[Plot], places: &[usize]) -> Markup {
    let of_section = places.chunk_by(|a, b| plots[*a].chosen.section == plots[*b].chosen.section);
    html! {
        @for places in of_section {
            h3 { (plots[places[0]].chosen.section) }
            div.plots { @for place in places { (figure(*place, &plots[*place])) } }
        }
    }
}

/// Renders the frame of a plot: its heading with the unit, and beside it the name that commands understand.
fn figure(number: usize, plot: &Plot) -> Markup {
    let heading = &plot.heading;
    let name = (plot.chosen.title != *heading).then_some(&plot.chosen.title);
    html! {
        figure.plot id={ "plot-" (number) } data-plot=(number) tabindex="0" aria-label={ "Plot: " (heading) } {
            figcaption {
                (heading) (plot.shown.bracketed())
                @if let Some(name) = name { " " code.name { (name) } }
            }
            div.tools {}
            div.canvas {}
            div.legend {}
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
