//! Commands that the plant received without a valid new value, so that it held the previous one.
//!
//! Counted from the validity bits of the records, by the recorder and by readers of its recording alike. Late messages
//! are counted elsewhere, as their content is valid.

use serde::Serialize;
use shared_types::record::{RecordLayout, Validity};

/// Number of steps at which a command was held.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct HeldCommand {
    /// Name of the command.
    pub command: String,
    /// Number of steps.
    pub steps: u64,
}

impl HeldCommand {
    /// Describes the command, as in `command drive_m was held for 12 of 100 steps`.
    #[must_use]
    pub fn describe(&self, all: u64) -> String {
        let Self { command, steps } = self;
        format!("command {command} was held for {steps} of {all} steps, without a valid new value")
    }
}

/// Commands of a run being counted.
#[derive(Clone, Debug, Default)]
pub struct HeldCommands {
    names: Vec<String>,
    /// Validity bits of the commands, by index.
    validity: Validity,
    steps: Vec<u64>,
}

impl HeldCommands {
    /// Starts with the validity bits of these commands, in their order.
    #[must_use]
    pub fn new(names: Vec<String>, validity: Validity) -> Self {
        Self {
            steps: vec![0; names.len()],
            names,
            validity,
        }
    }

    /// Starts with the commands of a layout.
    #[must_use]
    pub fn of(layout: &RecordLayout) -> Self {
        let first = 1 + layout.sample_validity_words();
        let places = layout.command_places.iter().enumerate();
        let bits = places.map(|(index, bit)| (first, *bit, index));
        // A layout from another process may have bits that no record has.
        let bits = bits.filter(|(first, bit, _)| first + bit / 64 < layout.values_start());
        let names = layout.command.iter().map(|field| field.name.clone());
        Self::new(names.collect(), Validity::new(bits))
    }

    /// Counts the record of a step with a command.
    pub fn take(&mut self, record: &[u64]) {
        for index in self.validity.invalid(record) {
            if let Some(steps) = self.steps.get_mut(index) {
                *steps += 1;
            }
        }
    }

    /// Lists the commands that were held at any step.
    #[must_use]
    pub fn held(&self) -> Vec<HeldCommand> {
        let counted = self.names.iter().zip(&self.steps);
        let held = counted.filter(|(_, steps)| **steps > 0);
        let held = held.map(|(command, steps)| HeldCommand {
            command: command.clone(),
            steps: *steps,
        });
        held.collect()
    }
}

#[cfg(test)]
mod tests {
    use shared_types::table::Field;

    use super::*;

    #[test]
    fn each_command_is_counted_at_the_steps_at_which_it_is_invalid() {
        let layout = RecordLayout {
            command: vec![Field::signal("a_m", "m", ""), Field::signal("b_m", "m", "")],
            command_signals: 3,
            // The law sends `b_m` first and `a_m` last.
            command_places: vec![2, 0],
            ..RecordLayout::default()
        };
        let mut held = HeldCommands::of(&layout);
        let mut record = vec![0; layout.words()];
        for bits in [0, 0b100, 0b101, 0b010, 0b100] {
            record[2] = bits;
            held.take(&record);
        }
        let counted = held.held().into_iter().map(|one| (one.command, one.steps));
        let expected = [("a_m".to_owned(), 3), ("b_m".to_owned(), 1)];
        assert_eq!(counted.collect::<Vec<_>>(), expected);
    }
}
