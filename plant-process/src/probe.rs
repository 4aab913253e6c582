//! Probes: tones added to commands just before the actuators, with the input and the output of each.
//!
//! Called by the engine at every step, after the faults on commands and before the instruments. A run without probes has
//! an empty list, and does nothing here.

use std::f64::consts::TAU;

use hil_config::plan::{Probe, Tone};
use shared_types::describe::{Invalid, PlantDescription};
use shared_types::time::Step;

/// Probes of a run, each with the place of its command in a row of commands.
pub(crate) struct Probes(Vec<(usize, Probe)>);

impl Probes {
    /// Creates the probes of a job, whose plant has these commands.
    ///
    /// # Errors
    /// If a probe names an unknown command, or its period is 0.
    pub(crate) fn new(plant: &PlantDescription, probes: &[Probe]) -> Result<Self, Invalid> {
        let placed = probes.iter().map(|probe| {
            let name = &probe.command;
            let place = (plant.commands.iter()).position(|field| field.name == *name);
            let place = place.ok_or_else(|| {
                Invalid(format!("there is no signal `command.{name}` to be probed"))
            })?;
            match probe.period_steps {
                0 => Err(Invalid(format!(
                    "the probe of `command.{name}` has no period"
                ))),
                _ => Ok((place, probe.clone())),
            }
        });
        Ok(Self(placed.collect::<Result<_, _>>()?))
    }

    /// Adds the tones of a step to the commands, and notes inputs, then outputs in `cut`.
    #[inline]
    pub(crate) fn cut(&self, step: Step, row: &mut [f64], cut: &mut [f64]) {
        let (inputs, outputs) = cut.split_at_mut(self.0.len());
        for (((place, probe), input), output) in self.0.iter().zip(inputs).zip(outputs) {
            *input = row[*place];
            if let Some(since) = step.0.checked_sub(probe.first_step) {
                row[*place] += sum(probe, since);
            }
            *output = row[*place];
        }
    }
}

/// Computes the sum of a probe's tones, `sum(A sin(2 pi n k / N + p))`, k steps after its first step.
///
/// The angle is reduced in whole numbers, so that the tones repeat exactly.
fn sum(probe: &Probe, since: u64) -> f64 {
    let period = probe.period_steps;
    let value = |tone: &Tone| {
        let turned = (tone.turns % period) * (since % period) % period;
        let angle = TAU * turned as f64 / period as f64 + tone.phase_rad;
        tone.amplitude * libm::sin(angle)
    };
    probe.tones.iter().map(value).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sum_of_tones_repeats_exactly_after_the_period() {
        let tone = |turns, amplitude| Tone {
            turns,
            amplitude,
            phase_rad: 0.3,
        };
        let probe = Probe {
            command: "force_n".into(),
            first_step: 0,
            period_steps: 1000,
            tones: vec![tone(1, 2.0), tone(7, 0.5)],
        };
        for since in [0_u64, 1, 250, 999] {
            let angle = TAU * since as f64 / 1000.0;
            let expected = 2.0 * libm::sin(angle + 0.3) + 0.5 * libm::sin(7.0 * angle + 0.3);
            assert!((sum(&probe, since) - expected).abs() < 1e-12);
            let later = sum(&probe, since + 1_000_000_000);
            assert_eq!(later.to_bits(), sum(&probe, since).to_bits());
        }
    }
}
