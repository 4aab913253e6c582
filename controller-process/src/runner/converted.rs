//! Values of the law's rows that are converted on their way in and out.
//!
//! Made when the law is bound; allocates nothing in a step, and touches no value whose conversion would change no bit.

use shared_types::connection::{Connection, conversions};
use shared_types::describe::LawDescription;
use shared_types::layout::SignalKind;
use shared_types::units::Conversion;

/// The signals of each row of the law whose values are converted, by place.
#[derive(Clone, Debug)]
pub(super) struct Converted {
    measured: Vec<(usize, Conversion)>,
    reference: Vec<(usize, Conversion)>,
    command: Vec<(usize, Conversion)>,
}

impl Converted {
    /// Finds the conversions of a law by its connections.
    pub(super) fn of(law: &LawDescription, connections: &[Connection]) -> Self {
        let commands = law.commands.as_deref().unwrap_or_default();
        Self {
            measured: conversions(SignalKind::Measured, &law.measured, connections),
            reference: conversions(SignalKind::Reference, &law.reference, connections),
            command: conversions(SignalKind::Command, commands, connections),
        }
    }

    /// Converts what the law receives.
    pub(super) fn sample(&self, measured: &mut [f64], reference: &mut [f64]) {
        convert(measured, &self.measured);
        convert(reference, &self.reference);
    }

    /// Converts what the law sends.
    pub(super) fn command(&self, command: &mut [f64]) {
        convert(command, &self.command);
    }
}

fn convert(row: &mut [f64], conversions: &[(usize, Conversion)]) {
    for (place, conversion) in conversions {
        row[*place] = conversion.apply(row[*place]);
    }
}
