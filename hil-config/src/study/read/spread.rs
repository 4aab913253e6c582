//! Spreads of the varied values: distributions, lists, grids and expressions.

use shared_types::number::counted;

use super::super::{Item, Spread};
use crate::document::Value;
use crate::expression::{Columns, Expression};
use crate::problem::{ProblemKind, listed};
use crate::reader::{Reader, Section};
use crate::source::Place;

/// Largest whole number up to which a 64-bit float distinguishes consecutive whole numbers.
const MOST_WHOLE: f64 = (1_u64 << 53) as f64;

pub(super) fn spread(
    reader: &mut Reader,
    own: &Section<'_>,
    kind: &str,
    columns: &Columns,
) -> Option<Spread> {
    match kind {
        "uniform" => {
            let [min, max] = rising(reader, own)?;
            Some(Spread::Uniform { min, max })
        }
        "normal" | "lognormal" => {
            let (first, second) = match kind {
                "normal" => ("mean", "deviation"),
                _ => ("median", "sigma"),
            };
            let (first, second) = (reader.number(own, first), reader.number(own, second));
            let within = bounds(reader, own)?;
            if kind == "lognormal" && within[1] <= 0.0 {
                reader
                    .report_at(
                        own,
                        "max",
                        ProblemKind::OutOfRange,
                        "a lognormal value is above 0, but `max` is not",
                    )
                    .expected("max above 0");
                return None;
            }
            Some(match kind {
                "normal" => Spread::Normal {
                    mean: first?,
                    deviation: second?,
                    within,
                },
                _ => Spread::Lognormal {
                    median: first?,
                    sigma: second?,
                    within,
                },
            })
        }
        "list" => values(reader, own).map(Spread::Choice),
        "grid" => grid(reader, own).map(Spread::Choice),
        _ => expression(reader, own, columns).map(Spread::Expression),
    }
}

/// Refuses fractional bounds and points where only whole numbers are valid.
pub(super) fn whole(
    reader: &mut Reader,
    own: &Section<'_>,
    spread: Spread,
    is_whole: bool,
) -> Option<Spread> {
    if !is_whole {
        return Some(spread);
    }
    let is_one = |value: f64| value == libm::round(value) && value.abs() <= MOST_WHOLE;
    match spread {
        Spread::Uniform { min, max }
        | Spread::Normal {
            within: [min, max], ..
        }
        | Spread::Lognormal {
            within: [min, max], ..
        } => {
            for (key, bound) in [("min", min), ("max", max)] {
                if bound.is_finite() && !is_one(bound) {
                    let path = own.path_of(key);
                    let message = format!("`{path}` is {bound}, but only whole numbers are valid");
                    reader
                        .report_at(own, key, ProblemKind::OutOfRange, message)
                        .expected("a whole number that a 64-bit float represents exactly");
                    return None;
                }
            }
            Some(spread)
        }
        Spread::Choice(points) => {
            let mut items = Vec::with_capacity(points.len());
            for point in points {
                let Item::Number(value, text) = &point else {
                    return None;
                };
                // Equal ratios may miss a whole number in the last bits.
                let nearest = libm::round(*value);
                if (value - nearest).abs() > 1e-12 * nearest.abs() || !is_one(nearest) {
                    let message =
                        format!("a point of the grid is {text}, but only whole numbers are valid");
                    reader
                        .report_at(own, "points", ProblemKind::OutOfRange, message)
                        .help("choose points at whole-number distances, or write a list");
                    return None;
                }
                items.push(Item::Number(nearest, format!("{:.0}", nearest + 0.0)));
            }
            Some(Spread::Choice(items))
        }
        Spread::Expression(_) => Some(spread),
    }
}

/// Returns the range of a section, which must have one.
fn rising(reader: &mut Reader, own: &Section<'_>) -> Option<[f64; 2]> {
    let (min, max) = (reader.number(own, "min"), reader.number(own, "max"));
    let range = [min?, max?];
    ordered(reader, own, range)
}

/// Returns the truncation range of a distribution, if any.
fn bounds(reader: &mut Reader, own: &Section<'_>) -> Option<[f64; 2]> {
    let mut range = [f64::NEG_INFINITY, f64::INFINITY];
    for (key, bound) in ["min", "max"].into_iter().zip(&mut range) {
        if own.table.get(key).is_some() {
            *bound = reader.number(own, key)?;
        }
    }
    ordered(reader, own, range)
}

fn ordered(reader: &mut Reader, own: &Section<'_>, [min, max]: [f64; 2]) -> Option<[f64; 2]> {
    if min < max {
        return Some([min, max]);
    }
    let path = own.path_of("min");
    reader
        .report_at(
            own,
            "min",
            ProblemKind::OutOfRange,
            format!("`{path}` is not below max"),
        )
        .expected("min below max");
    None
}

fn values(reader: &mut Reader, own: &Section<'_>) -> Option<Vec<Item>> {
    let path = own.path_of("values");
    let expected = "a list of numbers, of texts, or of true and false";
    let Some(entry) = own.table.get("values") else {
        reader.missing(own, &path, expected.into());
        return None;
    };
    let Value::List(nodes) = &entry.node.value else {
        reader.wrong_type(&path, &entry.node, expected);
        return None;
    };
    let mut items: Vec<Item> = Vec::new();
    for (index, node) in nodes.iter().enumerate() {
        let path = format!("{path}[{index}]");
        let text = || reader_text(reader, &node.place);
        let item = match &node.value {
            Value::Integer(number) => Item::Number(*number as f64, text()),
            Value::Float(number) if number.is_finite() => Item::Number(*number, text()),
            Value::Text(text) => Item::Text(text.clone()),
            Value::Boolean(value) => Item::Flag(*value),
            _ => {
                reader.wrong_type(&path, node, expected);
                return None;
            }
        };
        let is_other =
            |first: &Item| std::mem::discriminant(first) != std::mem::discriminant(&item);
        if items.first().is_some_and(is_other) {
            reader.wrong_type(&path, node, "a value of the same type as the first");
            return None;
        }
        if items.contains(&item) {
            let message = format!("`{path}` is a duplicate");
            reader.report(ProblemKind::Duplicate, path, &node.place, message);
            return None;
        }
        items.push(item);
    }
    if items.len() < 2 {
        let message = format!(
            "`{path}` has {}, so nothing varies",
            counted(items.len() as u64, "value")
        );
        reader
            .report_at(own, "values", ProblemKind::OutOfRange, message)
            .expected("at least two values");
        return None;
    }
    Some(items)
}

fn reader_text(reader: &Reader, place: &Place) -> String {
    reader.sources.text(place).into()
}

fn grid(reader: &mut Reader, own: &Section<'_>) -> Option<Vec<Item>> {
    let [min, max] = rising(reader, own)?;
    let points = reader.integer(own, "points")?;
    let is_log = reader.text(own, "scale")? == "log";
    if is_log && min <= 0.0 {
        reader
            .report_at(
                own,
                "min",
                ProblemKind::OutOfRange,
                "equal ratios cannot start at 0 or below",
            )
            .expected("min above 0, or scale = \"linear\"");
        return None;
    }
    let point = |index: i64| {
        let share = index as f64 / (points - 1) as f64;
        let value = match (index, is_log) {
            (0, _) => min,
            (last, _) if last == points - 1 => max,
            (_, true) => min * libm::pow(max / min, share),
            (_, false) => min + (max - min) * share,
        };
        Item::Number(value, format!("{value:?}"))
    };
    Some((0..points).map(point).collect())
}

fn expression(reader: &mut Reader, own: &Section<'_>, columns: &Columns) -> Option<Expression> {
    let text = reader.text(own, "expression")?;
    let parsed = Expression::parse(text).and_then(|parsed| {
        parsed.refuse_reduction()?;
        Ok(parsed)
    });
    let (expression, errors) = match parsed {
        Ok(parsed) => {
            let unknown = parsed.unknown_names(columns);
            (Some(parsed), unknown)
        }
        Err(error) => (None, vec![error]),
    };
    let is_known = errors.is_empty();
    for error in errors {
        let place = reader
            .sources
            .inside(own.place_of("expression"), text, error.span.clone());
        let message = error
            .message
            .replace("unknown derived signal", "unknown value");
        let names: Vec<&str> = columns.names().collect();
        reader
            .report(
                ProblemKind::UnknownName,
                own.path_of("expression"),
                &place,
                message,
            )
            .expected(format!(
                "numbers that are varied before this one: {}",
                listed(names)
            ));
    }
    expression.filter(|_| is_known)
}
