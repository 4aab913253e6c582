//! Model description of an FMU: its `modelDescription.xml`, of FMI 2.0 or 3.0, in a common form.
//!
//! [`ModelDescription::decode`] accepts any encoding that tools write. [`ModelDescription::read`] parses the text and
//! refuses document types, so that no entities are expanded. The module knows no signals or plants;
//! [`tables`](super::tables) maps variables to them.

use std::fmt;

mod encoding;
mod reading;
mod sizes;
mod slips;
mod structure;
mod tree;

#[cfg(test)]
mod tests;

/// Error of reading a model description.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DescriptionError {
    /// The document is malformed, or uses features that no model description needs.
    #[error("modelDescription.xml: {0}")]
    Xml(String),
    /// An attribute is missing or invalid.
    #[error("modelDescription.xml: {0}")]
    Content(String),
    /// The FMU cannot be run here; the text gives the reason.
    #[error("{0}")]
    Unsupported(String),
}

impl DescriptionError {
    /// Returns the reason without the name of the file.
    pub(super) fn reason(self) -> String {
        match self {
            Self::Xml(reason) | Self::Content(reason) | Self::Unsupported(reason) => reason,
        }
    }
}

/// Version of the FMI standard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Version {
    /// FMI 2.0.
    Two,
    /// FMI 3.0.
    Three,
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Two => "FMI 2.0",
            Self::Three => "FMI 3.0",
        })
    }
}

/// Model description of an FMU for co-simulation.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelDescription {
    /// Version of the FMI standard.
    pub version: Version,
    /// Name of the model.
    pub name: String,
    /// One-sentence description.
    pub description: String,
    /// Tool that generated the FMU.
    pub tool: String,
    /// Token that library and description must share.
    pub token: String,
    /// Name of the library, without its extension.
    pub identifier: String,
    /// Set if the FMU declares that it needs the tool that generated it.
    pub needs_tool: bool,
    /// Set if the FMU's state can be saved, restored and serialised.
    pub saves: bool,
    /// Step of the FMU's own solver in s, above 0, if it is fixed and declared.
    pub internal_step_s: Option<f64>,
    /// Default experiment of the model.
    pub experiment: Experiment,
    /// Log categories.
    pub categories: Vec<String>,
    /// Units, by name.
    pub units: Vec<Unit>,
    /// All variables, including aliases.
    pub variables: Vec<Variable>,
    /// Direct dependencies of the outputs that the model structure lists.
    pub dependencies: Vec<Dependency>,
    /// Set if the FMU provides directional derivatives of its equations.
    pub differentiates: bool,
    /// Continuous states that the model structure lists; empty without directional derivatives.
    pub states: Vec<ContinuousState>,
    /// Remarks on attributes that violate the standard and are ignored.
    pub notes: Vec<String>,
}

/// Default experiment, as far as declared.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Experiment {
    /// Start time, in s.
    pub start_s: Option<f64>,
    /// Relative tolerance, above 0.
    pub tolerance: Option<f64>,
}

/// Unit, expressed in base units.
#[derive(Clone, Debug, PartialEq)]
pub struct Unit {
    /// Name.
    pub name: String,
    /// Base unit, if it is declared.
    pub base: Option<BaseUnit>,
}

/// Unit as a product of powers: a value `v` in the unit is `factor v + offset` in base units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaseUnit {
    /// Exponents of kg, m, s, A, K, mol, cd and rad.
    pub exponents: [i32; 8],
    /// Factor.
    pub factor: f64,
    /// Offset.
    pub offset: f64,
}

/// Names of the base units, in the order of the exponents.
pub const BASE_UNITS: [&str; 8] = ["kg", "m", "s", "A", "K", "mol", "cd", "rad"];

/// Continuous state with its derivative by time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ContinuousState {
    /// Index of the state's variable.
    pub variable: usize,
    /// Value reference of the derivative.
    pub derivative: u32,
}

/// Direct dependency of an output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Dependency {
    /// Value reference of the output.
    pub output: u32,
    /// Value references of the variables on which the output depends; `None` for all variables.
    pub on: Option<Vec<u32>>,
}

/// Type of a variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum VariableType {
    /// 32-bit floating point.
    Float32,
    /// 64-bit floating point.
    Float64,
    /// Signed 8-bit integer.
    Int8,
    /// Unsigned 8-bit integer.
    UInt8,
    /// Signed 16-bit integer.
    Int16,
    /// Unsigned 16-bit integer.
    UInt16,
    /// Signed 32-bit integer.
    Int32,
    /// Unsigned 32-bit integer.
    UInt32,
    /// Signed 64-bit integer.
    Int64,
    /// Unsigned 64-bit integer.
    UInt64,
    /// Boolean value.
    Boolean,
    /// Value of an item of an enumeration.
    Enumeration,
    /// Text.
    String,
    /// Bytes.
    Binary,
    /// Clock.
    Clock,
}

impl VariableType {
    /// Returns the type in words.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Float32 => "32-bit number",
            Self::Float64 => "number",
            Self::Int8 => "8-bit integer",
            Self::UInt8 => "unsigned 8-bit integer",
            Self::Int16 => "16-bit integer",
            Self::UInt16 => "unsigned 16-bit integer",
            Self::Int32 => "integer",
            Self::UInt32 => "unsigned integer",
            Self::Int64 => "64-bit integer",
            Self::UInt64 => "unsigned 64-bit integer",
            Self::Boolean => "boolean",
            Self::Enumeration => "enumeration",
            Self::String => "text",
            Self::Binary => "binary",
            Self::Clock => "clock",
        }
    }

    /// Returns the type in words with its article.
    #[must_use]
    pub fn phrase(self) -> String {
        let name = self.name();
        let article = match name.starts_with(['8', 'e', 'i', 'u']) {
            true => "an",
            false => "a",
        };
        format!("{article} {name}")
    }

    /// Returns `true` if only whole numbers are values of the type.
    #[must_use]
    pub const fn is_whole(self) -> bool {
        !matches!(
            self,
            Self::Float32 | Self::Float64 | Self::String | Self::Binary | Self::Clock
        )
    }

    /// Returns the smallest and largest value that a row of numbers can represent exactly; `None` for types that are
    /// not numeric.
    #[must_use]
    pub fn range(self) -> Option<(f64, f64)> {
        /// Largest integer up to which every integer has an exact `f64`.
        const EXACT: f64 = 9_007_199_254_740_992.0;
        Some(match self {
            Self::Float32 => (f64::from(f32::MIN), f64::from(f32::MAX)),
            Self::Float64 => (f64::NEG_INFINITY, f64::INFINITY),
            Self::Int8 => (i8::MIN.into(), i8::MAX.into()),
            Self::UInt8 => (0.0, u8::MAX.into()),
            Self::Int16 => (i16::MIN.into(), i16::MAX.into()),
            Self::UInt16 => (0.0, u16::MAX.into()),
            Self::Int32 => (i32::MIN.into(), i32::MAX.into()),
            Self::UInt32 => (0.0, u32::MAX.into()),
            Self::Int64 | Self::Enumeration => (-EXACT, EXACT),
            Self::UInt64 => (0.0, EXACT),
            Self::Boolean => (0.0, 1.0),
            Self::String | Self::Binary | Self::Clock => return None,
        })
    }

    /// Returns `true` for floating-point types; all others are integers.
    #[must_use]
    pub const fn is_float(self) -> bool {
        matches!(self, Self::Float32 | Self::Float64)
    }
}

/// Causality of a variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Causality {
    /// Constant value that is set from outside.
    Parameter,
    /// Parameter that is computed from others.
    CalculatedParameter,
    /// Parameter that determines sizes of arrays.
    StructuralParameter,
    /// Value set from outside.
    Input,
    /// Value provided to the outside.
    Output,
    /// Local value.
    Local,
    /// Independent variable, usually time.
    Independent,
}

/// Determination of a variable's initial value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Initial {
    /// Start value.
    Exact,
    /// Result of an iteration that begins at the start value.
    Approx,
    /// Value computed from others.
    Calculated,
}

/// Reference of a variable that has none or has that of another variable; such a variable is not an alias.
pub const UNREFERENCED: u32 = u32::MAX;

/// Variable of a model description.
#[derive(Clone, Debug, PartialEq)]
pub struct Variable {
    /// Name.
    pub name: String,
    /// One-sentence description.
    pub description: String,
    /// Value reference in the library.
    pub reference: u32,
    /// Data type.
    pub kind: VariableType,
    /// Causality.
    pub causality: Causality,
    /// Set if the parameter may change between steps.
    pub is_tunable: bool,
    /// Set if the value never changes.
    pub is_constant: bool,
    /// Set if the variable belongs to clocks, and has a value only when they tick.
    pub is_clocked: bool,
    /// Set if its start values do not match the size that the scenario chose.
    pub is_resized: bool,
    /// Determination of the initial value.
    pub initial: Initial,
    /// Start values, one per element.
    pub start: Vec<f64>,
    /// Values of the items, for an enumeration that declares some.
    pub items: Vec<f64>,
    /// Reason why a local variable cannot be used.
    pub unusable: Option<String>,
    /// Unit.
    pub unit: Option<String>,
    /// Set if the value is a difference, whose unit converts without an offset.
    pub is_difference: bool,
    /// Smallest allowed value.
    pub min: Option<f64>,
    /// Largest allowed value.
    pub max: Option<f64>,
    /// Sizes in each dimension; empty for a scalar.
    pub dimensions: Vec<usize>,
}

impl Variable {
    /// Formats values of items as text.
    #[must_use]
    pub fn items_text(items: &[f64]) -> String {
        let items: Vec<String> = items.iter().map(f64::to_string).collect();
        items.join(", ")
    }

    /// Returns the smallest and largest value allowed by the variable's type and its own bounds. Bounds in the wrong
    /// order are ignored.
    #[must_use]
    pub fn bounds(&self) -> (f64, f64) {
        let (low, high) = (self.kind.range()).unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
        let is_range = (self.min.zip(self.max)).is_none_or(|(min, max)| min <= max);
        let min = self.min.filter(|min| is_range && *min > low);
        let max = self.max.filter(|max| is_range && *max < high);
        (min.unwrap_or(low), max.unwrap_or(high))
    }

    /// Returns `true` for a numeric parameter whose value the model does not state.
    #[must_use]
    pub fn lacks_start(&self) -> bool {
        let has_start = self.is_resized || self.start.len() == self.elements();
        self.causality == Causality::Parameter && self.kind.range().is_some() && !has_start
    }

    /// Returns `true` if the variable is not needed from outside.
    #[must_use]
    pub const fn is_inner(&self) -> bool {
        matches!(
            self.causality,
            Causality::Local | Causality::CalculatedParameter
        )
    }

    /// Returns the number of elements.
    #[must_use]
    pub fn elements(&self) -> usize {
        self.dimensions.iter().product()
    }

    /// Returns the name of an element: `x` for a scalar, `x[2,1]` for a matrix, whose last index varies fastest.
    #[must_use]
    pub fn element_name(&self, element: usize) -> String {
        if self.dimensions.is_empty() {
            return self.name.clone();
        }
        let mut rest = element;
        let mut indices: Vec<String> = (self.dimensions.iter().rev())
            .map(|&size| {
                let index = rest % size + 1;
                rest /= size;
                index.to_string()
            })
            .collect();
        indices.reverse();
        format!("{}[{}]", self.name, indices.join(","))
    }
}
