//! The text of a scenario with `--set` flags, in lines that begin with `#--set `.
//!
//! Refused input is refused with its name and place. An accepted scenario can be shown; the shown text is accepted with
//! the same meaning, and its expressions can be computed over any rows.

use hil_config::evaluation::Evaluation;
use hil_config::expression::Columns;
use hil_config::plan::Plan;
use hil_config::show::show;
use shared_types::time::Step;

use super::assert_told;
use super::numbers::OddNumbers;
use super::rig::rig;

/// Prefix of a line with a flag: a comment to TOML.
const FLAG: &str = "#--set ";
/// Number of rows to compute over.
const ROWS: u64 = 8;

/// Runs the target.
pub fn run(bytes: &[u8]) {
    // A file that is no text is refused when it is read.
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    let flags: Vec<&str> = text.lines().filter_map(|l| l.strip_prefix(FLAG)).collect();
    match rig().plan(text, &flags) {
        Ok(plan) => taken(&plan, OddNumbers::of(bytes)),
        Err(problems) => {
            assert!(!problems.0.is_empty());
            for problem in &problems.0 {
                assert!(!problem.source.is_empty(), "{problem:?}");
                assert!(!problem.message.is_empty(), "{problem:?}");
            }
            assert_told(&problems.to_string());
        }
    }
}

fn taken(plan: &Plan, mut numbers: OddNumbers) {
    let rig = rig();
    let shown = show(plan, &rig.plants, &rig.laws, &rig.kinds).expect("what was checked is known");
    let again = rig.plan(&shown, &[]);
    let again = again.unwrap_or_else(|problems| panic!("{problems}\n{shown}"));
    assert_eq!(format!("{plan:?}"), format!("{again:?}"), "{shown}");

    let (plant, law) = (plan.plant_among(&rig.plants), plan.law_among(&rig.laws));
    let (Some(plant), Some(law)) = (plant, law) else {
        panic!("a plan of an unknown plant or law");
    };
    let columns = Columns::from(&plan.record_layout(&plant, &law));
    let mut evaluation = Evaluation::new(plan, &columns).expect("what was checked can be computed");
    for step in 0..ROWS {
        evaluation.observe(Step(step), &numbers.row(columns.len()), []);
        for event in &plan.faults {
            evaluation.fault(event.id, Step(step + 1));
        }
    }
    assert_eq!(evaluation.derived().len(), plan.derived.len());
    assert_eq!(evaluation.requirements().len(), plan.requirements.len());
    for value in evaluation.results() {
        assert!(!value.name.is_empty());
    }
}
