//! Conclusion of a run: its outcome, checkpoints, summary and exit code.

use hil_config::port::counts::{COUNTS_FILE, PLANT_COUNTS_FILE};
use hil_console::files::part_file;
use hil_console::files::runs::SUMMARY;
use hil_console::terminal::advice;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption;
use hil_facts::arguments::run::LinkKind;
use hil_facts::checkpoint;
use hil_facts::results::company::ProcessorTime;
use hil_facts::results::ended::EndedRun;
use hil_facts::results::settings::Realtime;
use hil_facts::results::summary::Summary;
use hil_session::session::Session;
use shared_types::record::Outcome;

use super::environment::RunResult;
use super::prepared::PreparedRun;
use super::restoration;
use hil_recording::reader::RECORDING;
use hil_target::bridge::switches;

/// Ends the session of a run and writes its summary.
///
/// # Errors
/// If the summary cannot be made; a failure to write it is part of the result.
pub(super) fn conclude(
    mut prepared: PreparedRun,
    session: Session,
    realtime: Realtime,
    mut ended: EndedRun,
    before: &ProcessorTime,
) -> Result<RunResult, Failure> {
    // A side that is not a child process is counted as contention.
    let is_all_here = prepared.settings.by_hand.flag().is_none();
    let company = is_all_here.then(|| ProcessorTime::now().company(before));
    let has_joined = prepared.settings.link == LinkKind::InProcess || realtime.controller.is_some();
    if ended.outcome == Outcome::Completed && !has_joined {
        ended.outcome = Outcome::Failed;
        let what = "the plant reports a completed run, but no controller connected to its link";
        ended.reason = Some(what.into());
    }
    if ended.outcome == Outcome::Failed {
        let reason = ended.reason.take().unwrap_or_default();
        ended.reason = Some(advice::behind(&reason));
    }
    let collected = match &ended.recorded.error {
        None => checkpoint::collect(
            &prepared.checkpoints,
            &prepared.plan,
            (&prepared.binaries, &prepared.session),
            (&prepared.folder, &prepared.effective),
            &ended.recorded.partial_digests,
        ),
        Some(_) => Ok(Vec::new()),
    };
    let switches = switches(&prepared.session);
    let [plant_port, port] =
        [PLANT_COUNTS_FILE, COUNTS_FILE].map(|file| prepared.session.read_file(file).ok());
    drop(session);
    let (checkpoints, collected) = match collected {
        Ok(made) => (made, Ok(())),
        Err(failure) => (Vec::new(), Err(failure)),
    };

    let folder = prepared.folder.clone();
    // A run may end before there is anything to record.
    let is_recorded = prepared.recording.is_some() && folder.join(RECORDING).exists();
    let recorded_to = is_recorded.then_some(RECORDING);
    let mut summary = Summary::new(
        &prepared.plan,
        &prepared.binaries,
        &prepared.session,
        (prepared.settings).evidence(&prepared.plan, &prepared.binaries),
        recorded_to,
        realtime,
        &ended,
    );
    let by_hand = prepared.settings.by_hand.roles();
    summary.started_by_hand = by_hand.map(|side| side.name().into()).collect();
    summary.started_utc = Some(prepared.started_utc.clone());
    summary.set = prepared.settings.set.clone();
    summary.company = company;
    (summary.plant_port, summary.port) = (plant_port, port);
    (summary.resumed, summary.checkpoints) = (prepared.resumed.clone(), checkpoints);
    if let Some(target) = &mut summary.target {
        target.safe_switches = switches.or(Some(0));
    }
    prepared.reserve.release();
    if !prepared.settings.is_one_of_many {
        interruption::pass_over_ends();
    }
    let write = |summary: &Summary| {
        let json = serde_json::to_string_pretty(summary).map_err(Failure::infrastructure)?;
        let written = part_file::write_text(&folder.join(SUMMARY), &json);
        Ok::<_, Failure>((json, written))
    };
    if !summary.checkpoints.is_empty() {
        // The run is over: its result stays, however the check ends. The final write reports failures.
        let _ = write(&summary)?;
    }
    let check_result = restoration::check(&prepared, &ended.recorded, &mut summary.checkpoints);
    let mut checks = (summary.checkpoints.iter()).filter_map(|made| made.check.as_ref());
    let is_cut = prepared.interruption.came() && checks.any(|check| !check.is_made());
    let (json, written) = write(&summary)?;
    Ok(RunResult {
        exit: match ended.outcome {
            _ if ended.recorded.error.is_some() => Exit::Infrastructure,
            _ if is_cut => Exit::Interrupted,
            Outcome::Completed | Outcome::Diverged => summary.verdict.exit(),
            Outcome::Stopped if prepared.interruption.came() => Exit::Interrupted,
            Outcome::Stopped | Outcome::Failed => Exit::Infrastructure,
        },
        partial_digests: ended.recorded.partial_digests,
        curve: ended.recorded.curve,
        recording: recorded_to.map(|name| folder.join(name)),
        table: summary.table(&prepared.plan, &folder),
        written: written.and(collected).and(check_result),
        summary,
        json,
        folder,
    })
}
