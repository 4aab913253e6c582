//! Points over time, of a stimulus or a profile of kind `table`: a CSV file, or two lists in the
//! scenario itself.

use std::path::Path;

use shared_types::number::exact as number;

use super::csv;
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};

/// Times in s, strictly rising, and as many values.
pub(super) type Points = (Vec<f64>, Vec<f64>);

/// Layout of a file of points.
const FILE: csv::Layout = csv::Layout {
    header: Some("time_s,value"),
    columns: 2,
    row: "point",
};

/// The points of a section, which is that of `what`. Without a folder files are refused.
pub(super) fn check(
    reader: &mut Reader,
    section: &Section<'_>,
    folder: Option<&Path>,
    what: &str,
) -> Option<Points> {
    let inline = ["time_s", "values"].map(|key| section.table.get(key));
    match (section.table.get("file"), inline) {
        (Some(_), [None, None]) => file(reader, section, folder),
        (None, [Some(times), Some(values)]) => {
            let time_s = reader.numbers(&section.path_of("time_s"), &times.node);
            let values = reader.numbers(&section.path_of("values"), &values.node);
            lists(reader, section, time_s?, values?)
        }
        _ => {
            let path = section.path_of("file");
            let message = format!("{what} of kind `table` needs its points once");
            reader
                .report(
                    ProblemKind::Mismatch,
                    path,
                    section.place_of("kind"),
                    message,
                )
                .expected("either `file`, or both `time_s` and `values`");
            None
        }
    }
}

fn lists(
    reader: &mut Reader,
    section: &Section<'_>,
    time_s: Vec<f64>,
    values: Vec<f64>,
) -> Option<Points> {
    let (times, count) = (time_s.len(), values.len());
    let falling = time_s.windows(2).position(|pair| pair[1] <= pair[0]);
    let message = if times != count {
        format!("{times} times and {count} values")
    } else if times == 0 {
        "no points".into()
    } else if let Some(index) = falling {
        follows(time_s[index + 1], time_s[index])
    } else {
        return Some((time_s, values));
    };
    reader
        .report_at(section, "time_s", ProblemKind::Mismatch, message)
        .expected("at least one point, times strictly rising, as many values as times");
    None
}

fn file(reader: &mut Reader, section: &Section<'_>, folder: Option<&Path>) -> Option<Points> {
    let (mut time_s, mut values): Points = (Vec::new(), Vec::new());
    csv::read(reader, section, folder, &FILE, |row| {
        let (time, value) = (row[0], row[1]);
        if let Some(&last) = time_s.last()
            && time <= last
        {
            return Err((follows(time, last), "times strictly rising"));
        }
        time_s.push(time);
        values.push(value);
        Ok(())
    })?;
    Some((time_s, values))
}

fn follows(time: f64, last: f64) -> String {
    format!("time {} follows time {}", number(time), number(last))
}
