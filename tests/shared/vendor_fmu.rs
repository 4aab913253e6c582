//! An FMU as a vendor's tool exports one of a large model: 500 variables with names in parts, units with factors, and
//! tables in its resources. Its model is in `tests/fmus/vendor.c`, and both versions of it are the same.

use std::fmt::Write;

use super::fmus::{Entries, entries};

/// Parameters, every second of them tunable.
pub(crate) const PARAMETERS: usize = 100;
/// Inputs.
pub(crate) const INPUTS: usize = 50;
/// Outputs.
pub(crate) const OUTPUTS: usize = 100;
/// Inner signals: states and their derivatives.
pub(crate) const INNER: usize = 250;
/// Size of its tables in bytes.
const TABLES: usize = 8 << 20;

/// Causality of a variable.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Role {
    Parameter { is_tunable: bool },
    Input,
    Output,
    Inner,
}

/// A variable of the FMU.
pub(crate) struct Variable {
    pub(crate) name: String,
    /// Name of the variable in this project, by the table of `docs/fmu.md`.
    pub(crate) here: String,
    pub(crate) unit: &'static str,
    pub(crate) start: f64,
    pub(crate) role: Role,
    reference: usize,
}

/// Returns all variables, in the order of the model description.
pub(crate) fn variables() -> Vec<Variable> {
    let mut all = Vec::new();
    let mut add = |role, begin: usize, place, (before, after): (&str, &str), unit, start| {
        let number = place + 1;
        // `der(..)` around a name is `der__` in front of it.
        let (front, back) = match before.strip_prefix("der(") {
            Some(front) => (format!("der__{front}"), after.trim_end_matches(')')),
            None => (before.to_owned(), after),
        };
        all.push(Variable {
            name: format!("{before}[{number}]{after}"),
            here: format!("{front}__{number}{back}"),
            unit,
            start,
            role,
            reference: begin + place,
        });
    };
    let inner = 1 + OUTPUTS;
    let inputs = inner + INNER;
    for place in 0..PARAMETERS {
        let is_tunable = place % 2 == 0;
        let role = Role::Parameter { is_tunable };
        let name = ("circuit.lag", ".rate");
        add(role, inputs + INPUTS, place, name, "1/s", rate(place));
    }
    for place in 0..INPUTS {
        add(Role::Input, inputs, place, ("demand", ""), "bar", 0.0);
    }
    for place in 0..OUTPUTS {
        let name = ("sensors.pressure", "");
        add(Role::Output, 1, place, name, "bar", 0.0);
    }
    for place in 0..INNER / 2 {
        // Side by side, as the library has them.
        let begin = inner + place;
        let state = ("circuit.lag", ".pressure");
        add(Role::Inner, begin, place, state, "bar", 0.0);
        let derivative = ("der(circuit.lag", ".pressure)");
        add(Role::Inner, begin + 1, place, derivative, "bar/s", 0.0);
    }
    all
}

/// Returns the start value of a parameter: a number with many digits, in 1/s.
pub(crate) fn rate(place: usize) -> f64 {
    1.0 + place as f64 / 300.0
}

/// Returns the FMU of a version, as entries of its archive.
pub(crate) fn vendor(version: u32) -> Entries {
    let counts = [
        ("PARAMETERS", PARAMETERS),
        ("INPUTS", INPUTS),
        ("OUTPUTS", OUTPUTS),
        ("INNER", INNER),
    ];
    let options = counts.map(|(name, count)| format!("-D{name}={count}"));
    let options = options.each_ref().map(String::as_str);
    let description = description(version).into_bytes();
    let mut entries = entries("vendor", version, description, &options);
    entries.push(("resources/tables.bin".into(), tables()));
    entries
}

/// Returns bytes that no compression makes smaller: Marsaglia's xorshift64.
fn tables() -> Vec<u8> {
    let mut word = 88_172_645_463_325_252_u64;
    let words = (0..TABLES / 8).flat_map(|_| {
        word ^= word << 13;
        word ^= word >> 7;
        word ^= word << 17;
        word.to_le_bytes()
    });
    words.collect()
}

fn description(version: u32) -> String {
    let (token, state) = match version {
        2 => ("guid", " numberOfEventIndicators=\"0\""),
        _ => ("instantiationToken", ""),
    };
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
         <fmiModelDescription fmiVersion=\"{version}.0\" modelName=\"vendor\" {token}=\"vendor\"{state} \
         variableNamingConvention=\"structured\" generationTool=\"vendor_fmu.rs\" description=\"A circuit of many lags\">\n\
         <CoSimulation modelIdentifier=\"vendor\"/>\n\
         <UnitDefinitions>\n\
         <Unit name=\"bar\"><BaseUnit kg=\"1\" m=\"-1\" s=\"-2\" factor=\"100000\"/></Unit>\n\
         <Unit name=\"bar/s\"><BaseUnit kg=\"1\" m=\"-1\" s=\"-3\" factor=\"100000\"/></Unit>\n\
         <Unit name=\"1/s\"><BaseUnit s=\"-1\"/></Unit>\n\
         </UnitDefinitions>\n<ModelVariables>\n"
    );
    let variables = variables();
    if version == 3 {
        text += "<Float64 name=\"time\" valueReference=\"0\" causality=\"independent\" variability=\"continuous\"/>\n";
    }
    for variable in &variables {
        declare(&mut text, version, variable);
    }
    text += "</ModelVariables>\n<ModelStructure>\n";
    if version == 2 {
        text += "<Outputs>\n";
    }
    for (place, variable) in variables.iter().enumerate() {
        if variable.role == Role::Output {
            let output = match version {
                2 => format!("Unknown index=\"{}\"", place + 1),
                _ => format!("Output valueReference=\"{}\"", variable.reference),
            };
            writeln!(text, "<{output} dependencies=\"\"/>").expect("text");
        }
    }
    if version == 2 {
        text += "</Outputs>\n";
    }
    text + "</ModelStructure>\n</fmiModelDescription>\n"
}

fn declare(text: &mut String, version: u32, variable: &Variable) {
    let Variable {
        name,
        unit,
        start,
        reference,
        ..
    } = variable;
    let (role, range) = match variable.role {
        Role::Parameter { is_tunable: true } => (
            "causality=\"parameter\" variability=\"tunable\"",
            " min=\"0\" max=\"20\"",
        ),
        Role::Parameter { is_tunable: false } => (
            "causality=\"parameter\" variability=\"fixed\"",
            " min=\"0\" max=\"20\"",
        ),
        Role::Input => ("causality=\"input\" variability=\"continuous\"", ""),
        Role::Output => (
            "causality=\"output\" variability=\"continuous\" initial=\"exact\"",
            "",
        ),
        Role::Inner => (
            "causality=\"local\" variability=\"continuous\" initial=\"exact\"",
            "",
        ),
    };
    let head = format!(
        "name=\"{name}\" valueReference=\"{reference}\" {role} description=\"Variable {reference} of the circuit\""
    );
    let value = format!("unit=\"{unit}\" start=\"{start:?}\"{range}");
    let line = match version {
        2 => format!("<ScalarVariable {head}><Real {value}/></ScalarVariable>"),
        _ => format!("<Float64 {head} {value}/>"),
    };
    writeln!(text, "{line}").expect("text");
}
