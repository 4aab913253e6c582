//! `[[metrics]]`: the keys of a metric and of each kind.

use super::{Key, KeyKind, MAX_S, SectionKind, TEXT, number, number_or};

/// `[[metrics]]`; in addition the keys of the kind in [`METRICS`].
pub(crate) const METRIC: &[Key] = &[
    Key::new(
        "name",
        TEXT,
        "Name, its unit at the end; the figures of an analysis are named `name.figure`.",
    )
    .required(),
    Key::new(
        "kind",
        KeyKind::Text {
            choices: &[],
            default: Some("expression"),
        },
        "Kind of metric.",
    ),
];

const ANY: KeyKind = number("", f64::MIN, f64::MAX);

/// Kinds of metrics.
pub(crate) const METRICS: &[SectionKind] = &[
    SectionKind {
        name: "expression",
        text: "Reductions of signals over windows.",
        keys: EXPRESSION,
    },
    SectionKind {
        name: "step-response",
        text: "Response of a signal to a step: rise_time_s from 10 to 90 %, overshoot as a part of the step, peak_time_s, settling_time_s, steady_state_error.",
        keys: &[
            Key::new("signal", TEXT, "The signal, an expression.").required(),
            Key::new(
                "unit",
                TEXT,
                "Unit of the signal. Default: the unit that its name's ending stands for, else 1.",
            ),
            Key::new(
                "stimulus",
                TEXT,
                "Stimulus of kind step to which the signal responds. Default: the only one.",
            ),
            Key::new(
                "initial",
                ANY,
                "Value of the signal before the step. Default: that of the stimulus.",
            ),
            Key::new(
                "wanted",
                ANY,
                "Value of the signal long after the step. Default: that of the stimulus.",
            ),
            Key::new(
                "band",
                number_or("1", 1e-9, 1.0, 0.02),
                "Largest distance of a settled signal from `wanted`, as a part of the step.",
            ),
            Key::new(
                "until_s",
                number("s", 0.0, MAX_S),
                "End of the analysed time. Default: the end of the run.",
            ),
        ],
    },
    SectionKind {
        name: "frequency-response",
        text: "Response of a signal to a chirp: low_frequency_gain, bandwidth_hz at -3 dB, peak_gain over the low-frequency gain and peak_frequency_hz, phase_lag_90_frequency_hz.",
        keys: &[
            Key::new(
                "input",
                TEXT,
                "Input signal, an expression. Default: the chirp as the controller gets it.",
            ),
            Key::new("output", TEXT, "Output signal, an expression.").required(),
            Key::new(
                "stimulus",
                TEXT,
                "The stimulus of kind chirp. Default: the only one.",
            ),
        ],
    },
    SectionKind {
        name: "detection",
        text: "Detection of a fault and recovery from it: time_to_detect_s, missed, false_alarms, with `recovered` time_to_recover_s, with `effect` peak_effect and rms_effect.",
        keys: &[
            Key::new(
                "alarm",
                TEXT,
                "Expression that holds while the law sees a fault.",
            )
            .required(),
            Key::new(
                "held_s",
                number_or("s", 0.0, MAX_S, 0.01),
                "Time that the alarm must hold to count.",
            ),
            Key::new(
                "fault",
                KeyKind::Event,
                "Name or number of the fault event to detect. Default: the first that takes effect.",
            ),
            Key::new(
                "recovered",
                TEXT,
                "Expression that holds while the fault is overcome.",
            ),
            Key::new("effect", TEXT, "Effect of the fault, an expression."),
            Key::new(
                "unit",
                TEXT,
                "Unit of the effect. Default: the unit that its name's ending stands for, else 1.",
            ),
        ],
    },
];

/// A metric of kind `expression`.
pub(crate) const EXPRESSION: &[Key] = &[
    Key::new(
        "unit",
        TEXT,
        "Unit. Default: that of the expression, whose integrals are over time, else the unit that the name's ending stands for, else 1.",
    ),
    Key::new(
        "expression",
        TEXT,
        "Reductions of signals over a window (max_abs, max, min, mean, rms, initial, final, integral) and arithmetic of them.",
    )
    .required(),
    Key::new(
        "windows_s",
        KeyKind::Pairs,
        "Windows [begin, end], both ends included. Default: the whole run.",
    ),
    Key::new(
        "published",
        KeyKind::List(PUBLISHED),
        "Published values, shown beside those of the run.",
    ),
    Key::new(
        "published_note",
        TEXT,
        "Note for readers of the comparison.",
    ),
];

/// `published` of a metric.
pub(crate) const PUBLISHED: &[Key] = &[
    Key::new("law", TEXT, "The law that it was found with.").required(),
    Key::new(
        "window_s",
        KeyKind::Pair,
        "The window [begin, end], one of the metric's.",
    )
    .required(),
    Key::new(
        "value",
        number("", f64::MIN, f64::MAX),
        "The value in the metric's unit.",
    )
    .required(),
    Key::new("source", TEXT, "Where it stands, for example Table 3.").required(),
];
