//! What to plot of a run by default: signals that belong together, in plots on pages.
//!
//! Takes the columns of a recording and knows no plant: a signal's group, its unit and the words of
//! its name decide. Used by the layouts; it reads no record and never asks what a value was.

use shared_types::number::unit_shown;

use hil_recording::reader::Column;

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
        Self::new(&column.name, &column.unit)
    }

    fn new(column: &'a str, unit: &'a str) -> Option<Self> {
        let (group, name) = column.split_once('.')?;
        Some(Self {
            column,
            group,
            name,
            unit,
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
        let has_unit = !unit_shown(self.unit).is_empty();
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
        .map(|column| Signal::new(column, unit))
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
mod tests;
