//! Work that is due at a row, in lists that change at few rows.
//!
//! Part of [`Monitors`](super::Monitors). Only listed items are evaluated, and each item is listed once.

use super::ComparedSide;
use super::part::{Comparison, Growing, Join, Part, PartWork};

/// Rows at which a part is active. Ordered by stage: a part uses parts of earlier stages, and parts of its own stage
/// that precede it in the lists.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Span {
    pub stage: usize,
    pub part: usize,
    pub from: u64,
    /// Last row.
    pub until: u64,
}

/// Work that is due.
#[derive(Clone, Debug)]
pub(super) struct Due {
    /// Indices of expressions.
    pub sides: Vec<usize>,
    /// Comparisons with the index of each among the parts.
    pub comparisons: Vec<(usize, Comparison)>,
    pub joins: Vec<(usize, Join)>,
    pub growing: Vec<(usize, Growing)>,
    /// Indices of other parts.
    pub others: Vec<usize>,
    /// End of each stage among the joins, the growing windows, and the others.
    pub stages: Vec<[usize; 3]>,
    /// Next row at which the lists change, or at which a part is done.
    pub turns_at: u64,
}

impl Due {
    /// Creates empty lists with room for all parts.
    pub(super) fn new(parts: usize, spans: &[Span]) -> Self {
        let stages = spans.last().map_or(0, |span| span.stage + 1);
        Self {
            sides: Vec::with_capacity(2 * parts),
            comparisons: Vec::with_capacity(parts),
            joins: Vec::with_capacity(parts),
            growing: Vec::with_capacity(parts),
            others: Vec::with_capacity(parts),
            stages: Vec::with_capacity(stages),
            turns_at: 0,
        }
    }

    /// Determines the work that is due from this row on, and the row at which this work changes.
    pub(super) fn turn(
        &mut self,
        row: u64,
        spans: &[Span],
        parts: &[Part],
        sides: &[ComparedSide],
    ) {
        self.turns_at = u64::MAX;
        self.sides.clear();
        self.comparisons.clear();
        self.joins.clear();
        self.growing.clear();
        self.others.clear();
        self.stages.clear();
        for stage in spans.chunk_by(|a, b| a.stage == b.stage) {
            for span in stage {
                for change in [span.from, span.until, span.until + 1] {
                    if (row + 1..self.turns_at).contains(&change) {
                        self.turns_at = change;
                    }
                }
                if (span.from..=span.until).contains(&row) {
                    self.add(span.part, &parts[span.part]);
                }
            }
            let ends = [self.joins.len(), self.growing.len(), self.others.len()];
            self.stages.push(ends);
        }
        self.sides.retain(|at| sides[*at].program.is_some());
        self.sides.sort_unstable();
        self.sides.dedup();
    }

    fn add(&mut self, place: usize, part: &Part) {
        match &part.work {
            PartWork::Comparison(comparison) => {
                // Formulas that share it may have overlapping spans.
                if self
                    .comparisons
                    .last()
                    .is_none_or(|(last, _)| *last != place)
                {
                    self.comparisons.push((place, *comparison));
                    self.sides.extend([comparison.left, comparison.right]);
                }
            }
            PartWork::Join(join) => self.joins.push((place, *join)),
            PartWork::Growing(window) => self.growing.push((place, *window)),
            _ => self.others.push(place),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use shared_types::time::{Rate, Step};

    use crate::expression::{Columns, Group};
    use crate::formula::Formula;
    use crate::monitor::{FormulaContext, Monitors};

    /// Last step of the run.
    const END: u64 = 30;

    /// First and last step of each window.
    type Windows = &'static [(u64, u64)];

    /// Formulas over `a`, `b` and `abs(a - b)`, with the steps at which each formula uses these three; a step is 100
    /// ms.
    const FORMULAS: [(&str, [Windows; 3]); 7] = [
        ("always[1s,2s] truth.a < 1", [&[(10, 20)], &[], &[]]),
        ("always[0s,500ms](2 > truth.a)", [&[(0, 5)], &[], &[]]),
        ("always[1500ms,2s] truth.a < 1", [&[(15, 20)], &[], &[]]),
        (
            "eventually[2s,2500ms] always[0s,300ms] abs(truth.a - truth.b) < 4",
            [&[], &[], &[(20, 28)]],
        ),
        (
            "abs(truth.a-truth.b) < 4 until[400ms,600ms] truth.b > 9",
            [&[], &[(4, 6)], &[(0, 6)]],
        ),
        (
            "always[1s,1200ms](truth.b > 2 implies once[200ms,400ms] truth.a < 1)",
            [&[(6, 10)], &[(10, 12)], &[]],
        ),
        ("truth.b < 7 or truth.b == 8", [&[], &[(0, 0)], &[]]),
    ];

    #[test]
    fn an_expression_is_evaluated_once_a_row_and_only_inside_the_windows_of_its_formulas() {
        let mut columns = Columns::default();
        columns.push(Group::Truth, "a");
        columns.push(Group::Truth, "b");
        let rate = Rate::new(10.0).expect("a rate");
        let context = FormulaContext::new(&columns, &[], rate, END);
        let formulas = FORMULAS.map(|(text, _)| Formula::parse(text).expect("reads"));
        let mut monitors = Monitors::new(&formulas, &context).expect("fits the run");
        let row = [3.0, 5.0];
        for step in 0..=END {
            monitors.observe(Step(step), &row);
            let evaluated = monitors.due.sides.iter();
            let mut evaluated: Vec<f64> = evaluated.map(|at| monitors.sides[*at].value).collect();
            evaluated.sort_unstable_by(f64::total_cmp);
            // Identified by their values at the row, in order.
            let expected = [(2, 2.0), (0, 3.0), (1, 5.0)]
                .into_iter()
                .filter(|(which, _)| {
                    let looks = |steps: &(u64, u64)| (steps.0..=steps.1).contains(&step);
                    FORMULAS
                        .iter()
                        .any(|(_, steps)| steps[*which].iter().any(looks))
                });
            let expected: Vec<f64> = expected.map(|(_, value)| value).collect();
            assert_eq!(evaluated, expected, "at step {step}");
            // Comparisons are not repeated either.
            let compared = monitors.due.comparisons.iter();
            let different: HashSet<_> = compared.map(|(_, comparison)| comparison).collect();
            assert_eq!(
                different.len(),
                monitors.due.comparisons.len(),
                "at step {step}"
            );
        }
        let judged = monitors.judgements().iter();
        assert!(judged.map(|one| one.robustness()).all(|one| one.is_some()));
    }
}
