//! Times and durations of an event, each under a key in seconds or a key in steps.

use shared_types::number::exact as number;
use shared_types::time::{Rate, Step};

use super::super::run::Grid;
use crate::keys::MAX_STEPS;
use crate::problem::{ProblemKind, listed};
use crate::reader::{Reader, Section};

/// Marker of a problem that has been reported.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reported;

/// Result for an optional key.
pub(super) type Given<T> = Result<Option<T>, Reported>;

/// Two keys for the same quantity, one in seconds and one in steps.
#[derive(Clone, Copy, Debug)]
pub(super) struct Keys {
    /// Key in seconds.
    pub in_s: &'static str,
    /// Key in steps.
    pub in_steps: &'static str,
}

impl Keys {
    /// Returns the key that is present.
    pub(super) fn given(self, reader: &mut Reader, section: &Section<'_>) -> Given<&'static str> {
        let Self { in_s, in_steps } = self;
        let is_given = |key: &str| section.table.get(key).is_some();
        match (is_given(in_s), is_given(in_steps)) {
            (false, false) => Ok(None),
            (true, false) => Ok(Some(in_s)),
            (false, true) => Ok(Some(in_steps)),
            (true, true) => {
                let path = section.path_of(in_steps);
                let message = format!("`{path}` repeats `{in_s}`");
                reader
                    .report_at(section, in_steps, ProblemKind::Duplicate, message)
                    .expected(format!("one of {}", listed([in_s, in_steps])));
                Err(Reported)
            }
        }
    }

    /// Reads a duration in steps; seconds round up.
    pub(super) fn length(
        self,
        reader: &mut Reader,
        section: &Section<'_>,
        grid: Option<Grid>,
    ) -> Given<u64> {
        let Some(key) = self.given(reader, section)? else {
            return Ok(None);
        };
        if key == self.in_steps {
            let steps = reader.integer(section, key).ok_or(Reported)?;
            return Ok(Some(steps.unsigned_abs())); // its range begins at 0
        }
        let length_s = reader.number(section, key).ok_or(Reported)?;
        let rate = grid.ok_or(Reported)?.rate;
        Ok(Some(steps_of(rate, length_s)))
    }

    /// Reads a step not later than `last`, with the requested time.
    pub(super) fn instant(
        self,
        reader: &mut Reader,
        section: &Section<'_>,
        grid: Option<Grid>,
        last: fn(Grid) -> Step,
    ) -> Given<(Step, f64)> {
        let Some(key) = self.given(reader, section)? else {
            return Ok(None);
        };
        let in_s = key == self.in_s;
        let (step, at_s);
        let grid = if in_s {
            at_s = reader.number(section, key).ok_or(Reported)?;
            let grid = grid.ok_or(Reported)?;
            step = Step(steps_of(grid.rate, at_s));
            grid
        } else {
            let step_number = reader.integer(section, key).ok_or(Reported)?;
            let grid = grid.ok_or(Reported)?;
            step = Step(step_number.unsigned_abs());
            at_s = grid.rate.seconds(step);
            grid
        };
        let last = last(grid);
        if step <= last {
            return Ok(Some((step, at_s)));
        }
        let path = section.path_of(key);
        let last_s = number(grid.rate.seconds(last));
        let (when, expected) = if in_s {
            let expected = format!("a time from 0 to {last_s} in s, step {last}");
            (format!("{} s", number(at_s)), expected)
        } else {
            let expected = format!("a step from 0 to {last}, which is at {last_s} s");
            (format!("step {step}"), expected)
        };
        let message = format!("`{path}`: the run is already over at {when}");
        reader
            .report_at(section, key, ProblemKind::OutOfRange, message)
            .expected(expected);
        Err(Reported)
    }
}

/// Converts a time to steps, rounded up; at most [`MAX_STEPS`], which no run reaches.
pub(super) fn steps_of(rate: Rate, time_s: f64) -> u64 {
    if time_s < rate.seconds(Step(MAX_STEPS)) {
        rate.step_at_or_after(time_s).0
    } else {
        MAX_STEPS
    }
}

/// Reports a key that is meaningless because the key to which it belongs is missing.
pub(super) fn refuse_alone(
    reader: &mut Reader,
    section: &Section<'_>,
    key: &str,
    owner: &str,
) -> Result<(), Reported> {
    if section.table.get(key).is_none() || section.table.get(owner).is_some() {
        return Ok(());
    }
    let path = section.path_of(key);
    let message = format!("`{path}` belongs to `{owner}`, which is missing");
    reader.report_at(section, key, ProblemKind::Mismatch, message);
    Err(Reported)
}
