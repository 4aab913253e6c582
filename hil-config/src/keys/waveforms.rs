//! `[[stimuli]]`: the keys of square waves, pulses, binary sequences, sums of sines and sequences of waveforms.

use shared_types::time::Rate;

use super::{Key, KeyKind, LENGTH, MAX_S, TEXT, choice, integer, integer_or, number, number_or};

pub(super) const ANY: KeyKind = number("", f64::MIN, f64::MAX);
pub(super) const ANY_OR_ZERO: KeyKind = number_or("", f64::MIN, f64::MAX, 0.0);
pub(super) const FREQUENCY: KeyKind = number("Hz", 0.0, Rate::MAX_HZ);

/// Largest number of tones of a multisine.
pub(crate) const MOST_TONES: i64 = 1000;

/// Largest number of parts of a sequence.
pub(crate) const MOST_PARTS: usize = 1000;

pub(super) const SQUARE: &[Key] = keys! {
    amplitude!: ANY, "Amplitude.";
    frequency_hz!: FREQUENCY, "Frequency.";
    duty: number_or("1", 0.0, 1.0, 0.5), "Share of the period at the upper level.";
    phase_rad: number_or("rad", -1e6, 1e6, 0.0), "Phase.";
    offset: ANY_OR_ZERO, "Mean of both levels.";
};

pub(super) const PULSE: &[Key] = keys! {
    at_s: number_or("s", 0.0, MAX_S, 0.0), "Begin of the first pulse.";
    width_s!: LENGTH, "Length of a pulse.";
    period_s: LENGTH, "Time from one pulse to the next, above its length. Default: one pulse.";
    low: ANY_OR_ZERO, "Value outside a pulse.";
    high!: ANY, "Value of a pulse.";
};

pub(super) const PRBS: &[Key] = keys! {
    amplitude!: ANY, "Amplitude.";
    bit_s!: LENGTH, "Length of a bit, a whole number of steps.";
    order: integer_or(2, 31, 9),
        "Order n of the primitive polynomial: the sequence repeats after 2^n - 1 bits.";
    seed: integer(1, (1 << 31) - 1),
        "First n bits as a number, the lowest first, from 1 to 2^n - 1. Default: all 1.";
    offset: ANY_OR_ZERO, "Mean of both levels.";
};

pub(super) const MULTISINE: &[Key] = keys! {
    frequencies_hz: KeyKind::Numbers, "Frequencies. Alternative: start_hz, end_hz and tones.";
    start_hz: FREQUENCY, "Lowest frequency of a band.";
    end_hz: FREQUENCY, "Highest frequency of a band.";
    tones: integer(2, MOST_TONES), "Number of frequencies of a band, both ends included.";
    spacing: choice(&["linear", "logarithmic"]),
        "linear: frequencies of a band at equal distances; logarithmic: at equal ratios, start_hz above 0.";
    amplitude: ANY, "Amplitude of every tone. Alternative: amplitudes.";
    amplitudes: KeyKind::Numbers, "Amplitudes, as many as frequencies.";
    phases: choice(&["schroeder", "zero"]),
        "schroeder: phases by Schroeder's rule, which keeps the peak low; zero: all 0. Alternative: phases_rad.";
    phases_rad: KeyKind::Numbers, "Phases in rad, as many as frequencies.";
    offset: ANY_OR_ZERO, "Mean value.";
};

/// `[[stimuli.parts]]`; in addition the keys of the kind, which may be any but a sequence.
pub(crate) const PART: &[Key] = keys! {
    kind!: TEXT, "Waveform, not a sequence; its time is 0 where the part begins.";
    length_s!: number("s", 1e-9, MAX_S), "Length of the part, rounded up to whole steps.";
};

pub(super) const SEQUENCE: &[Key] = keys! {
    parts!: KeyKind::List(PART),
        "Parts in their order, each a table of length_s, kind and the keys of the kind.";
};
