use super::*;

/// Builds a document of FMI 3 with this content.
fn three(inside: &str) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"3.0\" modelName=\"m\" instantiationToken=\"t\"><CoSimulation modelIdentifier=\"m\"/>{inside}</fmiModelDescription>"
    )
}

fn read(inside: &str) -> Result<ModelDescription, DescriptionError> {
    ModelDescription::read(&three(inside))
}

fn refused(text: &str, fragment: &str) {
    let message = ModelDescription::read(text)
        .expect_err(fragment)
        .to_string();
    assert!(message.contains(fragment), "{message}");
}

fn reference(name: &str) -> ModelDescription {
    let folder = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../tests/third-party/reference-fmus/"
    );
    let text = std::fs::read_to_string(format!("{folder}{name}.xml")).expect("it is vendored");
    ModelDescription::read(&text).expect("sound")
}

#[test]
fn both_versions_of_a_model_have_the_same_description() {
    for model in [
        "BouncingBall",
        "Dahlquist",
        "Resource",
        "Stair",
        "VanDerPol",
    ] {
        let (two, three) = (
            reference(&format!("{model}/FMI2")),
            reference(&format!("{model}/FMI3")),
        );
        assert_eq!((two.version, three.version), (Version::Two, Version::Three));
        assert_eq!(
            (&two.identifier, two.saves),
            (&three.identifier, three.saves)
        );
        for one in &two.variables {
            let found = three.variables.iter().find(|other| other.name == one.name);
            let Some(other) = found else {
                assert_eq!(one.name, "h_ft", "{model}: of FMI 3 it is an alias");
                continue;
            };
            let of = |one: &Variable| {
                (
                    one.causality,
                    one.start.clone(),
                    one.unit.clone(),
                    one.min,
                    one.max,
                )
            };
            assert_eq!(of(one), of(other), "{model}: {}", one.name);
        }
        assert_eq!(two.dependencies.len(), three.dependencies.len(), "{model}");
    }
}

#[test]
fn array_sizes_follow_structural_parameters() {
    let model = reference("StateSpace/FMI3");
    let named = |name: &str| {
        model
            .variables
            .iter()
            .find(|one| one.name == name)
            .expect("there")
    };
    let matrix = named("A");
    assert_eq!(matrix.dimensions, [3, 3]);
    assert_eq!(matrix.start, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    assert_eq!(matrix.element_name(5), "A[2,3]");
    assert_eq!(named("u").element_name(2), "u[3]");
    assert_eq!(named("m").element_name(0), "m");
    assert_eq!(
        model.dependencies,
        [Dependency {
            output: 10,
            on: None
        }]
    );
}

#[test]
fn types_units_and_lists_are_inherited() {
    let model = reference("BouncingBall/FMI3");
    let ball = model
        .variables
        .iter()
        .find(|one| one.name == "h")
        .expect("there");
    assert_eq!(ball.unit.as_deref(), Some("m"));
    assert_eq!(
        model.units[1].base.expect("model").exponents,
        [0, 1, -1, 0, 0, 0, 0, 0]
    );
    let model = reference("Feedthrough/FMI2");
    let choice = model
        .variables
        .iter()
        .find(|one| one.name == "Enumeration_input")
        .expect("there");
    assert_eq!((choice.min, choice.max), (Some(1.0), Some(2.0)));
    assert_eq!(choice.start, [1.0]);
}

#[test]
fn a_document_with_entities_is_refused() {
    let bomb = r#"<?xml version="1.0"?><!DOCTYPE lolz [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]>
        <fmiModelDescription fmiVersion="3.0" modelName="&b;"/>"#;
    refused(bomb, "document type");
    refused(&three("<X a=\"&b;\"/>"), "b");
    refused(&three(&"<X>".repeat(100)), "too many elements");
    refused(&three("<X>"), "modelDescription.xml");
    refused("", "truncated");
    refused("<a/>", "not fmiModelDescription");
}

#[test]
fn a_document_is_decoded_as_declared() {
    let inside = "<ModelVariables><Float64 name=\"\u{3b1}\" valueReference=\"1\" description=\"20 \u{b0}C\"/></ModelVariables>";
    let latin = three(&inside.replace('\u{3b1}', "a")).replace("UTF-8", "ISO-8859-1");
    let latin: Vec<u8> = latin
        .chars()
        .map(|c| u8::try_from(c).expect("latin"))
        .collect();
    let model = ModelDescription::decode(&latin).expect("ISO-8859-1");
    assert_eq!(model.variables[0].description, "20 \u{b0}C");
    let text = format!("\u{feff}{}", three(inside).replace("UTF-8", "UTF-16"));
    let wide: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
    let model = ModelDescription::decode(&wide).expect("UTF-16");
    assert_eq!(model.variables[0].name, "\u{3b1}");
    let reason = ModelDescription::decode(&latin[..10])
        .expect_err("cut")
        .to_string();
    assert!(reason.contains("modelDescription.xml"), "{reason}");
}

#[test]
fn an_unreadable_local_variable_keeps_its_entry_with_a_reason() {
    let all = "<ModelVariables><Int8 name=\"x\" valueReference=\"7\" start=\"1,5\"/>\
         <Float64 name=\"a\" valueReference=\"8\"><Dimension start=\"99999\"/><Dimension start=\"99999\"/></Float64>\
         <Float64 name=\"y\" valueReference=\"9\" causality=\"output\"/></ModelVariables>";
    let model = read(all).expect("sound");
    let reasons: Vec<_> = (model.variables.iter())
        .map(|variable| variable.unusable.as_deref())
        .collect();
    let [Some(start), Some(size), None] = reasons[..] else {
        panic!("{reasons:?}")
    };
    assert!(start.contains("is not a value of its type"), "{start}");
    assert!(size.contains("more than 65536 elements"), "{size}");
    assert_eq!(model.variables[0].reference, 7);
}

#[test]
fn an_unusable_inner_variable_is_left_out_and_one_of_the_loop_is_refused() {
    let slips = [
        ("Float64", "", "`valueReference` of"),
        ("Float64", "valueReference=\"-1\"", "`valueReference` of"),
        (
            "Float64",
            "valueReference=\"4294967296\"",
            "`valueReference` of",
        ),
        ("Float128", "valueReference=\"3\"", "`type` of"),
    ];
    for (three, attributes, reason) in slips {
        let of = |causality: &str| {
            let two = three.replace("Float64", "Real");
            let head = format!("name=\"s\" {attributes} {causality}");
            let output = "name=\"y\" valueReference=\"9\" causality=\"output\"";
            let three =
                format!("<ModelVariables><{three} {head}/><Float64 {output}/></ModelVariables>");
            let two = format!(
                "<fmiModelDescription fmiVersion=\"2.0\" modelName=\"m\" guid=\"t\"><CoSimulation modelIdentifier=\"m\"/>\
                 <ModelVariables><ScalarVariable {head}><{two}/></ScalarVariable>\
                 <ScalarVariable {output}><Real/></ScalarVariable></ModelVariables>\
                 <ModelStructure><Outputs><Unknown index=\"2\" dependencies=\"1\"/></Outputs></ModelStructure>\
                 </fmiModelDescription>"
            );
            [read(&three), ModelDescription::read(&two)]
        };
        for model in of("causality=\"local\"") {
            let model = model.expect(attributes);
            let unusable = model.variables[0].unusable.as_deref();
            assert!(
                unusable.unwrap_or_default().contains(reason),
                "{unusable:?}"
            );
            assert_eq!(model.variables[1].unusable, None);
        }
        for causality in ["input", "output", "parameter"] {
            for model in of(&format!("causality=\"{causality}\"")) {
                let message = model.expect_err(causality).to_string();
                assert!(message.contains(reason), "{message}");
            }
        }
    }
    // Nobody knows that it is of the loop.
    let unknown = "<ModelVariables><Float64 name=\"s\" valueReference=\"1\" causality=\"internal\"/></ModelVariables>";
    let unknown = read(unknown).expect("left out");
    let reason = unknown.variables[0].unusable.as_deref();
    assert_eq!(reason, Some("`causality` of Float64 \"s\" is unknown"));
}

#[test]
fn an_inner_variable_is_omitted_if_another_has_its_name() {
    let of = |first: &str, second: &str| {
        let model = read(&format!(
            "<ModelVariables><Int8 name=\"x\" valueReference=\"1\" causality=\"{first}\"/>\
             <Int8 name=\"x\" valueReference=\"2\" causality=\"{second}\"/></ModelVariables>"
        ));
        let variables = model.expect("sound").variables;
        let usable = variables.into_iter().filter(|one| one.unusable.is_none());
        usable.map(|one| one.reference).collect::<Vec<_>>()
    };
    assert_eq!(of("local", "local"), [1]);
    assert_eq!(of("output", "local"), [1]);
    assert_eq!(of("local", "input"), [2]);
}

#[test]
fn units_dependencies_and_aliases_that_make_no_sense_are_noted() {
    let slips = read(
        "<UnitDefinitions><Unit/><Unit name=\"half\"><BaseUnit m=\"0.5\"/></Unit></UnitDefinitions>\
         <ModelVariables><Float64 name=\"y\" valueReference=\"1\" causality=\"output\"><Alias/></Float64></ModelVariables>\
         <ModelStructure><Output valueReference=\"1\" dependencies=\"u\"/><Output/></ModelStructure>",
    )
    .expect("sound");
    assert_eq!(
        slips.notes,
        [
            "an alias of \"y\" has no name; it is ignored",
            "a unit has no name; it is ignored",
            "unit \"half\": `m` of BaseUnit is \"0.5\"; it is not used for conversions",
            "`dependencies` of Output names no variable; it may depend on all inputs",
            "`valueReference` of Output names no variable; it is ignored",
        ]
    );
    let free = Dependency {
        output: 1,
        on: None,
    };
    assert_eq!(slips.dependencies, [free]);
}

#[test]
fn unsupported_fmus_are_refused_with_a_reason() {
    let simulation = "<CoSimulation modelIdentifier=\"m\"/>";
    let other = |with: &str| three("").replace(simulation, with);
    refused(
        &other("<ModelExchange modelIdentifier=\"m\"/>"),
        "only model exchange",
    );
    refused(
        &other("<ScheduledExecution modelIdentifier=\"m\"/>"),
        "only scheduled execution",
    );
    refused(&other(""), "does not support co-simulation");
    for name in ["", "../m", "a/b", "a b"] {
        let other = other(&format!("<CoSimulation modelIdentifier=\"{name}\"/>"));
        refused(&other, "is not a valid name of a library");
    }
    for version in ["1.0", "4.0", "", "30"] {
        let text = three("").replace("fmiVersion=\"3.0\"", &format!("fmiVersion=\"{version}\""));
        refused(&text, "only FMI 2.0 and 3.0 are supported");
    }
    ModelDescription::read(&three("").replace("\"3.0\"", "\"3.0.2\"")).expect("of 3.0");
}

#[test]
fn invalid_variables_are_refused() {
    let one = |attributes: &str| {
        read(&format!(
            "<ModelVariables><Int8 valueReference=\"1\" causality=\"input\" {attributes}/></ModelVariables>"
        ))
    };
    one("name=\"x\" start=\"1\"").expect("sound");
    for (attributes, fragment) in [
        ("", "`name` of Int8 is missing"),
        (
            "name=\"x\" start=\"1.5\"",
            "`start` of Int8 \"x\" is not a value of its type",
        ),
        ("name=\"x\" start=\"1 2\"", "has 2 values for 1 elements"),
        (
            "name=\"x\" clocks=\"1\" start=\"x\"",
            "`start` of Int8 \"x\" is not a value of its type",
        ),
        ("name=\"x\" min=\"low\"", "`min` of Int8 \"x\" is \"low\""),
    ] {
        let message = one(attributes).expect_err(fragment).to_string();
        assert!(message.contains(fragment), "{message}");
    }
    let large = "<ModelVariables><Float64 name=\"x\" valueReference=\"1\" causality=\"input\"><Dimension start=\"99999\"/><Dimension start=\"99999\"/></Float64></ModelVariables>";
    let message = read(large).expect_err("large").to_string();
    assert!(message.contains("more than 65536 elements"), "{message}");
    let array = |number: usize| {
        format!(
            "<Float64 name=\"x{number}\" valueReference=\"{number}\"><Dimension start=\"65536\"/></Float64>"
        )
    };
    let arrays = |count: usize| {
        let all: String = (0..count).map(array).collect();
        read(&format!("<ModelVariables>{all}</ModelVariables>"))
    };
    arrays(64).expect("2^22 elements");
    let message = arrays(65).expect_err("many").to_string();
    assert!(message.contains("4194304 elements in total"), "{message}");
    let twice = "<ModelVariables><Int8 name=\"x\" valueReference=\"1\" causality=\"output\"/>\
                 <Int8 name=\"x\" valueReference=\"2\" causality=\"input\"/></ModelVariables>";
    let message = read(twice).expect_err("twice").to_string();
    assert!(
        message.contains("variable \"x\" is defined twice"),
        "{message}"
    );
}

#[test]
fn an_integer_without_an_exact_signal_value_is_no_start_value() {
    let one = |start: &str| {
        read(&format!(
            "<ModelVariables><Int64 name=\"x\" valueReference=\"1\" causality=\"input\" start=\"{start}\"/></ModelVariables>"
        ))
    };
    one("9007199254740992").expect("2^53");
    one("9007199254740993").expect_err("2^53 + 1");
}

#[test]
fn an_invalid_internal_step_is_noted_and_ignored() {
    let of = |step: &str| {
        let text = three("").replace(
            "modelIdentifier=\"m\"/>",
            &format!("modelIdentifier=\"m\" fixedInternalStepSize=\"{step}\"/>"),
        );
        ModelDescription::read(&text).expect("sound")
    };
    let sound = of("0.001");
    assert_eq!((sound.internal_step_s, sound.notes.len()), (Some(0.001), 0));
    for step in [
        "0", "-0.0", "-1", "NaN", "INF", "1e999", "", "fast", "0,001",
    ] {
        let slip = of(step);
        assert_eq!(slip.internal_step_s, None, "{step}");
        let note = format!(
            "`fixedInternalStepSize` of CoSimulation is {step:?} and not a number above 0; it is ignored"
        );
        assert_eq!(slip.notes, [note]);
    }
}

#[test]
fn invalid_bounds_and_units_are_noted() {
    let slips = read(
        "<UnitDefinitions><Unit name=\"bar\"><BaseUnit kg=\"1\" m=\"-1\" s=\"-2\" factor=\"0\"/></Unit>\
         <Unit name=\"degC\"><BaseUnit K=\"1\" offset=\"NaN\"/></Unit>\
         <Unit name=\"kPa\"><BaseUnit kg=\"1\" m=\"-1\" s=\"-2\" factor=\"1000\"/></Unit></UnitDefinitions>\
         <ModelVariables><Float64 name=\"x\" valueReference=\"1\" min=\"NaN\" max=\"2\"/></ModelVariables>",
    )
    .expect("sound");
    let x = &slips.variables[0];
    assert_eq!((x.min, x.max), (None, Some(2.0)));
    assert_eq!(
        slips.notes,
        [
            "unit \"bar\" has the factor 0 and the offset 0; it is not used for conversions",
            "unit \"degC\" has the factor 1 and the offset NaN; it is not used for conversions",
            "`min` of \"x\" is NaN; it is ignored",
        ]
    );
}

#[test]
fn a_difference_is_declared_by_a_variable_or_its_type() {
    let three = read(
        "<TypeDefinitions><Float64Type name=\"rise\" unit=\"degC\" relativeQuantity=\"true\"/></TypeDefinitions>\
         <ModelVariables><Float64 name=\"a\" valueReference=\"1\" unit=\"K\" relativeQuantity=\"true\"/>\
         <Float64 name=\"b\" valueReference=\"2\" declaredType=\"rise\"/>\
         <Float64 name=\"c\" valueReference=\"3\" declaredType=\"rise\" relativeQuantity=\"false\"/>\
         <Float64 name=\"d\" valueReference=\"4\" unit=\"K\"/></ModelVariables>",
    );
    let two = ModelDescription::read(
        "<fmiModelDescription fmiVersion=\"2.0\" modelName=\"m\" guid=\"t\"><CoSimulation modelIdentifier=\"m\"/>\
         <TypeDefinitions><SimpleType name=\"rise\"><Real unit=\"degC\" relativeQuantity=\"true\"/></SimpleType>\
         </TypeDefinitions><ModelVariables>\
         <ScalarVariable name=\"a\" valueReference=\"1\"><Real relativeQuantity=\"true\"/></ScalarVariable>\
         <ScalarVariable name=\"b\" valueReference=\"2\"><Real declaredType=\"rise\"/></ScalarVariable>\
         <ScalarVariable name=\"c\" valueReference=\"3\">\
         <Real declaredType=\"rise\" relativeQuantity=\"false\"/></ScalarVariable>\
         <ScalarVariable name=\"d\" valueReference=\"4\"><Real unit=\"K\"/></ScalarVariable>\
         </ModelVariables></fmiModelDescription>",
    );
    for model in [two, three] {
        let model = model.expect("sound");
        let differences: Vec<bool> = model
            .variables
            .iter()
            .map(|one| one.is_difference)
            .collect();
        assert_eq!(differences, [true, true, false, false]);
    }
}
