//! Numbers with units: `5 cm`, `2%`, `500 ms`.
//!
//! A number with a unit counts in coherent SI units, so `5 cm` is 0.05 in any comparison; the unit check refuses to
//! combine it with a signal in another unit. Independent of the signals: a formula has one meaning for the check, the
//! plant and every reader of a recording.
//!
//! A unit follows its number with or without a space. A `/` belongs to the unit only without spaces around it and
//! before another unit: `5 m/s` is a speed, `5 m / s` a quotient.

use std::ops::Range;

use shared_types::units::{Unit, Unreadable};

/// Number with a unit.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Quantity {
    /// Number as written.
    pub written: f64,
    /// Unit as written.
    pub unit: Unit,
    /// Unit as text.
    pub symbol: String,
    /// Number and unit as text.
    pub text: String,
    /// Bytes of number and unit.
    pub span: Range<usize>,
}

impl Quantity {
    /// Returns the value in coherent SI units.
    pub(crate) fn value(&self) -> f64 {
        self.unit.in_base_units(self.written)
    }

    /// Returns the value in s if it is a time.
    pub(crate) fn time_s(&self) -> Option<f64> {
        (self.unit.coherent() == "s").then(|| self.value())
    }

    /// Returns advice to write the symbol without spaces, if the result is a unit of time.
    pub(crate) fn joined_time(&self) -> Option<String> {
        let symbol: String = self.symbol.split(' ').collect();
        let unit = Unit::parse(&symbol).ok()?;
        let is_time = symbol != self.symbol && unit.coherent() == "s";
        is_time.then(|| format!(" (`{symbol}` without a space)"))
    }
}

/// Returns the length of a leading number: digits, a point, an exponent.
pub(super) fn number_length(text: &str) -> usize {
    let digits = |text: &str| text.bytes().take_while(u8::is_ascii_digit).count();
    let mut length = digits(text);
    if text[length..].starts_with('.') {
        length += 1 + digits(&text[length + 1..]);
    }
    if let Some(exponent) = text[length..].strip_prefix(['e', 'E']) {
        let sign = usize::from(exponent.starts_with(['+', '-']));
        if let count @ 1.. = digits(&exponent[sign..]) {
            length += 1 + sign + count;
        }
    }
    length
}

/// Returns the longest leading unit of a text and its length; `None` if there is none.
pub(super) fn unit(text: &str) -> Option<(Unit, usize)> {
    let (mut unit, mut length) = (None, 0);
    let mut end = factor_length(text);
    while end > length
        && let Ok(read) = Unit::parse(&text[..end])
    {
        (unit, length) = (Some(read), end);
        let rest = &text[length..];
        end += if let Some(divisor) = rest.strip_prefix('/') {
            match factor_length(divisor) {
                0 => break,
                factor => 1 + factor,
            }
        } else {
            let spaces = rest.len() - rest.trim_start_matches(' ').len();
            match factor_length(&rest[spaces..]) {
                0 => break,
                factor => spaces + factor,
            }
        };
    }
    Some((unit?, length))
}

/// Parses the leading word of a text as a unit, to find out why it is invalid.
pub(super) fn unreadable(text: &str) -> Option<Unreadable> {
    match factor_length(text) {
        0 => None,
        length => Unit::parse(&text[..length]).err(),
    }
}

/// Returns the unit that consecutive words form if written together, such as `cm` for `c m`.
pub(super) fn joined<'a>(words: impl Iterator<Item = &'a str>) -> Option<String> {
    let mut symbol = String::new();
    let mut together = words.map(|word| {
        symbol += word;
        symbol.clone()
    });
    together.find(|symbol| Unit::parse(symbol).is_ok())
}

/// Returns the length of a symbol with its exponent, or of a parenthesis or root of units; 0 for anything else.
fn factor_length(text: &str) -> usize {
    let word = if text.starts_with('(') {
        0
    } else {
        let mut last = ' ';
        let end = text.find(|c: char| {
            let belongs = c.is_alphanumeric()
                || matches!(c, '%' | '°' | '^' | '.' | '·' | '⋅' | '⁻' | '_')
                || (c == '-' && last == '^');
            last = c;
            !belongs
        });
        end.unwrap_or(text.len())
    };
    let is_symbol = |c: char| c.is_alphabetic() || matches!(c, '%' | '°');
    match &text[..word] {
        "" | "sqrt" if text[word..].starts_with('(') => match parenthesis_length(&text[word..]) {
            0 => 0,
            length => word + length,
        },
        symbol if symbol.starts_with(is_symbol) => word,
        _ => 0,
    }
}

/// Returns the length of a leading parenthesis; 0 if it is longer than any unit.
fn parenthesis_length(text: &str) -> usize {
    const LONGEST: usize = 64;
    let mut depth = 0_usize;
    for (at, c) in text.char_indices().take(LONGEST) {
        match c {
            '(' => depth += 1,
            ')' if depth == 1 => return at + 1,
            ')' => depth -= 1,
            _ => {}
        }
    }
    0
}
