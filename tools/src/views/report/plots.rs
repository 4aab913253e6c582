//! Which plots a report has, for a plant that nobody has seen before.
//!
//! What the scenario asks for comes first, then what decides the verdict, then what follows from the
//! signal tables: what is wanted beside what is, sensors that do not tell the truth, derived signals,
//! commands, parameters that faults moved, and how long steps took. Any other signal can be added on the
//! page.

use std::collections::BTreeSet;

use glob::Pattern;
use hil_config::plan::Scale;
use serde::Serialize;

use super::bounds::{Bound, Other};
use super::grid::Grid;
use super::run::{Run, Signals};

/// Most signals of one plot that nobody asked for, of one run and of several.
const MOST: [usize; 2] = [4, 2];

/// A plot.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(super) struct Plot {
    pub(super) section: &'static str,
    pub(super) title: String,
    pub(super) unit: String,
    /// Whether its vertical axis is logarithmic, for magnitudes.
    pub(super) log: bool,
    pub(super) signals: Vec<String>,
    /// Signals that it should show and that have no value in any run.
    pub(super) missing: Vec<String>,
    /// The runs that it is for; null: all.
    pub(super) runs: Option<Vec<usize>>,
    /// Level lines.
    pub(super) lines: Vec<f64>,
    pub(super) limits: Vec<Limit>,
    pub(super) marks: Vec<Mark>,
}

/// A level that a requirement compares with.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Limit {
    pub(super) level: f64,
    pub(super) from_s: f64,
    pub(super) until_s: f64,
    pub(super) requirement: String,
}

/// Where the margin of a requirement comes from.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Mark {
    pub(super) run: usize,
    pub(super) requirement: String,
    pub(super) signal: String,
    pub(super) at_s: f64,
    /// The value of the signal and what it is compared with; null if no comparison alone gives the margin.
    pub(super) decisive: Option<[f64; 2]>,
    pub(super) holds: bool,
}

/// Everything that a choice of plots depends on.
pub(super) struct Ground<'a> {
    pub(super) runs: &'a [Run],
    pub(super) signals: &'a [Signals],
    pub(super) bounds: &'a [Bound],
    pub(super) grid: &'a Grid,
    /// Signals that the command line names.
    pub(super) asked: &'a [Pattern],
}

struct Choice<'a> {
    ground: &'a Ground<'a>,
    plots: Vec<Plot>,
}

/// The plots in their order.
pub(super) fn plots(ground: &Ground<'_>) -> Vec<Plot> {
    let mut choice = Choice {
        ground,
        plots: Vec::new(),
    };
    choice.of_scenarios();
    choice.of_command_line();
    choice.of_requirements();
    choice.of_references();
    choice.of_sensors();
    choice.of_groups();
    choice.of_time();
    let marks = marks(ground);
    for plot in &mut choice.plots {
        bind(plot, ground.bounds, &marks);
    }
    choice.plots
}

/// Where the margins come from: the comparisons that give them, or all of which none does alone.
fn marks(ground: &Ground<'_>) -> Vec<Mark> {
    let mut marks = Vec::new();
    for (number, run) in ground.runs.iter().enumerate() {
        for judged in &run.requirements {
            let Some(at_s) = judged.at_s else {
                continue;
            };
            let step = run.rate.step_at_or_after(at_s);
            let bucket = ground.grid.bucket(0, run.rate.nanoseconds(step));
            // An edge looks at the step before, and times have roundings.
            let period_s = run.rate.period_s();
            let counts = |bound: &&Bound| {
                let [from_s, until_s] = bound.window_s;
                let near_s = from_s - 1.5 * period_s..=until_s + 0.5 * period_s;
                bound.run == number && bound.requirement == judged.name && near_s.contains(&at_s)
            };
            let of_it: Vec<Mark> = (ground.bounds.iter().filter(counts))
                .map(|bound| Mark {
                    run: number,
                    requirement: judged.name.clone(),
                    signal: bound.side.signal.clone(),
                    at_s,
                    decisive: judged
                        .robustness
                        .and_then(|margin| bound.decisive(margin, &ground.signals[number], bucket)),
                    holds: judged.verdict == "pass",
                })
                .collect();
            let is_known = of_it.iter().any(|mark| mark.decisive.is_some());
            marks.extend(
                of_it
                    .into_iter()
                    .filter(|mark| mark.decisive.is_some() == is_known),
            );
        }
    }
    marks
}

/// Levels and marks of the requirements on a plot's signals.
fn bind(plot: &mut Plot, bounds: &[Bound], marks: &[Mark]) {
    let of_plot = |signal: &String| plot.signals.contains(signal);
    let shown = marks.iter().filter(|mark| of_plot(&mark.signal));
    plot.marks = shown.cloned().collect();
    for bound in bounds.iter().filter(|bound| of_plot(&bound.side.signal)) {
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

impl Choice<'_> {
    fn of_scenarios(&mut self) {
        let runs = self.ground.runs;
        for plot in runs
            .iter()
            .filter_map(Run::plan)
            .flat_map(|plan| &plan.plots)
        {
            // Runs of other scenarios may well show it too.
            let is_for = |run: &Run| run.laws.names().any(|law| plot.is_for(law));
            let shown: Vec<usize> = (0..runs.len()).filter(|run| is_for(&runs[*run])).collect();
            let is_known = self.plots.iter().any(|one| one.title == plot.title);
            if !is_known && !shown.is_empty() {
                self.push(Plot {
                    section: "Figures",
                    title: plot.title.clone(),
                    log: plot.scale == Scale::Log,
                    signals: plot.signals.clone(),
                    runs: (shown.len() < runs.len()).then_some(shown),
                    lines: plot.lines.clone(),
                    ..Plot::default()
                });
            }
        }
    }

    fn of_command_line(&mut self) {
        for pattern in self.ground.asked {
            let names = self.names(|name| pattern.matches(name));
            self.by_unit("Signals asked for", names);
        }
    }

    fn of_requirements(&mut self) {
        for bound in self.ground.bounds {
            let mut signals = vec![bound.side.signal.clone()];
            if let Other::Signal(other) = &bound.other {
                signals.push(other.signal.clone());
            }
            self.push_new("Requirements", signals);
        }
    }

    /// What is wanted, beside what is true of the same name or at least measured.
    fn of_references(&mut self) {
        for reference in self.names(|name| name.starts_with("reference.")) {
            let name = &reference["reference.".len()..];
            let found = ["truth", "measured"].map(|group| format!("{group}.{name}"));
            if let Some(found) = found.into_iter().find(|name| self.exists(name)) {
                self.push_new("Wanted and true", vec![reference, found]);
            }
        }
    }

    /// Sensors whose value is not the true one.
    fn of_sensors(&mut self) {
        for measured in self.names(|name| name.starts_with("measured.")) {
            let truth = format!("truth.{}", &measured["measured.".len()..]);
            if self.differ(&measured, &truth) {
                self.push_new(
                    "Sensors that do not tell the truth",
                    vec![truth, measured.clone()],
                );
            }
        }
    }

    /// Signals by what they are.
    fn of_groups(&mut self) {
        let derived = self.names(|name| {
            let plans = self.ground.runs.iter().filter_map(Run::plan);
            plans
                .flat_map(|plan| &plan.derived)
                .any(|one| one.name == name)
        });
        self.by_unit("Derived", self.not_shown(derived));
        let commands = self.names(|name| {
            let applied = |command: &str| format!("applied.{command}");
            name.starts_with("command.") || {
                let command = name.strip_prefix("applied.");
                command.is_some_and(|command| {
                    self.differ(&format!("command.{command}"), &applied(command))
                })
            }
        });
        self.by_unit("Commands", self.not_shown(commands));
        let moved = self.names(|name| {
            let is_still =
                |signals: &Signals| signals.get(name).is_none_or(|one| one.constant().is_some());
            name.starts_with("parameter.") && !self.ground.signals.iter().all(is_still)
        });
        self.by_unit("Parameters that faults moved", self.not_shown(moved));
    }

    fn of_time(&mut self) {
        for (name, title) in [
            (
                "round_trip_ns",
                "Round trip of each step: spikes are the highest of their time",
            ),
            ("controller_ns", "Of that the controller"),
            ("plant_ns", "Integration of the plant"),
            ("late_ns", "How much later than due the sample was sent"),
            (
                "held_steps",
                "For how many steps the command was held because a newer one was missed",
            ),
        ] {
            self.push(Plot {
                section: "Time",
                title: title.into(),
                log: name != "held_steps",
                signals: vec![name.into()],
                ..Plot::default()
            });
        }
    }

    /// The names of all signals of all runs, once each.
    fn names(&self, wanted: impl Fn(&str) -> bool) -> Vec<String> {
        let mut seen = BTreeSet::new();
        let names = self.ground.signals.iter().flat_map(Signals::iter);
        names
            .map(|(name, ..)| name)
            .filter(|name| wanted(name) && seen.insert(*name))
            .map(str::to_owned)
            .collect()
    }

    fn not_shown(&self, names: Vec<String>) -> Vec<String> {
        let is_shown = |name: &String| self.plots.iter().any(|plot| plot.signals.contains(name));
        names.into_iter().filter(|name| !is_shown(name)).collect()
    }

    fn exists(&self, name: &str) -> bool {
        self.unit(name).is_some()
    }

    fn unit(&self, name: &str) -> Option<&str> {
        self.ground
            .signals
            .iter()
            .find_map(|signals| signals.unit(name))
    }

    fn differ(&self, a: &str, b: &str) -> bool {
        self.ground.signals.iter().any(|signals| {
            let pair = signals.get(a).zip(signals.get(b));
            pair.is_some_and(|(a, b)| !a.is_same(b))
        })
    }

    /// Plots of signals that share a unit, a few to each.
    fn by_unit(&mut self, section: &'static str, names: Vec<String>) {
        let mut units: Vec<(String, Vec<String>)> = Vec::new();
        for name in names {
            let unit = self.unit(&name).unwrap_or_default().to_owned();
            match units.iter_mut().find(|(one, _)| *one == unit) {
                Some((_, names)) => names.push(name),
                None => units.push((unit, vec![name])),
            }
        }
        let most = MOST[usize::from(self.ground.runs.len() > 1)];
        for (_, names) in units {
            for names in names.chunks(most) {
                self.push(Plot {
                    section,
                    title: names.join(", "),
                    signals: names.to_vec(),
                    ..Plot::default()
                });
            }
        }
    }

    /// A plot of signals, unless one shows them all.
    fn push_new(&mut self, section: &'static str, signals: Vec<String>) {
        let has_all = |plot: &Plot| signals.iter().all(|name| plot.signals.contains(name));
        if !self.plots.iter().any(has_all) {
            self.push(Plot {
                section,
                title: signals.join(", "),
                signals,
                ..Plot::default()
            });
        }
    }

    /// A plot of those of its signals that are there, if any is.
    fn push(&mut self, mut plot: Plot) {
        let (there, missing) = (plot.signals.into_iter()).partition(|name| self.exists(name));
        (plot.signals, plot.missing) = (there, missing);
        let Some(first) = plot.signals.first() else {
            return;
        };
        plot.unit = self.unit(first).unwrap_or_default().to_owned();
        self.plots.push(plot);
    }
}
