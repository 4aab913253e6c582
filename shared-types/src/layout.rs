//! Who sends which signals: the tables of both directions, how they are bound by name and unit at
//! hello, and the layout of a record.
//!
//! Written once before step 0; after that only positions and the layout hash are used.

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::Xxh3Default;

use crate::table::{Field, nearest};

/// The signals of one direction, in the order of the wire.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct SignalTable(pub Vec<Signal>);

/// A signal on the wire.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Signal {
    /// Whose it is.
    pub kind: SignalKind,
    /// Name, unit and description.
    #[serde(flatten)]
    pub field: Field,
}

/// Whose signal it is; also its prefix in expressions and recordings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SignalKind {
    /// True state of the plant; never on the link.
    Truth,
    /// What sensors report.
    Measured,
    /// What the rig asks for.
    Reference,
    /// What the controller asks for.
    Command,
    /// What the controller shows of itself.
    Internal,
}

impl SignalKind {
    /// The prefix in expressions.
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

/// A wanted signal that the other side does not send.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unbound {
    /// There is no signal of that name.
    #[error("no signal `{wanted}`{}", hint(nearest))]
    Missing {
        /// What was wanted.
        wanted: String,
        /// Names that come close.
        nearest: Vec<String>,
    },
    /// It is there, in another unit.
    #[error("signal `{name}` is wanted in `{wanted}` and sent in `{sent}`")]
    Unit {
        /// The signal.
        name: String,
        /// Unit wanted.
        wanted: String,
        /// Unit sent.
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
    /// A table of one kind.
    #[must_use]
    pub fn of(kind: SignalKind, fields: &[Field]) -> Self {
        let signal = |field: &Field| Signal {
            kind,
            field: field.clone(),
        };
        Self(fields.iter().map(signal).collect())
    }

    /// This table with another behind it.
    #[must_use]
    pub fn and(mut self, kind: SignalKind, fields: &[Field]) -> Self {
        self.0.extend(Self::of(kind, fields).0);
        self
    }

    /// Number of signals.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The fields of one kind, in order.
    #[must_use]
    pub fn fields(&self, kind: SignalKind) -> Vec<Field> {
        let of_kind = self.0.iter().filter(|signal| signal.kind == kind);
        of_kind.map(|signal| signal.field.clone()).collect()
    }

    /// Where the wanted signals of one kind stand in this table, by name and unit.
    ///
    /// # Errors
    /// Every signal that is not there.
    pub fn bind(&self, kind: SignalKind, wanted: &[Field]) -> Result<Vec<usize>, Vec<Unbound>> {
        let mut places = Vec::with_capacity(wanted.len());
        let mut unbound = Vec::new();
        for want in wanted {
            let found = (self.0.iter())
                .position(|signal| signal.kind == kind && signal.field.name == want.name);
            match found {
                Some(place) if self.0[place].field.unit == want.unit => places.push(place),
                Some(place) => unbound.push(Unbound::Unit {
                    name: want.name.clone(),
                    wanted: want.unit.clone(),
                    sent: self.0[place].field.unit.clone(),
                }),
                None => {
                    let known = self.0.iter().filter(|signal| signal.kind == kind);
                    let names = known.map(|signal| signal.field.name.as_str());
                    unbound.push(Unbound::Missing {
                        wanted: want.name.clone(),
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

/// The hash that guards a link: kind, name and unit of every signal of both directions, in order.
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
    fn signals_bind_by_kind_and_name_in_the_order_wanted() {
        let wanted = [field("rate_radps", "rad/s"), field("angle_rad", "rad")];
        assert_eq!(sample().bind(SignalKind::Measured, &wanted), Ok(vec![1, 0]));
        assert_eq!(
            sample().bind(SignalKind::Reference, &wanted[1..]),
            Ok(vec![2])
        );
    }

    #[test]
    fn every_unbound_signal_is_named() {
        let wanted = [field("angel_rad", "rad"), field("rate_radps", "deg/s")];
        let unbound = sample().bind(SignalKind::Measured, &wanted).unwrap_err();
        assert_eq!(
            unbound[0].to_string(),
            "no signal `angel_rad`, nearest: angle_rad, rate_radps"
        );
        assert_eq!(
            unbound[1].to_string(),
            "signal `rate_radps` is wanted in `deg/s` and sent in `rad/s`"
        );
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
        let mut retold = sample();
        retold.0[0].field.description = "told otherwise".into();
        assert_eq!(layout_hash(&retold, &command), base);
    }
}
