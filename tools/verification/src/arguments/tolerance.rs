//! `--tolerance`: by how much signals may differ, all of them or one by name.
//!
//! Used by `hil compare` and `hil replay`. A tolerance is absolute and in the signal's own unit.

use std::collections::BTreeMap;
use std::str::FromStr;

use shared_types::number::exact;

use shared_types::table::near;

/// Tolerance as it is typed: `X` for every signal, or `SIGNAL=X`.
#[derive(Clone, Debug, PartialEq)]
pub struct Tolerance {
    /// The signal; `None` for all.
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
            (number.trim().parse()).map_err(|_| format!("`{}` is no number", number.trim()))?;
        if value.is_nan() || value < 0.0 {
            return Err(format!(
                "a tolerance is a number of at least 0, not {}",
                exact(value)
            ));
        }
        Ok(Self { signal, value })
    }
}

/// The tolerances of a comparison.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tolerances {
    all: f64,
    of: BTreeMap<String, f64>,
}

impl Tolerances {
    /// Reads the typed tolerances: the last word on a signal stands.
    #[must_use]
    pub fn typed(tolerances: &[Tolerance]) -> Self {
        let mut typed = Self::default();
        for Tolerance { signal, value } in tolerances {
            match signal {
                None => typed.all = *value,
                Some(signal) => typed.set(signal, *value),
            }
        }
        typed
    }

    /// Allows one signal so much.
    pub fn set(&mut self, signal: &str, tolerance: f64) {
        self.of.insert(signal.into(), tolerance);
    }

    /// Replaces the names of signals.
    #[must_use]
    pub fn renamed(&self, rename: impl Fn(&str) -> String) -> Self {
        let of = self.of.iter();
        Self {
            all: self.all,
            of: of.map(|(name, value)| (rename(name), *value)).collect(),
        }
    }

    /// By how much a signal may differ.
    #[must_use]
    pub fn of(&self, signal: &str) -> f64 {
        self.of.get(signal).copied().unwrap_or(self.all)
    }

    /// Refuses tolerances of signals that are not there.
    ///
    /// # Errors
    /// The first one, with the nearest names.
    pub fn check<'a>(&self, known: impl Iterator<Item = &'a str> + Clone) -> Result<(), String> {
        let unknown = |name: &&String| !known.clone().any(|known| known == name.as_str());
        let Some(name) = self.of.keys().find(unknown) else {
            return Ok(());
        };
        let near = near(name, known);
        Err(format!("--tolerance: no signal `{name}` is compared{near}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_signal_may_differ_by_more_than_all() {
        let typed = ["1e-3", "command.u_n=2.5"].map(|text| text.parse().expect("a tolerance"));
        let typed = Tolerances::typed(&typed);
        assert_eq!(
            (typed.of("command.u_n"), typed.of("truth.x_m")),
            (2.5, 1e-3)
        );
        let known = ["command.u_n", "truth.x_m"];
        assert_eq!(typed.check(known.into_iter()), Ok(()));
        let told = typed.check(["command.v_n"].into_iter()).unwrap_err();
        assert!(
            told.contains("`command.u_n`") && told.contains("nearest: `command.v_n`"),
            "{told}"
        );
    }

    #[test]
    fn what_is_no_tolerance_is_refused() {
        for text in ["", "x", "-1", "nan", "command.u_n=", "command.u_n=-1e-9"] {
            assert!(text.parse::<Tolerance>().is_err(), "{text}");
        }
    }
}
