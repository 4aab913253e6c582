//! Recursive-descent parser from tokens to operations in reverse Polish order: one function per rule of the grammar.

use std::ops::Range;

use super::cursor::Cursor;
use super::lexer::TokenKind;
use super::program::{Binary, Op, STACK, Unary, needed_stack};
use super::quantity::Quantity;
use super::{Expression, ExpressionError, Name, Reduced, ReductionKind, spellings};

/// Reserved words.
const WORDS: [&str; 3] = ["and", "or", "not"];

/// Function that no name is reserved for: only its parenthesis makes it a call.
pub(crate) const VALID: &str = "valid";

const COMPARISONS: [(&str, Binary); 6] = [
    ("<", Binary::Less),
    ("<=", Binary::LessOrEqual),
    (">", Binary::Greater),
    (">=", Binary::GreaterOrEqual),
    ("==", Binary::Equal),
    ("!=", Binary::NotEqual),
];

/// Lists the functions of expressions.
pub(crate) fn functions() -> impl Iterator<Item = &'static str> {
    let reductions = ReductionKind::ALL.iter().map(|kind| kind.name());
    ["abs", "sqrt", VALID].into_iter().chain(reductions)
}

/// Returns `true` if a name is reserved in expressions and so cannot name a derived signal.
pub(crate) fn is_reserved(name: &str) -> bool {
    WORDS.contains(&name)
        || matches!(name, "abs" | "sqrt")
        || ReductionKind::of_name(name).is_some()
}

pub(super) fn parse(text: &str) -> Result<Expression, ExpressionError> {
    let mut parser = Parser {
        words: Cursor::new(text)?,
        ops: Vec::new(),
        names: Vec::new(),
        quantities: Vec::new(),
        reductions: Vec::new(),
    };
    parser.disjunction()?;
    parser.words.expect_end()?;
    let expression = Expression {
        text: text.into(),
        ops: parser.ops,
        names: parser.names,
        quantities: parser.quantities.into(),
        reductions: parser.reductions,
    };
    let programs = expression.reductions.iter().map(|reduced| &reduced.ops);
    if programs
        .chain([&expression.ops])
        .any(|ops| needed_stack(ops) > STACK)
    {
        let message = format!(
            "the expression keeps more than {STACK} intermediate values; move a part into a derived signal"
        );
        return Err(expression.error(0..text.len(), &message));
    }
    if !expression.reductions.is_empty()
        && let Some(name) = expression.names.iter().find(|name| !name.reduced)
    {
        let message = format!(
            "`{}` has a value at every step and cannot be combined with a reduction",
            name.path
        );
        return Err(expression.error(name.span.clone(), &message));
    }
    Ok(expression)
}

struct Parser<'a> {
    words: Cursor<'a>,
    ops: Vec<Op>,
    names: Vec<Name>,
    quantities: Vec<Quantity>,
    reductions: Vec<Reduced>,
}

type Parsed = Result<(), ExpressionError>;

impl Parser<'_> {
    fn disjunction(&mut self) -> Parsed {
        self.conjunction()?;
        while self.words.accept_word("or") {
            self.conjunction()?;
            self.ops.push(Op::Binary(Binary::Or));
        }
        Ok(())
    }

    fn conjunction(&mut self) -> Parsed {
        self.negation()?;
        while self.words.accept_word("and") {
            self.negation()?;
            self.ops.push(Op::Binary(Binary::And));
        }
        Ok(())
    }

    fn negation(&mut self) -> Parsed {
        if !self.words.accept_word("not") {
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
        let next = self.words.peek().clone();
        if self.accept_comparison().is_some() {
            return Err(self
                .words
                .error(next.span, "two comparisons in a row; join them by `and`"));
        }
        Ok(())
    }

    fn accept_comparison(&mut self) -> Option<Binary> {
        COMPARISONS
            .iter()
            .find(|(symbol, _)| self.words.accept(symbol))
            .map(|(_, operator)| *operator)
    }

    fn sum(&mut self) -> Parsed {
        self.product()?;
        loop {
            let operator = if self.words.accept("+") {
                Binary::Add
            } else if self.words.accept("-") {
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
            let operator = if self.words.accept("*") {
                Binary::Multiply
            } else if self.words.accept("/") {
                Binary::Divide
            } else {
                return Ok(());
            };
            self.sign()?;
            self.ops.push(Op::Binary(operator));
        }
    }

    fn sign(&mut self) -> Parsed {
        if !self.words.accept("-") {
            return self.primary();
        }
        self.nested(Self::sign)?;
        self.ops.push(Op::Unary(Unary::Negate));
        Ok(())
    }

    fn primary(&mut self) -> Parsed {
        let token = self.words.next();
        match token.kind {
            TokenKind::Number(value) => self.ops.push(Op::Constant(value)),
            TokenKind::Quantity(quantity) => {
                self.ops.push(Op::Quantity(self.quantities.len()));
                self.quantities.push(quantity);
            }
            TokenKind::Symbol("(") => {
                self.nested(Self::disjunction)?;
                self.words.expect(")", "an operator or `)`")?;
            }
            TokenKind::Name(ref name) if !WORDS.contains(&name.as_str()) => {
                if self.words.accept("(") {
                    return self.nested(|parser| parser.call(name, token.span.clone()));
                }
                if is_reserved(name) {
                    let message = format!("`{name}` is a function and needs a `(`");
                    return Err(self.words.error(token.span, message));
                }
                self.ops.push(Op::Name(self.names.len()));
                self.names.push(Name {
                    path: name.clone(),
                    span: token.span,
                    reduced: false,
                });
            }
            _ => return Err(self.words.unexpected(&token, "a number, a signal or `(`")),
        }
        Ok(())
    }

    /// Parses a call after its opening parenthesis.
    fn call(&mut self, name: &str, span: Range<usize>) -> Parsed {
        let (first_op, first_name) = (self.ops.len(), self.names.len());
        let first_reduction = self.reductions.len();
        self.disjunction()?;
        let mut arguments = 1;
        while self.words.accept(",") {
            self.disjunction()?;
            arguments += 1;
        }
        let expected = if arguments == 1 { "`,` or `)`" } else { "`)`" };
        self.words.expect(")", expected)?;
        let op = match (name, arguments) {
            ("abs", 1) => Op::Unary(Unary::Abs),
            ("sqrt", 1) => Op::Unary(Unary::Sqrt),
            (VALID, 1) => Op::Unary(Unary::Valid),
            ("min", 2) => Op::Binary(Binary::Min),
            ("max", 2) => Op::Binary(Binary::Max),
            _ => match ReductionKind::of_name(name) {
                Some(kind) if arguments == 1 => {
                    if self.reductions.len() > first_reduction {
                        return Err(self.words.error(span, "a reduction of a reduction"));
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
        if is_reserved(name) || name == VALID {
            let takes = match name {
                "min" | "max" => "one or two values",
                _ => "one value",
            };
            let message = format!("`{name}` takes {takes}, not {arguments}");
            return self.words.error(span, message);
        }
        if let Some(message) = spellings::of_function(name) {
            return self.words.error(span, message);
        }
        if let Some(operator) = spellings::of_operator(name) {
            let message = format!("unknown operator `{name}`; write `{operator}`");
            return self.words.error(span, message);
        }
        let names: Vec<&str> = functions().collect();
        let names = names.join(", ");
        let message = format!("unknown function `{name}`; the functions are {names}");
        let mut error = self.words.error(span, message);
        error.nearest = shared_types::table::nearest(name, functions())
            .into_iter()
            .map(Into::into)
            .collect();
        error
    }

    /// Runs a rule one level deeper.
    fn nested(&mut self, rule: impl FnOnce(&mut Self) -> Parsed) -> Parsed {
        self.words.nest()?;
        rule(self)?;
        self.words.leave();
        Ok(())
    }
}
