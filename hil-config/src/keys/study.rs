//! Keys of a study, the file of a campaign.

use super::{
    Key, KeyKind, LENGTH, MAX_S, SectionKind, TEXT, VERSION, choice, integer, integer_or, number,
    number_or,
};

/// Maximum number of cases in a campaign.
pub(crate) const MOST_CASES: i64 = 100_000_000;

/// Default of `tolerance` in `[search]`.
pub(crate) const TOLERANCE: f64 = 0.01;
/// Default of `probes` in `[search]`.
pub(crate) const PROBES: i64 = 3;
/// Default of `runs` in `[search]`.
pub(crate) const RUNS: i64 = 300;

const ANY: f64 = f64::MAX;

const MIN: Key = key! { min!: number("", f64::MIN, ANY), "Smallest value." };
const MAX: Key = key! { max!: number("", f64::MIN, ANY), "Largest value." };
const CUT_MIN: Key = key! {
    min: number("", f64::MIN, ANY), "Smallest value; the distribution is truncated there. Default: none."
};
const CUT_MAX: Key = key! {
    max: number("", f64::MIN, ANY), "Largest value; the distribution is truncated there. Default: none."
};

const WHOLE: Key = key! {
    whole: KeyKind::Boolean { default: false },
        "Only whole numbers, for keys that take no others. `uniform` gives each one from min to max equally often; `normal`, `lognormal` and `expression` are rounded to the nearest, halves away from zero; the points of a `grid` must be whole as they are."
};

/// The whole study.
pub(crate) const STUDY: &[Key] = keys! {
    ..VERSION;
    name: TEXT, "Name of the study: letters, digits, - and _. Default: the file's name.";
    description: TEXT, "Question that the study answers.";
    scenario!: TEXT, "The scenario, relative to the study.";
    set: KeyKind::Texts, "Scenario values that are changed for every case, each written as for --set.";
    cases: integer(1, MOST_CASES),
        "Number of draws; each draw is one case of every variant. A grid has one draw for each of its points. Required, except for a grid and in a study with [search].";
    seed: integer_or(0, i64::MAX, 1),
        "Seed of the draws and of run.seed in each case, which is drawn too unless the study sets or varies it.";
    sampling: choice(&["independent", "latin-hypercube", "sobol", "grid", "saltelli"]),
        "Method of drawing values: independent draws give probabilities with bounds; a Latin hypercube and Sobol' points cover the space more evenly but give no such probabilities; a grid takes all combinations of lists and ranges; Saltelli's scheme gives Sobol' indices, the share of a margin's variance that each value explains, for as many draws as `cases` times the number of values and 2.";
    confidence: number_or("1", 0.5, 0.999_999, 0.95), "Confidence of the bounds.";
    case_limit_s: number_or("s", 0.1, 1e6, 600.0),
        "Time after which a case counts as hung; its worker ends and another worker retries the case.";
    wait_limit_s: number_or("s", 0.1, 1e6, 5.0),
        "Time that a side of a case may take to answer, as --wait-limit of hil run. To describe itself, to check its job and to start, a program may always take 10 s.";
    fresh_processes: KeyKind::Boolean { default: false },
        "Restart the campaign's own programs for each case. Otherwise a worker keeps the programs from case to case, and some cases are run again in new processes, to check that the programs keep no state.";
    vary: KeyKind::List(VARY), "Values that vary from case to case.";
    variants: KeyKind::List(VARIANT),
        "Versions that are compared on the same draws, such as control laws. Default: the scenario alone.";
    correlate: KeyKind::List(CORRELATE), "Correlations of normal and lognormal values.";
    goals: KeyKind::List(GOAL), "Goals that the campaign must meet to pass.";
    search: KeyKind::Section(SEARCH), "Settings of hil search.";
    faults: KeyKind::Section(FAULTS),
        "Faults of which each is tried alone in every variant: the campaign shows a table of faults by outcomes. Sampling is a grid.";
};

/// `[[vary]]`.
pub(crate) const VARY: &[Key] = keys! {
    key: TEXT,
        "The value of the scenario that varies, as --set names it. Default: none, for a value that only expressions use.";
    name: TEXT, "Name in expressions and tables. Default: the last part of the key.";
    kind!: TEXT, "Kind of variation.";
    nominal: number("", f64::MIN, ANY),
        "Value from which hil search measures distances. Default: the smallest value of a uniform range, the mean or median of another.";
};

/// Kinds of `[[vary]]`.
pub(crate) const SPREADS: &[SectionKind] = kinds! {
    "uniform": "Any value between min and max, equally likely." {
        ..MIN;
        ..MAX;
        ..WHOLE;
    }
    "normal": "A normal distribution, truncated and not clamped if it is bounded." {
        mean!: number("", f64::MIN, ANY), "Mean of the whole distribution.";
        deviation!: number("", f64::MIN_POSITIVE, ANY), "Standard deviation of the whole distribution.";
        ..CUT_MIN;
        ..CUT_MAX;
        ..WHOLE;
    }
    "lognormal": "A value whose logarithm has a normal distribution." {
        median!: number("", f64::MIN_POSITIVE, ANY), "Median.";
        sigma!: number("1", f64::MIN_POSITIVE, 100.0), "Standard deviation of the natural logarithm.";
        ..CUT_MIN;
        ..CUT_MAX;
        ..WHOLE;
    }
    "list": "One of these values, equally likely; numbers, texts, true or false." {
        values!: KeyKind::Values, "The values, all of one type.";
    }
    "grid": "One of several equally spaced numbers." {
        ..MIN;
        ..MAX;
        points!: integer(2, 1_000_000), "Number of points, both ends included.";
        scale: choice(&["linear", "log"]), "Equal differences, or equal ratios.";
        ..WHOLE;
    }
    "expression": "Value computed from values that are varied before it." {
        expression!: TEXT, "Formula of the value, over the names of the other values.";
        ..WHOLE;
    }
};

/// `[[variants]]`.
pub(crate) const VARIANT: &[Key] = keys! {
    name!: TEXT, "Name: letters, digits, - and _.";
    set: KeyKind::Texts, "Scenario values of the variant, each written as for --set. Default: none.";
    detected: TEXT,
        "Alarm of this variant in place of that of `[faults]`; `none` for a law without an alarm.";
};

/// `[[correlate]]`.
pub(crate) const CORRELATE: &[Key] = keys! {
    names!: KeyKind::Texts, "Names of two varied values.";
    coefficient!: number("1", -1.0, 1.0),
        "Correlation; for lognormal values that of their logarithms, for truncated values that before the truncation.";
};

/// `[[goals]]`.
pub(crate) const GOAL: &[Key] = keys! {
    requirement: TEXT,
        "Requirement of the scenario that the goal is about. Default: all requirements, that is, the case passes.";
    variant: TEXT, "Variant that the goal is about. Default: every variant.";
    probability!: number("1", 0.0, 1.0), "Least probability.";
    confidence: number("1", 0.5, 0.999_999),
        "Confidence with which the probability must be shown, as a one-sided bound. Default: that of the study.";
};

/// `[search]`.
pub(crate) const SEARCH: &[Key] = keys! {
    requirement: TEXT, "Requirement whose failure is searched. Default: any.";
    variant: TEXT, "Variant that is searched. Required if there are several.";
    tolerance: number_or("1", 1e-9, 0.5, TOLERANCE),
        "Largest distance between the failing point and its passing neighbour, as a share of the range.";
    probes: integer_or(0, 1000, PROBES),
        "Sizes between both ends that are tried before bisection, to see that everything fails beyond the first failure.";
    runs: integer_or(2, 1_000_000, RUNS), "Largest number of runs.";
};

/// `[faults]`.
pub(crate) const FAULTS: &[Key] = keys! {
    onsets_s: KeyKind::Numbers, "Times at which each fault takes effect. Default: each kind has its own.";
    detected: TEXT, "Alarm: expression that holds while the law sees a fault. Default: nothing is detected.";
    held_s: number_or("s", 0.0, MAX_S, 0.01), "Time that the alarm must hold to count.";
    recovered: TEXT,
        "Expression that holds while the fault is overcome; the recovery is the step from which it holds to the end.";
    kinds!: KeyKind::List(FAULT_KIND), "Kinds of faults that are tried; the others are rows of the table, too.";
};

/// `[[faults.kinds]]`.
pub(crate) const FAULT_KIND: &[Key] = keys! {
    kind!: TEXT, "Kind of fault: one of the plant's own, or one on signals, links or timing.";
    targets: KeyKind::Texts,
        "Targets: names as in `target` of an effect, or the key of a part of the plant, such as `actuator = 1`. Default: every target on which the kind can act, except parameters.";
    sizes: KeyKind::Texts,
        "Sizes: each the keys of an effect as TOML, such as `bias = 0.01`. Default: one without keys, for a kind that has no size.";
    onsets_s: KeyKind::Numbers, "Times at which these faults take effect. Default: those of `[faults]`.";
    duration_s: LENGTH, "Time that each fault acts. Default: it stays.";
};
