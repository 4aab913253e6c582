//! `[[changes]]`: the keys of a change of values during the run.

use super::{Key, KeyKind, LENGTH, MAX_S, number};

/// `[[changes]]`.
pub(crate) const CHANGE: &[Key] = keys! {
    at_s!: number("s", 0.0, MAX_S), "Time of the change; rounds up to a step.";
    ..RAMP;
    ..SET;
    ..CLEAR;
};

/// Keys of a change requested during a run: without a time it begins at once.
pub(crate) const LIVE_CHANGE: &[Key] = keys! {
    at_s: number("s", 0.0, MAX_S), "Time of the change; rounds up to a step. Default: at once.";
    ..RAMP;
    ..SET;
    ..CLEAR;
};

const RAMP: Key = key! {
    ramp_s: LENGTH, "Duration of a linear change from the current values; rounds up to a step. Default: none."
};
const SET: Key = key! {
    set: KeyKind::Described,
        "New values by their keys: controller.<law>.x and plant.parameters.x for parameters that can be tuned, a full name or the last part alone; reference.x for a reference signal, which then no longer follows its stimulus."
};
const CLEAR: Key = key! {
    clear: KeyKind::Texts, "Reference signals that follow their stimulus again: reference.x."
};
