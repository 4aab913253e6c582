//! Names of columns with their units, as programs write them: `angle [deg]`, `angle (deg)`, `angle_deg`.

use shared_types::table::unit_of_name;

/// Name of a column, split from its unit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ColumnName {
    /// Name as in the file.
    pub name: String,
    /// Name without its unit.
    pub label: String,
    /// Unit in the name, or stored beside it.
    pub unit: Option<String>,
    /// `true` if the column has dates, read as the seconds since the first row.
    pub is_date: bool,
}

/// Labels of time columns, in small letters.
const TIMES: [&str; 6] = ["time", "t", "timestamp", "seconds", "sec", "log_time"];

/// Units of time that only names of time columns end with.
const TIME_ENDINGS: [&str; 6] = ["s", "ms", "us", "ns", "min", "h"];

impl ColumnName {
    /// Splits a name.
    #[must_use]
    pub fn of(name: &str) -> Self {
        let name = name.trim();
        for (open, close) in [('[', ']'), ('(', ')')] {
            let inner = name
                .strip_suffix(close)
                .and_then(|rest| rest.split_once(open));
            if let Some((label, unit)) = inner.filter(|_| !is_element(name)) {
                return Self {
                    name: name.into(),
                    label: label.trim().into(),
                    unit: Some(spelt(unit.trim())),
                    is_date: false,
                };
            }
        }
        let ending = name
            .rsplit_once('_')
            .map(|(label, ending)| (label, ending, ending));
        let time =
            ending.filter(|(label, ending, _)| is_time(label) && TIME_ENDINGS.contains(ending));
        let unit = ending.and_then(|(label, _, _)| Some((label, "", unit_of_name(name)?)));
        match time.or(unit) {
            Some((label, _, unit)) => Self {
                name: name.into(),
                label: label.into(),
                unit: Some(unit.into()),
                is_date: false,
            },
            None => Self {
                name: name.into(),
                label: name.into(),
                unit: None,
                is_date: false,
            },
        }
    }

    /// Creates the name of a column whose unit is stored beside it.
    #[must_use]
    pub fn with_unit(name: &str, unit: &str) -> Self {
        let split = Self::of(name);
        match unit {
            "" => split,
            unit => Self {
                unit: Some(unit.into()),
                ..split
            },
        }
    }

    /// Returns `true` if the name is that of a time.
    #[must_use]
    pub fn is_time(&self) -> bool {
        is_time(&self.label)
    }
}

/// Returns `true` if a name ends with the index of an element, as `position[1]`; `ratio [1]` has the unit 1.
fn is_element(name: &str) -> bool {
    let inner = name
        .strip_suffix(']')
        .and_then(|rest| rest.rsplit_once('['));
    inner.is_some_and(|(label, index)| {
        let is_index = !index.is_empty() && index.bytes().all(|c| c.is_ascii_digit());
        is_index && !label.is_empty() && !label.ends_with(char::is_whitespace)
    })
}

fn is_time(label: &str) -> bool {
    TIMES.iter().any(|time| label.eq_ignore_ascii_case(time))
}

/// Spells a unit as in scenarios.
fn spelt(unit: &str) -> String {
    let unit = unit.replace('°', "deg").replace(['µ', 'μ'], "u");
    let unit = unit.replace('^', "").replace('²', "2").replace('³', "3");
    match unit.as_str() {
        "-" | "" => "1".into(),
        "sec" => "s".into(),
        _ => unit,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_stands_in_brackets_or_at_the_end() {
        let split = |name: &str| {
            let split = ColumnName::of(name);
            (split.label, split.unit.unwrap_or_default())
        };
        for (name, label, unit) in [
            ("angle [deg]", "angle", "deg"),
            ("angle (deg)", "angle", "deg"),
            (" angle[°/s] ", "angle", "deg/s"),
            ("angle_deg", "angle", "deg"),
            ("f(x) [N]", "f(x)", "N"),
            ("accel [m/s^2]", "accel", "m/s2"),
            ("T [°C]", "T", "degC"),
            ("time_ms", "time", "ms"),
            ("Time (ms)", "Time", "ms"),
            ("timestamp_ns", "timestamp", "ns"),
            ("gain [-]", "gain", "1"),
            ("ratio [1]", "ratio", "1"),
            // Elements of arrays.
            ("v[1]", "v[1]", ""),
            ("/thing.position[1]", "/thing.position[1]", ""),
            ("/thing.position[12]", "/thing.position[12]", ""),
            ("value", "value", ""),
            (
                "reference.surface_angle_rad",
                "reference.surface_angle",
                "rad",
            ),
        ] {
            assert_eq!(split(name), (label.into(), unit.into()), "{name}");
        }
    }
}
