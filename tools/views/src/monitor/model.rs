//! State of the watched session, built from its records, its events and the plant's answers.
//!
//! Drawn by the [view](super::view), summarised by the [line](super::line). Does no input or output.

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
use crate::plots::signal::own_names;
use crate::plots::{columns_of, descriptions_of};
use hil_recording::reader::Column;

/// End of the watched run.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Ending {
    /// Outcome in the record stream, if it was received.
    pub outcome: Option<Outcome>,
    /// Reason, if the run stopped early.
    pub reason: Option<String>,
    /// Number of executed steps, if known.
    pub steps: Option<u64>,
    /// Verdict in its summary.
    pub verdict: Option<String>,
    /// `true` once `hil` has removed the session.
    pub is_gone: bool,
    /// `true` if `hil` ended without writing a summary, for example because it was killed.
    pub is_abandoned: bool,
    /// `true` if a recording is left that can be recovered.
    pub is_recoverable: bool,
}

/// State of the requirements.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) enum Judged {
    /// No answer requested yet.
    #[default]
    Unknown,
    /// No answer from `hil`.
    Silent,
    /// Answer of `hil`.
    Known(Vec<Standing>),
}

/// Retained signal.
struct Trace {
    /// Index among the columns.
    column: usize,
    value: f64,
    /// Value in the previous record.
    before: f64,
    history: History,
}

/// Watched session.
pub(crate) struct Model {
    /// Name of the session.
    pub session: String,
    /// Folder of the run, if it is recorded.
    pub run_dir: Option<PathBuf>,
    plan: Plan,
    /// Active control law.
    law: String,
    patterns: Vec<String>,
    columns: Vec<Column>,
    plots: Vec<Plot>,
    /// Columns shown in the panel's table of readings.
    readings: Vec<usize>,
    traces: Vec<Trace>,
    /// Evaluation of derived signals that are drawn.
    derived: Option<Evaluation>,
    validity: Validity,
    pace: Pace,
    /// Step of the newest record, if there is one.
    step: Option<u64>,
    joined: Option<u64>,
    /// Records and events lost since the observer joined.
    pub lost: u64,
    /// `true` while `hil`, and with it the run, is stopped by a signal or a debugger.
    pub is_owner_stopped: bool,
    status: Option<Status>,
    faults: Vec<FaultState>,
    judged: Judged,
    /// Number of changes that may have altered the tunable values.
    retunings: u64,
    note: Option<String>,
    log: Log,
    ending: Option<Ending>,
}

impl Model {
    /// Creates the model of a session of which nothing has been observed yet.
    pub(crate) fn new(
        session: &str,
        run_dir: Option<PathBuf>,
        plan: Plan,
        patterns: &[String],
    ) -> Self {
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

    /// Sets the signals once the layout is known.
    ///
    /// # Errors
    /// If a signal to be drawn is not among the signals.
    pub(crate) fn attach(&mut self, layout: &RecordLayout) -> Result<(), Failure> {
        self.validity = layout.validity();
        // Patterns cannot select the signals computed for requirements.
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
        self.plots = chosen(
            &self.columns,
            &self.plan,
            bounds,
            &patterns,
            &descriptions_of(layout),
        )?;
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

    /// Updates the model from an observation.
    pub(crate) fn take(&mut self, seen: Seen<'_>) {
        match seen {
            // The status may report the newest step before the stream delivers its record.
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
                let invalid: Vec<usize> = self.validity.invalid(record.hashed).collect();
                for trace in &mut self.traces {
                    trace.before = trace.value;
                    trace.value = match trace.column.checked_sub(recorded) {
                        // Neither shown nor drawn: the record has what the receiver goes on with.
                        None if invalid.contains(&trace.column) => f64::NAN,
                        None => record.values[trace.column],
                        Some(at) => derived[at],
                    };
                    trace.history.take(record.step, trace.value);
                }
            }
            Seen::Event(event) => self.take_event(event),
            Seen::Lost(count) => self.lost += count,
            Seen::Broken(reason) => self.note = Some(format!("unreadable: {reason}")),
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

    /// Retains the last values of signals that the final record lacks, because no command answers it.
    fn keep_last_values(&mut self) {
        for trace in self.traces.iter_mut().filter(|trace| trace.value.is_nan()) {
            trace.value = trace.before;
        }
    }

    /// Updates the plant's status.
    pub(crate) fn hear_status(&mut self, status: Status) {
        self.status = Some(status);
    }

    /// Updates the plant's faults.
    pub(crate) fn hear_faults(&mut self, faults: Vec<FaultState>) {
        self.faults = faults;
    }

    /// Updates the requirements. No answer leaves a known state unchanged, and an answer after the end is ignored
    /// because it is older than the summary.
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

    /// Marks the session as ended. `verdict` is the verdict of its summary, if there is one.
    pub(crate) fn end(&mut self, verdict: Option<String>) {
        let ending = self.ending.get_or_insert_default();
        ending.is_gone = true;
        ending.verdict = verdict;
        self.keep_last_values();
        self.is_owner_stopped = false;
    }

    /// Marks the session as ended without a summary; a recoverable recording may be left.
    pub(crate) fn abandon(&mut self, is_recoverable: bool) {
        self.end(None);
        let ending = self.ending.get_or_insert_default();
        ending.is_abandoned = true;
        ending.is_recoverable = is_recoverable;
    }

    /// Returns the active control law.
    #[must_use]
    pub(crate) fn law(&self) -> &str {
        &self.law
    }

    /// Returns the checked scenario.
    #[must_use]
    pub(crate) const fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Returns the step rate.
    #[must_use]
    pub(crate) const fn rate(&self) -> Rate {
        self.plan.run.rate
    }

    /// Returns a step's simulated time in s.
    #[must_use]
    pub(crate) fn seconds(&self, step: u64) -> f64 {
        self.rate().seconds(Step(step))
    }

    /// Returns the newest known step.
    pub(crate) fn step(&self) -> Option<u64> {
        let reported = self.status.as_ref().map(|status| status.step);
        // The last record of a paused run is some steps older.
        if self.is_paused() {
            reported
        } else {
            self.step.or(reported)
        }
    }

    /// Returns the step of the newest record.
    pub(crate) const fn seen(&self) -> Option<u64> {
        self.step
    }

    /// Returns the first observed step, unless it was the first of the run.
    pub(crate) fn joined_late(&self) -> Option<u64> {
        self.joined.filter(|step| *step > 0)
    }

    /// Returns `true` while the plant holds the run.
    pub(crate) fn is_paused(&self) -> bool {
        self.status.as_ref().is_some_and(|status| status.paused)
    }

    /// Returns the end of the run, if it has ended.
    pub(crate) const fn ending(&self) -> Option<&Ending> {
        self.ending.as_ref()
    }

    /// Returns `starting`, `running`, `paused` or `ended`.
    pub(crate) fn state(&self) -> &'static str {
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

    /// Returns the simulated seconds per wall-clock second.
    pub(crate) fn speed(&self, now_ns: u64) -> Option<f64> {
        let steps_per_s = self.pace.steps_per_s(now_ns)?;
        Some(steps_per_s / self.rate().hz())
    }

    /// Returns the speed and the round trips.
    pub(crate) const fn pace(&self) -> &Pace {
        &self.pace
    }

    /// Returns the plots.
    #[must_use]
    pub(crate) fn plots(&self) -> &[Plot] {
        &self.plots
    }

    /// Returns the newest value of a drawn signal; NaN if there is none.
    #[must_use]
    pub(crate) fn value(&self, signal: usize) -> f64 {
        self.trace(signal).map_or(f64::NAN, |trace| trace.value)
    }

    /// Returns the history of a drawn signal.
    pub(crate) fn history(&self, signal: usize) -> Option<&History> {
        self.trace(signal).map(|trace| &trace.history)
    }

    /// Returns the number of observed changes of values and of controllers.
    pub(crate) const fn retunings(&self) -> u64 {
        self.retunings
    }

    /// Returns the columns of the panel's readings; empty for the signals of the plots.
    pub(crate) fn readings(&self) -> &[usize] {
        &self.readings
    }

    /// Returns every drawn signal with its column index.
    pub(crate) fn drawn(&self) -> impl Iterator<Item = (usize, &Column)> + '_ {
        let traces = self.traces.iter();
        traces.map(|trace| (trace.column, &self.columns[trace.column]))
    }

    /// Returns newest value and history of every drawn signal, in the order of [`drawn`](Self::drawn).
    pub(crate) fn histories(&self) -> impl Iterator<Item = (f64, &History)> + '_ {
        self.traces
            .iter()
            .map(|trace| (trace.value, &trace.history))
    }

    fn trace(&self, signal: usize) -> Option<&Trace> {
        self.traces.iter().find(|trace| trace.column == signal)
    }

    /// Returns the name and newest value of every drawn signal.
    pub(crate) fn values(&self) -> impl Iterator<Item = (String, f64)> + '_ {
        let named = |trace: &Trace| (self.columns[trace.column].name.clone(), trace.value);
        self.traces.iter().map(named)
    }

    /// Returns the faults of the run.
    #[must_use]
    pub(crate) fn faults(&self) -> &[FaultState] {
        &self.faults
    }

    /// Returns the state of the requirements.
    #[must_use]
    pub(crate) const fn judged(&self) -> &Judged {
        &self.judged
    }

    /// Appends the recorder's account after its first `known` events; ignores it if others were received meanwhile.
    pub(crate) fn hear_account(&mut self, known: usize, account: Vec<Happening>) {
        if known == self.log.known() {
            self.log.hear(account);
        }
    }

    /// Replaces the log by the account of the whole run.
    pub(crate) fn hear_whole_account(&mut self, mut account: Vec<Happening>) {
        let known = self.log.known().min(account.len());
        self.log.hear(account.split_off(known));
    }

    /// Returns `true` if the stream was observed from the beginning of the run without a loss.
    pub(crate) const fn has_seen_all(&self) -> bool {
        self.lost == 0 && matches!(self.joined, Some(0))
    }

    /// Returns the event log.
    pub(crate) const fn log(&self) -> &Log {
        &self.log
    }

    /// Returns the latest event.
    #[must_use]
    pub(crate) fn note(&self) -> Option<&str> {
        self.note.as_deref()
    }
}

#[cfg(test)]
pub(crate) mod tests;
