//! Definitions of formulas, applied by recursion over whole traces.
//!
//! Has no delays, sliding windows or shared parts, and evaluates a formula as defined by the tables of
//! `docs/requirements.md`, at any step.

use std::fmt::Write as _;

/// Reproducible random numbers (SplitMix64, Steele, Lea and Flood 2014).
pub(super) struct Draws(pub(super) u64);

impl Draws {
    pub(super) fn below(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % end
    }

    pub(super) fn of<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.below(all.len() as u64) as usize]
    }
}

const SIGNALS: [&str; 3] = ["truth.a", "truth.b", "command.c"];
const COMMAND: usize = 2;

#[derive(Clone, Debug)]
pub(super) enum Tree {
    /// Comparison of a signal and a number.
    Compare(usize, &'static str, f64),
    Not(Box<Tree>),
    Two(&'static str, Box<Tree>, Box<Tree>),
    Over(&'static str, Option<(u64, u64)>, Box<Tree>),
    Chain(&'static str, Option<(u64, u64)>, Box<Tree>, Box<Tree>),
    Edge(&'static str, Box<Tree>),
}

/// Size and step, ordered by size, then by step; -0 is below +0.
pub(super) type Judged = (f64, u64);

pub(super) fn is_below(a: Judged, b: Judged) -> bool {
    a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).is_lt()
}

/// Returns the minimum or the maximum.
pub(super) fn pick(least: bool, all: impl IntoIterator<Item = Judged>) -> Judged {
    let none = if least {
        (f64::INFINITY, u64::MAX)
    } else {
        (f64::NEG_INFINITY, 0)
    };
    all.into_iter().fold(none, |best, one| {
        if is_below(one, best) == least {
            one
        } else {
            best
        }
    })
}

/// Trace of a run up to the last step `end`.
pub(super) struct Trace {
    pub(super) rows: Vec<[f64; 3]>,
}

impl Trace {
    pub(super) fn end(&self) -> u64 {
        self.rows.len() as u64 - 1
    }
}

impl Tree {
    pub(super) fn random(draws: &mut Draws, depth: u64, outermost: bool) -> Self {
        let inner = |draws: &mut Draws| Box::new(Self::random(draws, depth - 1, false));
        let level = |draws: &mut Draws| Box::new(Self::random(draws, depth - 1, outermost));
        let bounds = |draws: &mut Draws, may_lack: bool| {
            if may_lack && draws.below(4) == 0 {
                return None;
            }
            let first = draws.below(4);
            Some((first, first + draws.below(6)))
        };
        match if depth == 0 { 0 } else { draws.below(12) } {
            0..=1 => {
                let sign = draws.of(&["<", "<=", ">", ">=", "==", "!="]);
                Self::Compare(draws.below(3) as usize, sign, draws.below(5) as f64 - 2.0)
            }
            2 => Self::Not(level(draws)),
            3..=4 => {
                let word = draws.of(&["and", "or", "implies"]);
                Self::Two(word, level(draws), level(draws))
            }
            5..=6 => {
                let word = draws.of(&["always", "eventually"]);
                Self::Over(word, bounds(draws, outermost), inner(draws))
            }
            7..=8 => {
                let word = draws.of(&["historically", "once"]);
                Self::Over(word, bounds(draws, true), inner(draws))
            }
            9 => Self::Chain(
                "until",
                bounds(draws, outermost),
                inner(draws),
                inner(draws),
            ),
            10 => Self::Chain("since", bounds(draws, true), inner(draws), inner(draws)),
            _ => Self::Edge(draws.of(&["rise", "fall"]), inner(draws)),
        }
    }

    /// Formats the formula, everything in parentheses. At 10 Hz a step is 100 ms.
    pub(super) fn text(&self) -> String {
        let window = |bounds: &Option<(u64, u64)>| {
            let mut text = String::new();
            if let Some((first, last)) = bounds {
                write!(text, "[{}ms,{}ms]", first * 100, last * 100).expect("a string");
            }
            text
        };
        match self {
            Self::Compare(signal, sign, value) => format!("{} {sign} {value:?}", SIGNALS[*signal]),
            Self::Not(f) => format!("not ({})", f.text()),
            Self::Two(word, f, g) => format!("({}) {word} ({})", f.text(), g.text()),
            Self::Over(word, bounds, f) => format!("{word}{} ({})", window(bounds), f.text()),
            Self::Chain(word, bounds, f, g) => {
                format!("({}) {word}{} ({})", f.text(), window(bounds), g.text())
            }
            Self::Edge(word, f) => format!("{word} ({})", f.text()),
        }
    }

    /// Returns the last step at which the formula can be evaluated in a run up to step `end`; below 0 if there is none.
    pub(super) fn until(&self, end: i64) -> i64 {
        let limited = |step: i64| step.min(end);
        match self {
            Self::Compare(COMMAND, ..) => end - 1,
            Self::Compare(..) => end,
            Self::Not(f) | Self::Edge(_, f) => f.until(end),
            Self::Two(_, f, g) => f.until(end).min(g.until(end)),
            Self::Over("always" | "eventually", bounds, f) => {
                let inner = f.until(end);
                bounds.map_or(0.min(inner), |(_, last)| inner - last as i64)
            }
            Self::Over(_, bounds, f) => {
                limited(f.until(end) + bounds.map_or(0, |(first, _)| first as i64))
            }
            Self::Chain("until", bounds, f, g) => {
                let inner = f.until(end).min(g.until(end));
                bounds.map_or(0.min(inner), |(_, last)| inner - last as i64)
            }
            Self::Chain(_, bounds, f, g) => {
                let inner = f.until(end).min(g.until(end));
                let reached = inner + bounds.map_or(0, |(first, _)| first as i64);
                // The first operand must hold from then up to the step itself.
                limited(reached).min(f.until(end))
            }
        }
    }

    /// Returns `true` if a part of the formula looks beyond the end wherever it is evaluated.
    pub(super) fn is_too_long(&self, end: i64) -> bool {
        let inner = match self {
            Self::Compare(..) => false,
            Self::Not(f) | Self::Edge(_, f) | Self::Over(_, _, f) => f.is_too_long(end),
            Self::Two(_, f, g) | Self::Chain(_, _, f, g) => {
                f.is_too_long(end) || g.is_too_long(end)
            }
        };
        inner || self.until(end) < 0
    }

    /// Returns the steps of the window of a future operator at `k`.
    pub(super) fn ahead(
        &self,
        bounds: &Option<(u64, u64)>,
        k: u64,
        trace: &Trace,
    ) -> std::ops::RangeInclusive<u64> {
        match (bounds, self) {
            (Some((first, last)), _) => k + first..=k + last,
            (None, Self::Over(_, _, f)) => 0..=f.until(trace.end() as i64) as u64,
            (None, Self::Chain(_, _, f, g)) => {
                let end = trace.end() as i64;
                0..=f.until(end).min(g.until(end)) as u64
            }
            _ => panic!("no window"),
        }
    }

    /// Returns the steps of the window of a past operator at `k`.
    pub(super) fn behind(bounds: &Option<(u64, u64)>, k: u64) -> std::ops::Range<u64> {
        let (first, last) = bounds.unwrap_or((0, k));
        k.saturating_sub(last)..(k + 1).saturating_sub(first)
    }

    /// Computes the margin at step `k`, or the margin of the negation if `holds` is `false`.
    pub(super) fn judge(&self, k: u64, holds: bool, trace: &Trace) -> Judged {
        let at = |tree: &Self, step: u64| tree.judge(step, holds, trace);
        match self {
            Self::Compare(signal, sign, value) => {
                let x = trace.rows[k as usize][*signal];
                if x.is_nan() {
                    return (f64::NEG_INFINITY, k);
                }
                // As Donze and Maler define it, with the sign that a zero needs.
                let (size, is_true) = match *sign {
                    "<" => (value - x, x < *value),
                    "<=" => (value - x, x <= *value),
                    ">" => (x - value, x > *value),
                    ">=" => (x - value, x >= *value),
                    "==" => (-(x - value).abs(), x == *value),
                    "!=" => ((x - value).abs(), x != *value),
                    other => panic!("{other}"),
                };
                let (size, is_true) = if holds {
                    (size, is_true)
                } else {
                    (-size, !is_true)
                };
                let zero = if is_true { 0.0 } else { -0.0 };
                (if size == 0.0 { zero } else { size }, k)
            }
            Self::Not(f) => f.judge(k, !holds, trace),
            Self::Two("and", f, g) => pick(holds, [at(f, k), at(g, k)]),
            Self::Two("or", f, g) => pick(!holds, [at(f, k), at(g, k)]),
            Self::Two(_, f, g) => pick(!holds, [f.judge(k, !holds, trace), at(g, k)]),
            Self::Over("always", bounds, f) => {
                pick(holds, self.ahead(bounds, k, trace).map(|j| at(f, j)))
            }
            Self::Over("eventually", bounds, f) => {
                pick(!holds, self.ahead(bounds, k, trace).map(|j| at(f, j)))
            }
            Self::Over(word, bounds, f) => {
                let steps = Self::behind(bounds, k).map(|j| at(f, j));
                pick((*word == "historically") == holds, steps)
            }
            Self::Chain("until", bounds, f, g) => {
                let reached = self.ahead(bounds, k, trace).map(|j| {
                    let until_then = (k..j).map(|i| at(f, i));
                    pick(holds, until_then.chain([at(g, j)]))
                });
                pick(!holds, reached)
            }
            Self::Chain(_, bounds, f, g) => {
                let reached = Self::behind(bounds, k).map(|j| {
                    let until_then = (j + 1..=k).map(|i| at(f, i));
                    pick(holds, until_then.chain([at(g, j)]))
                });
                pick(!holds, reached)
            }
            Self::Edge(word, f) => {
                let rises = *word == "rise";
                let now = f.judge(k, rises == holds, trace);
                let before = k.checked_sub(1).map(|j| f.judge(j, rises != holds, trace));
                // At step 0 there is no previous step, and so no edge.
                let none = pick(!holds, []);
                pick(holds, [now, before.unwrap_or(none)])
            }
        }
    }

    /// Returns `true` if the formula (or, if `holds` is `false`, its negation) holds at step `k`, by Boolean logic
    /// alone.
    pub(super) fn is_true(&self, k: u64, holds: bool, trace: &Trace) -> bool {
        let at = |tree: &Self, step: u64| tree.is_true(step, holds, trace);
        let quantified = |every: bool, mut steps: Vec<bool>| {
            if every == holds {
                steps.iter().all(|one| *one)
            } else {
                steps.drain(..).any(|one| one)
            }
        };
        match self {
            Self::Compare(signal, sign, value) => {
                let x = trace.rows[k as usize][*signal];
                let is_true = match *sign {
                    "<" => x < *value,
                    "<=" => x <= *value,
                    ">" => x > *value,
                    ">=" => x >= *value,
                    "==" => x == *value,
                    _ => x != *value,
                };
                !x.is_nan() && is_true == holds
            }
            Self::Not(f) => f.is_true(k, !holds, trace),
            Self::Two("and", f, g) => quantified(true, vec![at(f, k), at(g, k)]),
            Self::Two("or", f, g) => quantified(false, vec![at(f, k), at(g, k)]),
            Self::Two(_, f, g) => quantified(false, vec![f.is_true(k, !holds, trace), at(g, k)]),
            Self::Over(word @ ("always" | "eventually"), bounds, f) => {
                let steps = self.ahead(bounds, k, trace).map(|j| at(f, j)).collect();
                quantified(*word == "always", steps)
            }
            Self::Over(word, bounds, f) => {
                let steps = Self::behind(bounds, k).map(|j| at(f, j)).collect();
                quantified(*word == "historically", steps)
            }
            Self::Chain("until", bounds, f, g) => {
                let reached = self.ahead(bounds, k, trace).map(|j| {
                    let until_then = (k..j).map(|i| at(f, i));
                    quantified(true, until_then.chain([at(g, j)]).collect())
                });
                quantified(false, reached.collect())
            }
            Self::Chain(_, bounds, f, g) => {
                let reached = Self::behind(bounds, k).map(|j| {
                    let until_then = (j + 1..=k).map(|i| at(f, i));
                    quantified(true, until_then.chain([at(g, j)]).collect())
                });
                quantified(false, reached.collect())
            }
            Self::Edge(word, f) => {
                let rises = *word == "rise";
                let now = f.is_true(k, rises == holds, trace);
                let before = k
                    .checked_sub(1)
                    .map(|j| f.is_true(j, rises != holds, trace));
                quantified(true, vec![now, before.unwrap_or(!holds)])
            }
        }
    }
}

pub(super) fn random_trace(draws: &mut Draws) -> Trace {
    let end = 5 + draws.below(36);
    let (missing, smooth) = (draws.below(2) == 0, draws.below(2) == 0);
    let mut last = [0.0; 3];
    let rows = (0..=end).map(|k| {
        let mut row = last.map(|x: f64| {
            if smooth && draws.below(3) > 0 {
                return x;
            }
            // Few values, so that equal sides, and equal margins at several steps, are frequent.
            draws.of(&[-2.0, -1.0, -0.5, 0.0, 0.25, 1.0, 2.0, 2.0])
        });
        last = row;
        if missing && draws.below(12) == 0 {
            row[draws.below(3) as usize] = f64::NAN;
        }
        if k == end {
            row[COMMAND] = f64::NAN;
        }
        row
    });
    Trace {
        rows: rows.collect(),
    }
}
