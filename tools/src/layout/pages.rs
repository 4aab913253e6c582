//! What to plot of a run by default: signals that belong together, in plots on pages.
//!
//! Takes the columns of a recording and knows no plant: a signal's group, its unit and the words of
//! its name decide. Used by the layouts; it reads no record and never asks what a value was.

use crate::run_reader::Column;

/// Most plots on a page; further ones go to the next.
const PLOTS: usize = 8;
/// Longest list of names that is a title, and longest name beside curves.
const SHORT: usize = 16;
/// Measured time and counts, by unit.
const LOOP: [(&str, &[&str]); 3] = [
    ("ns", &["round_trip_ns", "controller_ns", "plant_ns"]),
    ("ns", &["late_ns"]),
    (
        "steps",
        &["sample_age_steps", "command_age_steps", "held_steps"],
    ),
];

/// Plots that are seen together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Page {
    /// What they show.
    pub title: String,
    /// In order.
    pub plots: Vec<Plot>,
}

/// Signals over one time axis.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Plot {
    /// The name that its signals share, `*` for what differs, or their names if those are short.
    pub title: String,
    /// Their unit.
    pub unit: String,
    /// Names of columns, for example `truth.force_fight_n`.
    pub curves: Vec<String>,
    /// Where one of them is wanted and another is what became of it: both, the wanted one first.
    pub wanted: Option<[String; 2]>,
}

/// The pages of a recording with these columns.
///
/// 1. *Tracking*: each reference with truth and measurement of its name; the truths that are there
///    once; the commands.
/// 2. *Controller*: what it shows of itself, by unit and first word, beside truths of the same unit
///    that have a word in common with it: an estimate beside what it estimates.
/// 3. *Plant*: truths that differ by a number in their name.
/// 4. *Interface*: measurements beside the truth, commands beside what was applied.
/// 5. *Loop*: measured time.
#[must_use]
pub fn of(columns: &[Column]) -> Vec<Page> {
    let signals = Signals(columns.iter().filter_map(Signal::of).collect());
    let titled = [
        ("Tracking", signals.tracking()),
        ("Controller", signals.controller()),
        ("Plant", signals.plant()),
        ("Interface", signals.interface()),
        ("Loop", loop_times(columns)),
    ];
    let mut pages = Vec::new();
    for (title, plots) in titled {
        for (number, plots) in plots.chunks(PLOTS).enumerate() {
            let title = match number {
                0 => title.to_owned(),
                _ => format!("{title} {}", number + 1),
            };
            let plots = plots.to_vec();
            pages.push(Page { title, plots });
        }
    }
    pages
}

/// A signal, taken apart.
#[derive(Clone, Copy)]
struct Signal<'a> {
    column: &'a str,
    group: &'a str,
    name: &'a str,
    unit: &'a str,
}

impl<'a> Signal<'a> {
    fn of(column: &'a Column) -> Option<Self> {
        let (group, name) = column.name.split_once('.')?;
        Some(Self {
            column: &column.name,
            group,
            name,
            unit: &column.unit,
        })
    }

    /// Its name without and the rest with the unit.
    fn stem(&self) -> (&'a str, &'a str) {
        let words = self.name.match_indices('_').map(|(place, _)| place);
        let unit = words
            .filter(|place| spells(&self.name[place + 1..], self.unit))
            .min();
        self.name.split_at(unit.unwrap_or(self.name.len()))
    }

    /// Its name with `*` for each number that is none of the unit.
    fn family(&self) -> String {
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

    /// The numbers in its name that are none of the unit.
    fn numbers(&self) -> Vec<&'a str> {
        let parts = self.stem().0.split(|c: char| !c.is_ascii_digit());
        parts.filter(|part| !part.is_empty()).collect()
    }

    /// Words of its name without numbers.
    fn words(&self) -> impl Iterator<Item = &'a str> {
        let words = self.stem().0.split('_');
        words.map(|word| word.trim_end_matches(|c: char| c.is_ascii_digit()))
    }

    /// Whether it is of the same unit and has a word in common.
    fn is_akin(&self, other: &Self) -> bool {
        let has_unit = !["", "1"].contains(&self.unit);
        has_unit
            && self.unit == other.unit
            && self.words().any(|one| other.words().any(|w| w == one))
    }

    fn is_twin(&self, other: &Self) -> bool {
        self.name == other.name && self.unit == other.unit
    }
}

/// What tells the curves of a plot apart beside its title: short names as they are; of longer ones the
/// group and the numbers that the title's `*` stand for, or else all but the unit.
pub(super) fn labels(plot: &Plot) -> Vec<String> {
    let unit = plot.unit.as_str();
    let signals: Vec<Option<Signal<'_>>> = (plot.curves.iter())
        .map(|column| {
            let (group, name) = column.split_once('.')?;
            Some(Signal {
                column,
                group,
                name,
                unit,
            })
        })
        .collect();
    let whole = |(column, signal): (&String, &Option<Signal<'_>>)| {
        let unit = signal.map_or(0, |signal| signal.stem().1.len());
        column[..column.len() - unit].to_owned()
    };
    let whole: Vec<String> = plot.curves.iter().zip(&signals).map(whole).collect();
    let short: Option<Vec<String>> = signals
        .iter()
        .map(|signal| {
            let signal = signal.as_ref()?;
            let numbers = signal.numbers();
            let is_told = !numbers.is_empty() || signal.name == plot.title;
            is_told.then(|| [&[signal.group], &numbers[..]].concat().join(" "))
        })
        .collect();
    let of_one_family = |one: &Signal<'_>| {
        let mut of_group = (signals.iter().flatten()).filter(|other| other.group == one.group);
        of_group.all(|other| other.family() == one.family())
    };
    let are_akin = signals.iter().flatten().all(of_one_family);
    let is_long = whole.len() > 1 && whole.iter().any(|label| label.len() > SHORT);
    let are_distinct = |labels: &Vec<String>| {
        let mut sorted: Vec<&String> = labels.iter().collect();
        sorted.sort_unstable();
        sorted.windows(2).all(|pair| pair[0] != pair[1])
    };
    short
        .filter(|labels| is_long && are_akin && are_distinct(labels))
        .unwrap_or(whole)
}

/// Whether the end of a name says this unit: `m3ps_per_sqrt_pa` says `m3/s/sqrt(Pa)`, `nm` and `n_m`
/// say `N m`.
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

struct Signals<'a>(Vec<Signal<'a>>);

impl<'a> Signals<'a> {
    fn group(&self, group: &str) -> impl Iterator<Item = Signal<'a>> {
        self.0
            .iter()
            .filter(move |signal| signal.group == group)
            .copied()
    }

    fn twin(&self, group: &str, signal: &Signal<'_>) -> Option<Signal<'a>> {
        self.group(group).find(|other| other.is_twin(signal))
    }

    /// Whether it is plotted beside its reference.
    fn is_tracked(&self, signal: &Signal<'_>) -> bool {
        self.twin("reference", signal).is_some()
    }

    fn tracking(&self) -> Vec<Plot> {
        let mut plots = Vec::new();
        for reference in self.group("reference") {
            let truth = self.twin("truth", &reference);
            let measured = self.twin("measured", &reference);
            let curves: Vec<_> = [Some(reference), measured, truth]
                .into_iter()
                .flatten()
                .collect();
            if curves.len() > 1 {
                let became = truth.or(measured);
                let wanted = became.map(|it| [reference, it].map(|one| one.column.to_owned()));
                plots.push(Plot {
                    wanted,
                    ..plot(&curves)
                });
            }
        }
        let once = |signal: &Signal<'_>| !signal.family().contains('*') && !self.is_tracked(signal);
        plots.extend(
            self.group("truth")
                .filter(once)
                .map(|signal| plot(&[signal])),
        );
        plots.extend(together(self.group("command"), |signal| {
            signal.unit.to_owned()
        }));
        plots
    }

    fn controller(&self) -> Vec<Plot> {
        let first_word = |signal: &Signal<'_>| {
            (
                signal.unit.to_owned(),
                signal.words().next().map(str::to_owned),
            )
        };
        let mut plots = together(self.group("internal"), first_word);
        for plot in &mut plots {
            let of_plot =
                |signal: &Signal<'_>| plot.curves.iter().any(|curve| curve == signal.column);
            let shown: Vec<_> = self.group("internal").filter(of_plot).collect();
            let akin = |truth: &Signal<'_>| shown.iter().any(|signal| signal.is_akin(truth));
            (plot.curves).extend(
                self.group("truth")
                    .filter(akin)
                    .map(|truth| truth.column.to_owned()),
            );
        }
        plots
    }

    fn plant(&self) -> Vec<Plot> {
        let numbered = self
            .group("truth")
            .filter(|signal| signal.family().contains('*'));
        together(numbered, Signal::family)
    }

    fn interface(&self) -> Vec<Plot> {
        let beside = |group: &str, other: &'static str| {
            let untracked = self.group(group).filter(|signal| !self.is_tracked(signal));
            let twins = untracked.flat_map(move |signal| [Some(signal), self.twin(other, &signal)]);
            together(twins.flatten(), Signal::family)
        };
        [beside("measured", "truth"), beside("command", "applied")].concat()
    }
}

/// One plot for all signals with the same key, in the order in which they come first.
fn together<'a, K: PartialEq>(
    signals: impl Iterator<Item = Signal<'a>>,
    key: impl Fn(&Signal<'a>) -> K,
) -> Vec<Plot> {
    let mut sets: Vec<(K, Vec<Signal<'a>>)> = Vec::new();
    for signal in signals {
        let key = key(&signal);
        match sets.iter_mut().find(|(other, _)| *other == key) {
            Some((_, set)) => set.push(signal),
            None => sets.push((key, vec![signal])),
        }
    }
    sets.iter().map(|(_, set)| plot(set)).collect()
}

/// A plot of signals of one unit.
fn plot(signals: &[Signal<'_>]) -> Plot {
    let families: Vec<String> = signals.iter().map(Signal::family).collect();
    let names: Vec<&str> = signals.iter().map(|signal| signal.name).collect();
    let is_one = |all: &[&str]| all.iter().all(|one| *one == all[0]);
    let mut distinct = names.clone();
    distinct.dedup(); // twins of other groups stand beside each other
    let all_names = distinct.join(", ");
    let title = if is_one(&names) {
        names[0].to_owned()
    } else if all_names.len() <= SHORT {
        all_names
    } else if families.iter().all(|family| *family == families[0]) {
        families[0].clone()
    } else {
        let first: Vec<&str> = signals
            .iter()
            .filter_map(|signal| signal.words().next())
            .collect();
        let word = if is_one(&first) {
            first[0]
        } else {
            signals[0].group
        };
        format!("{word}_*")
    };
    Plot {
        title,
        unit: signals[0].unit.to_owned(),
        curves: signals
            .iter()
            .map(|signal| signal.column.to_owned())
            .collect(),
        wanted: None,
    }
}

fn loop_times(columns: &[Column]) -> Vec<Plot> {
    let recorded = |name: &&&str| columns.iter().any(|column| column.name == ***name);
    let plots = LOOP.iter().map(|(unit, names)| Plot {
        title: match names {
            [name] => (*name).to_owned(),
            _ => format!("*_{unit}"),
        },
        unit: (*unit).to_owned(),
        curves: names
            .iter()
            .filter(recorded)
            .map(|name| (*name).to_owned())
            .collect(),
        wanted: None,
    });
    plots.filter(|plot| !plot.curves.is_empty()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns(signals: &[(&str, &str)]) -> Vec<Column> {
        let column = |(name, unit): &(&str, &str)| Column {
            name: (*name).into(),
            unit: (*unit).into(),
        };
        signals.iter().map(column).collect()
    }

    /// Title and curves of each plot, by page.
    fn shown(signals: &[(&str, &str)]) -> Vec<(String, Vec<String>)> {
        let pages = of(&columns(signals));
        let plots = pages.into_iter().flat_map(|page| {
            let told = move |plot: Plot| (format!("{}/{}", page.title, plot.title), plot.curves);
            page.plots.into_iter().map(told)
        });
        plots.collect()
    }

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
        let signal = columns(&[("truth.pump2_flow_m3ps", "m3/s")]);
        let signal = Signal::of(&signal[0]).expect("a signal");
        assert_eq!(signal.family(), "pump*_flow_m3ps");
    }

    #[test]
    fn labels_tell_curves_apart_and_leave_out_what_the_title_says() {
        let labels = |title: &str, unit: &str, curves: &[&str]| {
            labels(&Plot {
                title: title.into(),
                unit: unit.into(),
                curves: curves.iter().map(|curve| (*curve).into()).collect(),
                wanted: None,
            })
        };
        let angles = ["reference.surface_angle_rad", "truth.surface_angle_rad"];
        let told = labels("surface_angle_rad", "rad", &angles);
        assert_eq!(told, ["reference", "truth"]);
        let pressures = ["truth.pump1_pressure2_pa", "truth.pump2_pressure1_pa"];
        let told = labels("pump*_pressure*_pa", "Pa", &pressures);
        assert_eq!(told, ["truth 1 2", "truth 2 1"]);
        let told = labels("z11, z12", "N", &["internal.z11", "internal.z12"]);
        assert_eq!(told, ["internal.z11", "internal.z12"]);
        let functions = ["internal.lyapunov_v3", "internal.lyapunov_bound"];
        assert_eq!(labels("lyapunov_*", "1", &functions), functions);
        let told = labels(
            "*_m",
            "m",
            &["truth.spring1_length_m", "truth.damper2_length_m"],
        );
        assert_eq!(told, ["truth.spring1_length", "truth.damper2_length"]);
        let told = labels("surface_angle_rad", "rad", &angles[1..]);
        assert_eq!(told, ["truth.surface_angle"]);
        let times = ["round_trip_ns", "controller_ns"];
        assert_eq!(labels("*_ns", "ns", &times), times);
    }

    #[test]
    fn a_reference_is_plotted_with_truth_and_measurement_of_its_name() {
        let plots = of(&columns(&[
            ("truth.angle_rad", "rad"),
            ("truth.energy_j", "J"),
            ("measured.angle_rad", "rad"),
            ("reference.angle_rad", "rad"),
            ("reference.angle_d1_radps", "rad/s"),
            ("command.torque_nm", "N m"),
        ]));
        let [page, _] = &plots[..] else {
            panic!("{plots:?}");
        };
        let titles: Vec<&str> = page.plots.iter().map(|plot| &*plot.title).collect();
        assert_eq!(titles, ["angle_rad", "energy_j", "torque_nm"]);
        let tracking = [
            "reference.angle_rad",
            "measured.angle_rad",
            "truth.angle_rad",
        ];
        assert_eq!(page.plots[0].curves, tracking);
        let wanted = ["reference.angle_rad", "truth.angle_rad"].map(str::to_owned);
        assert_eq!(page.plots[0].wanted, Some(wanted));
    }

    #[test]
    fn an_estimate_is_plotted_beside_what_it_estimates_and_nothing_else() {
        let plots = shown(&[
            ("truth.valve1_leakage_m3ps", "m3/s"),
            ("truth.valve1_flow_m3ps", "m3/s"),
            ("truth.force_n", "N"),
            ("internal.leakage_estimate1_m3ps", "m3/s"),
            ("internal.z11", "N"),
            ("internal.z12", "N"),
        ]);
        let expected = |title: &str, curves: &[&str]| {
            let curves: Vec<String> = curves.iter().map(|curve| (*curve).into()).collect();
            assert!(
                plots.contains(&(title.into(), curves)),
                "{title} in {plots:?}"
            );
        };
        let estimate = "internal.leakage_estimate1_m3ps";
        expected(
            "Controller/leakage_estimate1_m3ps",
            &[estimate, "truth.valve1_leakage_m3ps"],
        );
        expected("Controller/z11, z12", &["internal.z11", "internal.z12"]);
        expected("Tracking/force_n", &["truth.force_n"]);
        expected("Plant/valve1_flow_m3ps", &["truth.valve1_flow_m3ps"]);
    }

    #[test]
    fn what_an_excerpt_lacks_is_not_plotted() {
        let plots = shown(&[("measured.angle_rad", "rad"), ("round_trip_ns", "")]);
        let title = |plot: &(String, Vec<String>)| plot.0.clone();
        let titles: Vec<String> = plots.iter().map(title).collect();
        assert_eq!(titles, ["Interface/angle_rad", "Loop/*_ns"]);
        assert_eq!(plots[1].1, ["round_trip_ns"]);
        assert!(of(&columns(&[("step", "")])).is_empty());
    }

    #[test]
    fn many_plots_go_to_further_pages() {
        let names: Vec<String> = (0..10)
            .map(|i| format!("truth.{}_m", ["a", "b"][i % 2].repeat(i + 1)))
            .collect();
        let signals: Vec<(&str, &str)> = names.iter().map(|name| (&**name, "m")).collect();
        let pages = of(&columns(&signals));
        let counts: Vec<_> = pages
            .iter()
            .map(|page| (&*page.title, page.plots.len()))
            .collect();
        assert_eq!(counts, [("Tracking", 8), ("Tracking 2", 2)]);
    }
}
