//! `[[metrics]]`: the keys of a metric and of each kind.

use super::{Key, KeyKind, MAX_S, SectionKind, TEXT, number, number_or};

/// `[[metrics]]`; in addition the keys of the kind in [`METRICS`].
pub(crate) const METRIC: &[Key] = keys! {
    name!: TEXT, "Name, its unit at the end; the figures of an analysis are named `name.figure`.";
    kind: KeyKind::Text { choices: &[], default: Some("expression"), }, "Kind of metric.";
};

const ANY: KeyKind = number("", f64::MIN, f64::MAX);

/// Kinds of metrics.
pub(crate) const METRICS: &[SectionKind] = kinds! {
    "expression": "Reductions of signals over windows." { EXPRESSION }
    "step-response": "Response of a signal to a step: rise_time_s from 10 to 90 %, overshoot as a part of the step, peak_time_s, settling_time_s, steady_state_error." {
        signal!: TEXT, "The signal, an expression.";
        unit: TEXT, "Unit of the signal. Default: the unit that its name's ending stands for, else 1.";
        stimulus: TEXT, "Stimulus of kind step to which the signal responds. Default: the only one.";
        initial: ANY, "Value of the signal before the step. Default: that of the stimulus.";
        wanted: ANY, "Value of the signal long after the step. Default: that of the stimulus.";
        band: number_or("1", 1e-9, 1.0, 0.02),
            "Largest distance of a settled signal from `wanted`, as a part of the step.";
        until_s: number("s", 0.0, MAX_S), "End of the analysed time. Default: the end of the run.";
    }
    "frequency-response": "Response of a signal to a chirp: low_frequency_gain, bandwidth_hz at -3 dB, peak_gain over the low-frequency gain and peak_frequency_hz, phase_lag_90_frequency_hz." {
        input: TEXT, "Input signal, an expression. Default: the chirp as the controller gets it.";
        output!: TEXT, "Output signal, an expression.";
        stimulus: TEXT, "The stimulus of kind chirp. Default: the only one.";
    }
    "detection": "Detection of a fault and recovery from it: time_to_detect_s, missed, false_alarms, with `recovered` time_to_recover_s, with `effect` peak_effect and rms_effect." {
        alarm!: TEXT, "Expression that holds while the law sees a fault.";
        held_s: number_or("s", 0.0, MAX_S, 0.01), "Time that the alarm must hold to count.";
        fault: KeyKind::Event,
            "Name or number of the fault event to detect. Default: the first that takes effect.";
        recovered: TEXT, "Expression that holds while the fault is overcome.";
        effect: TEXT, "Effect of the fault, an expression.";
        unit: TEXT, "Unit of the effect. Default: the unit that its name's ending stands for, else 1.";
    }
};

/// A metric of kind `expression`.
pub(crate) const EXPRESSION: &[Key] = keys! {
    unit: TEXT,
        "Unit. Default: that of the expression, whose integrals are over time, else the unit that the name's ending stands for, else 1.";
    expression!: TEXT,
        "Reductions of signals over a window (max_abs, max, min, mean, rms, initial, final, integral) and arithmetic of them.";
    windows_s: KeyKind::Pairs, "Windows [begin, end], both ends included. Default: the whole run.";
    published: KeyKind::List(PUBLISHED), "Published values, shown beside those of the run.";
    published_note: TEXT, "Note for readers of the comparison.";
};

/// `published` of a metric.
pub(crate) const PUBLISHED: &[Key] = keys! {
    law!: TEXT, "The law that it was found with.";
    window_s!: KeyKind::Pair, "The window [begin, end], one of the metric's.";
    value!: number("", f64::MIN, f64::MAX), "The value in the metric's unit.";
    source!: TEXT, "Where it stands, for example Table 3.";
};
