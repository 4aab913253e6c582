//! Tables of a report: verdicts, requirements, metrics, faults, latency, provenance.

use std::collections::{BTreeMap, BTreeSet};

use hil_config::plan::Published;
use hil_console::terminal::duration::shown_ns;
use hil_facts::results::faults::not_confirmed;
use hil_facts::results::latency::legs::{LatencySummary, without_command};
use hil_facts::results::latency::percentiles::Percentiles;
use hil_facts::results::latency::spikes::Spike;
use hil_facts::results::requirements::{self, Requirement, why_vacuous};
use hil_facts::results::summary::{Metric, of_law};
use maud::{Markup, PreEscaped, html};
use shared_types::number::{short, short_in};
use shared_types::time::Step;

use super::run::{Run, distinct};

/// Meaning of each level of evidence.
const EVIDENCE: [(&str, &str); 5] = [
    (
        "in-process",
        "both sides in one process: about the algorithms, not about processes or targets",
    ),
    (
        "sil",
        "software in the loop: two processes on one machine; no evidence about target hardware",
    ),
    (
        "sil-emulated",
        "software in the loop: the controller of another processor, emulated on this machine",
    ),
    (
        "pil",
        "processor in the loop: the controller on its target, in lockstep",
    ),
    (
        "hil",
        "hardware in the loop: the controller on its target, in real time",
    ),
];

/// Renders the table of runs: programs, end and speed.
pub(super) fn runs(runs: &[Run]) -> Markup {
    html! {
        div.scroll tabindex="0" { table {
            thead { tr {
                th { "run" } th { "verdict" } th { "scenario" } th { "law" } th { "clock" }
                th.n { "simulated" } th.n { "speed" } th { "evidence" } th { "digest" }
            } }
            tbody {
                @for (number, run) in runs.iter().enumerate() {
                    tr {
                        th scope="row" { (swatch(number)) (run.label) }
                        td { (badge(requirements::in_words(&run.verdict, run.requirements.len()))) @if let Some(reason) = &run.reason { br; (reason) } }
                        td { (run.fact("scenario")) }
                        td { (run.law()) }
                        td { (run.plan().map_or("", |plan| plan.run.clock.name())) }
                        td.n { (run.outcome.recorded.records) " records, " (seconds(run.end_s())) " s" }
                        td.n { (speed(run)) }
                        td { abbr title=(meaning(run.fact("evidence"))) { (run.fact("evidence")) } }
                        td { (digest(run)) }
                    }
                }
            }
        } }
    }
}

fn speed(run: &Run) -> String {
    let wall_s = run.outcome.recorded.wall_time_s;
    match wall_s > 0.0 {
        true => format!("{:.1}x real time", run.end_s() / wall_s),
        false => "-".into(),
    }
}

/// Renders the digest recomputed from the records, compared with that of the recorder.
fn digest(run: &Run) -> Markup {
    let recorded = run.outcome.reader.result("digest").unwrap_or_default();
    let recomputed = run.outcome.recorded.digest.as_deref();
    html! {
        @match recomputed {
            Some(recomputed) => {
                code title=(recomputed) { (recomputed.get(..12).unwrap_or(recomputed)) }
                @if run.outcome.reader.is_excerpt() { " as recorded" }
                @else if recorded == recomputed { " recomputed: equal" }
                @else if recorded.is_empty() { " of what is there" }
                @else { " " strong { "DIFFERS from the recorded one" } }
            }
            None => "none: records were lost",
        }
    }
}

/// Renders every requirement with its margin in every run.
pub(super) fn requirements(runs: &[Run]) -> Markup {
    let judged = runs.iter().flat_map(|run| &run.requirements);
    let names = distinct(judged, |a, b| a.name == b.name);
    html! {
        @if names.is_empty() { p { "No requirement was judged." } }
        @else { div.scroll tabindex="0" { table {
            thead { tr {
                th { "requirement" }
                @for (number, run) in runs.iter().enumerate() { th { (swatch(number)) (run.label) } }
            } }
            tbody { @for one in names { tr {
                th scope="row" { (one.name) br; code.formula { (one.formula) } }
                @for (number, run) in runs.iter().enumerate() {
                    td { @match run.requirements.iter().find(|judged| judged.name == one.name) {
                        Some(judged) => (margin(number, run, judged)),
                        None => "-",
                    } }
                }
            } } }
        } }
        p.hint { "Margins are robustness in the unit of the signal: how far the worst step was from the limit, negative where it failed. Select one to see it." } }
    }
}

fn margin(number: usize, run: &Run, judged: &Requirement) -> Markup {
    html! {
        (badge(judged.outcome())) " "
        @if let Some(robustness) = judged.robustness {
            @if let Some(at_s) = judged.at_s {
                button.link type="button" data-requirement=(judged.name) data-run=(number) data-at=(at_s) {
                    (short_in(robustness, &judged.unit)) " at " (seconds(at_s)) " s"
                }
            } @else { (short_in(robustness, &judged.unit)) }
        }
        @if let Some(premise) = &judged.vacuous { br; span.hint { (why_vacuous(premise)) } }
        @if let Some(decided_s) = judged.decided_at_s { br; span.hint { "certain at " (seconds(decided_s)) " s" } }
        @if let Some(line) = judged.at_s.and_then(|at_s| run.branch_at(at_s)) {
            details.branch { summary { "Branch from here" } code { (line) } }
        }
    }
}

/// Renders every metric over every window in every run, with published values for comparison.
pub(super) fn metrics(runs: &[Run]) -> Markup {
    let metrics = runs.iter().flat_map(|run| &run.metrics);
    let rows = distinct(metrics, |a, b| is_same(a, b));
    let has_published = runs
        .iter()
        .any(|run| rows.iter().any(|row| published(run, row).is_some()));
    let notes: BTreeSet<&str> = (runs.iter().filter_map(Run::plan))
        .flat_map(|plan| &plan.metrics)
        .filter_map(|metric| metric.published_note.as_deref())
        .collect();
    html! {
        @if rows.is_empty() { p { "The scenario has no metrics." } }
        @else { div.scroll tabindex="0" { table {
            thead { tr {
                th { "metric" } th.n { "window [s]" }
                @for (number, run) in runs.iter().enumerate() {
                    th.n { (swatch(number)) (run.label) }
                    @if has_published { th.n { "published" } }
                }
            } }
            tbody { @for row in rows { tr {
                th scope="row" { (row.name) }
                td.n { (seconds(row.window_s[0])) " to " (seconds(row.window_s[1])) }
                @for run in runs {
                    td.n { @match run.metrics.iter().find(|one| is_same(one, row)) {
                        Some(Metric { value: Some(value), unit, .. }) => { (short_in(*value, unit)) },
                        _ => "-",
                    } }
                    @if has_published { td.n { @if let Some(published) = published(run, row) {
                        (short(published.value)) " (" (published.source) ")"
                    } @else { "-" } } }
                }
            } } }
        } } }
        @for note in notes { p.note { (note) } }
    }
}

fn is_same(a: &Metric, b: &Metric) -> bool {
    a.name == b.name && a.window_s == b.window_s
}

/// Returns the published value of a metric's window for the law active in it.
fn published<'a>(run: &'a Run, metric: &Metric) -> Option<&'a Published> {
    let (published, _) = of_law(run.plan()?, &run.laws, metric)?;
    Some(published)
}

/// Renders the lists of faults, controllers, changes of values and marks.
pub(super) fn events(runs: &[Run]) -> Markup {
    // Runs of one scenario have the same events, which are listed once.
    let mut lists: Vec<(String, Vec<usize>)> = Vec::new();
    for (number, run) in runs.iter().enumerate() {
        let list = events_of(run).into_string();
        match lists.iter_mut().find(|(one, _)| *one == list) {
            Some((_, numbers)) => numbers.push(number),
            None => lists.push((list, vec![number])),
        }
    }
    html! {
        @for (list, numbers) in &lists {
            h3 { @for (nth, number) in numbers.iter().enumerate() {
                @if nth > 0 { ", " }
                (swatch(*number)) (runs[*number].label)
            } }
            (PreEscaped(list))
        }
    }
}

fn events_of(run: &Run) -> Markup {
    let recorded = &run.outcome.recorded;
    let faults = run.plan().map_or_else(Vec::new, |plan| {
        recorded.faults.faults(&plan.faults, run.rate)
    });
    let time = |step: u64| seconds(run.rate.seconds(Step(step)));
    html! {
        @if faults.is_empty() && recorded.changes.is_empty() && run.spans.is_empty() { p { "No fault." } }
        ul {
            @for fault in &faults { li { (fault.describe()) } }
            // For runs whose scenario is invalid.
            @if faults.is_empty() { @for span in &run.spans {
                li { "fault " (span.event) " " (span.kind) " from " (seconds(span.from_s)) " s" }
            } }
            @for change in &recorded.changes {
                li { "controller " (change.epoch) ", step " (change.step) ": " (changed(change)) }
            }
            @for change in &recorded.values {
                li { "change " (change.id) ", step " (change.step) ", " (time(change.step)) " s: " (change.described()) (not_confirmed(&recorded.faults.unconfirmed_of(change))) }
            }
            @for held in &recorded.held_commands {
                li { (held.describe(run.last.0)) }
            }
            @for counts in recorded.end.iter().flat_map(|end| &end.bus) {
                li { (counts.describe()) }
            }
            @for mark in &recorded.marks {
                li { "mark, step " (mark.step) ", " (time(mark.step)) " s: " (mark.text) }
            }
        }
    }
}

fn changed(change: &shared_types::record::ControllerChange) -> String {
    use shared_types::record::ControllerFate;
    match &change.change {
        ControllerFate::Lost { reason, policy } => {
            format!("lost, {reason}; then {}", policy.name())
        }
        ControllerFate::Joined { law } => format!("took over with {law}"),
        ControllerFate::Refused { reason } => format!("refused, {reason}"),
    }
}

/// Renders the percentiles of each leg with the grade; without requested timing, those of the round trip alone.
pub(super) fn latency(runs: &[Run]) -> Markup {
    html! {
        div.scroll tabindex="0" { table {
            thead { tr {
                th { "run" } th { "leg" }
                @for name in ["p50", "p90", "p99", "p99.9", "p99.99", "max", "count"] { th.n { (name) } }
            } }
            tbody { @for (number, run) in runs.iter().enumerate() {
                @let legs = run.outcome.recorded.latency.legs;
                @let count = if run.asks_for_timing() { 5 } else { 1 };
                @let all = [("round trip", Some(legs.round_trip)), ("controller", Some(legs.controller)), ("exchange", Some(legs.exchange)), ("plant", Some(legs.plant)), ("late by", legs.release)];
                @for (leg, times) in all.into_iter().take(count) { @if let Some(times) = times.filter(|times| times.count > 0) { tr {
                    th scope="row" { (swatch(number)) (run.label) }
                    td { (leg) }
                    (percentiles(&times))
                } } }
            } }
        } }
        @for (number, run) in runs.iter().enumerate() {
            @let latency = &run.outcome.recorded.latency;
            @if latency.legs.without_command > 0 {
                p { (swatch(number)) (run.label) ": " (without_command(latency.legs.without_command)) "." }
            }
            @if let Some(graded) = latency.grade.as_ref().filter(|_| run.asks_for_timing()) {
                p { (swatch(number)) (run.label) ": " (graded.grade.words()) ", by the limits that are usual in machine control." }
            }
        }
    }
}

fn percentiles(times: &Percentiles) -> Markup {
    html! {
        @for time in times.shown() { td.n { (time) } }
        td.n { (times.count) }
    }
}

/// Renders the worst steps of runs with requested timing, with their circumstances: by the round trip, and by the
/// release.
pub(super) fn spikes(runs: &[Run]) -> Markup {
    type Of = fn(&LatencySummary) -> &[Spike];
    let lists: [(&str, Of); 2] = [
        ("The longest round trips", |latency| &latency.spikes),
        ("The latest releases", |latency| &latency.late_releases),
    ];
    let runs = (runs.iter().enumerate()).filter(|(_, run)| run.asks_for_timing());
    html! {
        @for (title, of) in lists {
            @let rows = runs.clone().flat_map(|(number, run)| {
                of(&run.outcome.recorded.latency).iter().map(move |spike| (number, run, spike))
            });
            @if rows.clone().next().is_some() {
                h3 { (title) }
                div.scroll tabindex="0" { table {
                    thead { tr { th { "run" } th.n { "step" } th.n { "time" } th.n { "round trip" } th.n { "controller" } th.n { "late by" } th { "meanwhile" } } }
                    tbody { @for (number, run, spike) in rows { tr {
                        th scope="row" { (swatch(number)) (run.label) }
                        td.n { (spike.step) }
                        td.n { (seconds(run.rate.seconds(Step(spike.step)))) " s" }
                        td.n { @if spike.round_trip_ns > 0 { (shown_ns(spike.round_trip_ns)) } }
                        td.n { (shown_ns(spike.controller_ns)) }
                        td.n { (shown_ns(spike.late_ns)) }
                        td { (spike.surroundings()) }
                    } } }
                } }
            }
        }
    }
}

/// Renders all recorded facts about a run, grouped by subject.
pub(super) fn provenance(runs: &[Run]) -> Markup {
    const HOST: [&str; 4] = ["host", "kernel", "machine", "cores"];
    html! {
        @for (number, run) in runs.iter().enumerate() {
            @let facts: BTreeMap<&str, &str> = run.outcome.reader.facts().collect();
            @let is_of = |group: &str, name: &str| match group {
                "Doctor" => name.starts_with("doctor_"),
                "Real-time settings" => name.starts_with("realtime_"),
                "Host" => HOST.contains(&name),
                _ => !name.starts_with("doctor_") && !name.starts_with("realtime_") && !HOST.contains(&name),
            };
            h3 { (swatch(number)) (run.label) }
            p { "Evidence level " strong { (run.fact("evidence")) } ": " (meaning(run.fact("evidence"))) "." }
            p { code { (run.outcome.reader.path().display()) } }
            @for group in ["Run", "Host", "Doctor", "Real-time settings"] {
                @let selection: Vec<_> = facts.iter().filter(|(name, _)| is_of(group, name)).collect();
                @if !selection.is_empty() { details open[group == "Run" || group == "Host"] {
                    summary { (group) }
                    div.scroll tabindex="0" { table.facts { tbody {
                        @for (name, value) in selection { tr {
                            th scope="row" { (name.trim_start_matches("doctor_")) } td { (value) }
                        } }
                    } } }
                } }
            }
            @if let Ok(scenario) = run.outcome.reader.attachment("scenario.toml") {
                details { summary { "Configuration: the effective scenario" } pre tabindex="0" { code { (scenario) } } }
            }
        }
    }
}

fn meaning(evidence: &str) -> &'static str {
    let entry = EVIDENCE.iter().find(|(level, _)| *level == evidence);
    entry.map_or("unknown", |(_, meaning)| meaning)
}

pub(super) fn badge(verdict: &str) -> Markup {
    html! { span.badge data-verdict=(verdict) { (verdict) } }
}

/// Renders the colour of a run.
pub(super) fn swatch(run: usize) -> Markup {
    html! { span.swatch data-run=(run) aria-hidden="true" {} }
}

/// Formats a time without trailing zeros.
pub(super) fn seconds(time_s: f64) -> String {
    let text = format!("{time_s:.6}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}
