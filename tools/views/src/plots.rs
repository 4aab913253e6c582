//! Selection of plots: the signals of a run that are drawn, and their distribution among plots.
//!
//! Report, monitor and layout draw the plots selected here, so that a run looks alike in each; a view with less room
//! takes the first plots. The selection depends on scenario, names and units, not on any particular plant. Records are
//! never read: a view that has read them reports uninformative plots through [`Values`].

pub(crate) mod arranged;
pub mod bounds;
pub mod signal;
pub mod words;

use std::collections::BTreeMap;

use glob::Pattern;
use hil_config::expression::Group;
use hil_config::plan::{Derived, FaultAction, Plan, PlotKind, Scale};
use serde::Serialize;
use shared_types::record::RecordLayout;

use bounds::{Bound, Other};
use hil_recording::reader::Column;
use signal::{Signal, recorded_name, title};

/// Maximum number of signals in an automatic plot, for one run and for several.
const MOST: [usize; 2] = [4, 2];

/// Title, unit, logarithmic axis and signals of measured times and ages.
const LOOP: [(&str, &str, bool, &[&str]); 3] = [
    (
        "Round trip of each step, the controller's part of it, and integration of the plant: the highest value of each interval",
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
    /// Heading of the section that contains this plot.
    pub section: &'static str,
    /// Title.
    pub title: String,
    /// Unit of its first signal.
    pub unit: String,
    /// `true` for a logarithmic vertical axis, used for magnitudes.
    pub log: bool,
    /// Recorded or derived signals, by name.
    pub signals: Vec<String>,
    /// Signals named by the scenario's plot that do not exist.
    pub missing: Vec<String>,
    /// Runs whose scenario requests the plot; `None` for all.
    pub runs: Option<Vec<usize>>,
    /// Level lines.
    pub lines: Vec<f64>,
    /// Limits set by requirements.
    pub limits: Vec<Limit>,
}

/// Level with which a requirement compares a signal.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Limit {
    pub(crate) level: f64,
    pub(crate) from_s: f64,
    pub(crate) until_s: f64,
    pub(crate) requirement: String,
}

/// Run for which plots are selected.
#[derive(Default)]
pub struct Subject<'a> {
    /// Scenario, if it is valid.
    pub plan: Option<&'a Plan>,
    /// Control laws of the run.
    pub laws: Vec<&'a str>,
    /// Comparisons in its requirements.
    pub bounds: Vec<Bound>,
}

impl<'a> Subject<'a> {
    /// Creates a run with the law of its scenario, without requirements.
    #[must_use]
    pub fn of(plan: &'a Plan) -> Self {
        Self {
            plan: Some(plan),
            laws: vec![&plan.controller.law],
            bounds: Vec::new(),
        }
    }
}

/// Facts about recorded values, from a view that has read them.
pub trait Values {
    /// Returns `true` if two signals differ in any run.
    fn differ(&self, a: &str, b: &str) -> bool;
    /// Returns `true` if a signal changes in any run.
    fn changes(&self, name: &str) -> bool;
}

/// Inputs of the selection.
pub struct Choice<'a> {
    /// Signals by their recorded names, and derived ones.
    pub columns: &'a [Column],
    /// Runs, at least one.
    pub subjects: &'a [Subject<'a>],
    /// Additional signals requested on the command line.
    pub patterns: &'a [Pattern],
    /// Values, if they were read.
    pub values: Option<&'a dyn Values>,
}

/// Lists the signals of a record by their scenario names, followed by derived ones.
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

/// Returns the descriptions of the signals of a session, by the names of their recorded columns.
#[must_use]
pub fn descriptions_of(layout: &RecordLayout) -> BTreeMap<String, String> {
    let groups = Group::ALL.into_iter().zip(layout.groups());
    let descriptions = groups.flat_map(|(group, fields)| {
        fields.iter().map(move |field| {
            let name = format!("{}.{}", group.prefix(), field.name);
            (recorded_name(&name), field.description.clone())
        })
    });
    descriptions.collect()
}

/// Selects the plots: first those of the scenario, then those that decide its verdict, then the rest. Times and ages of
/// the loop, which no scenario names, are always the last.
#[must_use]
pub fn choose(choice: &Choice<'_>) -> Vec<Plot> {
    let mut chooser = Chooser {
        choice,
        signals: choice.columns.iter().map(Signal::of).collect(),
        plots: Vec::new(),
    };
    chooser.figures();
    chooser.add_matches();
    if chooser.has_further() {
        chooser.further();
    }
    chooser.times();
    for plot in &mut chooser.plots {
        limit(plot, choice.subjects);
    }
    chooser.plots
}

/// Groups signals by unit into plots, with a limited number of signals in each.
pub(crate) fn by_unit(columns: &[Column]) -> Vec<Plot> {
    let signals = columns.iter().map(Signal::of).collect();
    chunks("", signals, |one| one.unit, MOST[0])
}

/// Groups signals with equal keys into plots, in the order of the first signal of each, with at most `most` per plot.
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

/// Adds the limits of requirements on a plot's signals.
pub(crate) fn limit(plot: &mut Plot, subjects: &[Subject<'_>]) {
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
                // Runs of one scenario share their limits.
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
    /// Adds the plots over time that scenarios define.
    fn figures(&mut self) {
        let subjects = self.choice.subjects;
        let plots = self.plans().flat_map(|plan| &plan.plots);
        for plot in plots.filter(|plot| plot.kind == PlotKind::Time) {
            // Runs of other scenarios may have the signals too.
            let shows = |run: &usize| subjects[*run].laws.iter().any(|law| plot.is_for(law));
            let indices: Vec<usize> = (0..subjects.len()).filter(shows).collect();
            let is_known = self.plots.iter().any(|one| one.title == plot.title);
            let names = plot.signals.iter().map(|name| recorded_name(name));
            let (there, missing): (Vec<_>, _) = names.partition(|name| self.find(name).is_some());
            if let (false, false, Some(first)) = (is_known, indices.is_empty(), there.first()) {
                self.plots.push(Plot {
                    section: "Figures",
                    title: plot.title.clone(),
                    unit: (self.find(first)).map_or_else(String::new, |one| one.unit.into()),
                    log: plot.scale == Scale::Log,
                    signals: there,
                    missing,
                    runs: (indices.len() < subjects.len()).then_some(indices),
                    lines: plot.lines.clone(),
                    limits: Vec::new(),
                });
            }
        }
    }

    /// Returns `true` unless all scenarios do without plots besides their own.
    fn has_further(&self) -> bool {
        let subjects = self.choice.subjects.iter();
        let mut plans = subjects.map(|subject| subject.plan);
        plans.any(|plan| plan.is_none_or(|plan| plan.further_plots))
    }

    /// Adds plots of the signals that are worth one and have none.
    fn further(&mut self) {
        self.requirements();
        self.tracking();
        self.derived();
        self.together("Commands", self.fresh("command"), |one| one.unit);
        self.together("Inputs", self.fresh("input"), |one| one.unit);
        self.controller();
        self.together("Plant", self.fresh("truth"), Signal::family);
        self.interface();
        self.parameters();
    }

    fn add_matches(&mut self) {
        for pattern in self.choice.patterns {
            let matches = |one: &&Signal<'_>| pattern.matches(one.column);
            let signals = self.signals.iter().filter(matches).copied().collect();
            self.together("Signals asked for", signals, |one| one.unit);
        }
    }

    /// Adds the comparisons of requirements: a signal, with the signal to which it is compared, if any.
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

    /// Adds references with the true signal of their name, or else the measured signal.
    fn tracking(&mut self) {
        for reference in self.group("reference") {
            let mut groups = ["truth", "measured"].into_iter();
            let twin = groups.find_map(|group| self.twin(group, &reference));
            if let Some(twin) = twin {
                self.push_new("Tracking", vec![reference, twin]);
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

    /// Adds internal signals by unit and first word, with related truths: an estimate beside the estimated signal.
    fn controller(&mut self) {
        let key = |one: &Signal<'a>| (one.unit, one.words().next());
        let most = self.most();
        for mut plot in chunks("Controller", self.fresh("internal"), key, most) {
            let names: Vec<_> = (plot.signals.iter())
                .filter_map(|name| self.find(name))
                .collect();
            let truths = self.group("truth").into_iter();
            let akin = truths.filter(|truth| names.iter().any(|one| one.is_akin(truth)));
            let akin: Vec<String> = akin.take(most).map(|one| one.column.to_owned()).collect();
            plot.signals.extend(akin);
            self.plots.push(plot);
        }
    }

    /// Adds sensors together with the truth and commands together with the applied ones; where values are known, only
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

    /// Adds parameters changed by faults: the parameters in the scenario or, where values are known, any that change.
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

    /// Returns the signal of a group with the same name and unit.
    fn twin(&self, group: &str, of: &Signal<'_>) -> Option<Signal<'a>> {
        let is_twin =
            |one: &&Signal<'_>| one.group == group && one.name == of.name && one.unit == of.unit;
        self.signals.iter().find(is_twin).copied()
    }

    /// Returns the signals of a group that no plot shows yet.
    fn fresh(&self, group: &str) -> Vec<Signal<'a>> {
        self.unseen(self.group(group).into_iter())
    }

    fn unseen(&self, signals: impl Iterator<Item = Signal<'a>>) -> Vec<Signal<'a>> {
        signals.filter(|one| !self.shows_all(&[*one])).collect()
    }

    /// Returns `true` if a plot shows all these signals.
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

    /// Adds a plot of signals, unless an existing plot shows them all.
    fn push_new(&mut self, section: &'static str, signals: Vec<Signal<'a>>) {
        if !signals.is_empty() && !self.shows_all(&signals) {
            self.plots.push(plot(section, &signals));
        }
    }
}

#[cfg(test)]
mod tests;
