//! Tables of points, in a file or in the scenario.

use std::fs;

use hil_config::plan::{Plan, Waveform};
use hil_config::problem::{Problem, ProblemKind};
use hil_config::scenario::Scenario;
use hil_config::table::{Points, Table};

use crate::bad::assert_found;
use crate::descriptions::Checked;
use crate::{check, only, with_stimulus};

const TABLE: &str = "kind = \"table\"\nfile = \"points/x.csv\"";

/// Checks the base with a table of points in place of its second stimulus.
fn with_file(csv: Option<&str>) -> Result<Plan, Vec<Problem>> {
    let folder = tempfile::tempdir().expect("a folder");
    fs::create_dir(folder.path().join("points")).expect("a folder");
    if let Some(csv) = csv {
        fs::write(folder.path().join("points/x.csv"), csv).expect("a file");
    }
    let path = folder.path().join("base.toml");
    let text = with_stimulus(TABLE);
    fs::write(&path, text).expect("a file");
    Scenario::read(&path)
        .expect("TOML")
        .checked()
        .map_err(|problems| problems.0)
}

fn points() -> Waveform {
    let values = vec![vec![1.0, -2.5, 3e-3]];
    let points = Points::new(vec![0.0, 0.5, 2.0], values).expect("rows");
    Waveform::Table(Table::linear(points))
}

#[test]
fn a_file_is_found_beside_the_scenario() {
    let csv = "# load in N\ntime_s, value\n0,1\r\n\n0.5, -2.5\n2,3e-3";
    let plan = with_file(Some(csv)).expect("points");
    assert_eq!(plan.stimuli[1].waveform, points());
    assert_eq!(plan.stimuli[1].fields().len(), 2); // with the slope
}

#[test]
fn a_file_that_begins_with_a_byte_order_mark_is_read() {
    let csv = "\u{feff}time_s,value\n0,1\n0.5,-2.5\n2,3e-3\n";
    let plan = with_file(Some(csv)).expect("points");
    assert_eq!(plan.stimuli[1].waveform, points());
}

#[test]
fn points_may_stand_in_the_scenario() {
    let inline = "kind = \"table\"\ntime_s = [0, 0.5, 2]\nvalues = [1, -2.5, 3e-3]";
    let text = with_stimulus(inline);
    assert_eq!(check(&text).expect("points").stimuli[1].waveform, points());
}

#[test]
fn a_wrong_line_is_named_with_file_and_number() {
    let cases = [
        ("0,1\n1,2\n", 1, "not the header"),
        ("value\n1\n", 1, "not the header"),
        ("time_s,value\n0,1\n0.5;2\n", 3, "not a point"),
        ("time_s,value\n0,1\n0.5,two\n", 3, "not a point"),
        ("time_s,value\n0,1\n0.5,nan\n", 3, "not a point"),
        ("time_s,value\n0,1\n\n0.5,1,2\n", 4, "not a point"),
        ("time_s,value\n0,1\n1,1\n1,2\n", 4, "time 1 follows time 1"),
        ("time_s,value\n", 2, "no points"),
        ("", 1, "no points"),
    ];
    for (csv, line, piece) in cases {
        let problem = only(with_file(Some(csv)).expect_err(csv));
        assert_found(&problem, ProblemKind::Syntax, &[piece]);
        assert!(problem.source.ends_with("points/x.csv"), "{problem}");
        let reported = problem.excerpt.as_ref().map(|at| at.line);
        assert_eq!(reported, Some(line), "{problem}");
    }
}

#[test]
fn a_missing_file_is_reported_at_its_key_with_the_folder_of_its_path() {
    let problem = only(with_file(None).expect_err("no file"));
    let pieces = ["cannot be read: it does not exist", "points/x.csv"];
    assert_found(&problem, ProblemKind::Unreadable, &pieces);
    assert_eq!(problem.key, "stimuli[1].file");
    assert!(problem.source.ends_with("base.toml"));
    let help = problem.help.as_deref().expect("advice");
    let folder = "paths in a scenario are relative to the folder of the scenario, /";
    assert!(help.contains(folder), "{help}");
    assert!(help.ends_with("/points/x.csv"), "{help}");
}

#[test]
fn wrong_points_in_the_scenario_are_refused() {
    for (points, piece) in [
        ("", "its points in exactly one way"),
        ("time_s = [1]", "its points in exactly one way"),
        (
            "file = \"x\"\ntime_s = [1]\nvalues = [1]",
            "its points in exactly one way",
        ),
        ("time_s = [1, 2]\nvalues = [1]", "2 times and 1 values"),
        ("time_s = []\nvalues = []", "no points"),
        ("time_s = [1, 1]\nvalues = [1, 2]", "time 1 follows time 1"),
        (
            "time_s = [1, inf]\nvalues = [1, 2]",
            "stimuli[1].time_s[1]` is inf",
        ),
        ("time_s = 1\nvalues = [1, 2]", "a list of numbers"),
    ] {
        let stimulus = format!("kind = \"table\"\n{points}");
        let text = with_stimulus(&stimulus);
        let problem = only(crate::problems(&text));
        assert!(problem.to_string().contains(piece), "{problem}");
    }
}

#[test]
fn a_fault_with_more_numbers_than_the_record_stream_carries_is_refused() {
    let profile = |count: usize| {
        let times: Vec<String> = (0..count).map(|i| format!("{i}.0")).collect();
        let times = times.join(", ");
        format!(
            "kind = \"bias\"\nat_s = 0.5\n[[faults.effects]]\n\
             target = \"measured.surface_angle_rad\"\nbias = 1.0\n\
             profile = {{ kind = \"table\", time_s = [{times}], values = [{times}] }}\n"
        )
    };
    let list = |count: usize| {
        let rows = vec!["[5, 1]"; count].join(", ");
        format!(
            "kind = \"late\"\nat_s = 0.5\n[[faults.effects]]\n\
             target = \"plant\"\nbusy_us = 1\nhistogram = [{rows}]\n"
        )
    };
    let cases: [(&dyn Fn(usize) -> String, &str); 2] = [
        (&profile, "at most 10000 points"),
        (&list, "at most 20000 numbers"),
    ];
    for (fault, piece) in cases {
        let with = |count| check(&format!("{}\n[[faults]]\n{}", crate::BASE, fault(count)));
        assert!(with(10_000).is_ok(), "{piece}");
        let problems = with(10_001).expect_err(piece).to_string();
        assert!(problems.contains(piece), "{problems}");
    }
}

#[test]
fn a_table_outside_the_run_is_refused_with_both_times() {
    // The run goes from 0 to 2 s.
    let inline = |times: &str, values: &str| {
        let table = format!("kind = \"table\"\ntime_s = {times}\nvalues = {values}");
        check(&with_stimulus(&table))
    };
    for (times, text) in [
        (
            "[3, 4]",
            "the table goes from 3 to 4 s and the run from 0 to 2 s",
        ),
        (
            "[-2, -1]",
            "the table goes from -2 to -1 s and the run from 0 to 2 s",
        ),
    ] {
        let message = inline(times, "[1, 2]").expect_err(times).to_string();
        assert!(message.contains(text), "{message}");
        assert!(message.contains("times that overlap the run"), "{message}");
    }
    for times in ["[2, 3]", "[-1, 0]", "[-1, 9]", "[0.5, 1]"] {
        assert!(inline(times, "[1, 2]").is_ok(), "{times}");
    }
    let problems = with_file(Some("time_s,value\n3,1\n")).expect_err("outside");
    assert_eq!(problems[0].key, "stimuli[1].file");
}
