//! `hil campaign case`: prints a case as a scenario, or runs it again with a recording and compares the digest.

use std::sync::Arc;

use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_facts::arguments::BinaryArguments;
use hil_facts::arguments::run::LinkKind;
use hil_facts::programs::binaries::Choices;
use hil_facts::programs::binaries::named::Named;
use hil_run::settings::Settings;
use hil_run::{Environment, Origin};

use crate::folder::Folder;
use crate::shard::Shard;
use hil_config::plan::Plan;

use super::cases::Cases;
use super::planned::{self, become_planned};
use super::quoted;
use super::values;
use super::work::open;
use crate::arguments::CaseArguments;

/// Runs a case.
///
/// # Errors
/// If the case does not exist or cannot be run.
pub(super) fn case(arguments: &CaseArguments) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    let folder = open(&arguments.folder)?;
    become_planned(&folder)?;
    planned::check(&folder)?;
    let (case, all) = (arguments.case, folder.manifest().cases);
    if case >= all {
        return Err(Failure::usage(format!(
            "there is no case {case}; the campaign has {all}, counted from 0"
        )));
    }
    let cases = Cases::of_folder(&folder, &interruption)?;
    values::check(&folder, cases.study()).map_err(|why| {
        let folder_text = quoted(folder.path());
        Failure::usage(format!(
            "{why}; hil campaign run {folder_text} rewrites it, and so does hil campaign collect {folder_text} once all cases have a result"
        ))
    })?;
    let plan = cases.plan(case)?;
    if arguments.show {
        output::write(&cases.scenario_text(&plan)?)?;
        return Ok(Exit::Pass);
    }
    let link = match arguments.in_process {
        true => LinkKind::InProcess,
        false => LinkKind::Iceoryx2,
    };
    let settings = Settings {
        wait_limit_s: cases.study().wait_limit_s,
        ..Settings::with_recording(link, arguments.out.clone())
    };
    let copies = folder.manifest().both();
    folder
        .check_copies(copies.into_iter().flatten())
        .map_err(Failure::usage)?;
    let binaries = match cases.binaries_with(&plan.programs)? {
        Some(binaries) => binaries,
        None => built_in(&folder, link)?.find(&interruption)?,
    };
    let plan = Plan {
        programs: binaries.programs(),
        ..plan
    };
    let environment = Environment::new(&settings, Arc::clone(&binaries), &interruption)?;
    let ran = hil_run::execute(plan, environment, Origin::Scenario)?;
    output::write(&match arguments.json {
        true => format!("{}\n", ran.json),
        false => ran.table.clone(),
    })?;
    ran.written?;
    let digest = ran.summary.digest.unwrap_or_default();
    if !matches!(ran.exit, Exit::Pass | Exit::Failed) {
        return Ok(ran.exit);
    }
    match published(&folder, case) {
        Some(known) if known == digest => {
            tell!("case {case} reproduced the campaign's digest");
            Ok(ran.exit)
        }
        Some(known) => {
            tell!("error: the campaign has digest {known} for case {case}");
            Ok(Exit::Failed)
        }
        None => Ok(ran.exit),
    }
}

/// Chooses the programs of a case with built-in plant and law: the copies in the folder, not those next to the running
/// `hil`.
fn built_in(folder: &Folder, link: LinkKind) -> Result<Choices, Failure> {
    let root = std::path::absolute(folder.path()).map_err(Failure::usage)?;
    let copies = folder.manifest().both();
    let paths = copies.map(|both| both.map(|copied| root.join(&copied.path)));
    match (paths, link) {
        (Some(paths), LinkKind::InProcess) => Ok(Choices::copies(paths)),
        (Some([plant, controller]), _) => {
            let arguments = BinaryArguments {
                plant_bin: Some(plant),
                controller_bin: Some(controller),
            };
            Choices::of(&arguments, &Named::Nothing, None)
        }
        (None, LinkKind::InProcess) => {
            Choices::of(&BinaryArguments::default(), &Named::Nothing, None)
        }
        (None, _) => Err(Failure::usage(
            "the folder has no copies of plant-process and controller-process, because they were not beside hil when the campaign was planned; --in-process runs the case inside the planned hil",
        )),
    }
}

/// Returns the campaign's digest of a case, if it has one.
fn published(folder: &Folder, case: u64) -> Option<String> {
    let manifest = folder.manifest();
    let place = manifest.place("digest")?;
    let part = Shard::of(folder, manifest.shard_of(case)).part().ok()?;
    let row = part.cases().iter().position(|number| *number == case)?;
    let digest = part.results()[place].text(row);
    Some(digest.to_owned()).filter(|digest| !digest.is_empty())
}
