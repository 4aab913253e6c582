//! The verdicts as JUnit XML: a suite for each run, a case for each requirement and one for the run
//! itself.

use std::time::Duration;

use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};
use shared_types::number::short_in;

use super::case::Row;
use crate::results::requirements::Requirement;
use crate::terminal::exit::{Exit, Failure};

/// # Errors
/// If a text cannot stand in XML.
pub(super) fn of(rows: &[Row]) -> Result<String, Failure> {
    let mut report = Report::new("hil");
    let mut all_s = 0.0;
    for row in rows {
        let mut suite = TestSuite::new(&*row.label);
        suite.add_property(("law", &*row.law));
        suite.add_property(("scenario", &*row.origin));
        let mut case = TestCase::new("run", status_of(row));
        case.set_classname(&*row.label);
        if let Some(ran) = &row.ran {
            let summary = &ran.summary;
            let time_s = summary.wall_time_s;
            all_s += time_s;
            suite.set_time(Duration::from_secs_f64(time_s));
            case.set_time(Duration::from_secs_f64(time_s));
            suite.add_property(("session", &*summary.session));
            suite.add_property(("folder", &*ran.folder.display().to_string()));
            suite.add_property(("digest", summary.digest.as_deref().unwrap_or("none")));
            suite.add_test_case(case);
            for requirement in &summary.requirements {
                suite.add_test_case(case_of(row, requirement));
            }
        } else {
            suite.add_test_case(case);
        }
        report.add_test_suite(suite);
    }
    report.set_time(Duration::from_secs_f64(all_s));
    report.to_string().map_err(Failure::infrastructure)
}

/// Returns the status of the run itself: success if it went to its end, with the digest of its like.
fn status_of(row: &Row) -> TestCaseStatus {
    let requirements = row.ran.iter().flat_map(|ran| &ran.summary.requirements);
    let is_missed = requirements.into_iter().any(|one| one.verdict != "pass");
    let kind = match row.exit {
        Exit::Pass => return TestCaseStatus::success(),
        // Its requirements say so themselves.
        Exit::Failed if is_missed && row.reasons().is_empty() => {
            return TestCaseStatus::success();
        }
        Exit::Failed => NonSuccessKind::Failure,
        _ => NonSuccessKind::Error,
    };
    let mut status = TestCaseStatus::non_success(kind);
    status
        .set_message(row.reasons().join("; "))
        .set_type(row.verdict());
    status
}

fn case_of(row: &Row, requirement: &Requirement) -> TestCase {
    let Requirement {
        name,
        formula,
        verdict,
        robustness,
        unit,
        at_s,
        ..
    } = requirement;
    let is_aborted = !matches!(row.exit, Exit::Pass | Exit::Failed);
    let status = if *verdict == "pass" {
        TestCaseStatus::success()
    } else if *verdict == "undecided" && is_aborted {
        // The run's own error is why.
        let mut status = TestCaseStatus::skipped();
        status.set_message("undecided: the run did not get that far");
        status
    } else {
        let margin = robustness.map_or_else(|| "none".into(), |margin| short_in(margin, unit));
        let at = at_s.map_or_else(String::new, |at_s| format!(" at {at_s} s"));
        let mut status = TestCaseStatus::non_success(NonSuccessKind::Failure);
        let message = format!("{verdict}: margin {margin}{at}");
        status.set_message(message).set_type("requirement");
        status.set_description(formula.as_str());
        status
    };
    let mut case = TestCase::new(name.as_str(), status);
    case.set_classname(&*row.label);
    case.set_system_out(formula.as_str());
    case
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_an_aborted_run_leaves_open_is_no_failure_of_its_own() {
        let row = |exit| Row {
            label: "a".into(),
            law: "pid".into(),
            origin: "a.toml".into(),
            exit,
            skipped: None,
            failure: None,
            disagreement: None,
            ran: None,
        };
        let requirement = |verdict| Requirement {
            name: "settles".into(),
            formula: "always(x_m < 1)".into(),
            verdict,
            robustness: None,
            unit: "m".into(),
            at_s: None,
            decided_at_s: None,
        };
        use Exit::{Failed, Infrastructure, Interrupted, Pass};
        for (exit, verdict, expected) in [
            (Pass, "pass", "passed"),
            (Failed, "fail", "failed"),
            (Failed, "undecided", "failed"),
            (Infrastructure, "undecided", "skipped"),
            (Interrupted, "undecided", "skipped"),
            (Infrastructure, "fail", "failed"),
            (Infrastructure, "pass", "passed"),
        ] {
            let found = match case_of(&row(exit), &requirement(verdict)).status {
                TestCaseStatus::Success { .. } => "passed",
                TestCaseStatus::NonSuccess { .. } => "failed",
                TestCaseStatus::Skipped { .. } => "skipped",
            };
            assert_eq!(found, expected, "{verdict} of a run with {exit:?}");
        }
    }
}
