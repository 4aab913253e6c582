//! Exact coverage of the bounds: the probability that the bounds contain a given true probability.
//!
//! The computation is independent of the functions under test: logarithms of factorials by recurrence, and plain sums
//! of probabilities.

#![expect(
    clippy::disallowed_methods,
    reason = "the logarithms and exponentials of the standard library, as the bounds are made with those of libm"
)]

use super::{bounds, lower, upper};

/// Tolerance of a sum of probabilities: logarithms of factorials up to 4000 are about 30,000, with errors of some
/// 1e-12.
const ROUNDING: f64 = 1e-10;
const TRIALS: [u64; 12] = [10, 11, 13, 20, 33, 50, 100, 200, 400, 1000, 2000, 4000];
const CONFIDENCES: [f64; 3] = [0.9, 0.95, 0.99];

/// Binomial distribution of a number of trials.
struct Binomial {
    /// Logarithms of the binomial coefficients.
    ln_choose: Vec<f64>,
}

impl Binomial {
    fn new(n: usize) -> Self {
        // ln k! = ln (k - 1)! + ln k, by compensated summation (W. Kahan, 1965).
        let (mut factorials, mut sum, mut carried) = (vec![0.0], 0.0, 0.0);
        for k in 1..=n {
            let term = (k as f64).ln() - carried;
            let next: f64 = sum + term;
            carried = (next - sum) - term;
            sum = next;
            factorials.push(sum);
        }
        let choose = |k: usize| factorials[n] - factorials[k] - factorials[n - k];
        Self {
            ln_choose: (0..=n).map(choose).collect(),
        }
    }

    /// Sums the probabilities of the counts that a rule covers.
    fn sum(&self, p: f64, is_covered: impl Fn(usize) -> bool) -> f64 {
        let n = self.ln_choose.len() - 1;
        let (ln_p, ln_q) = (p.ln(), (-p).ln_1p());
        let covered = (0..=n).filter(|k| is_covered(*k));
        covered
            .map(|k| (self.ln_choose[k] + k as f64 * ln_p + (n - k) as f64 * ln_q).exp())
            .sum()
    }
}

/// Probabilities at which the coverage is evaluated: a grid, and the two numbers adjacent to each bound, where the
/// coverage jumps.
fn probabilities(bounds: impl Iterator<Item = f64>) -> Vec<f64> {
    let grid = (1..500).map(|step| f64::from(step) / 500.0);
    let beside = bounds.flat_map(|bound| [bound.next_down(), bound, bound.next_up()]);
    let is_inside = |p: &f64| *p > 0.0 && *p < 1.0;
    grid.chain(beside).filter(is_inside).collect()
}

/// Stride between the counts whose bounds are evaluated; the counts near both ends are all evaluated.
fn stride(n: u64) -> u64 {
    n.div_ceil(400)
}

fn is_chosen(k: u64, n: u64) -> bool {
    k < 30 || n - k < 30 || k.is_multiple_of(stride(n))
}

#[test]
fn the_coverage_of_two_sided_bounds_is_at_least_the_confidence() {
    for (n, confidence) in TRIALS.into_iter().flat_map(|n| CONFIDENCES.map(|c| (n, c))) {
        let binomial = Binomial::new(n as usize);
        let all: Vec<_> = (0..=n)
            .map(|k| bounds(k, n, confidence).expect("bounds"))
            .collect();
        let chosen = (0..=n).filter(|k| is_chosen(*k, n));
        let ends = chosen.flat_map(|k| [all[k as usize].lower, all[k as usize].upper]);
        for p in probabilities(ends) {
            let coverage = binomial.sum(p, |k| all[k].lower <= p && p <= all[k].upper);
            assert!(
                coverage >= confidence - ROUNDING,
                "{n} trials at {confidence}: {coverage} covered at {p}"
            );
        }
    }
}

#[test]
fn the_coverage_of_one_sided_bounds_is_at_least_the_confidence() {
    for (n, confidence) in TRIALS.into_iter().flat_map(|n| CONFIDENCES.map(|c| (n, c))) {
        let binomial = Binomial::new(n as usize);
        for (bound, is_lower) in [(lower as fn(u64, u64, f64) -> f64, true), (upper, false)] {
            let all: Vec<f64> = (0..=n).map(|k| bound(k, n, confidence)).collect();
            let chosen = (0..=n).filter(|k| is_chosen(*k, n));
            for p in probabilities(chosen.map(|k| all[k as usize])) {
                let coverage = binomial.sum(p, |k| (all[k] <= p) == is_lower || all[k] == p);
                assert!(
                    coverage >= confidence - ROUNDING,
                    "{n} trials at {confidence}: {coverage} covered at {p}"
                );
            }
        }
    }
}

#[test]
fn choosing_the_side_by_the_data_would_miss_the_confidence() {
    // The rule that this one replaced: at 95 %, the whole risk on one side without a success or without a failure.
    let (n, confidence) = (10, 0.95);
    let binomial = Binomial::new(n as usize);
    let all: Vec<[f64; 2]> = (0..=n)
        .map(|k| match k {
            0 => [0.0, upper(k, n, confidence)],
            k if k == n => [lower(k, n, confidence), 1.0],
            k => [lower(k, n, 0.975), upper(k, n, 0.975)],
        })
        .collect();
    let points = probabilities(all.iter().flatten().copied());
    let coverages = points
        .into_iter()
        .map(|p| binomial.sum(p, |k| all[k][0] <= p && p <= all[k][1]));
    let least = coverages.fold(1.0, |least, one| if one < least { one } else { least });
    assert!(least < 0.945, "{least}");
}
