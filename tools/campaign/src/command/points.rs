//! `hil campaign points`: results of a scenario at points of a caller's choice, for the Python package.
//!
//! Standard input lists the `KEY=VALUE` flags of each point, as JSON, and standard output lists the results. External
//! programs run one point after another in kept processes, and some points again in new ones, as in a campaign. Keeps no
//! result.

use std::io::stdin;
use std::path::Path;

use hil_config::plan::Plan;
use hil_config::scenario::Scenario;
use hil_config::study::Study;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_facts::arguments::BinaryArguments;
use hil_run::kept::Kept;
use serde_json::{Value, json};

use super::cases::Cases;
use crate::arguments::PointsArguments;

/// Study that varies nothing.
const STUDY: &str = "schema = 1\nscenario = \"-\"\ncases = 1\n";

/// Runs the command.
///
/// # Errors
/// If the scenario or a point is invalid, a point has no result, or kept processes give another one than new ones.
pub(super) fn points(arguments: &PointsArguments) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    let points: Vec<Vec<String>> = serde_json::from_reader(stdin().lock())
        .map_err(|error| Failure::usage(format!("standard input lists no points: {error}")))?;
    let study = Study::parse(STUDY, Path::new("points.toml"))?;
    let scenario = Scenario::read(&arguments.scenario)?.set(&arguments.set);
    let binaries = BinaryArguments::default();
    let cases = Cases::of_scenario(scenario, study, &binaries, &interruption)?;
    // All are checked before the first runs.
    let plans = points.into_iter().enumerate().map(|(number, flags)| {
        interruption.check()?;
        if let Err(problems) = cases.read(flags.clone())? {
            output::result(true, &json!({ "problems": problems }), String::new)?;
        }
        cases
            .checked(flags)
            .map_err(|refused| of_point(number, refused))
    });
    let plans = plans.collect::<Result<Vec<Plan>, Failure>>()?;
    let mut processes = Kept::new(cases.study().wait_limit_s);
    let mut results = Vec::new();
    for (number, plan) in plans.iter().enumerate() {
        let result = result(&cases, plan, &mut processes, &interruption);
        results.push(result.map_err(|failure| of_point(number, failure))?);
    }
    output::result(true, &results, String::new)?;
    Ok(Exit::Pass)
}

/// Runs a point and returns its result.
fn result(
    cases: &Cases,
    plan: &Plan,
    processes: &mut Kept,
    interruption: &Interruption,
) -> Result<Value, Failure> {
    let result = cases.run(plan, processes, interruption)?;
    if result.is_to_check && cases.run_fresh(plan, interruption)?.json() != result.json() {
        return Err(Failure::Differ(
            "its result in processes that ran earlier points is another one than in new processes: the plant or the law keeps state from one run to the next, for example in a static variable".into(),
        ));
    }
    Ok(result.json())
}

/// Adds the number of a point to its failure.
fn of_point(number: usize, failure: Failure) -> Failure {
    let named = |text: String| format!("point {number}: {text}");
    match failure {
        Failure::Usage(text) => Failure::Usage(named(text)),
        Failure::Infrastructure(text) => Failure::Infrastructure(named(text)),
        Failure::Differ(text) => Failure::Differ(named(text)),
        Failure::Interrupted => Failure::Interrupted,
    }
}
