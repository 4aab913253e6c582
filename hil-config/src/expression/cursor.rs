//! Cursor over the tokens of a text, used by both parsers.
//!
//! Advances token by token, limits the nesting and formats the errors; independent of any grammar.

use std::ops::Range;

use super::lexer::{Token, TokenKind, tokens};
use super::{ExpressionError, quantity, spellings};

/// Deepest nesting of parentheses, calls, signs and operators.
const NESTING: usize = 64;

/// Position in a text that is split into tokens.
pub(crate) struct Cursor<'a> {
    pub text: &'a str,
    /// Tokens, of which the last is [`TokenKind::End`].
    pub tokens: Vec<Token>,
    /// Index of the next token.
    pub at: usize,
    nesting: usize,
}

impl<'a> Cursor<'a> {
    /// Creates a cursor at the first token.
    pub(crate) fn new(text: &'a str) -> Result<Self, ExpressionError> {
        Ok(Self {
            text,
            tokens: tokens(text)?,
            at: 0,
            nesting: 0,
        })
    }

    pub(crate) fn peek(&self) -> &Token {
        &self.tokens[self.at]
    }

    /// Takes the next token; never advances past the end.
    pub(crate) fn next(&mut self) -> Token {
        let token = self.peek().clone();
        if token.kind != TokenKind::End {
            self.at += 1;
        }
        token
    }

    pub(crate) fn accept(&mut self, symbol: &str) -> bool {
        self.accept_if(|kind| matches!(kind, TokenKind::Symbol(text) if *text == symbol))
    }

    pub(crate) fn accept_word(&mut self, word: &str) -> bool {
        self.accept_if(|kind| matches!(kind, TokenKind::Name(name) if name == word))
    }

    fn accept_if(&mut self, fits: impl FnOnce(&TokenKind) -> bool) -> bool {
        let fits_here = fits(&self.peek().kind);
        self.at += usize::from(fits_here);
        fits_here
    }

    pub(crate) fn expect(&mut self, symbol: &str, expected: &str) -> Result<(), ExpressionError> {
        if self.accept(symbol) {
            return Ok(());
        }
        Err(self.unexpected(self.peek(), expected))
    }

    /// Refuses tokens after the last rule.
    pub(crate) fn expect_end(&self) -> Result<(), ExpressionError> {
        match self.peek().kind {
            TokenKind::End => Ok(()),
            _ => Err(self.unexpected(self.peek(), "an operator or the end")),
        }
    }

    /// Enters a nesting level; the limit keeps deep nesting from exhausting the stack.
    pub(crate) fn nest(&mut self) -> Result<(), ExpressionError> {
        if self.nesting == NESTING {
            let message = format!("nesting deeper than {NESTING} levels");
            return Err(self.error(self.peek().span.clone(), message));
        }
        self.nesting += 1;
        Ok(())
    }

    /// Leaves a nesting level.
    pub(crate) const fn leave(&mut self) {
        self.nesting -= 1;
    }

    pub(crate) fn unexpected(&self, token: &Token, expectation: &str) -> ExpressionError {
        let word = &self.text[token.span.clone()];
        let actual = match &token.kind {
            TokenKind::End => "the end".into(),
            _ => format!("`{word}`"),
        };
        let advice = self.advice(token).unwrap_or_default();
        self.error(
            token.span.clone(),
            format!("expected {expectation}, found {actual}{advice}"),
        )
    }

    /// Guesses the meaning of a misplaced name: an operator of another language, or a unit.
    fn advice(&self, token: &Token) -> Option<String> {
        let TokenKind::Name(name) = &token.kind else {
            return None;
        };
        if let Some(equivalent) = spellings::of_operator(name) {
            return Some(format!("; write `{equivalent}`"));
        }
        let place = self.tokens.iter().position(|other| other == token)?;
        let before = self.tokens.get(place.checked_sub(1)?)?;
        if !matches!(before.kind, TokenKind::Number(_)) {
            return None;
        }
        let unit = quantity::unreadable(name)?;
        let words = self.tokens[place..]
            .iter()
            .map_while(|word| match &word.kind {
                TokenKind::Name(name) => Some(name.as_str()),
                _ => None,
            });
        Some(match quantity::joined(words) {
            Some(symbol) => format!("; the unit `{symbol}` is written without a space"),
            None => format!("; {unit}"),
        })
    }

    pub(crate) fn error(&self, span: Range<usize>, message: impl Into<String>) -> ExpressionError {
        ExpressionError::new(self.text, span, message)
    }
}
