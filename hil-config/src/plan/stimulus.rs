//! Waveforms of reference signals.

use serde::{Deserialize, Serialize};
use shared_types::table::{Field, derivative_of};

use crate::table::Table;

use super::{INPUT_KEYS, REFERENCE_KEYS};
use crate::stimulus::{Multisine, Prbs, Pulse, Sequence, Square};

/// Reference signal with the derivatives that its waveform has, or an input of the plant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stimulus {
    /// Name of the reference signal, or `plant.` and the name of the plant's input.
    pub target: String,
    /// Aliases of the signal, taken from the law or the plant.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub aliases: Vec<String>,
    /// Unit.
    pub unit: String,
    /// Course.
    pub waveform: Waveform,
}

impl Stimulus {
    /// Returns the key under which a change sets the signal.
    #[must_use]
    pub fn key(&self) -> String {
        match self.input() {
            Some(input) => format!("{INPUT_KEYS}{input}"),
            None => format!("{REFERENCE_KEYS}{}", self.target),
        }
    }

    /// Returns the reference signals: the target and its derivatives in ascending order; none for an input of the plant.
    #[must_use]
    pub fn fields(&self) -> Vec<Field> {
        if self.input().is_some() {
            return Vec::new();
        }
        let mut fields = vec![Field {
            aliases: self.aliases.clone(),
            ..Field::signal(&self.target, &self.unit, "Command of the rig.")
        }];
        for order in 1..=self.waveform.derivatives() {
            let (name, unit) = derivative_of(&self.target, &self.unit, order);
            let text = format!("Time derivative {order} of `{}`.", self.target);
            fields.push(Field::signal(&name, &unit, &text));
        }
        fields
    }
}

/// Waveform of a reference signal. Sizes are in the target's unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Waveform {
    /// `atan(a sin(2 pi f t)) (1 - exp(-c t^3))`, section 4 of the paper with a = 0.2, f = 1, c = 0.1.
    Paper {
        /// a.
        amplitude: f64,
        /// f in Hz.
        frequency_hz: f64,
        /// c in 1/s^3.
        onset_per_s3: f64,
    },
    /// `before` until `at_s`, then `after`.
    Step {
        /// Time of the step in s.
        at_s: f64,
        /// Value before.
        before: f64,
        /// Value after.
        after: f64,
    },
    /// `start` until `at_s`, then a constant slope up to `end`, then `end`.
    Ramp {
        /// Beginning in s.
        at_s: f64,
        /// Length in s, above 0.
        duration_s: f64,
        /// Value before.
        start: f64,
        /// Value after.
        end: f64,
    },
    /// `offset + amplitude sin(2 pi f t + phase)`.
    Sine {
        /// Amplitude.
        amplitude: f64,
        /// f in Hz.
        frequency_hz: f64,
        /// Phase in rad.
        phase_rad: f64,
        /// Offset.
        offset: f64,
    },
    /// `offset + amplitude sin(2 pi n(t))`: a sweep from f0 to f1 in `duration_s`, then constant f1 without a phase
    /// jump. [`Sweep`] has the turns n.
    Chirp {
        /// Amplitude.
        amplitude: f64,
        /// f0 in Hz.
        start_hz: f64,
        /// f1 in Hz.
        end_hz: f64,
        /// d in s, above 0.
        duration_s: f64,
        /// Offset.
        offset: f64,
        /// Course of the frequency from f0 to f1.
        #[serde(default, skip_serializing_if = "Sweep::is_linear")]
        sweep: Sweep,
    },
    /// Two levels in a fixed rhythm.
    Square(Square),
    /// One pulse, or a train of them.
    Pulse(Pulse),
    /// Binary sequence of maximal length.
    Prbs(Prbs),
    /// Sum of sines.
    Multisine(Multisine),
    /// Waveforms one after the other.
    Sequence(Sequence),
    /// Rows over time and the course between them.
    Table(Table),
}

/// Course of a chirp's frequency from f0 to f1 in d, and the number of turns at time t.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sweep {
    /// `f0 + (f1 - f0) t / d`; `n = f0 t + (f1 - f0) t^2 / (2 d)`.
    #[default]
    Linear,
    /// `f0 e^(k t)` with `k = ln(f1 / f0) / d`; `n = f0 (e^(k t) - 1) / k`. Both frequencies are above 0 and differ.
    Logarithmic,
}

impl Sweep {
    /// Every sweep.
    pub const ALL: [Self; 2] = [Self::Linear, Self::Logarithmic];

    /// Returns the name in a scenario.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Logarithmic => "logarithmic",
        }
    }

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks so")]
    fn is_linear(&self) -> bool {
        *self == Self::Linear
    }
}

impl Waveform {
    /// Returns its table over time, or those of its parts.
    pub(crate) fn tables_mut(&mut self) -> Vec<&mut Table> {
        match self {
            Self::Table(table) => vec![table],
            Self::Sequence(sequence) => (sequence.parts.iter_mut())
                .flat_map(|part| part.waveform.tables_mut())
                .collect(),
            _ => Vec::new(),
        }
    }

    /// Highest derivative of any waveform.
    pub const MOST_DERIVATIVES: usize = 5;

    /// Returns the number of time derivatives that are sent with the signal: those that exist everywhere, and for
    /// a table those to the right.
    #[must_use]
    pub fn derivatives(&self) -> usize {
        match self {
            Self::Paper { .. } | Self::Sine { .. } | Self::Chirp { .. } | Self::Multisine(_) => 5,
            Self::Table(table) => table.derivatives(),
            Self::Ramp { .. } => 1,
            Self::Step { .. } | Self::Square(_) | Self::Pulse(_) | Self::Prbs(_) => 0,
            Self::Sequence(sequence) => sequence.derivatives(),
        }
    }
}
