//! `hold`: sets every command of the plant to one constant value, regardless of the sample; without a value, to the
//! start value that the plant declares for the command, else 0.
//!
//! For open-loop runs, for a first try of your own plant and as the peer in a latency measurement. This is the only law
//! for any plant, so it implements [`Law`] on rows and has no command table of its own. A value that jumps during a run
//! is reached within 0.1 s, in a straight line.

use serde::{Deserialize, Serialize};
use shared_types::describe::{Invalid, LawDescription};
use shared_types::failure::Failure;
use shared_types::state::{State, check_count};
use shared_types::table::{Field, Table};

use super::transfer::Transfer;
use crate::controller::{Law, LawKind, Row, Start, Transition, TunedRows};

shared_types::table! {
    /// Parameters of `hold`.
    pub struct Parameters {
        /// Value of every command, in the unit of that command. Without it each command has the start value that the plant declares, else 0.
        value: "1" = 0.0 in (f64::MIN)..=(f64::MAX) [tunable, optional],
    }
}

/// The law.
#[derive(Clone, Debug)]
pub struct Hold {
    /// Value of every command, if given.
    value: Option<f64>,
    /// Start value of each command.
    starts: Vec<f64>,
    period_s: f64,
    state: HoldState,
}

/// State that the law keeps from sample to sample.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct HoldState {
    /// Last commands, if any.
    last: Vec<f64>,
    /// `true` if the value has jumped since the last command.
    jumped: bool,
    /// Transfer of each command.
    transfers: Vec<Transfer>,
}

impl Law for Hold {
    fn step(
        &mut self,
        _sample: &Row<'_>,
        command: &mut [f64],
        _internals: &mut [f64],
    ) -> Result<(), Failure> {
        let state = &mut self.state;
        let jumped = std::mem::take(&mut state.jumped);
        // Room for both is reserved at the start.
        (state.transfers).resize(command.len(), Transfer::default());
        for (place, command) in command.iter_mut().enumerate() {
            let start = self.starts.get(place).copied();
            let value = self.value.or(start).unwrap_or(0.0);
            let transfer = &mut state.transfers[place];
            *command = match state.last.get(place).filter(|_| jumped) {
                Some(last) => transfer.begin(*last, value, self.period_s),
                None => value + transfer.next(),
            };
        }
        state.last.clear();
        state.last.extend_from_slice(command);
        Ok(())
    }

    fn save(&self) -> Result<State, Invalid> {
        State::of(&self.state)
    }

    fn restore(&mut self, state: &State) -> Result<(), Invalid> {
        self.state = state.read()?;
        Ok(())
    }

    /// Returns nothing: the last commands matter only while a changed value is on its way.
    fn numbers(&self) -> Result<Vec<f64>, Invalid> {
        Ok(Vec::new())
    }

    fn set_numbers(&mut self, numbers: &[f64]) -> Result<(), Invalid> {
        check_count(0, numbers.len())
    }

    fn retune(&mut self, setup: &TunedRows<'_>, transition: Transition) {
        // Not a number while the scenario's omission stands.
        let value = Some(Parameters::from_row(setup.parameters).value);
        let value = value.filter(|value| !value.is_nan());
        self.state.jumped |=
            transition == Transition::Step || value.is_some() != self.value.is_some();
        self.value = value;
    }
}

/// Lists the parameters. No number stands for the start values that the law holds without a value.
fn parameters() -> Vec<Field> {
    let without_default = |field| Field {
        default: None,
        ..field
    };
    Parameters::fields()
        .into_iter()
        .map(without_default)
        .collect()
}

/// Returns the entry of `hold` in the list of laws.
#[must_use]
pub fn kind() -> LawKind {
    LawKind {
        description: LawDescription {
            name: "hold".into(),
            summary: "Gives every command of the plant one constant value.".into(),
            plants: Vec::new(),
            parameters: parameters(),
            model: Vec::new(),
            measured: Vec::new(),
            reference: Vec::new(),
            commands: None,
            internals: Vec::new(),
            saves: true,
            state: Some(Vec::new()),
            tuning: "The commands go from the old value to the new one in a straight line within 0.1 s after a jump.".into(),
        },
        start: Box::new(start),
    }
}

fn start(start: &Start<'_>) -> Result<Box<dyn Law>, Invalid> {
    let commands = start.commands;
    Ok(Box::new(Hold {
        value: start.parameters.get("value"),
        starts: { commands.iter() }
            .map(|field| field.default.unwrap_or(0.0))
            .collect(),
        period_s: start.period_s,
        state: HoldState {
            last: Vec::with_capacity(commands.len()),
            transfers: Vec::with_capacity(commands.len()),
            ..HoldState::default()
        },
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::describe::Settings;

    #[test]
    fn every_command_of_the_plant_gets_the_value() {
        let mut parameters = Settings::default();
        parameters.set("value", -2.5);
        let mut law = (kind().start)(&Start {
            parameters: &parameters,
            model: &Settings::default(),
            period_s: 1e-3,
            commands: &[],
        })
        .expect("starts");
        let mut command = [f64::NAN; 3];
        let sample = Row {
            held_steps: 0,
            time_s: 0.0,
            measured: &[],
            reference: &[],
            valid: false,
        };
        (law.step(&sample, &mut command, &mut [])).expect("answers");
        assert_eq!(command, [-2.5; 3]);
    }

    #[test]
    fn a_jump_is_approached_in_a_straight_line_and_a_ramp_is_followed() {
        let mut law = Hold {
            value: Some(8.0),
            starts: Vec::new(),
            period_s: 0.025,
            state: HoldState::default(),
        };
        let step = |law: &mut Hold| {
            let sample = Row {
                held_steps: 0,
                time_s: 0.0,
                measured: &[],
                reference: &[],
                valid: true,
            };
            let mut command = [f64::NAN];
            law.step(&sample, &mut command, &mut []).expect("answers");
            command[0]
        };
        let retune = |law: &mut Hold, value, transition| {
            let setup = TunedRows {
                parameters: &[value],
                model: &[],
                period_s: 0.025,
            };
            law.retune(&setup, transition);
        };
        // No command yet: there is nothing to continue from.
        retune(&mut law, 4.0, Transition::Step);
        assert_eq!([step(&mut law), step(&mut law)], [4.0, 4.0]);
        retune(&mut law, 0.0, Transition::Step);
        let commands: Vec<f64> = (0..6).map(|_| step(&mut law)).collect();
        assert_eq!(commands, [4.0, 3.0, 2.0, 1.0, 0.0, 0.0]);
        for value in [0.0, 0.5, 1.0] {
            retune(&mut law, value, Transition::Ramp);
            assert_eq!(step(&mut law), value);
        }
    }

    #[test]
    fn without_a_value_each_command_holds_its_start_or_0_until_one_is_set() {
        let field = |name: &str, start| Field {
            default: start,
            ..Field::signal(name, "K", "x")
        };
        let mut law = (kind().start)(&Start {
            parameters: &Settings::default(),
            model: &Settings::default(),
            period_s: 0.05,
            commands: &[field("ambient_k", Some(290.0)), field("wall_k", None)],
        })
        .expect("starts");
        let step = |law: &mut Box<dyn Law>| {
            let sample = Row {
                held_steps: 0,
                time_s: 0.0,
                measured: &[],
                reference: &[],
                valid: true,
            };
            let mut command = [f64::NAN; 2];
            law.step(&sample, &mut command, &mut []).expect("answers");
            command
        };
        assert_eq!(step(&mut law), [290.0, 0.0]);
        let saved = law.save().expect("a state");
        // Both go from their own value to the new one in 0.1 s, also when a ramp begins.
        law.retune(
            &TunedRows {
                parameters: &[10.0],
                model: &[],
                period_s: 0.05,
            },
            Transition::Ramp,
        );
        let commands = [(); 3].map(|()| step(&mut law));
        assert_eq!(commands, [[290.0, 0.0], [150.0, 5.0], [10.0, 10.0]]);
        law.restore(&saved).expect("its own state");
        assert_eq!(step(&mut law), [10.0, 10.0]);
    }
}
