//! Names of the numbers in a row.
//!
//! Filled by the check from descriptions and by the launcher from the layout of a record; in a record the groups follow
//! each other in the order of [`Group`].

use std::collections::{HashMap, HashSet};

use shared_types::record::RecordLayout;
use shared_types::table::{Field, nearest, unit_of_name};

/// Group of a signal, the first part of its name in expressions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Group {
    /// True state of the plant, `truth.x`.
    Truth,
    /// Readings of the plant's sensors, `measured.x`.
    Measured,
    /// Reference signals of the rig, `reference.x`.
    Reference,
    /// Command as sent by the controller, `command.x`.
    Command,
    /// Command as applied by the plant, `applied.x`.
    Applied,
    /// Internal signals of the law, `internal.x`.
    Internal,
    /// Inputs of the plant that the scenario drives, `input.x`.
    Input,
    /// Sensor readings without faults, `sensed.x`.
    Sensed,
    /// Reference signals without faults, `stimulus.x`.
    Stimulus,
    /// Effective values of the plant's faultable parameters, `parameter.x`.
    Parameter,
    /// Inputs of sensors and of their stages, `sensor.x`.
    Sensor,
    /// Inputs of actuators and of their stages, `actuator.x`.
    Actuator,
    /// Inputs and outputs of probes that cut the loop, `cut.in.x` and `cut.out.x`.
    Cut,
    /// Value derived from other signals, `x`.
    Derived,
}

impl Group {
    /// Every group, in record order.
    pub const ALL: [Self; 14] = [
        Self::Truth,
        Self::Measured,
        Self::Reference,
        Self::Command,
        Self::Applied,
        Self::Internal,
        Self::Input,
        Self::Sensed,
        Self::Stimulus,
        Self::Parameter,
        Self::Sensor,
        Self::Actuator,
        Self::Cut,
        Self::Derived,
    ];

    /// Returns the first part of a name; empty for derived signals.
    #[must_use]
    pub const fn prefix(self) -> &'static str {
        match self {
            Self::Truth => "truth",
            Self::Measured => "measured",
            Self::Reference => "reference",
            Self::Command => "command",
            Self::Applied => "applied",
            Self::Internal => "internal",
            Self::Input => "input",
            Self::Sensed => "sensed",
            Self::Stimulus => "stimulus",
            Self::Parameter => "parameter",
            Self::Sensor => "sensor",
            Self::Actuator => "actuator",
            Self::Cut => "cut",
            Self::Derived => "",
        }
    }
}

/// The names of the numbers in a row, in order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Columns {
    names: Vec<String>,
    /// Unit of each column; empty if unknown.
    units: Vec<String>,
    /// Columns without a unit whose values may have been converted by a factor.
    converted: HashSet<usize>,
    /// First column of each name.
    places: HashMap<String, usize>,
    /// Columns by the aliases of their signals.
    aliases: HashMap<String, usize>,
}

impl From<&RecordLayout> for Columns {
    /// Names the signals of a record, in order.
    fn from(layout: &RecordLayout) -> Self {
        let mut columns = Self::default();
        for (group, fields) in Group::ALL.into_iter().zip(layout.groups()) {
            for field in fields {
                columns.push_field(group, field);
            }
        }
        columns
    }
}

impl Columns {
    /// Creates columns from complete names.
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

    /// Adds the column of a signal, with its unit and its aliases.
    pub(crate) fn push_field(&mut self, group: Group, field: &Field) {
        self.push_with_unit(group, &field.name, &field.unit);
        let place = self.len() - 1;
        for alias in &field.aliases {
            let path = format!("{}.{alias}", group.prefix());
            self.aliases.insert(path, place);
        }
    }

    /// Adds a column with the unit of its name's suffix.
    pub fn push(&mut self, group: Group, name: &str) {
        self.push_with_unit(group, name, unit_of_name(name).unwrap_or_default());
    }

    /// Adds a column with this unit; `1` means dimensionless.
    pub fn push_with_unit(&mut self, group: Group, name: &str, unit: &str) {
        let name = match group {
            Group::Derived => name.into(),
            _ => format!("{}.{name}", group.prefix()),
        };
        self.add(name, if unit == "1" { "" } else { unit });
    }

    /// Adds a derived signal without a unit, whose values may have been converted by a factor.
    pub(crate) fn push_converted(&mut self, name: &str) {
        self.converted.insert(self.len());
        self.push_with_unit(Group::Derived, name, "");
    }

    /// Returns the number of columns.
    #[must_use]
    pub fn len(&self) -> usize {
        self.names.len()
    }

    /// Returns `true` if there are no columns.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// Lists the names, in order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.names.iter().map(String::as_str)
    }

    /// Returns the index of a name as used in expressions, for example `truth.surface_angle_rad`; aliases count as
    /// well.
    #[must_use]
    pub fn index_of(&self, path: &str) -> Option<usize> {
        let place = self.places.get(path).or_else(|| self.aliases.get(path));
        place.copied()
    }

    /// Returns the column's own name for any name of its signal, because recordings have no other. An unknown name is
    /// returned unchanged.
    #[must_use]
    pub fn own_name<'a>(&'a self, path: &'a str) -> &'a str {
        let place = self
            .aliases
            .get(path)
            .filter(|_| !self.places.contains_key(path));
        place.map_or(path, |&place| &self.names[place])
    }

    /// Lists the aliases of signals, each with the column's own name, in alphabetical order.
    #[must_use]
    pub fn aliases(&self) -> Vec<(String, String)> {
        let aliases = (self.aliases.iter())
            .filter(|(alias, _)| !self.places.contains_key(*alias))
            .map(|(alias, &place)| (alias.clone(), self.names[place].clone()));
        let mut aliases: Vec<(String, String)> = aliases.collect();
        aliases.sort_unstable();
        aliases
    }

    /// Returns the unit of a signal, if known.
    pub(super) fn unit_of(&self, path: &str) -> Option<&str> {
        let unit = &self.units[self.index_of(path)?];
        (!unit.is_empty()).then_some(unit)
    }

    /// Returns `true` if a factor may have converted a signal to an unknown unit.
    pub(super) fn is_converted(&self, path: &str) -> bool {
        (self.index_of(path)).is_some_and(|place| self.converted.contains(&place))
    }

    /// Returns `true` if the first part of a name is an existing group.
    pub(super) fn has_prefix(&self, prefix: &str) -> bool {
        Group::ALL.iter().any(|group| group.prefix() == prefix)
    }

    /// Returns `true` if the plant has a true state.
    pub(super) fn has_truth(&self) -> bool {
        (self.names.iter()).any(|name| name.starts_with("truth."))
    }

    /// Returns the names closest to an unknown one: names of its group if it has a group; otherwise names of other
    /// groups, beginning with those that have the same ending.
    pub(crate) fn nearest(&self, path: &str) -> Vec<String> {
        let names = self.names.iter().map(String::as_str);
        let owned = |close_names: Vec<&str>| {
            close_names
                .into_iter()
                .map(Into::into)
                .collect::<Vec<String>>()
        };
        let of_a_kind = path
            .split_once('.')
            .filter(|(kind, _)| self.has_prefix(kind));
        let last = of_a_kind.map_or(path, |(_, last)| last);
        let is_of = |kind: &str| {
            let mut kinds = names.clone().filter_map(|name| name.split_once('.'));
            kinds.any(|(of, _)| of == kind)
        };
        let Some((prefix, rest_of_name)) = of_a_kind.filter(|(kind, _)| is_of(kind)) else {
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
        nearest(rest_of_name, of_kind)
            .into_iter()
            .map(|name| format!("{prefix}.{name}"))
            .collect()
    }
}
