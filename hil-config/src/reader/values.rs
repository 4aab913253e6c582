//! Values of keys: numbers in their range, booleans, texts and lists of them.

use shared_types::number::exact as number;
use shared_types::text::is_unprintable;

use super::{Reader, Section, describe};
use crate::document::{Node, Value};
use crate::keys::KeyKind;
use crate::problem::ProblemKind;
use crate::quantity::Quantity;
use crate::source::Place;

impl Reader {
    /// Returns a number of the section's own keys, or its default.
    pub(crate) fn number(&mut self, section: &Section<'_>, name: &str) -> Option<f64> {
        let key = section.key(name);
        let KeyKind::Number {
            unit,
            min,
            max,
            default,
        } = key.kind
        else {
            unreachable!("`{name}` is a number")
        };
        let Some(node) = self.value(section, key) else {
            return default;
        };
        let any = Quantity::finite(unit);
        let quantity = Quantity { min, max, ..any };
        self.quantity(&section.path_of(name), node, &quantity)
    }

    /// Returns an optional number of the section's own keys; the outer `None` means a faulty number.
    pub(crate) fn optional_number(
        &mut self,
        section: &Section<'_>,
        name: &str,
    ) -> Option<Option<f64>> {
        match section.table.get(name) {
            Some(_) => self.number(section, name).map(Some),
            None => Some(None),
        }
    }

    /// Returns a required number, according to a description.
    pub(crate) fn described_number(
        &mut self,
        section: &Section<'_>,
        quantity: &Quantity<'_>,
    ) -> Option<f64> {
        let path = section.path_of(quantity.name);
        match section.table.get(quantity.name) {
            Some(entry) => self.quantity(&path, &entry.node, quantity),
            None => {
                self.missing(section, &path, quantity.expected());
                None
            }
        }
    }

    /// Returns a number in its range.
    pub(crate) fn quantity(
        &mut self,
        path: &str,
        node: &Node,
        quantity: &Quantity<'_>,
    ) -> Option<f64> {
        let value = match &node.value {
            Value::Integer(value) => *value as f64,
            Value::Float(value) => *value,
            _ => {
                self.wrong_type(path, node, quantity.expected());
                return None;
            }
        };
        if quantity.admits(value) {
            return Some(value);
        }
        let what = if value.is_nan() {
            "not a number".into()
        } else if quantity.whole && value.fract() != 0.0 {
            format!("{}, not a whole number", number(value))
        } else {
            format!("{}, out of range", number(value))
        };
        self.report(
            ProblemKind::OutOfRange,
            path,
            &node.place,
            format!("`{path}` is {what}"),
        )
        .expected(quantity.expected());
        None
    }

    /// Returns a whole number, or its default.
    pub(crate) fn integer(&mut self, section: &Section<'_>, name: &str) -> Option<i64> {
        let key = section.key(name);
        let KeyKind::Integer { min, max, default } = key.kind else {
            unreachable!("`{name}` is a whole number")
        };
        let Some(node) = self.value(section, key) else {
            return default;
        };
        let path = section.path_of(name);
        let Value::Integer(value) = node.value else {
            self.wrong_type(&path, node, describe(&key.kind));
            return None;
        };
        if (min..=max).contains(&value) {
            return Some(value);
        }
        self.report(
            ProblemKind::OutOfRange,
            &path,
            &node.place,
            format!("`{path}` is {value}, out of range"),
        )
        .expected(describe(&key.kind));
        None
    }

    /// Returns a boolean, or its default.
    pub(crate) fn boolean(&mut self, section: &Section<'_>, name: &str) -> Option<bool> {
        let key = section.key(name);
        let KeyKind::Boolean { default } = key.kind else {
            unreachable!("`{name}` is true or false")
        };
        let Some(node) = self.value(section, key) else {
            return Some(default);
        };
        let Value::Boolean(value) = node.value else {
            self.wrong_type(&section.path_of(name), node, describe(&key.kind));
            return None;
        };
        Some(value)
    }

    /// Returns a text, or its default.
    pub(crate) fn text<'a>(&mut self, section: &Section<'a>, name: &str) -> Option<&'a str> {
        let key = section.key(name);
        let KeyKind::Text { choices, default } = key.kind else {
            unreachable!("`{name}` is text")
        };
        let Some(node) = self.value(section, key) else {
            return default;
        };
        let path = section.path_of(name);
        let text = self.printable(&path, node, describe(&key.kind))?;
        if choices.is_empty() || choices.contains(&text) {
            return Some(text);
        }
        self.report(
            ProblemKind::UnknownName,
            &path,
            &node.place,
            format!("`{path}` is `{text}`, which does not exist"),
        )
        .expected(describe(&key.kind))
        .nearest(text, choices.iter().copied());
        None
    }

    /// Returns the texts of a list, which must not be empty, each with its path and place.
    pub(crate) fn texts<'a>(
        &mut self,
        section: &Section<'a>,
        name: &str,
    ) -> Option<Vec<(String, &'a Place, &'a str)>> {
        let key = section.key(name);
        let KeyKind::Texts = key.kind else {
            unreachable!("`{name}` is a list of texts")
        };
        let node = self.value(section, key)?;
        let path = section.path_of(name);
        let Value::List(items) = &node.value else {
            self.wrong_type(&path, node, describe(&key.kind));
            return None;
        };
        if items.is_empty() {
            self.report(
                ProblemKind::OutOfRange,
                &path,
                &node.place,
                format!("`{path}` is empty"),
            )
            .expected(describe(&key.kind));
            return None;
        }
        let texts: Vec<Option<_>> = (items.iter().enumerate())
            .map(|(index, item)| {
                let path = format!("{path}[{index}]");
                let text = self.printable(&path, item, "text")?;
                Some((path, &item.place, text))
            })
            .collect();
        texts.into_iter().collect()
    }

    /// Returns a text without control characters.
    pub(crate) fn printable<'a>(
        &mut self,
        path: &str,
        node: &'a Node,
        expected: impl Into<String>,
    ) -> Option<&'a str> {
        let Value::Text(text) = &node.value else {
            self.wrong_type(path, node, expected);
            return None;
        };
        if let Some(control_character) = text.chars().find(|c| is_unprintable(*c)) {
            self.report(
                ProblemKind::OutOfRange,
                path,
                &node.place,
                format!("`{path}` has the control character {control_character:?}"),
            )
            .expected("text that a terminal can show");
            return None;
        }
        Some(text)
    }

    /// Returns a list of finite numbers.
    pub(crate) fn numbers(&mut self, path: &str, node: &Node) -> Option<Vec<f64>> {
        let Value::List(items) = &node.value else {
            self.wrong_type(path, node, "a list of numbers");
            return None;
        };
        let finite = Quantity::finite("");
        let values: Vec<Option<f64>> = items
            .iter()
            .enumerate()
            .map(|(index, item)| self.quantity(&format!("{path}[{index}]"), item, &finite))
            .collect();
        values.into_iter().collect()
    }

    /// Returns a pair `[first, second]` whose first number is not above the second; each may be infinite.
    pub(crate) fn pair(&mut self, path: &str, node: &Node, unit: &str) -> Option<(f64, f64)> {
        let expected = "a pair of numbers, the smaller one first";
        let Value::List(items) = &node.value else {
            self.wrong_type(path, node, expected);
            return None;
        };
        let [first, second] = items.as_slice() else {
            self.report(
                ProblemKind::WrongType,
                path,
                &node.place,
                format!("`{path}` has {} entries", items.len()),
            )
            .expected(expected);
            return None;
        };
        let any = Quantity {
            min: f64::NEG_INFINITY,
            max: f64::INFINITY,
            ..Quantity::finite(unit)
        };
        let low = self.quantity(&format!("{path}[0]"), first, &any);
        let high = self.quantity(&format!("{path}[1]"), second, &any);
        let (low, high) = (low?, high?);
        if low > high {
            self.report(
                ProblemKind::OutOfRange,
                path,
                &node.place,
                format!("`{path}` is [{}, {}]", number(low), number(high)),
            )
            .expected(expected);
            return None;
        }
        Some((low, high))
    }
}
