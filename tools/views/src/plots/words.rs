//! Headings and legends of plots in words: descriptions of signals where there are any, else their names, spelled out.

use super::Plot;
use super::signal::Signal;

/// Longest description that is a name: a longer one explains.
const LONGEST: usize = 64;
/// Longest heading made of two descriptions.
const LONGEST_PAIR: usize = 90;

/// Words of a plot.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Words {
    /// Heading, without a unit.
    pub heading: String,
    /// Name of each signal in words.
    pub signals: Vec<String>,
}

impl Words {
    /// Returns the words of a plot, given the description of each signal that has one. The title of a scenario's plot
    /// is its heading.
    pub fn of<'a>(plot: &Plot, describe: impl Fn(&str) -> Option<&'a str>) -> Self {
        let names: Vec<String> = (plot.signals.iter())
            .map(|column| in_words(column, &plot.unit, describe(column)))
            .collect();
        let heading = match plot.section {
            "Figures" | "Loop" => plot.title.clone(),
            _ => heading(plot, &names),
        };
        Self {
            heading,
            signals: names,
        }
    }
}

/// Returns a signal in words: its description if that is a name, else its own name, spelled out.
#[must_use]
pub fn in_words(column: &str, unit: &str, description: Option<&str>) -> String {
    let name = description.and_then(name_in);
    name.unwrap_or_else(|| spelled(column, unit))
}

fn heading(plot: &Plot, names: &[String]) -> String {
    let [first, others @ ..] = names else {
        return plot.title.clone();
    };
    if others.iter().all(|one| one == first) {
        return first.clone();
    }
    let stems = plot.signals.iter().map(|column| {
        let family = Signal::of_name(column, &plot.unit).family();
        capital(&family.replace('*', "").replace('_', " "))
    });
    let stems: Vec<String> = stems.map(|stem| without_unit(&stem, &plot.unit)).collect();
    // `z11` and `z12` share a letter, which says nothing.
    if stems[0].len() > 2 && stems.iter().all(|stem| *stem == stems[0]) {
        return stems[0].clone();
    }
    match others {
        [second] if first.len() + second.len() < LONGEST_PAIR => {
            format!("{first} and {}", lower(second))
        }
        _ => common(names).unwrap_or_else(|| plot.title.clone()),
    }
}

/// Returns the first words that all names share.
fn common(names: &[String]) -> Option<String> {
    let mut words: Vec<&str> = names.first()?.split(' ').collect();
    for name in names {
        let same = words.iter().zip(name.split(' '));
        words.truncate(same.take_while(|(a, b)| *a == b).count());
    }
    (!words.is_empty()).then(|| words.join(" "))
}

/// Returns the part of a description that names the signal: the text before the first aside, without the full stop.
/// `None` if that explains rather than names.
pub(crate) fn name_in(description: &str) -> Option<String> {
    let end = description.find([',', ';', '\n', ':']);
    let mut name = &description[..end.unwrap_or(description.len())];
    if let Some((before, _)) = name.split_once(" (") {
        name = before;
    }
    let name = name.trim().trim_end_matches('.');
    let names = name.starts_with(|first: char| first.is_alphabetic());
    (names && name.len() <= LONGEST && !name.contains('`')).then(|| name.to_owned())
}

/// Spells a name out: `truth.force_fight_n` in N is `Force fight`. An expression remains as it is.
pub(crate) fn spelled(column: &str, unit: &str) -> String {
    let is_name = |text: &str| {
        text.chars()
            .all(|one| one.is_ascii_alphanumeric() || matches!(one, '_' | '.'))
    };
    if !is_name(column) {
        return column.to_owned();
    }
    let signal = Signal::of_name(column, unit);
    let words = signal.label(false).split(['_', '.']);
    let words: Vec<String> = words.map(numbered).collect();
    capital(&words.join(" "))
}

/// Parts a word from the number at its end: `valve 2`, but `z11`.
fn numbered(word: &str) -> String {
    let stem = word.trim_end_matches(|one: char| one.is_ascii_digit());
    match stem.len() > 2 && stem.len() < word.len() {
        true => format!("{stem} {}", &word[stem.len()..]),
        false => word.to_owned(),
    }
}

/// Removes the words of a unit from the end of a spelled name.
fn without_unit(name: &str, unit: &str) -> String {
    let column = name.replace(' ', "_");
    let signal = Signal::of_name(&column, unit);
    let label = signal.label(true).replace('_', " ");
    label.trim().to_owned()
}

pub(crate) fn capital(text: &str) -> String {
    cased(text, |first| first.to_uppercase().collect())
}

/// Lowers the first letter of a word that is no abbreviation.
pub(crate) fn lower(text: &str) -> String {
    let second = text.chars().nth(1);
    match second.is_some_and(char::is_lowercase) {
        true => cased(text, |first| first.to_lowercase().collect()),
        false => text.to_owned(),
    }
}

fn cased(text: &str, change: impl Fn(char) -> String) -> String {
    let mut rest = text.chars();
    rest.next()
        .map(|first| change(first) + rest.as_str())
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(section: &'static str, unit: &str, signals: &[(&str, &str)]) -> (String, String) {
        let plot = Plot {
            section,
            title: "the title".into(),
            unit: unit.into(),
            signals: signals.iter().map(|(name, _)| (*name).to_owned()).collect(),
            ..Plot::default()
        };
        let describe = |name: &str| {
            let signal = signals.iter().find(|(one, _)| *one == name);
            signal
                .map(|(_, text)| *text)
                .filter(|text| !text.is_empty())
        };
        let words = Words::of(&plot, describe);
        (words.heading, words.signals.join(" | "))
    }

    #[test]
    fn a_description_is_the_heading_without_its_asides() {
        for (description, expected) in [
            ("Pressure in chamber 1.", "Pressure in chamber 1"),
            (
                "Position x_h of piston 1, 0 in the middle.",
                "Position x_h of piston 1",
            ),
            (
                "Current u_1 of valve 1; positive extends.",
                "Current u_1 of valve 1",
            ),
            (
                "Error z_11 of the position sum (eq. 39).",
                "Error z_11 of the position sum",
            ),
            // It explains and names nothing.
            ("1 while V_3 is above V_r, else 0.", "Rod angle"),
            ("", "Rod angle"),
        ] {
            let result = words("Plant", "rad", &[("truth.rod_angle_rad", description)]);
            assert_eq!(result, (expected.to_owned(), expected.to_owned()));
        }
    }

    #[test]
    fn several_signals_have_a_heading_for_all_and_a_name_each() {
        let twins = [
            ("reference.surface_angle_rad", "Command of the rig."),
            ("truth.surface_angle_rad", "Angle theta_d of the surface."),
        ];
        let (heading, names) = words("Tracking", "rad", &twins);
        assert_eq!(heading, "Surface angle");
        assert_eq!(names, "Command of the rig | Angle theta_d of the surface");
        let errors = [
            ("internal.z11", "Error z_11 of the sum (eq. 39)."),
            ("internal.z12", "Error z_12 of the difference."),
        ];
        let (heading, _) = words("Controller", "N", &errors);
        assert_eq!(
            heading,
            "Error z_11 of the sum and error z_12 of the difference"
        );
        let pressures = [
            ("truth.pump1_pressure2_pa", "Pressure P_12."),
            ("truth.pump2_pressure1_pa", "Pressure P_21."),
        ];
        assert_eq!(words("Plant", "Pa", &pressures).0, "Pump pressure");
        let mixed = [
            ("truth.spring_length_m", ""),
            ("truth.damper_length_m", ""),
            ("truth.rod_m", ""),
        ];
        let (heading, names) = words("Plant", "m", &mixed);
        assert_eq!(
            (&*heading, &*names),
            ("the title", "Spring length | Damper length | Rod")
        );
    }

    #[test]
    fn a_title_of_the_scenario_and_an_expression_remain() {
        let figure = words("Figures", "N", &[("truth.force_fight_n", "Force fight.")]);
        assert_eq!(figure, ("the title".into(), "Force fight".into()));
        let numbers = [("truth.valve2_z11_m", "")];
        assert_eq!(words("Plant", "m", &numbers).0, "Valve 2 z11");
        let (heading, _) = words("Requirements", "m", &[("truth.a_m - truth.b_m", "")]);
        assert_eq!(heading, "truth.a_m - truth.b_m");
    }
}
