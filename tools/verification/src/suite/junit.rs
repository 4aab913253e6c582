//! The verdicts as JUnit XML: a suite for each run, with a case for each requirement and one for the run itself. The
//! strictest known reader is the xUnit plugin of Jenkins, whose schema (junit-10.xsd) a test restates.

use std::time::Duration;

use hil_console::terminal::exit::{Exit, Failure};
use hil_facts::results::requirements::{Requirement, why_vacuous};
use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};
use shared_types::number::short_in;

use super::case::Row;

/// # Errors
/// If a text cannot be represented in XML.
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
    xml(&report)
}

/// Serialises a report without the total number of skipped cases, which no JUnit schema allows; each suite has its
/// own number.
pub(crate) fn xml(report: &Report) -> Result<String, Failure> {
    let mut text = report.to_string().map_err(Failure::infrastructure)?;
    let tag = text.find("<testsuites ").map(|begin| {
        let length = text[begin..].find('>').unwrap_or_default();
        begin..begin + length
    });
    if let Some(tag) = tag
        && let Some(skipped) = text[tag.clone()].find(" skipped=\"")
    {
        let begin = tag.start + skipped;
        let value = begin + " skipped=\"".len();
        if let Some(length) = text[value..tag.end].find('"') {
            text.replace_range(begin..=value + length, "");
        }
    }
    Ok(text)
}

/// Returns the status of the run itself: success if it completed with the expected digest.
fn status_of(row: &Row) -> TestCaseStatus {
    let requirements = row.ran.iter().flat_map(|ran| &ran.summary.requirements);
    let is_missed = requirements.into_iter().any(|one| one.verdict != "pass");
    let kind = match row.exit {
        Exit::Pass => return TestCaseStatus::success(),
        // The cases of its requirements report the failure.
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
        vacuous,
        ..
    } = requirement;
    let is_aborted = !matches!(row.exit, Exit::Pass | Exit::Failed);
    let status = if let Some(premise) = vacuous {
        let mut status = TestCaseStatus::skipped();
        status.set_message(why_vacuous(premise));
        status
    } else if *verdict == "pass" {
        TestCaseStatus::success()
    } else if *verdict == "undecided" && is_aborted {
        // The error of the run explains it.
        let mut status = TestCaseStatus::skipped();
        status.set_message("undecided: the run ended before");
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
mod schema;
#[cfg(test)]
mod tests {
    use hil_config::plan::Trace;

    use super::*;

    fn row(exit: Exit) -> Row {
        Row {
            label: "a".into(),
            law: "pid".into(),
            origin: "a.toml".into(),
            exit,
            skipped: None,
            failure: None,
            disagreement: None,
            begun: None,
            ran: None,
        }
    }

    fn requirement(verdict: &'static str) -> Requirement {
        Requirement {
            name: "settles <at last>".into(),
            formula: "always(x_m < 1)".into(),
            verdict,
            robustness: None,
            unit: "m".into(),
            at_s: None,
            decided_at_s: None,
            vacuous: None,
            trace: Trace::default(),
        }
    }

    #[test]
    fn the_schema_of_jenkins_accepts_every_kind_of_suite() {
        use Exit::{Failed, Infrastructure, Interrupted, Pass, Usage};
        let mut report = Report::new("hil");
        report.set_time(Duration::from_secs_f64(1234.5678));
        for exit in [Pass, Failed, Infrastructure, Interrupted, Usage] {
            let row = row(exit);
            let mut suite = TestSuite::new("a \"b\" & <c>");
            suite.set_time(Duration::from_secs_f64(0.25));
            suite.add_property(("law", "pid"));
            suite.add_test_case(TestCase::new("run", status_of(&row)));
            for verdict in ["pass", "fail", "undecided"] {
                suite.add_test_case(case_of(&row, &requirement(verdict)));
            }
            report.add_test_suite(suite);
        }
        let text = xml(&report).expect("XML");
        assert_eq!(schema::objections(&text), Vec::<String>::new(), "{text}");
        // Each suite has its own count.
        assert_eq!(text.matches(" skipped=\"1\"").count(), 3, "{text}");
        let rows = [row(Infrastructure), row(Pass)];
        let text = of(&rows).expect("XML");
        assert_eq!(schema::objections(&text), Vec::<String>::new(), "{text}");
    }

    #[test]
    fn undecided_requirements_of_an_aborted_run_are_skipped() {
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
            let status = match case_of(&row(exit), &requirement(verdict)).status {
                TestCaseStatus::Success { .. } => "passed",
                TestCaseStatus::NonSuccess { .. } => "failed",
                TestCaseStatus::Skipped { .. } => "skipped",
            };
            assert_eq!(status, expected, "{verdict} of a run with {exit:?}");
        }
    }
}
