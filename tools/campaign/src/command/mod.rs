//! `hil campaign`: very many cases of one scenario, on the cores of this machine and of others. Draws, counts and
//! tables are [this package](crate::draws)'s, runs are [`run`](hil_run)'s; neither is made here.
//!
//! 1. [`cases`] joins a study with its scenario and programs: the plan of each case, and its row.
//! 2. [`plan`] checks a study and writes the folder that everybody works on; [`grow`] adds cases to it.
//! 3. [`values`] writes and checks the table of all values, [`planned`] refuses a folder whose programs others can have written, before anything in it is run.
//! 4. [`work`] is the one worker that every engine starts; [`workers`] and [`slurm`] start it.
//! 5. [`collect`] joins the results, [`answers`] computes what they mean, [`show`] tells it, and
//!    [`report`](mod@report) draws it; [`case`] runs one of them again.

mod answers;
mod case;
mod cases;
mod collect;
mod compare;
mod envelopes;
mod grow;
mod plan;
mod planned;
mod report;
mod result;
mod show;
mod slurm;
mod status;
mod study_text;
mod values;
mod work;
mod workers;

use std::path::Path;

use hil_views::arguments::report::ReportArguments;

use hil_console::terminal::exit::{Exit, Failure};

use crate::manifest::MANIFEST;

use crate::arguments::CampaignAction;

/// Runs the command.
///
/// # Errors
/// Everything that keeps it from its result.
pub fn campaign(action: &CampaignAction) -> Result<Exit, Failure> {
    match action {
        CampaignAction::Check(arguments) => plan::check(arguments),
        CampaignAction::Plan(arguments) => plan::plan(arguments),
        CampaignAction::Grow(arguments) => grow::grow(arguments),
        CampaignAction::Run(arguments) => workers::run(arguments),
        CampaignAction::Submit(arguments) => slurm::submit(arguments),
        CampaignAction::Work(arguments) => work::work(arguments),
        CampaignAction::Status(arguments) => status::status(arguments),
        CampaignAction::Collect(arguments) => collect::collect(arguments),
        CampaignAction::Show(arguments) => show::show(arguments),
        CampaignAction::Case(arguments) => case::case(arguments),
        CampaignAction::Compare(arguments) => compare::compare(arguments),
    }
}

/// Tells whether a path is the folder of a campaign.
pub fn is_campaign(path: &Path) -> bool {
    path.join(MANIFEST).is_file()
}

/// Runs `hil report` for the folder of a campaign.
///
/// # Errors
/// Everything that keeps it from its result.
pub fn report(arguments: &ReportArguments) -> Result<Exit, Failure> {
    report::report(arguments)
}

/// Writes a path as a shell takes it.
fn quoted(path: &Path) -> String {
    let shown = path.display().to_string();
    let quoted = shlex::try_quote(&shown).map(|quoted| quoted.into_owned());
    quoted.unwrap_or(shown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_stands_in_a_command_as_a_shell_takes_it() {
        assert_eq!(quoted(Path::new("runs/common-mode")), "runs/common-mode");
        assert_eq!(quoted(Path::new("my runs/a")), "'my runs/a'");
    }
}
