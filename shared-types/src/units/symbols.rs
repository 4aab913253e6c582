//! Symbols of units and prefixes.
//!
//! Values: BIPM, *The International System of Units*, 9th edition (tables 4, 7 and 8); the foot, the pound and units
//! derived from them by NIST SP 811, appendix B.8, exactly.

use super::Unit;
use crate::table::{listed, nearest};

/// Known symbol.
pub(super) struct Known {
    pub(super) symbol: &'static str,
    /// `true` if a prefix may precede the symbol.
    takes_prefix: bool,
    numerator: f64,
    denominator: f64,
    /// Exponent of pi.
    turns: i32,
    zero: f64,
    /// Exponents of kg, m, s, A, K, mol, cd and rad.
    exponents: [i32; 8],
}

impl Known {
    const fn of(symbol: &'static str, exponents: [i32; 8]) -> Self {
        Self {
            symbol,
            takes_prefix: false,
            numerator: 1.0,
            denominator: 1.0,
            turns: 0,
            zero: 0.0,
            exponents,
        }
    }

    const fn si(symbol: &'static str, exponents: [i32; 8]) -> Self {
        let mut unit = Self::of(symbol, exponents);
        unit.takes_prefix = true;
        unit
    }

    const fn times(mut self, numerator: f64) -> Self {
        self.numerator = numerator;
        self
    }

    const fn by(mut self, denominator: f64) -> Self {
        self.denominator = denominator;
        self
    }

    const fn turning(mut self) -> Self {
        self.turns = 1;
        self
    }

    const fn with_zero(mut self, zero: f64) -> Self {
        self.zero = zero;
        self
    }

    pub(super) const ALL: &[Self] = &[
        Self::si("g", MASS).by(1e3),
        Self::si("m", LENGTH),
        Self::si("s", [0, 0, 1, 0, 0, 0, 0, 0]),
        Self::si("A", [0, 0, 0, 1, 0, 0, 0, 0]),
        Self::si("K", TEMPERATURE),
        Self::si("mol", [0, 0, 0, 0, 0, 1, 0, 0]),
        Self::si("cd", [0, 0, 0, 0, 0, 0, 1, 0]),
        Self::si("rad", ANGLE),
        Self::si("sr", [0, 0, 0, 0, 0, 0, 0, 2]),
        Self::si("Hz", [0, 0, -1, 0, 0, 0, 0, 0]),
        Self::si("N", FORCE),
        Self::si("Pa", PRESSURE),
        Self::si("J", ENERGY),
        Self::si("Nm", ENERGY),
        Self::si("W", [1, 2, -3, 0, 0, 0, 0, 0]),
        Self::si("VA", [1, 2, -3, 0, 0, 0, 0, 0]),
        Self::si("C", [0, 0, 1, 1, 0, 0, 0, 0]),
        Self::si("V", [1, 2, -3, -1, 0, 0, 0, 0]),
        Self::si("F", [-1, -2, 4, 2, 0, 0, 0, 0]),
        Self::si("Ohm", [1, 2, -3, -2, 0, 0, 0, 0]),
        Self::si("ohm", [1, 2, -3, -2, 0, 0, 0, 0]),
        Self::si("Ω", [1, 2, -3, -2, 0, 0, 0, 0]),
        Self::si("S", [-1, -2, 3, 2, 0, 0, 0, 0]),
        Self::si("Wb", [1, 2, -2, -1, 0, 0, 0, 0]),
        Self::si("T", [1, 0, -2, -1, 0, 0, 0, 0]),
        Self::si("H", [1, 2, -2, -2, 0, 0, 0, 0]),
        Self::si("lm", [0, 0, 0, 0, 0, 0, 1, 2]),
        Self::si("lx", [0, -2, 0, 0, 0, 0, 1, 2]),
        Self::si("L", VOLUME).by(1e3),
        Self::si("l", VOLUME).by(1e3),
        Self::si("bar", PRESSURE).times(1e5),
        Self::si("Wh", ENERGY).times(3600.0),
        Self::si("Ah", [0, 0, 1, 1, 0, 0, 0, 0]).times(3600.0),
        Self::of("%", [0; 8]).by(1e2),
        Self::of("ppm", [0; 8]).by(1e6),
        Self::of("min", [0, 0, 1, 0, 0, 0, 0, 0]).times(60.0),
        Self::of("h", [0, 0, 1, 0, 0, 0, 0, 0]).times(3600.0),
        Self::of("d", [0, 0, 1, 0, 0, 0, 0, 0]).times(86_400.0),
        Self::of("t", MASS).times(1e3),
        Self::of("deg", ANGLE).by(180.0).turning(),
        Self::of("°", ANGLE).by(180.0).turning(),
        Self::of("arcmin", ANGLE).by(10_800.0).turning(),
        Self::of("arcsec", ANGLE).by(648_000.0).turning(),
        Self::of("rev", ANGLE).times(2.0).turning(),
        Self::of("rpm", [0, 0, -1, 0, 0, 0, 0, 1])
            .by(30.0)
            .turning(),
        Self::of("degC", TEMPERATURE).with_zero(273.15),
        Self::of("°C", TEMPERATURE).with_zero(273.15),
        Self::of("degF", TEMPERATURE)
            .times(5.0)
            .by(9.0)
            .with_zero(459.67),
        Self::of("°F", TEMPERATURE)
            .times(5.0)
            .by(9.0)
            .with_zero(459.67),
        Self::of("in", LENGTH).times(254.0).by(1e4),
        Self::of("ft", LENGTH).times(3048.0).by(1e4),
        Self::of("lb", MASS).times(45_359_237.0).by(1e8),
        Self::of("lbf", FORCE).times(44_482_216_152_605.0).by(1e13),
        Self::of("psi", PRESSURE)
            .times(44_482_216_152_605.0)
            .by(6_451_600_000.0),
        Self::of("atm", PRESSURE).times(101_325.0),
    ];
}

const MASS: [i32; 8] = [1, 0, 0, 0, 0, 0, 0, 0];
const LENGTH: [i32; 8] = [0, 1, 0, 0, 0, 0, 0, 0];
const TEMPERATURE: [i32; 8] = [0, 0, 0, 0, 1, 0, 0, 0];
const ANGLE: [i32; 8] = [0, 0, 0, 0, 0, 0, 0, 1];
const VOLUME: [i32; 8] = [0, 3, 0, 0, 0, 0, 0, 0];
const FORCE: [i32; 8] = [1, 1, -2, 0, 0, 0, 0, 0];
const PRESSURE: [i32; 8] = [1, -1, -2, 0, 0, 0, 0, 0];
const ENERGY: [i32; 8] = [1, 2, -2, 0, 0, 0, 0, 0];

/// Prefixes and their factors, as numerator and denominator.
const PREFIXES: [(&str, f64, f64); 22] = [
    ("da", 1e1, 1.0),
    ("h", 1e2, 1.0),
    ("k", 1e3, 1.0),
    ("M", 1e6, 1.0),
    ("G", 1e9, 1.0),
    ("T", 1e12, 1.0),
    ("P", 1e15, 1.0),
    ("E", 1e18, 1.0),
    ("Z", 1e21, 1.0),
    ("Y", 1e24, 1.0),
    ("d", 1.0, 1e1),
    ("c", 1.0, 1e2),
    ("m", 1.0, 1e3),
    ("u", 1.0, 1e6),
    ("µ", 1.0, 1e6), // U+00B5
    ("μ", 1.0, 1e6), // U+03BC
    ("n", 1.0, 1e9),
    ("p", 1.0, 1e12),
    ("f", 1.0, 1e15),
    ("a", 1.0, 1e18),
    ("z", 1.0, 1e21),
    ("y", 1.0, 1e24),
];

/// Lists every symbol, plain and with each prefix that it accepts.
pub(super) fn all() -> impl Iterator<Item = String> {
    Known::ALL.iter().flat_map(|symbol| {
        let prefixes = PREFIXES.iter().filter(|_| symbol.takes_prefix);
        let prefixed = prefixes.map(|(prefix, ..)| format!("{prefix}{}", symbol.symbol));
        std::iter::once(symbol.symbol.to_owned()).chain(prefixed)
    })
}

/// Looks up the unit of a symbol, first without and then with a prefix.
pub(super) fn known(symbol: &str) -> Option<Unit> {
    if let Some(exact) = Known::ALL.iter().find(|exact| exact.symbol == symbol) {
        return Some(exact.unit(1.0, 1.0));
    }
    PREFIXES
        .iter()
        .find_map(|(prefix, numerator, denominator)| {
            let rest = symbol.strip_prefix(prefix)?;
            let is_it = |exact: &&Known| exact.takes_prefix && exact.symbol == rest;
            let exact = Known::ALL.iter().find(is_it)?;
            Some(exact.unit(*numerator, *denominator))
        })
}

/// Words and abbreviations for units, in lower case, and their symbols.
const WORDS: [(&str, &str); 30] = [
    ("sec", "s"),
    ("second", "s"),
    ("msec", "ms"),
    ("usec", "us"),
    ("nsec", "ns"),
    ("millisecond", "ms"),
    ("microsecond", "us"),
    ("minute", "min"),
    ("hr", "h"),
    ("hour", "h"),
    ("day", "d"),
    ("meter", "m"),
    ("metre", "m"),
    ("millimeter", "mm"),
    ("millimetre", "mm"),
    ("centimeter", "cm"),
    ("centimetre", "cm"),
    ("inch", "in"),
    ("feet", "ft"),
    ("newton", "N"),
    ("pascal", "Pa"),
    ("volt", "V"),
    ("amp", "A"),
    ("ampere", "A"),
    ("watt", "W"),
    ("joule", "J"),
    ("kelvin", "K"),
    ("celsius", "degC"),
    ("degree", "deg"),
    ("radian", "rad"),
];

/// Returns the symbol of the unit that a word names, in the singular or the plural.
#[must_use]
pub fn symbol_of_word(word: &str) -> Option<&'static str> {
    let word = word.to_ascii_lowercase();
    let singular = word.strip_suffix('s').unwrap_or(&word);
    let is_it = |(entry, _): &&(&str, &str)| *entry == word || *entry == singular;
    WORDS.iter().find(is_it).map(|(_, symbol)| *symbol)
}

/// Formats the symbols close to an unknown one as the end of a message: the symbol of a word, or else symbols that
/// differ only in case, or else those with a similar spelling; empty if there is none.
pub(super) fn near(symbol: &str) -> String {
    let is_same = |candidate: &String| candidate.to_lowercase() == symbol.to_lowercase();
    let mut close: Vec<String> = match symbol_of_word(symbol) {
        Some(meant) => vec![meant.into()],
        None => all().filter(is_same).collect(),
    };
    if close.is_empty() {
        let nearest = nearest(symbol, Known::ALL.iter().map(|candidate| candidate.symbol));
        close = nearest.into_iter().map(Into::into).collect();
    }
    close.truncate(3);
    match close.is_empty() {
        true => String::new(),
        false => format!("; nearest: {}", listed(&close)),
    }
}

impl Known {
    pub(super) fn unit(&self, numerator: f64, denominator: f64) -> Unit {
        let (numerator, denominator) = (self.numerator * numerator, self.denominator * denominator);
        // A kilogram is 1/1, not 1000/1000.
        let is_one = numerator == denominator;
        Unit {
            halves: self.exponents.map(|exponent| 2 * exponent),
            numerator: if is_one { 1.0 } else { numerator },
            denominator: if is_one { 1.0 } else { denominator },
            half_turns: 2 * self.turns,
            zero: self.zero,
        }
    }
}
