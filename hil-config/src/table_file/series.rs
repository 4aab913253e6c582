//! Choice of the columns of a table, and the check of its time base.

use shared_types::number::exact as number;
use shared_types::table::nearest;

use super::{ColumnName, Objection, Refusal, TableSource};
use crate::problem::listed;

/// Rows from which on the usual interval between them is known well enough to call a much longer one a gap.
const FEWEST_FOR_GAPS: usize = 10;
/// Usual intervals in a gap.
const GAP: f64 = 10.0;

/// Units of time with the number of seconds as a fraction.
const TIME_UNITS: [(&str, f64, f64); 6] = [
    ("s", 1.0, 1.0),
    ("ms", 1.0, 1e3),
    ("us", 1.0, 1e6),
    ("ns", 1.0, 1e9),
    ("min", 60.0, 1.0),
    ("h", 3600.0, 1.0),
];

/// Columns that a scenario asks for.
#[derive(Clone, Debug, Default)]
pub(crate) struct Choice<'a> {
    /// Column of the values; by default the only one beside the time.
    pub column: Option<&'a str>,
    /// Columns of the derivatives, in rising order.
    pub derivatives: Vec<&'a str>,
    /// Column of the time; by default the one whose name says so.
    pub time: Option<&'a str>,
    /// Longest time between two rows in s; by default ten times the median, in a file of chosen columns.
    pub gap_s: Option<f64>,
    /// Time in s that counts as 0. It is subtracted in the unit of the column, where it is often exact.
    pub start_s: f64,
}

/// Rows of the chosen columns.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Series {
    /// Names of the columns.
    pub names: Vec<ColumnName>,
    /// Times in s, strictly ascending.
    pub time_s: Vec<f64>,
    /// Values, then derivatives, in the file's units.
    pub columns: Vec<Vec<f64>>,
    /// Last row, for messages: `line 12`.
    pub last: String,
}

/// Reads the chosen columns of a file.
pub(crate) fn read(source: &mut dyn TableSource, choice: &Choice<'_>) -> Result<Series, Refusal> {
    let (time, chosen) = choose(source.columns(), choice)?;
    let names = chosen.iter().map(|&at| source.columns()[at].clone());
    let names: Vec<ColumnName> = names.collect();
    let scale = scale_of(&source.columns()[time], choice)?;
    let all: Vec<usize> = std::iter::once(time)
        .chain(chosen.iter().copied())
        .collect();

    let mut time_s: Vec<f64> = Vec::new();
    let mut columns = vec![Vec::new(); chosen.len()];
    let mut places = Places::default();
    let mut last = f64::NAN;
    let start = choice.start_s * scale.1 / scale.0;
    let unit = source.unit();
    source.read(&all, &mut |place, numbers| {
        let (row_time, values) = (numbers[0], &numbers[1..]);
        let row_time_s = (row_time - start) * scale.0 / scale.1;
        // Two times in the file may be one time in s.
        if time_s.last().is_some_and(|&last_s| row_time_s <= last_s) {
            let message = format!("time {} follows time {}", number(row_time), number(last));
            return Err(Objection::new(message, "times strictly ascending"));
        }
        last = row_time;
        places.add(time_s.len(), place);
        time_s.push(row_time_s);
        for (column, value) in columns.iter_mut().zip(values) {
            column.push(*value);
        }
        Ok(())
    })?;
    if time_s.is_empty() {
        let message = "the file has no points";
        return Err(Refusal::new(message, "a header and at least one row"));
    }
    refuse_gap(&time_s, choice, &places, unit)?;
    let last = format!("{unit} {}", places.of(time_s.len() - 1));
    Ok(Series {
        names,
        time_s,
        columns,
        last,
    })
}

/// Returns the columns of the time and of the values.
fn choose(names: &[ColumnName], choice: &Choice<'_>) -> Result<(usize, Vec<usize>), Refusal> {
    let time = match choice.time {
        Some(name) => find(names, name, "time_column")?,
        None => {
            let times = (names.iter().enumerate()).filter(|(_, column)| column.is_time());
            let mut times: Vec<usize> = times.map(|(at, _)| at).collect();
            if times.is_empty() {
                let dates = (names.iter().enumerate()).filter(|(_, column)| column.is_date);
                times = dates.map(|(at, _)| at).collect();
            }
            match times.as_slice() {
                [one] => *one,
                [] => {
                    let message = "no column is named as a time";
                    let refusal = Refusal::new(
                        message,
                        format!(
                            "a column `time`, `time_s`, `time [ms]`, `t` or `timestamp`, a column of dates, or time_column = one of {}",
                            shown(names)
                        ),
                    );
                    return Err(refusal);
                }
                [first, second, ..] => {
                    let [first, second] = [first, second].map(|&at| &names[at].name);
                    let message = format!("two time columns, `{first}` and `{second}`");
                    let expected = format!("one of them as time_column, for example \"{first}\"");
                    return Err(Refusal::new(message, expected));
                }
            }
        }
    };
    let value = match choice.column {
        Some(name) => find(names, name, "column")?,
        None => {
            let mut others = (0..names.len()).filter(|&at| at != time);
            match (others.next(), others.next()) {
                (Some(one), None) => one,
                (None, _) => {
                    let message = "the time is the only column";
                    return Err(Refusal::new(message, "a column of values beside it"));
                }
                (Some(_), Some(_)) => {
                    let others = names.iter().enumerate().filter(|(at, _)| *at != time);
                    let others = others.map(|(_, column)| column.name.as_str());
                    let count = names.len() - 1;
                    let message = format!("{count} columns beside the time");
                    let expected = format!("column = one of {}", listed(others));
                    return Err(Refusal::new(message, expected));
                }
            }
        }
    };
    let mut chosen = vec![value];
    for name in &choice.derivatives {
        chosen.push(find(names, name, "derivatives")?);
    }
    Ok((time, chosen))
}

/// Finds a column by its name in the file, or without its unit.
fn find(names: &[ColumnName], name: &str, key: &'static str) -> Result<usize, Refusal> {
    let places = |is_it: &dyn Fn(&ColumnName) -> bool| {
        let places = names.iter().enumerate().filter(|(_, column)| is_it(column));
        places.map(|(at, _)| at).collect::<Vec<usize>>()
    };
    let exact = places(&|column| column.name == name);
    let loose = places(&|column| {
        column.name.eq_ignore_ascii_case(name) || column.label.eq_ignore_ascii_case(name)
    });
    let all = if exact.is_empty() { loose } else { exact };
    match all.as_slice() {
        [one] => Ok(*one),
        [] => {
            let all = || names.iter().map(|column| column.name.as_str());
            let labels = names.iter().map(|column| column.label.as_str());
            let mut near = nearest(name, all());
            if near.is_empty() {
                let label = nearest(name, labels);
                let with_label = |column: &&ColumnName| label.contains(&column.label.as_str());
                near = names
                    .iter()
                    .filter(with_label)
                    .map(|one| one.name.as_str())
                    .collect();
            }
            Err(Refusal {
                nearest: near.into_iter().map(Into::into).collect(),
                key: Some(key),
                ..Refusal::new(
                    format!("the file has no column `{name}`"),
                    format!("one of {}", shown(names)),
                )
            })
        }
        several => {
            let several = several.iter().map(|&at| names[at].name.as_str());
            Err(Refusal {
                key: Some(key),
                ..Refusal::new(
                    format!("the file has several columns `{name}`"),
                    format!("the whole name of one: {}", listed(several)),
                )
            })
        }
    }
}

/// Lists the columns of a file, as far as a message can have them.
fn shown(names: &[ColumnName]) -> String {
    const MOST: usize = 30;
    let listing = listed(names.iter().take(MOST).map(|column| column.name.as_str()));
    match names.len().saturating_sub(MOST) {
        0 => listing,
        more => format!("{listing} and {more} more"),
    }
}

/// Returns the unit of a time column as a fraction of seconds.
fn scale_of(time: &ColumnName, choice: &Choice<'_>) -> Result<(f64, f64), Refusal> {
    let unit = time.unit.as_deref().unwrap_or("s");
    let known = TIME_UNITS.iter().find(|(symbol, ..)| *symbol == unit);
    known
        .map(|(_, above, below)| (*above, *below))
        .ok_or_else(|| {
            let units = listed(TIME_UNITS.iter().map(|(symbol, ..)| *symbol));
            Refusal {
                key: choice.time.map(|_| "time_column"),
                ..Refusal::new(
                    format!(
                        "the time column `{}` is in {unit}, which is no unit of time",
                        time.name
                    ),
                    format!("one of {units}, as in `time [ms]`, or no unit for s"),
                )
            }
        })
}

/// Refuses two rows that are much further apart than the others.
fn refuse_gap(
    time_s: &[f64],
    choice: &Choice<'_>,
    places: &Places,
    unit: &str,
) -> Result<(), Refusal> {
    let intervals = || time_s.windows(2).map(|pair| pair[1] - pair[0]);
    let mut usual = String::new();
    let longest_s = match choice.gap_s {
        Some(gap_s) => gap_s,
        None if choice.column.is_none() || time_s.len() < FEWEST_FOR_GAPS => return Ok(()),
        None => {
            let mut all: Vec<f64> = intervals().collect();
            let middle = all.len() / 2;
            let (_, median_s, _) = all.select_nth_unstable_by(middle, f64::total_cmp);
            usual = format!(", where the others are {} s apart", number(*median_s));
            GAP * *median_s
        }
    };
    let Some(at) = intervals().position(|interval_s| interval_s > longest_s) else {
        return Ok(());
    };
    let (from, to) = (time_s[at], time_s[at + 1]);
    let message = format!(
        "{unit} {} and {unit} {} are {} s apart, from {} to {} s{usual}",
        places.of(at),
        places.of(at + 1),
        number(to - from),
        number(from),
        number(to)
    );
    let expected = format!(
        "rows without a gap, or gap_s = {} to permit it",
        number(to - from)
    );
    Err(Refusal::new(message, expected))
}

/// Numbers of rows in a file; stored only where they are not consecutive.
#[derive(Clone, Debug, Default)]
struct Places(Vec<(usize, usize)>);

impl Places {
    fn add(&mut self, row: usize, place: usize) {
        let follows = |&(first, at): &(usize, usize)| row - first == place - at;
        if !self.0.last().is_some_and(follows) {
            self.0.push((row, place));
        }
    }

    fn of(&self, row: usize) -> usize {
        let after = self.0.partition_point(|(first, _)| *first <= row);
        let (first, place) = self.0[after - 1];
        place + row - first
    }
}
