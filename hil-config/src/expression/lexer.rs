//! Tokens of an expression.

use std::ops::Range;

use super::quantity::{self, Quantity};
use super::{ExpressionError, spellings};

/// Token and its bytes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Token {
    pub kind: TokenKind,
    pub span: Range<usize>,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum TokenKind {
    Number(f64),
    /// Number with a unit.
    Quantity(Quantity),
    /// A name, with dots if it has parts.
    Name(String),
    /// An operator, a parenthesis, a bracket or a comma.
    Symbol(&'static str),
    End,
}

/// Prefix operators of formulas.
pub(crate) const PREFIXES: [&str; 6] = [
    "always",
    "eventually",
    "historically",
    "once",
    "rise",
    "fall",
];
/// Words that end a comparison in a formula.
pub(crate) const JOINTS: [&str; 5] = ["and", "or", "implies", "until", "since"];

/// Longer symbols first, so that `<=` is not read as `<`.
const SYMBOLS: [&str; 15] = [
    "<=", ">=", "==", "!=", "<", ">", "+", "-", "*", "/", "(", ")", "[", "]", ",",
];

/// Splits an expression into tokens, of which the last is [`TokenKind::End`].
pub(crate) fn tokens(text: &str) -> Result<Vec<Token>, ExpressionError> {
    let mut tokens = Vec::new();
    let mut at = 0;
    while let Some(first) = text[at..].chars().next() {
        let rest = &text[at..];
        let (kind, length) = if first.is_whitespace() {
            at += first.len_utf8();
            continue;
        } else if first.is_ascii_digit() || first == '.' {
            number(text, at)?
        } else if let Some((length, message)) = spellings::of_symbol(rest, expects_operand(&tokens))
        {
            let span = at..at + length;
            return Err(ExpressionError::new(text, span, message));
        } else if starts_name(first) {
            let length = rest
                .find(|c: char| !(starts_name(c) || c.is_ascii_digit() || c == '.'))
                .unwrap_or(rest.len());
            let name = &rest[..length];
            let whole = name.split('.').all(|part| part.starts_with(starts_name));
            if !whole {
                let message = format!("`{name}` is not a name");
                return Err(ExpressionError::new(text, at..at + length, message));
            }
            (TokenKind::Name(name.into()), length)
        } else if let Some(symbol) = SYMBOLS.iter().find(|symbol| rest.starts_with(**symbol)) {
            (TokenKind::Symbol(symbol), symbol.len())
        } else {
            let span = at..at + first.len_utf8();
            let message = format!("unexpected {first:?}");
            return Err(ExpressionError::new(text, span, message));
        };
        tokens.push(Token {
            kind,
            span: at..at + length,
        });
        at += length;
    }
    tokens.push(Token {
        kind: TokenKind::End,
        span: at..at,
    });
    Ok(tokens)
}

/// Returns `true` if an operand is expected after these tokens.
fn expects_operand(words: &[Token]) -> bool {
    let Some(last) = words.last() else {
        return true;
    };
    match &last.kind {
        TokenKind::Number(_) | TokenKind::Quantity(_) | TokenKind::Symbol(")") => false,
        TokenKind::Name(name) => {
            let mut operators = PREFIXES.iter().chain(&JOINTS).chain(&["not"]);
            operators.any(|operator| operator == name)
        }
        TokenKind::Symbol(_) | TokenKind::End => true,
    }
}

fn starts_name(c: char) -> bool {
    c.is_ascii_alphabetic() || c == '_'
}

/// Reads a number with its unit, if there is one; also returns the length.
fn number(text: &str, at: usize) -> Result<(TokenKind, usize), ExpressionError> {
    let rest = &text[at..];
    if let Some((length, message)) = spellings::of_range(rest) {
        return Err(ExpressionError::new(text, at..at + length, message));
    }
    let digits = quantity::number_length(rest);
    let value = rest[..digits]
        .parse::<f64>()
        .ok()
        .filter(|value| value.is_finite());
    let behind = rest[digits..].trim_start();
    let begin = rest.len() - behind.len();
    if let (Some(value_si), Some((unit, length))) = (value, quantity::unit(behind)) {
        let end = begin + length;
        let span = at..at + end;
        if unit.has_own_zero() {
            let kelvin = unit.in_base_units(value_si);
            let message = format!(
                "`{}` has an offset from absolute zero; write a plain number, in the unit of the signal, or `{kelvin:?} K`",
                &rest[..end]
            );
            return Err(ExpressionError::new(text, span, message));
        }
        if let Some(factors) = spellings::of_percentage(&behind[..length]) {
            let (product, part) = (&rest[..end], value_si / 100.0);
            let message = format!(
                "`{product}` is a percentage times a unit; write `{part:?} {factors}` (`%` is not a remainder operator)"
            );
            return Err(ExpressionError::new(text, span, message));
        }
        let symbol = behind[..length].into();
        let quantity = Quantity {
            written: value_si,
            unit,
            symbol,
            text: rest[..end].into(),
            span,
        };
        return Ok((TokenKind::Quantity(quantity), end));
    }
    let word = meant_length(rest);
    match value {
        Some(value) if word == digits => Ok((TokenKind::Number(value), digits)),
        _ => {
            let unit = value.and_then(|_| quantity::unreadable(&rest[digits..]));
            let unit = unit.map_or(String::new(), |unit| format!(": {unit}"));
            let message = format!("`{}` is not a number{unit}", &rest[..word]);
            Err(ExpressionError::new(text, at..at + word, message))
        }
    }
}

/// Returns the length of a presumed number: digits, points, letters, and an exponent with its sign.
fn meant_length(text: &str) -> usize {
    let mut last = ' ';
    text.find(|c: char| {
        let belongs = c.is_ascii_alphanumeric()
            || c == '.'
            || (matches!(c, '+' | '-') && matches!(last, 'e' | 'E'));
        last = c;
        !belongs
    })
    .unwrap_or(text.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_names_and_symbols_are_distinguished() {
        let kinds: Vec<TokenKind> = tokens("1.5e-3<=truth.x_m-2")
            .expect("reads")
            .into_iter()
            .map(|token| token.kind)
            .collect();
        assert_eq!(
            kinds,
            [
                TokenKind::Number(1.5e-3),
                TokenKind::Symbol("<="),
                TokenKind::Name("truth.x_m".into()),
                TokenKind::Symbol("-"),
                TokenKind::Number(2.0),
                TokenKind::End,
            ]
        );
    }

    #[test]
    fn times_with_units_equal_the_same_times_in_seconds() {
        for (text, time_s) in [
            ("7s", 7.0),
            ("200ms", 0.2),
            ("1.5us", 1.5e-6),
            ("3ns", 3e-9),
            ("1e-1s", 0.1),
        ] {
            let words = tokens(text).expect(text);
            let TokenKind::Quantity(quantity) = &words[0].kind else {
                panic!("{text}: {words:?}");
            };
            assert_eq!(quantity.time_s(), Some(time_s), "{text}");
        }
    }

    #[test]
    fn an_invalid_token_is_refused_at_its_place() {
        for (text, span) in [
            ("1 + 2x", 4..6),
            ("1e999", 0..5),
            ("a & b", 2..3),
            ("truth.", 0..6),
            ("a..b", 0..4),
            ("1.2.3", 0..5),
            ("µ", 0..2),
            ("5 degC", 0..6),
            ("1 + 5em", 4..7),
            ("truth.1x", 0..8),
        ] {
            assert_eq!(tokens(text).expect_err(text).span, span, "{text}");
        }
    }

    #[test]
    fn ranges_and_remainders_of_other_languages_are_refused_with_the_syntax_of_this_one() {
        for (text, span, fragment) in [
            ("always[0s..5s](x < 1)", 7..13, "write `0s, 5s`"),
            ("always[0..=5](x < 1)", 7..12, "write `0, 5`"),
            ("[1.5 s .. 2 s]", 7..9, "write `,`"),
            ("x < 2 % m", 4..9, "write `0.02 m`"),
            ("x < 5% mm", 4..9, "write `0.05 mm`"),
            ("x % 2 < 1", 2..3, "no operator `%` for a remainder"),
        ] {
            let error = tokens(text).expect_err(text);
            assert_eq!(error.span, span, "{text}");
            assert!(
                error.message.contains(fragment),
                "{text}: {}",
                error.message
            );
        }
        for text in ["2%", "2 %", "5 %/s", "x < 2% and y < 1 m", "2 % * m"] {
            tokens(text).expect(text);
        }
    }
}
