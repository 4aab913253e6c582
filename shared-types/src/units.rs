//! Units as text, reduced to base units, and conversions between units of one dimension.
//!
//! `N.m`, `N m` and `kg m2/s2` are three spellings of one unit, `mm` is m with a factor, and `degC` is K with an
//! offset.
//! Called when a scenario is checked, never by a loop, which only uses the [`Conversion`].
//!
//! Base units are those of SI (BIPM, *The International System of Units*, 9th edition, tables 2 to 8), and rad, which
//! is distinct from 1: converting an angle into a plain number, or rad/s into Hz, would hide a factor of 2 pi. No crate
//! fits: `uom` needs the units at compile time, `octofhir-ucum` uses the codes of UCUM, in which `degC` and `rpm` have
//! other names, and `rink-core` is a calculator with a dictionary.

mod symbols;

use std::fmt::Write as _;

use serde::{Deserialize, Serialize};

use crate::table::number;
use symbols::{Known, known};

pub use symbols::symbol_of_word;

/// Maximum length of a unit's text.
const LONGEST: usize = 64;
/// Largest exponent, in halves.
const LARGEST_EXPONENT: i32 = 64;
/// Base units, in the order of exponents.
const BASE: [&str; 8] = ["kg", "m", "s", "A", "K", "mol", "cd", "rad"];

/// A unit, reduced to base units.
///
/// A value `x` in this unit is `(x + zero) * numerator / denominator * pi^(half_turns / 2)` in base units. Numerator
/// and denominator are separate because both are whole numbers for nearly every unit, so that a factor is rounded only
/// once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    /// Exponents of [`BASE`], in halves.
    halves: [i32; 8],
    numerator: f64,
    denominator: f64,
    /// Exponent of pi, in halves.
    half_turns: i32,
    /// Offset of the unit's zero, in this unit: 273.15 for degC.
    zero: f64,
}

/// Reason why a text cannot be reduced to base units.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unreadable {
    /// Unknown symbol.
    #[error("`{0}` is not a known unit{near}", near = symbols::near(.0))]
    Symbol(String),
    /// Product after a quotient without parentheses.
    #[error("`{0}` is ambiguous; write a denominator of two units in parentheses, as in J/(kg K)")]
    Ambiguous(String),
    /// Text that is not a product of units.
    #[error("`{0}` is not a product of units with exponents, such as kg m2/s2 or N.m")]
    Form(String),
}

/// Conversion of a value: `received = factor * sent + offset`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Conversion {
    /// Factor of the sent value.
    #[serde(with = "number")]
    pub factor: f64,
    /// Offset, in the receiver's unit.
    #[serde(with = "number")]
    pub offset: f64,
}

impl Conversion {
    /// Conversion that changes no bit.
    pub const IDENTITY: Self = Self {
        factor: 1.0,
        offset: 0.0,
    };

    /// Returns `true` if the conversion changes no bit.
    #[must_use]
    pub fn is_identity(&self) -> bool {
        *self == Self::IDENTITY
    }

    /// Converts a value.
    #[must_use]
    #[inline]
    pub fn apply(&self, value: f64) -> f64 {
        if self.is_identity() {
            return value;
        }
        self.factor * value + self.offset
    }
}

impl Unit {
    const ONE: Self = Self {
        halves: [0; 8],
        numerator: 1.0,
        denominator: 1.0,
        half_turns: 0,
        zero: 0.0,
    };

    /// Parses a unit. The empty text is 1.
    ///
    /// # Errors
    /// If the text is not a unit, or names an unknown one.
    pub fn parse(text: &str) -> Result<Self, Unreadable> {
        if text.trim().is_empty() {
            return Ok(Self::ONE);
        }
        if text.len() > LONGEST {
            let begin = text.chars().take(40).collect::<String>();
            return Err(Unreadable::Form(format!("{begin}..")));
        }
        let mut parser = Parser { text, rest: text };
        let unit = parser.product()?;
        match parser.rest {
            "" => Ok(unit),
            _ => Err(parser.form()),
        }
    }

    /// Formats the unit in base units without its factor, for example `kg m2/s2`.
    #[must_use]
    pub fn base(&self) -> String {
        let side = |sign: i32| {
            let mut text = String::new();
            let mut count = 0;
            for (symbol, halves) in BASE.iter().zip(self.halves) {
                if halves * sign <= 0 {
                    continue;
                }
                let separator = if count > 0 { " " } else { "" };
                let _ = match (halves * sign, halves % 2) {
                    (2, _) => write!(text, "{separator}{symbol}"),
                    (halves, 0) => write!(text, "{separator}{symbol}{}", halves / 2),
                    (1, _) => write!(text, "{separator}sqrt({symbol})"),
                    (halves, _) => write!(text, "{separator}sqrt({symbol}{halves})"),
                };
                count += 1;
            }
            (text, count)
        };
        let ((above, count), (below, divisors)) = (side(1), side(-1));
        let above = if count == 0 { "1" } else { &above };
        match divisors {
            0 => above.into(),
            1 => format!("{above}/{below}"),
            _ => format!("{above}/({below})"),
        }
    }

    /// Returns the coherent SI unit of the same dimension: its own symbol, such as `N` or `Hz`, or else
    /// [`base`](Self::base).
    #[must_use]
    pub fn coherent(&self) -> String {
        let mut symbols = Known::ALL.iter().filter(|symbol| {
            let unit = symbol.unit(1.0, 1.0);
            unit.is_coherent() && unit.halves == self.halves
        });
        symbols
            .next()
            .map_or_else(|| self.base(), |symbol| symbol.symbol.into())
    }

    /// Returns `true` if values in this unit equal those in base units.
    #[must_use]
    pub fn is_coherent(&self) -> bool {
        let one = Self {
            halves: self.halves,
            ..Self::ONE
        };
        *self == one
    }

    /// Returns `true` if the unit is a plain number or a fraction of 1, as are 1 and %.
    #[must_use]
    pub fn is_plain(&self) -> bool {
        self.halves == [0; 8]
    }

    /// Returns `true` if 0 in this unit is not 0 in base units, as in degC.
    #[must_use]
    pub fn has_own_zero(&self) -> bool {
        self.zero != 0.0
    }

    /// Converts a value in this unit into base units.
    #[must_use]
    pub fn in_base_units(&self, value: f64) -> f64 {
        // Divided, not multiplied by a fraction: 200 ms are the same number as 0.2 s.
        let value = (value + self.zero) * self.numerator / self.denominator;
        match self.half_turns {
            0 => value,
            turns if turns > 0 => value * power_of_pi(turns),
            turns => value / power_of_pi(-turns),
        }
    }

    /// Lists the known symbols, each with every prefix that it accepts.
    #[must_use]
    pub fn symbols() -> Vec<String> {
        symbols::all().collect()
    }

    /// Returns the conversion from this unit into another; `None` if their dimensions differ.
    #[must_use]
    pub fn conversion_to(&self, other: &Self) -> Option<Conversion> {
        if self.halves != other.halves {
            return None;
        }
        if self == other {
            return Some(Conversion::IDENTITY);
        }
        let numerator = self.numerator * other.denominator;
        let denominator = self.denominator * other.numerator;
        let factor = match self.half_turns - other.half_turns {
            0 => numerator / denominator,
            turns if turns > 0 => numerator * power_of_pi(turns) / denominator,
            turns => numerator / (denominator * power_of_pi(-turns)),
        };
        let offset = if self.zero == 0.0 {
            0.0 - other.zero
        } else {
            self.zero * factor - other.zero
        };
        Some(Conversion { factor, offset })
    }

    fn times(&self, other: &Self, halves: i32) -> Option<Self> {
        if *other == Self::ONE {
            return Some(*self);
        }
        if *self == Self::ONE && halves == 2 {
            return Some(*other);
        }
        let mut unit = *self;
        // A temperature in a product is a difference: degC/s is K/s.
        unit.zero = 0.0;
        for (mine, theirs) in unit.halves.iter_mut().zip(other.halves) {
            *mine += theirs * halves / 2;
            if theirs * halves % 2 != 0 || mine.abs() > LARGEST_EXPONENT {
                return None;
            }
        }
        let turns = other.half_turns * halves;
        if turns % 2 != 0 {
            return None;
        }
        unit.half_turns += turns / 2;
        let (above, below) = if halves < 0 {
            (other.denominator, other.numerator)
        } else {
            (other.numerator, other.denominator)
        };
        unit.numerator *= power(above, halves.abs());
        unit.denominator *= power(below, halves.abs());
        let is_sound = |value: f64| value.is_normal();
        (is_sound(unit.numerator) && is_sound(unit.denominator)).then_some(unit)
    }
}

fn power_of_pi(halves: i32) -> f64 {
    power(std::f64::consts::PI, halves)
}

/// Computes `base` to the power of `halves / 2`.
fn power(base: f64, halves: i32) -> f64 {
    let root = if halves % 2 == 0 { 1.0 } else { base.sqrt() };
    (0..halves / 2).fold(root, |product, _| product * base)
}

struct Parser<'a> {
    text: &'a str,
    rest: &'a str,
}

impl Parser<'_> {
    fn form(&self) -> Unreadable {
        Unreadable::Form(self.text.into())
    }

    /// Parses adjacent units, up to a closing parenthesis or the end.
    fn product(&mut self) -> Result<Unit, Unreadable> {
        self.skip_spaces();
        let (first, halves) = self.factor()?;
        let mut unit = Unit::ONE.times(&first, halves).ok_or_else(|| self.form())?;
        let mut is_quotient = false;
        loop {
            let is_apart = self.skip_spaces();
            let sign = match self.rest.chars().next() {
                None | Some(')') => return Ok(unit),
                Some('/') => -1,
                Some('.' | '*' | '·' | '⋅') => 1,
                Some(_) if is_apart => 0,
                Some(_) => return Err(self.form()),
            };
            if sign != 0 {
                self.skip(1);
                self.skip_spaces();
            }
            if sign >= 0 && is_quotient {
                return Err(Unreadable::Ambiguous(self.text.into()));
            }
            is_quotient |= sign < 0;
            let (other, halves) = self.factor()?;
            let halves = if sign < 0 { -halves } else { halves };
            unit = unit.times(&other, halves).ok_or_else(|| self.form())?;
        }
    }

    /// Parses a unit and its exponent in halves.
    fn factor(&mut self) -> Result<(Unit, i32), Unreadable> {
        if let Some(rest) = self.rest.strip_prefix("sqrt(") {
            self.rest = rest;
            return Ok((self.inner()?, 1));
        }
        let unit = if let Some(rest) = self.rest.strip_prefix('(') {
            self.rest = rest;
            self.inner()?
        } else if let Some(rest) = self.rest.strip_prefix('1') {
            self.rest = rest;
            return Ok((Unit::ONE, 2));
        } else {
            let is_of_symbol = |c: char| c.is_alphabetic() || matches!(c, '%' | '°' | '\'' | '"');
            let end = self.rest.find(|c| !is_of_symbol(c));
            let (symbol, rest) = self.rest.split_at(end.unwrap_or(self.rest.len()));
            if symbol.is_empty() {
                return Err(self.form());
            }
            self.rest = rest;
            known(symbol).ok_or_else(|| Unreadable::Symbol(symbol.into()))?
        };
        Ok((unit, 2 * self.exponent()?))
    }

    fn inner(&mut self) -> Result<Unit, Unreadable> {
        let unit = self.product()?;
        self.rest = self.rest.strip_prefix(')').ok_or_else(|| self.form())?;
        Ok(unit)
    }

    /// Parses a whole number after a unit, with or without `^`; 1 if there is none.
    fn exponent(&mut self) -> Result<i32, Unreadable> {
        const RAISED: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
        let (is_needed, rest) = match self.rest.strip_prefix('^') {
            Some(rest) => (true, rest),
            None => (false, self.rest),
        };
        let (sign, digits) = match rest.strip_prefix(['-', '−', '⁻']) {
            Some(digits) => (-1, digits),
            None => (1, rest.strip_prefix('+').unwrap_or(rest)),
        };
        let digit = |c: char| {
            let raised = RAISED.iter().position(|raised| *raised == c);
            c.to_digit(10).or(raised.map(|digit| digit as u32))
        };
        let (mut exponent, mut length) = (0, 0);
        for c in digits.chars() {
            let Some(digit) = digit(c) else { break };
            exponent = exponent * 10 + digit as i32;
            length += c.len_utf8();
            if exponent > LARGEST_EXPONENT / 2 {
                return Err(self.form());
            }
        }
        match length {
            0 if is_needed || digits.len() != rest.len() => Err(self.form()),
            0 => Ok(1),
            _ => {
                self.rest = &digits[length..];
                Ok(sign * exponent)
            }
        }
    }

    fn skip_spaces(&mut self) -> bool {
        let rest = self.rest.trim_start();
        let is_apart = rest.len() < self.rest.len();
        self.rest = rest;
        is_apart
    }

    fn skip(&mut self, characters: usize) {
        let mut rest = self.rest.chars();
        rest.by_ref().take(characters).for_each(drop);
        self.rest = rest.as_str();
    }
}

#[cfg(test)]
mod tests;
