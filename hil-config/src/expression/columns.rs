//! The names of the numbers in a row.
//!
//! Filled by the check from descriptions and by the launcher from the layout of a record; in a
//! record the groups follow each other in the order of [`Group`].

use std::collections::{HashMap, HashSet};

use shared_types::record::RecordLayout;
use shared_types::table::{nearest, unit_of_name};

/// Kind of a signal, and the first part of its name in expressions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Group {
    /// True state of the plant, `truth.x`.
    Truth,
    /// Readings of the plant's sensors, `measured.x`.
    Measured,
    /// Reference signals of the rig, `reference.x`.
    Reference,
    /// The command as the controller sent it, `command.x`.
    Command,
    /// The command as the plant applied it, `applied.x`.
    Applied,
    /// Inner quantities of the law, `internal.x`.
    Internal,
    /// Readings that the plant's sensors would give without faults, `sensed.x`.
    Sensed,
    /// Reference signals of the rig without faults, `stimulus.x`.
    Stimulus,
    /// The plant's faultable parameters as they act, `parameter.x`.
    Parameter,
    /// Computed from the others, `x`.
    Derived,
}

impl Group {
    /// Every group, in the order of a record.
    pub const ALL: [Self; 10] = [
        Self::Truth,
        Self::Measured,
        Self::Reference,
        Self::Command,
        Self::Applied,
        Self::Internal,
        Self::Sensed,
        Self::Stimulus,
        Self::Parameter,
        Self::Derived,
    ];

    /// The first part of a name; empty for derived signals.
    #[must_use]
    pub const fn prefix(self) -> &'static str {
        match self {
            Self::Truth => "truth",
            Self::Measured => "measured",
            Self::Reference => "reference",
            Self::Command => "command",
            Self::Applied => "applied",
            Self::Internal => "internal",
            Self::Sensed => "sensed",
            Self::Stimulus => "stimulus",
            Self::Parameter => "parameter",
            Self::Derived => "",
        }
    }
}

/// The names of the numbers in a row, in order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Columns {
    names: Vec<String>,
    /// The unit of each; empty if it is not known.
    units: Vec<String>,
    /// Columns without a unit whose values a factor may have converted to one.
    converted: HashSet<usize>,
    /// The first column of each name.
    places: HashMap<String, usize>,
    /// Columns by further names of their signals.
    aliases: HashMap<String, usize>,
}

impl From<&RecordLayout> for Columns {
    /// Names the signals of a record, in order.
    fn from(layout: &RecordLayout) -> Self {
        let mut columns = Self::default();
        for (group, fields) in Group::ALL.into_iter().zip(layout.groups()) {
            for field in fields {
                columns.push_with_unit(group, &field.name, &field.unit);
                let place = columns.len() - 1;
                for alias in &field.aliases {
                    let path = format!("{}.{alias}", group.prefix());
                    columns.aliases.insert(path, place);
                }
            }
        }
        columns
    }
}

impl Columns {
    /// Columns whose names are whole already.
    pub(crate) fn named(names: Vec<String>) -> Self {
        let mut columns = Self::default();
        names.into_iter().for_each(|name| columns.add(name, ""));
        columns
    }

    fn add(&mut self, name: String, unit: &str) {
        let place = self.names.len();
        self.places.entry(name.clone()).or_insert(place);
        self.names.push(name);
        self.units.push(unit.into());
    }

    /// Adds a column, whose unit is that of the name's ending.
    pub fn push(&mut self, group: Group, name: &str) {
        self.push_with_unit(group, name, unit_of_name(name).unwrap_or_default());
    }

    /// Adds a column of this unit; `1` is that of a plain number.
    pub fn push_with_unit(&mut self, group: Group, name: &str, unit: &str) {
        let name = match group {
            Group::Derived => name.into(),
            _ => format!("{}.{name}", group.prefix()),
        };
        self.add(name, if unit == "1" { "" } else { unit });
    }

    /// Adds a derived signal without a unit, whose values a factor may have converted to one.
    pub(crate) fn push_converted(&mut self, name: &str) {
        self.converted.insert(self.len());
        self.push_with_unit(Group::Derived, name, "");
    }

    /// Number of columns.
    #[must_use]
    pub fn len(&self) -> usize {
        self.names.len()
    }

    /// Returns true if there is no column.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// The names, in order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.names.iter().map(String::as_str)
    }

    /// The index of a name as expressions write it, for example `truth.surface_angle_rad`; an alias counts as well.
    #[must_use]
    pub fn index_of(&self, path: &str) -> Option<usize> {
        let place = self.places.get(path).or_else(|| self.aliases.get(path));
        place.copied()
    }

    /// The column's own name for any name of its signal, which is all that a recording has; a name that is none as
    /// it is.
    #[must_use]
    pub fn own_name<'a>(&'a self, path: &'a str) -> &'a str {
        let place = self
            .aliases
            .get(path)
            .filter(|_| !self.places.contains_key(path));
        place.map_or(path, |&place| &self.names[place])
    }

    /// The further names of signals, each with the column's own name, in alphabetical order.
    #[must_use]
    pub fn aliases(&self) -> Vec<(String, String)> {
        let aliases = (self.aliases.iter())
            .filter(|(alias, _)| !self.places.contains_key(*alias))
            .map(|(alias, &place)| (alias.clone(), self.names[place].clone()));
        let mut aliases: Vec<(String, String)> = aliases.collect();
        aliases.sort_unstable();
        aliases
    }

    /// The unit of a signal, if it is known.
    pub(super) fn unit_of(&self, path: &str) -> Option<&str> {
        let unit = &self.units[self.index_of(path)?];
        (!unit.is_empty()).then_some(unit)
    }

    /// Returns `true` if a factor may have converted a signal to a unit that is not known.
    pub(super) fn is_converted(&self, path: &str) -> bool {
        (self.index_of(path)).is_some_and(|place| self.converted.contains(&place))
    }

    /// Returns true if the first part of a name is one that exists.
    pub(super) fn has_prefix(&self, prefix: &str) -> bool {
        Group::ALL.iter().any(|group| group.prefix() == prefix)
    }

    /// Names closest to an unknown one. Where there are names of its kind, only those; else names of
    /// other kinds that end alike come first.
    pub(crate) fn nearest(&self, path: &str) -> Vec<String> {
        let names = self.names.iter().map(String::as_str);
        let owned = |found: Vec<&str>| found.into_iter().map(Into::into).collect::<Vec<String>>();
        let of_a_kind = path
            .split_once('.')
            .filter(|(kind, _)| self.has_prefix(kind));
        let last = of_a_kind.map_or(path, |(_, last)| last);
        let is_of = |kind: &str| {
            let mut kinds = names.clone().filter_map(|name| name.split_once('.'));
            kinds.any(|(of, _)| of == kind)
        };
        let Some((prefix, wanted)) = of_a_kind.filter(|(kind, _)| is_of(kind)) else {
            let ends_so =
                |name: &&str| (name.strip_suffix(last)).is_some_and(|rest| rest.ends_with('.'));
            let exact: Vec<&str> = names.clone().filter(ends_so).take(3).collect();
            if !exact.is_empty() {
                return owned(exact);
            }
            return owned(nearest(path, names));
        };
        // Compared without the common prefix, which would make everything look similar.
        let of_kind = names
            .filter_map(|name| name.split_once('.'))
            .filter(|(group, _)| *group == prefix)
            .map(|(_, name)| name);
        nearest(wanted, of_kind)
            .into_iter()
            .map(|name| format!("{prefix}.{name}"))
            .collect()
    }
}
