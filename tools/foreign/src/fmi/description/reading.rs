//! Conversion of the elements of a document to a model description.

use std::collections::BTreeMap;

use super::encoding::decoded;
use super::sizes::{dimensions, resize};
use super::slips::{drop_bounds, name_once, positive, units, unusable, unusable_unit};
use super::structure::{dependencies, states};
use super::tree::{Element, shortened};
use super::{
    Causality, DescriptionError, Experiment, Initial, ModelDescription, Variable, VariableType,
    Version,
};

/// Maximum total number of elements of all variables: a short text could require more memory than exists.
const MOST_TOGETHER: usize = 1 << 22;

/// Element names of FMI 3, with the types that they stand for.
const KINDS: [(&str, VariableType); 15] = [
    ("Float32", VariableType::Float32),
    ("Float64", VariableType::Float64),
    ("Int8", VariableType::Int8),
    ("UInt8", VariableType::UInt8),
    ("Int16", VariableType::Int16),
    ("UInt16", VariableType::UInt16),
    ("Int32", VariableType::Int32),
    ("UInt32", VariableType::UInt32),
    ("Int64", VariableType::Int64),
    ("UInt64", VariableType::UInt64),
    ("Boolean", VariableType::Boolean),
    ("Enumeration", VariableType::Enumeration),
    ("String", VariableType::String),
    ("Binary", VariableType::Binary),
    ("Clock", VariableType::Clock),
];

type Types<'a> = BTreeMap<&'a str, &'a Element>;

impl ModelDescription {
    /// Parses the bytes of a `modelDescription.xml`.
    ///
    /// # Errors
    /// If the encoding is not supported; also see [`read`](Self::read).
    pub fn decode(bytes: &[u8]) -> Result<Self, DescriptionError> {
        Self::resized(bytes, &BTreeMap::new())
    }

    /// Parses the bytes of a `modelDescription.xml` with these values of structural parameters.
    ///
    /// # Errors
    /// See [`decode`](Self::decode); also if such a parameter does not exist.
    pub fn resized(bytes: &[u8], sizes: &BTreeMap<String, u64>) -> Result<Self, DescriptionError> {
        Self::with_sizes(&decoded(bytes)?, sizes)
    }

    /// Parses the text of a `modelDescription.xml`.
    ///
    /// # Errors
    /// If the text is not a model description, or the FMU cannot be run.
    pub fn read(text: &str) -> Result<Self, DescriptionError> {
        Self::with_sizes(text, &BTreeMap::new())
    }

    fn with_sizes(text: &str, sizes: &BTreeMap<String, u64>) -> Result<Self, DescriptionError> {
        let root = Element::read(text)?;
        if root.name != "fmiModelDescription" {
            let name: String = root.name.chars().take(80).collect();
            return Err(DescriptionError::Xml(format!(
                "the root element is {name:?}, not fmiModelDescription"
            )));
        }
        let version = version(root.needed("fmiVersion")?)?;
        let simulation = co_simulation(&root)?;
        let state = match version {
            Version::Two => ["canGetAndSetFMUstate", "canSerializeFMUstate"],
            Version::Three => ["canGetAndSetFMUState", "canSerializeFMUState"],
        };
        let derivatives = match version {
            Version::Two => "providesDirectionalDerivative",
            Version::Three => "providesDirectionalDerivatives",
        };
        let differentiates = simulation.flag(derivatives)?;
        let mut notes = Vec::new();
        let mut variables = variables(&root, version, sizes, &mut notes)?;
        let units = units(&root, &mut notes);
        let internal_step_s = positive(simulation, "fixedInternalStepSize", &mut notes);
        notes.extend(units.iter().filter_map(unusable_unit));
        for variable in &mut variables {
            drop_bounds(variable, &mut notes);
        }
        let token = match version {
            Version::Two => root.needed("guid")?,
            Version::Three => root.needed("instantiationToken")?,
        };
        let identifier = simulation.needed("modelIdentifier")?;
        let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-' || c == '.';
        if identifier.is_empty() || identifier.len() > 256 || !identifier.chars().all(is_name) {
            return Err(simulation.wrong("modelIdentifier", "is not a valid name of a library"));
        }
        Ok(Self {
            version,
            name: root.needed("modelName")?.into(),
            description: root.text("description").unwrap_or_default().into(),
            tool: root.text("generationTool").unwrap_or_default().into(),
            token: token.into(),
            identifier: identifier.into(),
            needs_tool: simulation.flag("needsExecutionTool")?,
            saves: simulation.flag(state[0])? && simulation.flag(state[1])?,
            internal_step_s,
            experiment: experiment(&root),
            categories: (root.list("LogCategories").iter())
                .filter_map(|category| category.text("name").map(str::to_owned))
                .collect(),
            units,
            dependencies: dependencies(&root, version, &variables, &mut notes),
            differentiates,
            states: match differentiates {
                true => states(&root, version, &variables),
                false => Vec::new(),
            },
            variables,
            notes,
        })
    }
}

/// Reads the default experiment; invalid numbers count as missing.
fn experiment(root: &Element) -> Experiment {
    let experiment = root.child("DefaultExperiment");
    let number = |name: &str| {
        let number: f64 = experiment?.text(name)?.trim().parse().ok()?;
        Some(number).filter(|number| number.is_finite())
    };
    Experiment {
        start_s: number("startTime"),
        tolerance: number("tolerance").filter(|tolerance| *tolerance > 0.0),
    }
}

fn version(text: &str) -> Result<Version, DescriptionError> {
    let is = |major: &str| {
        let rest = text.strip_prefix(major);
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
    };
    if is("2.0") {
        return Ok(Version::Two);
    }
    if is("3.0") {
        return Ok(Version::Three);
    }
    let text = shortened(text);
    Err(DescriptionError::Unsupported(format!(
        "the FMU uses FMI {text}, but only FMI 2.0 and 3.0 are supported"
    )))
}

fn co_simulation(root: &Element) -> Result<&Element, DescriptionError> {
    let Some(simulation) = root.child("CoSimulation") else {
        let other = ["ModelExchange", "ScheduledExecution"];
        let other = other.iter().find(|name| root.child(name).is_some());
        return Err(DescriptionError::Unsupported(match other {
            Some(&"ModelExchange") => {
                "the FMU supports only model exchange, without a solver; export it for co-simulation"
                    .into()
            }
            Some(_) => "the FMU supports only scheduled execution; export it for co-simulation".into(),
            None => "the FMU does not support co-simulation; export it for co-simulation".into(),
        }));
    };
    Ok(simulation)
}

/// Maps type names to elements: in FMI 2 to the element with the type's attributes in each definition, in FMI 3 to
/// the definition itself.
fn types(root: &Element, version: Version) -> Types<'_> {
    let definitions = root.list("TypeDefinitions").iter();
    let types = definitions.filter_map(|definition| {
        let of = match version {
            Version::Two => definition.children.first()?,
            Version::Three => definition,
        };
        Some((definition.text("name")?, of))
    });
    types.collect()
}

fn variables(
    root: &Element,
    version: Version,
    sizes: &BTreeMap<String, u64>,
    notes: &mut Vec<String>,
) -> Result<Vec<Variable>, DescriptionError> {
    let types = types(root, version);
    let mut variables = Vec::new();
    let mut structure = Vec::new();
    let mut together = 0;
    let mut add = |elements: usize| {
        together += elements;
        match together > MOST_TOGETHER {
            true => Err(DescriptionError::Unsupported(format!(
                "the variables have more than {MOST_TOGETHER} elements in total"
            ))),
            false => Ok(()),
        }
    };
    for (number, element) in (1..).zip(root.list("ModelVariables")) {
        let typed = match version {
            Version::Two => (element.children.iter().find_map(|of| Some((of, two(of)?))))
                .filter(|_| element.name == "ScalarVariable"),
            Version::Three => (KINDS.iter().find(|(name, _)| *name == element.name))
                .map(|(_, kind)| (element, *kind)),
        };
        let of = typed.map_or(element, |(of, _)| of);
        let variable = match typed {
            Some((of, kind)) => variable(element, of, kind, &types),
            None => Err(element.wrong("type", "is missing or unknown")),
        };
        let known = (typed.map(|(_, kind)| kind), causality(element).ok());
        let variable = variable.or_else(|error| unusable(element, known, number, error))?;
        let sizes: Vec<&Element> = (of.children.iter())
            .filter(|child| version == Version::Three && child.name == "Dimension")
            .collect();
        let aliases: Vec<&Element> = (of.children.iter())
            .filter(|child| version == Version::Three && child.name == "Alias")
            .collect();
        add((1 + aliases.len()) * variable.start.len())?;
        let aliases = aliases.into_iter().filter_map(|alias| {
            let Some(name) = alias.text("name") else {
                let name = shortened(&variable.name);
                notes.push(format!("an alias of {name:?} has no name; it is ignored"));
                return None;
            };
            let description = alias.text("description");
            Some(Variable {
                name: name.into(),
                description: description.unwrap_or(&variable.description).into(),
                ..variable.clone()
            })
        });
        let aliases: Vec<Variable> = aliases.collect();
        structure.extend(std::iter::repeat_n(sizes, 1 + aliases.len()));
        variables.push(variable);
        variables.extend(aliases);
    }
    resize(&mut variables, sizes)?;
    let starts: BTreeMap<u32, f64> = (variables.iter())
        .filter_map(|variable| Some((variable.reference, *variable.start.first()?)))
        .collect();
    for (variable, sizes) in variables.iter_mut().zip(structure) {
        variable.dimensions = match dimensions(&sizes, &starts) {
            Err(error) if variable.is_inner() => {
                variable.unusable.get_or_insert_with(|| error.reason());
                continue;
            }
            other => other?,
        };
        let count = variable.elements();
        add(count)?;
        if let ([one], true) = (&variable.start[..], count != 1) {
            variable.start = vec![*one; count];
        }
        if !variable.start.is_empty() && variable.start.len() != count {
            let (name, values) = (&variable.name, variable.start.len());
            if !sizes.is_empty() {
                variable.start.clear();
                variable.is_resized = true;
                continue;
            }
            if variable.is_inner() {
                let reason = format!("its start has {values} values for {count} elements");
                variable.unusable.get_or_insert(reason);
                variable.start.clear();
                continue;
            }
            return Err(DescriptionError::Content(format!(
                "`start` of {name:?} has {values} values for {count} elements"
            )));
        }
    }
    name_once(&mut variables)?;
    Ok(variables)
}

fn two(element: &Element) -> Option<VariableType> {
    Some(match element.name.as_str() {
        "Real" => VariableType::Float64,
        "Integer" => VariableType::Int32,
        "Boolean" => VariableType::Boolean,
        "Enumeration" => VariableType::Enumeration,
        "String" => VariableType::String,
        _ => return None,
    })
}

/// Reads the variable of an element; `of` is the element with the attributes of its type.
fn variable(
    element: &Element,
    of: &Element,
    kind: VariableType,
    types: &Types<'_>,
) -> Result<Variable, DescriptionError> {
    let declared = of.text("declaredType").and_then(|name| types.get(name));
    let inherited = |name: &str| {
        let own = of.value::<f64>(name)?;
        match (own, declared) {
            (None, Some(declared)) => declared.value(name),
            (own, _) => Ok(own),
        }
    };
    let (mut min, mut max, mut items) = (None, None, Vec::new());
    if !matches!(
        kind,
        VariableType::Boolean | VariableType::String | VariableType::Binary | VariableType::Clock
    ) {
        (min, max) = (inherited("min")?, inherited("max")?);
    }
    if let (VariableType::Enumeration, Some(declared)) = (kind, declared) {
        let all = declared.children.iter().filter(|item| item.name == "Item");
        for item in all {
            let value: f64 = item
                .value("value")?
                .ok_or_else(|| item.wrong("value", "is missing"))?;
            min = Some(min.filter(|min| *min <= value).unwrap_or(value));
            max = Some(max.filter(|max| *max >= value).unwrap_or(value));
            items.push(value);
        }
    }
    let causality = causality(element)?;
    let variability = element.text("variability");
    let unit = of.text("unit").or_else(|| declared?.text("unit"));
    Ok(Variable {
        name: element.needed("name")?.into(),
        description: element.text("description").unwrap_or_default().into(),
        reference: (element.value("valueReference")?)
            .ok_or_else(|| element.wrong("valueReference", "is missing"))?,
        kind,
        causality,
        is_tunable: variability == Some("tunable"),
        is_constant: variability == Some("constant"),
        is_clocked: element
            .text("clocks")
            .is_some_and(|clocks| !clocks.trim().is_empty()),
        is_resized: false,
        initial: match element.text("initial") {
            Some("exact") => Initial::Exact,
            Some("approx") => Initial::Approx,
            _ => Initial::Calculated,
        },
        start: start(of, kind)?,
        items,
        unusable: None,
        unit: unit.map(str::to_owned),
        is_difference: match (of.text("relativeQuantity"), declared) {
            (None, Some(declared)) => declared.flag("relativeQuantity")?,
            _ => of.flag("relativeQuantity")?,
        },
        min,
        max,
        dimensions: Vec::new(),
    })
}

fn causality(element: &Element) -> Result<Causality, DescriptionError> {
    Ok(match element.text("causality") {
        None | Some("local") => Causality::Local,
        Some("parameter") => Causality::Parameter,
        Some("calculatedParameter") => Causality::CalculatedParameter,
        Some("structuralParameter") => Causality::StructuralParameter,
        Some("input") => Causality::Input,
        Some("output") => Causality::Output,
        Some("independent") => Causality::Independent,
        Some(_) => return Err(element.wrong("causality", "is unknown")),
    })
}

fn start(of: &Element, kind: VariableType) -> Result<Vec<f64>, DescriptionError> {
    let Some(text) = of.text("start").filter(|_| kind.range().is_some()) else {
        return Ok(Vec::new());
    };
    let number = |word: &str| match (kind, word) {
        (VariableType::Boolean, "true") => Some(1.0),
        (VariableType::Boolean, "false") => Some(0.0),
        (VariableType::Float32 | VariableType::Float64, _) => word.parse().ok(),
        (_, _) => whole(word),
    };
    let numbers = text.split_ascii_whitespace().map(number);
    let numbers: Option<Vec<f64>> = numbers.collect();
    numbers.ok_or_else(|| of.wrong("start", "is not a value of its type"))
}

/// Parses an integer that has an exact `f64`.
fn whole(word: &str) -> Option<f64> {
    let value: i128 = word.parse().ok()?;
    #[expect(clippy::cast_precision_loss, reason = "compared below")]
    let number = value as f64;
    #[expect(clippy::cast_possible_truncation, reason = "compared here")]
    (number as i128 == value).then_some(number)
}
