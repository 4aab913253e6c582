//! Detection of files of the wrong kind, with the commands that accept them.

use std::path::{Path, PathBuf};

use hil_campaign::arguments::CampaignAction;
use hil_campaign::arguments::search::SearchAction;

use hil_console::files::kind::FileKind::{
    self, Campaign, Fmu, Port, Program, Recording, Scenario, Study,
};
use hil_console::terminal::exit::Failure;
use hil_verification::arguments::recordings::ScenarioAction;

use crate::arguments::Command;
use crate::arguments::config::ConfigAction;

/// Kinds of files that a command accepts.
type Kinds = &'static [FileKind];

/// Refuses a file on the command line that is certainly of a kind that the command does not accept.
///
/// # Errors
/// If there is such a file.
pub(super) fn refuse_other_kinds(command: &Command) -> Result<(), Failure> {
    let (paths, kinds): (Vec<&Path>, Kinds) = match command {
        Command::Run(arguments) if arguments.from.from.is_some() => {
            let paths = arguments.from.from.iter().map(PathBuf::as_path);
            (paths.collect(), &[Recording])
        }
        Command::Run(arguments) => {
            let paths = arguments.scenarios.iter().map(PathBuf::as_path);
            (paths.collect(), &[Scenario])
        }
        Command::Margins(arguments) => (vec![arguments.scenario.as_path()], &[Scenario]),
        Command::Trim(it) => (it.resolved().scenario.into_iter().collect(), &[Scenario]),
        Command::Linearise(it) => (vec![it.scenario.as_path()], &[Scenario]),
        Command::Config(arguments) => match &arguments.action {
            ConfigAction::Check(it) => (vec![it.scenario.as_path()], &[Scenario]),
            ConfigAction::Show(it) => (vec![it.scenario.scenario.as_path()], &[Scenario]),
            ConfigAction::Schema { .. } => return Ok(()),
        },
        Command::Describe(arguments) => (vec![arguments.file.as_path()], &[Program, Fmu, Port]),
        Command::Campaign(arguments) => match &arguments.action {
            CampaignAction::Check(it) => (vec![it.study.as_path()], &[Study]),
            CampaignAction::Plan(it) => (vec![it.check.study.as_path()], &[Study]),
            CampaignAction::Compare(it) => (vec![&it.first, &it.second], &[Campaign]),
            CampaignAction::Run(it) => (vec![it.folder.as_path()], &[Campaign]),
            CampaignAction::Show(it) => (vec![it.folder.as_path()], &[Campaign]),
            CampaignAction::Status(it) => (vec![it.folder.as_path()], &[Campaign]),
            CampaignAction::Case(it) => (vec![it.folder.as_path()], &[Campaign]),
            CampaignAction::Collect(it) => (vec![it.folder.as_path()], &[Campaign]),
            CampaignAction::Grow(it) => (vec![it.folder.as_path()], &[Campaign]),
            CampaignAction::Submit(it) => (vec![it.folder.as_path()], &[Campaign]),
            CampaignAction::Work(it) => (vec![it.folder.as_path()], &[Campaign]),
            CampaignAction::Points(it) => (vec![it.scenario.as_path()], &[Scenario]),
        },
        Command::Search(arguments) => match &arguments.action {
            SearchAction::Smallest(it) | SearchAction::Worst(it) => {
                (vec![it.study.as_path()], &[Study])
            }
        },
        Command::Latency(arguments) => {
            let paths = arguments.run.iter().map(PathBuf::as_path);
            (paths.collect(), &[Recording])
        }
        Command::Scenario(arguments) => {
            let ScenarioAction::From(it) = &arguments.action;
            (vec![it.run.as_path()], &[Recording])
        }
        Command::Layout(arguments) => (vec![arguments.run.as_path()], &[Recording]),
        Command::Report(arguments) => {
            let paths = arguments.runs.iter().map(PathBuf::as_path);
            (paths.collect(), &[Recording, Campaign])
        }
        Command::Compare(arguments) => {
            let both = [Some(&arguments.a), arguments.b.as_ref()];
            let paths = both.into_iter().flatten().map(PathBuf::as_path);
            (paths.collect(), &[Recording])
        }
        Command::Recover(arguments) => (vec![arguments.run.as_path()], &[Recording]),
        Command::Judge(arguments) => (vec![arguments.run.as_path()], &[Recording]),
        Command::Replay(arguments) => (vec![arguments.run.as_path()], &[Recording]),
        Command::Rerun(arguments) => (vec![arguments.run.as_path()], &[Recording]),
        Command::Export(arguments) => {
            let paths = arguments.runs.iter().map(PathBuf::as_path);
            let kinds: &[FileKind] = match arguments.evidence {
                Some(_) => &[Recording, FileKind::Summary],
                None => &[Recording],
            };
            (paths.collect(), kinds)
        }
        _ => return Ok(()),
    };
    for path in paths {
        let Some(kind) = FileKind::of(path).filter(|kind| !kinds.contains(kind)) else {
            continue;
        };
        let expected: Vec<&str> = kinds.iter().map(|kind| kind.in_words().0).collect();
        let (word, commands) = kind.in_words();
        let advice = match kind {
            FileKind::Summary => commands.to_owned(),
            FileKind::Port => format!("{commands} takes {word}"),
            _ => format!("{commands} take {word}"),
        };
        return Err(Failure::usage(format!(
            "{} is {word} and not {}: {advice}",
            path.display(),
            expected.join(" or ")
        )));
    }
    Ok(())
}
