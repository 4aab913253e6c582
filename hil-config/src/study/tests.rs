use super::*;

const HEAD: &str = "schema = 1\nscenario = \"a.toml\"\n";

fn study(text: &str) -> Study {
    let read = Study::parse(&format!("{HEAD}{text}"), "studies/demo.toml");
    read.unwrap_or_else(|problems| panic!("{problems}"))
}

fn refused(text: &str) -> String {
    let read = Study::parse(&format!("{HEAD}{text}"), "studies/demo.toml");
    read.expect_err("refused").to_string()
}

#[test]
fn a_study_is_read_with_its_defaults() {
    let study = study(
        r#"
cases = 10
set = ["run.duration_s=2"]
[[vary]]
key = "faults[0].at_s"
kind = "uniform"
min = 1
max = 2
[[vary]]
name = "half"
key = "plant.parameters.a"
kind = "expression"
expression = "at_s / 2"
[[variants]]
name = "pid"
set = ["controller.law=pid"]
[[variants]]
name = "ftsc"
set = ["controller.law=ftsc"]
[[goals]]
variant = "ftsc"
probability = 0.9
"#,
    );
    assert_eq!((&*study.name, study.seed, study.cases()), ("demo", 1, 20));
    assert_eq!(study.scenario, Path::new("studies/a.toml"));
    assert_eq!(study.sampling, Sampling::Independent);
    assert_eq!(study.varied[0].name, "at_s");
    assert_eq!(
        study.varied[0].spread,
        Spread::Uniform { min: 1.0, max: 2.0 }
    );
    assert_eq!(study.goals[0].confidence, 0.95);
    assert!(
        study.sets("controller.law") && study.sets("run.duration_s") && !study.sets("run.seed")
    );
}

#[test]
fn a_grid_has_as_many_draws_as_points() {
    let study = study(
        r#"
sampling = "grid"
[[vary]]
key = "a.b"
kind = "grid"
min = 0.1
max = 10
points = 3
scale = "log"
[[vary]]
key = "a.c"
kind = "list"
values = ["x", "y", "z", "w"]
"#,
    );
    assert_eq!(study.draws, 12);
    let Spread::Choice(items) = &study.varied[0].spread else {
        panic!("{:?}", study.varied[0])
    };
    let numbers: Vec<String> = items.iter().map(Item::toml).collect();
    assert_eq!(numbers, ["0.1", "1.0", "10.0"]);
    let Spread::Choice(items) = &study.varied[1].spread else {
        panic!("{:?}", study.varied[1])
    };
    assert_eq!(items[1].toml(), "\"y\"");
}

#[test]
fn using_a_faulty_value_is_not_reported_as_another_mistake() {
    let text = "cases = 1\n[[vary]]\nkey = \"a.n\"\nkind = \"normal\"\nmean = nan\ndeviation = 1\n\
                [[vary]]\nkey = \"a.b\"\nkind = \"expression\"\nexpression = \"2 * n\"\n";
    let message = refused(text);
    assert!(
        message.contains("`vary[0].mean` is not a number") && message.ends_with("\n1 problem"),
        "{message}"
    );
}

#[test]
fn each_mistake_is_reported_with_its_place_and_the_nearest_name() {
    let uniform = "[[vary]]\nkey = \"a.b\"\nkind = \"uniform\"\nmin = 0\nmax = 1\n";
    let normal = "[[vary]]\nkey = \"a.n\"\nkind = \"normal\"\nmean = 0\ndeviation = 1\n";
    #[rustfmt::skip] // a table
    let rows = [
        (uniform.to_owned(), "`cases` is missing"),
        ("cases = 1\nsampels = 2\n".into(), "nearest: `sampling`"),
        (format!("cases = 1\n{}", uniform.replace("uniform", "unifrom")), "nearest: `uniform`"),
        (format!("cases = 1\n{}", uniform.replace("max = 1", "max = 0")), "`vary[0].min` is not below max"),
        (format!("cases = 1\n{uniform}{uniform}"), "`a.b` is already set by this study"),
        (format!("cases = 1\nset = [\"a.b=3\"]\n{uniform}"), "`a.b` is already set by this study"),
        ("cases = 1\nset = [\"a.b\"]\n".into(), "`a.b` has no `=`"),
        (format!("cases = 1\n{}", uniform.replace("a.b", "a..b")), "`` is not a key"),
        (format!("cases = 1\n{}", uniform.replace("a.b", "a.class")), "a column of every table of results"),
        (format!("sampling = \"grid\"\n{uniform}"), "`b` is uniform, but grid sampling needs a list of points"),
        ("sampling = \"grid\"\ncases = 3\n".into(), "a grid has as many cases as points"),
        ("cases = 1\n[[vary]]\nkey = \"a.b\"\nkind = \"list\"\nvalues = [1, \"x\"]\n".into(), "a value of the same type as the first"),
        ("cases = 1\n[[vary]]\nkey = \"a.b\"\nkind = \"list\"\nvalues = [1]\n".into(), "nothing varies"),
        (
            format!(
                "cases = 1\n{uniform}[[vary]]\nname = \"c\"\nkind = \"expression\"\nexpression = \"2 * d\"\n"
            ),
            "numbers that are varied before this one: `b`",
        ),
        (
            format!(
                "cases = 1\n{normal}{uniform}[[correlate]]\nnames = [\"n\", \"b\"]\ncoefficient = 0.5\n"
            ),
            "`b` is not a normal or lognormal value",
        ),
        ("cases = 1\nsampling = \"sobol\"\n[[goals]]\nprobability = 0.9\n".into(), "has no confidence bounds"),
        ("cases = 1\n[[goals]]\nprobability = 0.9\nvariant = \"senario\"\n".into(), "nearest: `scenario`"),
        (
            format!(
                "cases = 1\nsampling = \"saltelli\"\n{normal}{}[[correlate]]\nnames = [\"n\", \"m\"]\ncoefficient = 0.5\n",
                normal.replace("a.n", "a.m")
            ),
            "correlations are not possible with sampling = \"saltelli\"",
        ),
        (
            {
                let one = |number| uniform.replace("a.b", &format!("a.b{number}"));
                let all: String = (0..33).map(one).collect();
                format!("cases = 1\nsampling = \"saltelli\"\n{all}")
            },
            "Sobol' points support at most 32 values",
        ),
        ("cases = 100000001\n".into(), "a whole number from 1 to 100000000"),
        (
            format!(
                "cases = 1\n{}whole = true\n",
                uniform.replace("min = 0", "min = 0.5")
            ),
            "`vary[0].min` is 0.5, but only whole numbers are valid",
        ),
        (
            format!(
                "cases = 1\n{}points = 3\nwhole = true\n",
                uniform.replace("uniform", "grid")
            ),
            "a point of the grid is 0.5, but only whole numbers are valid",
        ),
        ("cases = 1\n[[vary]]\nkey = \"a.b\"\nkind = \"list\"\nvalues = [1, 2]\nwhole = true\n".into(), "unknown key `whole`"),
        ("cases = 1\n[[variants]]\nname = \"a b\"\n".into(), "no name twice"),
        ("cases = 1\n[search]\nvariant = \"senario\"\n".into(), "nearest: `scenario`"),
        (format!("cases = 1\n{uniform}nominal = 2\n"), "a number from 0 to 1, the range of the value"),
        ("cases = 1\n[[vary]]\nkey = \"a.b\"\nkind = \"list\"\nvalues = [1, 2]\nnominal = 1\n".into(), "a value without a range has no nominal value"),
    ];
    for (text, message) in rows {
        let said = refused(&text);
        assert!(said.contains(message), "{text}\n{said}");
        assert!(said.contains("--> studies/demo.toml:"), "{said}");
    }
}

#[test]
fn a_problem_of_a_case_is_reported_at_the_variation_that_caused_it() {
    let study = study(
        "cases = 1\n[[vary]]\nkey = \"run.duraton_s\"\nkind = \"uniform\"\nmin = 0\nmax = 1\n",
    );
    let scenario = crate::scenario::Scenario::parse("schema = 1\n[run]\nrate_hz = 10\n", "a.toml");
    let checked = scenario
        .expect("TOML")
        .set(&["run.duraton_s=0.5"])
        .check(&[], &[], &[]);
    let problems = checked.expect_err("refused").0;
    let texts: Vec<String> = problems
        .into_iter()
        .map(|one| study.at_home(one).to_string())
        .collect();
    let one = texts
        .iter()
        .find(|one| one.contains("duraton_s"))
        .expect("told");
    assert!(one.contains("--> studies/demo.toml:5:7"), "{one}");
    assert!(one.contains("nearest: `duration_s`"), "{one}");
    assert!(one.contains("a case has run.duraton_s=0.5"), "{one}");
}

#[test]
fn a_grid_takes_whole_numbers_and_advice_is_given_for_others() {
    let grid = "[[vary]]\nname = \"n\"\nkey = \"run.seed\"\nkind = \"grid\"\nmin = 1\nmax = 1000\npoints = 4\nscale = \"log\"\n";
    let whole = study(&format!("sampling = \"grid\"\n{grid}whole = true\n"));
    let Spread::Choice(items) = &whole.varied[0].spread else {
        panic!("{:?}", whole.varied[0])
    };
    let texts: Vec<String> = items.iter().map(Item::toml).collect();
    assert_eq!(texts, ["1", "10", "100", "1000"]);
    let study = study(&format!("sampling = \"grid\"\n{grid}"));
    let scenario = crate::scenario::Scenario::parse("schema = 1\n", "a.toml").expect("TOML");
    let checked = scenario.set(&["run.seed=1.0"]).check(&[], &[], &[]);
    let problems = checked.expect_err("refused").0;
    let mut messages = problems
        .into_iter()
        .map(|one| study.at_home(one).to_string());
    assert!(
        messages
            .any(|one| one.contains("set `whole = true` in its [[vary]] to draw whole numbers"))
    );
}

#[test]
fn a_study_of_a_search_needs_no_cases_and_has_ranges_and_nominal_values() {
    let text = r#"
[[vary]]
name = "factor"
kind = "uniform"
min = 1
max = 3
[[vary]]
key = "a.mass"
kind = "normal"
mean = 5
deviation = 1
min = 4
max = 8
[[vary]]
key = "a.gain"
kind = "normal"
mean = 5
deviation = 1
[search]
requirement = "settles"
"#;
    let study = study(text);
    assert_eq!(study.draws, 1);
    let ranges: Vec<_> = study.varied.iter().map(Varied::range).collect();
    let expected = [Some(([1.0, 3.0], 1.0)), Some(([4.0, 8.0], 5.0)), None];
    assert_eq!(ranges, expected);
    let search = study.search;
    assert_eq!(search.requirement.as_deref(), Some("settles"));
    assert_eq!(
        (search.tolerance, search.probes, search.runs),
        (0.01, 3, 300)
    );
}

#[test]
fn saltellis_scheme_has_two_draws_and_one_for_each_drawn_value_in_a_row() {
    let text = r#"
cases = 10
sampling = "saltelli"
[[vary]]
key = "a.b"
kind = "uniform"
min = 1
max = 3
[[vary]]
key = "a.c"
kind = "uniform"
min = 1
max = 3
[[vary]]
key = "a.d"
kind = "expression"
expression = "b + c"
"#;
    let study = study(text);
    assert_eq!((study.draws, study.rows(), study.drawn()), (40, 10, 2));
}

#[test]
fn a_table_of_faults_is_a_grid_over_kinds_targets_sizes_and_onsets() {
    let study = study(
        r#"
[[variants]]
name = "a"
[[variants]]
name = "b"
detected = "none"
[faults]
onsets_s = [1.0, 2.0]
detected = "truth.x > 1"
[[faults.kinds]]
kind = "bias"
targets = ["measured.x", "command.y"]
sizes = ["bias = 0.5"]
[[faults.kinds]]
kind = "leakage"
targets = ["actuator = 1"]
sizes = ["area = 1, profile = { kind = \"ramp\", duration_s = 2 }", "area = 2"]
onsets_s = [3.0]
duration_s = 0.25
"#,
    );
    assert_eq!(
        (study.sampling, study.draws, study.cases()),
        (Sampling::Grid, 6, 12)
    );
    let tried = study.faults.as_ref().expect("a table").tried();
    let flags: Vec<String> = tried.iter().map(TriedFault::flag).collect();
    let bias = |target: &str, at_s: &str| {
        format!(
            "faults[+]={{ name = \"tried\", kind = \"bias\", at_s = {at_s}, effects = [{{ target = \"{target}\", bias = 0.5 }}] }}"
        )
    };
    assert_eq!(
        flags[..4],
        [
            bias("measured.x", "1.0"),
            bias("measured.x", "2.0"),
            bias("command.y", "1.0"),
            bias("command.y", "2.0"),
        ]
    );
    assert_eq!(
        flags[4],
        "faults[+]={ name = \"tried\", kind = \"leakage\", at_s = 3.0, duration_s = 0.25, effects = [{ actuator = 1, area = 1, profile = { kind = \"ramp\", duration_s = 2 } }] }"
    );
    // Every variant has the same columns of results, with or without an alarm.
    let timing = |variant| study.timing_flag(variant, true).expect("an alarm");
    assert!(
        timing(0).contains("alarm = \"truth.x > 1\""),
        "{}",
        timing(0)
    );
    assert!(timing(1).contains("alarm = \"0\""), "{}", timing(1));
    assert!(timing(1).contains("fault = \"tried\""), "{}", timing(1));
}

#[test]
fn a_size_moves_no_onset() {
    for skew in ["skew_s = 0.5", "skew_steps = 5"] {
        let message = refused(&format!(
            "[faults]\nonsets_s = [1.0]\n[[faults.kinds]]\nkind = \"bias\"\nsizes = [\"bias = 1, {skew}\"]\n"
        ));
        assert!(
            message.contains("`onsets_s` has the time at which the effect begins"),
            "{message}"
        );
    }
}

#[test]
fn faults_without_targets_are_no_varied_value_yet() {
    let study = study("[faults]\nonsets_s = [1.0]\n[[faults.kinds]]\nkind = \"late\"\n");
    let table = study.faults.as_ref().expect("a table");
    assert!(!table.is_complete() && table.tried().is_empty());
    assert!(study.varied.is_empty());
    assert_eq!(study.timing_flag(0, true), None);
}
