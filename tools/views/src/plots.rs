//! Chooser of plots: signals of a run that are worth a look, and those that share a plot.
//!
//! Report, monitor and layout draw what is chosen here, so that a run looks alike in each; a view with
//! less room takes the first plots. Scenario, names and units decide, and no plant is known. Records are
//! never read: a view that has read them says through [`Values`] which plots have nothing to show.

pub mod bounds;
pub mod signal;

use glob::Pattern;
use hil_config::expression::Group;
use hil_config::plan::{Derived, FaultAction, Plan, Scale};
use serde::Serialize;
use shared_types::record::RecordLayout;

use bounds::{Bound, Other};
use hil_recording::reader::Column;
use signal::{Signal, recorded_name, title};

/// Most signals of a plot that nobody asked for, of one run and of several.
const MOST: [usize; 2] = [4, 2];

/// Title, unit, logarithmic axis and signals of measured times and ages.
const LOOP: [(&str, &str, bool, &[&str]); 3] = [
    (
        "Round trip of each step, the controller's part of it, and integration of the plant: spikes are the highest of their time",
        "ns",
        true,
        &["round_trip_ns", "controller_ns", "plant_ns"],
    ),
    (
        "How much later than due the sample was sent",
        "ns",
        true,
        &["late_ns"],
    ),
    (
        "Ages of sample and command, and for how many steps the command was held because a newer one was missed",
        "steps",
        false,
        &["sample_age_steps", "command_age_steps", "held_steps"],
    ),
];

/// Signals over one time axis.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Plot {
    /// Heading of this plot and of those beside it.
    pub section: &'static str,
    /// Heading of its own.
    pub title: String,
    /// Unit of its first signal.
    pub unit: String,
    /// Logarithmic vertical axis, for magnitudes.
    pub log: bool,
    /// Recorded or derived signals, by name.
    pub signals: Vec<String>,
    /// Signals of the scenario's plot that do not exist.
    pub missing: Vec<String>,
    /// Runs that the scenario means the plot for; `None`: all.
    pub runs: Option<Vec<usize>>,
    /// Level lines.
    pub lines: Vec<f64>,
    /// Levels of requirements.
    pub limits: Vec<Limit>,
}

/// A level that a requirement compares with.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Limit {
    level: f64,
    from_s: f64,
    until_s: f64,
    requirement: String,
}

/// A run that the plots are for.
#[derive(Default)]
pub struct Subject<'a> {
    /// Scenario, if it is understood.
    pub plan: Option<&'a Plan>,
    /// Laws that the run had.
    pub laws: Vec<&'a str>,
    /// Comparisons of its requirements.
    pub bounds: Vec<Bound>,
}

impl<'a> Subject<'a> {
    /// A run with the law of its scenario, without requirements.
    #[must_use]
    pub fn of(plan: &'a Plan) -> Self {
        Self {
            plan: Some(plan),
            laws: vec![&plan.controller.law],
            bounds: Vec::new(),
        }
    }
}

/// Answers about values, of a view that has read them.
pub trait Values {
    /// Reports signals that differ in any run.
    fn differ(&self, a: &str, b: &str) -> bool;
    /// Reports a signal that changes in any run.
    fn changes(&self, name: &str) -> bool;
}

/// Everything that a choice of plots depends on.
pub struct Choice<'a> {
    /// Signals by their recorded names, and derived ones.
    pub columns: &'a [Column],
    /// Runs, at least one.
    pub subjects: &'a [Subject<'a>],
    /// Signals that the command line names besides.
    pub asked: &'a [Pattern],
    /// Values, if they are known.
    pub values: Option<&'a dyn Values>,
}

/// Lists the signals of a record, as scenarios name them, and derived ones after them.
#[must_use]
pub fn columns_of(layout: &RecordLayout, derived: &[Derived]) -> Vec<Column> {
    let groups = Group::ALL.into_iter().zip(layout.groups());
    let columns = groups.flat_map(|(group, fields)| {
        fields.iter().map(move |field| Column {
            name: format!("{}.{}", group.prefix(), field.name),
            unit: field.unit.clone(),
        })
    });
    let derived = derived.iter().map(|derived| Column {
        name: derived.name.clone(),
        unit: derived.unit.clone(),
    });
    columns.chain(derived).collect()
}

/// Chooses the plots, those of the scenario first, then what decides its verdict.
#[must_use]
pub fn choose(choice: &Choice<'_>) -> Vec<Plot> {
    let mut chooser = Chooser {
        choice,
        signals: choice.columns.iter().map(Signal::of).collect(),
        plots: Vec::new(),
    };
    chooser.figures();
    chooser.asked();
    chooser.requirements();
    chooser.tracking();
    chooser.derived();
    chooser.together("Commands", chooser.fresh("command"), |one| one.unit);
    chooser.controller();
    chooser.together("Plant", chooser.fresh("truth"), Signal::family);
    chooser.interface();
    chooser.parameters();
    chooser.times();
    for plot in &mut chooser.plots {
        limit(plot, choice.subjects);
    }
    chooser.plots
}

/// Plots of signals that share a unit, as many to each as can be told apart.
#[must_use]
pub(crate) fn by_unit(columns: &[Column]) -> Vec<Plot> {
    let signals = columns.iter().map(Signal::of).collect();
    chunks("", signals, |one| one.unit, MOST[0])
}

/// Plots of signals with equal keys, in the order of the first of each, no more than `most` to one.
fn chunks<'a, K: PartialEq>(
    section: &'static str,
    signals: Vec<Signal<'a>>,
    key: impl Fn(&Signal<'a>) -> K,
    most: usize,
) -> Vec<Plot> {
    let mut sets: Vec<(K, Vec<Signal<'_>>)> = Vec::new();
    for signal in signals {
        let key = key(&signal);
        match sets.iter_mut().find(|(other, _)| *other == key) {
            Some((_, set)) => set.push(signal),
            None => sets.push((key, vec![signal])),
        }
    }
    let chunks = sets.iter().flat_map(|(_, set)| set.chunks(most));
    chunks.map(|chunk| plot(section, chunk)).collect()
}

fn plot(section: &'static str, signals: &[Signal<'_>]) -> Plot {
    Plot {
        section,
        title: title(signals),
        unit: signals[0].unit.to_owned(),
        signals: signals.iter().map(|one| one.column.to_owned()).collect(),
        ..Plot::default()
    }
}

/// Adds the levels of requirements on a plot's signals.
fn limit(plot: &mut Plot, subjects: &[Subject<'_>]) {
    let bounds = subjects.iter().flat_map(|subject| &subject.bounds);
    for bound in bounds.filter(|bound| plot.signals.contains(&bound.side.signal)) {
        if let Other::Level(level) = bound.other {
            let mirrored = bound.side.magnitude.then_some(-level);
            for level in std::iter::once(level).chain(mirrored) {
                let limit = Limit {
                    level,
                    from_s: bound.window_s[0],
                    until_s: bound.window_s[1],
                    requirement: bound.requirement.clone(),
                };
                // Runs of one scenario have the same ones.
                if !plot.limits.contains(&limit) {
                    plot.limits.push(limit);
                }
            }
        }
    }
}

struct Chooser<'a> {
    choice: &'a Choice<'a>,
    signals: Vec<Signal<'a>>,
    plots: Vec<Plot>,
}

impl<'a> Chooser<'a> {
    /// Plots that scenarios name.
    fn figures(&mut self) {
        let subjects = self.choice.subjects;
        for plot in self.plans().flat_map(|plan| &plan.plots) {
            // Runs of other scenarios may well show it too.
            let shows = |run: &usize| subjects[*run].laws.iter().any(|law| plot.is_for(law));
            let shown: Vec<usize> = (0..subjects.len()).filter(shows).collect();
            let is_known = self.plots.iter().any(|one| one.title == plot.title);
            let names = plot.signals.iter().map(|name| recorded_name(name));
            let (there, missing): (Vec<_>, _) = names.partition(|name| self.find(name).is_some());
            if let (false, false, Some(first)) = (is_known, shown.is_empty(), there.first()) {
                self.plots.push(Plot {
                    section: "Figures",
                    title: plot.title.clone(),
                    unit: (self.find(first)).map_or_else(String::new, |one| one.unit.into()),
                    log: plot.scale == Scale::Log,
                    signals: there,
                    missing,
                    runs: (shown.len() < subjects.len()).then_some(shown),
                    lines: plot.lines.clone(),
                    limits: Vec::new(),
                });
            }
        }
    }

    fn asked(&mut self) {
        for pattern in self.choice.asked {
            let matches = |one: &&Signal<'_>| pattern.matches(one.column);
            let signals = self.signals.iter().filter(matches).copied().collect();
            self.together("Signals asked for", signals, |one| one.unit);
        }
    }

    /// Comparisons of requirements: a signal, beside another if it is compared with one.
    fn requirements(&mut self) {
        let subjects = self.choice.subjects.iter();
        for bound in subjects.flat_map(|subject| &subject.bounds) {
            let other = match &bound.other {
                Other::Signal(other) => Some(&other.signal),
                Other::Level(_) => None,
            };
            let signals = [Some(&bound.side.signal), other].into_iter().flatten();
            let signals = signals.filter_map(|one| self.find(one)).collect();
            self.push_new("Requirements", signals);
        }
    }

    /// References beside the true or at least measured signal of their name.
    fn tracking(&mut self) {
        for reference in self.group("reference") {
            let mut groups = ["truth", "measured"].into_iter();
            let found = groups.find_map(|group| self.twin(group, &reference));
            if let Some(found) = found {
                self.push_new("Tracking", vec![reference, found]);
            }
        }
    }

    fn derived(&mut self) {
        let names: Vec<&str> = self
            .plans()
            .flat_map(|plan| &plan.derived)
            .map(|one| one.name.as_str())
            .collect();
        let is_derived = |one: &&Signal<'_>| names.contains(&one.column);
        let derived = self.unseen(self.signals.iter().filter(is_derived).copied());
        self.together("Derived", derived, |one| one.unit);
    }

    /// Internals by unit and first word, beside truths that are akin: an estimate beside what it
    /// estimates.
    fn controller(&mut self) {
        let key = |one: &Signal<'a>| (one.unit, one.words().next());
        let most = self.most();
        for mut plot in chunks("Controller", self.fresh("internal"), key, most) {
            let shown: Vec<_> = (plot.signals.iter())
                .filter_map(|name| self.find(name))
                .collect();
            let truths = self.group("truth").into_iter();
            let akin = truths.filter(|truth| shown.iter().any(|one| one.is_akin(truth)));
            let akin: Vec<String> = akin.take(most).map(|one| one.column.to_owned()).collect();
            plot.signals.extend(akin);
            self.plots.push(plot);
        }
    }

    /// Sensors beside the truth, commands beside what the plant applied; where values are known, only
    /// those that differ.
    fn interface(&mut self) {
        for [before, after] in [["truth", "measured"], ["command", "applied"]] {
            let mut signals = Vec::new();
            for one in self.group(after) {
                let pair: Vec<_> = (self.twin(before, &one).into_iter().chain([one])).collect();
                let is_worth = match (self.choice.values, &pair[..]) {
                    (None, _) => true,
                    (Some(values), [a, b]) => values.differ(a.column, b.column),
                    (Some(_), _) => false,
                };
                if is_worth && !self.shows_all(&pair) {
                    signals.extend(pair);
                }
            }
            self.together("Interface", signals, Signal::family);
        }
    }

    /// Parameters that faults move: those of the scenario or, where values are known, any.
    fn parameters(&mut self) {
        let effects = self
            .plans()
            .flat_map(|plan| &plan.faults)
            .flat_map(|fault| &fault.effects);
        let moves = effects.flat_map(|effect| match &effect.action {
            FaultAction::Move { moves, .. } => moves.as_slice(),
            FaultAction::Kind { .. } => &[],
        });
        let moved: Vec<String> = moves
            .map(|one| recorded_name(&format!("parameter.{}", one.parameter)))
            .collect();
        let is_moved = |one: &Signal<'_>| match self.choice.values {
            Some(values) => values.changes(one.column),
            None => moved.iter().any(|name| name == one.column),
        };
        let signals = self
            .fresh("parameter")
            .into_iter()
            .filter(is_moved)
            .collect();
        self.together("Parameters", signals, Signal::family);
    }

    fn times(&mut self) {
        for (title, unit, log, names) in LOOP {
            let there: Vec<String> = names
                .iter()
                .filter_map(|name| self.find(name))
                .map(|one| one.column.to_owned())
                .collect();
            for signals in there.chunks(self.most()) {
                self.plots.push(Plot {
                    section: "Loop",
                    title: if signals.len() < there.len() {
                        signals.join(", ")
                    } else {
                        title.into()
                    },
                    unit: unit.into(),
                    log,
                    signals: signals.to_vec(),
                    ..Plot::default()
                });
            }
        }
    }

    fn plans(&self) -> impl Iterator<Item = &'a Plan> + use<'a> {
        self.choice
            .subjects
            .iter()
            .filter_map(|subject| subject.plan)
    }

    fn most(&self) -> usize {
        MOST[usize::from(self.choice.subjects.len() > 1)]
    }

    fn find(&self, name: &str) -> Option<Signal<'a>> {
        self.signals.iter().find(|one| one.column == name).copied()
    }

    fn group(&self, group: &str) -> Vec<Signal<'a>> {
        self.signals
            .iter()
            .filter(|one| one.group == group)
            .copied()
            .collect()
    }

    /// The signal of a group with the same name and unit.
    fn twin(&self, group: &str, of: &Signal<'_>) -> Option<Signal<'a>> {
        let is_twin =
            |one: &&Signal<'_>| one.group == group && one.name == of.name && one.unit == of.unit;
        self.signals.iter().find(is_twin).copied()
    }

    /// Signals of a group that no plot shows yet.
    fn fresh(&self, group: &str) -> Vec<Signal<'a>> {
        self.unseen(self.group(group).into_iter())
    }

    fn unseen(&self, signals: impl Iterator<Item = Signal<'a>>) -> Vec<Signal<'a>> {
        signals.filter(|one| !self.shows_all(&[*one])).collect()
    }

    /// Reports a plot that shows all these signals.
    fn shows_all(&self, signals: &[Signal<'_>]) -> bool {
        let has = |plot: &Plot, name: &str| plot.signals.iter().any(|one| one == name);
        let has_all = |plot: &Plot| signals.iter().all(|one| has(plot, one.column));
        self.plots.iter().any(has_all)
    }

    fn together<K: PartialEq>(
        &mut self,
        section: &'static str,
        signals: Vec<Signal<'a>>,
        key: impl Fn(&Signal<'a>) -> K,
    ) {
        let plots = chunks(section, signals, key, self.most());
        self.plots.extend(plots);
    }

    /// Adds a plot of signals, unless one shows them all.
    fn push_new(&mut self, section: &'static str, signals: Vec<Signal<'a>>) {
        if !signals.is_empty() && !self.shows_all(&signals) {
            self.plots.push(plot(section, &signals));
        }
    }
}

#[cfg(test)]
mod tests;
