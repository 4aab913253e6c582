//! Recorded run as shown in a report.
//!
//! Read twice: first for its results, which determine the times of interest; then for its [signals](super::reading) as
//! envelopes over the resulting grid. Neither pass stores records, so memory does not grow with the length of a run.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use hil_config::plan::{self, Plan, Trace};
use hil_console::files::runs::SUMMARY;
use hil_console::terminal::exit::Failure;
use hil_facts::checkpoint;
use hil_facts::results::handover::Laws;
use hil_facts::results::latency::spikes::KEPT;
use hil_facts::results::outcome::RecordedOutcome;
use hil_facts::results::recorded_run::RecordedRun;
use hil_facts::results::requirements::{Requirement, RunVerdict};
use hil_facts::results::summary::{Metric, Missed};
use hil_recording::reader::folder_of;
use serde_json::Value;
use shared_types::time::{Rate, Step};

use super::reading::Reading;

/// Result of a run.
pub(crate) struct Run {
    /// Label that distinguishes the run from the others of the report.
    pub(crate) label: String,
    pub(crate) path: PathBuf,
    pub(crate) outcome: RecordedOutcome,
    /// Run reconstructed from its scenario; `None` if that is invalid.
    recorded_run: Option<RecordedRun>,
    pub(crate) rate: Rate,
    pub(crate) last: Step,
    pub(crate) reason: Option<String>,
    pub(crate) verdict: String,
    pub(crate) requirements: Vec<Requirement>,
    pub(crate) metrics: Vec<Metric>,
    /// Effects of faults in the order in which they became active.
    pub(crate) spans: Vec<Span>,
    /// Control laws that were active.
    pub(crate) laws: Laws,
    /// Control laws, formatted for the user.
    laws_in_words: String,
    /// Warnings at the top of the page.
    pub(crate) notes: Vec<String>,
}

/// Time span in which a fault is active.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Span {
    pub(crate) event: u32,
    pub(crate) kind: String,
    pub(crate) from_s: f64,
    /// End in s; `None` if the fault lasts to the end of the run.
    pub(crate) until_s: Option<f64>,
}

impl Run {
    /// Reads the results of a run, judged by its own scenario or by another.
    ///
    /// # Errors
    /// If the recording cannot be read.
    pub(crate) fn of(path: &Path, by: Option<&Path>) -> Result<Self, Failure> {
        let mut result = RecordedOutcome::of(path, by).map_err(Failure::usage)?;
        if result.recorded.written == 0 {
            let file = result.reader.path().display().to_string();
            return Err(Failure::usage(format!("{file} has no record to show")));
        }
        let rate = result.reader.rate().map_err(Failure::usage)?;
        let mut notes = Vec::new();
        if let Some(damage) = &result.damage {
            notes.push(format!("damaged: {damage}"));
        } else if let Some(torn) = result.reader.caveat() {
            notes.push(torn);
        }
        let broke_off = (!result.has_result() && result.recorded.end.is_none())
            .then_some("the recording breaks off");
        let (outcome, reason) = result.outcome(broke_off);
        let recorded_run = std::mem::replace(&mut result.run, Err(Failure::usage("taken")));
        let recorded_run = match recorded_run {
            Ok(run) => Some(run),
            Err(failure) if by.is_some() => return Err(failure),
            Err(failure) => {
                notes.push(format!(
                    "the scenario of the run is invalid, so nothing is judged or derived: {failure}"
                ));
                None
            }
        };
        let recorded = &result.recorded;
        let mut requirements: Vec<Requirement> = (recorded.requirements.iter())
            .map(Requirement::from)
            .collect();
        let mut verdict = RunVerdict::of(outcome, &requirements).name().to_owned();
        if let Some(content) = result.reader.fact(hil_recording::reader::EXCERPT) {
            let summary = summary_beside(path);
            notes.push(format!(
                "an excerpt: {content}; {}",
                match &summary {
                    Some(_) => "verdict and requirements are those of the original run",
                    None => "requirements need the whole run, so it is not judged",
                }
            ));
            (verdict, requirements) = summary.unwrap_or(("not judged".into(), Vec::new()));
        } else if recorded_run.is_none() {
            verdict = "not judged".into();
        }
        let written = result.reader.result("digest").unwrap_or_default();
        let is_other = (recorded.digest.as_deref())
            .is_some_and(|digest| !written.is_empty() && digest != written);
        if is_other {
            notes.push("the digest of its records differs from the recorded one: some of the data shown is not what was recorded".into());
        }
        if (is_other || result.damage.is_some()) && verdict == "pass" {
            verdict = "not judged".into();
        }
        notes.extend(result.recorded.end.iter().flat_map(Missed::of_end));
        let spans = spans(&result, rate);
        let laws = (recorded_run.as_ref()).map(|run| run.plan.controller.law.as_str());
        let fact = |name: &str| result.reader.fact(name).map(Into::into);
        let laws = laws.map_or_else(Laws::default, |law| Laws::of(law, &recorded.changes, fact));
        Ok(Self {
            label: String::new(),
            path: path.to_owned(),
            rate,
            last: Step(result.reader.step()),
            reason,
            verdict,
            requirements,
            metrics: recorded.metrics.iter().map(Metric::from).collect(),
            spans,
            laws_in_words: laws.describe(rate),
            laws,
            notes,
            recorded_run,
            outcome: result,
        })
    }

    /// Returns the scenario; `None` if it is invalid.
    pub(crate) fn plan(&self) -> Option<&Plan> {
        self.recorded_run.as_ref().map(|run| &run.plan)
    }

    /// Returns the run reconstructed from its scenario; `None` if the scenario is invalid.
    pub(crate) const fn recorded_run(&self) -> Option<&RecordedRun> {
        self.recorded_run.as_ref()
    }

    /// Returns the aliases of the run's signals, each with the recorded name.
    pub(crate) fn aliases(&self) -> Vec<(String, String)> {
        let run = self.recorded_run.as_ref();
        run.map(RecordedRun::aliases).unwrap_or_default()
    }

    /// Returns `true` if the run requested timing, as far as its scenario is valid.
    pub(crate) fn asks_for_timing(&self) -> bool {
        self.plan().is_none_or(Plan::asks_for_timing)
    }

    /// Returns a fact recorded before the run.
    pub(crate) fn fact(&self, name: &str) -> &str {
        self.outcome.reader.fact(name).unwrap_or_default()
    }

    /// Names the law, or all laws with their start times; empty if the scenario is invalid.
    pub(crate) fn law(&self) -> &str {
        &self.laws_in_words
    }

    /// Returns the end of the run in s.
    pub(crate) fn end_s(&self) -> f64 {
        self.rate.seconds(self.last)
    }

    /// Returns the times of interest in ns, the most interesting first.
    pub(crate) fn times_ns(&self) -> Vec<u64> {
        let ns = |s: f64| (s * 1e9) as u64;
        let spans = self.spans.iter();
        let faults = spans.flat_map(|span| std::iter::once(span.from_s).chain(span.until_s));
        let changes = self
            .outcome
            .recorded
            .changes
            .iter()
            .map(|change| change.step);
        let values = self.outcome.recorded.values.iter().map(|one| one.step);
        let marks = self.outcome.recorded.marks.iter().map(|mark| mark.step);
        let spikes = self.outcome.recorded.latency.spikes.iter();
        let steps = changes
            .chain(values.take(KEPT))
            .chain(marks.take(KEPT))
            .chain(spikes.take(KEPT / 3).map(|spike| spike.step));
        let margins = self.requirements.iter().filter_map(|one| one.at_s);
        let times = faults.chain(margins).map(ns);
        times
            .chain(steps.map(|step| self.rate.nanoseconds(Step(step))))
            .collect()
    }

    /// Returns the command line that reaches a time again from the nearest checkpoint; `None` if no checkpoint can.
    pub(crate) fn branch_at(&self, at_s: f64) -> Option<String> {
        let step = self.rate.step_at_or_after(at_s);
        let recorded = &self.outcome.recorded;
        let (folder, log) = (folder_of(&self.path), &recorded.faults);
        let (_, from) = checkpoint::nearest(folder, step, log, &recorded.values)?;
        // No run is held at its end.
        let is_before_end = self.plan().is_some_and(|plan| step.0 < plan.run.steps);
        is_before_end.then(|| checkpoint::command_line(&from, step, self.rate))
    }

    /// Prepares the reading of the run's signals.
    pub(crate) fn reading<'a>(&'a self, extra: &'a [plan::Derived]) -> Reading<'a> {
        let is_sound = self.outcome.damage.is_none() && self.outcome.reader.is_whole();
        Reading {
            path: &self.path,
            rate: self.rate,
            last: self.last,
            run: self.recorded_run.as_ref(),
            extra,
            records: is_sound.then_some(self.outcome.recorded.written),
        }
    }
}

/// Returns the spans in which faults were active: one for each event, from its first effect to the end of its last.
fn spans(outcome: &RecordedOutcome, rate: Rate) -> Vec<Span> {
    let faults = &outcome.recorded.faults;
    let mut ends: BTreeMap<(u32, u32), u64> = BTreeMap::new();
    for ended in &faults.ended {
        ends.insert((ended.id, ended.effect), ended.step);
    }
    let mut events: BTreeMap<u32, (String, u64, Option<u64>)> = BTreeMap::new();
    for begun in &faults.begun {
        let until = ends.get(&(begun.id, begun.effect)).copied();
        events
            .entry(begun.id)
            .and_modify(|(_, from, to)| {
                *from = begun.step.min(*from);
                // One effect without an end keeps the span open.
                *to = to.zip(until).map(|(a, b)| a.max(b));
            })
            .or_insert((begun.kind.clone(), begun.step, until));
    }
    let seconds = |step| rate.seconds(Step(step));
    let mut spans: Vec<Span> = (events.into_iter())
        .map(|(event, (kind, from, until))| Span {
            event,
            kind,
            from_s: seconds(from),
            until_s: until.map(seconds),
        })
        .collect();
    spans.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
    spans
}

/// Returns elements in order, keeping the first of equal elements.
pub(crate) fn distinct<T>(
    all: impl Iterator<Item = T>,
    are_same: impl Fn(&T, &T) -> bool,
) -> Vec<T> {
    let mut unique: Vec<T> = Vec::new();
    for one in all {
        if !unique.iter().any(|other| are_same(other, &one)) {
            unique.push(one);
        }
    }
    unique
}

/// Returns verdict and requirements of the `summary.json` next to a recording.
fn summary_beside(run: &Path) -> Option<(String, Vec<Requirement>)> {
    let folder = if run.is_dir() { run } else { run.parent()? };
    let text = std::fs::read_to_string(folder.join(SUMMARY)).ok()?;
    let summary: Value = serde_json::from_str(&text).ok()?;
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let requirements = summary["requirements"]
        .as_array()?
        .iter()
        .map(|one| Requirement {
            name: text(&one["name"]),
            formula: text(&one["formula"]),
            verdict: match one["verdict"].as_str() {
                Some("pass") => "pass",
                Some("fail") => "fail",
                _ => "undecided",
            },
            robustness: one["robustness"].as_f64(),
            unit: text(&one["unit"]),
            at_s: one["at_s"].as_f64(),
            decided_at_s: one["decided_at_s"].as_f64(),
            vacuous: one["vacuous"].as_str().map(Into::into),
            trace: Trace::default(),
        });
    Some((text(&summary["verdict"]), requirements.collect()))
}
