//! `hil search`: the smallest departure from the nominal values that breaks a requirement, or the case with the least
//! margin.
//!
//! [`trials`] runs and judges points, a [`line`] between two points is bisected, and [`spread`] searches several values;
//! [`answer`] writes and prints the result. Never runs a point itself: that is the
//! [evaluator](super::evaluator).

mod answer;
mod line;
mod smallest;
mod spread;
mod trials;
mod worst;

use std::path::Path;

use hil_config::problem::Problems;
use hil_config::study::Study;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;

use super::evaluator::Evaluator;
use super::quoted;
use crate::arguments::search::{SearchAction, SearchArguments};
use answer::Answer;
use trials::{Stop, Trials};

/// Runs a search.
///
/// # Errors
/// If the study is invalid, a run has no result, or the command is interrupted.
pub(super) fn search(action: &SearchAction) -> Result<Exit, Failure> {
    match action {
        SearchAction::Smallest(arguments) => with(arguments, "smallest", smallest::smallest),
        SearchAction::Worst(arguments) => with(arguments, "worst", worst::worst),
    }
}

fn with(
    arguments: &SearchArguments,
    kind: &'static str,
    find: impl FnOnce(&mut Trials) -> Result<Answer, Stop>,
) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    let study = Study::read(&arguments.study)?;
    let variant = variant(&study)?;
    let name = study.name.clone();
    let folder = arguments.out.clone();
    let folder = folder.unwrap_or_else(|| Path::new("runs").join(format!("{name}-{kind}")));
    let evaluator = Evaluator::open(study, variant, &arguments.binaries, &folder, &interruption)?;
    let mut trials = Trials::new(evaluator)?;
    let answer = match find(&mut trials) {
        Ok(answer) => answer,
        Err(Stop::Refused(reason)) => Answer::without(reason),
        Err(Stop::Failed(Failure::Interrupted)) => {
            let folder_text = quoted(&folder);
            tell!("finished runs are kept in {folder_text}, and the same command continues");
            return Err(Failure::Interrupted);
        }
        Err(Stop::Failed(failure)) => return Err(failure),
    };
    let exit = answer.exit();
    answer::write(&answer, &trials, kind, &folder, arguments.json)?;
    Ok(exit)
}

/// Returns the variant that is searched.
///
/// # Errors
/// If the study has several variants and names none.
fn variant(study: &Study) -> Result<usize, Failure> {
    let mut names = study.variants.iter().map(|one| &*one.name);
    match &study.search.variant {
        Some(name) => Ok(names.position(|one| one == name).unwrap_or_default()),
        None if study.variants.len() == 1 => Ok(0),
        None => {
            let advice = format!(
                "name one of them as `variant` in [search]: {}",
                names.collect::<Vec<&str>>().join(", ")
            );
            let message = "the study has several variants, and a search runs one";
            let problem = study.problem_of("search.variant", message, &advice);
            Err(Problems(vec![problem]).into())
        }
    }
}
