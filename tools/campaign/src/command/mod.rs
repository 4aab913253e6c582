//! `hil campaign` and `hil search`: large numbers of cases of one scenario, run on the cores of this and other machines. Draws,
//! statistics and tables come from [the rest of this package](crate::draws), runs from [`hil_run`].
//!
//! 1. [`cases`] combines a study with its scenario and programs: the plan of each case, and its row.
//! 2. [`plan`] checks a study and writes the folder that all workers share; [`grow`] adds cases to it.
//! 3. [`values`] writes and checks the table of all values; [`planned`] refuses a folder whose programs others could
//!    have written, before any of them runs.
//! 4. [`runner`] runs single cases. [`work`] is the worker that every engine starts for the cases of a campaign;
//!    [`workers`] and [`slurm`] start it. The [`evaluator`] runs chosen points for [`search`](mod@search).
//!    [`points`] runs those that standard input lists.
//! 5. [`collect`] joins the results, [`answers`] evaluates them, [`show`] prints the evaluation and
//!    [`report`](mod@report) plots it; [`case`] runs a single case again.

mod answers;
mod case;
mod cases;
mod collect;
mod compare;
mod envelopes;
pub mod evaluator;
mod grow;
mod plan;
mod planned;
mod points;
mod report;
mod result;
mod runner;
mod search;
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
use crate::arguments::search::SearchAction;

/// Runs the command.
///
/// # Errors
/// Everything that prevents the command from completing.
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
        CampaignAction::Points(arguments) => points::points(arguments),
    }
}

/// Runs `hil search`.
///
/// # Errors
/// Everything that prevents the command from completing.
pub fn search(action: &SearchAction) -> Result<Exit, Failure> {
    search::search(action)
}

/// Returns `true` if the path is the folder of a campaign.
pub fn is_campaign(path: &Path) -> bool {
    path.join(MANIFEST).is_file()
}

/// Runs `hil report` for the folder of a campaign.
///
/// # Errors
/// Everything that prevents the command from completing.
pub fn report(arguments: &ReportArguments) -> Result<Exit, Failure> {
    report::report(arguments)
}

/// Quotes a path for a shell.
fn quoted(path: &Path) -> String {
    let path_text = path.display().to_string();
    let quoted = shlex::try_quote(&path_text).map(|quoted| quoted.into_owned());
    quoted.unwrap_or(path_text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_in_suggested_commands_are_quoted_for_a_shell() {
        assert_eq!(quoted(Path::new("runs/common-mode")), "runs/common-mode");
        assert_eq!(quoted(Path::new("my runs/a")), "'my runs/a'");
    }
}
