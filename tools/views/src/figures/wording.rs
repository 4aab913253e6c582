//! Words of a figure: titles of axes from descriptions and names of signals, and labels of curves.
//!
//! A signal is called by the first clause of its description, or else by its name in words. Never shows a value.

use std::collections::BTreeMap;

use crate::plots::signal::Signal;
use crate::plots::words::{capital, name_in, spelled};

/// Quantities of units, for signals that have no word in common.
const QUANTITIES: [(&str, &str); 16] = [
    ("rad", "Angle"),
    ("deg", "Angle"),
    ("rad/s", "Angular rate"),
    ("m", "Length"),
    ("m/s", "Velocity"),
    ("m/s2", "Acceleration"),
    ("N", "Force"),
    ("N m", "Torque"),
    ("Pa", "Pressure"),
    ("A", "Current"),
    ("V", "Voltage"),
    ("W", "Power"),
    ("m3/s", "Flow"),
    ("K", "Temperature"),
    ("kg", "Mass"),
    ("J", "Energy"),
];

/// Returns the title of an axis that all these signals share.
pub(super) fn title(signals: &[Signal<'_>], descriptions: &BTreeMap<String, String>) -> String {
    let Some(first) = signals.first() else {
        return String::new();
    };
    if signals.iter().all(|one| one.name == first.name) {
        // The description of a reference tells who commands it.
        let described = signals
            .iter()
            .filter(|one| one.group != "reference" || signals.len() == 1);
        let mut clauses = described.filter_map(|one| clause(descriptions.get(one.column)?));
        return clauses.next().unwrap_or_else(|| in_words(first));
    }
    let others = &signals[1..];
    let has = |signal: &Signal<'_>, word: &str| signal.words().any(|one| one == word);
    let common: Vec<&str> = first
        .words()
        .filter(|word| !word.is_empty() && others.iter().all(|one| has(one, word)))
        .collect();
    if !common.is_empty() {
        return capital(&common.join(" "));
    }
    let quantity = QUANTITIES.iter().find(|(unit, _)| *unit == first.unit);
    quantity.map_or_else(String::new, |(_, quantity)| (*quantity).to_owned())
}

/// Returns a label for each of several signals; a single one needs none.
pub(super) fn labels(signals: &[Signal<'_>]) -> Vec<String> {
    let [first, others @ ..] = signals else {
        return Vec::new();
    };
    if others.is_empty() {
        return vec![String::new()];
    }
    let are_twins = others.iter().all(|one| one.name == first.name);
    let of = |one: &Signal<'_>| {
        let shares_name = signals
            .iter()
            .filter(|other| other.name == one.name)
            .count()
            > 1;
        match (are_twins, shares_name) {
            (true, _) => one.group.to_owned(),
            (false, true) => format!("{} ({})", in_words(one), one.group),
            (false, false) => in_words(one),
        }
    };
    signals.iter().map(of).collect()
}

/// Returns the name of a signal in words: `actuator1_valve_current_a` as `Actuator 1 valve current`.
fn in_words(signal: &Signal<'_>) -> String {
    spelled(signal.column, signal.unit)
}

/// Returns the part of a description that is a title.
fn clause(description: &str) -> Option<String> {
    name_in(description).map(|name| lowered(&capital(&name)))
}

/// Lowers the number of a symbol: `u_1` becomes `u₁`.
fn lowered(text: &str) -> String {
    let mut result = String::new();
    let mut is_number = false;
    let characters: Vec<char> = text.chars().collect();
    for (place, one) in characters.iter().enumerate() {
        let next = characters.get(place + 1);
        if *one == '_' && place > 0 && next.is_some_and(char::is_ascii_digit) {
            is_number = true;
            continue;
        }
        is_number &= one.is_ascii_digit();
        let lower = char::from_u32(
            (*one as u32)
                .wrapping_sub(u32::from('0'))
                .wrapping_add(0x2080),
        )
        .filter(|_| is_number);
        result.push(lower.unwrap_or(*one));
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(unit: &str, columns: &[&str], described: &[(&str, &str)]) -> (String, String) {
        let signals: Vec<_> = columns
            .iter()
            .map(|one| Signal::of_name(one, unit))
            .collect();
        let described = described.iter();
        let described = described.map(|(name, text)| ((*name).to_owned(), (*text).to_owned()));
        (
            title(&signals, &described.collect()),
            labels(&signals).join("|"),
        )
    }

    #[test]
    fn a_signal_is_called_by_its_description_or_by_its_name_in_words() {
        let pressure = "truth.actuator1_pressure1_pa";
        let text = "Pressure in chamber 1; positive above the surroundings.";
        for (unit, columns, described, title, labels) in [
            (
                "Pa",
                &[pressure][..],
                &[(pressure, text)][..],
                "Pressure in chamber 1",
                "",
            ),
            ("Pa", &[pressure], &[], "Actuator 1 pressure 1", ""),
            (
                "Pa",
                &[pressure, "truth.actuator2_pressure1_pa"],
                &[(pressure, text)],
                "Actuator pressure",
                "Actuator 1 pressure 1|Actuator 2 pressure 1",
            ),
            (
                "rad",
                &["reference.angle_rad", "truth.angle_rad"],
                &[],
                "Angle",
                "reference|truth",
            ),
            (
                "N",
                &["truth.spring_n", "truth.damper_n"],
                &[],
                "Force",
                "Spring|Damper",
            ),
            (
                "1",
                &["internal.lyapunov_v3", "internal.bound"],
                &[],
                "",
                "Lyapunov v3|Bound",
            ),
            (
                "A",
                &["command.current_a"],
                &[(
                    "command.current_a",
                    "Current u_1 of valve 1; positive extends.",
                )],
                "Current u₁ of valve 1",
                "",
            ),
            ("rad", &["tracking_error_rad"], &[], "Tracking error", ""),
        ] {
            let expected = (title.to_owned(), labels.to_owned());
            assert_eq!(words(unit, columns, described), expected, "{columns:?}");
        }
    }
}
