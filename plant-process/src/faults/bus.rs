//! Bus in simulation: both directions of the link as frames on one network or two.
//!
//! Called by the [signal paths](super::signal_path) in place of their channels. A step packs the frames that are due,
//! lets faults of the link act on each, and unpacks those that arrive: frames in the order of their file, each first
//! on network A and then on B, and on each in the order of sending, overtaken ones last. Lockstep frames
//! never pass through the bus, which only determines their content.

mod line;
mod redundancy;
mod transit;

#[cfg(test)]
mod tests;

use std::path::Path;

use hil_config::bus::{frames, read};
use hil_config::plan::BusPlan;
use hil_config::port::{Carries, PortTables};
use shared_types::describe::{Invalid, PlantDescription};
use shared_types::layout::{SignalKind, SignalTable};
use shared_types::table::Field;
use shared_types::time::Rate;

pub(super) use line::Line;

/// Both directions of a bus.
pub struct Bus {
    pub(super) sample: Line,
    pub(super) command: Line,
}

impl Bus {
    /// Creates the bus of a plan between this plant and its controller.
    ///
    /// # Errors
    /// If its frames do not fit the signals or the rate.
    pub fn new(
        plan: &BusPlan,
        plant: &PlantDescription,
        reference: &[Field],
        rate: Rate,
    ) -> Result<Self, Invalid> {
        let tables = PortTables {
            measured: &plant.measured,
            reference,
            commands: &plant.commands,
        };
        let port = read(plan, Path::new("bus.toml"), &tables)
            .map_err(|problems| Invalid(problems.to_string()))?;
        let all = frames(&port, plan, rate).map_err(|wrong| {
            let reasons: Vec<String> = wrong.into_iter().map(|(reason, _)| reason).collect();
            Invalid(reasons.join("; "))
        })?;
        let sample = SignalTable::of(SignalKind::Measured, &plant.measured)
            .and(SignalKind::Reference, reference);
        let command = SignalTable::of(SignalKind::Command, &plant.commands);
        let line = |carries: Carries, table: &SignalTable| {
            let frames = all.iter().filter(|one| one.carries == carries);
            Line::new(frames, table, plan.networks)
                .map_err(|unusable| Invalid(unusable.to_string()))
        };
        Ok(Self {
            sample: line(Carries::Sample, &sample)?,
            command: line(Carries::Command, &command)?,
        })
    }
}
