//! Programs that a scenario names.

use std::path::{Path, PathBuf};

use hil_config::plan::{ControllerProgram, Permissions, Programs};
use hil_config::problem::{Problem, ProblemKind};
use hil_config::scenario::Advice;

use crate::descriptions::{self, Checked};
use crate::{BASE, base_with, only, parse, plan, problems};

/// Returns the base with programs named in both tables.
fn naming(plant: &str, controller: &str) -> String {
    let text = base_with("substeps = 2", &format!("substeps = 2\nprogram = {plant}"));
    let law = "law = \"ftsc\"";
    text.replacen(law, &format!("{law}\nprogram = {controller}"), 1)
}

/// Returns a path from the folder of the scenario, as the tests name it.
fn beside(path: &str) -> PathBuf {
    std::path::absolute(Path::new("folder").join(path)).expect("a folder")
}

#[test]
fn a_program_is_relative_to_the_folder_of_the_scenario() {
    let text = naming("\"target/plant\"", "\"/opt/laws\"");
    let programs = Programs {
        plant: Some(beside("target/plant")),
        controller: Some(ControllerProgram::One("/opt/laws".into())),
        ..Programs::default()
    };
    assert_eq!(parse(&text).expect("TOML").programs(), programs);
    assert_eq!(plan(&text).programs, programs);
    assert_eq!(plan(BASE).programs, Programs::default());
}

#[test]
fn internal_signals_of_a_plant_are_selected_by_patterns() {
    let with =
        |locals: &str| base_with("substeps = 2", &format!("substeps = 2\nlocals = {locals}"));
    let plan = plan(&with("[\"der(*)\", \"x?\"]"));
    assert_eq!(plan.programs.locals, ["der(*)", "x?"]);
    for wrong in ["[]", "\"x\"", "[1]"] {
        let reported = problems(&with(wrong));
        assert!(
            reported
                .iter()
                .any(|one| one.key.starts_with("plant.locals")),
            "{wrong}: {reported:?}"
        );
    }
}

#[test]
fn permissions_of_an_fmu_are_read_for_each_side_and_shown_again() {
    let text = base_with(
        "substeps = 2",
        "substeps = 2\ntrust_archive = true\nallow_execution_tool = false",
    );
    let law = "law = \"ftsc\"";
    let text = text.replacen(law, &format!("{law}\nallow_execution_tool = true"), 1);
    let plan = plan(&text);
    let [archive, tool] = [true, false].map(|trust_archive| Permissions {
        trust_archive,
        allow_execution_tool: !trust_archive,
    });
    assert_eq!(plan.programs.plant_permissions, archive);
    assert_eq!(plan.programs.controller_permissions, tool);
    let shown_text = descriptions::shown(&plan);
    assert_eq!(
        crate::plan(&shown_text).programs,
        plan.programs,
        "{shown_text}"
    );
    for wrong in ["1", "\"true\"", "[true]"] {
        let text = base_with(
            "substeps = 2",
            &format!("substeps = 2\ntrust_archive = {wrong}"),
        );
        let Problem { key, kind, .. } = only(problems(&text));
        assert_eq!(
            (&*key, kind),
            ("plant.trust_archive", ProblemKind::WrongType)
        );
    }
}

#[test]
fn a_controller_may_have_a_program_for_each_type_of_machine() {
    let table = "{ x86_64 = \"host/law\", aarch64 = \"target/law\" }";
    let program = plan(&naming("\"plant\"", table)).programs.controller;
    let program = program.expect("it is named");
    assert_eq!(program.for_machine("x86_64"), Some(&*beside("host/law")));
    assert_eq!(program.for_machine("aarch64"), Some(&*beside("target/law")));
    assert_eq!(program.for_machine("riscv64"), None);
    let one = ControllerProgram::One("/a".into());
    assert_eq!(one.for_machine("riscv64"), Some(Path::new("/a")));
}

#[test]
fn an_invalid_program_is_refused_at_its_place() {
    #[rustfmt::skip] // a table
    let cases = [
        ("3", "\"a\"", "plant.program", ProblemKind::WrongType),
        ("{ x86_64 = \"a\" }", "\"a\"", "plant.program", ProblemKind::WrongType),
        ("\"\"", "\"a\"", "plant.program", ProblemKind::OutOfRange),
        ("\"a\\u0007\"", "\"a\"", "plant.program", ProblemKind::OutOfRange),
        ("\"a\"", "[\"a\"]", "controller.program", ProblemKind::WrongType),
        ("\"a\"", "{ x86_64 = 1 }", "controller.program.x86_64", ProblemKind::WrongType),
    ];
    for (plant, controller, key, kind) in cases {
        let text = naming(plant, controller);
        let reported = only(problems(&text));
        assert_eq!((reported.key.as_str(), reported.kind), (key, kind));
        // Before the check a faulty one counts as missing.
        let programs = parse(&text).expect("TOML").programs();
        assert!(programs.plant.is_none() || programs.controller.is_none());
    }
}

#[test]
fn programs_are_shown_with_their_whole_path() {
    let table = "{ x86_64 = \"host/law\", aarch64 = \"target/law\" }";
    for controller in ["\"laws/one\"", table] {
        let plan = plan(&naming("\"target/plant\"", controller));
        let text = descriptions::shown(&plan);
        let again = crate::plan(&text);
        assert_eq!(again.programs, plan.programs, "{text}");
    }
}

#[test]
fn an_unknown_name_is_reported_with_exactly_the_given_advice() {
    let text =
        base_with("model = \"drhas\"", "model = \"x\"").replace("law = \"ftsc\"", "law = \"y\"");
    let help = |advice: Advice| {
        let scenario = parse(&text).expect("TOML").advise(advice);
        let problems = scenario.checked().expect_err("neither is known").0;
        ["plant.model", "controller.law"].map(|key| {
            let problem = problems.iter().find(|one| one.key == key);
            problem.expect("it is told").help.clone()
        })
    };
    let advice = Advice {
        plant: "of plants".into(),
        law: "of laws".into(),
    };
    assert_eq!(
        help(advice),
        [Some("of plants".into()), Some("of laws".into())]
    );
    assert_eq!(help(Advice::default()), [None, None]);
}
