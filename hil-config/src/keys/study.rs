//! Keys of a study, the file of a campaign.

use super::{
    Key, KeyKind, SectionKind, TEXT, VERSION, choice, integer, integer_or, number, number_or,
};

/// Maximum number of cases in a campaign.
pub(crate) const MOST_CASES: i64 = 100_000_000;

const ANY: f64 = f64::MAX;

const MIN: Key = Key::new("min", number("", f64::MIN, ANY), "Smallest value.").required();
const MAX: Key = Key::new("max", number("", f64::MIN, ANY), "Largest value.").required();
const CUT_MIN: Key = Key::new(
    "min",
    number("", f64::MIN, ANY),
    "Smallest value; the distribution is truncated there. Default: none.",
);
const CUT_MAX: Key = Key::new(
    "max",
    number("", f64::MIN, ANY),
    "Largest value; the distribution is truncated there. Default: none.",
);

const WHOLE: Key = Key::new(
    "whole",
    KeyKind::Boolean { default: false },
    "Only whole numbers, for keys that take no others. `uniform` gives each one from min to max equally often; `normal`, `lognormal` and `expression` are rounded to the nearest, halves away from zero; the points of a `grid` must be whole as they are.",
);

/// The whole study.
pub(crate) const STUDY: &[Key] = &[
    VERSION,
    Key::new(
        "name",
        TEXT,
        "Name of the study: letters, digits, - and _. Default: the file's name.",
    ),
    Key::new("description", TEXT, "Question that the study answers."),
    Key::new("scenario", TEXT, "The scenario, relative to the study.").required(),
    Key::new(
        "set",
        KeyKind::Texts,
        "Scenario values that are changed for every case, each written as for --set.",
    ),
    Key::new(
        "cases",
        integer(1, MOST_CASES),
        "Number of draws; each draw is one case of every variant. A grid has one draw for each of its points.",
    ),
    Key::new(
        "seed",
        integer_or(0, i64::MAX, 1),
        "Seed of the draws and of run.seed in each case, which is drawn too unless the study sets or varies it.",
    ),
    Key::new(
        "sampling",
        choice(&["independent", "latin-hypercube", "sobol", "grid"]),
        "Method of drawing values: independent draws give probabilities with bounds; a Latin hypercube and Sobol' points cover the space more evenly but give no such probabilities; a grid takes all combinations of lists and ranges.",
    ),
    Key::new(
        "confidence",
        number_or("1", 0.5, 0.999_999, 0.95),
        "Confidence of the bounds.",
    ),
    Key::new(
        "case_limit_s",
        number_or("s", 0.1, 1e6, 600.0),
        "Time after which a case counts as hung; its worker ends and another worker retries the case.",
    ),
    Key::new(
        "wait_limit_s",
        number_or("s", 0.1, 1e6, 5.0),
        "Time that a side of a case may take to answer, as --wait-limit of hil run. To describe itself, to check its job and to start, a program may always take 10 s.",
    ),
    Key::new(
        "fresh_processes",
        KeyKind::Boolean { default: false },
        "Restart the campaign's own programs for each case. Otherwise a worker keeps the programs from case to case, and some cases are run again in new processes, to check that the programs keep no state.",
    ),
    Key::new(
        "vary",
        KeyKind::List(VARY),
        "Values that vary from case to case.",
    ),
    Key::new(
        "variants",
        KeyKind::List(VARIANT),
        "Versions that are compared on the same draws, such as control laws. Default: the scenario alone.",
    ),
    Key::new(
        "correlate",
        KeyKind::List(CORRELATE),
        "Correlations of normal and lognormal values.",
    ),
    Key::new(
        "goals",
        KeyKind::List(GOAL),
        "Goals that the campaign must meet to pass.",
    ),
];

/// `[[vary]]`.
pub(crate) const VARY: &[Key] = &[
    Key::new(
        "key",
        TEXT,
        "The value of the scenario that varies, as --set names it. Default: none, for a value that only expressions use.",
    ),
    Key::new(
        "name",
        TEXT,
        "Name in expressions and tables. Default: the last part of the key.",
    ),
    Key::new("kind", TEXT, "Kind of variation.").required(),
];

/// Kinds of `[[vary]]`.
pub(crate) const SPREADS: &[SectionKind] = &[
    SectionKind {
        name: "uniform",
        text: "Any value between min and max, equally likely.",
        keys: &[MIN, MAX, WHOLE],
    },
    SectionKind {
        name: "normal",
        text: "A normal distribution, truncated and not clamped if it is bounded.",
        keys: &[
            Key::new(
                "mean",
                number("", f64::MIN, ANY),
                "Mean of the whole distribution.",
            )
            .required(),
            Key::new(
                "deviation",
                number("", f64::MIN_POSITIVE, ANY),
                "Standard deviation of the whole distribution.",
            )
            .required(),
            CUT_MIN,
            CUT_MAX,
            WHOLE,
        ],
    },
    SectionKind {
        name: "lognormal",
        text: "A value whose logarithm has a normal distribution.",
        keys: &[
            Key::new("median", number("", f64::MIN_POSITIVE, ANY), "Median.").required(),
            Key::new(
                "sigma",
                number("1", f64::MIN_POSITIVE, 100.0),
                "Standard deviation of the natural logarithm.",
            )
            .required(),
            CUT_MIN,
            CUT_MAX,
            WHOLE,
        ],
    },
    SectionKind {
        name: "list",
        text: "One of these values, equally likely; numbers, texts, true or false.",
        keys: &[Key::new("values", KeyKind::Values, "The values, all of one type.").required()],
    },
    SectionKind {
        name: "grid",
        text: "One of several equally spaced numbers.",
        keys: &[
            MIN,
            MAX,
            Key::new(
                "points",
                integer(2, 1_000_000),
                "Number of points, both ends included.",
            )
            .required(),
            Key::new(
                "scale",
                choice(&["linear", "log"]),
                "Equal differences, or equal ratios.",
            ),
            WHOLE,
        ],
    },
    SectionKind {
        name: "expression",
        text: "Value computed from values that are varied before it.",
        keys: &[
            Key::new(
                "expression",
                TEXT,
                "Formula of the value, over the names of the other values.",
            )
            .required(),
            WHOLE,
        ],
    },
];

/// `[[variants]]`.
pub(crate) const VARIANT: &[Key] = &[
    Key::new("name", TEXT, "Name: letters, digits, - and _.").required(),
    Key::new(
        "set",
        KeyKind::Texts,
        "Scenario values of the variant, each written as for --set. Default: none.",
    ),
];

/// `[[correlate]]`.
pub(crate) const CORRELATE: &[Key] = &[
    Key::new("names", KeyKind::Texts, "Names of two varied values.").required(),
    Key::new(
        "coefficient",
        number("1", -1.0, 1.0),
        "Correlation; for lognormal values that of their logarithms, for truncated values that before the truncation.",
    )
    .required(),
];

/// `[[goals]]`.
pub(crate) const GOAL: &[Key] = &[
    Key::new(
        "requirement",
        TEXT,
        "Requirement of the scenario that the goal is about. Default: all requirements, that is, the case passes.",
    ),
    Key::new(
        "variant",
        TEXT,
        "Variant that the goal is about. Default: every variant.",
    ),
    Key::new("probability", number("1", 0.0, 1.0), "Least probability.").required(),
    Key::new(
        "confidence",
        number("1", 0.5, 0.999_999),
        "Confidence with which the probability must be shown, as a one-sided bound. Default: that of the study.",
    ),
];
