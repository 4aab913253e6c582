//! One case of a campaign again: as a scenario, or as a run with a recording whose digest must be the same.

use std::sync::Arc;

use hil_campaign::folder::Folder;
use hil_campaign::shard::Shard;

use super::cases::{Cases, told};
use super::work::open;
use crate::arguments::BinaryArguments;
use crate::arguments::campaign::CaseArguments;
use crate::arguments::run::LinkKind;
use crate::programs::binaries::Choices;
use crate::programs::binaries::named::Named;
use crate::run::settings::Settings;
use crate::run::{self, Environment, Origin};
use crate::terminal::exit::{Exit, Failure};
use crate::terminal::interruption::Interruption;
use crate::terminal::output;

/// Runs a case.
///
/// # Errors
/// If it cannot be run.
pub(super) fn case(arguments: &CaseArguments) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    let folder = open(&arguments.folder)?;
    folder.check().map_err(Failure::usage)?;
    let (case, all) = (arguments.case, folder.manifest().cases);
    if case >= all {
        return Err(Failure::usage(format!(
            "there is no case {case}; the campaign has {all}, counted from 0"
        )));
    }
    let cases = Cases::of_folder(&folder, &interruption)?;
    let plan = cases.plan(case).map_err(told)?;
    if arguments.show {
        output::write(&cases.shown(&plan)?)?;
        return Ok(Exit::Pass);
    }
    let link = match arguments.in_process {
        true => LinkKind::InProcess,
        false => LinkKind::Iceoryx2,
    };
    let settings = Settings::with_recording(link, arguments.out.clone());
    let copy = |copied: &Option<_>| {
        let path = |copied: &hil_campaign::manifest::Copied| folder.path().join(&copied.path);
        copied.as_ref().map(path)
    };
    let binaries = BinaryArguments {
        plant_bin: copy(&folder.manifest().plant),
        controller_bin: copy(&folder.manifest().controller),
    };
    let binaries = Choices::of(&binaries, &Named::Nothing, None)?.find(&interruption)?;
    let environment = Environment::new(&settings, Arc::clone(&binaries), &interruption)?;
    let ran = run::execute(plan, environment, Origin::Scenario)?;
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
            tell!("case {case} has the digest of the campaign");
            Ok(ran.exit)
        }
        Some(known) => {
            tell!("error: the campaign has digest {known} for case {case}");
            Ok(Exit::Failed)
        }
        None => Ok(ran.exit),
    }
}

/// Returns the digest that a case has in the campaign, if it has one.
fn published(folder: &Folder, case: u64) -> Option<String> {
    let manifest = folder.manifest();
    let place = manifest
        .columns
        .iter()
        .position(|column| column.name == "digest")?;
    let part = Shard::of(folder, case / manifest.shard_cases).part().ok()?;
    let row = part.rows.iter().find(|row| row[0].as_count() == case)?;
    Some(row[place].as_text().to_owned()).filter(|digest| !digest.is_empty())
}
