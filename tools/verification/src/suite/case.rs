//! Requested runs, and the rows of the verdict table that result from them.

use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use hil_config::plan::{Clock, Plan};
use hil_console::terminal::exit::{Exit, Failure};
use hil_facts::results::requirements;
use hil_run::{Environment, Origin, RunResult};

use super::noise::Noise;
use crate::arguments::tolerance::Tolerances;
use crate::compare::{self, Comparison, Difference};

/// Requested run.
#[derive(Clone)]
pub(super) struct Case {
    pub(super) plan: Plan,
    pub(super) environment: Environment,
    /// Name in tables and folders: the scenario, with a number if there are several runs, or the condition of an
    /// audit.
    pub(super) label: String,
    /// Source of the case's scenario.
    pub(super) origin: String,
    /// Index of the first case with the same scenario.
    pub(super) first: usize,
    /// Set if the cores are kept busy during the run.
    pub(super) noise: bool,
    /// Reason why this machine or plant cannot run the case.
    pub(super) skipped: Option<String>,
}

/// Result of a run.
pub(super) struct Row {
    pub(super) label: String,
    /// Law of the controller.
    pub(super) law: String,
    /// Source of the run's scenario.
    pub(super) origin: String,
    pub(super) exit: Exit,
    /// Reason why the case was not run.
    pub(super) skipped: Option<String>,
    /// Error of starting the run or writing its summary.
    pub(super) failure: Option<Failure>,
    pub(super) disagreement: Option<Disagreement>,
    /// `None` if the run was never started, or if this process did not see its end.
    pub(super) ran: Option<RunResult>,
    /// Data of a run that a killed `hil` had begun, from its folder.
    pub(super) begun: Option<Begun>,
}

/// Run whose end this process did not see, according to the summary in its folder.
pub(super) struct Begun {
    /// Number of requirements that passed.
    pub(super) passed: usize,
    pub(super) requirements: usize,
    /// Simulated time divided by wall-clock time, if the run ended.
    pub(super) realtime_factor: Option<f64>,
    pub(super) digest: Option<String>,
    pub(super) folder: PathBuf,
}

/// Digest that differs from that of the first run of the same scenario.
pub(super) struct Disagreement {
    first: String,
    pub(super) difference: Option<Difference>,
}

impl fmt::Display for Disagreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "digest differs from that of {}", self.first)?;
        match &self.difference {
            Some(difference) => write!(f, ": {difference}"),
            None => Ok(()),
        }
    }
}

impl Case {
    /// Creates the case of a scenario that is run alone.
    pub(super) fn new(plan: Plan, environment: Environment, origin: String) -> Self {
        Self {
            label: plan.name.clone(),
            plan,
            environment,
            origin,
            first: 0,
            noise: false,
            skipped: None,
        }
    }

    /// Runs the case.
    ///
    /// # Errors
    /// If the run could not be started.
    pub(super) fn run(&self, origin: Origin) -> Result<RunResult, Failure> {
        self.environment.interruption.check()?;
        let _noise = self.noise.then(Noise::begin);
        isolated(|| hil_run::execute(self.plan.clone(), self.environment.clone(), origin))
    }

    /// Creates the row of the case; `ran` is `None` for a skipped case.
    pub(super) fn row(&self, ran: Option<Result<RunResult, Failure>>) -> Row {
        let (exit, ran, failure) = match ran {
            None => (Exit::Pass, None, None),
            Some(Err(failure)) => (failure.exit(), None, Some(failure)),
            Some(Ok(mut ran)) => match std::mem::replace(&mut ran.written, Ok(())) {
                Ok(()) => (ran.exit, Some(ran), None),
                Err(failure) => (Exit::Infrastructure, Some(ran), Some(failure)),
            },
        };
        Row {
            label: self.label.clone(),
            law: self.plan.controller.law.clone(),
            origin: self.origin.clone(),
            exit,
            skipped: self.skipped.clone(),
            failure,
            disagreement: None,
            ran,
            begun: None,
        }
    }

    /// Returns `true` if the plant is behind a port.
    pub(super) fn is_behind_port(&self) -> bool {
        let plants = &self.environment.binaries.plant.description.plants;
        (self.plan.whole_plant_among(plants)).is_some_and(|plant| plant.port.is_some())
    }

    /// Returns `true` if all runs of the case must have the same digest, which does not hold in real time.
    pub(super) fn repeats(&self) -> bool {
        self.plan.run.clock != Clock::Realtime
    }
}

/// Converts a panic of a run to an error, because other runs continue in other threads.
fn isolated<T>(run: impl FnOnce() -> Result<T, Failure>) -> Result<T, Failure> {
    // The state of a panicked run is discarded, so it cannot be observed broken.
    catch_unwind(AssertUnwindSafe(run))
        .unwrap_or_else(|panic| Err(Failure::panicked("the run", &*panic)))
}

impl Row {
    /// Makes the row of a scenario that cannot be run.
    pub(super) fn refused(scenario: &Path, problem: &str) -> Self {
        let stem = scenario.file_stem().unwrap_or(scenario.as_os_str());
        Self {
            label: stem.to_string_lossy().into_owned(),
            law: String::new(),
            origin: scenario.display().to_string(),
            exit: Exit::Usage,
            skipped: None,
            failure: Some(Failure::Usage(problem.into())),
            disagreement: None,
            ran: None,
            begun: None,
        }
    }

    /// Returns the verdict in one word. The verdict follows the exit code, which separates findings from infrastructure
    /// failures: a diverged run is a `fail` here, but `aborted` in its own summary.
    pub(super) const fn verdict(&self) -> &'static str {
        match (self.exit, &self.ran) {
            (Exit::Pass, _) => "pass",
            (Exit::Failed, _) => "fail",
            (_, None) if self.begun.is_none() => "not run",
            _ => "aborted",
        }
    }

    /// Returns the verdict to display to a person.
    pub(super) fn verdict_in_words(&self) -> &'static str {
        let requirements = self.ran.as_ref().map(|ran| ran.summary.requirements.len());
        let requirements = requirements.or(self.begun.as_ref().map(|begun| begun.requirements));
        requirements::in_words(self.verdict(), requirements.unwrap_or(1))
    }

    /// Returns `true` if the run ended by itself, successfully or not.
    pub(super) const fn is_over(&self) -> bool {
        matches!(self.exit, Exit::Pass | Exit::Failed)
    }

    /// Returns the digest of the run's records, if there is one.
    pub(super) fn digest(&self) -> Option<&str> {
        self.ran.as_ref()?.summary.digest.as_deref()
    }

    /// Lists the reasons other than failed requirements why the run does not pass.
    pub(super) fn reasons(&self) -> Vec<String> {
        let summary = self.ran.as_ref().map(|ran| &ran.summary);
        let reason = summary.and_then(|summary| summary.reason.clone());
        let failure = self.failure.as_ref().map(ToString::to_string);
        let disagreement = self.disagreement.as_ref().map(ToString::to_string);
        [reason, failure, disagreement]
            .into_iter()
            .flatten()
            .collect()
    }

    /// Compares the digest with that of the first run of the scenario, if both ended by themselves.
    pub(super) fn compare(&mut self, first: &Self) {
        let (Some(a), Some(b)) = (&first.ran, &self.ran) else {
            return;
        };
        if !first.is_over() || !self.is_over() || a.summary.digest == b.summary.digest {
            return;
        }
        let comparison = (a.recording.as_ref().zip(b.recording.as_ref()))
            .and_then(|(a, b)| compare::compare(a, b, &[], &Tolerances::default()).ok());
        let difference = comparison.as_ref().and_then(Comparison::first_difference);
        self.disagreement = Some(Disagreement {
            first: first.label.clone(),
            difference: difference.cloned(),
        });
        self.exit = Exit::Failed;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panicking_run_fails_with_the_panic_message() {
        let outcome =
            |run: fn() -> Result<(), Failure>| isolated(run).map_err(|why| why.to_string());
        let prefix = "error: the run panicked: no ";
        assert_eq!(
            outcome(|| panic!("no such thing")),
            Err(format!("{prefix}such thing"))
        );
        assert_eq!(outcome(|| panic!("no {}", 7)), Err(format!("{prefix}7")));
        assert_eq!(
            outcome(|| std::panic::panic_any(7)),
            Err(format!("{prefix}reason given"))
        );
        assert_eq!(outcome(|| Ok(())), Ok(()));
    }
}
