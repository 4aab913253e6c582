//! Probes: tones that a measurement adds to a command, at the last stage before its actuator.
//!
//! A probe cuts the loop: its input is the command as it arrives, after link and faults, and its output is the sum of
//! input and tones. Both are recorded, in the group `cut`, so that their ratio is the response of everything else in
//! the loop. No scenario has probes; `hil margins` adds them to a plan.

use serde::{Deserialize, Serialize};
use shared_types::table::Field;

/// Probe of one command.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Probe {
    /// Name of the command.
    pub command: String,
    /// First step to which the tones are added.
    pub first_step: u64,
    /// Common period of all tones in steps.
    pub period_steps: u64,
    /// Tones, each a whole number of turns in the common period.
    pub tones: Vec<Tone>,
}

/// Sine with a whole number of turns in the period of its probe.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tone {
    /// Turns in the common period.
    pub turns: u64,
    /// Amplitude in the unit of the command.
    pub amplitude: f64,
    /// Phase at the first step in rad.
    pub phase_rad: f64,
}

/// Returns the columns of the group `cut`: the inputs of all probes, then their outputs.
#[must_use]
pub fn cut_fields(commands: &[Field], probes: &[Probe]) -> Vec<Field> {
    let of = |side: &'static str, text: &'static str| {
        probes.iter().filter_map(move |probe| {
            let own = (commands.iter()).find(|field| field.name == probe.command)?;
            Some(Field {
                name: format!("{side}.{}", own.name),
                description: format!("{text} of the probe of {}.", own.name),
                aliases: Vec::new(),
                ..own.clone()
            })
        })
    };
    of("in", "Input").chain(of("out", "Output")).collect()
}
