//! Studies: a scenario, its varied values, the number of cases, and the seed.
//!
//! Read by `hil campaign`, which draws the values of each case and applies them to the scenario like `--set`. Draws
//! nothing itself, and is independent of plants and laws: values are validated when the scenario of a case is checked,
//! and [`Study::at_home`] maps the problems back to their places in the study.

mod faults;
mod read;

use std::path::{Path, PathBuf};

use crate::expression::Expression;
use crate::flag::key_of;
use crate::problem::{FLAG, Problem, ProblemKind, Problems};
use crate::reader::Reader;
use crate::scenario::{Scenario, advice_on_missing};
use crate::source::{Place, Sources};
pub use faults::{FAULT, FaultKindTable, FaultTable, TriedFault};

/// Maximum number of values in Sobol' points.
pub const MOST_SOBOL: usize = 64;

/// Study that was checked as far as possible without its scenario.
#[derive(Clone, Debug)]
pub struct Study {
    /// Name, which becomes part of folder names.
    pub name: String,
    /// Question that the study answers; may be empty.
    pub description: String,
    /// Scenario, relative to the working directory.
    pub scenario: PathBuf,
    /// Flags `KEY=VALUE` for every case.
    pub set: Vec<String>,
    /// Number of draws.
    pub draws: u64,
    /// Seed of the draws.
    pub seed: u64,
    /// Sampling method.
    pub sampling: Sampling,
    /// Confidence of bounds.
    pub confidence: f64,
    /// Time in s after which a case counts as hung.
    pub case_limit_s: f64,
    /// Time in s that a side of a case may take to answer.
    pub wait_limit_s: f64,
    /// `true` to restart the campaign's own programs for each case.
    pub fresh_processes: bool,
    /// Varied values; each depends only on earlier ones.
    pub varied: Vec<Varied>,
    /// Versions compared on the same draws; at least one.
    pub variants: Vec<Variant>,
    /// Correlations of varied values.
    pub correlations: Vec<Correlation>,
    /// Requirements on the whole campaign.
    pub goals: Vec<Goal>,
    /// Settings of a search.
    pub search: Search,
    /// Faults of which each is tried alone; the first varied value chooses one, once their targets are known.
    pub faults: Option<FaultTable>,
    sources: Sources,
    /// Folder of the study, to which its paths are relative.
    folder: PathBuf,
    /// Places of the scenario and of flags, by their keys.
    homes: Vec<(String, Place)>,
}

/// Sampling method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sampling {
    /// Independent draws of each value.
    Independent,
    /// Each value once from each of as many equally likely ranges as there are draws.
    LatinHypercube,
    /// Points of Sobol's sequence, displaced by a random shift.
    Sobol,
    /// Every combination.
    Grid,
    /// Saltelli's scheme for Sobol' indices: two points of Sobol's sequence, and one for each value, which has that
    /// value from the second and all others from the first.
    Saltelli,
}

impl Sampling {
    /// Returns the name in a study.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Independent => "independent",
            Self::LatinHypercube => "latin-hypercube",
            Self::Sobol => "sobol",
            Self::Grid => "grid",
            Self::Saltelli => "saltelli",
        }
    }
}

/// Varied value.
#[derive(Clone, Debug, PartialEq)]
pub struct Varied {
    /// Name in expressions and tables.
    pub name: String,
    /// Scenario key as for `--set`; `None` for a value that only expressions use.
    pub key: Option<String>,
    /// Distribution or set of its values.
    pub spread: Spread,
    /// `true` if only whole numbers are drawn: equally likely ones for uniform values, otherwise rounded to the
    /// nearest.
    pub is_whole: bool,
    /// Value from which a search measures distances; `None` for the default.
    pub nominal: Option<f64>,
}

/// Settings of a search for the point at which a requirement breaks.
#[derive(Clone, Debug, PartialEq)]
pub struct Search {
    /// Requirement whose failure is searched; `None` for any.
    pub requirement: Option<String>,
    /// Variant that is searched; `None` for the only one.
    pub variant: Option<String>,
    /// Largest distance between a failing point and its passing neighbour, in units of the ranges.
    pub tolerance: f64,
    /// Number of sizes between both ends that are tried before bisection.
    pub probes: u64,
    /// Largest number of runs.
    pub runs: u64,
}

/// Distribution or set of a varied value.
#[derive(Clone, Debug, PartialEq)]
pub enum Spread {
    /// Any value between two limits.
    Uniform {
        /// Smallest.
        min: f64,
        /// Largest.
        max: f64,
    },
    /// Normal, truncated to a range that may be infinite.
    Normal {
        /// Mean before truncation.
        mean: f64,
        /// Standard deviation before truncation.
        deviation: f64,
        /// Range.
        within: [f64; 2],
    },
    /// Lognormal, truncated to a range that may be infinite.
    Lognormal {
        /// Median before truncation.
        median: f64,
        /// Standard deviation of the natural logarithm before truncation.
        sigma: f64,
        /// Range.
        within: [f64; 2],
    },
    /// Choice among these values.
    Choice(Vec<Item>),
    /// Computed from values that are varied earlier.
    Expression(Expression),
}

/// Value from a list.
#[derive(Clone, Debug, PartialEq)]
pub enum Item {
    /// Number, with its TOML text.
    Number(f64, String),
    /// A text.
    Text(String),
    /// Boolean.
    Flag(bool),
    /// Table, with a text that stands for it.
    Table {
        /// Text.
        label: String,
        /// TOML text.
        toml: String,
    },
}

/// Version of the scenario.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Variant {
    /// Name.
    pub name: String,
    /// Flags `KEY=VALUE` that define the version.
    pub set: Vec<String>,
    /// Alarm in place of that of the table of faults.
    pub detected: Option<String>,
}

/// Correlation of two varied values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correlation {
    /// Indices of both among the varied values, the smaller one first.
    pub of: [usize; 2],
    /// Coefficient between the underlying normal values.
    pub coefficient: f64,
}

/// Requirement on the whole campaign.
#[derive(Clone, Debug, PartialEq)]
pub struct Goal {
    /// Requirement of the scenario; `None` means that the case passes.
    pub requirement: Option<String>,
    /// Variant; `None` means every variant.
    pub variant: Option<String>,
    /// Minimum probability.
    pub probability: f64,
    /// Confidence with which the goal must be shown.
    pub confidence: f64,
}

impl Varied {
    /// Returns the finite range of the values, and the value from which distances are measured; `None` for a value
    /// without such a range.
    #[must_use]
    pub fn range(&self) -> Option<([f64; 2], f64)> {
        let (range, usual) = match self.spread {
            Spread::Uniform { min, max } => ([min, max], min),
            Spread::Normal { mean, within, .. } => (within, mean),
            Spread::Lognormal { median, within, .. } => (within, median),
            Spread::Choice(_) | Spread::Expression(_) => return None,
        };
        let [min, max] = range;
        let nominal = self.nominal.unwrap_or_else(|| usual.clamp(min, max));
        (min.is_finite() && max.is_finite()).then_some((range, nominal))
    }
}

impl Study {
    /// Reads a study file.
    ///
    /// # Errors
    /// All problems found.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, Problems> {
        read::file(path.as_ref())
    }

    /// Parses the text of a study; `origin` is its file, which need not exist.
    ///
    /// # Errors
    /// All problems found.
    pub fn parse(text: &str, origin: impl Into<PathBuf>) -> Result<Self, Problems> {
        read::text(text, origin.into())
    }

    /// Returns the file of the study, which need not exist.
    #[must_use]
    pub fn path(&self) -> &Path {
        Path::new(self.sources.name(Sources::SCENARIO))
    }

    /// Returns the text of the study.
    #[must_use]
    pub fn text(&self) -> &str {
        self.sources.whole(Sources::SCENARIO)
    }

    /// Returns the number of varied values that are drawn, not computed.
    #[must_use]
    pub fn drawn(&self) -> usize {
        let drawn = |one: &&Varied| !matches!(one.spread, Spread::Expression(_));
        self.varied.iter().filter(drawn).count()
    }

    /// Returns the number that the study gives as `cases`: that of draws, or of rows of Saltelli's scheme.
    #[must_use]
    pub fn rows(&self) -> u64 {
        match self.sampling {
            Sampling::Saltelli => self.draws / (self.drawn() as u64 + 2),
            _ => self.draws,
        }
    }

    /// Returns the number of cases: each draw for each variant.
    #[must_use]
    pub const fn cases(&self) -> u64 {
        self.draws * self.variants.len() as u64
    }

    /// Reads the scenario.
    ///
    /// # Errors
    /// If the scenario cannot be read or is not TOML; a missing file is reported at its place in the study.
    pub fn read_scenario(&self) -> Result<Scenario, Problems> {
        if self.scenario.exists() {
            return Scenario::read(&self.scenario);
        }
        let (folder, message) = (
            &self.folder,
            "the scenario cannot be read: it does not exist",
        );
        let name = self.scenario.strip_prefix(folder).unwrap_or(&self.scenario);
        let help = advice_on_missing(folder, &name.to_string_lossy(), "study");
        let problem = self.problem_of("scenario", message, &help);
        Err(Problems(vec![Problem {
            kind: ProblemKind::Unreadable,
            ..problem
        }]))
    }

    /// Returns `true` if the study sets a key of the scenario in every case.
    #[must_use]
    pub fn sets(&self, key: &str) -> bool {
        self.homes.iter().any(|(home, _)| home == key)
    }

    /// Returns the flag that adds the metric of detection and recovery to a case of a variant; `None` without a table of
    /// faults that declares either. Without `has_fault` the metric is about the first fault of the scenario.
    #[must_use]
    pub fn timing_flag(&self, variant: usize, has_fault: bool) -> Option<String> {
        let own_alarm = self.variants[variant].detected.as_deref();
        self.faults.as_ref()?.metric(own_alarm, has_fault)
    }

    /// Maps a problem of a case's scenario to the study, if a flag of the study caused it.
    #[must_use]
    pub fn at_home(&self, problem: Problem) -> Problem {
        let Some(flag) = problem.source.strip_prefix(FLAG) else {
            return problem;
        };
        let (key, value) = flag.split_once('=').unwrap_or((flag, ""));
        // A fault that the study tries has the place of its kind.
        let home = |text: &str| self.homes.iter().find(|(home, _)| home == text);
        let Some((_, place)) = home(flag).or_else(|| home(key)) else {
            return problem;
        };
        let mut help = format!("a case has {key}={value}");
        let is_varied = self
            .varied
            .iter()
            .any(|one| one.key.as_deref() == Some(key));
        if is_varied && problem.kind == ProblemKind::WrongType && value.parse::<f64>().is_ok() {
            help += "; set `whole = true` in its [[vary]] to draw whole numbers, or use a list of whole numbers";
        }
        if self.faults.is_some()
            && faults::is_appended(key)
            && problem.kind == ProblemKind::Duplicate
        {
            help += "; [faults] gives its fault and its metric these names: choose others in the scenario";
        }
        Problem {
            source: self.sources.name(place.source).into(),
            excerpt: Some(self.sources.excerpt(place)),
            help: Some(
                problem
                    .help
                    .map_or(help.clone(), |earlier| format!("{earlier}; {help}")),
            ),
            ..problem
        }
    }

    /// Creates a problem for the key of a variation, or for a key such as `goals[0]`, on behalf of a later check.
    #[must_use]
    pub fn problem_of(&self, key: &str, message: &str, help: &str) -> Problem {
        let start = Place {
            source: Sources::SCENARIO,
            span: 0..0,
        };
        let home = self.homes.iter().find(|(home, _)| home == key);
        let place = home.map_or(&start, |(_, place)| place);
        let mut reader = Reader::new(self.sources.clone(), Vec::new());
        let problem = reader.report(ProblemKind::OutOfRange, key, place, message);
        problem.help(help);
        problem.clone()
    }
}

impl Item {
    /// Formats the value as for `--set`.
    #[must_use]
    pub fn toml(&self) -> String {
        match self {
            Self::Number(_, text) => text.clone(),
            Self::Text(text) => toml::Value::String(text.clone()).to_string(),
            Self::Flag(value) => value.to_string(),
            Self::Table { toml, .. } => toml.clone(),
        }
    }
}

/// Returns the key of a flag `KEY=VALUE`.
fn flag_key(flag: &str) -> &str {
    key_of(flag).unwrap_or(flag)
}

#[cfg(test)]
mod tests;
