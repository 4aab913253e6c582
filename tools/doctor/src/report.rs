//! The report of the doctor, as text and as JSON.

use std::fmt::Write;

use hil_console::terminal::duration::shown_ns;
use hil_console::terminal::table::{Table, left, right};
use serde::Serialize;
use serde_json::Value;

use super::finding::{Finding, Grade};

/// Findings and conclusion.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Report {
    /// Version of the report format.
    pub schema: u32,
    /// Fitness for timing claims; unfit if a grade is poor.
    pub verdict: Verdict,
    /// Cores that were checked.
    pub cores: Vec<u32>,
    /// Online cores of the machine.
    pub online_cores: String,
    /// Scheduling class of the measurements; `None` if nothing was measured.
    pub class: Option<String>,
    /// Duration of each measurement, in s; `None` if nothing was measured.
    pub seconds: Option<f64>,
    /// Findings of all checks.
    pub checks: Vec<Finding>,
}

/// Fitness of a machine for timing claims.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Verdict {
    /// Fit.
    Fit,
    /// Unfit.
    Unfit,
}

impl Verdict {
    /// Derives the verdict from findings.
    pub(crate) fn of(findings: &[Finding]) -> Self {
        let poor = |finding: &Finding| finding.grade == Grade::Poor;
        if findings.iter().any(poor) {
            Self::Unfit
        } else {
            Self::Fit
        }
    }
}

impl Report {
    /// Formats the report for a person.
    pub(crate) fn text(&self, colours: bool) -> String {
        let mut text = format!(
            "checked: cores {} of {}",
            list(&self.cores),
            self.online_cores
        );
        if let (Some(class), Some(seconds)) = (&self.class, self.seconds) {
            let _ = write!(text, "; measured {seconds} s each at {class}");
        } else {
            text += "; nothing measured";
        }
        let mut table = Table::new(0, [left(7), left(0), left(0)]);
        table.cells(["GRADE", "CHECK", "FOUND"]);
        for finding in &self.checks {
            let Finding {
                check,
                grade,
                found,
                why,
                mend,
                ..
            } = finding;
            let word = match colours {
                true => coloured(*grade, grade.word()),
                false => grade.word().to_owned(),
            };
            table.row(&[&word, check, found]);
            if *grade == Grade::Good {
                continue;
            }
            table.row(&[&"", &"", why]);
            if let Some(mend) = mend {
                table.row(&[&"", &"", &format!("$ {mend}")]);
            }
        }
        text += &format!("\n\n{table}");
        if let Some(table) = self.gaps() {
            text += "\n";
            text += &table;
        }
        text += "\n";
        text += &self.conclusion();
        text
    }

    fn conclusion(&self) -> String {
        let of = |grade| {
            let names: Vec<&str> = (self.checks.iter())
                .filter(|finding| finding.grade == grade)
                .map(|finding| finding.check)
                .collect();
            names.join(", ")
        };
        let mut text = match self.verdict {
            Verdict::Unfit => format!("unfit for timing claims: {}\n", of(Grade::Poor)),
            Verdict::Fit => "fit for timing claims\n".into(),
        };
        let unknown = of(Grade::Unknown);
        if !unknown.is_empty() {
            let _ = writeln!(text, "unknown: {unknown}");
        }
        text
    }

    /// Formats the gaps of each core, by length.
    fn gaps(&self) -> Option<String> {
        let measured = |finding: &Finding| finding.measured.clone();
        let gaps = self.checks.iter().filter(|finding| finding.check == "gaps");
        let gaps = gaps.filter_map(measured).next()?;
        let from = numbers(&gaps["classes_from_ns"]);
        let mut columns = vec![right(0); from.len() + 4];
        columns[0] = left(0);
        let mut table = Table::new(0, columns);
        let mut heading = vec!["HOLES FROM".to_owned()];
        heading.extend(from.iter().map(|ns| shown_ns(*ns)));
        heading.extend(["LOST", "LONGEST", "SWITCHES"].map(str::to_owned));
        table.cells(heading);
        for core in gaps["cores"].as_array()? {
            let ns = |name: &str| core[name].as_u64().unwrap_or_default();
            let mut row = vec![format!("core {}", core["core"])];
            row.extend(numbers(&core["holes"]).iter().map(u64::to_string));
            let lost = 100.0 * ns("lost_ns") as f64 / ns("watched_ns").max(1) as f64;
            row.push(format!("{lost:.2} %"));
            row.push(shown_ns(ns("longest_ns")));
            row.push(
                core["switches"]
                    .as_u64()
                    .map_or("?".into(), |n| n.to_string()),
            );
            table.cells(row);
        }
        Some(table.to_string())
    }
}

fn numbers(list: &Value) -> Vec<u64> {
    let list = list.as_array().map(Vec::as_slice).unwrap_or_default();
    list.iter().filter_map(Value::as_u64).collect()
}

fn list(cores: &[u32]) -> String {
    let cores: Vec<String> = cores.iter().map(u32::to_string).collect();
    cores.join(",")
}

fn coloured(grade: Grade, word: &str) -> String {
    let colour = match grade {
        Grade::Good => 32,
        Grade::Fair => 33,
        Grade::Poor => 31,
        Grade::Unknown => 36,
    };
    format!("\x1b[{colour}m{word}\x1b[0m")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Check;
    use serde_json::json;

    const SWAP: Check = Check::new("swap", "it is slow");
    const LOAD: Check = Check::new("load", "it disturbs");
    const GAPS: Check = Check::new("gaps", "they hurt");

    fn report(checks: Vec<Finding>) -> Report {
        Report {
            schema: 1,
            verdict: Verdict::of(&checks),
            cores: vec![2, 3],
            online_cores: "0-3".into(),
            class: None,
            seconds: None,
            checks,
        }
    }

    #[test]
    fn one_poor_grade_makes_a_machine_unfit() {
        for (grades, verdict) in [
            (vec![], Verdict::Fit),
            (vec![Grade::Good, Grade::Fair, Grade::Unknown], Verdict::Fit),
            (vec![Grade::Good, Grade::Poor], Verdict::Unfit),
        ] {
            let findings = grades.iter().map(|grade| SWAP.graded(*grade, ""));
            assert_eq!(
                Verdict::of(&findings.collect::<Vec<_>>()),
                verdict,
                "{grades:?}"
            );
        }
    }

    #[test]
    fn the_text_names_each_problem_with_its_reason_and_remedy() {
        let checks = vec![
            SWAP.good("none"),
            LOAD.poor("3.00 on 2 cores").mend("ps | head"),
            GAPS.unknown("no core was watched"),
        ];
        let expected = "\
checked: cores 2,3 of 0-3; nothing measured

GRADE    CHECK  FOUND
good     swap   none
poor     load   3.00 on 2 cores
                it disturbs
                $ ps | head
unknown  gaps   no core was watched
                they hurt

unfit for timing claims: load
unknown: gaps
";
        assert_eq!(report(checks).text(false), expected);
    }

    #[test]
    fn holes_are_listed_for_each_core() {
        let core = |core: u32, holes: [u64; 2], switches| {
            json!({"core": core, "watched_ns": 1_000_000, "lost_ns": 12_500, "longest_ns": 7_000,
                "holes": holes, "switches": switches})
        };
        let figures = json!({"classes_from_ns": [5_000, 20_000],
            "cores": [core(2, [2, 0], json!(4)), core(13, [11, 1], Value::Null)]});
        let mut report = report(vec![GAPS.good("few").measured(figures)]);
        report.class = Some("SCHED_OTHER".into());
        report.seconds = Some(0.5);
        let expected = "\
checked: cores 2,3 of 0-3; measured 0.5 s each at SCHED_OTHER

GRADE    CHECK  FOUND
good     gaps   few

HOLES FROM  5.00 us  20.0 us    LOST  LONGEST  SWITCHES
core 2            2        0  1.25 %  7.00 us         4
core 13          11        1  1.25 %  7.00 us         ?

fit for timing claims
";
        assert_eq!(report.text(false), expected);
    }

    #[test]
    fn colours_do_not_change_the_text() {
        let report = report(vec![SWAP.fair("unused"), LOAD.good("none")]);
        let mut plain = report.text(true);
        for code in ["\x1b[32m", "\x1b[33m", "\x1b[0m"] {
            assert!(plain.contains(code));
            plain = plain.replace(code, "");
        }
        assert_eq!(plain, report.text(false));
    }
}
