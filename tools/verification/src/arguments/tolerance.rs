//! `--tolerance`: the largest allowed difference, for all signals or for one by name.
//!
//! Used by `hil compare` and `hil replay`. A tolerance is absolute and in the signal's own unit.

use std::collections::BTreeMap;
use std::str::FromStr;

use shared_types::number::exact;

use shared_types::table::near;

/// Tolerance as typed: `X` for every signal, or `SIGNAL=X`.
#[derive(Clone, Debug, PartialEq)]
pub struct Tolerance {
    /// Name of the signal; `None` for all signals.
    signal: Option<String>,
    value: f64,
}

impl FromStr for Tolerance {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (signal, number) = match text.split_once('=') {
            Some((signal, number)) => (Some(signal.trim().to_owned()), number),
            None => (None, text),
        };
        let value: f64 =
            (number.trim().parse()).map_err(|_| format!("`{}` is not a number", number.trim()))?;
        if value.is_nan() || value < 0.0 {
            return Err(format!(
                "a tolerance must be a number of at least 0, not {}",
                exact(value)
            ));
        }
        Ok(Self { signal, value })
    }
}

/// Tolerances of a comparison.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tolerances {
    all: f64,
    of: BTreeMap<String, f64>,
}

impl Tolerances {
    /// Collects the typed tolerances; the last one for a signal wins.
    pub(crate) fn typed(tolerances: &[Tolerance]) -> Self {
        let mut typed = Self::default();
        for Tolerance { signal, value } in tolerances {
            match signal {
                None => typed.all = *value,
                Some(signal) => typed.set(signal, *value),
            }
        }
        typed
    }

    /// Sets the tolerance of one signal.
    pub fn set(&mut self, signal: &str, tolerance: f64) {
        self.of.insert(signal.into(), tolerance);
    }

    /// Replaces the names of signals.
    pub(crate) fn renamed(&self, rename: impl Fn(&str) -> String) -> Self {
        let of = self.of.iter();
        Self {
            all: self.all,
            of: of.map(|(name, value)| (rename(name), *value)).collect(),
        }
    }

    /// Returns the tolerance of a signal.
    #[must_use]
    pub fn of(&self, signal: &str) -> f64 {
        self.of.get(signal).copied().unwrap_or(self.all)
    }

    /// Refuses tolerances for unknown signals.
    ///
    /// # Errors
    /// For the first unknown signal, with the nearest names.
    pub fn check<'a>(&self, known: impl Iterator<Item = &'a str> + Clone) -> Result<(), String> {
        let unknown = |name: &&String| !known.clone().any(|known| known == name.as_str());
        let Some(name) = self.of.keys().find(unknown) else {
            return Ok(());
        };
        let near = near(name, known);
        Err(format!(
            "--tolerance: no compared signal is named `{name}`{near}"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_can_have_a_larger_tolerance_than_all_others() {
        let typed = ["1e-3", "command.u_n=2.5"].map(|text| text.parse().expect("a tolerance"));
        let typed = Tolerances::typed(&typed);
        assert_eq!(
            (typed.of("command.u_n"), typed.of("truth.x_m")),
            (2.5, 1e-3)
        );
        let known = ["command.u_n", "truth.x_m"];
        assert_eq!(typed.check(known.into_iter()), Ok(()));
        let message = typed.check(["command.v_n"].into_iter()).unwrap_err();
        assert!(
            message.contains("`command.u_n`") && message.contains("nearest: `command.v_n`"),
            "{message}"
        );
    }

    #[test]
    fn an_invalid_tolerance_is_refused() {
        for text in ["", "x", "-1", "nan", "command.u_n=", "command.u_n=-1e-9"] {
            assert!(text.parse::<Tolerance>().is_err(), "{text}");
        }
    }
}
