//! Words of an expression.

use std::ops::Range;

use super::ExpressionError;

/// A word and its bytes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Token {
    pub kind: TokenKind,
    pub span: Range<usize>,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum TokenKind {
    Number(f64),
    /// A name, with dots if it has parts.
    Name(String),
    /// An operator, a parenthesis or a comma.
    Symbol(&'static str),
    End,
}

/// Longer ones first, so that `<=` is not read as `<`.
const SYMBOLS: [&str; 13] = [
    "<=", ">=", "==", "!=", "<", ">", "+", "-", "*", "/", "(", ")", ",",
];

/// Splits an expression into words; the last one is [`TokenKind::End`].
pub(crate) fn tokens(text: &str) -> Result<Vec<Token>, ExpressionError> {
    let mut tokens = Vec::new();
    let mut at = 0;
    while let Some(first) = text[at..].chars().next() {
        let rest = &text[at..];
        let (kind, length) = if first.is_whitespace() {
            at += first.len_utf8();
            continue;
        } else if first.is_ascii_digit() || first == '.' {
            let length = number_length(rest);
            match rest[..length].parse::<f64>() {
                Ok(value) if value.is_finite() => (TokenKind::Number(value), length),
                _ => {
                    let message = format!("`{}` is not a number", &rest[..length]);
                    return Err(ExpressionError::new(text, at..at + length, message));
                }
            }
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

fn starts_name(c: char) -> bool {
    c.is_ascii_alphabetic() || c == '_'
}

/// Length of what was meant as a number: digits, points, and an exponent with its sign.
fn number_length(text: &str) -> usize {
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
    fn numbers_names_and_symbols_are_told_apart() {
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
    fn what_is_no_word_is_refused_where_it_stands() {
        for (text, span) in [
            ("1 + 2x", 4..6),
            ("1e999", 0..5),
            ("a & b", 2..3),
            ("truth.", 0..6),
            ("a..b", 0..4),
            ("1.2.3", 0..5),
            ("µ", 0..2),
            ("truth.1x", 0..8),
        ] {
            assert_eq!(tokens(text).expect_err(text).span, span, "{text}");
        }
    }
}
