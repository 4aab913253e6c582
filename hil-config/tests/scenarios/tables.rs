//! Tables as other programs write them, and the mistakes in them.

use std::fs;
use std::io::Write as _;

use hil_config::plan::{DerivedSource, Plan, Waveform};
use hil_config::problem::{Problem, ProblemKind};
use hil_config::scenario::Scenario;
use hil_config::table::Table;

use crate::{base_with, descriptions};

const STEP: &str = "kind = \"step\"\nat_s = 0.5\nafter = 2.0";

/// Checks the base, whose run lasts 2 s, with a table in place of its second stimulus.
pub(crate) fn check(content: &[u8], keys: &str) -> Result<Plan, Vec<Problem>> {
    check_text(
        content,
        &base_with(STEP, &format!("kind = \"table\"\nfile = \"x.csv\"\n{keys}")),
    )
}

fn check_text(content: &[u8], scenario: &str) -> Result<Plan, Vec<Problem>> {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("x.csv"), content).expect("a file");
    let path = folder.path().join("base.toml");
    fs::write(&path, scenario).expect("a file");
    let scenario = Scenario::read(&path).expect("TOML");
    let plan = scenario.check(
        &descriptions::plants(),
        &descriptions::laws(),
        &descriptions::kinds(),
    );
    plan.map_err(|problems| problems.0)
}

pub(crate) fn table(plan: &Plan) -> &Table {
    match &plan.stimuli[1].waveform {
        Waveform::Table(table) => table,
        other => panic!("{other:?}"),
    }
}

#[test]
fn tables_are_read_as_other_programs_write_them() {
    let rows: &[(f64, f64)] = &[(0.0, 1.0), (0.5, -2.5), (2.5, 3e-3)];
    let utf16: Vec<u8> = "\u{feff}time_s\tload_n\r\n0\t1\r\n0.5\t-2.5\r\n2.5\t3e-3\r\n"
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    let cases: [(&[u8], &str); 9] = [
        (
            b"\xef\xbb\xbftime_s;load_n\r\n0;1\r\n0.5;-2.5\r\n2.5;3e-3\r\n",
            "",
        ),
        (
            b"sep=;\n\"time (ms)\";\"load (N)\"\n\"0\";\"1\"\n500;-2.5\n2500;3e-3",
            "",
        ),
        (
            b"Time [ms]\tnote\tload [N]\n0\tidle\t1\n500\tup\t-2.5\n2500\tup\t3e-3\n",
            "column = \"load\"",
        ),
        (b"t,load [kN]\n0,1e-3\n0.5,-2.5e-3\n2.5,3e-6\n", ""),
        (
            b"# a rig\n\ntimestamp_us,a,load\n0,9,1\n# pause\n500000,9,-2.5\n2500000,9,3e-3\n",
            "column = \"load\"",
        ),
        (
            b"clock,load\n0,1\n0.5,-2.5\n2.5,3e-3\n",
            "time_column = \"clock\"",
        ),
        (b"t,\"load, measured\n[N]\"\n0,1\n0.5,-2.5\n2.5,3e-3\n", ""),
        (
            b"t,load [LSB]\n10,2\n10.5,-5\n12.5,6e-3\n",
            "scale = 0.5\nstart_s = 10",
        ),
        (&utf16, ""),
    ];
    for (content, keys) in cases {
        let text = String::from_utf8_lossy(content);
        let plan =
            check(content, keys).unwrap_or_else(|problems| panic!("{text}: {}", problems[0]));
        let points = table(&plan).points();
        assert_eq!(points.time_s().len(), 3, "{text}");
        for (row, (time_s, value)) in rows.iter().enumerate() {
            assert_eq!(points.time_s()[row], *time_s, "{text}");
            let error = (points.column(0)[row] - value).abs();
            assert!(
                error < 1e-15,
                "{text}: {} is not {value}",
                points.column(0)[row]
            );
        }
    }
}

#[test]
fn a_table_is_scaled_and_has_the_derivatives_of_its_columns() {
    let csv = b"t,x,v,a\n0,1,2,3\n1,4,5,6\n2,7,8,9\n";
    let keys = "column = \"x\"\nderivatives = [\"v\", \"a\"]\nscale = 2\noffset = 1";
    let plan = check(csv, keys).expect("a table");
    let points = table(&plan).points();
    assert_eq!(points.column(0), [3.0, 9.0, 15.0]);
    assert_eq!(points.column(1), [4.0, 10.0, 16.0]);
    assert_eq!(points.column(2), [6.0, 12.0, 18.0]);
    assert_eq!(plan.stimuli[1].fields().len(), 3);
}

#[test]
fn a_mistake_is_named_with_its_line_and_the_possible_content() {
    // Line, or 0 for the scenario; a piece of the message; a piece of the expected content.
    let cases = [
        (
            "t;x\n0;1\n0.5;2,5\n",
            "",
            3,
            "`2,5` in `x` has a decimal comma",
            "a decimal point",
        ),
        (
            "t,x\n0,0,1,5\n",
            "",
            2,
            "as if each had a decimal comma",
            "tabs and points",
        ),
        (
            "t,x\ns,deg\n0,1\n",
            "",
            2,
            "a header in two lines?",
            "units in it as in `angle [deg]`",
        ),
        (
            "t,x\n0,1\n1,\n",
            "",
            3,
            "the cell of `x` is empty",
            "leave out rows",
        ),
        (
            "t,x\n0,1\n1,inf\n",
            "",
            3,
            "`inf` in `x` is not a finite number",
            "each finite",
        ),
        (
            "t,x\n0,1\n1,1\n0.5,2\n",
            "",
            4,
            "time 0.5 follows time 1",
            "strictly ascending",
        ),
        (
            "t,x\n0,1\n1,1\n1,2\n",
            "",
            4,
            "time 1 follows time 1",
            "strictly ascending",
        ),
        (
            "time,t,x\n0,0,1\n",
            "column = \"x\"",
            0,
            "two time columns, `time` and `t`",
            "time_column, for example \"time\"",
        ),
        (
            "clock,x\n0,1\n",
            "",
            0,
            "no column is named as a time",
            "time_column = one of `clock`, `x`",
        ),
        (
            "t,angle,rate\n0,1,2\n",
            "",
            0,
            "2 columns beside the time",
            "column = one of `angle`, `rate`",
        ),
        (
            "t,angle [N]\n0,1\n3,1\n",
            "column = \"angel\"",
            0,
            "no column `angel`",
            "one of `t`, `angle [N]`",
        ),
        (
            "t,angle [deg]\n0,1\n3,1\n",
            "column = \"angle\"",
            0,
            "in deg, which does not convert to N",
            "dimension of N",
        ),
        (
            "t,angle [LSB]\n0,1\n3,1\n",
            "column = \"angle\"",
            0,
            "in LSB, which does not convert to N",
            "`scale`",
        ),
        (
            "t [fortnight],x\n0,1\n",
            "",
            0,
            "no unit of time",
            "one of `s`, `ms`, `us`, `ns`, `min`, `h`",
        ),
        (
            "t,x\n0,1\n0.5,2\n",
            "column = \"x\"",
            0,
            "ends at 0.5 s with line 3 of x.csv, but the run ends at 2 s",
            "end = \"hold\" (the last value stays) or \"zero\", repeat = true, or run.duration_s of at most 0.5",
        ),
        (
            "t,x\n0,1\n1,2\n",
            "gap_s = 0.5",
            0,
            "line 2 and line 3 are 1 s apart, from 0 to 1 s",
            "gap_s = 1",
        ),
        (
            "t,x\n0,1\n3,2\n",
            "repeat = true\nend = \"hold\"",
            0,
            "a table that repeats has no end",
            "`repeat` or `end`",
        ),
        (
            "t,x\n0,1\n3,2\n",
            "repeat = true\ninterpolation = \"cubic\"",
            0,
            "its last row is the first row",
            "other rows",
        ),
        (
            "x\n1\n",
            "",
            1,
            "it has one column",
            "a time and at least one more",
        ),
        (
            "t,x\n7,1\n8,2\n",
            "",
            0,
            "the table goes from 7 to 8 s and the run from 0 to 2 s",
            "overlap the run",
        ),
    ];
    let outside = check(b"t,x\n7,1\n8,2\n", "start_s = 2").expect_err("outside");
    assert_eq!(
        outside[0].help.as_deref(),
        Some("start_s = 7 begins the run with the first row")
    );
    for (csv, keys, line, piece, expected) in cases {
        let problems = check(csv.as_bytes(), keys).expect_err(csv);
        assert_eq!(problems.len(), 1, "{csv}: {problems:?}");
        let problem = &problems[0];
        let text = problem.to_string();
        assert!(text.contains(piece), "{csv}: {text}");
        assert!(
            problem
                .expected
                .as_deref()
                .unwrap_or_default()
                .contains(expected),
            "{text}"
        );
        if line > 0 {
            assert!(problem.source.ends_with("x.csv"), "{text}");
            assert_eq!(
                problem.excerpt.as_ref().map(|at| at.line),
                Some(line),
                "{text}"
            );
        } else {
            assert!(problem.source.ends_with("base.toml"), "{text}");
        }
    }
}

#[test]
fn a_missing_column_comes_with_the_nearest_name() {
    let problems = check(
        b"t,elevator [N],aileron [N]\n0,1,1\n3,1,1\n",
        "column = \"elevatr\"",
    );
    let problem = &problems.expect_err("misspelt")[0];
    assert_eq!(problem.kind, ProblemKind::UnknownName);
    assert_eq!(problem.key, "stimuli[1].column");
    assert_eq!(problem.nearest, ["elevator [N]"]);
}

#[test]
fn a_gap_in_a_file_of_many_rows_is_refused() {
    let mut csv = String::from("t,x\n");
    for row in (0..100).chain(150..300) {
        csv += &format!("{},1\n", f64::from(row) / 100.0);
    }
    let problem = &check(csv.as_bytes(), "column = \"x\"").expect_err("a gap")[0];
    let text = problem.to_string();
    assert!(
        text.contains(
            "line 101 and line 102 are 0.51 s apart, from 0.99 to 1.5 s, where the others are 0.01"
        ),
        "{text}"
    );
    assert!(check(csv.as_bytes(), "column = \"x\"\ngap_s = 1").is_ok());
    assert!(
        check(csv.as_bytes(), "").is_ok(),
        "points were never checked for gaps"
    );
}

#[test]
fn ten_million_rows_are_read_in_their_own_memory() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut file =
        std::io::BufWriter::new(fs::File::create(folder.path().join("x.csv")).expect("a file"));
    file.write_all(b"time [us];note;load [N]\n")
        .expect("writes");
    for row in 0..10_000_000_u32 {
        writeln!(file, "{row};n;{}.5", row % 7).expect("writes");
    }
    file.into_inner().expect("writes");
    let keys = "kind = \"table\"\nfile = \"x.csv\"\ncolumn = \"load\"";
    let path = folder.path().join("base.toml");
    fs::write(&path, base_with(STEP, keys)).expect("a file");
    let scenario = Scenario::read(&path).expect("TOML");
    let plan = scenario
        .check(
            &descriptions::plants(),
            &descriptions::laws(),
            &descriptions::kinds(),
        )
        .expect("a table");
    let points = table(&plan).points();
    assert_eq!(points.time_s().len(), 10_000_000);
    assert_eq!(points.time_s()[9_999_999], 9.999999);
    assert_eq!(points.column(0)[9_999_999], f64::from(9_999_999 % 7) + 0.5);
    // Rows are never copied with the plan, and cost 16 bytes each.
    let copy = plan.clone();
    assert!(std::ptr::eq(
        table(&copy).points().time_s(),
        points.time_s()
    ));
    let status = fs::read_to_string("/proc/self/status").expect("Linux");
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let peak_kb: u64 = peak
        .and_then(|text| text.trim().strip_suffix(" kB")?.trim().parse().ok())
        .expect("a number");
    assert!(peak_kb < 1_000_000, "{peak_kb} kB");
}

fn derived(keys: &str, content: &[u8]) -> Result<Plan, Vec<Problem>> {
    let text = format!(
        "{}\n[[derived]]\nname = \"bound\"\n{keys}\n\n[[requirements]]\nname = \"within\"\nformula = \"always(truth.surface_angle_rad <= bound)\"\n",
        crate::BASE
    );
    check_text(content, &text)
}

#[test]
fn a_column_of_a_file_is_a_signal_for_expressions() {
    let csv = b"time (ms);limit [deg]\n0;180\n1000;90\n";
    let plan = derived(
        "unit = \"rad\"\nfile = \"x.csv\"\ncolumn = \"limit\"\nend = \"hold\"",
        csv,
    );
    let plan = plan.unwrap_or_else(|problems| panic!("{}", problems[0]));
    let bound = plan.derived.last().expect("derived");
    assert_eq!((bound.name.as_str(), bound.unit.as_str()), ("bound", "rad"));
    let DerivedSource::Table(table) = &bound.source else {
        panic!("{bound:?}");
    };
    assert!((table.value(0.5) - 0.75 * std::f64::consts::PI).abs() < 1e-15);
}

#[test]
fn a_derived_signal_is_an_expression_or_a_table() {
    let csv = b"t,x\n0,1\n0.5,1\n1,2\n";
    for (keys, piece) in [
        (
            "expression = \"1\"\nfile = \"x.csv\"",
            "beside an expression",
        ),
        ("", "`derived[2].expression` is missing"),
        (
            "file = \"x.csv\"\ncolumn = \"x\"",
            "ends at 1 s with line 4",
        ),
        ("file = \"y.csv\"", "it does not exist"),
    ] {
        let problems = derived(keys, csv).expect_err(keys);
        assert_eq!(problems.len(), 1, "{keys}: {problems:?}");
        let text = problems[0].to_string();
        assert!(text.contains(piece), "{text}");
    }
}

#[test]
fn a_start_is_subtracted_in_the_unit_of_the_column() {
    let csv = b"time (ms),x\n3600000,1\n3600010,2\n3602500,3\n";
    let plan = check(csv, "start_s = 3600").expect("a table");
    // 3600.01 - 3600 in s is 0.010000000000218279.
    assert_eq!(table(&plan).points().time_s(), [0.0, 0.01, 2.5]);
}
