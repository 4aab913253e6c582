//! Description of an FMU: its `modelDescription.xml`, of FMI 2.0 and 3.0, in one form.
//!
//! [`ModelDescription::decode`] takes the bytes in whatever encoding tools write; [`ModelDescription::read`] takes the
//! text and never asks for anything else: a document type, and with it
//! every entity that a document could declare, is refused. Nothing here knows signals or plants; which
//! variable becomes which is the work of [`tables`](super::tables).

use std::fmt;

mod encoding;
mod reading;
mod sizes;
mod slips;
mod structure;
mod tree;

#[cfg(test)]
mod tests;

/// A model description cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DescriptionError {
    /// The document is damaged, or uses what no model description needs.
    #[error("modelDescription.xml: {0}")]
    Xml(String),
    /// An attribute is missing or has no sense.
    #[error("modelDescription.xml: {0}")]
    Content(String),
    /// The FMU cannot be run here; the text says why.
    #[error("{0}")]
    Unsupported(String),
}

impl DescriptionError {
    /// The reason without the name of the file.
    pub(super) fn reason(self) -> String {
        match self {
            Self::Xml(reason) | Self::Content(reason) | Self::Unsupported(reason) => reason,
        }
    }
}

/// Version of the standard.
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

/// An FMU for co-simulation as its model description has it.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelDescription {
    /// Version of the standard.
    pub version: Version,
    /// Name of the model.
    pub name: String,
    /// Sentence about the model.
    pub description: String,
    /// Tool that made the FMU.
    pub tool: String,
    /// Text by which library and description know each other.
    pub token: String,
    /// Name of the library, without its ending.
    pub identifier: String,
    /// True if it says that it needs the tool that it was made with.
    pub needs_tool: bool,
    /// True if the FMU's state can be taken, put back and written as bytes.
    pub saves: bool,
    /// Step of the FMU's own solver in s, above 0, if that is fixed and told.
    pub internal_step_s: Option<f64>,
    /// Experiment that the model is made for.
    pub experiment: Experiment,
    /// Categories of messages.
    pub categories: Vec<String>,
    /// Units by name.
    pub units: Vec<Unit>,
    /// All variables, aliases included.
    pub variables: Vec<Variable>,
    /// For each output that the model structure names, the variables it depends on directly.
    pub dependencies: Vec<Dependency>,
    /// Attributes that the standard does not allow and that count as left out.
    pub notes: Vec<String>,
}

/// Default experiment, as far as it is given.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Experiment {
    /// Time of the begin in s.
    pub start_s: Option<f64>,
    /// Relative tolerance, above 0.
    pub tolerance: Option<f64>,
}

/// A unit, in terms of base units.
#[derive(Clone, Debug, PartialEq)]
pub struct Unit {
    /// Name.
    pub name: String,
    /// Base unit, if it is told.
    pub base: Option<BaseUnit>,
}

/// A unit as a product of powers: a value `v` in the unit is `factor v + offset` in base units.
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

/// Direct dependency of an output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Dependency {
    /// Value reference of the output.
    pub output: u32,
    /// Value references of variables; `None`: all of them.
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
    /// True or false.
    Boolean,
    /// Number of an item of a list.
    Enumeration,
    /// Text.
    String,
    /// Bytes.
    Binary,
    /// Clock.
    Clock,
}

impl VariableType {
    /// In one word.
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

    /// Smallest and largest value that a row of numbers can carry exactly; `None`: it carries none.
    #[must_use]
    pub fn range(self) -> Option<(f64, f64)> {
        /// Integers up to here are all numbers of 64 bits.
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

    /// Checks for a type of floating-point numbers; all others are whole.
    #[must_use]
    pub const fn is_float(self) -> bool {
        matches!(self, Self::Float32 | Self::Float64)
    }
}

/// Role of a variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Causality {
    /// Value that stays as it was set.
    Parameter,
    /// Parameter that follows from others.
    CalculatedParameter,
    /// Parameter that sets sizes of arrays.
    StructuralParameter,
    /// Value from outside.
    Input,
    /// Value for the outside.
    Output,
    /// Inner value.
    Local,
    /// Time.
    Independent,
}

/// Initial value of a variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Initial {
    /// The start value.
    Exact,
    /// Value that an iteration finds, which begins at the start value.
    Approx,
    /// Value that follows from others.
    Calculated,
}

/// Reference of a variable whose own is missing or of another one: it is no other name of anything.
pub const UNREFERENCED: u32 = u32::MAX;

/// Variable.
#[derive(Clone, Debug, PartialEq)]
pub struct Variable {
    /// Name.
    pub name: String,
    /// Sentence about the variable.
    pub description: String,
    /// Number by which the library knows it.
    pub reference: u32,
    /// Type.
    pub kind: VariableType,
    /// Role.
    pub causality: Causality,
    /// True if it may change between steps although it is a parameter.
    pub is_tunable: bool,
    /// True if it never changes.
    pub is_constant: bool,
    /// Clocks by which it is active; such a variable has no value at other times.
    pub is_clocked: bool,
    /// True if its start values are of another size than the scenario chose.
    pub is_resized: bool,
    /// Initial value.
    pub initial: Initial,
    /// Start values; one for each element.
    pub start: Vec<f64>,
    /// Values of the items, if it is of an enumeration that has some.
    pub items: Vec<f64>,
    /// Reason for which it cannot be used, if it is an inner variable that cannot.
    pub unusable: Option<String>,
    /// Unit.
    pub unit: Option<String>,
    /// True if it is a difference of two values, whose unit converts without an offset.
    pub is_difference: bool,
    /// Smallest value.
    pub min: Option<f64>,
    /// Largest value.
    pub max: Option<f64>,
    /// Size in each dimension; none for a single value.
    pub dimensions: Vec<usize>,
}

impl Variable {
    /// Values of items as text.
    #[must_use]
    pub fn items_text(items: &[f64]) -> String {
        let items: Vec<String> = items.iter().map(f64::to_string).collect();
        items.join(", ")
    }

    /// Smallest and largest value that both its type and its own bounds allow. Bounds in the wrong order count as none.
    #[must_use]
    pub fn bounds(&self) -> (f64, f64) {
        let (low, high) = (self.kind.range()).unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
        let is_range = (self.min.zip(self.max)).is_none_or(|(min, max)| min <= max);
        let min = self.min.filter(|min| is_range && *min > low);
        let max = self.max.filter(|max| is_range && *max < high);
        (min.unwrap_or(low), max.unwrap_or(high))
    }

    /// Returns `true` if it is a number and a parameter whose value the model does not tell.
    #[must_use]
    pub fn lacks_start(&self) -> bool {
        let has_start = self.is_resized || self.start.len() == self.elements();
        self.causality == Causality::Parameter && self.kind.range().is_some() && !has_start
    }

    /// Returns true if nobody outside needs it.
    #[must_use]
    pub const fn is_inner(&self) -> bool {
        matches!(
            self.causality,
            Causality::Local | Causality::CalculatedParameter
        )
    }

    /// Number of elements.
    #[must_use]
    pub fn elements(&self) -> usize {
        self.dimensions.iter().product()
    }

    /// Name of an element: `x` of a single value, `x[2,1]` of a matrix, whose last index runs fastest.
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
