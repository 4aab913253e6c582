use super::*;

fn model(name: &str) -> ModelDescription {
    let folder = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../tests/third-party/reference-fmus/"
    );
    let text = std::fs::read_to_string(format!("{folder}{name}.xml")).expect("it is vendored");
    ModelDescription::read(&text).expect("sound")
}

fn tables(model: &ModelDescription, patterns: &[&str]) -> Result<Tables, Invalid> {
    let pattern = |text: &&str| Pattern::new(text).expect("a pattern");
    Tables::of(model, &patterns.iter().map(pattern).collect::<Vec<_>>())
}

fn names(columns: &[Column]) -> Vec<&str> {
    columns
        .iter()
        .map(|column| column.field.name.as_str())
        .collect()
}

#[test]
fn every_variable_has_a_column_or_a_reason_for_none() {
    let tables = tables(&model("BouncingBall/FMI3"), &[]).expect("sound");
    assert_eq!(names(&tables.parameters), ["g", "e"]);
    assert_eq!(names(&tables.outputs), ["h", "v"]);
    assert_eq!(tables.outputs[0].field.aliases, ["h_ft"]);
    assert_eq!(tables.imported.locals, ["der__h", "der__v", "v_min"]);
    assert_eq!(tables.locals, []);
    let tunable = &tables.parameters[1].field;
    assert_eq!(
        (tunable.default, tunable.min, tunable.max),
        (Some(0.7), 0.5, 1.0)
    );
    assert!(tunable.faultable && !tables.parameters[0].field.faultable);
    assert_eq!(tables.outputs[1].field.unit, "m/s");
    assert_eq!(tables.imported.units[1].base, "m s-1");
    assert_eq!(tables.imported.left_out, []);
}

#[test]
fn local_signals_become_truth_on_request_by_either_name() {
    let model = model("BouncingBall/FMI3");
    let request = |patterns: &[&str]| {
        let tables = tables(&model, patterns)?;
        Ok::<_, Invalid>(names(&tables.locals).join(" "))
    };
    assert_eq!(request(&["der(*)"]).as_deref(), Ok("der__h der__v"));
    assert_eq!(request(&["der__v", "v_*"]).as_deref(), Ok("der__v v_min"));
    let message = request(&["der(*)", "h"]).expect_err("an output").0;
    assert!(
        message.contains("no inner signal of the FMU matches \"h\""),
        "{message}"
    );
}

#[test]
fn arrays_are_flattened_and_depend_on_all_inputs_by_default() {
    let tables = tables(&model("StateSpace/FMI3"), &[]).expect("sound");
    assert_eq!(names(&tables.inputs), ["u__1", "u__2", "u__3"]);
    assert_eq!(tables.parameters.len(), 9 * 4 + 3);
    assert_eq!(tables.parameters[5].field.name, "A__2_3");
    assert_eq!(tables.imported.direct.len(), 3);
    assert_eq!(tables.imported.direct[0].inputs, ["u__1", "u__2", "u__3"]);
    assert_eq!(tables.imported.left_out.len(), 3, "m, n and r");
}

#[test]
fn direct_dependencies_follow_the_model_structure() {
    let tables = tables(&model("Feedthrough/FMI3"), &[]).expect("sound");
    let direct = &tables.imported.direct;
    assert_eq!(direct.len(), tables.outputs.len());
    assert!(direct.iter().all(|one| one.inputs.len() == 1));
    let whole = direct
        .iter()
        .find(|one| one.output == "Int32_output")
        .expect("there");
    assert_eq!(whole.inputs, ["Int32_input"]);
    let actual: Vec<_> = tables
        .imported
        .left_out
        .iter()
        .map(|one| one.name.as_str())
        .collect();
    assert_eq!(
        actual,
        [
            "String_input",
            "String_output",
            "Binary_input",
            "Binary_output"
        ]
    );
    let small = tables
        .inputs
        .iter()
        .find(|one| one.field.name == "Int8_input")
        .expect("there");
    assert_eq!((small.field.min, small.field.max), (-128.0, 127.0));
}

#[test]
fn names_that_collide_in_a_recording_are_refused() {
    let mut model = model("BouncingBall/FMI3");
    let mut other = model.variables[1].clone();
    "h.x".clone_into(&mut model.variables[1].name);
    "h_x".clone_into(&mut other.name);
    other.reference = 100;
    model.variables.push(other);
    let message = tables(&model, &[]).expect_err("alike").0;
    assert!(
        message.contains("\"h.x\"") && message.contains("\"h_x\""),
        "{message}"
    );
}

#[test]
fn variables_beyond_the_frame_size_are_left_out_and_listed() {
    let mut model = model("StateSpace/FMI3");
    let output = model
        .variables
        .iter()
        .position(|one| one.name == "y")
        .expect("there");
    let mut many = model.variables[output].clone();
    "z".clone_into(&mut many.name);
    many.dimensions = vec![MAX_SIGNALS - 2];
    model.variables.push(many);
    let tables = tables(&model, &[]).expect("sound");
    assert_eq!(names(&tables.outputs), ["y__1", "y__2", "y__3"]);
    let entry = tables.imported.left_out.last().expect("one");
    assert_eq!(entry.name, "z");
    assert!(
        entry.reason.contains("exceeds the limit of 512"),
        "{}",
        entry.reason
    );
}

#[test]
fn inputs_with_the_reference_prefix_become_reference_signals() {
    let mut model = model("StateSpace/FMI3");
    let input = model
        .variables
        .iter_mut()
        .find(|one| one.name == "u")
        .expect("there");
    input.dimensions.clear();
    input.start.truncate(1);
    "reference.angle_rad".clone_into(&mut input.name);
    let mut other = input.clone();
    "reference".clone_into(&mut other.name);
    other.reference = 100;
    model.variables.push(other);
    let (measured, reference) = tables(&model, &[]).expect("sound").split_inputs();
    let of = |fields: &[Field]| {
        fields
            .iter()
            .map(|one| one.name.clone())
            .collect::<Vec<_>>()
    };
    assert_eq!(of(&measured), ["reference"]);
    assert_eq!(of(&reference), ["angle_rad"]);
}

/// Adds a variable that resembles an existing one.
fn add(model: &mut ModelDescription, like: &str, name: &str, causality: Causality) {
    let mut variables = model.variables.iter();
    let like = variables.find(|one| one.name == like).expect("there");
    let added = Variable {
        name: name.into(),
        causality,
        ..like.clone()
    };
    model.variables.push(added);
}

fn aliases(columns: &[Column]) -> Vec<String> {
    let text = |column: &Column| {
        [
            std::slice::from_ref(&column.field.name),
            &column.field.aliases[..],
        ]
        .concat()
    };
    columns.iter().map(|one| text(one).join(" = ")).collect()
}

#[test]
fn a_value_with_several_names_has_one_column() {
    let mut model = model("BouncingBall/FMI3");
    add(&mut model, "g", "world.g", Causality::Parameter);
    add(&mut model, "g", "ball.g", Causality::Local);
    add(&mut model, "h", "ball.h", Causality::Local);
    add(&mut model, "v_min", "floor.v", Causality::Local);
    add(&mut model, "der(h)", "speed", Causality::Output);
    let bounce = tables(&model, &["floor.*"]).expect("sound");
    assert_eq!(aliases(&bounce.parameters), ["g = world.g = ball.g", "e"]);
    assert_eq!(
        aliases(&bounce.outputs),
        ["h = h_ft = ball.h", "v", "speed = der__h"]
    );
    assert_eq!(aliases(&bounce.locals), ["v_min = floor.v"]);
    // The pattern matches an alias of an output, which is available anyway.
    let outputs = tables(&model, &["ball.h"]).expect("sound");
    assert_eq!(names(&outputs.locals), [""; 0]);
}

#[test]
fn every_name_of_an_unusable_value_is_listed() {
    let mut model = model("BouncingBall/FMI3");
    for name in ["clocked", "clocked_too"] {
        add(&mut model, "v_min", name, Causality::Output);
        let added = model.variables.last_mut().expect("added");
        (added.reference, added.is_clocked) = (100, true);
    }
    let tables = tables(&model, &[]).expect("sound");
    let left_out = tables.imported.left_out.iter();
    let left_out: Vec<[&str; 2]> = left_out
        .map(|one| [one.name.as_str(), one.reason.as_str()])
        .collect();
    let reason = "it has a clock";
    assert_eq!(left_out, [["clocked", reason], ["clocked_too", reason]]);
}

#[test]
fn a_parameter_with_two_units_is_set_in_one_of_them() {
    let mut model = model("BouncingBall/FMI3");
    add(&mut model, "g", "g_ft", Causality::Parameter);
    let added = model.variables.last_mut().expect("added");
    added.unit = Some("ft/s2".into());
    let tables = tables(&model, &[]).expect("sound");
    assert_eq!(names(&tables.parameters), ["g", "e"]);
    let entry = &tables.imported.left_out[0];
    assert_eq!(entry.name, "g_ft");
    assert!(entry.reason.contains("alias of \"g\""), "{}", entry.reason);
}

/// Returns the model with one more variable, derived from its second one.
fn with(change: impl FnOnce(&mut Variable)) -> ModelDescription {
    let mut model = model("BouncingBall/FMI3");
    let mut other = model.variables[1].clone();
    other.causality = Causality::Parameter;
    other.reference = 100;
    change(&mut other);
    model.variables.push(other);
    model
}

#[test]
fn a_constant_parameter_is_left_out_and_listed() {
    for is_constant in [true, false] {
        let model = with(|other| {
            (other.name, other.start) = ("c".into(), vec![2.0]);
            other.is_constant = is_constant;
        });
        let tables = tables(&model, &[]).expect("sound");
        let left_out = tables.imported.left_out.iter();
        let reasons: Vec<&str> = left_out.map(|one| one.reason.as_str()).collect();
        let reason = "it is constant and keeps its start value";
        let (parameters, expected) = match is_constant {
            true => (&["g", "e"][..], &[reason][..]),
            false => (&["g", "e", "c"][..], &[][..]),
        };
        assert_eq!(names(&tables.parameters), parameters);
        assert_eq!(reasons, expected);
    }
}

#[test]
fn a_variable_whose_name_is_too_long_is_left_out_and_listed() {
    for causality in [
        Causality::Local,
        Causality::Output,
        Causality::Input,
        Causality::Parameter,
    ] {
        let model = with(|other| {
            other.name = "v".repeat(300);
            other.start = vec![0.0];
            other.causality = causality;
        });
        let tables = tables(&model, &["*"]).expect("sound");
        let [left_out] = &tables.imported.left_out[..] else {
            panic!("{:?}", tables.imported.left_out)
        };
        assert!(
            left_out.reason.contains("has 300 bytes"),
            "{}",
            left_out.reason
        );
        let keeps = matches!(causality, Causality::Input | Causality::Parameter);
        assert_eq!(left_out.reason.contains("keeps its start value"), keeps);
    }
}

#[test]
fn requesting_all_local_signals_may_give_none() {
    let mut model = model("StateSpace/FMI3");
    model.variables.retain(|one| !one.is_inner());
    assert_eq!(tables(&model, &["*"]).expect("sound").locals, []);
    tables(&model, &["x*"]).expect_err("none begins so");
}

#[test]
fn an_invalid_start_value_is_not_a_default_and_is_reported() {
    let parameter = |model: &ModelDescription| {
        let tables = tables(model, &[]).expect("sound");
        tables.parameters.last().expect("there").field.clone()
    };
    let model = with(|other| {
        other.name = "p".into();
        (other.min, other.max, other.start) = (Some(0.0), Some(5.0), vec![7.0]);
    });
    let field = parameter(&model);
    assert_eq!((field.default, field.min, field.max), (None, 0.0, 5.0));
    assert!(
        field.description.contains("start value in the FMU, 7"),
        "{}",
        field.description
    );
    let items = |start: f64| {
        parameter(&with(|other| {
            other.name = "p".into();
            other.kind = VariableType::Enumeration;
            (other.min, other.max) = (Some(1.0), Some(5.0));
            (other.items, other.start) = (vec![1.0, 2.0, 5.0], vec![start]);
        }))
    };
    assert_eq!(items(5.0).default, Some(5.0));
    assert!(items(5.0).description.ends_with("One of 1, 2, 5."));
    assert_eq!(items(4.0).default, None);
    // A range with its ends in the wrong order is ignored.
    let model = with(|other| {
        other.name = "p".into();
        (other.min, other.max, other.start) = (Some(5.0), Some(0.0), vec![7.0]);
    });
    assert_eq!(parameter(&model).default, Some(7.0));
}

#[test]
fn a_variable_without_a_description_is_described_by_its_role() {
    let model = with(|other| {
        other.name = "p".into();
        other.description.clear();
        other.start = vec![1.0];
        other.is_tunable = true;
    });
    let tables = tables(&model, &[]).expect("sound");
    let text = &tables.parameters.last().expect("there").field.description;
    assert_eq!(text, "Tunable parameter, not described in the FMU.");
}
