//! Inputs of the plant that no law commands: `[plant.inputs]`, and stimuli for `plant.X`.

use hil_config::live_requests::RequestContext;
use hil_config::plan::{Plan, driven};
use hil_config::problem::{Problem, Problems};
use hil_config::scenario::Scenario;
use hil_config::show::show;
use shared_types::describe::PlantDescription;
use shared_types::live::{ChangeRequest, NewValue};
use shared_types::table::Field;

use crate::descriptions;

const BASE: &str = r#"schema = 1
name = "inputs"
[run]
duration_s = 2.0
rate_hz = 100
[plant]
model = "spring-mass"
[plant.inputs]
ambient_k = 280.0
[controller]
law = "pid"
[[stimuli]]
target = "position_m"
kind = "step"
after = 1.0
[[stimuli]]
target = "plant.wind_mps"
kind = "ramp"
duration_s = 1.0
end = 5.0
"#;

/// Returns the plant of the tests, whose law gives one of three commands.
fn plants() -> Vec<PlantDescription> {
    let mut plant = descriptions::plants().remove(1);
    assert_eq!(plant.name, "spring-mass");
    plant.commands.push(Field {
        default: Some(293.15),
        min: 200.0,
        max: 400.0,
        aliases: vec!["room_k".into()],
        ..Field::signal("ambient_k", "K", "Ambient temperature.")
    });
    (plant.commands).push(Field::signal("wind_mps", "m/s", "Wind."));
    vec![plant]
}

fn check(text: &str) -> Result<Plan, Problems> {
    let scenario = Scenario::parse(text, "folder/inputs.toml")?;
    scenario.check(&plants(), &descriptions::laws(), &descriptions::kinds())
}

fn plan(text: &str) -> Plan {
    check(text).unwrap_or_else(|problems| panic!("{problems}\n{text}"))
}

fn problems(text: &str) -> Vec<Problem> {
    match check(text) {
        Ok(_) => panic!("nothing is wrong in\n{text}"),
        Err(problems) => problems.0,
    }
}

/// Returns the base with one piece of text replaced.
fn with(from: &str, to: &str) -> String {
    assert_eq!(BASE.matches(from).count(), 1, "`{from}` stands once");
    BASE.replacen(from, to, 1)
}

#[test]
fn driven_inputs_are_neither_commands_nor_references() {
    let plan = plan(BASE);
    assert_eq!(plan.plant.inputs.get("ambient_k"), Some(280.0));
    let names = |fields: &[Field]| {
        fields
            .iter()
            .map(|field| field.name.clone())
            .collect::<Vec<_>>()
    };
    assert_eq!(names(&plan.reference()), ["position_m"; 1]);
    assert_eq!(names(&driven(&plan.stimuli)), ["wind_mps"]);
    let plant = plan.plant_among(&plants()).expect("it is there");
    assert_eq!(names(&plant.commands), ["force_n"]);
    assert!(plan.plant.safe_command.get("ambient_k").is_none());
    let law = plan.law_among(&descriptions::laws()).expect("it is there");
    let layout = plan.record_layout(&plant, &law);
    assert_eq!(
        (names(&layout.command), names(&layout.input)),
        (names(&plant.commands), vec!["wind_mps".to_owned()])
    );
}

#[test]
fn an_input_without_a_source_is_refused_with_the_lines_to_paste() {
    let without = with("[plant.inputs]\nambient_k = 280.0\n", "");
    let without = without.replace("target = \"plant.wind_mps\"", "target = \"other_mps\"");
    let problems = problems(&without);
    let messages: Vec<&str> = problems.iter().map(|one| one.message.as_str()).collect();
    assert_eq!(
        messages,
        [
            "plant `spring-mass` needs the command `ambient_k` in K, which law `pid` does not provide",
            "plant `spring-mass` needs the command `wind_mps` in m/s, which law `pid` does not provide",
        ]
    );
    let help = problems[0].help.as_deref().expect("advice");
    let lines = "[plant.inputs]\nambient_k = \"start\"\nwind_mps = 0.0\n";
    assert!(help.contains(lines), "{help}");
    assert!(
        help.contains("[[stimuli]] with target = \"plant.ambient_k\""),
        "{help}"
    );
    assert!(
        problems[0]
            .to_string()
            .contains("\n    ambient_k = \"start\"\n"),
        "{}",
        problems[0]
    );
    // The lines are what is missing.
    let pasted = format!("{without}{lines}");
    assert_eq!(plan(&pasted).plant.inputs.get("ambient_k"), Some(293.15));
    // With a table they belong into that one.
    let help = self::problems(&with("\"plant.wind_mps\"", "\"other_mps\""))[0]
        .help
        .clone();
    let help = help.expect("advice");
    assert!(
        help.contains("paste into [plant.inputs]\nwind_mps = 0.0\n"),
        "{help}"
    );
}

#[test]
fn a_constant_can_be_the_declared_start_and_be_named_by_an_alias() {
    for value in ["ambient_k = \"start\"", "room_k = \"start\""] {
        let plan = plan(&with("ambient_k = 280.0", value));
        assert_eq!(plan.plant.inputs.get("ambient_k"), Some(293.15));
    }
}

#[test]
fn every_faulty_input_is_refused_with_its_reason() {
    let stimulus = "[[stimuli]]\ntarget = \"plant.wind_mps\"";
    for (text, messages) in [
        (
            with("ambient_k = 280.0", "ambient_k = 500.0"),
            &["`plant.inputs.ambient_k` is 500, out of range"][..],
        ),
        (
            with("ambient_k = 280.0", "ambient_k = \"warm\""),
            &["`plant.inputs.ambient_k`"],
        ),
        (
            with(
                "ambient_k = 280.0",
                "ambient_k = 280.0\nwind_mps = \"start\"",
            )
            .replace("plant.wind_mps", "other_mps"),
            &[
                "`plant.inputs.wind_mps` is \"start\", but plant `spring-mass` declares no start for `wind_mps`",
            ],
        ),
        (
            with("ambient_k = 280.0", "ambient_k = 280.0\nrain = 1.0"),
            &["plant `spring-mass` has no input `rain`"],
        ),
        (
            with("\"plant.wind_mps\"", "\"plant.win_mps\""),
            &[
                "plant `spring-mass` has no input `win_mps`",
                "needs the command `wind_mps`",
            ],
        ),
        (
            with("ambient_k = 280.0", "ambient_k = 280.0\nwind_mps = 1.0"),
            &[
                "`stimuli[1].target` drives the input `wind_mps`, and so does `plant.inputs.wind_mps`",
            ],
        ),
        (
            with(
                stimulus,
                "[[stimuli]]\ntarget = \"plant.wind_mps\"\nunit = \"km/h\"",
            ),
            &[
                "`stimuli[1].unit` is km/h, but plant `spring-mass` takes the input `wind_mps` in m/s",
            ],
        ),
        (
            with("ambient_k = 280.0", "ambient_k = 280.0\nforce_n = 1.0"),
            &[
                "`plant.inputs.force_n` drives the input `force_n`, and law `pid` of `controller.law` commands it as `command.force_n`",
            ],
        ),
        (
            with("\"plant.wind_mps\"", "\"plant.force_n\"")
                .replace("280.0", "280.0\nwind_mps = 0.0"),
            &[
                "`stimuli[1].target` drives the input `force_n`, and law `pid` of `controller.law` commands it as `command.force_n`",
            ],
        ),
        (
            BASE.to_owned()
                + "[[connect]]\nlaw = \"command.force_n\"\nplant = \"command.wind_mps\"\nfactor = 2.0\n",
            &["`connect[0].plant` binds the input `wind_mps`, which `stimuli[1].target` drives"],
        ),
        (
            BASE.to_owned() + "[[actuators]]\nsignal = \"wind_mps\"\nbits = 8\nrange = [-1, 1]\n",
            &["no law commands `wind_mps`, so it has no actuator"],
        ),
        (
            BASE.to_owned()
                + "[[faults]]\nkind = \"bias\"\nat_s = 1\n[[faults.effects]]\ntarget = \"input.ambient_k\"\nbias = 1.0\n",
            &["no stimulus drives the input `ambient_k` of plant `spring-mass`"],
        ),
        (
            BASE.to_owned() + "[[derived]]\nname = \"x_k\"\nexpression = \"input.ambient_k\"\n",
            &["input.ambient_k"],
        ),
    ] {
        let reported = problems(&text);
        for message in messages {
            let is_one = reported.iter().any(|one| one.message.contains(message));
            assert!(is_one, "`{message}` in {reported:#?}");
        }
    }
}

#[test]
fn faults_changes_and_expressions_know_a_driven_input() {
    let text = BASE.to_owned()
        + "[[faults]]\nkind = \"bias\"\nat_s = 1\n[[faults.effects]]\ntarget = \"input.wind_mps\"\nbias = 1.0\n\
           [[changes]]\nat_s = 0.5\nset = { input.wind_mps = 2.0 }\n\
           [[requirements]]\nname = \"calm\"\nformula = \"always (input.wind_mps < 10)\"\n";
    let plan = plan(&text);
    assert_eq!(plan.faults[0].effects[0].target, "input.wind_mps");
    assert_eq!(plan.changes[0].set[0].key, "input.wind_mps");
    // A request in the run is checked by the same code.
    let plant = plan.plant_among(&plants()).expect("it is there");
    let context = RequestContext::of(&plan, &plant, &descriptions::kinds());
    let fault = "[[faults]]\nkind = \"bias\"\n[[faults.effects]]\ntarget = \"input.wind_mps\"\nbias = 1.0\n";
    assert!(context.check(fault, &[]).is_ok());
    let change = |clear: &[&str], set: &[&str]| ChangeRequest {
        at_s: None,
        ramp_s: None,
        set: (set.iter())
            .map(|key| NewValue {
                key: (*key).into(),
                value: 3.0,
            })
            .collect(),
        clear: clear.iter().map(|key| (*key).into()).collect(),
    };
    let check = |request| context.check_change(&request, ("pid", &[]), 1);
    assert!(check(change(&[], &["input.wind_mps"])).is_ok());
    assert!(check(change(&["input.wind_mps"], &[])).is_ok());
    assert!(check(change(&[], &["input.ambient_k"])).is_err());
}

#[test]
fn a_constant_input_is_refused_with_the_stimulus_that_would_do() {
    let lines = "in place of `ambient_k` under [plant.inputs] write\n[[stimuli]]\ntarget = \"plant.ambient_k\"\nkind = \"step\"\nafter = 280";
    for target in [
        "input.ambient_k",
        "plant.ambient_k",
        "plant.inputs.ambient_k",
        "command.ambient_k",
    ] {
        let fault = format!(
            "[[faults]]\nkind = \"bias\"\nat_s = 1\n[[faults.effects]]\ntarget = \"{target}\"\nbias = 1.0\n"
        );
        let change = format!("[[changes]]\nat_s = 0.5\n[changes.set]\n{target} = 300.0\n");
        for more in [fault, change] {
            let reported = problems(&format!("{BASE}{more}"));
            let help = reported[0].help.as_deref().unwrap_or_default();
            assert!(help.contains(lines), "{target}: {}", reported[0]);
        }
    }
    // The text of the message does what it says.
    let pasted = with("[plant.inputs]\nambient_k = 280.0\n", "")
        + "[[stimuli]]\ntarget = \"plant.ambient_k\"\nkind = \"step\"\nafter = 280\n\
         [[changes]]\nat_s = 0.5\n[changes.set]\ninput.ambient_k = 300.0\n";
    assert_eq!(plan(&pasted).changes[0].set[0].value, 300.0);
}

#[test]
fn an_input_with_a_course_is_named_where_its_target_is_used_as_its_name() {
    for name in [
        "plant.wind_mps",
        "command.wind_mps",
        "plant.inputs.wind_mps",
    ] {
        let text = format!("{BASE}[[changes]]\nat_s = 0.5\n[changes.set]\n{name} = 3.0\n");
        let reported = problems(&text);
        let text = reported[0].to_string();
        assert!(
            text.contains("during a run this input of the plant is `input.wind_mps`"),
            "{text}"
        );
    }
}

#[test]
fn a_change_of_an_input_stays_in_the_range_of_the_plant() {
    let driven = with("[plant.inputs]\nambient_k = 280.0\n", "")
        + "[[stimuli]]\ntarget = \"plant.ambient_k\"\nkind = \"step\"\nafter = 280\n";
    let with_change = |value: &str| {
        format!("{driven}[[changes]]\nat_s = 0.5\n[changes.set]\ninput.ambient_k = {value}\n")
    };
    for value in ["200.0", "400.0"] {
        plan(&with_change(value));
    }
    for value in ["199.9", "400.1", "inf"] {
        let reported = problems(&with_change(value));
        let text = reported[0].to_string();
        assert!(text.contains("200 to 400"), "{text}");
    }
    let plan = plan(&driven);
    let plant = plan.plant_among(&plants()).expect("it is there");
    let context = RequestContext::of(&plan, &plant, &descriptions::kinds());
    let request = ChangeRequest {
        at_s: None,
        ramp_s: Some(1.0),
        set: vec![NewValue {
            key: "input.ambient_k".into(),
            value: 500.0,
        }],
        clear: Vec::new(),
    };
    let refused = context.check_change(&request, ("pid", &[]), 1);
    let text = refused.expect_err("out of range").to_string();
    assert!(text.contains("out of range"), "{text}");
}

#[test]
fn a_shown_plan_has_its_inputs() {
    let text = BASE.to_owned()
        + "[[stimuli]]\ntarget = \"other_m\"\nkind = \"square\"\namplitude = 1.0\nfrequency_hz = 2.0\nduty = 0.25\n";
    let plan = plan(&text);
    let text_of_plan = show(
        &plan,
        &plants(),
        &descriptions::laws(),
        &descriptions::kinds(),
    );
    let text_of_plan = text_of_plan.expect("described");
    assert!(
        text_of_plan.contains("[plant.inputs]\nambient_k = 280.0 # K"),
        "{text_of_plan}"
    );
    assert!(
        text_of_plan.contains("target = \"plant.wind_mps\""),
        "{text_of_plan}"
    );
    assert_eq!(self::plan(&text_of_plan), plan, "{text_of_plan}");
}

/// Checks a text against a plant whose wind and ambient temperature are whole numbers.
fn checked_whole(text: &str) -> Result<Plan, Problems> {
    let mut plants = plants();
    for field in plants.iter_mut().flat_map(|plant| &mut plant.commands) {
        field.is_whole = field.name != "force_n";
    }
    let scenario = Scenario::parse(text, "folder/inputs.toml")?;
    scenario.check(&plants, &descriptions::laws(), &descriptions::kinds())
}

#[test]
fn fractions_for_an_input_of_whole_numbers_are_refused_before_the_run() {
    let course = "kind = \"ramp\"\nduration_s = 1.0\nend = 5.0\n";
    let held = "kind = \"table\"\ntime_s = [0, 1]\nvalues = [2, 4]\ninterpolation = \"hold\"\n";
    let whole = with(course, held);
    let change = |text: &str| format!("{whole}[[changes]]\nat_s = 0.5\n{text}\n");
    checked_whole(&whole).expect("whole numbers");
    checked_whole(&change("set = { input.wind_mps = 3.0 }")).expect("a whole number");
    let text = checked_whole(&with("end = 5.0", "end = 0.0")).map(|_| ());
    text.expect("a ramp that stays where it is");
    for (text, message) in [
        (
            BASE.to_owned(),
            "`stimuli[1]`: `plant.wind_mps` takes whole numbers only, but is 0.05 at 0.01 s",
        ),
        (
            whole.replace("interpolation = \"hold\"", "interpolation = \"linear\""),
            "takes whole numbers only, but is 2.02 at 0.01 s",
        ),
        (
            whole.replace("280.0", "280.5"),
            "`plant.inputs.ambient_k` is 280.5, not a whole number",
        ),
        (
            change("set = { input.wind_mps = 0.4 }"),
            "`changes[0].set.input.wind_mps` is 0.4, not a whole number",
        ),
        (
            change("ramp_s = 0.1\nset = { input.wind_mps = 3.0 }"),
            "`input.wind_mps` takes whole numbers only, so it cannot change along a ramp",
        ),
    ] {
        let problems = checked_whole(&text).expect_err(message);
        let messages: Vec<&str> = problems.0.iter().map(|one| &*one.message).collect();
        assert!(
            messages.iter().any(|one| one.contains(message)),
            "{message}: {messages:#?}"
        );
    }
}

#[test]
fn a_change_of_an_instrument_in_the_run_is_refused_with_the_fault_that_does_the_same() {
    let plan = plan(BASE);
    let plant = plan.plant_among(&plants()).expect("it is there");
    let context = RequestContext::of(&plan, &plant, &descriptions::kinds());
    for (key, group) in [
        ("sensors[0].bits", "measured"),
        ("sensor.position_m", "measured"),
        ("sensed.position_m", "measured"),
        ("actuators[0].lag_hz", "command"),
    ] {
        let request = ChangeRequest {
            set: vec![NewValue {
                key: key.into(),
                value: 4.0,
            }],
            ..ChangeRequest::default()
        };
        let problems = context.check_change(&request, ("pid", &[]), 1);
        let problem = &problems.expect_err("an instrument").0[0];
        let message = format!("`{key}` cannot be changed during the run");
        assert_eq!(problem.message, message);
        let help = problem.help.as_deref().expect("advice");
        assert!(
            help.contains(&format!("hil inject KIND {group}.SIGNAL")),
            "{help}"
        );
    }
}

#[test]
fn a_reference_signal_with_dots_is_driven_under_its_name() {
    let mut laws = descriptions::laws();
    for law in laws.iter_mut().filter(|law| law.name == "pid") {
        (law.reference).push(Field::signal("rig.a.x", "1", "Set point."));
    }
    let check = |target: &str| {
        let text =
            format!("{BASE}[[stimuli]]\ntarget = \"{target}\"\nkind = \"step\"\nafter = 1.0\n");
        let scenario = Scenario::parse(&text, "folder/inputs.toml").expect("TOML");
        scenario.check(&plants(), &laws, &descriptions::kinds())
    };
    let plan = check("rig.a.x").expect("a reference signal");
    assert_eq!(plan.stimuli[2].key(), "reference.rig.a.x");
    let problems = check("rig.a.y").expect_err("unknown").to_string();
    assert!(problems.contains("nearest: `rig.a.x`"), "{problems}");
}
