//! Keys of tables over time: of a stimulus, and of a derived signal that is a column of a file.

use super::{Key, KeyKind, LENGTH, TEXT, choice, number_or};

const FILE: Key = key! {
    file: TEXT,
        "File with a column of times, relative to the scenario: CSV, Parquet, an MCAP recording of hil or of ROS 2, or the points that a run has kept."
};
const COLUMN: Key = key! {
    column: TEXT, "Column of the values, with or without its unit. Default: the only column beside the time."
};
const TIME_COLUMN: Key = key! {
    time_column: TEXT,
        "Column of the times, in s or in the unit that its name ends with: s, ms, us, ns, min, h. Default: the column named time, t or timestamp."
};
const DERIVATIVES: Key = key! {
    derivatives: KeyKind::Texts,
        "Columns of the first to at most the fifth time derivative, which are sent with the signal. Default: the derivatives of the interpolation."
};
const GAP_S: Key = key! {
    gap_s: LENGTH,
        "Longest time between two rows. Default: ten times the median, if `column` is given; else no limit."
};
const INTERPOLATION: Key = key! {
    interpolation: choice(&["linear", "hold", "cubic"]),
        "Course between two rows: linear is a straight line, which has a first derivative; hold is the earlier row, which has none; cubic is a spline with a continuous second derivative, which has five."
};
const REPEAT: Key = key! {
    repeat: KeyKind::Boolean { default: false },
        "true: the table begins anew at its last row, which is the first one of the next pass."
};
const END: Key = key! {
    end: choice(&["hold", "zero"]),
        "Course after the last row: hold is the last value, zero is 0. Required if `column` is given and the file ends before the run."
};
const SCALE: Key = key! {
    scale: number_or("", f64::MIN, f64::MAX, 1.0),
        "Factor of the values, once they are in the unit of the signal. A column in a unit that is not known is converted by it alone."
};
const OFFSET: Key = key! {
    offset: number_or("", f64::MIN, f64::MAX, 0.0), "Added to the scaled values."
};
const START_S: Key = key! {
    start_s: number_or("s", f64::MIN, f64::MAX, 0.0), "Time of the table at which the run begins."
};

/// Keys that belong to a file.
pub(crate) const TABLE_FILE: &[Key] = keys! {
    ..FILE;
    ..COLUMN;
    ..TIME_COLUMN;
    ..DERIVATIVES;
    ..GAP_S;
};

/// A stimulus of kind `table`.
pub(crate) const TABLE: &[Key] = keys! {
    ..FILE;
    ..COLUMN;
    ..TIME_COLUMN;
    ..DERIVATIVES;
    ..GAP_S;
    time_s: KeyKind::Numbers, "Times, strictly ascending, in place of a file.";
    values: KeyKind::Numbers, "Values, as many as times.";
    values_d1: KeyKind::Numbers, "First derivative of the values.";
    values_d2: KeyKind::Numbers, "Second derivative of the values.";
    values_d3: KeyKind::Numbers, "Third derivative of the values.";
    values_d4: KeyKind::Numbers, "Fourth derivative of the values.";
    values_d5: KeyKind::Numbers, "Fifth derivative of the values.";
    ..INTERPOLATION;
    ..REPEAT;
    ..END;
    ..SCALE;
    ..OFFSET;
    ..START_S;
};

/// `[[derived]]`.
pub(crate) const DERIVED: &[Key] = keys! {
    name!: TEXT, "Name, its unit at the end.";
    unit: TEXT,
        "Unit. Default: the unit that the name's ending stands for, else that of the expression or the column, else 1.";
    expression: TEXT,
        "Value at a step, from signals (truth.x, measured.x, reference.x, command.x, applied.x, internal.x, input.x, sensed.x, stimulus.x, parameter.x) and earlier derived signals.";
    ..FILE;
    ..COLUMN;
    ..TIME_COLUMN;
    ..GAP_S;
    time_s: KeyKind::Numbers, "Times, strictly ascending, in place of an expression or a file.";
    values: KeyKind::Numbers, "Values, as many as times.";
    ..INTERPOLATION;
    ..REPEAT;
    ..END;
    ..SCALE;
    ..OFFSET;
    ..START_S;
};
