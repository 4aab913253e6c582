//! `[[sensors]]` and `[[actuators]]`.

use shared_types::time::Rate;

use super::{Key, KeyKind, MAX_S, TEXT, integer};

/// Maximum number of bits of a converter: a double cannot represent more steps.
const MOST_BITS: i64 = f64::MANTISSA_DIGITS as i64;
/// Largest size of a stage in the unit of its signal, as for a fault.
const LARGEST: f64 = 1e30;

const fn quantity(unit: &'static str, min: f64, max: f64) -> KeyKind {
    KeyKind::Quantity { unit, min, max }
}

const SIZE: KeyKind = quantity("target", 0.0, LARGEST);

const LAG_HZ: Key = key! {
    lag_hz: quantity("Hz", 1e-9, 1e9),
        "Corner frequency of a low-pass filter of first order; with `lag_damping` the natural frequency of one of second order."
};
const LAG_DAMPING: Key = key! {
    lag_damping: quantity("1", 1e-6, 1e6), "Damping ratio of a low-pass filter of second order."
};
const RATE_HZ: Key = key! {
    rate_hz: quantity("Hz", Rate::MIN_HZ, Rate::MAX_HZ),
        "Sampling rate, run.rate_hz divided by a whole number; the value is held between samples."
};
const PHASE_STEPS: Key = key! {
    phase_steps: integer(0, u32::MAX as i64),
        "Step of the first sample, below run.rate_hz / rate_hz. Default: 0."
};
const BITS: Key = key! {
    bits: integer(1, MOST_BITS), "Bits of a converter that covers `range` in 2^bits steps."
};
const RESOLUTION: Key = key! {
    resolution: quantity("target", 1e-30, LARGEST), "Step of a converter, in place of `bits`."
};
const RANGE: Key = key! {
    range: KeyKind::Range, "Lower and upper end of the range; values outside are limited to it."
};

/// `[[sensors]]`.
pub(crate) const SENSOR: &[Key] = keys! {
    signal!: TEXT, "Name of a measured signal of the plant.";
    scale: quantity("1", -LARGEST, LARGEST), "Factor of the reading.";
    cross: KeyKind::Described,
        "Factors by which readings of other measured signals are added, by their names.";
    bias: quantity("target", -LARGEST, LARGEST), "Constant error.";
    bias_sigma: SIZE,
        "Standard deviation of an error that is drawn once a run, or that wanders if there is `bias_tau_s`.";
    bias_tau_s: quantity("s", 1e-9, MAX_S),
        "Correlation time of an error that wanders about 0 (Gauss-Markov process of first order).";
    bias_walk: quantity("target/sqrt(s)", 0.0, LARGEST),
        "Growth of an error that walks away at random: its standard deviation after 1 s.";
    noise_density: quantity("target/sqrt(Hz)", 0.0, LARGEST),
        "One-sided amplitude density of white noise; a unit divided by the root of a time, as deg/sqrt(h), is N of IEEE 952.";
    ..LAG_HZ;
    ..LAG_DAMPING;
    noise_sigma: SIZE, "Standard deviation of white noise in each sample, behind the lag.";
    ..RATE_HZ;
    ..PHASE_STEPS;
    delay_s: quantity("s", 0.0, MAX_S), "Delay, a whole number of steps of the run.";
    ..BITS;
    ..RESOLUTION;
    ..RANGE;
};

/// `[[actuators]]`.
pub(crate) const ACTUATOR: &[Key] = keys! {
    signal!: TEXT, "Name of a command of the plant.";
    dead_time_s: quantity("s", 0.0, MAX_S), "Delay of the command, a whole number of steps of the run.";
    rate_limit_per_s: quantity("target/s", 0.0, LARGEST), "Largest rate, up and down.";
    ..LAG_HZ;
    ..LAG_DAMPING;
    dead_band: SIZE,
        "Half width of a band about 0 in which nothing happens; larger values come closer to 0 by it.";
    backlash: SIZE, "Play, from one side to the other.";
    ..RANGE;
    ..BITS;
    ..RESOLUTION;
    ..RATE_HZ;
    ..PHASE_STEPS;
};
