//! Report of `hil latency`: JSON; text with a table, a histogram and spikes; and CSV with all histograms.

use std::collections::BTreeMap;
use std::fmt::{self, Write as _};
use std::path::Path;

use hil_console::terminal::duration::shown_ns;
use hil_console::terminal::output;
use hil_console::terminal::table::{Table, left, right};
use hil_facts::results::latency::bars::bars;
use hil_facts::results::latency::grade::Graded;
use hil_facts::results::latency::legs::{LatencySummary, without_command};
use hil_facts::results::latency::percentiles::Percentiles;
use hil_facts::results::latency::spikes::Spike;
use hil_facts::results::latency::times::Times;
use rustix::thread::{CpuSet, sched_getaffinity};
use serde::Serialize;
use shared_types::realtime;
use shared_types::wait::WaitStrategy;

use super::exchange::frame_words;
use super::measurement::{Case, Sides};
use super::null::answered_with;

/// Version of the report format.
const SCHEMA: u32 = 1;
/// Width of the text, in columns.
const WIDTH: usize = 80;
/// Width of a spike's figures, in columns.
const SPIKE_FIGURES: usize = 42;
/// Width of a late release's figures, in columns.
const RELEASE_FIGURES: usize = 33;
/// Payload whose histogram is shown, if it was measured.
const HEADLINE_SIGNALS: usize = 32;

/// Figures of all cases, with one of them shown in detail.
#[derive(Debug, Serialize)]
pub(crate) struct Report {
    schema: u32,
    /// Recorded run; null for a new measurement.
    run: Option<String>,
    /// Wait strategy of both sides; null if a recording does not contain it.
    wait: Option<WaitStrategy>,
    /// Cores that both sides may use; null for a recording that does not restrict them.
    cores: Option<Vec<usize>>,
    /// Scheduling class of the plant's side.
    class: Option<String>,
    /// Real-time settings of both sides, as requested and as granted.
    realtime: Option<Sides>,
    /// Facts about the machine as read by `hil doctor`, without measuring.
    machine: BTreeMap<String, String>,
    #[serde(flatten)]
    headline: Figures,
    cases: Vec<Figures>,
    #[serde(skip)]
    headline_case: usize,
}

/// Figures of one case.
#[derive(Clone, Debug, Serialize)]
struct Figures {
    signals: usize,
    /// Steps per second by the clock; null for maximum speed.
    rate_hz: Option<f64>,
    warm_up_steps: u64,
    /// Sizes of the sample and command frames, in bytes.
    frame_bytes: Option<[usize; 2]>,
    round_trip_ns: Percentiles,
    /// Time from sending a sample to the call of the law; null for a recording, because only the null law reports its
    /// call.
    sample_ns: Option<Percentiles>,
    command_ns: Option<Percentiles>,
    exchange_ns: Percentiles,
    controller_ns: Percentiles,
    plant_ns: Percentiles,
    /// Lateness of releases; null in lockstep.
    release_ns: Option<Percentiles>,
    /// Mean time from one step to the next, in ns.
    step_ns: Option<f64>,
    raw_limit_ns: Option<Percentiles>,
    bare_exchange_ns: Option<Percentiles>,
    /// Median round trip divided by that of the raw limit.
    ratio_p50: Option<f64>,
    /// Median round trip divided by that of the bare exchange.
    ratio_bare_p50: Option<f64>,
    /// Number of steps without a command.
    without_command: u64,
    grade: Option<Graded>,
    spikes: Vec<Spike>,
    /// Latest releases; empty in lockstep.
    late_releases: Vec<Spike>,
}

impl Figures {
    fn of(case: &Case) -> Self {
        let looped = &case.looped;
        let LatencySummary {
            legs,
            spikes,
            late_releases,
            grade,
        } = looped.latency.summary();
        let limits = case.limits.as_ref();
        let raw = limits.map(|limits| Percentiles::of(&limits.raw));
        let bare = limits.map(|limits| Percentiles::of(&limits.bare));
        let ratio = |to: Percentiles| legs.round_trip.p50 as f64 / to.p50 as f64;
        let frame_bytes = || {
            [case.signals, answered_with(case.signals)]
                .map(|signals| frame_words(signals) * size_of::<u64>())
        };
        Self {
            signals: case.signals,
            rate_hz: case.rate.map(|rate| rate.hz()),
            warm_up_steps: case.warm_up,
            frame_bytes: limits.map(|_| frame_bytes()),
            round_trip_ns: legs.round_trip,
            sample_ns: looped
                .ways
                .as_ref()
                .map(|ways| Percentiles::of(&ways.sample)),
            command_ns: looped
                .ways
                .as_ref()
                .map(|ways| Percentiles::of(&ways.command)),
            exchange_ns: legs.exchange,
            controller_ns: legs.controller,
            plant_ns: legs.plant,
            release_ns: legs.release,
            step_ns: looped.step_ns(),
            raw_limit_ns: raw,
            bare_exchange_ns: bare,
            ratio_p50: raw.map(ratio),
            ratio_bare_p50: bare.map(ratio),
            without_command: legs.without_command,
            grade,
            spikes,
            late_releases,
        }
    }

    fn released(&self) -> String {
        match self.rate_hz {
            None => "as fast as both sides can".into(),
            Some(hz) => format!("{hz} steps a second by the clock"),
        }
    }

    fn write(&self, table: &mut Table) {
        table.line(self.released());
        let rows = [
            ("  round trip", Some(self.round_trip_ns)),
            ("    to the law", self.sample_ns),
            ("    and back", self.command_ns),
            ("    exchange", Some(self.exchange_ns)),
            ("    controller", Some(self.controller_ns)),
            ("  plant", Some(self.plant_ns)),
            ("  late by", self.release_ns),
        ];
        for (name, figures) in rows {
            if let Some(figures) = figures {
                row(table, name, &figures);
            }
        }
        if let (Some(raw), Some(bare)) = (self.ratio_p50, self.ratio_bare_p50) {
            table.line(format!(
                "  p50 of the round trip: {raw:.2} times raw, {bare:.2} times bare"
            ));
        }
        if let Some(step_ns) = self.step_ns {
            let step = shown_ns(step_ns as u64);
            table.line(format!("  a whole step: {step} on average"));
        }
        if self.without_command > 0 {
            table.line(format!("  {}", without_command(self.without_command)));
        }
        table.line(match &self.grade {
            Some(graded) => format!("  {graded}"),
            None => "  no step was answered".into(),
        });
    }
}

/// Appends words to a line that already has some columns, wrapping into further lines as needed.
fn write_wrapped(text: &mut String, words: &str, indent: usize) -> fmt::Result {
    let mut column = indent;
    for word in words.split(' ') {
        if column + 1 + word.len() > WIDTH {
            write!(text, "\n{:indent$}", "")?;
            column = indent;
        }
        write!(text, " {word}")?;
        column += 1 + word.len();
    }
    writeln!(text)
}

/// Appends a row of percentiles to the table.
fn row(table: &mut Table, name: &str, figures: &Percentiles) {
    let cells = [name.to_owned()].into_iter().chain(figures.shown());
    table.cells(cells.chain([figures.count.to_string()]));
}

impl Report {
    /// Creates the report of at least one case.
    pub(crate) fn new(cases: &[Case], run: Option<&Path>) -> Self {
        let figures: Vec<Figures> = cases.iter().map(Figures::of).collect();
        let stands_for_all =
            |figures: &Figures| figures.signals == HEADLINE_SIGNALS && figures.rate_hz.is_none();
        let headline_case = figures.iter().position(stands_for_all).unwrap_or(0);
        let sides = cases[headline_case].looped.sides.clone();
        let machine = run.is_none().then(hil_doctor::facts);
        Self {
            schema: SCHEMA,
            run: run.map(|run| run.display().to_string()),
            wait: sides.as_ref().map(|sides| sides.plant.wait.granted),
            cores: (sides.as_ref()).and_then(|sides| cores(sides, run.is_none())),
            class: sides.as_ref().map(|sides| class(&sides.plant)),
            realtime: sides,
            machine: machine.into_iter().flatten().collect(),
            headline: figures[headline_case].clone(),
            cases: figures,
            headline_case,
        }
    }

    /// Formats the report for a person.
    pub(crate) fn text(&self, cases: &[Case]) -> String {
        output::text(|text| self.write(text, cases))
    }

    fn write(&self, text: &mut String, cases: &[Case]) -> fmt::Result {
        match &self.run {
            Some(run) => writeln!(text, "{run}")?,
            None => writeln!(
                text,
                "a plant and a law that do nothing, in two processes over iceoryx2"
            )?,
        }
        if let Some(wait) = self.wait {
            let cores = (self.cores.as_deref()).map_or_else(
                || vec!["any".into()],
                |cores| cores.iter().map(ToString::to_string).collect(),
            );
            let (cores, class) = (cores.join(", "), self.class.as_deref().unwrap_or("unknown"));
            let wait = wait.name();
            writeln!(text, "wait: {wait}; cores: {cores}; class: {class}")?;
        }
        if let Some(Sides {
            plant, controller, ..
        }) = &self.realtime
        {
            for (side, report) in [("plant", plant), ("controller", controller)] {
                for refusal in refusals(side, report) {
                    writeln!(text, "{refusal}")?;
                }
            }
        }
        for check in ["virtualisation", "load"] {
            if let Some(observation) = self.machine.get(&format!("doctor_{check}")) {
                writeln!(text, "{check}: {observation}")?;
            }
        }
        let mut columns = [right(7).close(); 8];
        (columns[0], columns[7]) = (left(18), right(9).close());
        let mut table = Table::new(0, columns);
        let mut signals = None;
        for figures in &self.cases {
            if signals != Some(figures.signals) {
                signals = Some(figures.signals);
                Self::write_heading(&mut table, figures);
            }
            figures.write(&mut table);
        }
        write!(text, "{table}")?;
        let (figures, case) = (&self.headline, &cases[self.headline_case]);
        let (count, released) = (figures.signals, figures.released());
        writeln!(text, "\nround trip of {count} signals, {released}")?;
        writeln!(text, "(a bar grows with the logarithm of its count)")?;
        let [(_, round_trip), ..] = case.looped.latency.times();
        *text += &bars(round_trip);
        writeln!(
            text,
            "\nits worst steps, and the events since the previous poll"
        )?;
        writeln!(
            text,
            "{:>10} {:>10} {:>10} {:>8}",
            "step", "round trip", "controller", "plant"
        )?;
        for spike in &figures.spikes {
            let [round_trip, controller, plant] =
                [spike.round_trip_ns, spike.controller_ns, spike.plant_ns].map(shown_ns);
            let step = spike.step;
            write!(
                text,
                "{step:>10} {round_trip:>10} {controller:>10} {plant:>8} "
            )?;
            write_wrapped(text, &spike.surroundings(), SPIKE_FIGURES)?;
        }
        if !figures.late_releases.is_empty() {
            writeln!(text, "\nits latest releases")?;
            writeln!(text, "{:>10} {:>10} {:>10}", "step", "late by", "plant")?;
        }
        for spike in &figures.late_releases {
            let [late, plant] = [spike.late_ns, spike.plant_ns].map(shown_ns);
            write!(text, "{:>10} {late:>10} {plant:>10} ", spike.step)?;
            write_wrapped(text, &spike.surroundings(), RELEASE_FIGURES)?;
        }
        Ok(())
    }

    /// Writes the payload and the limits of the machine for it.
    fn write_heading(table: &mut Table, figures: &Figures) {
        let heading = format!("{} signals", figures.signals);
        table.line("");
        table.cells([
            &heading, "p50", "p90", "p99", "p99.9", "p99.99", "max", "count",
        ]);
        let limits = [
            ("raw shared memory", &figures.raw_limit_ns),
            ("bare iceoryx2", &figures.bare_exchange_ns),
        ];
        for (name, figures) in limits {
            if let Some(figures) = figures {
                row(table, name, figures);
            }
        }
    }
}

/// Returns the cores that both sides may use: its core for a pinned side, and all cores of this process otherwise.
/// `None` if the sides ran elsewhere and one of them was not pinned.
fn cores(sides: &Sides, ran_here: bool) -> Option<Vec<usize>> {
    let allowed = sched_getaffinity(None).unwrap_or_default();
    let pinned = [sides.plant.core.granted, sides.controller.core.granted];
    if !ran_here && pinned.contains(&None) {
        return None;
    }
    let may_run_on = |core: &usize| {
        pinned.iter().any(|pinned| match pinned {
            Some(pinned) => *pinned as usize == *core,
            None => allowed.is_set(*core),
        })
    };
    Some((0..CpuSet::MAX_CPU).filter(may_run_on).collect())
}

/// Formats the scheduling class of a side.
fn class(report: &realtime::Report) -> String {
    match report.priority.granted {
        0 => "ordinary".into(),
        priority => format!("SCHED_FIFO {priority}"),
    }
}

/// Lists the settings of one side that were requested but not granted.
fn refusals(side: &str, report: &realtime::Report) -> Vec<String> {
    let refusal = |what: &str, reason: Option<&str>| {
        reason.map(|reason| format!("{side}'s {what} was not granted: {reason}"))
    };
    [
        refusal("core", report.core.refusal(&None)),
        refusal("priority", report.priority.refusal(&0)),
        refusal("wait", report.wait.refusal(&WaitStrategy::default())),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// Formats all histograms as CSV, with a row for each non-empty class: `from_ns <= t < to_ns`.
pub(crate) fn csv(cases: &[Case]) -> String {
    let mut text = String::from("signals,rate_hz,leg,from_ns,to_ns,count\n");
    let mut limits_of = None;
    for case in cases {
        let rate = case.rate.map_or("max".into(), |rate| rate.hz().to_string());
        let mut rows = |rate: &str, leg: &str, times_ns: &Times| {
            let signals = case.signals;
            for (from_ns, to_ns, count) in times_ns.buckets() {
                // Writing to a string cannot fail.
                let _ = writeln!(text, "{signals},{rate},{leg},{from_ns},{to_ns},{count}");
            }
        };
        // The limits are the same for all rates of a payload.
        if let Some(limits) = &case.limits
            && limits_of.replace(case.signals) != Some(case.signals)
        {
            rows("", "raw_limit", &limits.raw);
            rows("", "bare_exchange", &limits.bare);
        }
        for (leg, times_ns) in case.looped.latency.times() {
            rows(&rate, leg, times_ns);
        }
        if let Some(ways) = &case.looped.ways {
            rows(&rate, "sample", &ways.sample);
            rows(&rate, "command", &ways.command);
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_descriptions_of_a_spike_are_wrapped_to_their_columns() {
        let mut text = "x".repeat(60);
        let words = "plant moved from core 0 to 1; neither more";
        write_wrapped(&mut text, words, 60).expect("a string takes all");
        let expected = format!(
            "{} plant moved from\n{} core 0 to 1;\n{} neither more\n",
            "x".repeat(60),
            " ".repeat(60),
            " ".repeat(60)
        );
        assert_eq!(text, expected);
    }
}
