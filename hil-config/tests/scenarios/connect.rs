//! `[[connect]]`: a law on a plant whose signals have other names and units.

use hil_config::plan::Plan;
use hil_config::problem::{Problem, ProblemKind, Problems};
use hil_config::scenario::Scenario;
use hil_config::show::show;
use shared_types::describe::{LawDescription, PlantDescription};
use shared_types::layout::SignalKind;
use shared_types::table::Field;

use crate::bad::{Case, assert_found};
use crate::{descriptions, only};

use ProblemKind::{Duplicate, Mismatch, MissingKey, OutOfRange, Unbound, UnknownKey, UnknownName};

const TEXT: &str = r#"schema = 1
name = "slider"

[run]
duration_s = 1.0
rate_hz = 10

[plant]
model = "slider"

[controller]
law = "pid"
made_for = "spring-mass"

[[stimuli]]
target = "goal_mm"
unit = "mm"
kind = "step"
after = 10.0

[[connect]]
law = "measured.position_m"
plant = "measured.s"

[[connect]]
law = "reference.position_m"
plant = "reference.goal_mm"

[[connect]]
law = "command.force_n"
plant = "command.F"
"#;

fn plants() -> Vec<PlantDescription> {
    let mut plants = descriptions::plants();
    let mut slider = plants.remove(1);
    slider.name = "slider".into();
    slider.measured = vec![
        Field::signal("s", "mm", "Way."),
        Field::signal("der__s", "mm/s", "Speed."),
        Field::signal("odd", "turns", "Turns of a screw."),
    ];
    slider.commands = vec![Field::signal("F", "kN", "Force.")];
    plants.push(slider);
    plants
}

fn laws() -> Vec<LawDescription> {
    let mut laws = descriptions::laws();
    let mut both = laws[1].clone();
    both.name = "both".into();
    both.plants = Vec::new();
    both.measured
        .push(Field::signal("velocity_mps", "m/s", "It."));
    both.commands = Some(vec![
        Field::signal("F", "N", "It."),
        Field::signal("G", "N", "It."),
    ]);
    laws.push(both);
    laws
}

fn check(text: &str) -> Result<Plan, Problems> {
    Scenario::parse(text, "slider.toml")?.check(&plants(), &laws(), &descriptions::kinds())
}

fn plan(text: &str) -> Plan {
    check(text).unwrap_or_else(|problems| panic!("{problems}\n{text}"))
}

fn problems(text: &str) -> Vec<Problem> {
    match check(text) {
        Ok(_) => panic!("nothing found wrong in\n{text}"),
        Err(problems) => problems.0,
    }
}

fn connections(plan: &Plan) -> Vec<String> {
    (plan.controller.connections.iter())
        .map(ToString::to_string)
        .collect()
}

#[test]
fn units_determine_the_conversion_in_each_direction() {
    let plan = plan(TEXT);
    assert_eq!(
        connections(&plan),
        [
            "law measured.position_m [m] = 0.001 * plant measured.s [mm]",
            "law reference.position_m [m] = 0.001 * plant reference.goal_mm [mm]",
            "plant command.F [kN] = 0.001 * law command.force_n [N]",
        ]
    );
    assert_eq!(plan.controller.made_for, "spring-mass");
    let law = plan.law_among(&laws()).expect("described");
    assert_eq!(law.measured[0].name, "s");
    assert_eq!(law.measured[0].unit, "mm");
    assert_eq!(law.reference[0].name, "goal_mm");
    assert_eq!(law.commands.expect("its own")[0].name, "F");
}

#[test]
fn an_explicit_factor_overrides_the_units() {
    let text = TEXT.replace(
        "plant = \"measured.s\"",
        "plant = \"measured.odd\"\nfactor = -0.004\noffset = 0.5",
    );
    let plan = plan(&text);
    assert_eq!(
        connections(&plan)[0],
        "law measured.position_m [m] = -0.004 * plant measured.odd [turns] + 0.5"
    );
    assert!(plan.controller.connections[0].is_given);
    assert!(!plan.controller.connections[1].is_given);
}

#[test]
fn shown_connections_mean_the_same() {
    for text in [
        TEXT.to_owned(),
        TEXT.replace(
            "plant = \"measured.s\"",
            "plant = \"measured.odd\"\nfactor = 3",
        ),
    ] {
        let plan = plan(&text);
        let shown_text =
            show(&plan, &plants(), &laws(), &descriptions::kinds()).expect("described");
        assert!(
            shown_text.contains("made_for = \"spring-mass\""),
            "{shown_text}"
        );
        assert!(
            shown_text.contains(
                "\n[[connect]] # plant command.F [kN] = 0.001 * law command.force_n [N]\n"
            ),
            "{shown_text}"
        );
        assert_eq!(check(&shown_text), Ok(plan), "{shown_text}");
    }
}

#[test]
fn connections_of_another_law_take_effect_with_it() {
    // One flag switches the law.
    let scenario = Scenario::parse(TEXT, "slider.toml").expect("TOML");
    let scenario = scenario.set(&["controller.law=hold"]);
    let plan = scenario.check(&plants(), &laws(), &descriptions::kinds());
    let plan = plan.unwrap_or_else(|problems| panic!("{problems}"));
    assert_eq!(plan.controller.connections, []);
}

#[test]
fn a_sensor_may_be_read_under_two_names() {
    let text = TEXT
        .replace(
            "law = \"pid\"\nmade_for = \"spring-mass\"",
            "law = \"both\"",
        )
        .replace("command.force_n", "command.F")
        + "[[connect]]\nlaw = \"measured.velocity_mps\"\nplant = \"measured.s\"\nfactor = 0.0005\n";
    let plan = plan(&text);
    let law = plan.law_among(&laws()).expect("described");
    assert_eq!(law.measured.len(), 1);
    let kinds = plan.controller.connections.iter().map(|one| one.kind);
    assert_eq!(
        kinds.filter(|kind| *kind == SignalKind::Measured).count(),
        2
    );
}

#[rustfmt::skip] // a table reads best with a case on a line
const CASES: &[Case] = &[
    ("made_for = \"spring-mass\"\n", "", Mismatch, &["law `pid` is not made for plant `slider`", "made for `drhas`", "`made_for`"]),
    ("made_for = \"spring-mass\"", "made_for = \"sprin-mass\"", Mismatch, &["law `pid` is not made for plant `sprin-mass`"]),
    ("made_for = \"spring-mass\"", "made_for = 3", ProblemKind::WrongType, &["`controller.made_for` is a number"]),
    ("law = \"measured.position_m\"", "law = \"measured.positon_m\"", UnknownName, &["`measured.positon_m` is not a signal of law `pid`", "nearest: `measured.position_m`"]),
    ("plant = \"measured.s\"", "plant = \"measured.t\"", UnknownName, &["`measured.t` is not a signal of plant `slider`", "one of `measured.s`, `measured.der__s`, `measured.odd`"]),
    ("plant = \"reference.goal_mm\"", "plant = \"reference.gaol_mm\"", UnknownName, &["`reference.gaol_mm` is not a signal of the scenario's [[stimuli]]", "nearest: `reference.goal_mm`"]),
    ("plant = \"measured.s\"", "plant = \"command.F\"", Mismatch, &["a measured signal of the law cannot be a command signal of the plant", "expected: measured.NAME"]),
    ("plant = \"measured.s\"", "plant = \"truth.s\"", OutOfRange, &["`connect[0].plant` is `truth.s`", "measured.NAME, reference.NAME or command.NAME"]),
    ("plant = \"measured.s\"", "plant = \"s\"", OutOfRange, &["`connect[0].plant` is `s`"]),
    ("plant = \"measured.s\"\n", "", MissingKey, &["`connect[0].plant` is missing"]),
    ("plant = \"measured.s\"", "plant = \"measured.der__s\"", Mismatch, &["`der__s` in mm/s and `position_m` in m have different dimensions, m/s and m", "give `factor` and, if needed, `offset`: received = factor * sent + offset"]),
    ("plant = \"measured.s\"", "plant = \"measured.odd\"", Mismatch, &["`odd` in turns and `position_m` in m cannot be converted: `turns` is not a known unit", "give `factor`"]),
    ("plant = \"measured.s\"", "plant = \"measured.s\"\nfactor = 0", OutOfRange, &["a factor of 0 removes the signal"]),
    ("plant = \"measured.s\"", "plant = \"measured.s\"\nfactor = inf", OutOfRange, &["`connect[0].factor`"]),
    ("plant = \"measured.s\"", "plant = \"measured.s\"\noffset = 1", MissingKey, &["an `offset` without a `factor`"]),
    ("plant = \"measured.s\"", "plant = \"measured.s\"\nunit = \"m\"", UnknownKey, &["unknown key `unit` in `connect[0]`"]),
    ("plant = \"command.F\"\n", "plant = \"command.F\"\n[[connect]]\nlaw = \"measured.position_m\"\nplant = \"measured.odd\"\nfactor = 1\n", Duplicate, &["`measured.position_m` of the law is connected twice"]),
    ("[[connect]]\nlaw = \"command.force_n\"\nplant = \"command.F\"\n", "", Unbound, &["plant `slider` needs the command `F` in kN, which law `pid` does not provide", "[[connect]]"]),
];

#[test]
fn each_faulty_connection_is_refused_with_the_expected_value() {
    for (from, to, kind, pieces) in CASES {
        assert_eq!(TEXT.matches(from).count(), 1, "`{from}` stands once");
        let text = TEXT.replacen(from, to, 1);
        let problem = only(problems(&text));
        assert_found(&problem, *kind, pieces);
    }
}

#[test]
fn a_command_may_be_sent_only_once() {
    let two = TEXT
        .replace(
            "law = \"pid\"\nmade_for = \"spring-mass\"",
            "law = \"both\"",
        )
        .replace(
            "[[connect]]\nlaw = \"command.force_n\"\nplant = \"command.F\"\n",
            "[[connect]]\nlaw = \"measured.velocity_mps\"\nplant = \"measured.der__s\"\n",
        );
    let other = "[[connect]]\nlaw = \"command.G\"\nplant = \"command.F\"\n";
    let reported = problems(&(two.clone() + other));
    assert_found(
        &reported[0],
        Duplicate,
        &["law `both` would send the command `F` twice"],
    );
    let one = "[[connect]]\nlaw = \"command.F\"\nplant = \"command.F\"\n";
    let reported = problems(&(two + one + other));
    assert_found(
        &reported[0],
        Duplicate,
        &["`command.F` of the plant is connected twice"],
    );
}

#[test]
fn two_commands_that_are_names_of_one_input_are_refused() {
    let text = TEXT
        .replace(
            "law = \"pid\"\nmade_for = \"spring-mass\"",
            "law = \"both\"",
        )
        .replace(
            "law = \"command.force_n\"\nplant = \"command.F\"",
            "law = \"measured.velocity_mps\"\nplant = \"measured.der__s\"",
        );
    for (input, aliases) in [("F", &["G"][..]), ("push", &["F", "G"])] {
        let mut plants = plants();
        let slider = plants.last_mut().expect("the slider");
        slider.commands = vec![Field {
            aliases: aliases.iter().map(|&alias| alias.into()).collect(),
            ..Field::signal(input, "N", "Force.")
        }];
        let check = |text: &str| {
            let scenario = Scenario::parse(text, "slider.toml").expect("TOML");
            scenario.check(&plants, &laws(), &descriptions::kinds())
        };
        let Err(Problems(problems)) = check(&text) else {
            panic!("one of the commands is lost");
        };
        let both = format!(
            "`command.F` and `command.G` of law `both` are both names of the one input `{input}` of plant `slider`"
        );
        assert_found(&problems[0], Duplicate, &[&both, "[[connect]]"]);
        // A connection chooses.
        if input == "push" {
            let chosen =
                text.clone() + "[[connect]]\nlaw = \"command.G\"\nplant = \"command.push\"\n";
            let plan = check(&chosen).unwrap_or_else(|problems| panic!("{problems}"));
            let commands = plan.controller.connections.iter();
            let commands: Vec<&str> = commands
                .filter(|one| one.kind == SignalKind::Command)
                .map(|one| one.law.as_str())
                .collect();
            assert_eq!(commands, ["G"]);
        }
    }
}
