//! Evidence as JUnit XML: a suite for each run, with a case for each of its requirements, whose properties link it to
//! documents. `hil run --junit` writes none, because the plugin of Jenkins refuses properties of cases.

use std::time::Duration;

use hil_console::terminal::exit::Failure;
use hil_facts::results::requirements::why_vacuous;
use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};
use shared_types::number::short_in;

use super::listed::Listed;
use super::run::{RecordedRun, Test};
use crate::suite::junit::xml;

/// Writes the report.
pub(super) fn of(runs: &[RecordedRun], untested: &[&Listed]) -> Result<String, Failure> {
    let mut report = Report::new("hil");
    for run in runs {
        report.add_test_suite(suite_of(run));
    }
    if !untested.is_empty() {
        let mut suite = TestSuite::new("untested");
        for listed in untested {
            let mut status = TestCaseStatus::skipped();
            status.set_message("no run verifies this requirement");
            let mut case = TestCase::new(&*listed.id, status);
            case.set_classname("untested");
            case.add_property(("verifies", &*listed.id));
            case.set_system_out(&listed.title);
            suite.add_test_case(case);
        }
        report.add_test_suite(suite);
    }
    xml(&report)
}

fn suite_of(run: &RecordedRun) -> TestSuite {
    let mut suite = TestSuite::new(&*run.scenario);
    if let Ok(time) = Duration::try_from_secs_f64(run.wall_time_s) {
        suite.set_time(time);
    }
    let folder = run.folder.display().to_string();
    suite.add_properties([
        ("folder", &*folder),
        ("evidence", &*run.evidence),
        ("digest", run.digest.as_deref().unwrap_or("none")),
        (
            "started_utc",
            run.started_utc.as_deref().unwrap_or("unknown"),
        ),
        ("set", &*run.set.join(" ")),
        ("plant", &*run.plant.binary),
        ("plant_blake3", &*run.plant.blake3),
        ("controller", &*run.controller.binary),
        ("controller_blake3", &*run.controller.blake3),
    ]);
    let mut status = TestCaseStatus::success();
    if run.verdict == "aborted" {
        status = TestCaseStatus::non_success(NonSuccessKind::Error);
        status.set_message(run.reason.as_deref().unwrap_or("unknown reason"));
    }
    let mut case = TestCase::new("run", status);
    case.set_classname(&*run.scenario);
    suite.add_test_case(case);
    for test in &run.requirements {
        suite.add_test_case(case_of(run, test));
    }
    suite
}

fn case_of(run: &RecordedRun, test: &Test) -> TestCase {
    let mut status = TestCaseStatus::success();
    if let Some(premise) = &test.vacuous {
        status = TestCaseStatus::skipped();
        status.set_message(why_vacuous(premise));
    } else if test.verdict != "pass" {
        let margin =
            (test.robustness).map_or_else(|| "none".into(), |margin| short_in(margin, &test.unit));
        status = TestCaseStatus::non_success(NonSuccessKind::Failure);
        status
            .set_message(format!("{}: margin {margin}", test.verdict))
            .set_type("requirement")
            .set_description(&*test.formula);
    }
    let mut case = TestCase::new(&*test.name, status);
    case.set_classname(&*run.scenario);
    case.set_system_out(&test.formula);
    if let Some(id) = &test.id {
        case.add_property(("id", &**id));
    }
    for id in &test.verifies {
        case.add_property(("verifies", &**id));
    }
    if let Some(robustness) = test.robustness {
        case.add_property(("robustness", &*robustness.to_string()));
        case.add_property(("unit", &*test.unit));
    }
    case
}
