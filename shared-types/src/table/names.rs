//! Names of signals: their units, and those closest to an unknown one.

/// Returns the unit that a name's suffix stands for, for example `rad` for `surface_angle_rad`.
///
/// Used for signals without a description: reference signals unknown to the law, and derived signals and metrics whose
/// expression does not determine a unit. A suffix after `_per_` or `_sqrt_` is only part of a unit and yields none.
#[must_use]
pub fn unit_of_name(name: &str) -> Option<&'static str> {
    const UNITS: [(&str, &str); 37] = [
        ("rad", "rad"),
        ("radps", "rad/s"),
        ("radps2", "rad/s2"),
        ("m", "m"),
        ("mps", "m/s"),
        ("mps2", "m/s2"),
        ("pa", "Pa"),
        ("n", "N"),
        ("nm", "N m"),
        ("kg", "kg"),
        ("m3", "m3"),
        ("m3ps", "m3/s"),
        ("a", "A"),
        ("v", "V"),
        ("s", "s"),
        ("hz", "Hz"),
        ("k", "K"),
        ("j", "J"),
        ("w", "W"),
        ("um", "um"),
        ("mm", "mm"),
        ("cm", "cm"),
        ("km", "km"),
        ("mmps", "mm/s"),
        ("kmph", "km/h"),
        ("us", "us"),
        ("ms", "ms"),
        ("deg", "deg"),
        ("degps", "deg/s"),
        ("rpm", "rpm"),
        ("degc", "degC"),
        ("kpa", "kPa"),
        ("mpa", "MPa"),
        ("bar", "bar"),
        ("kn", "kN"),
        ("khz", "kHz"),
        ("kw", "kW"),
    ];
    let (rest, ending) = name.rsplit_once('_')?;
    if rest.split('_').any(|word| matches!(word, "per" | "sqrt")) {
        return None;
    }
    UNITS
        .iter()
        .find(|(suffix, _)| *suffix == ending)
        .map(|(_, unit)| *unit)
}

/// Returns the name and unit of a signal's derivative. The second derivative of `surface_angle_rad` is
/// `surface_angle_d2_radps2` in `rad/s2`.
#[must_use]
pub fn derivative_of(name: &str, unit: &str, order: usize) -> (String, String) {
    let power = if order == 1 {
        String::new()
    } else {
        order.to_string()
    };
    let name = match name.rsplit_once('_') {
        Some((stem, ending)) => format!("{stem}_d{order}_{ending}ps{power}"),
        None => format!("{name}_d{order}_ps{power}"),
    };
    (name, format!("{unit}/s{power}"))
}

/// Returns up to three names that are closest to an unknown one, best first.
#[must_use]
pub fn nearest<'a>(unknown: &str, names: impl IntoIterator<Item = &'a str>) -> Vec<&'a str> {
    /// Length beyond that of any misspelled name; the time to compare names grows with the product of both lengths.
    const LONGEST: usize = 256;
    if unknown.len() > LONGEST {
        return Vec::new();
    }
    let mut scored: Vec<(f64, &str)> = names
        .into_iter()
        .map(|name| (closeness(unknown, name), name))
        .filter(|(score, _)| *score > 0.6)
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(b.1)));
    scored.into_iter().take(3).map(|(_, name)| name).collect()
}

/// Short names and words of other tools, each with its equivalent here.
const SYNONYMS: [(&str, &str); 14] = [
    ("kp", "proportional"),
    ("ki", "integral"),
    ("kd", "derivative"),
    ("p", "proportional"),
    ("i", "integral"),
    ("d", "derivative"),
    ("gauss", "noise"),
    ("gauss", "normal"),
    ("gaussian", "noise"),
    ("gaussian", "normal"),
    ("offset", "bias"),
    ("sin", "sine"),
    ("sinus", "sine"),
    ("sweep", "chirp"),
];

/// Returns the similarity of two names, from 0 to 1, by spelling or as synonyms.
fn closeness(unknown: &str, name: &str) -> f64 {
    let last = |name: &str| {
        name.rsplit_once('.')
            .map_or(0, |(group, _)| group.len() + 1)
    };
    let (typed, part) = (&unknown[last(unknown)..], &name[last(name)..]);
    let words = || part.split(['_', '-']);
    let stem = |name: &str| name.rsplit_once('_').map(|(stem, _)| stem.to_owned());
    let lower = unknown.to_ascii_lowercase();
    let is_meant =
        |(short, word): &(&str, &str)| *short == lower && words().any(|one| one == *word);
    // A parameter without its group, without its unit, or with another unit.
    let is_same = typed == part
        || stem(part).is_some_and(|stem| stem == typed)
        || (stem(part).is_some() && stem(part) == stem(typed) && unit_of_name(part).is_some());
    let alike = strsim::jaro_winkler(unknown, name);
    if SYNONYMS.iter().any(is_meant) || (is_same && unknown != name && part.len() > 1) {
        // Of several, the one in the same group is the most similar.
        return 0.98 + 0.01 * alike;
    }
    let longest = unknown.chars().count().max(name.chars().count());
    let edits = strsim::osa_distance(unknown, name);
    let few = if edits * 3 <= longest {
        1.0 - edits as f64 / 20.0
    } else {
        0.0
    };
    if alike > few { alike } else { few }
}

/// Formats names as a list: `` `a`, `b` ``.
#[must_use]
pub fn listed<S: AsRef<str>>(names: &[S]) -> String {
    let names: Vec<String> = names
        .iter()
        .map(|name| format!("`{}`", name.as_ref()))
        .collect();
    names.join(", ")
}

/// Formats the names closest to an unknown one as the end of a message; empty if no name is close.
#[must_use]
pub fn near<'a>(name: &str, names: impl IntoIterator<Item = &'a str>) -> String {
    let near = nearest(name, names);
    match near.is_empty() {
        true => String::new(),
        false => format!("; nearest: {}", listed(&near)),
    }
}

#[cfg(test)]
mod tests {
    use super::nearest;

    #[test]
    fn short_names_swapped_letters_and_other_units_lead_to_the_intended_name() {
        for (typed, names, name) in [
            ("rnu", &["rerun", "runs", "run"][..], "run"),
            (
                "kp",
                &["integral_n_per_m_s", "proportional_n_per_m"],
                "proportional_n_per_m",
            ),
            ("gauss", &["bias", "noise", "drift"], "noise"),
            ("gauss", &["uniform", "normal", "lognormal"], "normal"),
            ("position_mm", &["velocity_mps", "position_m"], "position_m"),
            ("mass", &["mass_kg", "max_force_n"], "mass_kg"),
            (
                "piston_mass_kg",
                &["piston_area_m2", "actuator1.piston_mass_kg"],
                "actuator1.piston_mass_kg",
            ),
        ] {
            assert_eq!(
                nearest(typed, names.iter().copied()).first(),
                Some(&name),
                "{typed}"
            );
        }
    }
}
