//! A controller in C as a [`LawKind`].

use controller_process::controller::{self, Law, LawKind, Row, Transition, TunedRows};
use shared_types::describe::{Invalid, LawDescription};
use shared_types::failure::Failure;
use shared_types::quality;
use shared_types::state::State;

use crate::crash::calling;

use super::interface::{Answer, AnswerWithQuality, Controller, Quality, RetuneLaw, Sample, Setup};
use super::memory::{Memory, Naming, Saving};
use super::plant::take_bytes;
use super::reason::outcome;
use super::tables::{check_form, naming, parameters, required, saving, signals, text};
use crate::float_modes;

/// Functions of a controller, and the lengths of its rows.
#[derive(Clone, Copy, Debug)]
struct Calls {
    step: Step,
    retune: Option<RetuneLaw>,
    saving: Option<Saving>,
    naming: Option<Naming>,
    measured: usize,
    reference: usize,
    commands: usize,
    internals: usize,
    /// Lengths of the rows of parameters and model parameters.
    setup: (usize, usize),
}

/// Callback that answers a sample.
#[derive(Clone, Copy, Debug)]
enum Step {
    Plain(Answer),
    WithQuality(AnswerWithQuality),
}

/// Controller instance that has started.
struct InC {
    calls: Calls,
    memory: Memory,
    /// Room for a byte per measured and reference signal, and per command.
    measured_invalid: Vec<u8>,
    reference_invalid: Vec<u8>,
    held: Vec<u8>,
}

/// Builds the law entry of a controller in C.
///
/// # Safety
/// See [`plant::kind`](super::plant::kind).
///
/// # Errors
/// For the first invalid item in the struct.
pub unsafe fn kind(controller: &Controller) -> Result<LawKind, Invalid> {
    check_form(controller.api, controller.size)?;
    let saving = saving(controller.saved_size, controller.save, controller.restore)?;
    // SAFETY: the caller guarantees all texts and tables.
    let state = unsafe { signals(&controller.state, "state")? };
    let naming = naming(
        &state,
        (controller.tell_state, controller.take_state),
        saving,
    )?;
    let made_for = (!controller.plant.is_null()).then_some(controller.plant);
    // SAFETY: the caller guarantees all texts and tables.
    let (description, commands) = unsafe {
        let made_for = made_for.map(|plant| text(plant, "the plant of the controller"));
        let commands = signals(&controller.commands, "commands")?;
        let description = LawDescription {
            name: text(controller.name, "the name of the controller")?,
            summary: text(controller.summary, "the summary of the controller")?,
            plants: made_for.transpose()?.into_iter().collect(),
            parameters: parameters(&controller.parameters, "parameters")?,
            model: parameters(&controller.model, "model")?,
            measured: signals(&controller.measured, "measured")?,
            reference: signals(&controller.reference, "reference")?,
            commands: Some(commands.clone()),
            internals: signals(&controller.internals, "internals")?,
            saves: saving.is_some(),
            state: naming.map(|_| state),
            tuning: match controller.tuning.is_null() {
                true => String::new(),
                false => text(controller.tuning, "`tuning`")?,
            },
        };
        (description, commands)
    };
    check_tuning(&description, controller.retune)?;
    let start = required(controller.start, "start")?;
    let calls = Calls {
        step: match controller.answer {
            Some(answer) => Step::WithQuality(answer),
            None => Step::Plain(required(controller.step, "step")?),
        },
        retune: controller.retune,
        saving,
        naming,
        measured: description.measured.len(),
        reference: description.reference.len(),
        commands: commands.len(),
        internals: description.internals.len(),
        setup: (description.parameters.len(), description.model.len()),
    };
    let (size, end) = (controller.size, controller.end);
    LawKind::from_tables(description, move |rows| {
        assert_eq!((rows.parameters.len(), rows.model.len()), calls.setup);
        let setup = Setup {
            parameters: rows.parameters.as_ptr(),
            model: rows.model.as_ptr(),
            period_s: rows.period_s,
        };
        let mut memory = Memory::new(size);
        let _call = calling(&"start");
        // SAFETY: `start` receives memory of the size that it requested, and rows as long as their tables.
        let status = unsafe { start(memory.change(), &setup) };
        outcome("start", status).map_err(|failure| Invalid(failure.to_string()))?;
        memory.end = end;
        Ok(Box::new(InC {
            calls,
            memory,
            measured_invalid: vec![0; calls.measured],
            reference_invalid: vec![0; calls.reference],
            held: vec![0; calls.commands],
        }))
    })
}

/// Checks that a controller with tunable parameters declares how it applies them.
fn check_tuning(law: &LawDescription, retune: Option<RetuneLaw>) -> Result<(), Invalid> {
    let Some(first) = law.parameters.iter().find(|field| field.tunable) else {
        return Ok(());
    };
    if retune.is_none() || law.tuning.is_empty() {
        return Err(Invalid(format!(
            "`{}` is HIL_TUNABLE: that needs `retune` and `tuning`",
            first.name
        )));
    }
    Ok(())
}

/// Sets the bytes of the signals in a set to 1, and the others to 0.
fn put_bytes(set: &quality::SignalSet, bytes: &mut [u8]) {
    for (index, byte) in bytes.iter_mut().enumerate() {
        *byte = set.contains(index).into();
    }
}

impl Law for InC {
    fn step(
        &mut self,
        row: &Row<'_>,
        command: &mut [f64],
        internals: &mut [f64],
    ) -> Result<(), Failure> {
        let none = quality::SignalSet::EMPTY;
        let mut held = none;
        let quality = quality::Quality {
            measured: &none,
            reference: &none,
            age_steps: &vec![0; self.calls.measured],
        };
        let answer = controller::Answer {
            command,
            internals,
            held: &mut held,
        };
        Law::answer(self, row, &quality, answer)
    }

    fn answer(
        &mut self,
        row: &Row<'_>,
        quality: &quality::Quality<'_>,
        answer: controller::Answer<'_>,
    ) -> Result<(), Failure> {
        let controller::Answer {
            command,
            internals,
            held,
        } = answer;
        let calls = &self.calls;
        let sizes = (row.measured.len(), row.reference.len());
        assert_eq!(sizes, (calls.measured, calls.reference));
        let output_sizes = (command.len(), internals.len());
        assert_eq!(output_sizes, (calls.commands, calls.internals));
        command.fill(f64::NAN);
        internals.fill(f64::NAN);
        let sample = Sample {
            time_s: row.time_s,
            measured: row.measured.as_ptr(),
            reference: row.reference.as_ptr(),
            valid: row.valid.into(),
            held_steps: row.held_steps,
        };
        let (command, internals) = (command.as_mut_ptr(), internals.as_mut_ptr());
        match calls.step {
            Step::Plain(step) => {
                let _call = calling(&"step");
                // SAFETY: the callback belongs to this started memory, and all rows are as long as their tables.
                let status = unsafe { step(self.memory.change(), &sample, command, internals) };
                outcome("step", status)
            }
            Step::WithQuality(answer) => {
                assert_eq!(quality.age_steps.len(), calls.measured);
                put_bytes(quality.measured, &mut self.measured_invalid);
                put_bytes(quality.reference, &mut self.reference_invalid);
                let quality = Quality {
                    measured_invalid: self.measured_invalid.as_ptr(),
                    reference_invalid: self.reference_invalid.as_ptr(),
                    age_steps: quality.age_steps.as_ptr(),
                };
                let bytes = self.held.as_mut_ptr();
                let memory = self.memory.change();
                let _call = calling(&"answer");
                // SAFETY: as above, and there is a byte or an age for each signal of the rows.
                let status =
                    unsafe { answer(memory, &sample, &quality, command, internals, bytes) };
                take_bytes(&mut self.held, held);
                outcome("answer", status)
            }
        }
    }

    fn retune(&mut self, rows: &TunedRows<'_>, transition: Transition) {
        assert_eq!((rows.parameters.len(), rows.model.len()), self.calls.setup);
        let Some(retune) = self.calls.retune else {
            return;
        };
        let setup = Setup {
            parameters: rows.parameters.as_ptr(),
            model: rows.model.as_ptr(),
            period_s: rows.period_s,
        };
        let jumps = transition == Transition::Step;
        let _call = calling(&"retune");
        // SAFETY: the callback belongs to this started memory, and the rows are as long as their tables.
        unsafe { retune(self.memory.change(), &setup, jumps.into()) }
        float_modes::settle("retune");
    }

    fn save(&self) -> Result<State, Invalid> {
        self.memory.save(self.calls.saving)
    }

    fn restore(&mut self, state: &State) -> Result<(), Invalid> {
        self.memory.restore(self.calls.saving, state)
    }

    fn numbers(&self) -> Result<Vec<f64>, Invalid> {
        self.memory.numbers(self.calls.naming)
    }

    fn set_numbers(&mut self, numbers: &[f64]) -> Result<(), Invalid> {
        self.memory.set_numbers(self.calls.naming, numbers)
    }
}
