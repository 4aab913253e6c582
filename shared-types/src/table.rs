//! Tables: the meaning of a row of numbers.
//!
//! The wire carries plain `f64` rows. A table gives each column a name with its unit, and, for a parameter, a default
//! and a range. Inside a model the same row is a struct, declared with [`table!`](crate::table!), so that equations
//! read `measured.surface_angle_rad` while everything around the model (binding, recording, faults, expressions, plots)
//! uses the table.

#[doc(hidden)]
pub mod flag;
mod names;
pub mod number;
pub mod row;
#[doc(hidden)]
pub mod rule;

use serde::{Deserialize, Serialize};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

pub use names::{derivative_of, listed, near, nearest, unit_of_name};

/// Column of a table: a signal or a parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Field {
    /// Name ending in its unit, for example `surface_angle_rad`; the name of a group's field is prefixed with the
    /// group, for example `actuator1.piston_mass_kg`.
    pub name: String,
    /// Aliases of the same variable, valid wherever a name is accepted; tables and recordings use [`name`](Self::name)
    /// only.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub aliases: Vec<String>,
    /// Unit as text, for example `rad`, `m/s`, `1`.
    pub unit: String,
    /// One-sentence description.
    pub description: String,
    /// Default value of a parameter, or start value of a plant's command; none for other signals.
    #[serde(
        with = "number::option",
        default,
        skip_serializing_if = "Option::is_none"
    )]
    pub default: Option<f64>,
    /// Smallest valid value.
    #[serde(with = "number", default = "lowest")]
    pub min: f64,
    /// Largest valid value.
    #[serde(with = "number", default = "highest")]
    pub max: f64,
    /// `true` if a fault may change the value during a run.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub faultable: bool,
    /// `true` if the value may be changed during a run; parameters of a plant may also be open to faults.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub tunable: bool,
    /// `true` if the value is a difference, for example of two temperatures: unit conversion then ignores offsets.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_difference: bool,
    /// True if a scenario may leave the value out and the program then does what no value expresses.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_optional: bool,
    /// `true` if the value is one of a few, as in an enumeration or a Boolean: noise has no meaning for such a value.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_discrete: bool,
    /// `true` if only whole numbers are valid, as for an integer, an enumeration or a Boolean.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_whole: bool,
}

impl Field {
    /// Creates a column without default and range.
    #[must_use]
    pub fn signal(name: &str, unit: &str, description: &str) -> Self {
        Self {
            name: name.into(),
            aliases: Vec::new(),
            unit: unit.into(),
            description: description.trim().into(),
            default: None,
            min: lowest(),
            max: highest(),
            faultable: false,
            tunable: false,
            is_difference: false,
            is_optional: false,
            is_discrete: false,
            is_whole: false,
        }
    }

    /// Lists all names: the column's own, then its aliases.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        std::iter::once(&self.name)
            .chain(&self.aliases)
            .map(String::as_str)
    }

    /// Returns `true` if this is the name or an alias of the column.
    #[must_use]
    pub fn is_called(&self, name: &str) -> bool {
        self.names().any(|one| one == name)
    }

    /// Returns `true` if a value is a number inside the range. Infinity is valid where the range includes it.
    #[must_use]
    #[inline]
    pub fn admits(&self, value: f64) -> bool {
        (self.min..=self.max).contains(&value)
    }
}

fn lowest() -> f64 {
    f64::NEG_INFINITY
}

fn highest() -> f64 {
    f64::INFINITY
}

/// Struct of `f64` columns without padding, tied to its fields. Declare it with [`table!`](crate::table!).
pub trait Table:
    Copy + FromBytes + IntoBytes + Immutable + KnownLayout + std::fmt::Debug + 'static
{
    /// Returns the number of columns.
    const LEN: usize = size_of::<Self>() / size_of::<f64>();

    /// Returns the columns, in memory order.
    fn fields() -> Vec<Field>;

    /// Returns the row as numbers.
    fn row(&self) -> &[f64] {
        if Self::LEN == 0 {
            return &[]; // a struct without fields is not aligned as f64
        }
        <[f64]>::ref_from_bytes(self.as_bytes()).expect("a table is made of f64 only")
    }

    /// Returns the row as mutable numbers.
    fn row_mut(&mut self) -> &mut [f64] {
        if Self::LEN == 0 {
            return &mut [];
        }
        <[f64]>::mut_from_bytes(self.as_mut_bytes()).expect("a table is made of f64 only")
    }

    /// Builds the struct from a row.
    ///
    /// # Panics
    /// If the row does not have [`Table::LEN`] numbers.
    fn from_row(row: &[f64]) -> Self {
        Self::read_from_bytes(row.as_bytes()).expect("the row has as many columns as the table")
    }
}

/// Declares a [`Table`]: a `repr(C)` struct of `f64` with the table's names, units and descriptions.
///
/// A signal is `name: "unit"`, optionally with its range of validity (`in min..=max`, used by the engine's guard). A
/// parameter has a default and a range, and may be open to faults or to changes during a run:
/// `name: "unit" = default in min..=max [faultable]`, `[tunable]`, or both, as `[faultable, tunable]`. Numbers other
/// than plain literals need parentheses. A command of a plant may have a start value, `name: "unit" start 293.15`, for
/// scenarios in which no law commands it. The description is the doc comment.
///
/// ```
/// shared_types::table! {
///     /// Parameters of the teaching plant.
///     pub struct Parameters {
///         /// Mass m.
///         mass_kg: "kg" = 1.0 in 1e-3..=1e3,
///         /// Spring stiffness k.
///         stiffness_n_per_m: "N/m" = 100.0 in 0.0..=1e9 [faultable],
///     }
/// }
/// use shared_types::table::Table;
/// assert_eq!(Parameters::default().row(), [1.0, 100.0]);
/// assert_eq!(Parameters::fields()[1].name, "stiffness_n_per_m");
/// ```
///
/// A group of tables has types in place of units. Its columns are prefixed with the group's name, and a default that
/// differs from the type's default follows `=`:
///
/// ```
/// # shared_types::table! { /// One.
/// # pub struct Actuator { /// Mass.
/// # mass_kg: "kg" = 55.0 in 0.0..=1e3, } }
/// shared_types::table! {
///     /// Two actuators.
///     pub struct Pair {
///         /// First actuator.
///         actuator1: Actuator,
///         /// Second, heavier actuator.
///         actuator2: Actuator = Actuator { mass_kg: 60.0 },
///     }
/// }
/// use shared_types::table::Table;
/// assert_eq!(Pair::fields()[1].name, "actuator2.mass_kg");
/// assert_eq!(Pair::fields()[1].default, Some(60.0));
/// ```
///
/// A mistake in a row is a compile error that points at the row: a range that begins above its end, a default outside
/// its range, an unknown flag, no description, no unit, a negative number without parentheses, no default where other
/// rows have one.
///
/// ```compile_fail
/// shared_types::table! {
///     /// Parameters of the plant.
///     pub struct Parameters {
///         /// Mass m.
///         mass_kg: "kg" = 1.0 in 1e3..=1e-3,
///     }
/// }
/// ```
#[macro_export]
macro_rules! table {
    // Checks of the row. Tokens passed on as `tt` or `expr` keep their place in the source.
    (@row $name:ident $docs:tt $unit:tt $default:tt $min:tt $max:tt) => {
        $crate::table!(@described $name $docs $unit);
        $crate::table!(@measured $docs $unit);
        $crate::table!(@parenthesised $default);
        $crate::table!(@parenthesised $min);
        $crate::table!(@parenthesised $max);
        $crate::table!(@ordered $min $max);
        $crate::table!(@inside $min $max $default);
    };
    (@described $name:ident [$($doc:expr)+] $unit:tt) => {};
    (@described $name:ident [] [$unit:tt]) => {
        $crate::table::rule::Kept::<false>::described($unit)
    };
    (@described $name:ident [] []) => {
        ::core::compile_error!(::core::concat!(
            "the row `", ::core::stringify!($name), "` of a table has no description and no unit: \
            write `/// What it is.` above it and `: \"unit\"` behind it"
        ))
    };
    (@measured [$($doc:expr)*] []) => { $( $crate::table::rule::Kept::<false>::measured($doc); )* };
    (@measured $docs:tt $unit:tt) => {};
    (@parenthesised [$sign:tt $number:literal]) => {
        $crate::table::rule::Kept::<false>::parenthesised($number)
    };
    (@parenthesised $number:tt) => {};
    (@ordered [$min:tt] [$max:tt]) => {
        $crate::table::rule::Kept::<{ $crate::table::rule::is_range($min, $max) }>::ordered($max)
    };
    (@ordered $min:tt $max:tt) => {};
    (@inside [$min:tt] [$max:tt] [$default:tt]) => {
        $crate::table::rule::Kept::<{
            $crate::table::rule::is_inside($min, $max, $default)
        }>::inside($default)
    };
    (@inside $min:tt $max:tt $default:tt) => {};
    // Rows with defaults make a table of parameters, rows without one of signals.
    (@kind $table:ident $([$($default:tt)+] $unit:tt $flag:tt)*) => {
        impl $crate::table::Parameters for $table {}
    };
    (@kind $table:ident $([] $unit:tt [])*) => {};
    (@kind $table:ident $([] $unit:tt [$($flag:ident)*])*) => {
        const _: () = { $( $crate::table!(@closed [$($flag)*] $unit); )* };
    };
    (@kind $table:ident $($default:tt $unit:tt $flag:tt)*) => {
        const _: () = { $( $crate::table!(@settable $default $unit); )* };
    };
    (@closed [$($flag:ident)+] [$unit:tt]) => { $crate::table::rule::Kept::<false>::settable($unit) };
    (@closed $flag:tt $unit:tt) => {};
    (@settable [] [$unit:tt]) => { $crate::table::rule::Kept::<false>::settable($unit) };
    (@settable $default:tt $unit:tt) => {};
    (
        $(#[doc = $table_doc:expr])+
        $vis:vis struct $table:ident {
            $(
                $(#[doc = $doc:expr])*
                $name:ident : $group:ty $(= $default:expr)?
            ),+ $(,)?
        }
    ) => {
        $(#[doc = $table_doc])+
        #[derive(
            Clone, Copy, Debug, PartialEq,
            $crate::zerocopy::FromBytes,
            $crate::zerocopy::IntoBytes,
            $crate::zerocopy::Immutable,
            $crate::zerocopy::KnownLayout,
        )]
        #[zerocopy(crate = "shared_types::zerocopy")]
        #[repr(C)]
        $vis struct $table {
            $( $(#[doc = $doc])* $vis $name: $group, )+
        }

        impl ::core::default::Default for $table {
            fn default() -> Self {
                Self {
                    $( $name: {
                        let _value = <$group as ::core::default::Default>::default();
                        $( let _value: $group = $default; )?
                        _value
                    }, )+
                }
            }
        }

        impl $crate::table::Table for $table {
            fn fields() -> ::std::vec::Vec<$crate::table::Field> {
                let mut fields = ::std::vec::Vec::new();
                $( $crate::table::push_group::<$group>(
                    &mut fields,
                    stringify!($name),
                    &Self::default().$name,
                ); )+
                fields
            }
        }

        // `for<'a>`: a group of signals is a table as well.
        impl $crate::table::Parameters for $table where $( for<'a> $group: $crate::table::Parameters, )+ {}
    };
    (
        $(#[doc = $table_doc:expr])+
        $vis:vis struct $table:ident {
            $(
                $(#[doc = $doc:expr])*
                $name:ident $(: $unit:tt)?
                    $(= $default:tt $($default_size:literal)?)?
                    $(start $start:tt $($start_size:literal)?)?
                    $(in $min:tt $($min_size:literal)? ..= $max:tt $($max_size:literal)?)?
                    $([$($flag:ident),+ $(,)?])?
            ),* $(,)?
        }
    ) => {
        $(#[doc = $table_doc])+
        #[derive(
            Clone, Copy, Debug, PartialEq,
            $crate::zerocopy::FromBytes,
            $crate::zerocopy::IntoBytes,
            $crate::zerocopy::Immutable,
            $crate::zerocopy::KnownLayout,
        )]
        #[zerocopy(crate = "shared_types::zerocopy")]
        #[repr(C)]
        $vis struct $table {
            $( $(#[doc = $doc])* $vis $name: f64, )*
        }

        #[allow(unused_parens, reason = "a number that is no literal stands in parentheses")]
        const _: () = {
            $( $crate::table!(
                @row $name [$($doc)*] [$($unit)?]
                [$($default $($default_size)?)? $($start $($start_size)?)?]
                [$($min $($min_size)?)?] [$($max $($max_size)?)?]
            ); )*
        };
        $crate::table!(@kind $table $( [$($default $($default_size)?)?] [$($unit)?] [$($($flag)+)?] )*);

        impl ::core::default::Default for $table {
            #[allow(unused_parens, reason = "a number that is no literal stands in parentheses")]
            fn default() -> Self {
                Self { $( $name: {
                    let _value = 0.0_f64;
                    $( let _value: f64 = $default $($default_size)?; )?
                    $( let _value: f64 = $start $($start_size)?; )?
                    _value
                }, )* }
            }
        }

        impl $crate::table::Table for $table {
            #[allow(unused_parens, reason = "a number that is no literal stands in parentheses")]
            fn fields() -> ::std::vec::Vec<$crate::table::Field> {
                ::std::vec![
                    $({
                        let field = $crate::table::Field::signal(
                            stringify!($name),
                            concat!($($unit)?),
                            concat!($($doc),*),
                        );
                        $( let field = $crate::table::Field {
                            default: Some($default $($default_size)?),
                            ..field
                        }; )?
                        $( let field = $crate::table::Field {
                            default: Some($start $($start_size)?),
                            ..field
                        }; )?
                        $( let field = $crate::table::Field {
                            min: $min $($min_size)?,
                            max: $max $($max_size)?,
                            ..field
                        }; )?
                        $($( let field = $crate::table::flag::$flag(field); )+)?
                        field
                    },)*
                ]
            }
        }
    };
    ($($other:tt)*) => {
        ::core::compile_error!(
            "a table is `/// What it is.` and `struct Name { .. }`; each of its lines is `/// What it is.` and \
            `name: \"unit\"`, for a parameter with ` = default in min..=max` and perhaps `[faultable]`, \
            `[tunable]` or `[faultable, tunable]` behind it. \
            Numbers other than plain literals stand in parentheses. The `///` lines are what --describe says, so \
            none may be missing"
        );
    };
}

/// Table in which every row has a default, so that a scenario can omit it.
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a table of parameters: a parameter needs a default",
    label = "a row of it has no default",
    note = "write each row as `name: \"unit\" = default in min..=max`"
)]
pub trait Parameters: Table + Default {}

/// Appends a group's columns, with the group's name as prefix and with the group's own defaults.
#[doc(hidden)]
pub fn push_group<T: Table>(fields: &mut Vec<Field>, group: &str, defaults: &T) {
    for (field, &default) in T::fields().into_iter().zip(defaults.row()) {
        fields.push(Field {
            name: format!("{group}.{}", field.name),
            default: field.default.map(|_| default),
            ..field
        });
    }
}

crate::table! {
    /// Table without columns, for a law without internals or without parameters.
    pub struct Empty {}
}

/// Returns the canonical form of a number in a frame or record: one NaN, no negative zero.
#[must_use]
#[inline]
pub fn canonical(value: f64) -> f64 {
    if value.is_nan() {
        f64::NAN
    } else {
        value + 0.0
    }
}

#[cfg(test)]
mod tests;
