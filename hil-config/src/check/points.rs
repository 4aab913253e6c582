//! Points over time, of a stimulus or a profile of kind `table`: a file, or two lists in the scenario itself.

use shared_types::number::exact as number;

use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};

/// Times in s, strictly ascending, and as many values.
pub(super) type Points = (Vec<f64>, Vec<f64>);

/// Returns points that stand in the scenario, in a section that describes `what`.
pub(super) fn lists(reader: &mut Reader, section: &Section<'_>, what: &str) -> Option<Points> {
    let inline = ["time_s", "values"].map(|key| section.table.get(key));
    if let (None, [Some(times), Some(values)]) = (section.table.get("file"), inline) {
        let time_s = reader.numbers(&section.path_of("time_s"), &times.node);
        let values = reader.numbers(&section.path_of("values"), &values.node);
        return fitting(reader, section, time_s?, values?);
    }
    let path = section.path_of("file");
    let message = format!("{what} of kind `table` must define its points in exactly one way");
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

/// Time span in which a table has an effect: from 0 to an end, on the table's own scale.
pub(super) struct Span {
    end_s: f64,
    /// Description of the span, to follow "the table goes from 3 to 4 s and".
    words: String,
}

impl Span {
    /// Returns the span of a run that ends at a time.
    pub(super) fn of_run(end_s: f64) -> Self {
        let words = format!("the run from 0 to {} s", number(end_s));
        Self { end_s, words }
    }

    /// Returns the span of an effect that begins at most `left_s` before the end of the run.
    pub(super) fn of_effect(left_s: f64) -> Self {
        let words = format!(
            "counts from the beginning of the effect, after which the run lasts for at most {} s",
            number(left_s)
        );
        Self {
            end_s: left_s,
            words,
        }
    }
}

/// Refuses a table that begins after the end of a span or ends before its beginning: it would be a constant.
pub(super) fn refuse_outside(
    reader: &mut Reader,
    section: &Section<'_>,
    time_s: &[f64],
    span: &Span,
) -> Option<()> {
    let (&first, &last) = (time_s.first()?, time_s.last()?);
    if first <= span.end_s && last >= 0.0 {
        return Some(());
    }
    let key = match section.table.get("file") {
        Some(_) => "file",
        None => "time_s",
    };
    let message = format!(
        "the table goes from {} to {} s and {}, so it has no effect",
        number(first),
        number(last),
        span.words
    );
    reader
        .report_at(section, key, ProblemKind::OutOfRange, message)
        .expected("times that overlap the run; before its first point a table keeps the first value, and after its last point the last value");
    None
}

fn fitting(
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
        .expected("at least one point, times strictly ascending, and as many values as times");
    None
}

fn follows(time: f64, last: f64) -> String {
    format!("time {} follows time {}", number(time), number(last))
}
