//! Conversion of values in the law's incoming and outgoing rows.
//!
//! Created when the law is bound; allocates nothing in a step, and skips values that the conversion would not change.

use shared_types::connection::{Connection, conversions};
use shared_types::describe::LawDescription;
use shared_types::layout::SignalKind;
use shared_types::units::Conversion;

/// Indices of the signals to convert in each row of the law.
#[derive(Clone, Debug)]
pub(super) struct Converted {
    measured: Vec<(usize, Conversion)>,
    reference: Vec<(usize, Conversion)>,
    command: Vec<(usize, Conversion)>,
}

impl Converted {
    /// Collects the conversions of a law from its connections.
    pub(super) fn of(law: &LawDescription, connections: &[Connection]) -> Self {
        let commands = law.commands.as_deref().unwrap_or_default();
        Self {
            measured: conversions(SignalKind::Measured, &law.measured, connections),
            reference: conversions(SignalKind::Reference, &law.reference, connections),
            command: conversions(SignalKind::Command, commands, connections),
        }
    }

    /// Converts the signals that the law receives.
    pub(super) fn sample(&self, measured: &mut [f64], reference: &mut [f64]) {
        convert(measured, &self.measured);
        convert(reference, &self.reference);
    }

    /// Converts the commands that the law sends.
    pub(super) fn command(&self, command: &mut [f64]) {
        convert(command, &self.command);
    }
}

fn convert(row: &mut [f64], conversions: &[(usize, Conversion)]) {
    for (place, conversion) in conversions {
        row[*place] = conversion.apply(row[*place]);
    }
}
