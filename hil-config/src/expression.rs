//! The expression grammar.

/// An expression.
#[derive(Clone, Debug)]
pub struct Expression;
