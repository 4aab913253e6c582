//! State of the watched session, fed by its records, its events and the answers of its plant.
//!
//! Drawn by the [view](super::view), told in one line by the [line](super::line). Knows no terminal and
//! asks nobody.

use std::path::PathBuf;

use hil_config::evaluation::Evaluation;
use hil_config::expression::Columns;
use hil_config::plan::Plan;
use hil_console::terminal::exit::Failure;
use hil_facts::session::happening::Happening;
use hil_facts::session::observer::Seen;
use hil_facts::session::standing::Standing;
use shared_types::live::{FaultState, Status};
use shared_types::record::{ControllerFate, Event, Outcome, RecordLayout, Validity};
use shared_types::time::{Rate, Step};

use super::history::History;
use super::log::Log;
use super::pace::Pace;
use super::plots::{self, Plot, chosen};
use crate::plots::bounds::bounds;
use crate::plots::columns_of;
use crate::plots::signal::own_names;
use hil_recording::reader::Column;

/// End of the watched run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ending {
    /// Last word in the record stream.
    pub outcome: Option<Outcome>,
    /// Reason, if the run did not come to its end.
    pub reason: Option<String>,
    /// Steps that were executed, if that is known.
    pub steps: Option<u64>,
    /// The verdict of its summary.
    pub verdict: Option<String>,
    /// `hil` has removed the session.
    pub is_gone: bool,
    /// `hil` is gone and wrote no summary, as when it was killed.
    pub is_abandoned: bool,
    /// A recording is left that can be recovered.
    pub is_recoverable: bool,
}

/// State of the requirements.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Judged {
    /// Nobody was asked yet.
    #[default]
    Unknown,
    /// `hil` gave no answer.
    Silent,
    /// Answer of `hil`.
    Known(Vec<Standing>),
}

/// A signal that is kept.
struct Trace {
    /// Place among the columns.
    column: usize,
    value: f64,
    /// Value of the record before.
    before: f64,
    history: History,
}

/// The watched session.
pub struct Model {
    /// Name of the session.
    pub session: String,
    /// Folder of the run, if it is recorded.
    pub run_dir: Option<PathBuf>,
    plan: Plan,
    /// The law that answers now.
    law: String,
    patterns: Vec<String>,
    columns: Vec<Column>,
    plots: Vec<Plot>,
    /// Columns whose values the panel's table asks for.
    readings: Vec<usize>,
    traces: Vec<Trace>,
    /// For derived signals that are drawn.
    derived: Option<Evaluation>,
    validity: Validity,
    pace: Pace,
    /// The newest record, if there was one.
    step: Option<u64>,
    joined: Option<u64>,
    /// Records and events that were lost since it joined.
    pub lost: u64,
    /// `hil` is stopped, by a signal or a debugger, and the run with it.
    pub is_owner_stopped: bool,
    status: Option<Status>,
    faults: Vec<FaultState>,
    judged: Judged,
    /// Number of times that what can be tuned may have become another.
    retunings: u64,
    note: Option<String>,
    log: Log,
    ending: Option<Ending>,
}

impl Model {
    /// Of a session before anything was seen of it.
    #[must_use]
    pub fn new(session: &str, run_dir: Option<PathBuf>, plan: Plan, patterns: &[String]) -> Self {
        Self {
            session: session.into(),
            run_dir,
            law: plan.controller.law.clone(),
            plan,
            patterns: patterns.to_vec(),
            columns: Vec::new(),
            plots: Vec::new(),
            readings: Vec::new(),
            traces: Vec::new(),
            derived: None,
            validity: Validity::default(),
            pace: Pace::default(),
            step: None,
            joined: None,
            lost: 0,
            is_owner_stopped: false,
            status: None,
            faults: Vec::new(),
            judged: Judged::Unknown,
            retunings: 0,
            note: None,
            log: Log::default(),
            ending: None,
        }
    }

    /// Takes the signals, which are known from now on.
    ///
    /// # Errors
    /// If those that are to be drawn are not among them.
    pub(crate) fn attach(&mut self, layout: &RecordLayout) -> Result<(), Failure> {
        self.validity = layout.validity();
        // Patterns know nothing of what requirements compute.
        let mut plan = self.plan.clone();
        let (bounds, computed) = bounds(&plan, self.seconds(plan.run.steps));
        if self.patterns.is_empty() {
            plan.derived.extend(computed);
        }
        self.columns = columns_of(layout, &plan.derived);
        let aliases = Columns::from(layout).aliases();
        let own = |patterns: &[String]| {
            let names = self.columns.iter().map(|one| one.name.as_str());
            own_names(patterns, names, &aliases)
        };
        let (patterns, readings) = (own(&self.patterns), own(&self.plan.panel.readings));
        self.plots = chosen(&self.columns, &self.plan, bounds, &patterns)?;
        self.readings = plots::readings(&self.columns, &readings)?;
        let mut drawn: Vec<usize> = (self.plots.iter())
            .flat_map(|plot| plot.signals.iter().copied())
            .chain(self.readings.iter().copied())
            .collect();
        drawn.sort_unstable();
        drawn.dedup();
        if drawn.iter().any(|signal| *signal >= layout.values()) {
            let evaluation = Evaluation::new(&plan.without_judgement(), &Columns::from(layout));
            self.derived = Some(evaluation.map_err(Failure::infrastructure)?);
        }
        self.traces = drawn
            .into_iter()
            .map(|column| Trace {
                column,
                value: f64::NAN,
                before: f64::NAN,
                history: History::default(),
            })
            .collect();
        Ok(())
    }

    /// Takes what was seen.
    pub fn take(&mut self, seen: Seen<'_>) {
        match seen {
            // The newest one may have been asked for before the stream brings it and those before it.
            Seen::Record(record, _) if self.step.is_some_and(|step| record.step <= step) => {}
            Seen::Record(record, _) => {
                self.joined.get_or_insert(record.step);
                self.step = Some(record.step);
                self.pace.take(record.step, &record.timing);
                let recorded = record.values.len();
                if let Some(evaluation) = &mut self.derived {
                    let invalid = self.validity.invalid(record.hashed);
                    evaluation.observe(Step(record.step), record.values, invalid);
                }
                let derived = self.derived.as_ref().map_or(&[][..], Evaluation::derived);
                for trace in &mut self.traces {
                    trace.before = trace.value;
                    trace.value = match trace.column.checked_sub(recorded) {
                        None => record.values[trace.column],
                        Some(at) => derived[at],
                    };
                    trace.history.take(record.step, trace.value);
                }
            }
            Seen::Event(event) => self.take_event(event),
            Seen::Lost(count) => self.lost += count,
            Seen::Broken(what) => self.note = Some(format!("unreadable: {what}")),
        }
    }

    fn take_event(&mut self, event: Event) {
        if let Some(happening) = Happening::of(&event, self.rate()) {
            self.note = Some(happening.text.clone());
            self.log.see(happening);
        }
        match event {
            Event::Controller(change) => {
                if let ControllerFate::Joined { law } = change.change {
                    self.law = law;
                    self.retunings += 1;
                }
            }
            Event::Change(_) => self.retunings += 1,
            Event::End(end) => {
                let ending = self.ending.get_or_insert_default();
                ending.outcome = Some(end.outcome);
                ending.reason = end.reason;
                ending.steps = Some(end.steps);
                self.keep_last_values();
            }
            Event::Accepted(_) | Event::Fault(_) | Event::FaultEnded(_) | Event::Mark(_) => {}
        }
    }

    /// Keeps the last values of signals that the record after the last step lacks: no command answers it.
    fn keep_last_values(&mut self) {
        for trace in self.traces.iter_mut().filter(|trace| trace.value.is_nan()) {
            trace.value = trace.before;
        }
    }

    /// Takes the status that the plant reports.
    pub(crate) fn hear_status(&mut self, status: Status) {
        self.status = Some(status);
    }

    /// Takes the faults that the plant reports.
    pub(crate) fn hear_faults(&mut self, faults: Vec<FaultState>) {
        self.faults = faults;
    }

    /// Takes in what is said of the requirements. A silence does not unsay what was known, and an answer that
    /// comes after the end is older than the summary.
    pub(crate) fn hear_standings(&mut self, standings: Option<Vec<Standing>>) {
        if self.ending.as_ref().is_some_and(|ending| ending.is_gone) {
            return;
        }
        match standings {
            Some(standings) => self.judged = Judged::Known(standings),
            None if matches!(self.judged, Judged::Known(_)) => {}
            None => self.judged = Judged::Silent,
        }
    }

    /// The session is no more. `verdict` is that of its summary, if there is one.
    pub fn end(&mut self, verdict: Option<String>) {
        let ending = self.ending.get_or_insert_default();
        ending.is_gone = true;
        ending.verdict = verdict;
        self.keep_last_values();
        self.is_owner_stopped = false;
    }

    /// The session is no more, and `hil` is gone without a summary; perhaps it has left a recording.
    pub fn abandon(&mut self, is_recoverable: bool) {
        self.end(None);
        let ending = self.ending.get_or_insert_default();
        ending.is_abandoned = true;
        ending.is_recoverable = is_recoverable;
    }

    /// The law that answers now.
    #[must_use]
    pub fn law(&self) -> &str {
        &self.law
    }

    /// The scenario.
    #[must_use]
    pub const fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Steps per second.
    #[must_use]
    pub const fn rate(&self) -> Rate {
        self.plan.run.rate
    }

    /// A step's simulated time in s.
    #[must_use]
    pub fn seconds(&self, step: u64) -> f64 {
        self.rate().seconds(Step(step))
    }

    /// The newest step that is known of.
    #[must_use]
    pub fn step(&self) -> Option<u64> {
        let asked = self.status.as_ref().map(|status| status.step);
        // The last record of a held run is some steps older.
        if self.is_paused() {
            asked
        } else {
            self.step.or(asked)
        }
    }

    /// The step of the newest record.
    #[must_use]
    pub(crate) const fn seen(&self) -> Option<u64> {
        self.step
    }

    /// The first step that was seen, unless it was the run's first.
    #[must_use]
    pub(crate) fn joined_late(&self) -> Option<u64> {
        self.joined.filter(|step| *step > 0)
    }

    /// Reports a run that the plant holds.
    #[must_use]
    pub(crate) fn is_paused(&self) -> bool {
        self.status.as_ref().is_some_and(|status| status.paused)
    }

    /// Returns the end of the run, if it has ended.
    #[must_use]
    pub const fn ending(&self) -> Option<&Ending> {
        self.ending.as_ref()
    }

    /// `starting`, `running`, `paused` or `ended`.
    #[must_use]
    pub fn state(&self) -> &'static str {
        if self.ending.is_some() {
            "ended"
        } else if self.is_paused() {
            "paused"
        } else if self.step().is_some() {
            "running"
        } else {
            "starting"
        }
    }

    /// Simulated seconds per second.
    #[must_use]
    pub(crate) fn speed(&self, now_ns: u64) -> Option<f64> {
        let steps_per_s = self.pace.steps_per_s(now_ns)?;
        Some(steps_per_s / self.rate().hz())
    }

    /// Speed and round trips.
    #[must_use]
    pub(crate) const fn pace(&self) -> &Pace {
        &self.pace
    }

    /// Returns the plots.
    #[must_use]
    pub fn plots(&self) -> &[Plot] {
        &self.plots
    }

    /// The newest value of a signal that is drawn; NaN if there is none.
    #[must_use]
    pub fn value(&self, signal: usize) -> f64 {
        self.trace(signal).map_or(f64::NAN, |trace| trace.value)
    }

    /// Returns the history of a signal that is drawn.
    #[must_use]
    pub(crate) fn history(&self, signal: usize) -> Option<&History> {
        self.trace(signal).map(|trace| &trace.history)
    }

    /// Number of changes of values and of controllers that were seen.
    #[must_use]
    pub(crate) const fn retunings(&self) -> u64 {
        self.retunings
    }

    /// Lists the columns that the panel's readings show; empty: those of the plots.
    #[must_use]
    pub(crate) fn readings(&self) -> &[usize] {
        &self.readings
    }

    /// Every signal that is drawn, with its place among the columns.
    pub(crate) fn drawn(&self) -> impl Iterator<Item = (usize, &Column)> + '_ {
        let traces = self.traces.iter();
        traces.map(|trace| (trace.column, &self.columns[trace.column]))
    }

    /// Newest value and history of every signal that is drawn, in the order of [`drawn`](Self::drawn).
    pub(crate) fn histories(&self) -> impl Iterator<Item = (f64, &History)> + '_ {
        self.traces
            .iter()
            .map(|trace| (trace.value, &trace.history))
    }

    fn trace(&self, signal: usize) -> Option<&Trace> {
        self.traces.iter().find(|trace| trace.column == signal)
    }

    /// Every signal that is drawn, by name, with its newest value.
    pub fn values(&self) -> impl Iterator<Item = (String, f64)> + '_ {
        let named = |trace: &Trace| (self.columns[trace.column].name.clone(), trace.value);
        self.traces.iter().map(named)
    }

    /// The faults of the run.
    #[must_use]
    pub fn faults(&self) -> &[FaultState] {
        &self.faults
    }

    /// The requirements.
    #[must_use]
    pub const fn judged(&self) -> &Judged {
        &self.judged
    }

    /// Takes the recorder's account after its first `known` events; passes it over if others came meanwhile.
    pub(crate) fn hear_account(&mut self, known: usize, account: Vec<Happening>) {
        if known == self.log.known() {
            self.log.hear(account);
        }
    }

    /// Takes the account of the whole run.
    pub(crate) fn hear_whole_account(&mut self, mut account: Vec<Happening>) {
        let known = self.log.known().min(account.len());
        self.log.hear(account.split_off(known));
    }

    /// Reports a run whose stream was seen from its begin on without a loss.
    #[must_use]
    pub(crate) const fn has_seen_all(&self) -> bool {
        self.lost == 0 && matches!(self.joined, Some(0))
    }

    /// Everything that happened.
    #[must_use]
    pub const fn log(&self) -> &Log {
        &self.log
    }

    /// The last thing that happened.
    #[must_use]
    pub fn note(&self) -> Option<&str> {
        self.note.as_deref()
    }
}

#[cfg(test)]
pub(crate) mod tests;
