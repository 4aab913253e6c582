//! Recursive-descent parser from tokens to the nodes of a formula: one function per rule of the grammar.
//!
//! The sides of a comparison are parsed by the expression parser.

use std::ops::Range;

use shared_types::table::nearest;

use super::{Comparison, Formula, FormulaSide, Node, Relation, Window};
use crate::expression::cursor::Cursor;
use crate::expression::lexer::{JOINTS, PREFIXES, Token, TokenKind};
use crate::expression::spellings;
use crate::expression::{Expression, ExpressionError, VALID, functions, is_reserved};

/// Returns `true` if a name is a formula operator and so cannot be the name of a signal.
pub(crate) fn is_operator(name: &str) -> bool {
    PREFIXES.contains(&name) || JOINTS.contains(&name)
}

pub(super) fn parse(text: &str) -> Result<Formula, ExpressionError> {
    let mut parser = Parser {
        words: Cursor::new(text)?,
        nodes: Vec::new(),
        implications: Vec::new(),
    };
    parser.formula()?;
    parser.words.expect_end()?;
    Ok(Formula {
        text: text.into(),
        nodes: parser.nodes,
        implications: parser.implications,
    })
}

struct Parser<'a> {
    words: Cursor<'a>,
    nodes: Vec<Node>,
    /// Each `implies`, with the place of its premise.
    implications: Vec<(usize, Range<usize>)>,
}

/// Index of the parsed node.
type Parsed = Result<usize, ExpressionError>;

impl Parser<'_> {
    fn formula(&mut self) -> Parsed {
        let begin = self.words.peek().span.start;
        let left = self.disjunction()?;
        let last = self.words.at.saturating_sub(1);
        let premise = begin..self.words.tokens[last].span.end;
        if !self.words.accept_word("implies") {
            return Ok(left);
        }
        let right = self.nested(Self::formula)?;
        let implication = self.push(Node::Implies(left, right));
        self.implications.push((implication, premise));
        Ok(implication)
    }

    fn disjunction(&mut self) -> Parsed {
        let mut left = self.conjunction()?;
        while self.words.accept_word("or") {
            let right = self.conjunction()?;
            left = self.push(Node::Or(left, right));
        }
        Ok(left)
    }

    fn conjunction(&mut self) -> Parsed {
        let mut left = self.pair()?;
        while self.words.accept_word("and") {
            let right = self.pair()?;
            left = self.push(Node::And(left, right));
        }
        Ok(left)
    }

    fn pair(&mut self) -> Parsed {
        let hold = self.operand()?;
        let Some((is_past, word)) = self.accept_chain() else {
            return Ok(hold);
        };
        let window = self.window(word)?;
        let reach = self.operand()?;
        let next = self.words.peek().span.clone();
        if self.accept_chain().is_some() {
            let message = "two of `until` and `since` in a row; group them by parentheses";
            return Err(self.words.error(next, message));
        }
        Ok(self.push(Node::Chain {
            is_past,
            window,
            hold,
            reach,
        }))
    }

    /// Accepts `until` or `since`; returns `true` for `since`, and the place of the word.
    fn accept_chain(&mut self) -> Option<(bool, Range<usize>)> {
        let span = self.words.peek().span.clone();
        if self.words.accept_word("until") {
            Some((false, span))
        } else if self.words.accept_word("since") {
            Some((true, span))
        } else {
            None
        }
    }

    fn operand(&mut self) -> Parsed {
        let token = self.words.peek().clone();
        let TokenKind::Name(word) = &token.kind else {
            return self.primary();
        };
        let over = match word.as_str() {
            "not" => {
                self.words.at += 1;
                let operand = self.nested(Self::operand)?;
                return Ok(self.push(Node::Not(operand)));
            }
            "rise" | "fall" => {
                self.words.at += 1;
                let rises = word == "rise";
                let operand = self.nested(Self::operand)?;
                return Ok(self.push(Node::Edge { rises, operand }));
            }
            "always" => (false, true),
            "eventually" => (false, false),
            "historically" => (true, true),
            "once" => (true, false),
            _ => {
                self.refuse_foreign(&token, word)?;
                return self.primary();
            }
        };
        self.words.at += 1;
        let window = self.window(token.span)?;
        let operand = self.nested(Self::operand)?;
        let (is_past, every) = over;
        Ok(self.push(Node::Over {
            is_past,
            every,
            window,
            operand,
        }))
    }

    /// Refuses an operator of another language, unless it may be a signal name.
    fn refuse_foreign(&self, token: &Token, word: &str) -> Result<(), ExpressionError> {
        let begins_operand = match &self.words.tokens[self.words.at + 1].kind {
            TokenKind::Symbol(symbol) => matches!(*symbol, "(" | "["),
            TokenKind::Name(next) => !JOINTS.contains(&next.as_str()),
            TokenKind::Number(_) | TokenKind::Quantity(_) => true,
            TokenKind::End => false,
        };
        if !begins_operand {
            return Ok(());
        }
        let advice = match word {
            "if" | "IF" | "when" => "`a implies b` for `if a then b`".into(),
            _ => match spellings::of_operator(word) {
                Some(operator) => format!("`{operator}`"),
                None => return Ok(()),
            },
        };
        let message = format!("unknown operator `{word}`; write {advice}");
        Err(self.words.error(token.span.clone(), message))
    }

    fn primary(&mut self) -> Parsed {
        if self.words.peek().kind != TokenKind::Symbol("(") || self.opens_expression() {
            return self.comparison();
        }
        self.words.at += 1;
        let inner = self.nested(Self::formula)?;
        self.words.expect(")", "an operator or `)`")?;
        Ok(inner)
    }

    /// Returns `true` if the parenthesis here belongs to an expression: an operator of expressions follows its end.
    fn opens_expression(&self) -> bool {
        let mut depth = 0_usize;
        for (at, token) in self.words.tokens.iter().enumerate().skip(self.words.at) {
            match token.kind {
                TokenKind::Symbol("(") => depth += 1,
                TokenKind::Symbol(")") => depth -= 1,
                _ => {}
            }
            if depth == 0 {
                let next = &self.words.tokens[at + 1].kind;
                return matches!(next, TokenKind::Symbol(symbol)
                    if !matches!(*symbol, "(" | ")" | "[" | "]" | ","));
            }
        }
        false
    }

    fn comparison(&mut self) -> Parsed {
        let begin = self.words.at;
        let end = self.end_of_comparison();
        let words = &self.words.tokens[begin..end];
        let (Some(first), Some(last)) = (words.first(), words.last()) else {
            return Err(self.words.unexpected(self.words.peek(), "a comparison"));
        };
        let span = first.span.start..last.span.end;
        if let Some(word) = foreign_joint(words) {
            return Err(self.words.unexpected(word, "an operator or the end"));
        }
        let relations = relations(words);
        let (relation, sign) = match relations.as_slice() {
            [] if is_validity(words) => return self.validity(end, span),
            [] => return Err(self.no_comparison(begin..end, span)),
            [one] => one.clone(),
            [_, (_, second), ..] => {
                let message = "two comparisons in a row; join them by `and`";
                return Err(self.words.error(second.clone(), message));
            }
        };
        let left = self.side(span.start..sign.start)?;
        let right = self.side(sign.end..span.end)?;
        for (side, end) in [(&left, sign.start), (&right, span.end)] {
            if side.expression.is_truth() {
                let words = self.words.text[side.start..end].trim_end();
                let begin = side.start + words.len() - words.trim_start().len();
                let span = begin..side.start + words.len();
                let message = "a truth value cannot be compared; join comparisons by `and`, `or` and `implies`";
                return Err(self.words.error(span, message));
            }
        }
        if left.expression.is_constant() && right.expression.is_constant() {
            let message = "the comparison has only numbers and no signal, so it does not depend on the run; compare a signal";
            return Err(self.words.error(span, message));
        }
        self.words.at = end;
        let node = Node::Comparison(Comparison {
            relation,
            left,
            right,
        });
        Ok(self.push(node))
    }

    /// Pushes `valid(x)` as the comparison `valid(x) > 0.5`; the next token is that at `end`.
    fn validity(&mut self, end: usize, span: Range<usize>) -> Parsed {
        let right = FormulaSide {
            expression: Expression::parse("0.5")?,
            start: span.end,
        };
        let left = self.side(span)?;
        self.words.at = end;
        let relation = Relation::Greater;
        Ok(self.push(Node::Comparison(Comparison {
            relation,
            left,
            right,
        })))
    }

    /// Returns the first token after the comparison that begins here.
    fn end_of_comparison(&self) -> usize {
        let mut depth = 0_usize;
        for (at, token) in self.words.tokens.iter().enumerate().skip(self.words.at) {
            match &token.kind {
                TokenKind::End | TokenKind::Symbol("[" | "]") => return at,
                TokenKind::Symbol(")" | ",") if depth == 0 => return at,
                TokenKind::Name(name) if depth == 0 && JOINTS.contains(&name.as_str()) => {
                    return at;
                }
                TokenKind::Symbol("(") => depth += 1,
                TokenKind::Symbol(")") => depth -= 1,
                _ => {}
            }
        }
        self.words.tokens.len()
    }

    fn side(&self, span: Range<usize>) -> Result<FormulaSide, ExpressionError> {
        let start = span.start;
        let expression = Expression::parse(&self.words.text[span])
            .and_then(|expression| expression.refuse_reduction().map(|()| expression))
            .map_err(|error| error.inside(self.words.text, start))?;
        Ok(FormulaSide { expression, start })
    }

    /// Returns the error for tokens without a comparison.
    fn no_comparison(&self, words: Range<usize>, span: Range<usize>) -> ExpressionError {
        let first = &self.words.tokens[words.start];
        let follows = &self.words.tokens[words.start + 1].kind;
        let misspelt = match &first.kind {
            TokenKind::Name(name) if *follows == TokenKind::Symbol("[") => Some(name),
            TokenKind::Name(name) if *follows == TokenKind::Symbol("(") => {
                Some(name).filter(|name| !is_reserved(name))
            }
            _ => None,
        };
        if let Some(message) = misspelt.and_then(|name| spellings::of_function(name)) {
            return self.words.error(first.span.clone(), message);
        }
        if let Some(name) = misspelt {
            let message = format!("unknown operator `{name}`");
            let mut error = self.words.error(first.span.clone(), message);
            let names = PREFIXES.into_iter().chain(["not"]).chain(functions());
            error.nearest = nearest(name, names).into_iter().map(Into::into).collect();
            return error;
        }
        let message = "a requirement consists of comparisons, such as `abs(error_m) < 0.01`";
        self.words.error(span, message)
    }

    /// Parses optional bounds; `word` is the operator to which they belong.
    fn window(&mut self, word: Range<usize>) -> Result<Window, ExpressionError> {
        let open = self.words.peek().span.clone();
        if !self.words.accept("[") {
            return Ok(Window {
                bounds_s: None,
                span: word,
            });
        }
        let begin_s = self.time()?;
        self.words.expect(",", "`,` and the end of the window")?;
        let end_s = self.time()?;
        let close = self.words.peek().span.clone();
        self.words.expect("]", "`]`")?;
        if begin_s > end_s {
            let message = "the window ends before it begins";
            return Err(self.words.error(open.start..close.end, message));
        }
        Ok(Window {
            bounds_s: Some((begin_s, end_s)),
            span: word.start..close.end,
        })
    }

    fn time(&mut self) -> Result<f64, ExpressionError> {
        let token = self.words.next();
        let time_s = match &token.kind {
            TokenKind::Number(time_s) => Some(*time_s),
            TokenKind::Quantity(quantity) => quantity.time_s(),
            _ => None,
        };
        let minutes = match &token.kind {
            TokenKind::Quantity(quantity) if quantity.symbol == "m" => {
                " (minutes are `min`)".into()
            }
            TokenKind::Quantity(quantity) => quantity.joined_time().unwrap_or_default(),
            _ => String::new(),
        };
        let expected = format!("a time of at least 0, such as 2s or 200ms{minutes}");
        time_s.ok_or_else(|| self.words.unexpected(&token, &expected))
    }

    fn push(&mut self, node: Node) -> usize {
        self.nodes.push(node);
        self.nodes.len() - 1
    }

    /// Runs a rule one level deeper.
    fn nested(&mut self, rule: impl FnOnce(&mut Self) -> Parsed) -> Parsed {
        self.words.nest()?;
        let parsed = rule(self)?;
        self.words.leave();
        Ok(parsed)
    }
}

/// Returns `true` for tokens that are a call of `valid` and nothing else.
fn is_validity(words: &[Token]) -> bool {
    let is = |token: &Token, symbol: &'static str| token.kind == TokenKind::Symbol(symbol);
    let [name, open, inner @ .., close] = words else {
        return false;
    };
    let is_call = matches!(&name.kind, TokenKind::Name(name) if name == VALID);
    is_call && is(open, "(") && is(close, ")") && !inner.iter().any(|token| is(token, ")"))
}

/// Returns the first operator of another language between two operands.
fn foreign_joint(words: &[Token]) -> Option<&Token> {
    let ends_operand = |token: &Token| match &token.kind {
        TokenKind::Number(_) | TokenKind::Quantity(_) | TokenKind::Symbol(")") => true,
        TokenKind::Name(name) => name != "not" && !JOINTS.contains(&name.as_str()),
        TokenKind::Symbol(_) | TokenKind::End => false,
    };
    let is_foreign = |token: &Token| matches!(&token.kind, TokenKind::Name(name) if spellings::of_operator(name).is_some());
    let mut pairs = words.windows(2);
    let pair = pairs.find(|pair| ends_operand(&pair[0]) && is_foreign(&pair[1]))?;
    Some(&pair[1])
}

/// Lists the relations among tokens outside parentheses.
fn relations(words: &[Token]) -> Vec<(Relation, Range<usize>)> {
    let mut list = Vec::new();
    let mut depth = 0_usize;
    for word in words {
        let TokenKind::Symbol(symbol) = word.kind else {
            continue;
        };
        match symbol {
            "(" => depth += 1,
            ")" => depth -= 1,
            _ if depth == 0 => {
                let mut all = Relation::ALL.into_iter();
                let relation = all.find(|relation| relation.symbol() == symbol);
                list.extend(relation.map(|relation| (relation, word.span.clone())));
            }
            _ => {}
        }
    }
    list
}
