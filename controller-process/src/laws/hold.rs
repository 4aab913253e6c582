//! `hold`: gives every command of the plant one constant value, whatever the sample says.
//!
//! For open-loop runs, for a first try of an own plant and as the other side of a latency
//! measurement. It is the one law that fits any plant, so it implements [`Law`] on rows and has no
//! command table of its own.

use shared_types::describe::{Invalid, LawDescription};
use shared_types::failure::Failure;
use shared_types::state::State;
use shared_types::table::Table;

use crate::controller::{Law, LawKind, Row, Start};

shared_types::table! {
    /// Parameters of `hold`.
    pub struct Parameters {
        /// Value of every command, in the unit of that command.
        value: "1" = 0.0 in (f64::MIN)..=(f64::MAX),
    }
}

/// The law.
#[derive(Clone, Copy, Debug)]
pub struct Hold {
    value: f64,
}

impl Law for Hold {
    fn step(
        &mut self,
        _sample: &Row<'_>,
        command: &mut [f64],
        _internals: &mut [f64],
    ) -> Result<(), Failure> {
        command.fill(self.value);
        Ok(())
    }

    fn save(&self) -> Result<State, Invalid> {
        Ok(State::default()) // it has none
    }

    fn restore(&mut self, state: &State) -> Result<(), Invalid> {
        state.read::<()>()
    }
}

/// The entry of `hold` in the list of laws.
#[must_use]
pub fn kind() -> LawKind {
    LawKind {
        description: LawDescription {
            name: "hold".into(),
            summary: "Gives every command of the plant one constant value.".into(),
            plants: Vec::new(),
            parameters: Parameters::fields(),
            model: Vec::new(),
            measured: Vec::new(),
            reference: Vec::new(),
            commands: None,
            internals: Vec::new(),
            saves: true,
        },
        start: Box::new(start),
    }
}

fn start(start: &Start<'_>) -> Result<Box<dyn Law>, Invalid> {
    let parameters: Parameters = start.parameters.to_table("controller.hold")?;
    Ok(Box::new(Hold {
        value: parameters.value,
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
    fn a_missing_value_is_named() {
        let error = (kind().start)(&Start {
            parameters: &Settings::default(),
            model: &Settings::default(),
            period_s: 1e-3,
            commands: &[],
        })
        .err()
        .expect("refused");
        assert!(error.0.contains("`controller.hold.value`"), "{error}");
    }
}
