//! Signal layout: the tables of both directions, their binding by name and unit at hello, and the layout of a record.
//!
//! Fixed before step 0; afterwards only positions and the layout hash are used.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::Xxh3Default;

use crate::table::{Field, nearest};

/// Maximum number of columns of a table that is not sent in frames.
pub const MOST_FIELDS: usize = 4096;
/// Maximum length of a name in bytes.
pub(crate) const LONGEST_NAME: usize = 256;
/// Maximum length of a unit in bytes.
const LONGEST_UNIT: usize = 64;
/// Maximum length of a description in bytes.
const LONGEST_DESCRIPTION: usize = 4096;
/// Row of characters that separates the sections of a recording's schema.
const RULER: &str = "========";

/// Signals of one direction, in wire order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct SignalTable(pub Vec<Signal>);

/// A signal on the wire.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Signal {
    /// Kind of the signal, which determines its owner.
    pub kind: SignalKind,
    /// Name, unit and description.
    #[serde(flatten)]
    pub field: Field,
}

/// Kind of a signal, which determines the signal's owner and its prefix in expressions and recordings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SignalKind {
    /// True state of the plant; never on the link.
    Truth,
    /// Value that a sensor reports.
    Measured,
    /// Value that the rig requests.
    Reference,
    /// Value that the controller requests.
    Command,
    /// Internal value that the controller exposes.
    Internal,
}

impl SignalKind {
    /// Returns the prefix in expressions.
    #[must_use]
    pub const fn prefix(self) -> &'static str {
        match self {
            Self::Truth => "truth",
            Self::Measured => "measured",
            Self::Reference => "reference",
            Self::Command => "command",
            Self::Internal => "internal",
        }
    }
}

/// Required signal that the other side does not send under this name and unit.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unbound {
    /// No signal has that name.
    #[error("no signal `{needed}`{}", hint(nearest))]
    Missing {
        /// Required name.
        needed: String,
        /// Similar names.
        nearest: Vec<String>,
    },
    /// The signal exists, but in another unit.
    #[error("signal `{name}` is needed in `{needed}`, but sent in `{sent}`")]
    Unit {
        /// The signal.
        name: String,
        /// Required unit.
        needed: String,
        /// Unit that is sent.
        sent: String,
    },
}

fn hint(nearest: &[String]) -> String {
    if nearest.is_empty() {
        String::new()
    } else {
        format!(", nearest: {}", nearest.join(", "))
    }
}

impl SignalTable {
    /// Creates a table of signals of one kind.
    #[must_use]
    pub fn of(kind: SignalKind, fields: &[Field]) -> Self {
        let signal = |field: &Field| Signal {
            kind,
            field: field.clone(),
        };
        Self(fields.iter().map(signal).collect())
    }

    /// Appends signals of one kind to this table.
    #[must_use]
    pub fn and(mut self, kind: SignalKind, fields: &[Field]) -> Self {
        self.0.extend(Self::of(kind, fields).0);
        self
    }

    /// Returns the number of signals.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Returns `true` if the table has no signals.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Returns the fields of one kind, in order.
    #[must_use]
    pub fn fields(&self, kind: SignalKind) -> Vec<Field> {
        let of_kind = self.0.iter().filter(|signal| signal.kind == kind);
        of_kind.map(|signal| signal.field.clone()).collect()
    }

    /// Finds the positions of required signals of one kind in this table, by name and unit.
    ///
    /// # Errors
    /// Every signal that is missing or has another unit.
    pub fn bind(&self, kind: SignalKind, fields: &[Field]) -> Result<Vec<usize>, Vec<Unbound>> {
        let mut places = Vec::with_capacity(fields.len());
        let mut unbound = Vec::new();
        for want in fields {
            let position = (self.0.iter())
                .position(|signal| signal.kind == kind && signal.field.name == want.name);
            match position {
                Some(place) if self.0[place].field.unit == want.unit => places.push(place),
                Some(place) => unbound.push(Unbound::Unit {
                    name: want.name.clone(),
                    needed: want.unit.clone(),
                    sent: self.0[place].field.unit.clone(),
                }),
                None => {
                    let candidates = self.0.iter().filter(|signal| signal.kind == kind);
                    let names = candidates.map(|signal| signal.field.name.as_str());
                    unbound.push(Unbound::Missing {
                        needed: want.name.clone(),
                        nearest: nearest(&want.name, names)
                            .into_iter()
                            .map(Into::into)
                            .collect(),
                    });
                }
            }
        }
        if unbound.is_empty() {
            Ok(places)
        } else {
            Err(unbound)
        }
    }
}

/// Reason why a table of another process is unusable. Its columns must be printable, and unique both in expressions and
/// in the schema of a recording.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unusable {
    /// Invalid name.
    #[error("{0:?} is not a name of letters, digits and _, with a dot after a group")]
    Name(String),
    /// Unit that could not be read back as written.
    #[error("`{name}` has the invalid unit {unit:?}")]
    Unit {
        /// The column.
        name: String,
        /// Unit of the column.
        unit: String,
    },
    /// Description that could not be read back as written.
    #[error("the description of `{0}` is too long or contains unprintable characters")]
    Description(String),
    /// Duplicate column name.
    #[error("`{0}` is defined twice")]
    Twice(String),
    /// Too many columns.
    #[error("there are {count} entries, but at most {most} are allowed")]
    Many {
        /// Returns the number of columns.
        count: usize,
        /// Largest number of columns allowed.
        most: usize,
    },
}

/// Returns `true` if a text fits on one line.
#[must_use]
pub fn is_line(text: &str) -> bool {
    !text.contains(|c: char| c.is_control() || matches!(c, '\u{2028}' | '\u{2029}'))
}

/// Checks the name of a model, a law or a kind of fault.
///
/// # Errors
/// If the name is not printable.
pub fn check_title(name: &str) -> Result<(), Unusable> {
    if name.is_empty() || name.len() > LONGEST_NAME || !is_line(name) {
        return Err(Unusable::Name(beginning(name)));
    }
    Ok(())
}

/// Checks the columns of a table with at most N columns.
///
/// # Errors
/// The first violation.
pub fn check_fields(fields: &[Field], most: usize) -> Result<(), Unusable> {
    let count = fields.len();
    if count > most {
        return Err(Unusable::Many { count, most });
    }
    let mut names = BTreeSet::new();
    for Field {
        name,
        unit,
        description,
        ..
    } in fields
    {
        if name.len() > LONGEST_NAME || !name.split('.').all(is_name) {
            return Err(Unusable::Name(beginning(name)));
        }
        if unit.len() > LONGEST_UNIT || !is_line(unit) || unit.contains(['[', ']']) {
            let (name, unit) = (name.clone(), beginning(unit));
            return Err(Unusable::Unit { name, unit });
        }
        if description.len() > LONGEST_DESCRIPTION
            || !description.split(['\n', '\t']).all(is_line)
            || description.contains(RULER)
        {
            return Err(Unusable::Description(name.clone()));
        }
        if !names.insert(schema_name(name)) {
            return Err(Unusable::Twice(name.clone()));
        }
    }
    let mut names: BTreeSet<&str> = fields.iter().map(|field| field.name.as_str()).collect();
    for alias in fields.iter().flat_map(|field| &field.aliases) {
        if alias.len() > LONGEST_NAME || !alias.split('.').all(is_name) {
            return Err(Unusable::Name(beginning(alias)));
        }
        if !names.insert(alias) {
            return Err(Unusable::Twice(alias.clone()));
        }
    }
    Ok(())
}

/// Returns a signal's name as written in the schema of a recording, whose syntax allows no dots: each becomes `_`.
#[must_use]
pub fn schema_name(name: &str) -> String {
    name.replace('.', "_")
}

/// Returns `true` if a text is a name, or the part of a name before or after a dot.
#[must_use]
pub fn is_name(text: &str) -> bool {
    let is_first = |c: char| c.is_ascii_alphabetic() || c == '_';
    text.starts_with(is_first) && (text.chars()).all(|c| is_first(c) || c.is_ascii_digit())
}

/// Truncates a text of unknown length for display.
fn beginning(text: &str) -> String {
    text.chars().take(80).collect()
}

/// Describes the first difference in number, name or unit between the columns of a hello and of its description.
#[must_use]
pub fn difference(what: &str, actual: &[Field], described: &[Field]) -> Option<String> {
    if actual.len() != described.len() {
        let (actual, described) = (actual.len(), described.len());
        return Some(format!(
            "{actual} {what} signals; its --describe says {described}"
        ));
    }
    let is_other = |(actual, described): &(&Field, &Field)| {
        (&actual.name, &actual.unit) != (&described.name, &described.unit)
    };
    let (actual, described) = actual.iter().zip(described).find(is_other)?;
    let describe_field = |field: &Field| {
        let (name, unit) = (beginning(&field.name), beginning(&field.unit));
        format!("{name:?} in {unit:?}")
    };
    Some(format!(
        "the {what} signal {}; its --describe says {}",
        describe_field(actual),
        describe_field(described)
    ))
}

/// Computes the hash that guards a link: kind, name and unit of every signal of both directions, in order.
#[must_use]
pub fn layout_hash(sample: &SignalTable, command: &SignalTable) -> u64 {
    let mut hash = Xxh3Default::new();
    for table in [sample, command] {
        hash.update(&(table.len() as u64).to_le_bytes());
        for signal in &table.0 {
            for text in [signal.kind.prefix(), &signal.field.name, &signal.field.unit] {
                hash.update(&(text.len() as u64).to_le_bytes());
                hash.update(text.as_bytes());
            }
        }
    }
    hash.digest()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(name: &str, unit: &str) -> Field {
        Field::signal(name, unit, "x")
    }

    fn sample() -> SignalTable {
        SignalTable::of(
            SignalKind::Measured,
            &[field("angle_rad", "rad"), field("rate_radps", "rad/s")],
        )
        .and(SignalKind::Reference, &[field("angle_rad", "rad")])
    }

    #[test]
    fn signals_bind_by_kind_and_name_in_the_requested_order() {
        let fields = [field("rate_radps", "rad/s"), field("angle_rad", "rad")];
        assert_eq!(sample().bind(SignalKind::Measured, &fields), Ok(vec![1, 0]));
        assert_eq!(
            sample().bind(SignalKind::Reference, &fields[1..]),
            Ok(vec![2])
        );
    }

    #[test]
    fn every_unbound_signal_is_named() {
        let fields = [field("angel_rad", "rad"), field("rate_radps", "deg/s")];
        let unbound = sample().bind(SignalKind::Measured, &fields).unwrap_err();
        assert_eq!(
            unbound[0].to_string(),
            "no signal `angel_rad`, nearest: angle_rad, rate_radps"
        );
        assert_eq!(
            unbound[1].to_string(),
            "signal `rate_radps` is needed in `deg/s`, but sent in `rad/s`"
        );
    }

    #[test]
    fn unprintable_columns_are_refused_by_name() {
        let sound = [field("a.b_m", "m"), field("_c2", "rad/s2")];
        assert_eq!(check_fields(&sound, 2), Ok(()));
        let many = Unusable::Many { count: 2, most: 1 };
        assert_eq!(check_fields(&sound, 1), Err(many));
        for name in [
            "",
            ".",
            "a.",
            ".a",
            "a..b",
            "a b",
            "2a",
            "a-b",
            "ä",
            "a\nfloat64 b",
            "a#",
        ] {
            let error = check_fields(&[field(name, "m")], 9);
            assert_eq!(error, Err(Unusable::Name(name.into())), "{name:?}");
        }
        assert!(check_fields(&[field(&"a".repeat(300), "m")], 9).is_err());
        for unit in ["m]", "[m", "m\n", "\u{1b}[2J", "m\u{2028}"] {
            let (name, unit) = ("a_m".to_owned(), unit.to_owned());
            let error = check_fields(&[field(&name, &unit)], 9);
            assert_eq!(error, Err(Unusable::Unit { name, unit }));
        }
        for description in ["\r", "\u{7}", &"=".repeat(80), &"long ".repeat(1000)] {
            let sample_field = Field::signal("a_m", "m", &format!("It is {description} so."));
            let error = check_fields(&[sample_field], 9);
            assert_eq!(error, Err(Unusable::Description("a_m".into())));
        }
        for [one, other] in [["a_m", "a_m"], ["a.b_m", "a_b_m"]] {
            let error = check_fields(&[field(one, "m"), field(other, "m")], 9);
            assert_eq!(error, Err(Unusable::Twice(other.into())));
        }
    }

    #[test]
    fn the_first_difference_from_the_description_is_named() {
        let (one, two) = (field("a_m", "m"), field("b_m", "m"));
        let described = [one.clone(), two.clone()];
        let differs = |fields: &[Field]| difference("internal", fields, &described);
        assert_eq!(differs(&described), None);
        let redescribed = Field::signal("a_m", "m", "told otherwise");
        assert_eq!(differs(&[redescribed, two.clone()]), None);
        for (fields, expected) in [
            (
                vec![one.clone()],
                "1 internal signals; its --describe says 2",
            ),
            (
                vec![two.clone(), one.clone()],
                "the internal signal \"b_m\" in \"m\"; its --describe says \"a_m\" in \"m\"",
            ),
            (
                vec![field("a_m", "m\n"), two],
                "the internal signal \"a_m\" in \"m\\n\"; its --describe says \"a_m\" in \"m\"",
            ),
        ] {
            assert_eq!(differs(&fields).as_deref(), Some(expected));
        }
    }

    #[test]
    fn any_change_of_a_table_changes_the_hash() {
        let command = SignalTable::of(SignalKind::Command, &[field("force_n", "N")]);
        let base = layout_hash(&sample(), &command);
        let mut renamed = sample();
        renamed.0[0].field.name = "angle2_rad".into();
        let mut in_degrees = sample();
        in_degrees.0[0].field.unit = "deg".into();
        let mut swapped = sample();
        swapped.0.swap(0, 1);
        let mut moved = sample();
        moved.0[0].kind = SignalKind::Reference;
        for other in [renamed, in_degrees, swapped, moved, SignalTable::default()] {
            assert_ne!(layout_hash(&other, &command), base);
        }
        assert_ne!(layout_hash(&command, &sample()), base);
        let mut changed = sample();
        changed.0[0].field.description = "told otherwise".into();
        assert_eq!(layout_hash(&changed, &command), base);
    }
}
