//! Bound expression as a short list of operations on a stack.
//!
//! Evaluated once per record for every derived signal and reduction. The parser has checked the required stack size
//! against a fixed maximum, so nothing is allocated.

/// Maximum number of values waiting for their operator.
pub(super) const STACK: usize = 32;

/// Operation. Names, quantities and reductions are indices into the expression, replaced by [`Op::Load`] and
/// [`Op::Constant`] on binding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Op {
    Constant(f64),
    Name(usize),
    Quantity(usize),
    Reduced(usize),
    Load(usize),
    Unary(Unary),
    Binary(Binary),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Unary {
    Negate,
    Not,
    Abs,
    Sqrt,
    /// 1 where there is a value, 0 where it is missing.
    Valid,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Binary {
    Add,
    Subtract,
    Multiply,
    Divide,
    Min,
    Max,
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
    Equal,
    NotEqual,
    And,
    Or,
}

/// Stack height that suffices for nearly all expressions, because clearing a stack takes time.
const LOW: usize = 4;

/// Expression bound to columns.
#[derive(Clone, Debug, PartialEq)]
pub struct Program {
    shape: Shape,
}

/// Shape of a program. The most common shapes need no stack and take a fraction of the time.
#[derive(Clone, Debug, PartialEq)]
enum Shape {
    Constant(f64),
    Load(usize),
    Unary(Unary, usize),
    Binary(Binary, usize, usize),
    /// Operations on a low stack.
    Low(Vec<Op>),
    High(Vec<Op>),
}

impl Program {
    pub(super) fn new(ops: Vec<Op>) -> Self {
        let shape = match *ops.as_slice() {
            [Op::Constant(value)] => Shape::Constant(value),
            [Op::Load(index)] => Shape::Load(index),
            [Op::Load(index), Op::Unary(operator)] => Shape::Unary(operator, index),
            [Op::Load(a), Op::Load(b), Op::Binary(operator)] => Shape::Binary(operator, a, b),
            _ if needed_stack(&ops) <= LOW => Shape::Low(ops),
            _ => Shape::High(ops),
        };
        Self { shape }
    }

    /// Evaluates the program on a row.
    ///
    /// # Panics
    /// If the row is shorter than the columns to which the program is bound.
    #[must_use]
    #[inline]
    pub fn evaluate(&self, row: &[f64]) -> f64 {
        match &self.shape {
            Shape::Constant(value) => *value,
            Shape::Load(index) => row[*index],
            Shape::Unary(operator, index) => operator.apply(row[*index]),
            Shape::Binary(operator, a, b) => operator.apply(row[*a], row[*b]),
            Shape::Low(ops) => evaluate_on([0.0; LOW], ops, row),
            Shape::High(ops) => evaluate_on([0.0; STACK], ops, row),
        }
    }
}

#[inline(never)]
fn evaluate_on<const HEIGHT: usize>(mut stack: [f64; HEIGHT], ops: &[Op], row: &[f64]) -> f64 {
    let mut height = 0;
    for op in ops {
        match *op {
            Op::Constant(value) => {
                stack[height] = value;
                height += 1;
            }
            Op::Load(index) => {
                stack[height] = row[index];
                height += 1;
            }
            Op::Unary(operator) => {
                stack[height - 1] = operator.apply(stack[height - 1]);
            }
            Op::Binary(operator) => {
                height -= 1;
                stack[height - 1] = operator.apply(stack[height - 1], stack[height]);
            }
            Op::Name(_) | Op::Quantity(_) | Op::Reduced(_) => unreachable!("a program is bound"),
        }
    }
    stack[0]
}

/// Returns the largest number of values on the stack at any time.
pub(super) fn needed_stack(ops: &[Op]) -> usize {
    let (mut height, mut highest) = (0_usize, 0_usize);
    for op in ops {
        match op {
            Op::Constant(_) | Op::Name(_) | Op::Quantity(_) | Op::Reduced(_) | Op::Load(_) => {
                height += 1;
            }
            Op::Unary(_) => {}
            Op::Binary(_) => height -= 1,
        }
        highest = highest.max(height);
    }
    highest
}

impl Op {
    /// Returns `true` if the operation yields a truth value.
    pub(super) fn is_truth(&self) -> bool {
        match self {
            Self::Constant(_)
            | Self::Name(_)
            | Self::Quantity(_)
            | Self::Reduced(_)
            | Self::Load(_) => false,
            // `valid` is a number, which a requirement compares.
            Self::Unary(unary) => *unary == Unary::Not,
            Self::Binary(binary) => match binary {
                Binary::Add
                | Binary::Subtract
                | Binary::Multiply
                | Binary::Divide
                | Binary::Min
                | Binary::Max => false,
                Binary::Less
                | Binary::LessOrEqual
                | Binary::Greater
                | Binary::GreaterOrEqual
                | Binary::Equal
                | Binary::NotEqual
                | Binary::And
                | Binary::Or => true,
            },
        }
    }
}

impl Unary {
    #[inline]
    fn apply(self, a: f64) -> f64 {
        match self {
            Self::Negate => -a,
            Self::Abs => a.abs(),
            Self::Sqrt => a.sqrt(),
            Self::Valid => truth(!a.is_nan()),
            Self::Not if a.is_nan() => f64::NAN,
            Self::Not => truth(a == 0.0),
        }
    }
}

impl Binary {
    #[inline]
    fn apply(self, a: f64, b: f64) -> f64 {
        match self {
            Self::Add => a + b,
            Self::Subtract => a - b,
            Self::Multiply => a * b,
            Self::Divide => a / b,
            // A comparison with NaN would be false, but the result must stay missing.
            _ if a.is_nan() || b.is_nan() => f64::NAN,
            Self::Min if b < a => b,
            Self::Min => a,
            Self::Max if b > a => b,
            Self::Max => a,
            Self::Less => truth(a < b),
            Self::LessOrEqual => truth(a <= b),
            Self::Greater => truth(a > b),
            Self::GreaterOrEqual => truth(a >= b),
            Self::Equal => truth(a == b),
            Self::NotEqual => truth(a != b),
            Self::And => truth(a != 0.0 && b != 0.0),
            Self::Or => truth(a != 0.0 || b != 0.0),
        }
    }
}

fn truth(holds: bool) -> f64 {
    if holds { 1.0 } else { 0.0 }
}
