//! `hil run --audit`: whether a scenario has one digest with these binaries, whatever goes on around
//! it.
//!
//! Runs the scenario as asked for, then again under [conditions] that must not matter:
//! other speeds, other cores, busy cores, sides that take their time. Each is a whole run of the same
//! binaries in a session, a folder and processes of its own, so that addresses, process numbers and
//! names differ as well. The first difference of each is named.

mod conditions;
mod noise;

use std::path::Path;

use serde::Serialize;

use crate::arguments::run::{LinkKind, RunArguments};
use crate::arguments::tolerance::Tolerances;
use crate::files::part_file;
use crate::programs::scenario::Finder;
use crate::run::settings::Settings;
use crate::run::{self, Environment, Origin, RunResult};
use crate::terminal::exit::{Exit, Failure};
use crate::terminal::output;
use crate::verification::compare::{self, Difference};
use conditions::{Condition, Conditions};
use hil_config::plan::{Clock, Plan};
use noise::Noise;

/// What a run that differs may have in it.
const HINT: &str = "what can do this: a law or plant that reads a clock, its process number, its environment or its cores; \
memory that was never written; random numbers without the seed of the run; threads; the order of a hash map";

/// One repetition.
#[derive(Debug, Serialize)]
struct Repetition {
    condition: String,
    /// Why this machine cannot have it; the rest is null then.
    skipped: Option<String>,
    agrees: Option<bool>,
    digest: Option<String>,
    wall_time_s: Option<f64>,
    first_difference: Option<Difference>,
    /// Where it is kept, if it differs.
    run: Option<String>,
}

/// Runs the command.
///
/// # Errors
/// If a run could not be started, or results not be written.
pub(crate) fn audit(arguments: &RunArguments) -> Result<Exit, Failure> {
    let options = &arguments.options;
    let (settings, interruption) = run::begin(options)?;
    let [scenario] = &arguments.scenarios[..] else {
        return Err(Failure::usage("--audit takes one scenario"));
    };
    if arguments.repeat > 1 || arguments.junit.is_some() || arguments.markdown.is_some() {
        return Err(Failure::usage(
            "--audit repeats the scenario itself and tells of it in summary.json; leave out --repeat, --junit and --markdown",
        ));
    }
    let mut finder = Finder::new(&options.binaries, &interruption);
    let (plan, binaries) = finder.read(scenario, &options.changes, options.json)?;
    let environment = Environment::new(&settings, binaries, &interruption)?;
    refuse(&plan, &settings)?;

    let reference = run::execute(plan.clone(), environment.clone(), Origin::Scenario)?;
    let is_over = matches!(reference.exit, Exit::Pass | Exit::Failed);
    let (Some(digest), Some(recording), true) = (&reference.digest, &reference.recording, is_over)
    else {
        tell(&reference, options.json, &[], Exit::Infrastructure)?;
        return Ok(reference.exit);
    };
    let folder = recording.parent().unwrap_or(Path::new("."));
    let conditions = Conditions::new(&plan, &environment.binaries, reference.wall_time_s);
    let count = conditions.all().len();
    let mut repetitions = Vec::new();
    for (number, condition) in (1..).zip(conditions.all()) {
        tell!("audit {number} of {count}: {}", condition.told);
        let repetition = match &condition.skipped {
            Some(why) => {
                tell!("  skipped: {why}");
                Repetition::skipped(condition, why)
            }
            None => {
                let kept = folder.join(format!("audit-{number}"));
                let again = repeat(condition, environment.clone(), &kept)?;
                if !matches!(again.exit, Exit::Pass | Exit::Failed) || again.digest.is_none() {
                    output::tell(&again.table);
                    let told = format!("the audit ended while it ran {}", condition.told);
                    tell!("{told}; what it left is in {}", kept.display());
                    return Ok(again.exit);
                }
                compared(condition, &again, digest, recording, &kept)?
            }
        };
        if repetition.agrees == Some(false) {
            tell!("  another digest");
        }
        repetitions.push(repetition);
    }
    let differs = repetitions.iter().any(|one| one.agrees == Some(false));
    let exit = if differs {
        Exit::Failed
    } else {
        reference.exit
    };
    tell(&reference, options.json, &repetitions, exit)?;
    reference.written?;
    Ok(exit)
}

/// Refuses what leaves nothing to find out.
fn refuse(plan: &Plan, settings: &Settings) -> Result<(), Failure> {
    let why = if settings.recording.is_none() {
        "--audit needs the recordings to name what differs; leave out --no-record"
    } else if settings.link == LinkKind::InProcess {
        "--audit changes how two processes are scheduled, and --link in-process has one; leave it out"
    } else if settings.pause_at_s.is_some() {
        "--audit runs by itself; leave out --pause-at"
    } else if !settings.checkpoints_at_s.is_empty() {
        "--audit keeps nothing to go on from; leave out --checkpoint-at"
    } else if plan.run.clock == Clock::Realtime {
        "in real time a run depends on what comes too late; audit it with --clock lockstep"
    } else {
        return Ok(());
    };
    Err(Failure::usage(why))
}

/// Runs the scenario once more under a condition.
fn repeat(
    condition: &Condition,
    mut environment: Environment,
    folder: &Path,
) -> Result<RunResult, Failure> {
    environment.settings.out = Some(folder.to_owned());
    environment.settings.session = None;
    let noise = condition.noise.then(Noise::begin);
    let ran = run::execute(condition.plan.clone(), environment, Origin::Scenario);
    drop(noise);
    ran
}

/// Looks whether a repetition has the digest, and keeps it only if not.
fn compared(
    condition: &Condition,
    again: &RunResult,
    digest: &str,
    recording: &Path,
    folder: &Path,
) -> Result<Repetition, Failure> {
    let agrees = again.digest.as_deref() == Some(digest);
    let first_difference = match &again.recording {
        Some(other) if !agrees => {
            let comparison = compare::compare(recording, other, &[], &Tolerances::default())?;
            comparison.first_difference().cloned()
        }
        _ => None,
    };
    if agrees {
        std::fs::remove_dir_all(folder).map_err(|error| {
            Failure::infrastructure(format!("cannot remove {}: {error}", folder.display()))
        })?;
    }
    Ok(Repetition {
        condition: condition.told.clone(),
        skipped: None,
        agrees: Some(agrees),
        digest: again.digest.clone(),
        wall_time_s: Some(again.wall_time_s),
        first_difference,
        run: (!agrees).then(|| folder.display().to_string()),
    })
}

impl Repetition {
    fn skipped(condition: &Condition, why: &str) -> Self {
        Self {
            condition: condition.told.clone(),
            skipped: Some(why.into()),
            agrees: None,
            digest: None,
            wall_time_s: None,
            first_difference: None,
            run: None,
        }
    }
}

/// Prints the summary of the run with the outcome of the audit, and adds that to `summary.json`.
fn tell(
    reference: &RunResult,
    json: bool,
    repetitions: &[Repetition],
    exit: Exit,
) -> Result<(), Failure> {
    let mut summary: serde_json::Value =
        serde_json::from_str(&reference.summary).map_err(Failure::infrastructure)?;
    summary["audit"] = serde_json::json!({
        "verdict": if exit == Exit::Infrastructure { "aborted" }
            else if repetitions.iter().any(|one| one.agrees == Some(false)) { "fail" }
            else { "pass" },
        "repetitions": repetitions,
    });
    let text = format!("{summary:#}\n");
    if let Some(folder) = reference.recording.as_ref().and_then(|path| path.parent()) {
        part_file::write_text(&folder.join("summary.json"), &text)?;
    }
    output::write(&if json {
        text
    } else {
        format!("{}{}", reference.table, told(repetitions))
    })
}

fn told(repetitions: &[Repetition]) -> String {
    let mut text = String::from("\n");
    for one in repetitions {
        let condition = &one.condition;
        text += &match (&one.skipped, &one.first_difference, &one.run) {
            (Some(why), ..) => format!("  -     {condition}: {why}\n"),
            (_, Some(difference), Some(run)) => {
                format!("  DIFF  {condition}: {difference}\n        kept in {run}\n")
            }
            (_, _, Some(run)) => format!("  DIFF  {condition}: see {run}\n"),
            _ => format!("  same  {condition}\n"),
        };
    }
    let ran = repetitions
        .iter()
        .filter(|one| one.agrees.is_some())
        .count();
    let differ = (repetitions.iter().filter(|one| one.agrees == Some(false))).count();
    match (ran, differ) {
        (0, _) => {}
        (_, 0) => text += &format!("  one digest in {} runs\n", ran + 1),
        _ => {
            text += &format!("  NOT deterministic: {differ} of {ran} repetitions differ; {HINT}\n")
        }
    }
    text
}
