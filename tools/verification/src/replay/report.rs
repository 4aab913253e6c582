//! The report of a replay, as text and as JSON.

use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter, Write as _};

use hil_console::terminal::exit::Exit;
use hil_console::terminal::output;
use hil_console::terminal::table::{Table, left, right};
use hil_facts::programs::binaries::Binary;
use serde::Serialize;
use serde_json::Value;
use shared_types::number::{counted, exact_in, short};
use shared_types::time::Step;

use super::comparison::{Comparison, Mismatch, NearbySample};
use super::original::Original;
use super::tape::Length;
use crate::compare::{SignalDifference, Verdict, number, write_table};

/// Result of a replay.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    verdict: Verdict,
    run: String,
    law: String,
    controller: Controller,
    /// Number of answers that were compared.
    steps: u64,
    /// Number of samples whose answer was not recorded: unseen by the run's controller, or superseded by the next
    /// sample.
    unanswered_steps: u64,
    /// Set if the recording extends to the end of the run.
    whole: bool,
    /// Planned number of steps of the run.
    planned_steps: u64,
    sim_time_s: f64,
    wall_time_s: f64,
    realtime_factor: f64,
    compared: Vec<String>,
    only_in_recording: Vec<String>,
    only_in_controller: Vec<String>,
    /// First difference beyond the tolerances; null if there is none.
    first_difference: Option<FirstDifference>,
    /// Signals that differ at some step.
    signals: Vec<Difference>,
    #[serde(skip)]
    table: String,
}

#[derive(Debug, Serialize)]
struct Controller {
    binary: String,
    blake3: String,
    /// Set if the binary is the one of the run; null if the recording does not contain its hash.
    of_the_run: Option<bool>,
}

#[derive(Debug, Serialize)]
struct FirstDifference {
    step: u64,
    time_s: f64,
    signal: String,
    unit: String,
    recorded: Value,
    replayed: Value,
    difference: Value,
    /// Validity of the signal in the recording and in the replay, if the validity differs.
    #[serde(skip_serializing_if = "Option::is_none")]
    validity: Option<[bool; 2]>,
    /// Names of other signals that differ at that step.
    also: Vec<String>,
    samples_around: Vec<Sample>,
}

#[derive(Debug, Serialize)]
struct Sample {
    step: u64,
    time_s: f64,
    recorded: Option<Value>,
    replayed: Value,
    /// Values that the controller received, by signal name.
    sample: BTreeMap<String, Value>,
}

#[derive(Debug, Serialize)]
struct Difference {
    #[serde(flatten)]
    signal: SignalDifference,
    /// Number of steps at which exactly one of the values is valid.
    validity_steps: u64,
}

impl Report {
    pub(super) fn new(
        original: &Original,
        controller: &Binary,
        length: &Length,
        wall_time_s: f64,
        comparison: &Comparison,
    ) -> Self {
        let sample = original.sample_names();
        let around = comparison.around();
        let sim_time_s = original.plan.run.rate.seconds(Step(length.steps));
        let verdict = match comparison.first() {
            Some(_) => Verdict::Different,
            None if comparison.is_same() => Verdict::Same,
            None => Verdict::WithinTolerance,
        };
        let differences = comparison.differences().into_iter();
        Self {
            verdict,
            run: original.run.display().to_string(),
            law: original.plan.controller.law.clone(),
            controller: Controller {
                binary: controller.path.display().to_string(),
                blake3: controller.blake3.clone(),
                of_the_run: original
                    .blake3
                    .as_ref()
                    .map(|hash| *hash == controller.blake3),
            },
            steps: comparison.answers,
            unanswered_steps: comparison.unanswered,
            whole: length.is_whole,
            planned_steps: original.plan.run.steps,
            sim_time_s,
            wall_time_s,
            realtime_factor: if wall_time_s > 0.0 {
                sim_time_s / wall_time_s
            } else {
                0.0
            },
            compared: comparison.names().map(str::to_owned).collect(),
            only_in_recording: comparison.only_recorded.clone(),
            only_in_controller: comparison.only_replayed.clone(),
            table: comparison.first().map_or_else(String::new, |first| {
                output::text(|text| write_around(text, first, &around, &sample))
            }),
            first_difference: comparison
                .first()
                .map(|first| FirstDifference::of(first, &around, &sample)),
            signals: differences
                .map(|(signal, validity_steps)| Difference {
                    signal,
                    validity_steps,
                })
                .collect(),
        }
    }

    pub(super) const fn exit(&self) -> Exit {
        match self.verdict {
            Verdict::Same | Verdict::WithinTolerance => Exit::Pass,
            Verdict::Different => Exit::Failed,
        }
    }

    /// Formats the report for a person.
    pub(super) fn describe(&self) -> String {
        output::text(|text| self.write(text))
    }

    fn write(&self, text: &mut String) -> fmt::Result {
        let steps = self.steps;
        match self.verdict {
            Verdict::Same => writeln!(text, "same: {steps} answers, bit by bit")?,
            Verdict::WithinTolerance => writeln!(text, "within the tolerance: {steps} answers")?,
            Verdict::Different => writeln!(text, "different: {steps} answers compared")?,
        }
        let Controller {
            binary, of_the_run, ..
        } = &self.controller;
        let which = match of_the_run {
            Some(true) => ", the binary of the run",
            Some(false) => ", not the binary of the run",
            None => "",
        };
        writeln!(text, "  {} of {}: {binary}{which}", self.law, self.run)?;
        writeln!(
            text,
            "  {} s in {:.2} s, {:.1}x real time; compared: {}",
            self.sim_time_s,
            self.wall_time_s,
            self.realtime_factor,
            listed(&self.compared)
        )?;
        if self.unanswered_steps > 0 {
            writeln!(
                text,
                "  {} samples have no recorded answer: not seen by the run's controller, or superseded by the next sample",
                self.unanswered_steps
            )?;
        }
        if !self.whole {
            writeln!(
                text,
                "  the recording was cut off and is replayed as far as possible; complete it with `hil recover {}`",
                self.run
            )?;
        } else if self.steps + self.unanswered_steps < self.planned_steps {
            writeln!(
                text,
                "  the run ended before its {} steps, and so did the replay",
                self.planned_steps
            )?;
        }
        for (whose, only) in [
            ("recording", &self.only_in_recording),
            ("controller", &self.only_in_controller),
        ] {
            if !only.is_empty() {
                writeln!(text, "  only in the {whose}: {}", only.join(", "))?;
            }
        }
        text.push_str(&self.table);
        if self.signals.is_empty() {
            return Ok(());
        }
        let signals: Vec<SignalDifference> = (self.signals.iter())
            .map(|difference| difference.signal.clone())
            .collect();
        write_table(text, &signals, "max |diff|")?;
        for Difference {
            signal,
            validity_steps,
        } in &self.signals
        {
            if *validity_steps > 0 {
                writeln!(
                    text,
                    "  {} is valid in only one of both at {validity_steps} steps",
                    signal.name
                )?;
            }
        }
        Ok(())
    }
}

fn listed(names: &[String]) -> String {
    let commands = names.iter().filter(|name| name.starts_with("command."));
    let commands = commands.count();
    let internals = (names.len() - commands) as u64;
    let (commands, internals) = (
        counted(commands as u64, "command"),
        counted(internals, "internal"),
    );
    format!("{commands}, {internals}")
}

/// Writes the samples around a difference as a table: a line for each signal, a column for each step.
fn write_around(
    text: &mut String,
    first: &Mismatch,
    around: &[NearbySample],
    sample: &[String],
) -> fmt::Result {
    writeln!(text, "  {first}")?;
    if !first.also.is_empty() {
        writeln!(text, "  at the same step also: {}", first.also.join(", "))?;
    }
    let mut columns = vec![right(13); 1 + around.len()];
    columns[0] = left(0);
    let mut table = Table::new(2, columns);
    let mut line = |name: &str, value: &dyn Fn(&NearbySample) -> Option<String>| {
        let values = around
            .iter()
            .map(|near| value(near).unwrap_or_else(|| "-".into()));
        table.cells([name.to_owned()].into_iter().chain(values));
    };
    line("step", &|near| {
        let mark = if near.step == first.step { ">" } else { "" };
        Some(format!("{mark}{}", near.step))
    });
    let name = &first.signal;
    line(&format!("{name} recorded"), &|near| {
        near.recorded.map(short)
    });
    line(&format!("{name} replayed"), &|near| {
        Some(short(near.replayed))
    });
    line("difference", &|near| {
        near.recorded.map(|was| short(near.replayed - was))
    });
    for (index, name) in sample.iter().enumerate() {
        line(name, &|near| Some(short(near.sample[index])));
    }
    write!(text, "\n{table}")
}

impl Original {
    fn sample_names(&self) -> Vec<String> {
        let measured = self.plant.measured.iter().map(|field| ("measured", field));
        let reference = self.reference.iter().map(|field| ("reference", field));
        (measured.chain(reference))
            .map(|(group, field)| format!("{group}.{}", field.name))
            .collect()
    }
}

impl FirstDifference {
    fn of(first: &Mismatch, around: &[NearbySample], names: &[String]) -> Self {
        let samples = around.iter().map(|near| Sample {
            step: near.step,
            time_s: near.time_s,
            recorded: near.recorded.map(number),
            replayed: number(near.replayed),
            sample: (names.iter().cloned())
                .zip(near.sample.iter().map(|value| number(*value)))
                .collect(),
        });
        Self {
            step: first.step,
            time_s: first.time_s,
            signal: first.signal.clone(),
            unit: first.unit.clone(),
            recorded: number(first.recorded),
            replayed: number(first.replayed),
            difference: number(first.replayed - first.recorded),
            validity: first.validity,
            also: first.also.clone(),
            samples_around: samples.collect(),
        }
    }
}

impl Display for Mismatch {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self {
            step,
            time_s,
            signal,
            unit,
            recorded,
            replayed,
            validity,
            ..
        } = self;
        write!(f, "first difference at step {step} ({time_s} s): ")?;
        match validity {
            Some([was, is]) => {
                let name_of = |valid: &bool| if *valid { "valid" } else { "invalid" };
                write!(f, "{signal} was {} and is {}", name_of(was), name_of(is))
            }
            None => write!(
                f,
                "{signal} was {} and is {}, a difference of {}",
                exact_in(*recorded, unit),
                exact_in(*replayed, unit),
                exact_in(replayed - recorded, unit)
            ),
        }
    }
}
