//! Null plant and law, which do nothing, so that only the cost of engine, link and runner remains.
//!
//! The law can expose a single value, the time of its call, by the clock that both processes share. This value splits
//! the round trip into the way there and the way back. No other law reads a clock.

use controller_process::controller::{Law, LawKind, Row};
use hil_config::plan::{Clock, PlantPlan, Realtime, Run};
use hil_session::clock::monotonic_ns;
use hil_session::session::SessionInfo;
use plant_process::plant::{Model, PlantKind};
use shared_types::describe::{LawDescription, PlantDescription, Settings};
use shared_types::failure::Failure;
use shared_types::lockstep::OnLoss;
use shared_types::pacer::OverrunPolicy;
use shared_types::record::RecordLayout;
use shared_types::table::Field;
use shared_types::time::{Interval, Rate};

/// Name of the plant and of the law in a measurement.
pub(crate) const NAME: &str = "null";
/// Internal signal of the law: the time of its call, in ns of the monotonic clock.
const CALLED: &str = "called_ns";

/// Plant that measures the value 1 and computes nothing.
pub(crate) struct NullPlant;

impl Model for NullPlant {
    fn retune(&mut self, _parameters: &[f64]) -> Result<(), Failure> {
        Ok(())
    }

    fn measure(&mut self, measured: &mut [f64]) -> Result<(), Failure> {
        measured.fill(1.0);
        Ok(())
    }

    fn truth(&mut self, _: f64, _command: &[f64], _truth: &mut [f64]) -> Result<(), Failure> {
        Ok(())
    }

    fn advance(&mut self, _interval: &Interval, _command: &[f64]) -> Result<(), Failure> {
        Ok(())
    }
}

struct NullLaw;

impl Law for NullLaw {
    fn step(
        &mut self,
        _sample: &Row<'_>,
        command: &mut [f64],
        internals: &mut [f64],
    ) -> Result<(), Failure> {
        if !internals.is_empty() {
            // Exact in a double for the first hundred days after boot, and to 2 ns for the next hundred.
            internals.fill(monotonic_ns() as f64);
        }
        command.fill(1.0);
        Ok(())
    }
}

/// Returns the number of signals in the answer to a sample: half as many, including the time.
pub(crate) fn answered_with(signals: usize) -> usize {
    (signals / 2).max(2)
}

fn fields(stem: &str, count: usize) -> Vec<Field> {
    let field = |i| Field::signal(&format!("{stem}{i}_m"), "m", "Nothing.");
    (0..count).map(field).collect()
}

/// Creates the plant with these numbers of measured signals and commands.
#[must_use]
pub fn plant(name: &str, signals: usize, commands: usize) -> PlantKind {
    PlantKind {
        description: PlantDescription {
            name: name.into(),
            summary: "Does nothing.".into(),
            parameters: Vec::new(),
            truth: Vec::new(),
            measured: fields("measured", signals),
            commands: fields("command", commands),
            faults: Vec::new(),
            saves: false,
            port: None,
            state: None,
        },
        start: Box::new(|_| Ok(Box::new(NullPlant))),
    }
}

/// Creates the law for that plant; with `tells_time` it exposes the time of its call.
#[must_use]
pub fn law(name: &str, signals: usize, commands: usize, tells_time: bool) -> LawKind {
    let called = Field::signal(CALLED, "ns", "Time of the law's call.");
    LawKind {
        description: LawDescription {
            name: name.into(),
            summary: "Does nothing.".into(),
            plants: vec![name.into()],
            parameters: Vec::new(),
            model: Vec::new(),
            measured: fields("measured", signals),
            reference: Vec::new(),
            commands: Some(fields("command", commands)),
            internals: tells_time.then_some(called).into_iter().collect(),
            saves: false,
            state: None,
            tuning: String::new(),
        },
        start: Box::new(|_| Ok(Box::new(NullLaw))),
    }
}

/// Returns the plant of a measurement.
pub(crate) fn measured_plant(signals: usize) -> PlantKind {
    plant(NAME, signals, answered_with(signals) - 1)
}

/// Returns the law of a measurement.
pub(crate) fn measured_law(signals: usize) -> LawKind {
    law(NAME, signals, answered_with(signals) - 1, true)
}

/// Returns the index of the law's call time in a record.
pub(crate) fn called_place(layout: &RecordLayout) -> usize {
    let before = [&layout.truth, &layout.measured, &layout.reference];
    let before: usize = before.into_iter().map(Vec::len).sum();
    layout.values_start() + before + 2 * layout.command.len()
}

/// Creates the jobs of both sides for a plant and a law by name, at the pace of the monotonic clock or at maximum
/// speed.
#[must_use]
pub fn jobs(
    session: &SessionInfo,
    name: &str,
    rate: Option<Rate>,
    steps: u64,
    realtime: &Realtime,
    wait_limit_s: f64,
) -> (plant_process::job::Job, controller_process::job::Job) {
    // In lockstep the rate has no effect on timing.
    let nominal = || Rate::new(1000.0).expect("a legal rate");
    let clock = match rate {
        None => Clock::Lockstep,
        Some(_) => Clock::Paced { factor: 1.0 },
    };
    // Between two samples of a paced run the controller waits for the clock, not for the plant.
    let between_s = rate.map_or(0.0, Rate::period_s);
    let rate = rate.unwrap_or_else(nominal);
    let run = Run {
        rate,
        steps,
        seed: 0,
        clock,
        overrun: OverrunPolicy::CatchUp,
        deadline: 0.8,
        on_controller_loss: OnLoss::Abort,
    };
    let plan = PlantPlan {
        model: name.into(),
        substeps: 1,
        parameters: Settings::default(),
        limits: Vec::new(),
        safe_command: Settings::default(),
        inputs: Settings::default(),
    };
    let plant = plant_process::job::Job {
        observed: false,
        realtime: realtime.plant(),
        ..plant_process::job::Job::new(session.id, run, plan, wait_limit_s)
    };
    let limit_s = wait_limit_s + between_s;
    let controller = controller_process::job::Job {
        realtime: realtime.controller(),
        ..controller_process::job::Job::new(session.id, name, name, rate, limit_s)
    };
    (plant, controller)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_of_the_call_is_the_first_internal() {
        let layout = RecordLayout {
            truth: fields("truth", 2),
            measured: fields("measured", 8),
            reference: fields("reference", 1),
            command: fields("command", 3),
            internal: measured_law(8).description.internals,
            input: Vec::new(),
            command_signals: 4,
            command_places: vec![0, 1, 2],
            parameter: Vec::new(),
            sensor: Vec::new(),
            actuator: Vec::new(),
            cut: Vec::new(),
        };
        let mut words = vec![0; layout.words()];
        words[called_place(&layout)] = 1.5_f64.to_bits();
        // truth, measured, reference, commands as sent and as applied
        let place = 2 + 8 + 1 + 3 + 3;
        assert_eq!(layout.view(&words).values[place], 1.5);
    }

    #[test]
    fn an_answer_has_half_as_many_signals_including_the_time() {
        for (signals, answered) in [(1, 2), (3, 2), (8, 4), (33, 16), (512, 256)] {
            let law = measured_law(signals).description;
            let commands = law.commands.expect("named").len();
            assert_eq!(
                commands + law.internals.len(),
                answered,
                "{signals} signals"
            );
            assert_eq!(measured_plant(signals).description.commands.len(), commands);
        }
    }
}
