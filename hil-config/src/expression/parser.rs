//! From words to operations in Polish order, by recursive descent: one function per rule of the
//! grammar.

use std::ops::Range;

use super::lexer::{Token, TokenKind, tokens};
use super::program::{Binary, Op, STACK, Unary, needed_stack};
use super::{Expression, ExpressionError, Name, Reduced, ReductionKind};

/// Deepest nesting of parentheses, calls and signs.
const NESTING: usize = 64;

/// Words with a meaning of their own.
const WORDS: [&str; 3] = ["and", "or", "not"];

const COMPARISONS: [(&str, Binary); 6] = [
    ("<", Binary::Less),
    ("<=", Binary::LessOrEqual),
    (">", Binary::Greater),
    (">=", Binary::GreaterOrEqual),
    ("==", Binary::Equal),
    ("!=", Binary::NotEqual),
];

/// The functions of expressions.
pub(crate) fn functions() -> impl Iterator<Item = &'static str> {
    let reductions = ReductionKind::ALL.iter().map(|kind| kind.name());
    ["abs", "sqrt"].into_iter().chain(reductions)
}

/// Whether a name means something in an expression and so cannot be a derived signal's.
pub(crate) fn is_reserved(name: &str) -> bool {
    WORDS.contains(&name)
        || matches!(name, "abs" | "sqrt")
        || ReductionKind::of_name(name).is_some()
}

pub(super) fn parse(text: &str) -> Result<Expression, ExpressionError> {
    let mut parser = Parser {
        text,
        tokens: tokens(text)?,
        at: 0,
        nesting: 0,
        ops: Vec::new(),
        names: Vec::new(),
        reductions: Vec::new(),
    };
    parser.disjunction()?;
    let last = parser.next();
    if last.kind != TokenKind::End {
        return Err(parser.unexpected(&last, "an operator or the end"));
    }
    let expression = Expression {
        text: text.into(),
        ops: parser.ops,
        names: parser.names,
        reductions: parser.reductions,
    };
    let programs = expression.reductions.iter().map(|reduced| &reduced.ops);
    if programs
        .chain([&expression.ops])
        .any(|ops| needed_stack(ops) > STACK)
    {
        let message = format!(
            "more than {STACK} values wait for their operator; use a derived signal for a part"
        );
        return Err(expression.error(0..text.len(), &message));
    }
    if !expression.reductions.is_empty()
        && let Some(name) = expression.names.iter().find(|name| !name.reduced)
    {
        let message = format!(
            "`{}` has a value for every step and cannot stand beside a reduction",
            name.path
        );
        return Err(expression.error(name.span.clone(), &message));
    }
    Ok(expression)
}

struct Parser<'a> {
    text: &'a str,
    tokens: Vec<Token>,
    at: usize,
    nesting: usize,
    ops: Vec<Op>,
    names: Vec<Name>,
    reductions: Vec<Reduced>,
}

type Parsed = Result<(), ExpressionError>;

impl Parser<'_> {
    fn disjunction(&mut self) -> Parsed {
        self.conjunction()?;
        while self.accept_word("or") {
            self.conjunction()?;
            self.ops.push(Op::Binary(Binary::Or));
        }
        Ok(())
    }

    fn conjunction(&mut self) -> Parsed {
        self.negation()?;
        while self.accept_word("and") {
            self.negation()?;
            self.ops.push(Op::Binary(Binary::And));
        }
        Ok(())
    }

    fn negation(&mut self) -> Parsed {
        if !self.accept_word("not") {
            return self.comparison();
        }
        self.nested(Self::negation)?;
        self.ops.push(Op::Unary(Unary::Not));
        Ok(())
    }

    fn comparison(&mut self) -> Parsed {
        self.sum()?;
        let Some(operator) = self.accept_comparison() else {
            return Ok(());
        };
        self.sum()?;
        self.ops.push(Op::Binary(operator));
        let next = self.peek().clone();
        if self.accept_comparison().is_some() {
            return Err(self.error(next.span, "two comparisons in a row; join them by `and`"));
        }
        Ok(())
    }

    fn accept_comparison(&mut self) -> Option<Binary> {
        COMPARISONS
            .iter()
            .find(|(symbol, _)| self.accept(symbol))
            .map(|(_, operator)| *operator)
    }

    fn sum(&mut self) -> Parsed {
        self.product()?;
        loop {
            let operator = if self.accept("+") {
                Binary::Add
            } else if self.accept("-") {
                Binary::Subtract
            } else {
                return Ok(());
            };
            self.product()?;
            self.ops.push(Op::Binary(operator));
        }
    }

    fn product(&mut self) -> Parsed {
        self.sign()?;
        loop {
            let operator = if self.accept("*") {
                Binary::Multiply
            } else if self.accept("/") {
                Binary::Divide
            } else {
                return Ok(());
            };
            self.sign()?;
            self.ops.push(Op::Binary(operator));
        }
    }

    fn sign(&mut self) -> Parsed {
        if !self.accept("-") {
            return self.primary();
        }
        self.nested(Self::sign)?;
        self.ops.push(Op::Unary(Unary::Negate));
        Ok(())
    }

    fn primary(&mut self) -> Parsed {
        let token = self.next();
        match token.kind {
            TokenKind::Number(value) => self.ops.push(Op::Constant(value)),
            TokenKind::Symbol("(") => {
                self.nested(Self::disjunction)?;
                self.expect(")", "an operator or `)`")?;
            }
            TokenKind::Name(ref name) if !WORDS.contains(&name.as_str()) => {
                if self.accept("(") {
                    return self.nested(|parser| parser.call(name, token.span.clone()));
                }
                if is_reserved(name) {
                    let message = format!("`{name}` is a function and needs a `(`");
                    return Err(self.error(token.span, message));
                }
                self.ops.push(Op::Name(self.names.len()));
                self.names.push(Name {
                    path: name.clone(),
                    span: token.span,
                    reduced: false,
                });
            }
            _ => return Err(self.unexpected(&token, "a number, a signal or `(`")),
        }
        Ok(())
    }

    /// A call behind its opening parenthesis.
    fn call(&mut self, name: &str, span: Range<usize>) -> Parsed {
        let (first_op, first_name) = (self.ops.len(), self.names.len());
        let first_reduction = self.reductions.len();
        self.disjunction()?;
        let mut arguments = 1;
        while self.accept(",") {
            self.disjunction()?;
            arguments += 1;
        }
        let wanted = if arguments == 1 { "`,` or `)`" } else { "`)`" };
        self.expect(")", wanted)?;
        let op = match (name, arguments) {
            ("abs", 1) => Op::Unary(Unary::Abs),
            ("sqrt", 1) => Op::Unary(Unary::Sqrt),
            ("min", 2) => Op::Binary(Binary::Min),
            ("max", 2) => Op::Binary(Binary::Max),
            _ => match ReductionKind::of_name(name) {
                Some(kind) if arguments == 1 => {
                    if self.reductions.len() > first_reduction {
                        return Err(self.error(span, "a reduction of a reduction"));
                    }
                    let ops = self.ops.split_off(first_op);
                    for name in &mut self.names[first_name..] {
                        name.reduced = true;
                    }
                    self.reductions.push(Reduced { kind, ops, span });
                    Op::Reduced(self.reductions.len() - 1)
                }
                _ => return Err(self.no_such_call(name, arguments, span)),
            },
        };
        self.ops.push(op);
        Ok(())
    }

    fn no_such_call(&self, name: &str, arguments: usize, span: Range<usize>) -> ExpressionError {
        if is_reserved(name) {
            let takes = match name {
                "min" | "max" => "one or two values",
                _ => "one value",
            };
            let message = format!("`{name}` takes {takes}, not {arguments}");
            return self.error(span, message);
        }
        let known: Vec<&str> = functions().collect();
        let known = known.join(", ");
        let message = format!("unknown function `{name}`; there are {known}");
        let mut error = self.error(span, message);
        error.nearest = shared_types::table::nearest(name, functions())
            .into_iter()
            .map(Into::into)
            .collect();
        error
    }

    /// Runs a rule one level deeper; deep nesting must not exhaust the stack.
    fn nested(&mut self, rule: impl FnOnce(&mut Self) -> Parsed) -> Parsed {
        if self.nesting == NESTING {
            let span = self.peek().span.clone();
            let message = format!("nesting deeper than {NESTING} levels");
            return Err(self.error(span, message));
        }
        self.nesting += 1;
        rule(self)?;
        self.nesting -= 1;
        Ok(())
    }

    fn peek(&self) -> &Token {
        &self.tokens[self.at]
    }

    /// The next word; the end is never left.
    fn next(&mut self) -> Token {
        let token = self.peek().clone();
        if token.kind != TokenKind::End {
            self.at += 1;
        }
        token
    }

    fn accept(&mut self, symbol: &str) -> bool {
        let found = matches!(self.peek().kind, TokenKind::Symbol(found) if found == symbol);
        if found {
            self.at += 1;
        }
        found
    }

    fn accept_word(&mut self, word: &str) -> bool {
        let found = matches!(&self.peek().kind, TokenKind::Name(name) if name == word);
        if found {
            self.at += 1;
        }
        found
    }

    fn expect(&mut self, symbol: &str, wanted: &str) -> Parsed {
        if self.accept(symbol) {
            return Ok(());
        }
        let token = self.peek().clone();
        Err(self.unexpected(&token, wanted))
    }

    fn unexpected(&self, token: &Token, wanted: &str) -> ExpressionError {
        let found = match &token.kind {
            TokenKind::End => "the end".into(),
            TokenKind::Time(_) => format!("the time `{}`", &self.text[token.span.clone()]),
            _ => format!("`{}`", &self.text[token.span.clone()]),
        };
        let message = format!("expected {wanted}, found {found}");
        self.error(token.span.clone(), message)
    }

    fn error(&self, span: Range<usize>, message: impl Into<String>) -> ExpressionError {
        ExpressionError::new(self.text, span, message)
    }
}
