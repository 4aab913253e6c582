//! `hil rerun`: a recorded run once more, what was done to it while it went on included, and
//! whether the same came out.

use hil_config::plan::Clock;
use hil_config::scenario::Scenario;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use hil_facts::arguments::run::ClockKind;
use hil_facts::programs::binaries::Choices;
use hil_facts::programs::binaries::named::{Named, refuse_set};
use hil_facts::programs::binaries::reached::Reached;
use hil_facts::programs::scenario;
use hil_recording::reader;
use hil_run::{Environment, Origin, Repeated};
use serde_json::json;
use shared_types::record::Outcome;

use crate::arguments::run::RerunArguments;
use crate::arguments::tolerance::Tolerances;
use crate::compare::{self, Difference};
use crate::repetition::RecordedScenario;

/// Runs the command.
///
/// # Errors
/// If the run cannot be read or repeated.
pub fn rerun(arguments: &RerunArguments) -> Result<Exit, Failure> {
    let options = &arguments.options;
    let recorded = RecordedScenario::read(&arguments.run)?.for_any_machine();
    let shown = arguments.run.display();
    if recorded.lost > 0 {
        let lost = recorded.lost;
        return Err(Failure::usage(format!(
            "{shown} lost {lost} records: there is no digest to compare with"
        )));
    }
    // Of a run that was stopped or died all that was recorded must come again; what happened after the
    // last record is no part of that. In real time it is not known what that one's controller saw.
    let is_whole = recorded.outcome.is_some_and(Outcome::is_own_end);
    let (records, expected) = if is_whole {
        (recorded.records, recorded.digest.clone())
    } else {
        let unsure = u64::from(recorded.is_against_clock());
        let records = recorded.records.saturating_sub(unsure);
        (
            records,
            reader::digest_of_first(&arguments.run, records).map_err(Failure::usage)?,
        )
    };
    if records == 0 {
        return Err(Failure::usage(format!(
            "{shown} has no record to compare with"
        )));
    }
    if options.changes.clock == Some(ClockKind::Realtime) {
        return Err(Failure::usage(
            "a rerun repeats in lockstep what came too late; --clock realtime would be late in its own way",
        ));
    }
    refuse_set(&options.changes.set, |role| role.flag)?;
    let (settings, interruption) = hil_run::begin(options)?;
    let at = Reached::by(&options.target, settings.wait_limit_s, &interruption)?;
    let named = Named::Recorded(&recorded.programs);
    let choices = Choices::of(&options.binaries, &named, at.as_ref())?;
    let binaries = choices.find(&interruption)?;
    let environment = Environment::new(&settings, binaries, &interruption)?;
    let binaries = &environment.binaries;
    binaries.tell();
    let both = [&binaries.plant, &binaries.controller];
    for (binary, before) in both.into_iter().zip(&recorded.programs.blake3) {
        if before
            .as_ref()
            .is_some_and(|before| *before != binary.blake3)
        {
            let (path, found) = (binary.path.display(), &binary.blake3);
            let before = before.as_deref().unwrap_or_default();
            tell!(
                "warning: {path} is not the binary of the recorded run: it has hash {found}, that one had {before}"
            );
        }
    }
    let text = recorded.scenario()?;
    let scenario = Scenario::parse(&text, format!("the scenario of {shown}"));
    let check = || scenario::check(scenario, &options.changes, binaries, options.json);
    let mut plan = interruption.at_once(check)??;
    if options.changes.clock.is_none() && plan.run.clock == Clock::Realtime {
        plan.run.clock = Clock::Lockstep;
    }
    let repeated = Repeated {
        records,
        missed: recorded.missed,
    };
    let ran = hil_run::execute(plan, environment, Origin::Repeated(repeated))?;
    let found = if is_whole {
        &ran.summary.digest
    } else {
        &ran.partial_digests.get(&records).cloned()
    };
    let is_same = found.as_ref() == Some(&expected);
    let difference: Option<Difference> = match &ran.recording {
        Some(recording) if !is_same => {
            let exact = Tolerances::default();
            let compare = || compare::compare(&arguments.run, recording, &[], &exact);
            let comparison = interruption.at_once(compare);
            (comparison.ok().and_then(Result::ok))
                .and_then(|comparison| comparison.first_difference().cloned())
        }
        _ => None,
    };
    let told = if options.json {
        let summary: serde_json::Value =
            serde_json::from_str(&ran.json).map_err(Failure::infrastructure)?;
        let result = json!({
            "same": is_same,
            "records": records,
            "recorded_digest": expected,
            "digest": found,
            "first_difference": difference,
            "resumed_check": recorded.resumed_check,
            "summary": summary,
        });
        format!("{result:#}\n")
    } else {
        let mut text = ran.table;
        let compared = if is_whole {
            String::new()
        } else {
            format!(", over its first {records} records: it did not end by itself")
        };
        text += &if is_same {
            format!("same digest as {shown}{compared}\n")
        } else {
            let found = found.as_deref().unwrap_or("none");
            format!(
                "NOT the digest of {shown}{compared}: {expected} was recorded, {found} came now\n"
            )
        };
        if let Some(difference) = &difference {
            text += &format!("{difference}\n");
        }
        if let (false, Some(check)) = (is_same, &recorded.resumed_check) {
            text +=
                &format!("{shown} went on from a checkpoint, whose restored state is: {check}\n");
        }
        text
    };
    let told = output::write(&told);
    ran.written?;
    told?;
    Ok(match ran.exit {
        Exit::Infrastructure | Exit::Interrupted => ran.exit,
        _ if is_same => Exit::Pass,
        _ => Exit::Failed,
    })
}
