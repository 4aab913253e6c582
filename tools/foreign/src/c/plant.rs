//! A plant in C as a [`PlantKind`].

use plant_process::plant::{Model, PlantKind};
use shared_types::describe::{Invalid, PlantDescription};
use shared_types::failure::Failure;
use shared_types::quality::SignalSet;
use shared_types::state::State;
use shared_types::time;

use crate::crash::calling;

use super::interface::{Advance, Interval, Plant, Read, TakeRow, WriteRow, WriteTruth};
use super::memory::{Memory, Naming, Saving};
use super::reason::outcome;
use super::tables::{check_form, naming, parameters, required, saving, signals, starts, text};

/// Functions of a plant, and the lengths of its rows.
#[derive(Clone, Copy, Debug)]
struct Calls {
    retune: Option<TakeRow>,
    measure: Measure,
    tell_truth: WriteTruth,
    advance: Advance,
    saving: Option<Saving>,
    naming: Option<Naming>,
    parameters: usize,
    measured: usize,
    truth: usize,
    commands: usize,
}

/// Callback that gives the readings.
#[derive(Clone, Copy, Debug)]
enum Measure {
    Values(WriteRow),
    WithValidity(Read),
}

/// Plant instance that has started.
struct InC {
    calls: Calls,
    memory: Memory,
    /// Room for a byte per measured signal, all zero between two calls.
    invalid: Vec<u8>,
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
    let state = unsafe { signals(&plant.state, "state")? };
    let naming = naming(&state, (plant.tell_state, plant.take_state), saving)?;
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
            port: None,
            state: naming.map(|_| state),
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
        measure: match plant.read {
            Some(read) => Measure::WithValidity(read),
            None => Measure::Values(required(plant.measure, "measure")?),
        },
        tell_truth: required(plant.tell_truth, "tell_truth")?,
        advance: required(plant.advance, "advance")?,
        saving,
        naming,
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
        Ok(Box::new(InC {
            calls,
            memory,
            invalid: vec![0; calls.measured],
        }))
    })
}

/// Adds the signals whose byte is not 0 to a set, and clears the bytes.
pub(super) fn take_bytes(bytes: &mut [u8], set: &mut SignalSet) {
    for (index, byte) in bytes.iter_mut().enumerate() {
        if std::mem::take(byte) != 0 {
            set.insert(index);
        }
    }
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
        Model::read(self, measured, &mut SignalSet::default())
    }

    fn read(&mut self, measured: &mut [f64], invalid: &mut SignalSet) -> Result<(), Failure> {
        assert_eq!(measured.len(), self.calls.measured);
        measured.fill(f64::NAN);
        let row = measured.as_mut_ptr();
        match self.calls.measure {
            Measure::Values(measure) => {
                let _call = calling(&"measure");
                // SAFETY: the callback belongs to this started memory, and the row is as long as its table.
                let status = unsafe { measure(self.memory.read(), row) };
                outcome("measure", status)
            }
            Measure::WithValidity(read) => {
                let _call = calling(&"read");
                let bytes = self.invalid.as_mut_ptr();
                // SAFETY: as above, and there is a byte for each signal of the row.
                let status = unsafe { read(self.memory.read(), row, bytes) };
                take_bytes(&mut self.invalid, invalid);
                outcome("read", status)
            }
        }
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

    fn numbers(&self) -> Result<Vec<f64>, Invalid> {
        self.memory.numbers(self.calls.naming)
    }

    fn set_numbers(&mut self, numbers: &[f64]) -> Result<(), Invalid> {
        self.memory.set_numbers(self.calls.naming, numbers)
    }
}
