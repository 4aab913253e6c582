//! `--set KEY=VALUE`.

use hil_config::problem::{Problem, ProblemKind};

use crate::bad::assert_found;
use crate::descriptions::Checked;
use crate::{BASE, only, parse, plan};

fn with(flags: &[&str]) -> Result<hil_config::plan::Plan, Vec<Problem>> {
    parse(BASE)
        .expect("TOML")
        .set(flags)
        .checked()
        .map_err(|problems| problems.0)
}

fn set(flags: &[&str]) -> hil_config::plan::Plan {
    with(flags).unwrap_or_else(|problems| panic!("{problems:?}"))
}

#[test]
fn a_flag_acts_like_a_line_of_the_file() {
    #[rustfmt::skip] // a table
    let cases = [
        ("run.seed=9", "seed = 7", "seed = 9"),
        ("faults[0].effects[1].speed_per_s=2", "speed_per_s = 0.5", "speed_per_s = 2"),
        ("plant.parameters.actuator2.piston_mass_kg=70", "= 60.0", "= 70"),
        ("metrics[0].windows_s[1][0]=1.5", "[1.0, 2]", "[1.5, 2]"),
        ("metrics[0].windows_s=[[0.5, 2]]", "[[0, 1], [1.0, 2]]", "[[0.5, 2]]"),
        ("name=other", "\"base\"", "\"other\""),
        ("name=\"other\"", "\"base\"", "\"other\""),
    ];
    for (flag, from, to) in cases {
        assert_eq!(set(&[flag]), plan(&crate::base_with(from, to)), "{flag}");
    }
}

#[test]
fn a_flag_creates_missing_tables() {
    let actual = set(&["plant.parameters.actuator1.piston_mass_kg=61"]);
    assert_eq!(
        actual.plant.parameters.get("actuator1.piston_mass_kg"),
        Some(61.0)
    );
    assert_eq!(
        actual.plant.parameters.get("actuator2.piston_mass_kg"),
        Some(60.0)
    );
}

#[test]
fn a_flag_overrides_a_value_under_a_quoted_key() {
    let flag = "plant.parameters.actuator2.piston_mass_kg=70";
    for quoted in [
        "\"actuator2.piston_mass_kg\" = 60.0",
        "\"actuator2.piston_mass_kg\" = 60.0\nactuator1.piston_mass_kg = 61.0",
    ] {
        let text = crate::base_with("actuator2.piston_mass_kg = 60.0", quoted);
        let checked = parse(&text).expect("TOML").set(&[flag]).checked();
        let plan = checked.unwrap_or_else(|problems| panic!("{problems}"));
        let mass_kg = plan.plant.parameters.get("actuator2.piston_mass_kg");
        assert_eq!(mass_kg, Some(70.0));
    }
}

#[test]
fn one_flag_switches_the_law() {
    let without = ["derived[1].expression=error_rad > 0"];
    let actual = set(&["controller.law=pid", without[0]]);
    assert_eq!(actual.controller.law, "pid");
    assert_eq!(actual.controller.parameters.get("gain_a_per_m"), Some(80.0));
    assert_eq!(actual.controller.model.0.len(), 0);
}

#[test]
fn a_value_that_two_flags_set_is_refused() {
    for (flags, place) in [
        (["run.seed=8", "run.seed=9"], "run.seed"),
        (["run.seed=8", "run.seed=8"], "run.seed"),
        (
            [
                "faults[0].effects[1].speed_per_s=2",
                "faults[0].effects[1]={}",
            ],
            "faults[0].effects[1]",
        ),
        (
            [
                "plant.parameters.actuator1.piston_mass_kg=9",
                "plant.parameters={}",
            ],
            "plant.parameters",
        ),
    ] {
        let problems = with(&flags).expect_err("one of them would be lost");
        let twice = (problems
            .iter()
            .find(|one| one.kind == ProblemKind::Duplicate))
        .unwrap_or_else(|| panic!("{problems:?}"));
        assert_eq!(twice.key, place);
        let earlier = format!("set by `--set {}`", flags[0]);
        assert!(twice.message.contains(&earlier), "{}", twice.message);
    }
}

#[test]
fn a_flag_may_change_a_part_of_what_an_earlier_one_set() {
    let table = "plant.parameters={ piston_mass_kg = 50 }";
    let actual = set(&[table, "plant.parameters.actuator2.piston_mass_kg=61"]);
    let mass_kg = |actuator: &str| {
        actual
            .plant
            .parameters
            .get(&format!("{actuator}.piston_mass_kg"))
    };
    assert_eq!(mass_kg("actuator1"), Some(50.0));
    assert_eq!(mass_kg("actuator2"), Some(61.0));
}

#[test]
fn a_faulty_flag_is_reported_with_the_column_of_the_mistake() {
    #[rustfmt::skip] // a table
    let cases = [
        ("run.rate_hz=0", 13, ProblemKind::OutOfRange, "`run.rate_hz` is 0"),
        ("run.rate_hz=fast", 13, ProblemKind::WrongType, "`run.rate_hz` is text"),
        ("run.rat_hz=1", 5, ProblemKind::UnknownKey, "unknown key `rat_hz`"),
        ("rum.rate_hz=1", 1, ProblemKind::UnknownKey, "unknown key `rum`"),
        ("run.rate_hz", 1, ProblemKind::Syntax, "found no `=`"),
        ("run.rate_hz=", 13, ProblemKind::Syntax, "no value"),
        ("run..rate_hz=1", 5, ProblemKind::Syntax, "is not a key"),
        ("faults[1].at_s=1", 7, ProblemKind::Syntax, "has 1 entries, counted from 0; there is no [1]"),
        ("faults[x].at_s=1", 7, ProblemKind::Syntax, "is not an index"),
        ("faults.at_s=1", 8, ProblemKind::Syntax, "`faults` is a list, not a table"),
        ("run[0]=1", 4, ProblemKind::Syntax, "`run` is a table, not a list"),
        ("run.seed.x=1", 10, ProblemKind::Syntax, "`seed` is a number, not a table"),
        ("runs[0]=1", 5, ProblemKind::Syntax, "there is no list `runs`"),
        ("metrics[0].windows_s=[[0, 1], [1, 9]]", 31, ProblemKind::OutOfRange, "not inside the run"),
        ("metrics[0].expression=max_abs(eror_rad)", 31, ProblemKind::Expression, "column 9 of the expression"),
        ("plant.parameters.piston_mass_kg=-1", 33, ProblemKind::OutOfRange, "in kg"),
    ];
    for (flag, column, kind, piece) in cases {
        let problem = only(with(&[flag]).expect_err(flag));
        assert_found(&problem, kind, &[piece]);
        assert_eq!(problem.source, format!("--set {flag}"));
        let excerpt = problem.excerpt.as_ref().expect("a place");
        assert_eq!((excerpt.line, excerpt.column), (1, column), "{problem}");
    }
}

#[test]
fn a_misplaced_name_is_answered_with_its_key_or_table() {
    #[rustfmt::skip] // a table
    let cases = [
        ("piston_mass_kg=1", "plant.parameters.actuator1.piston_mass_kg", ""),
        ("plant.piston_mass=1", "plant.parameters.actuator1.piston_mass_kg", ""),
        ("rate_hz=1", "run.rate_hz", ""),
        ("run=1", "", ""),
        ("surface_angle_deg=1", "", "`surface_angle_rad` is a reference signal: its values follow from the keys of `stimuli[0]`"),
        ("offset=1", "", "`bias` is a kind of fault"),
        ("sede=9", "run.seed", ""),
    ];
    for (flag, nearest, help) in cases {
        let problems = with(&[flag]).expect_err(flag);
        let first = problems[0].nearest.first().map_or("", String::as_str);
        assert_eq!(first, nearest, "{flag}: {problems:?}");
        let text = problems[0].help.as_deref().unwrap_or_default();
        assert!(text.starts_with(help), "{flag}: {problems:?}");
    }
    let of_pid = |flag: &str| {
        let problems = with(&["controller.law=pid", "derived[1].expression=1", flag]);
        problems.expect_err(flag)[0].nearest.clone()
    };
    let gain = "controller.pid.gain_a_per_m";
    assert_eq!(of_pid("gain_a_per_m=3")[0], gain);
    assert_eq!(of_pid("controller.gain=3")[0], gain);
    assert_eq!(of_pid("controller.parameters.gain=3")[0], gain);
}

#[test]
fn faulty_flags_and_a_faulty_file_are_reported_together() {
    let text = BASE.replace("seed = 7", "seed = -7");
    let problems = parse(&text)
        .expect("TOML")
        .set(&["a", "run.rate_hz=0", "b[0]=1"])
        .checked()
        .expect_err("all wrong");
    assert_eq!(problems.0.len(), 4, "{problems}");
}

#[test]
fn a_flag_appends_an_entry_to_a_list() {
    let fault = |time: &str| {
        format!(
            "faults[+]={{ kind = \"leakage\", at_s = {time}, effects = [{{ actuator = 1, coefficient_m3ps_per_sqrt_pa = 0.0, speed_per_s = 1.0 }}] }}"
        )
    };
    let before = set(&[]).faults.len();
    let actual = set(&[&fault("0.5"), &fault("0.75")]);
    let steps: Vec<_> = (actual.faults.iter().skip(before))
        .map(|event| event.trigger.clone())
        .collect();
    assert_eq!(steps.len(), 2, "{steps:?}");
    assert_ne!(steps[0], steps[1]);
    let problems = with(&["faults[+].at_s=1"]).expect_err("an entry is whole");
    assert!(
        problems[0].message.contains("nothing may follow `[+]`"),
        "{problems:?}"
    );
    let problems = with(&["run[+]=1"]).expect_err("no list");
    assert!(
        problems[0].message.contains("`run` is a table, not a list"),
        "{problems:?}"
    );
}
