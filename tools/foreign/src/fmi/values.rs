//! Conversion of values between a row of numbers and the types of an FMU, with one call per type.
//!
//! All memory is allocated once. A number that cannot be passed exactly in either direction is an error that names the
//! variable; nothing is rounded.

use std::ffi::{c_int, c_void};

use crate::crash::calling;

use super::description::{ModelDescription, Variable, VariableType, Version};
use super::library::{Access, Functions, Handle, access_names};
use super::status::Status;
use super::tables::Column;
use crate::float_modes;

/// Largest integer up to which a row of numbers represents all integers.
const EXACT: i128 = 1 << 53;

/// Values of one type, as the library represents them.
#[derive(Debug)]
enum Buffer {
    Float32(Vec<f32>),
    Float64(Vec<f64>),
    Int8(Vec<i8>),
    UInt8(Vec<u8>),
    Int16(Vec<i16>),
    UInt16(Vec<u16>),
    Int32(Vec<i32>),
    UInt32(Vec<u32>),
    Int64(Vec<i64>),
    UInt64(Vec<u64>),
    /// Booleans of FMI 3, as bytes, so that any value from the library is valid.
    Boolean(Vec<u8>),
}

/// Evaluates an expression with the values of a buffer of any type.
macro_rules! each {
    ($buffer:expr, $values:ident => $then:expr) => {
        match $buffer {
            Buffer::Float32($values) => $then,
            Buffer::Float64($values) => $then,
            Buffer::Int8($values) => $then,
            Buffer::UInt8($values) | Buffer::Boolean($values) => $then,
            Buffer::Int16($values) => $then,
            Buffer::UInt16($values) => $then,
            Buffer::Int32($values) => $then,
            Buffer::UInt32($values) => $then,
            Buffer::Int64($values) => $then,
            Buffer::UInt64($values) => $then,
        }
    };
}

impl Buffer {
    fn new(version: Version, kind: VariableType, count: usize) -> Self {
        match (version, kind) {
            (
                Version::Two,
                VariableType::Int32 | VariableType::Enumeration | VariableType::Boolean,
            ) => Self::Int32(vec![0; count]),
            (_, VariableType::Float32) => Self::Float32(vec![0.0; count]),
            (_, VariableType::Int8) => Self::Int8(vec![0; count]),
            (_, VariableType::UInt8) => Self::UInt8(vec![0; count]),
            (_, VariableType::Int16) => Self::Int16(vec![0; count]),
            (_, VariableType::UInt16) => Self::UInt16(vec![0; count]),
            (_, VariableType::Int32) => Self::Int32(vec![0; count]),
            (_, VariableType::UInt32) => Self::UInt32(vec![0; count]),
            (_, VariableType::Int64 | VariableType::Enumeration) => Self::Int64(vec![0; count]),
            (_, VariableType::UInt64) => Self::UInt64(vec![0; count]),
            (_, VariableType::Boolean) => Self::Boolean(vec![0; count]),
            // Types without a range have no columns.
            (
                _,
                VariableType::Float64
                | VariableType::String
                | VariableType::Binary
                | VariableType::Clock,
            ) => Self::Float64(vec![0.0; count]),
        }
    }

    fn pointer(&mut self) -> *mut c_void {
        each!(self, values => values.as_mut_ptr().cast())
    }

    /// Returns a value as a number, if it has an exact one.
    #[expect(
        clippy::cast_precision_loss,
        reason = "whole numbers of 64 bits are compared with the largest that is exact"
    )]
    fn get(&self, place: usize) -> Option<f64> {
        let exact = |value: i128| (-EXACT..=EXACT).contains(&value).then_some(value as f64);
        match self {
            Self::Float32(values) => Some(values[place].into()),
            Self::Float64(values) => Some(values[place]),
            Self::Int8(values) => Some(values[place].into()),
            Self::UInt8(values) => Some(values[place].into()),
            Self::Int16(values) => Some(values[place].into()),
            Self::UInt16(values) => Some(values[place].into()),
            Self::Int32(values) => Some(values[place].into()),
            Self::UInt32(values) => Some(values[place].into()),
            Self::Int64(values) => exact(values[place].into()),
            Self::UInt64(values) => exact(values[place].into()),
            Self::Boolean(values) => Some(f64::from(u8::from(values[place] != 0))),
        }
    }

    /// Sets a value; returns `false` if the type cannot represent it exactly.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "each cast is compared with what it was made of"
    )]
    fn set(&mut self, place: usize, value: f64) -> bool {
        macro_rules! whole {
            ($values:ident, $of:ty) => {{
                let is_exact = value.fract() == 0.0 && value.abs() <= EXACT as f64;
                match <$of>::try_from(value as i64) {
                    Ok(number) if is_exact => {
                        $values[place] = number;
                        true
                    }
                    _ => false,
                }
            }};
        }
        match self {
            Self::Float64(values) => {
                values[place] = value;
                true
            }
            // Single precision rounds every number, so only numbers out of range are refused.
            Self::Float32(values) => {
                values[place] = value as f32;
                values[place].is_finite() == value.is_finite()
            }
            Self::Int8(values) => whole!(values, i8),
            Self::UInt8(values) => whole!(values, u8),
            Self::Int16(values) => whole!(values, i16),
            Self::UInt16(values) => whole!(values, u16),
            Self::Int32(values) => whole!(values, i32),
            Self::UInt32(values) => whole!(values, u32),
            Self::Int64(values) => whole!(values, i64),
            Self::UInt64(values) => whole!(values, u64),
            Self::Boolean(values) => {
                values[place] = u8::from(value == 1.0);
                value == 0.0 || value == 1.0
            }
        }
    }
}

/// Variables of one type: their references, and the index in the row for each value.
#[derive(Debug)]
struct Group {
    kind: VariableType,
    references: Vec<u32>,
    places: Vec<usize>,
    /// For each value, the items of its enumeration; empty if any number of the type is valid.
    items: Vec<Vec<f64>>,
    buffer: Buffer,
    /// Names of the functions that read and write the variables.
    names: [&'static &'static str; 2],
}

/// Sets a value; returns `false` if a type cannot represent it exactly.
fn set(kind: VariableType, buffer: &mut Buffer, index: usize, value: f64) -> bool {
    // FMI 2 passes Booleans as integers, of which only two are Booleans.
    let is_of_kind = kind != VariableType::Boolean || [0.0, 1.0].contains(&value);
    is_of_kind && buffer.set(index, value)
}

/// Variables that are read or written together.
#[derive(Debug)]
pub(super) struct Values {
    groups: Vec<Group>,
    names: Vec<String>,
}

/// Reason why values were not read or written.
#[derive(Debug)]
pub(super) enum Refused {
    /// Status returned by the library.
    Status(&'static str, Status),
    /// Value that has no counterpart in the other representation.
    Value(String),
}

impl Values {
    /// Groups the variables of these columns; the columns of an array must be adjacent.
    pub(super) fn new(model: &ModelDescription, columns: &[Column]) -> Self {
        let mut groups: Vec<Group> = Vec::new();
        for (place, column) in columns.iter().enumerate() {
            let variable = &model.variables[column.variable];
            let existing = groups.iter_mut().find(|group| group.kind == variable.kind);
            let group = match existing {
                Some(group) => group,
                None => {
                    let kind = variable.kind;
                    groups.push(Group {
                        kind,
                        references: Vec::new(),
                        places: Vec::new(),
                        items: Vec::new(),
                        buffer: Buffer::new(model.version, kind, 0),
                        names: access_names(model.version, kind).unwrap_or([&"Get", &"Set"]),
                    });
                    let last = groups.len() - 1;
                    &mut groups[last]
                }
            };
            if column.element == 0 {
                group.references.push(variable.reference);
            }
            group.places.push(place);
            group.items.push(variable.items.clone());
        }
        for group in &mut groups {
            group.buffer = Buffer::new(model.version, group.kind, group.places.len());
        }
        Self {
            groups,
            names: columns
                .iter()
                .map(|column| column.field.name.clone())
                .collect(),
        }
    }

    /// Reads all variables into a row.
    ///
    /// # Safety
    /// `handle` is a live instance of the library, in a state in which these variables may be read.
    pub(super) unsafe fn get(
        &mut self,
        functions: &Functions,
        handle: Handle,
        row: &mut [f64],
    ) -> Result<(), Refused> {
        for group in &mut self.groups {
            let (references, count) = (&group.references, group.places.len());
            let (first, values) = (references.as_ptr(), group.buffer.pointer());
            let call = calling(group.names[0]);
            // SAFETY: the instance is alive, `references` has this many references, and the buffer has one value of
            // the type for each element of these variables.
            let status = unsafe {
                match functions.access[&group.kind] {
                    Access::Two(get, _) => get(handle, first, references.len(), values),
                    Access::Three(get, _) => get(handle, first, references.len(), values, count),
                }
            };
            drop(call);
            done("get", status)?;
            for (index, &place) in group.places.iter().enumerate() {
                let value = group.buffer.get(index).ok_or_else(|| {
                    let name = &self.names[place];
                    Refused::Value(format!(
                        "`{name}` is an integer beyond 2^53, which a signal cannot represent exactly"
                    ))
                })?;
                // In C any nonzero number is true, including a vendor's -1.
                row[place] = match group.kind {
                    VariableType::Boolean => f64::from(u8::from(value != 0.0)),
                    _ => value,
                };
            }
        }
        Ok(())
    }

    /// Writes all variables from a row.
    ///
    /// # Safety
    /// `handle` is a live instance of the library, in a state in which these variables may be written.
    pub(super) unsafe fn set(
        &mut self,
        functions: &Functions,
        handle: Handle,
        row: &[f64],
    ) -> Result<(), Refused> {
        for group in &mut self.groups {
            for (index, &place) in group.places.iter().enumerate() {
                let items = &group.items[index];
                if !items.is_empty() && !items.contains(&row[place]) {
                    let (name, value) = (&self.names[place], row[place]);
                    let items = Variable::items_text(items);
                    return Err(Refused::Value(format!(
                        "`{name}` is set to {value}, which is not an item of its enumeration; use one of {items}"
                    )));
                }
                if !set(group.kind, &mut group.buffer, index, row[place]) {
                    let (name, value, kind) = (&self.names[place], row[place], group.kind.phrase());
                    return Err(Refused::Value(format!(
                        "`{name}` is set to {value}, which is not {kind}"
                    )));
                }
            }
            let (references, count) = (&group.references, group.places.len());
            let (first, values) = (references.as_ptr(), group.buffer.pointer().cast_const());
            let call = calling(group.names[1]);
            // SAFETY: as in `get`.
            let status = unsafe {
                match functions.access[&group.kind] {
                    Access::Two(_, set) => set(handle, first, references.len(), values),
                    Access::Three(_, set) => set(handle, first, references.len(), values, count),
                }
            };
            drop(call);
            done("set", status)?;
        }
        Ok(())
    }
}

fn done(function: &'static str, status: c_int) -> Result<(), Refused> {
    float_modes::settle(function);
    match Status::of(status) {
        status if status.is_done() => Ok(()),
        status => Err(Refused::Status(function, status)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_are_passed_exactly_or_refused() {
        let mut bytes = Buffer::new(Version::Three, VariableType::Int8, 1);
        for value in [-128.0, -1.0, 0.0, 127.0] {
            assert!(bytes.set(0, value));
            assert_eq!(bytes.get(0), Some(value));
        }
        for value in [-129.0, 128.0, 0.5, f64::NAN, f64::INFINITY] {
            assert!(!bytes.set(0, value), "{value}");
        }
        let most = 9_007_199_254_740_992.0;
        let mut large = Buffer::new(Version::Three, VariableType::Int64, 1);
        assert!(large.set(0, -most) && large.get(0) == Some(-most));
        assert!(!large.set(0, most * 2.0));
        let beyond = Buffer::Int64(vec![(1 << 53) + 1]);
        assert_eq!(beyond.get(0), None);
        let beyond = Buffer::UInt64(vec![u64::MAX]);
        assert_eq!(beyond.get(0), None);
    }

    #[test]
    fn a_boolean_is_set_to_0_or_1_in_both_versions() {
        for version in [Version::Two, Version::Three] {
            let mut flags = Buffer::new(version, VariableType::Boolean, 1);
            for value in [0.0, 1.0] {
                assert!(set(VariableType::Boolean, &mut flags, 0, value));
                assert_eq!(flags.get(0), Some(value), "{version:?}");
            }
            for value in [-1.0, 2.0, 7.0, 0.4, f64::NAN] {
                assert!(!set(VariableType::Boolean, &mut flags, 0, value), "{value}");
            }
        }
    }

    #[test]
    fn booleans_are_converted_to_0_and_1() {
        let mut flags = Buffer::new(Version::Three, VariableType::Boolean, 1);
        assert!(flags.set(0, 1.0) && flags.get(0) == Some(1.0));
        assert!(!flags.set(0, 2.0));
        assert_eq!(Buffer::Boolean(vec![7]).get(0), Some(1.0));
    }
}
