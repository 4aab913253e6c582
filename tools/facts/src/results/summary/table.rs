//! Summary as a table for the user.

use std::fmt::Write as _;
use std::path::Path;

use hil_config::plan::{Plan, Published};
use hil_console::terminal::duration::shown_ns;
use hil_console::terminal::output;
use hil_console::terminal::table::{Table, left, right};
use shared_types::number::{short, unit_shown};
use shared_types::record::RunEnd;

use super::{ChangeAt, MarkAt, Metric, Missed, Recording, Summary};
use crate::results::company::Company;
use crate::results::faults::not_confirmed;
use crate::results::handover::Laws;
use crate::results::latency::legs::without_command;
use crate::results::latency::percentiles::Percentiles;
use crate::results::requirements;

/// Maximum number of listed changes.
const MOST_SHOWN: usize = 20;

/// Texts after a count of late steps or of late commands.
const OVERRAN: &str = "steps overran";
const MISSED: &str = "commands missed their deadline";

impl Missed {
    /// Describes the late steps and commands of a run.
    pub fn of_end(end: &RunEnd) -> impl Iterator<Item = String> {
        let counts = [(end.overruns, OVERRAN), (end.missed_commands, MISSED)];
        (counts.into_iter()).filter_map(|(streaks, what)| Self::from(streaks).describe(what))
    }

    /// Describes the steps, if there are any.
    fn describe(&self, what: &str) -> Option<String> {
        let first_step = self.first_step?;
        let (count, longest) = (self.count, self.longest_streak);
        Some(format!(
            "{count} {what}, at most {longest} in a row, the first at step {first_step}"
        ))
    }
}

impl Summary {
    /// Returns the summary as a table.
    #[must_use]
    pub fn table(&self, plan: &Plan, run_dir: &Path) -> String {
        output::text(|text| self.write_table(text, plan, run_dir))
    }

    fn write_table(&self, text: &mut String, plan: &Plan, run_dir: &Path) -> std::fmt::Result {
        let (law, model) = (self.laws.describe(plan.run.rate), &plan.plant.model);
        writeln!(
            text,
            "{}: {}  ({law} on {model}, {})",
            self.scenario,
            requirements::in_words(self.verdict.name(), self.requirements.len()),
            self.clock
        )?;
        if let Some(reason) = &self.reason {
            writeln!(text, "  {reason}")?;
        }
        writeln!(
            text,
            "  {} steps, {} s in {:.2} s, {:.1}x real time",
            self.steps, self.sim_time_s, self.wall_time_s, self.realtime_factor
        )?;
        if let Some(resumed) = &self.resumed {
            writeln!(text, "  {}", resumed.describe())?;
        }
        let overruns = self.overruns.as_ref();
        let overran = overruns.and_then(|overruns| overruns.steps.describe(OVERRAN));
        let missed = (self.missed_commands.as_ref()).and_then(|missed| missed.describe(MISSED));
        for description in overran.iter().chain(&missed) {
            writeln!(text, "  {description}")?;
        }
        if let Some(target) = &self.target {
            writeln!(text, "  {target} ({})", self.evidence)?;
        }
        if self.plant.kind.is_some() {
            let simulated = match self.plant.simulated.as_slice() {
                [] => String::new(),
                names => format!("; simulated here: {}", names.join(", ")),
            };
            writeln!(text, "  plant behind a port ({}){simulated}", self.evidence)?;
        }
        if !self.started_by_hand.is_empty() {
            let sides = self.started_by_hand.join(" and ");
            writeln!(text, "  {sides} started by hand ({})", self.evidence)?;
        }
        for connection in &self.connections {
            writeln!(text, "  connected: {connection}")?;
        }
        for held in &self.held_commands {
            writeln!(text, "  {}", held.describe(self.steps))?;
        }
        for counts in &self.bus {
            writeln!(text, "  {}", counts.describe())?;
        }
        for port in [&self.plant_port, &self.port].into_iter().flatten() {
            if !port.repeatable {
                writeln!(
                    text,
                    "  the far end of the port keeps a clock of its own, so equal runs differ"
                )?;
            }
            for line in port.describe() {
                writeln!(text, "  {line}")?;
            }
        }
        for controller in &self.controllers {
            writeln!(text, "  {}", controller.describe())?;
        }
        for fault in &self.faults {
            writeln!(text, "  {}", fault.describe())?;
        }
        for ChangeAt {
            change,
            at_s,
            unconfirmed,
        } in self.changes.iter().take(MOST_SHOWN)
        {
            let (id, step, description) = (change.id, change.step, change.described());
            let live = if change.live { " (live)" } else { "" };
            writeln!(
                text,
                "  change {id}{live} at step {step} ({at_s} s): {description}{}",
                not_confirmed(unconfirmed)
            )?;
        }
        if self.changes.len() > MOST_SHOWN {
            let more = self.changes.len() - MOST_SHOWN;
            writeln!(text, "  {more} more changes are in the summary's JSON")?;
        }
        for MarkAt { mark, at_s } in &self.marks {
            writeln!(
                text,
                "  mark at step {} ({at_s} s): {}",
                mark.step, mark.text
            )?;
        }
        write_metrics(text, &self.metrics, plan, &self.laws, self.steps)?;
        requirements::write(text, &self.requirements)?;
        self.write_latency(text, plan.asks_for_timing())?;
        writeln!(text, "  {}", self.realtime.describe())?;
        if let Some(company) = self.company.filter(Company::is_worth_telling) {
            writeln!(text, "  {company}")?;
        }
        let Recording {
            file,
            records,
            digested,
            kept,
            cut_short,
            lost,
            ..
        } = &self.recording;
        match (&self.digest, cut_short) {
            (Some(digest), None) => writeln!(text, "  digest {digest}")?,
            (Some(digest), Some(_)) => writeln!(
                text,
                "  digest {digest} of {digested} records, of which the file has {kept}"
            )?,
            (None, _) => {}
        }
        let lost = if *lost > 0 {
            format!(", {lost} LOST")
        } else {
            String::new()
        };
        for checkpoint in &self.checkpoints {
            writeln!(text, "  {}", checkpoint.describe(run_dir))?;
        }
        let run_dir = run_dir.display();
        match file {
            Some(file) if kept < records => writeln!(
                text,
                "  {kept} of {records} records{lost} in {run_dir}/{file}"
            ),
            Some(file) => writeln!(text, "  {records} records{lost} in {run_dir}/{file}"),
            None => writeln!(
                text,
                "  {records} records{lost}, not recorded; summary in {run_dir}"
            ),
        }
    }

    /// Writes the durations of steps: one line, or with requested timing also the grade, the releases, and the worst
    /// round trips and releases with their causes.
    fn write_latency(&self, text: &mut String, asks_for_timing: bool) -> std::fmt::Result {
        let (Some(graded), legs) = (&self.grade, &self.latency_ns) else {
            return Ok(());
        };
        write!(text, "  round trip {}", figures(&legs.round_trip))?;
        if legs.without_command > 0 {
            write!(text, ", {}", without_command(legs.without_command))?;
        }
        if !asks_for_timing {
            return writeln!(text);
        }
        writeln!(text, ": {}", graded.grade.words())?;
        if let Some(worst) = self.spikes.first() {
            writeln!(text, "  worst: {}", worst.describe())?;
        }
        if let Some(release) = &legs.release {
            writeln!(text, "  late by {}", figures(release))?;
        }
        match self.late_releases.first() {
            Some(latest) => writeln!(text, "  latest: {}", latest.describe_release()),
            None => Ok(()),
        }
    }
}

/// Formats the figures of a leg in one line.
fn figures(leg: &Percentiles) -> String {
    let [p50, p99, p9999, max] = [leg.p50, leg.p99, leg.p9999, leg.max].map(shown_ns);
    format!("{p50} p50, {p99} p99, {p9999} p99.99, {max} max")
}

/// Writes the table of metrics after some steps, with published values for comparison.
pub fn write_metrics(
    text: &mut String,
    metrics: &[Metric],
    plan: &Plan,
    laws: &Laws,
    steps: u64,
) -> std::fmt::Result {
    if metrics.is_empty() || steps == 0 {
        return Ok(());
    }
    let published: Vec<_> = (metrics.iter())
        .map(|metric| of_law(plan, laws, metric))
        .collect();
    let any = published.iter().any(Option::is_some);
    let column = if any { "published" } else { "" };
    let columns = [left(0), right(10), right(11), left(4).close()];
    let mut table = Table::new(2, [&columns[..], &[right(9), left(0).close()]].concat());
    table.cells(["metric", "window [s]", "value", "", column]);
    let mut notes = Vec::new();
    for (metric, published) in metrics.iter().zip(published) {
        let [start_s, end_s] = metric.window_s;
        let window = format!("{start_s} to {end_s}");
        let (value, unit) = match metric.value {
            Some(value) => (short(value), unit_shown(&metric.unit)),
            None => ("-".into(), ""),
        };
        let [figure, source] = match published {
            Some((published, note)) => {
                notes.extend(note);
                [short(published.value), format!("({})", published.source)]
            }
            None => Default::default(),
        };
        table.row(&[&metric.name, &window, &value, &unit, &figure, &source]);
    }
    write!(text, "\n{table}")?;
    if steps < plan.run.steps {
        writeln!(
            text,
            "  the run ended early: windows beyond its end are incomplete"
        )?;
    }
    notes.dedup();
    for note in notes {
        writeln!(text, "  note: {note}")?;
    }
    writeln!(text)
}

/// Returns the published value of a metric's window for the law active in it, and its note.
pub fn of_law<'a>(
    plan: &'a Plan,
    laws: &Laws,
    metric: &Metric,
) -> Option<(&'a Published, &'a Option<String>)> {
    let law = laws.during(metric.window_s, plan.run.rate)?;
    let planned = plan
        .metrics
        .iter()
        .find(|planned| planned.name == metric.name)?;
    let is_it =
        |published: &&Published| published.law == law && published.window_s == metric.window_s;
    Some((
        planned.published.iter().find(is_it)?,
        &planned.published_note,
    ))
}
