//! Reference signals and driven inputs of a plan.

use serde::{Deserialize, Serialize};
use shared_types::table::{Field, derivative_of};

use super::REFERENCE_KEYS;
use crate::stimulus::Waveform;

/// Prefix of driven inputs in the keys of changes and in the names of signals.
pub const INPUT_KEYS: &str = "input.";

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
    /// Smallest and largest value that the plant declares for the input; any finite one for a reference signal.
    #[serde(default = "Stimulus::any_range", skip_serializing_if = "is_any")]
    pub range: [f64; 2],
    /// `true` if the law or the plant takes whole numbers only.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_whole: bool,
    /// Course.
    pub waveform: Waveform,
}

fn is_any(range: &[f64; 2]) -> bool {
    *range == Stimulus::any_range()
}

impl Stimulus {
    /// Returns the range of all finite numbers.
    #[must_use]
    pub const fn any_range() -> [f64; 2] {
        [f64::MIN, f64::MAX]
    }

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
