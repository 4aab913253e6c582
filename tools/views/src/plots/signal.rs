//! Names of signals, split into group, words, numbers and unit, and the titles and labels built from them.

use glob::Pattern;
use hil_config::expression::Group;
use shared_types::number::unit_shown;

use super::Plot;
use hil_recording::reader::Column;
use hil_recording::schema::column_name;

/// Maximum length of a list of names used as a title, and of a name next to a curve.
const SHORT: usize = 16;

/// Signal that can be plotted.
#[derive(Clone, Copy)]
pub(crate) struct Signal<'a> {
    /// Full name, for example `truth.force_fight_n`.
    pub(crate) column: &'a str,
    /// Group; empty for derived signals and for times.
    pub(crate) group: &'a str,
    pub(crate) name: &'a str,
    pub(crate) unit: &'a str,
}

impl<'a> Signal<'a> {
    pub(super) fn of(column: &'a Column) -> Self {
        Self::of_name(&column.name, &column.unit)
    }

    pub(crate) fn of_name(column: &'a str, unit: &'a str) -> Self {
        let (group, name) = apart(column).unwrap_or(("", column));
        Self {
            column,
            group,
            name,
            unit,
        }
    }

    /// Splits the unit off the end of the name.
    pub(crate) fn stem(&self) -> (&'a str, &'a str) {
        let words = self.name.match_indices('_').map(|(place, _)| place);
        let unit = words
            .filter(|place| spells(&self.name[place + 1..], self.unit))
            .min();
        self.name.split_at(unit.unwrap_or(self.name.len()))
    }

    /// Returns the name with `*` for each number, except those in its unit.
    pub(super) fn family(&self) -> String {
        let (stem, unit) = self.stem();
        let mut family = String::new();
        for character in stem.chars() {
            if !character.is_ascii_digit() {
                family.push(character);
            } else if !family.ends_with('*') {
                family.push('*');
            }
        }
        family + unit
    }

    /// Returns the words of the name that have a number, without those of its unit.
    fn numbered(&self) -> impl Iterator<Item = &'a str> {
        let words = self.stem().0.split(['_', '.']);
        words.filter(|word| word.contains(|c: char| c.is_ascii_digit()))
    }

    /// Returns the words of the name without numbers.
    pub(crate) fn words(&self) -> impl Iterator<Item = &'a str> {
        let words = self.stem().0.split('_');
        words.map(|word| word.trim_end_matches(|c: char| c.is_ascii_digit()))
    }

    /// Returns `true` if the other signal has the same unit and a word in common.
    pub(super) fn is_akin(&self, other: &Self) -> bool {
        let has_unit = !unit_shown(self.unit).is_empty();
        has_unit
            && self.unit == other.unit
            && self.words().any(|one| other.words().any(|w| w == one))
    }

    /// Returns the name without the unit, with or without its group.
    pub(super) fn label(&self, has_group: bool) -> &'a str {
        let from = match has_group {
            true => self.column,
            false => self.name,
        };
        &from[..from.len() - self.stem().1.len()]
    }
}

/// Splits a recorded signal into group and name; `None` for derived signals and for expressions.
fn apart(column: &str) -> Option<(&str, &str)> {
    let (group, name) = column.split_once('.')?;
    let is_group = Group::ALL.iter().any(|one| one.prefix() == group);
    let is_name = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '.');
    (is_group && name.chars().all(is_name)).then_some((group, name))
}

/// Returns the name of a signal in a recording, where only the group ends with a dot.
#[must_use]
pub fn recorded_name(name: &str) -> String {
    match apart(name) {
        Some((group, name)) => column_name(group, name),
        None => name.to_owned(),
    }
}

/// Replaces aliases of variables in patterns by the names used in a run.
///
/// `names` are the names and `aliases` pairs of alias and name. A pattern remains unchanged if it is an exact name, if
/// it matches only names, or if it matches nothing.
pub(crate) fn own_names<'a>(
    patterns: &[String],
    names: impl Iterator<Item = &'a str> + Clone,
    aliases: &[(String, String)],
) -> Vec<String> {
    let mut own: Vec<String> = Vec::new();
    for text in patterns {
        let pattern = Pattern::new(text).ok();
        let is_exact = names.clone().any(|name| name == text);
        let fits = |name: &str| {
            let fits =
                |pattern: &Pattern| pattern.matches(name) || pattern.matches(&recorded_name(name));
            pattern.as_ref().is_some_and(fits)
        };
        let names_of_aliases: Vec<&String> = (aliases.iter())
            .filter(|(alias, name)| !is_exact && fits(alias) && !fits(name))
            .map(|(_, name)| name)
            .collect();
        let stays = names_of_aliases.is_empty() || names.clone().any(fits);
        for name in stays.then_some(text).into_iter().chain(names_of_aliases) {
            if !own.contains(name) {
                own.push(name.clone());
            }
        }
    }
    own
}

/// Returns a title for signals: the common part of their names with `*` for the rest, or the list of names if the list
/// is short or the names have nothing in common.
pub(super) fn title(signals: &[Signal<'_>]) -> String {
    let first = &signals[0];
    let all = |same: &dyn Fn(&Signal<'_>) -> bool| signals.iter().all(same);
    let mut names: Vec<&str> = signals.iter().map(|one| one.name).collect();
    names.dedup(); // equal names of different groups are adjacent
    let names = names.join(", ");
    let word = |one: &Signal<'_>| one.words().next().map(str::to_owned);
    let name = if names == first.name || names.len() <= SHORT {
        names
    } else if all(&|one| one.family() == first.family()) {
        first.family()
    } else if let (true, Some(word)) = (all(&|one| word(one) == word(first)), word(first)) {
        format!("{word}_*")
    } else {
        let whole: Vec<&str> = signals.iter().map(|one| one.column).collect();
        return whole.join(", ");
    };
    match first.group {
        group if !group.is_empty() && all(&|one| one.group == group) => format!("{group}.{name}"),
        _ => name,
    }
}

/// Returns labels that distinguish the curves of a plot, given its title: groups if the names are equal; names without
/// their unit if they are short; otherwise group and the words whose numbers are behind the title's `*`, if these
/// suffice. A single curve named by the title has no label.
pub(crate) fn labels(plot: &Plot) -> Vec<String> {
    let signals: Vec<Signal<'_>> = (plot.signals.iter())
        .map(|column| Signal::of_name(column, &plot.unit))
        .collect();
    let [first, others @ ..] = &signals[..] else {
        return Vec::new();
    };
    if others.is_empty() && first.column == plot.title {
        return vec![String::new()];
    }
    let has_groups = others.is_empty() || others.iter().any(|one| one.group != first.group);
    let is_of_family = |one: &Signal<'_>| {
        let mut of_group = signals.iter().filter(|other| other.group == one.group);
        of_group.all(|other| other.family() == one.family())
    };
    let whole: Vec<String> = (signals.iter())
        .map(|one| one.label(has_groups).to_owned())
        .collect();
    let is_long = whole.iter().any(|label| label.len() > SHORT);
    let are_twins = others.iter().all(|one| one.name == first.name);
    let is_told = are_twins || (is_long && signals.iter().all(is_of_family));
    if others.is_empty() || !is_told {
        return whole;
    }
    let short: Vec<String> = (signals.iter())
        .map(|one| {
            let words = one.numbered().filter(|_| !are_twins);
            let group = has_groups.then_some(one.group);
            let parts: Vec<&str> = group.into_iter().chain(words).collect();
            parts.join(" ")
        })
        .collect();
    let is_distinct = |label: &String| short.iter().filter(|one| *one == label).count() == 1;
    match short
        .iter()
        .all(|label| !label.is_empty() && is_distinct(label))
    {
        true => short,
        false => whole,
    }
}

/// Returns `true` if the end of a name spells a unit: `m3ps_per_sqrt_pa` spells `m3/s/sqrt(Pa)`, `nm` and `n_m`
/// spell `N m`.
fn spells(end: &str, unit: &str) -> bool {
    let end = end.trim_start_matches('_');
    let Some(character) = unit.chars().next() else {
        return end.is_empty();
    };
    let rest = &unit[character.len_utf8()..];
    let after = |text: &str| end.strip_prefix(text).is_some_and(|end| spells(end, rest));
    match character {
        '/' => after("per") || after("p"),
        letter if letter.is_ascii_alphanumeric() => {
            after(letter.to_ascii_lowercase().encode_utf8(&mut [0; 4]))
        }
        _ => spells(end, rest),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_found_at_the_end_of_names() {
        for (end, unit) in [
            ("m3ps_per_sqrt_pa", "m3/s/sqrt(Pa)"),
            ("radps2", "rad/s2"),
            ("n_m_s_per_rad", "N m s/rad"),
            ("nm", "N m"),
        ] {
            assert!(spells(end, unit), "{end} and {unit}");
        }
        assert!(!spells("angle_rad", "rad") && !spells("nm", "N"));
        let signal = Signal::of_name("truth.pump2_flow_m3ps", "m3/s");
        assert_eq!(signal.family(), "pump*_flow_m3ps");
    }

    #[test]
    fn an_expression_has_no_group_and_no_other_name_in_a_recording() {
        let difference = "measured.angle_rad - truth.angle_rad";
        assert_eq!(Signal::of_name(difference, "rad").group, "");
        assert_eq!(recorded_name(difference), difference);
        assert_eq!(
            recorded_name("parameter.pump1.leak"),
            "parameter.pump1_leak"
        );
    }

    #[test]
    fn an_alias_in_patterns_is_replaced_by_the_name() {
        let names = ["truth.x", "truth.speed", "truth.a_b", "error"];
        let aliases = [
            ("truth.a.b", "truth.speed"),
            ("truth.body.v", "truth.speed"),
            ("truth.body.x", "truth.x"),
        ];
        let aliases = aliases.map(|(alias, name)| (alias.to_owned(), name.to_owned()));
        for (patterns, expected) in [
            (&["truth.body.x"][..], &["truth.x"][..]),
            (&["truth.body_x"], &["truth.x"]),
            (&["truth.x", "truth.body.x"], &["truth.x"]),
            (&["truth.body.*"], &["truth.speed", "truth.x"]),
            // A pattern that also matches names matches only those.
            (&["*x", "truth.*"], &["*x", "truth.*"]),
            (&["*b*"], &["*b*", "truth.speed", "truth.x"]),
            // An exact name takes precedence over an alias in its recorded spelling.
            (&["truth.a_b"], &["truth.a_b"]),
            (&["nothing", "[x"], &["nothing", "[x"]),
        ] {
            let patterns: Vec<String> = patterns.iter().map(|&text| text.into()).collect();
            let own = own_names(&patterns, names.into_iter(), &aliases);
            assert_eq!(own, expected, "{patterns:?}");
        }
    }

    #[test]
    fn titles_and_labels_distinguish_curves_without_redundancy() {
        let of = |unit: &str, columns: &[&str]| {
            let signals: Vec<_> = columns
                .iter()
                .map(|one| Signal::of_name(one, unit))
                .collect();
            let title = title(&signals);
            let labels = labels(&Plot {
                title: title.clone(),
                unit: unit.into(),
                signals: columns.iter().map(|&column| column.into()).collect(),
                ..Plot::default()
            });
            (title, labels.join("|"))
        };
        #[rustfmt::skip] // a table
        let cases = [
            ("rad", &["reference.surface_angle_rad", "truth.surface_angle_rad"][..], "surface_angle_rad", "reference|truth"),
            ("rad", &["truth.surface_angle_rad"], "truth.surface_angle_rad", ""),
            ("Pa", &["truth.actuator1_pressure2_pa", "truth.actuator2_pressure1_pa"], "truth.actuator*_pressure*_pa", "actuator1 pressure2|actuator2 pressure1"),
            (
                "Pa",
                &[
                    "truth.pump1_pressure_pa",
                    "measured.pump1_pressure_pa",
                    "truth.pump2_pressure_pa",
                    "measured.pump2_pressure_pa",
                ],
                "pump*_pressure_pa",
                "truth pump1|measured pump1|truth pump2|measured pump2",
            ),
            ("N", &["internal.z11", "internal.z12"], "internal.z11, z12", "z11|z12"),
            ("1", &["internal.lyapunov_v3", "internal.lyapunov_bound"], "internal.lyapunov_*", "lyapunov_v3|lyapunov_bound"),
            (
                "m",
                &["truth.spring1_length_m", "truth.damper2_length_m"],
                "truth.spring1_length_m, truth.damper2_length_m",
                "spring1_length|damper2_length",
            ),
            ("ns", &["round_trip_ns", "controller_ns"], "round_trip_ns, controller_ns", "round_trip|controller"),
        ];
        for (unit, columns, title, labels) in cases {
            let expected = (title.to_owned(), labels.to_owned());
            assert_eq!(of(unit, columns), expected, "{columns:?}");
        }
    }

    #[test]
    fn with_a_title_from_the_scenario_the_label_names_the_signal() {
        let plot = Plot {
            title: "Force fight".into(),
            unit: "N".into(),
            signals: vec!["truth.force_fight_n".into()],
            ..Plot::default()
        };
        assert_eq!(labels(&plot), ["truth.force_fight"]);
    }
}
