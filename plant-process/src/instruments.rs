//! Instruments: sensors between the model and its faults, actuators between the command and the model.
//!
//! Called by the engine at every step. An instrument is a chain of the same stages as [faults](crate::faults), at full
//! size from the first step on. A run without instruments has empty lists, and does nothing here.

use hil_config::plan::{Instrument, Stage, taps_of};
use shared_types::describe::{Invalid, PlantDescription};
use shared_types::quality::SignalSet;
use shared_types::random::RandomStream;
use shared_types::state::State;
use shared_types::table::Field;
use shared_types::time::{Rate, Step};

use crate::faults::kind::{AnySetup, Fault, FaultKindEntry, Moment, Reading};
use crate::faults::kinds;
use crate::job::Job;

mod figures;

pub use figures::Figures;

/// The instruments of a run.
pub(crate) struct Instruments {
    rate: Rate,
    sensors: Vec<Chain>,
    actuators: Vec<Chain>,
    /// Buffer for the row at the input of all stages of one kind of instrument.
    row: Vec<f64>,
}

/// Instrument of one signal.
struct Chain {
    /// Place of the signal in its row.
    place: usize,
    /// Full name of the signal.
    signal: String,
    stages: Vec<Box<dyn Fault>>,
    /// Indices of the stages whose input is recorded, ascending.
    taps: Vec<usize>,
    /// Last valid value that went in, 0 before the first.
    last: f64,
}

impl Instruments {
    /// Starts the instruments of a job, whose plant has these signals.
    ///
    /// # Errors
    /// If an instrument names an unknown signal, or its keys are inconsistent.
    pub(crate) fn new(plant: &PlantDescription, job: &Job) -> Result<Self, Invalid> {
        let (rate, seed) = (job.run.rate, job.run.seed);
        // Most runs have none, and a session in Python begins again many thousand times.
        let kinds = match job.sensors.is_empty() && job.actuators.is_empty() {
            true => Vec::new(),
            false => kinds::all(),
        };
        let chains = |all: &[Instrument], fields: &[Field], side: &str, group: &str| {
            let chain = |instrument: &Instrument| {
                let name = format!("{group}.{}", instrument.signal);
                let place = fields
                    .iter()
                    .position(|field| field.name == instrument.signal)
                    .ok_or_else(|| Invalid(format!("there is no signal `{name}`")))?;
                let stages = match side {
                    "sensor" => instrument.sensor_stages(rate, fields),
                    _ => instrument.actuator_stages(rate),
                };
                let path = format!("{side}/{}", instrument.signal);
                let taps = taps_of(&instrument.signal, &stages).into_iter();
                let taps = taps.filter(|(name, _)| instrument.taps.contains(name));
                let taps = taps.map(|(_, index)| index).collect();
                let start = |(number, stage)| {
                    started(&kinds, stage, (rate, fields.len()), (seed, &path, number))
                };
                let stages = (1_u32..).zip(&stages).map(start);
                Ok(Chain {
                    place,
                    stages: stages
                        .collect::<Result<_, Invalid>>()
                        .map_err(|Invalid(why)| Invalid(format!("{side} of `{name}`: {why}")))?,
                    signal: name,
                    taps,
                    last: 0.0,
                })
            };
            all.iter().map(chain).collect::<Result<Vec<_>, Invalid>>()
        };
        Ok(Self {
            rate,
            sensors: chains(&job.sensors, &plant.measured, "sensor", "measured")?,
            actuators: chains(&job.actuators, &plant.commands, "actuator", "command")?,
            row: Vec::with_capacity(plant.measured.len().max(plant.commands.len())),
        })
    }

    /// Converts the model's readings into sensed values, and notes the recorded inputs in `taps`. A sensor gets its last
    /// valid reading in place of an invalid one, and passes the mark on with the value.
    ///
    /// # Errors
    /// If a value is no longer finite.
    #[inline]
    pub(crate) fn sense(
        &mut self,
        step: Step,
        row: &mut [f64],
        taps: &mut [f64],
        invalid: &mut SignalSet,
    ) -> Result<(), String> {
        if self.sensors.is_empty() {
            return Ok(());
        }
        apply(
            &mut self.sensors,
            &moment(step, self.rate),
            (row, invalid),
            taps,
            &mut self.row,
        )
    }

    /// Converts the received commands into applied commands, and notes the recorded inputs in `taps`.
    ///
    /// # Errors
    /// If a value is no longer finite.
    #[inline]
    pub(crate) fn actuate(
        &mut self,
        step: Step,
        row: &mut [f64],
        taps: &mut [f64],
    ) -> Result<(), String> {
        if self.actuators.is_empty() {
            return Ok(());
        }
        let mut invalid = SignalSet::EMPTY;
        apply(
            &mut self.actuators,
            &moment(step, self.rate),
            // An invalid command has been replaced by the last valid one.
            (row, &mut invalid),
            taps,
            &mut self.row,
        )
    }

    /// Returns the state of all stages, in the order of the chains, then what went into the sensors last.
    ///
    /// # Errors
    /// If the state of a stage cannot be saved.
    pub(crate) fn save(&self) -> Result<Vec<State>, Invalid> {
        let chains = self.sensors.iter().chain(&self.actuators);
        let stages = chains.flat_map(|chain| &chain.stages);
        let last: Vec<f64> = self.sensors.iter().map(|chain| chain.last).collect();
        let last = (!last.is_empty()).then(|| State::of(&last));
        stages.map(|stage| stage.save()).chain(last).collect()
    }

    /// Restores a saved state.
    ///
    /// # Errors
    /// If the state does not belong to these instruments.
    pub(crate) fn restore(&mut self, saved: &[State]) -> Result<(), Invalid> {
        let mut saved = saved;
        if let Some((last, stages)) = saved.split_last().filter(|_| !self.sensors.is_empty()) {
            let last: Vec<f64> = last.read()?;
            for (chain, last) in self.sensors.iter_mut().zip(last) {
                chain.last = last;
            }
            saved = stages;
        }
        let chains = self.sensors.iter_mut().chain(&mut self.actuators);
        let stages: Vec<_> = chains.flat_map(|chain| &mut chain.stages).collect();
        if stages.len() != saved.len() {
            let (theirs, ours) = (saved.len(), stages.len());
            return Err(Invalid(format!(
                "the state contains {theirs} stages of instruments, but this run has {ours}"
            )));
        }
        let mut pairs = stages.into_iter().zip(saved);
        pairs.try_for_each(|(stage, state)| stage.restore(state))
    }
}

/// Starts a stage of an instrument, with a random stream of its own.
fn started(
    kinds: &[FaultKindEntry],
    stage: &Stage,
    (rate, signals): (Rate, usize),
    (seed, path, number): (u64, &str, u32),
) -> Result<Box<dyn Fault>, Invalid> {
    let kind = stage.kind.as_str();
    let entry = (kinds.iter()).find(|entry| entry.description.kind == kind);
    let entry = entry.ok_or_else(|| Invalid(format!("there is no stage `{kind}`")))?;
    let mut started = (entry.start)(&AnySetup {
        parameters: &stage.parameters,
        list: &stage.list,
        rate,
        signals,
        is_instrument: true,
    })?;
    started.hold(RandomStream::new(seed, &format!("{path}/{number}/{kind}")));
    Ok(started)
}

/// Returns the moment of a step, at full size since step 0.
fn moment(step: Step, rate: Rate) -> Moment {
    Moment {
        step: step.0,
        since_steps: step.0,
        since_s: rate.seconds(step),
        gain: 1.0,
    }
}

/// Passes each signal that has a chain through it; `before` is room for the row as it was, and `taps` for the recorded
/// inputs.
fn apply(
    chains: &mut [Chain],
    at: &Moment,
    (row, invalid): (&mut [f64], &mut SignalSet),
    taps: &mut [f64],
    before: &mut Vec<f64>,
) -> Result<(), String> {
    before.clear();
    before.extend_from_slice(row); // within the capacity it was made with
    for chain in &mut *chains {
        if invalid.contains(chain.place) {
            before[chain.place] = chain.last;
        }
        chain.last = before[chain.place];
    }
    let mut taps = taps.iter_mut();
    for chain in chains {
        let mut reading = Reading {
            value: before[chain.place],
            valid: !invalid.contains(chain.place),
        };
        let mut rest = &mut chain.stages[..];
        let mut passed = 0;
        for &tap in &chain.taps {
            let (stages, later) = rest.split_at_mut(tap - passed);
            (rest, passed) = (later, tap);
            reading = pass(stages, at, reading, before);
            if let Some(tap) = taps.next() {
                *tap = reading.value;
            }
        }
        reading = pass(rest, at, reading, before);
        if !reading.value.is_finite() {
            return Err(format!(
                "{} is {} after its instrument",
                chain.signal, reading.value
            ));
        }
        row[chain.place] = reading.value;
        if reading.valid {
            invalid.remove(chain.place);
        } else {
            invalid.insert(chain.place);
        }
    }
    Ok(())
}

/// Passes a reading through stages.
#[inline]
fn pass(
    stages: &mut [Box<dyn Fault>],
    at: &Moment,
    mut reading: Reading,
    before: &[f64],
) -> Reading {
    for stage in stages {
        reading = stage.coupled(at, reading, before);
    }
    reading
}

#[cfg(test)]
mod tests;
