//! Case: a run that is wanted and the row of the verdict table that comes of it.

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

/// Run that is wanted.
#[derive(Clone)]
pub(super) struct Case {
    pub(super) plan: Plan,
    pub(super) environment: Environment,
    /// Name in tables and folders: the scenario, and its number if there are more; the condition of an
    /// audit.
    pub(super) label: String,
    /// Place that its scenario comes from.
    pub(super) origin: String,
    /// Number of the first case of the same scenario.
    pub(super) first: usize,
    /// The cores are busy meanwhile.
    pub(super) noise: bool,
    /// Reason for which this machine or plant cannot run it.
    pub(super) skipped: Option<String>,
}

/// Run as it came out.
pub(super) struct Row {
    pub(super) label: String,
    /// The law that ran.
    pub(super) law: String,
    /// Place that its scenario comes from.
    pub(super) origin: String,
    pub(super) exit: Exit,
    /// Reason for which it was not run.
    pub(super) skipped: Option<String>,
    /// Failure to start it or to write its summary.
    pub(super) failure: Option<Failure>,
    pub(super) disagreement: Option<Disagreement>,
    /// `None` if it was never started, or if this process did not see its end.
    pub(super) ran: Option<RunResult>,
    /// Summary of a run that a killed `hil` had begun, from its folder.
    pub(super) begun: Option<Begun>,
}

/// Run whose end this process did not see, by the summary in its folder.
pub(super) struct Begun {
    /// Requirements that passed.
    pub(super) met: usize,
    pub(super) requirements: usize,
    /// Simulated time over wall time, if it ended.
    pub(super) realtime_factor: Option<f64>,
    pub(super) digest: Option<String>,
    pub(super) folder: PathBuf,
}

/// Another digest than the first run of the same scenario has.
pub(super) struct Disagreement {
    first: String,
    pub(super) difference: Option<Difference>,
}

impl fmt::Display for Disagreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "another digest than {}", self.first)?;
        match &self.difference {
            Some(difference) => write!(f, ": {difference}"),
            None => Ok(()),
        }
    }
}

impl Case {
    /// Makes the case of a scenario that is run alone.
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

    /// Runs it.
    ///
    /// # Errors
    /// If it could not be started.
    pub(super) fn run(&self, origin: Origin) -> Result<RunResult, Failure> {
        self.environment.interruption.check()?;
        let _noise = self.noise.then(Noise::begin);
        isolated(|| hil_run::execute(self.plan.clone(), self.environment.clone(), origin))
    }

    /// Makes the row of it; `None` of a case that was skipped.
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

    /// Tells whether all its runs have one digest; in real time it depends on what comes too late.
    pub(super) fn repeats(&self) -> bool {
        self.plan.run.clock != Clock::Realtime
    }
}

/// Makes a panic of a run its failure: other runs go on in other threads.
fn isolated<T>(run: impl FnOnce() -> Result<T, Failure>) -> Result<T, Failure> {
    // What the run was about goes with it; nothing of it is looked at again.
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

    /// Names its verdict in one word. Follows the exit code, which tells findings from broken machinery: a
    /// diverged run is a `fail` here, while its own summary calls it `aborted`.
    pub(super) const fn verdict(&self) -> &'static str {
        match (self.exit, &self.ran) {
            (Exit::Pass, _) => "pass",
            (Exit::Failed, _) => "fail",
            (_, None) if self.begun.is_none() => "not run",
            _ => "aborted",
        }
    }

    /// The verdict in words for a person.
    pub(super) fn verdict_in_words(&self) -> &'static str {
        let requirements = self.ran.as_ref().map(|ran| ran.summary.requirements.len());
        let requirements = requirements.or(self.begun.as_ref().map(|begun| begun.requirements));
        requirements::in_words(self.verdict(), requirements.unwrap_or(1))
    }

    /// Tells whether the run ended by itself, well or not.
    pub(super) const fn is_over(&self) -> bool {
        matches!(self.exit, Exit::Pass | Exit::Failed)
    }

    /// Gives the digest of its records, if it ran and has one.
    pub(super) fn digest(&self) -> Option<&str> {
        self.ran.as_ref()?.summary.digest.as_deref()
    }

    /// Lists why it is no pass, beside the requirements that failed.
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

    /// Compares its digest with that of the first run of its scenario, if both ended by themselves.
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
    fn a_run_that_panics_fails_with_what_it_said() {
        let told = |run: fn() -> Result<(), Failure>| isolated(run).map_err(|why| why.to_string());
        let said = "error: the run panicked: no ";
        assert_eq!(
            told(|| panic!("no such thing")),
            Err(format!("{said}such thing"))
        );
        assert_eq!(told(|| panic!("no {}", 7)), Err(format!("{said}7")));
        assert_eq!(
            told(|| std::panic::panic_any(7)),
            Err(format!("{said}reason given"))
        );
        assert_eq!(told(|| Ok(())), Ok(()));
    }
}
