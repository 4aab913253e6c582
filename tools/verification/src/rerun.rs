//! `hil rerun`: repeats a recorded run, including its live interventions, and compares the digests.

use hil_config::plan::Clock;
use hil_config::scenario::Scenario;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use hil_facts::arguments::run::ClockKind;
use hil_facts::programs::binaries::Choices;
use hil_facts::programs::binaries::named::{Named, refuse_set};
use hil_facts::programs::binaries::reached::Reached;
use hil_facts::programs::scenario;
use hil_facts::tables::FORMATS;
use hil_recording::reader;
use hil_run::{Environment, Origin, Repeated};
use serde_json::json;
use shared_types::record::Outcome;

use crate::arguments::run::RerunArguments;
use crate::arguments::tolerance::Tolerances;
use crate::compare::{self, Difference};
use crate::repetition::RecordedScenario;

/// Warning about a port whose file says so.
const NOT_REPEATABLE: &str = "the far end of the port keeps a clock of its own (`repeatable = false`), so the digest of this run will differ";

/// Runs the command.
///
/// # Errors
/// If the run cannot be read or repeated.
pub fn rerun(arguments: &RerunArguments) -> Result<Exit, Failure> {
    let options = &arguments.options;
    let recorded = RecordedScenario::read(&arguments.run)?.for_any_machine();
    let run_text = arguments.run.display();
    if recorded.is_behind_port() {
        return Err(Failure::usage(format!(
            "the plant of {run_text} is behind a port and does not repeat; use `hil replay` for its controller, or `hil scenario from` and `hil run` for another run"
        )));
    }
    if recorded.lost > 0 {
        let lost = recorded.lost;
        return Err(Failure::usage(format!(
            "{run_text} lost {lost} records, so there is no digest for the comparison"
        )));
    }
    // A run that was stopped or died must be reproduced up to its last record; later events do not matter. In real
    // time it is unknown what its controller saw after that.
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
            "{run_text} has no records for the comparison"
        )));
    }
    if options.changes.clock == Some(ClockKind::Realtime) {
        return Err(Failure::usage(
            "a rerun reproduces late commands in lockstep, but with --clock realtime other commands would be late; omit --clock realtime",
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
            let (path, hash) = (binary.path.display(), &binary.blake3);
            let before = before.as_deref().unwrap_or_default();
            tell!(
                "warning: {path} is not the binary of the recorded run: its hash is {hash}, but was {before}"
            );
        }
    }
    if !binaries.controller.is_repeatable() {
        tell!("warning: {NOT_REPEATABLE}");
    }
    let text = recorded.scenario()?;
    let scenario = Scenario::parse(&text, format!("the scenario of {run_text}")).map(|scenario| {
        scenario
            .beside(reader::folder_of(&arguments.run))
            .with_formats(FORMATS)
    });
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
    let digest = if is_whole {
        &ran.summary.digest
    } else {
        &ran.partial_digests.get(&records).cloned()
    };
    let is_same = digest.as_ref() == Some(&expected);
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
    let output_text = if options.json {
        let summary: serde_json::Value =
            serde_json::from_str(&ran.json).map_err(Failure::infrastructure)?;
        let result = json!({
            "same": is_same,
            "records": records,
            "recorded_digest": expected,
            "digest": digest,
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
            format!(", over its first {records} records: the run did not end by itself")
        };
        text += &if is_same {
            format!("same digest as {run_text}{compared}\n")
        } else {
            let digest = digest.as_deref().unwrap_or("none");
            format!("NOT the digest of {run_text}{compared}: recorded {expected}, now {digest}\n")
        };
        if let Some(difference) = &difference {
            text += &format!("{difference}\n");
        }
        if let (false, Some(check)) = (is_same, &recorded.resumed_check) {
            text += &format!(
                "{run_text} resumed from a checkpoint, whose restored state is: {check}\n"
            );
        }
        text
    };
    let result = output::write(&output_text);
    ran.written?;
    result?;
    Ok(match ran.exit {
        Exit::Infrastructure | Exit::Interrupted => ran.exit,
        _ if is_same => Exit::Pass,
        _ => Exit::Failed,
    })
}
