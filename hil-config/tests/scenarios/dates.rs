//! Dates in the time column of CSV.

use crate::tables::{check, table};

#[test]
fn a_table_with_dates_counts_from_its_first_row() {
    for csv in [
        "time,load [N]\n2026-11-28T05:00:00.100Z,1\n2026-11-28T05:00:00.600Z,2\n2026-11-28T05:00:02.600Z,3\n",
        "Timestamp (UTC);note;load [N]\n2026-11-28 05:00:00.100;a;1\n2026-11-28 05:00:00.600;b;2\n2026-11-28 05:00:02.600;c;3\n",
        "date\tload [N]\n2026-11-28 06:00:00.1+01:00\t1\n2026-11-28 05:00:00.6+00:00\t2\n2026-11-28 07:00:02.6+0200\t3\n",
        "\"When\",\"load [N]\"\n# a rig\n\"2026-12-31 23:59:59.4 UTC\",1\n\"2026-12-31 23:59:59.9 UTC\",2\n\"2027-01-01 00:00:01.9 UTC\",3\n",
    ] {
        let plan = check(csv.as_bytes(), "column = \"load\"");
        let plan = plan.unwrap_or_else(|problems| panic!("{csv}: {}", problems[0]));
        assert_eq!(table(&plan).points().time_s(), [0.0, 0.5, 2.5], "{csv}");
    }
}

#[test]
fn a_table_with_dates_begins_where_start_s_says() {
    let csv = b"time,x\n2026-11-28T05:00:00Z,1\n2026-11-28T06:00:00Z,2\n2026-11-28T06:00:03Z,4\n";
    let plan = check(csv, "column = \"x\"\nstart_s = 3600\ngap_s = 3600").expect("a table");
    let table = table(&plan);
    assert_eq!([table.value(0.0), table.value(1.5)], [2.0, 3.0]);
}

#[test]
fn a_number_counts_as_time_where_another_column_has_dates() {
    let csv = b"date,time,x\n2026-11-28 05:00:00,0,1\n2026-11-28 05:00:09,3,2\n";
    let plan = check(csv, "column = \"x\"").expect("a table");
    assert_eq!(table(&plan).points().time_s(), [0.0, 3.0]);
}

#[test]
fn dates_that_are_mixed_or_do_not_rise_are_refused_with_their_line() {
    let cases = [
        (
            "time,x\n2026-11-28T05:00:00Z,1\n12.5,2\n",
            3,
            "`12.5` in `time` is not a date, but the first row has one",
            "a date in every row or a number in every row",
        ),
        (
            "time,x\n0,1\n2026-11-28T05:00:00Z,2\n",
            3,
            "`2026-11-28T05:00:00Z` in `time` is a date, and the first row has a number",
            "a date in every row or a number in every row",
        ),
        (
            "time,x\n2026-11-28T05:00:00Z,1\n2026-11-28 05:00:01,2\n",
            3,
            "has no zone, but the first row has one",
            "a zone in every row or in none",
        ),
        (
            "time,x\n2026-11-28T05:00:00,1\n2026-11-28T05:00:01+01:00,2\n",
            3,
            "has a zone, but the first row has none",
            "a zone in every row or in none",
        ),
        (
            "time,x\n2026-11-28T05:00:00Z,1\n\n2026-11-28T05:00:00+01:00,2\n",
            4,
            "time -3600 follows time 0",
            "strictly ascending",
        ),
        (
            "time,x\n2026-11-28T05:00:00Z,1\n2026-11-28T05:00:00.000Z,2\n",
            3,
            "time 0 follows time 0",
            "strictly ascending",
        ),
        (
            "time,x\n28.11.2026 05:00:00,1\n",
            2,
            "`28.11.2026 05:00:00` in `time` is neither a number nor a date with a time of day",
            "dates such as 2026-11-28T05:00:00.123Z",
        ),
        (
            "time,x\n05:00:00.123,1\n",
            2,
            "neither a number nor a date",
            "numbers, or dates such as",
        ),
        (
            "time,x\n2026-02-30T05:00:00Z,1\n",
            2,
            "neither a number nor a date",
            "numbers, or dates such as",
        ),
        (
            "time,x\n2026-11-28T05:00:00Z,1\n2026-13-28T05:00:00Z,2\n",
            3,
            "is not a date, but the first row has one",
            "dates such as 2026-11-28T05:00:00.123Z",
        ),
    ];
    for (csv, line, piece, expected) in cases {
        let problems = check(csv.as_bytes(), "column = \"x\"").expect_err(csv);
        assert_eq!(problems.len(), 1, "{csv}: {problems:?}");
        let problem = &problems[0];
        let text = problem.to_string();
        assert!(text.contains(piece), "{csv}: {text}");
        assert!(text.contains(expected), "{csv}: {text}");
        assert!(problem.source.ends_with("x.csv"), "{text}");
        let at = problem.excerpt.as_ref().map(|excerpt| excerpt.line);
        assert_eq!(at, Some(line), "{text}");
    }
}

#[test]
fn a_column_of_dates_is_no_value() {
    let csv = b"t,when\n0,2026-11-28T05:00:00Z\n3,2026-11-28T05:00:03Z\n";
    let problems = check(csv, "column = \"when\"").expect_err("dates");
    let text = problems[0].to_string();
    assert!(text.contains("in s, which does not convert to N"), "{text}");
}
