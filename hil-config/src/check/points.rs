//! The points of a stimulus of kind `table`: a CSV file, or two lists in the scenario itself.

use crate::plan::Waveform;
use crate::problem::ProblemKind;
use crate::quantity::number;
use crate::reader::{Reader, Section};
use crate::scenario::Scenario;
use crate::source::Place;

/// The first line of a file of points.
const HEADER: &str = "time_s,value";

pub(super) fn check(
    reader: &mut Reader,
    section: &Section<'_>,
    scenario: &Scenario,
) -> Option<Waveform> {
    let inline = ["time_s", "values"].map(|key| section.table.get(key));
    match (section.table.get("file"), inline) {
        (Some(_), [None, None]) => file(reader, section, scenario),
        (None, [Some(times), Some(values)]) => {
            let time_s = reader.numbers(&section.path_of("time_s"), &times.node);
            let values = reader.numbers(&section.path_of("values"), &values.node);
            lists(reader, section, time_s?, values?)
        }
        _ => {
            let path = section.path_of("file");
            let message = "a stimulus of kind `table` needs its points once";
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
) -> Option<Waveform> {
    let (times, count) = (time_s.len(), values.len());
    let falling = time_s.windows(2).position(|pair| pair[1] <= pair[0]);
    let message = if times != count {
        format!("{times} times and {count} values")
    } else if times == 0 {
        "no points".into()
    } else if let Some(index) = falling {
        format!(
            "time {} follows time {}",
            number(time_s[index + 1]),
            number(time_s[index])
        )
    } else {
        return Some(Waveform::Table { time_s, values });
    };
    let path = section.path_of("time_s");
    reader
        .report(
            ProblemKind::Mismatch,
            path,
            section.place_of("time_s"),
            message,
        )
        .expected("at least one point, times strictly rising, as many values as times");
    None
}

fn file(reader: &mut Reader, section: &Section<'_>, scenario: &Scenario) -> Option<Waveform> {
    let name = reader.text(section, "file")?;
    let key = section.path_of("file");
    let path = match scenario.path.parent() {
        Some(folder) => folder.join(name),
        None => name.into(),
    };
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) => {
            let message = format!("`{}` cannot be read: {error}", path.display());
            reader
                .report(
                    ProblemKind::Unreadable,
                    key,
                    section.place_of("file"),
                    message,
                )
                .expected(format!("a CSV file with the header {HEADER}"));
            return None;
        }
    };
    let source = reader.sources.add(path.display().to_string(), text.clone());
    match read(&text) {
        Ok((time_s, values)) => Some(Waveform::Table { time_s, values }),
        Err(BadLine {
            start,
            length,
            message,
            expected,
        }) => {
            let place = Place {
                source,
                span: start..start + length,
            };
            reader
                .report(ProblemKind::Syntax, key, &place, message)
                .expected(expected);
            None
        }
    }
}

/// What is wrong with a line and where it stands.
struct BadLine {
    start: usize,
    length: usize,
    message: String,
    expected: &'static str,
}

/// The times and values of a CSV text. The first bad line ends the reading: a file of another kind
/// would otherwise give thousands of messages.
fn read(text: &str) -> Result<(Vec<f64>, Vec<f64>), BadLine> {
    let (mut time_s, mut values): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    let mut has_header = false;
    let mut start = 0;
    for line in text.split_inclusive('\n') {
        let content = line.trim();
        let bad = |message: String, expected| BadLine {
            start,
            length: line.trim_end().len(),
            message,
            expected,
        };
        if content.is_empty() || content.starts_with('#') {
            // Nothing to read.
        } else if !has_header {
            let columns: Vec<&str> = content.split(',').map(str::trim).collect();
            if columns.join(",") != HEADER {
                return Err(bad("not the header of a table of points".into(), HEADER));
            }
            has_header = true;
        } else {
            let point = match content.split(',').collect::<Vec<_>>()[..] {
                [time, value] => finite(time).zip(finite(value)),
                _ => None,
            };
            let Some((time, value)) = point else {
                return Err(bad(
                    "not a point".into(),
                    "two finite numbers, time_s,value",
                ));
            };
            if let Some(&last) = time_s.last()
                && time <= last
            {
                let message = format!("time {} follows time {}", number(time), number(last));
                return Err(bad(message, "times strictly rising"));
            }
            time_s.push(time);
            values.push(value);
        }
        start += line.len();
    }
    if time_s.is_empty() {
        return Err(BadLine {
            start,
            length: 0,
            message: "the file has no points".into(),
            expected: "the header time_s,value and at least one point",
        });
    }
    Ok((time_s, values))
}

fn finite(text: &str) -> Option<f64> {
    text.trim()
        .parse()
        .ok()
        .filter(|value: &f64| value.is_finite())
}
