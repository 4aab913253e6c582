//! State as bytes: the part of a plant, a law or a fault that a checkpoint keeps.
//!
//! A model declares its state once, with [`StateOf`]; engine and runner save and restore it as opaque bytes. The format
//! is postcard's: every number keeps its bits, including those of a NaN. The bytes are not self-describing: only the
//! binary that wrote them can read them, which the launcher ensures. An ordinary step makes no calls here.
//!
//! A state may also name its numbers ([`StateOf::named`]): `hil trim` and `hil linearise` work on these rows. Flags and
//! counts stay in the bytes.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::describe::Invalid;
use crate::table::{Empty, Field, Table};

/// State as bytes.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct State(Vec<u8>);

impl State {
    /// Serialises a value.
    ///
    /// # Errors
    /// If the value cannot be serialised, for example a sequence of unknown length.
    pub fn of<T: Serialize>(value: &T) -> Result<Self, Invalid> {
        let bytes = postcard::to_allocvec(value);
        (bytes.map(Self)).map_err(|error| Invalid(format!("the state cannot be written: {error}")))
    }

    /// Deserialises a value from all of the bytes.
    ///
    /// # Errors
    /// If the bytes do not represent such a value.
    pub fn read<T: DeserializeOwned>(&self) -> Result<T, Invalid> {
        let (value, rest) = postcard::take_from_bytes(&self.0)
            .map_err(|error| Invalid(format!("the state cannot be read: {error}")))?;
        if rest.is_empty() {
            Ok(value)
        } else {
            let bytes = rest.len();
            Err(Invalid(format!("the state has {bytes} surplus bytes")))
        }
    }

    /// Returns the bytes.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        &self.0
    }
}

impl From<Vec<u8>> for State {
    fn from(bytes: Vec<u8>) -> Self {
        Self(bytes)
    }
}

/// Returns the refusal of a state whose numbers have no names.
#[must_use]
pub fn unnamed() -> Invalid {
    Invalid(
        "the state is bytes without names; it needs `StateOf::named`, in C the member `state`"
            .into(),
    )
}

/// Checks the number of rows of a state.
///
/// # Errors
/// If there are more or fewer.
pub fn check_count(expected: usize, actual: usize) -> Result<(), Invalid> {
    match expected == actual {
        true => Ok(()),
        false => Err(Invalid(format!(
            "the state has {expected} named numbers, but {actual} were given"
        ))),
    }
}

type Save<T> = Box<dyn Fn(&T) -> Result<State, Invalid>>;
type Restore<T> = Box<dyn Fn(&mut T, &State) -> Result<(), Invalid>>;

/// State of a `T`: the part of the `T` that is saved, and the way to restore it.
///
/// State is everything that the next step depends on and that follows neither from the parameters nor from the step
/// number. A value that follows from parameters is not state: before its state is restored, a `T` is started with the
/// parameters and receives those that faults have changed.
///
/// ```
/// use shared_types::state::StateOf;
///
/// struct Tank { area_m2: f64, level_m: f64 }
///
/// let state = StateOf::new(|tank: &Tank| tank.level_m, |tank, level_m| tank.level_m = level_m);
/// let full = Tank { area_m2: 2.0, level_m: 3.5 };
/// let mut other = Tank { area_m2: 2.0, level_m: 0.0 };
/// state.restore(&mut other, &state.save(&full)?)?;
/// assert_eq!(other.level_m, 3.5);
/// # Ok::<(), shared_types::describe::Invalid>(())
/// ```
pub struct StateOf<T> {
    save: Save<T>,
    restore: Restore<T>,
    rows: Option<Rows<T>>,
}

type Numbers<T> = Box<dyn Fn(&T) -> Vec<f64>>;
type SetNumbers<T> = Box<dyn Fn(&mut T, &[f64])>;

/// Numbers of a state by name.
struct Rows<T> {
    fields: Vec<Field>,
    numbers: Numbers<T>,
    set: SetNumbers<T>,
}

impl<T: 'static> StateOf<T> {
    /// Declares a state of one value, which may be a tuple.
    #[must_use]
    pub fn new<S>(save: fn(&T) -> S, restore: fn(&mut T, S)) -> Self
    where
        S: Serialize + DeserializeOwned + 'static,
    {
        Self {
            save: Box::new(move |whole| State::of(&save(whole))),
            restore: Box::new(move |whole, state| {
                restore(whole, state.read()?);
                Ok(())
            }),
            rows: None,
        }
    }

    /// Declares a state as [`new`](Self::new) does, if restoring may reject a value.
    #[must_use]
    pub fn checked<S>(save: fn(&T) -> S, restore: fn(&mut T, S) -> Result<(), Invalid>) -> Self
    where
        S: Serialize + DeserializeOwned + 'static,
    {
        Self {
            save: Box::new(move |whole| State::of(&save(whole))),
            restore: Box::new(move |whole, state| restore(whole, state.read()?)),
            rows: None,
        }
    }

    /// Names the numbers of the state, as the columns of a table; `numbers` reads and `set` writes them. All else in
    /// the state keeps its value.
    ///
    /// ```
    /// use shared_types::state::StateOf;
    ///
    /// shared_types::table! {
    ///     /// Level of the tank.
    ///     pub struct Level {
    ///         /// Height of the water.
    ///         level_m: "m",
    ///     }
    /// }
    ///
    /// struct Tank { area_m2: f64, level_m: f64 }
    ///
    /// let state = StateOf::new(|tank: &Tank| tank.level_m, |tank, level_m| tank.level_m = level_m)
    ///     .named(|tank| Level { level_m: tank.level_m }, |tank, row| tank.level_m = row.level_m);
    /// let mut tank = Tank { area_m2: 2.0, level_m: 3.5 };
    /// state.set_numbers(&mut tank, &[1.25])?;
    /// assert_eq!((tank.level_m, state.numbers(&tank)?), (1.25, vec![1.25]));
    /// # Ok::<(), shared_types::describe::Invalid>(())
    /// ```
    #[must_use]
    pub fn named<N: Table>(self, numbers: fn(&T) -> N, set: fn(&mut T, N)) -> Self {
        Self {
            rows: Some(Rows {
                fields: N::fields(),
                numbers: Box::new(move |whole| numbers(whole).row().to_vec()),
                set: Box::new(move |whole, row| set(whole, N::from_row(row))),
            }),
            ..self
        }
    }

    /// Declares that there is no state: everything follows from parameters and the step number.
    #[must_use]
    pub fn none() -> Self {
        Self::new(|_| (), |_, ()| ()).named(|_| Empty {}, |_, Empty {}| ())
    }

    /// Returns the names of the state's numbers; `None` if the state does not name them.
    #[must_use]
    pub fn fields(self) -> Option<Vec<Field>> {
        self.rows.map(|rows| rows.fields)
    }

    /// Returns the named numbers of the present state.
    ///
    /// # Errors
    /// If the state does not name its numbers.
    pub fn numbers(&self, whole: &T) -> Result<Vec<f64>, Invalid> {
        let rows = self.rows.as_ref().ok_or_else(unnamed)?;
        Ok((rows.numbers)(whole))
    }

    /// Sets the named numbers of the state.
    ///
    /// # Errors
    /// If the state does not name its numbers, or names another count of them.
    pub fn set_numbers(&self, whole: &mut T, numbers: &[f64]) -> Result<(), Invalid> {
        let rows = self.rows.as_ref().ok_or_else(unnamed)?;
        check_count(rows.fields.len(), numbers.len())?;
        (rows.set)(whole, numbers);
        Ok(())
    }

    /// Saves the present state.
    ///
    /// # Errors
    /// As [`State::of`].
    pub fn save(&self, whole: &T) -> Result<State, Invalid> {
        (self.save)(whole)
    }

    /// Restores a state.
    ///
    /// # Errors
    /// If the bytes are not a state of this `T` with these parameters.
    pub fn restore(&self, whole: &mut T, state: &State) -> Result<(), Invalid> {
        (self.restore)(whole, state)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_keeps_its_bits() {
        let signalling = f64::from_bits(0x7ff0_0000_0000_0001);
        let quiet = f64::from_bits(0xfff8_0000_dead_beef);
        let numbers = [
            -0.0,
            f64::MIN_POSITIVE / 2.0,
            f64::INFINITY,
            signalling,
            quiet,
            0.1,
        ];
        let state = State::of(&(numbers, u64::MAX)).expect("a form");
        let (read, most): ([f64; 6], u64) = state.read().expect("the same type");
        assert_eq!(read.map(f64::to_bits), numbers.map(f64::to_bits));
        assert_eq!(most, u64::MAX);
    }

    #[test]
    fn a_state_too_short_or_too_long_is_refused() {
        let state = State::of(&[1.5, 2.5]).expect("a form");
        let cut = State::from(state.as_bytes()[..15].to_vec());
        assert!(cut.read::<[f64; 2]>().is_err());
        let error = state.read::<[f64; 1]>().expect_err("8 bytes are left");
        assert!(error.0.contains("8 surplus bytes"), "{error}");
    }
}
