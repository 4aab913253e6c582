//! A plant in C as a [`PlantKind`].

use plant_process::plant::{Model, PlantKind};
use shared_types::describe::{Invalid, PlantDescription};
use shared_types::failure::Failure;
use shared_types::state::State;
use shared_types::time;

use crate::crash::calling;

use super::interface::{Advance, Interval, Plant, TakeRow, WriteRow, WriteTruth};
use super::memory::{Memory, Saving};
use super::reason::outcome;
use super::tables::{check_form, parameters, required, saving, signals, starts, text};

/// Functions of a plant, and the lengths of its rows.
#[derive(Clone, Copy, Debug)]
struct Calls {
    retune: Option<TakeRow>,
    measure: WriteRow,
    tell_truth: WriteTruth,
    advance: Advance,
    saving: Option<Saving>,
    parameters: usize,
    measured: usize,
    truth: usize,
    commands: usize,
}

/// Plant instance that has started.
struct InC {
    calls: Calls,
    memory: Memory,
}

/// Builds the plant entry of a plant in C.
///
/// # Safety
/// The struct must be valid as defined by `hil.h`: its tables have the declared number of rows, each text is null or
/// zero-terminated, and its callbacks have the declared types, write no more than the given rows and `size` bytes of
/// `self`, and may be called as long as the program runs.
///
/// # Errors
/// For the first invalid item in the struct.
pub unsafe fn kind(plant: &Plant) -> Result<PlantKind, Invalid> {
    check_form(plant.api, plant.size)?;
    let saving = saving(plant.saved_size, plant.save, plant.restore)?;
    // SAFETY: the caller guarantees all texts and tables.
    let description = unsafe {
        PlantDescription {
            name: text(plant.name, "the name of the plant")?,
            summary: text(plant.summary, "the summary of the plant")?,
            parameters: parameters(&plant.parameters, "parameters")?,
            truth: signals(&plant.truth, "truth")?,
            measured: signals(&plant.measured, "measured")?,
            commands: starts(signals(&plant.commands, "commands")?, plant.start_commands),
            faults: Vec::new(),
            saves: saving.is_some(),
        }
    };
    let start = required(plant.start, "start")?;
    if let (None, [first, ..]) = (plant.retune, &description.parameters[..]) {
        return Err(Invalid(format!(
            "the callback `retune` is missing, which applies `{}`",
            first.name
        )));
    }
    let calls = Calls {
        retune: plant.retune,
        measure: required(plant.measure, "measure")?,
        tell_truth: required(plant.tell_truth, "tell_truth")?,
        advance: required(plant.advance, "advance")?,
        saving,
        parameters: description.parameters.len(),
        measured: description.measured.len(),
        truth: description.truth.len(),
        commands: description.commands.len(),
    };
    let (size, end) = (plant.size, plant.end);
    PlantKind::from_tables(description, move |row| {
        assert_eq!(row.len(), calls.parameters);
        let mut memory = Memory::new(size);
        let _call = calling(&"start");
        // SAFETY: `start` receives memory of the size that it requested, and a row as long as its table.
        let status = unsafe { start(memory.change(), row.as_ptr()) };
        outcome("start", status).map_err(|failure| Invalid(failure.to_string()))?;
        memory.end = end;
        Ok(Box::new(InC { calls, memory }))
    })
}

impl Model for InC {
    fn retune(&mut self, parameters: &[f64]) -> Result<(), Failure> {
        assert_eq!(parameters.len(), self.calls.parameters);
        let Some(retune) = self.calls.retune else {
            return Ok(());
        };
        let _call = calling(&"retune");
        // SAFETY: the callback belongs to this started memory, and the row is as long as its table.
        let status = unsafe { retune(self.memory.change(), parameters.as_ptr()) };
        outcome("retune", status)
    }

    fn measure(&mut self, measured: &mut [f64]) -> Result<(), Failure> {
        assert_eq!(measured.len(), self.calls.measured);
        measured.fill(f64::NAN);
        let _call = calling(&"measure");
        // SAFETY: the callback belongs to this started memory, and the row is as long as its table.
        let status = unsafe { (self.calls.measure)(self.memory.read(), measured.as_mut_ptr()) };
        outcome("measure", status)
    }

    fn truth(&mut self, time_s: f64, command: &[f64], truth: &mut [f64]) -> Result<(), Failure> {
        let lengths = (command.len(), truth.len());
        assert_eq!(lengths, (self.calls.commands, self.calls.truth));
        truth.fill(f64::NAN);
        let (command, truth) = (command.as_ptr(), truth.as_mut_ptr());
        let _call = calling(&"tell_truth");
        // SAFETY: the callback belongs to this started memory, and both rows are as long as their tables.
        let status = unsafe { (self.calls.tell_truth)(self.memory.read(), time_s, command, truth) };
        outcome("tell_truth", status)
    }

    fn advance(&mut self, interval: &time::Interval, command: &[f64]) -> Result<(), Failure> {
        assert_eq!(command.len(), self.calls.commands);
        let interval = Interval {
            start_s: interval.start_s,
            length_s: interval.length_s,
            substeps: interval.substeps,
        };
        let _call = calling(&"advance");
        // SAFETY: the callback belongs to this started memory, and the row is as long as its table.
        let status =
            unsafe { (self.calls.advance)(self.memory.change(), &interval, command.as_ptr()) };
        outcome("advance", status)
    }

    fn save(&self) -> Result<State, Invalid> {
        self.memory.save(self.calls.saving)
    }

    fn restore(&mut self, state: &State) -> Result<(), Invalid> {
        self.memory.restore(self.calls.saving, state)
    }
}
