//! The point: a scenario run up to a time, with its checkpoint and the signals of that step. Changes nothing of what
//! runs.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use hil_config::plan::{Clock, Plan, Realtime};
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_facts::arguments::run::LinkKind;
use hil_facts::programs::binaries::Binaries;
use hil_recording::reader::RunReader;
use hil_recording::schema::column_name;
use hil_run::settings::Settings;
use hil_run::{Environment, Origin};
use shared_types::describe::{self, LawDescription};
use shared_types::number::{exact, exact_in};
use shared_types::record::{Event, FaultBegun};
use shared_types::table::Field;
use shared_types::time::Step;

/// Point of a scenario.
pub(crate) struct Point {
    /// Scenario.
    pub(crate) plan: Plan,
    /// Programs.
    pub(crate) binaries: Arc<Binaries>,
    /// Step of the point.
    pub(crate) step: Step,
    /// Checkpoint before the step; none at step 0.
    pub(crate) checkpoint: Option<PathBuf>,
    /// Effects of faults that began before the step.
    pub(crate) begun: Vec<FaultBegun>,
    /// Names and values of the step's record.
    signals: Vec<(String, f64)>,
}

/// Signals of a step's record, and the effects of faults that began before.
type Recorded = (Vec<(String, f64)>, Vec<FaultBegun>);

impl Point {
    /// Runs a scenario into the folder `out`, up to a step. With `whole` the run goes on to its end.
    ///
    /// # Errors
    /// If the time is not in the run, a side cannot save its state, or the run ends before.
    pub(crate) fn reach(
        mut plan: Plan,
        binaries: &Arc<Binaries>,
        (at_s, out, whole): (f64, &Path, bool),
        interruption: &Interruption,
    ) -> Result<Self, Failure> {
        let rate = plan.run.rate;
        let step = rate.step_at_or_after(at_s);
        if !(at_s >= 0.0 && step.0 < plan.run.steps) {
            let last = Step(plan.run.steps.saturating_sub(1));
            return Err(Failure::usage(format!(
                "--at {} is not in the run, whose last step is at {}",
                exact(at_s),
                exact_in(rate.seconds(last), "s")
            )));
        }
        plan.run.clock = Clock::Lockstep;
        plan.realtime = Realtime::default();
        let mut run = plan.clone();
        if !whole {
            run.run.steps = step.0 + 1;
            // Their windows may be beyond the point, and nothing is judged here.
            run.metrics.clear();
            run.analyses.clear();
            run.requirements.clear();
        }
        let named = [&binaries.plant, &binaries.controller].map(|binary| binary.named());
        let link = match named {
            [None, None] => LinkKind::InProcess,
            _ => LinkKind::Iceoryx2,
        };
        let mut settings = Settings::with_recording(link, Some(out.to_owned()));
        settings.is_one_of_many = true;
        settings.checkpoints_at_s = match step.0 {
            0 => Vec::new(),
            _ => vec![rate.seconds(step)],
        };
        let environment = Environment::new(&settings, Arc::clone(binaries), interruption)?;
        let result = hil_run::execute(run, environment, Origin::Scenario)?;
        if matches!(result.exit, Exit::Infrastructure | Exit::Interrupted) {
            return Err(match result.exit {
                Exit::Interrupted => Failure::Interrupted,
                _ => Failure::infrastructure(result.table.trim_end()),
            });
        }
        let (signals, begun) = record(out, step)?.ok_or_else(|| {
            let at = exact_in(rate.seconds(step), "s");
            Failure::Differ(format!(
                "the run ends before {at}:\n{}",
                result.table.trim_end()
            ))
        })?;
        Ok(Self {
            plan,
            binaries: Arc::clone(binaries),
            step,
            checkpoint: (step.0 > 0).then(|| out.join(format!("checkpoint-{step}"))),
            begun,
            signals,
        })
    }

    /// Returns a recorded value of the step.
    pub(crate) fn recorded(&self, group: &str, name: &str) -> Option<f64> {
        let name = column_name(group, name);
        let signal = self.signals.iter().find(|(own, _)| *own == name);
        signal.map(|(_, value)| *value)
    }

    /// Returns the inputs of the plant at the step: applied commands, driven inputs and constants.
    pub(crate) fn plant_inputs(&self, commands: &[Field]) -> Result<describe::Settings, Failure> {
        let value = |field: &Field| {
            let name = &field.name;
            (self.recorded("applied", name))
                .or_else(|| self.recorded("input", name))
                .or_else(|| self.plan.plant.inputs.get(name))
        };
        all(commands, value)
    }

    /// Returns the sample of the law at the step, each signal named with its group.
    pub(crate) fn sample(&self, law: &LawDescription) -> Result<describe::Settings, Failure> {
        let mut sample = describe::Settings::default();
        for (group, fields) in [("measured", &law.measured), ("reference", &law.reference)] {
            let values = all(fields, |field| self.recorded(group, &field.name))?;
            for (name, value) in values.0 {
                sample.0.insert(format!("{group}.{name}"), value);
            }
        }
        Ok(sample)
    }

    /// Returns the time of the point in s.
    pub(crate) fn time_s(&self) -> f64 {
        self.plan.run.rate.seconds(self.step)
    }
}

fn all(
    fields: &[Field],
    value: impl Fn(&Field) -> Option<f64>,
) -> Result<describe::Settings, Failure> {
    let mut settings = describe::Settings::default();
    for field in fields {
        let value = value(field)
            .filter(|value| value.is_finite())
            .ok_or_else(|| {
                Failure::Differ(format!("`{}` has no value at this point", field.name))
            })?;
        settings.set(&field.name, value);
    }
    Ok(settings)
}

/// Reads a step's record; `None` if the run ended before it.
fn record(run: &Path, step: Step) -> Result<Option<Recorded>, Failure> {
    let mut reader = RunReader::open(run)
        .map_err(Failure::infrastructure)?
        .without_digest();
    let mut begun = Vec::new();
    while reader.advance().map_err(Failure::infrastructure)? {
        for event in reader.events() {
            if let Event::Fault(one) = event
                && one.step < step.0
            {
                begun.push(one.clone());
            }
        }
        if reader.step() == step.0 {
            let columns = reader.columns().iter().zip(reader.words());
            let signals = columns.filter(|(column, _)| column.is_signal());
            let signals =
                signals.map(|(column, word)| (column.name.clone(), f64::from_bits(*word)));
            return Ok(Some((signals.collect(), begun)));
        }
    }
    Ok(None)
}
