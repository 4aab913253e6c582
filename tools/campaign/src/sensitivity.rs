//! First and total Sobol' indices: the shares of a result's variance that a varied value explains alone, and with all its
//! interactions.
//!
//! Saltelli, Annoni, Azzini, Campolongo, Ratto, Tarantola, Variance based sensitivity analysis of model output, Comput.
//! Phys. Commun. 181 (2010) 259-270: estimators (b) and (f) of table 2, from the rows A, B and, for each value, A with
//! that value from B. Intervals come from a bootstrap over the rows; it takes them for independent, so for Sobol' points
//! the intervals are rather too wide. Knows no cases; a result without a number has no indices.

use serde::Serialize;
use shared_types::random::RandomStream;

use crate::normal;

/// Number of resampled estimates of the bootstrap.
const RESAMPLED: usize = 400;

/// Indices of a varied value, with half the widths of their confidence intervals.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Indices {
    /// Share of the variance that the value explains alone.
    pub(crate) first: f64,
    pub(crate) first_within: f64,
    /// Share that would vanish last, with all interactions.
    pub(crate) total: f64,
    pub(crate) total_within: f64,
}

/// Returns the number of draws of one row: A, B, and A with each value from B.
pub(crate) const fn draws_of_row(values: u64) -> u64 {
    values + 2
}

/// Computes the indices of each varied value from the results of all draws, row by row; `None` if a result is not
/// finite, or if all are the same.
pub(crate) fn indices(
    results: &[f64],
    values: usize,
    confidence: f64,
    seed: u64,
) -> Option<Vec<Indices>> {
    let width = values + 2;
    let is_whole = results.len() >= 2 * width && results.len().is_multiple_of(width);
    if !is_whole || results.iter().any(|result| !result.is_finite()) {
        return None;
    }
    let mean = results.iter().sum::<f64>() / results.len() as f64;
    let centred: Vec<f64> = results.iter().map(|result| result - mean).collect();
    let rows: Vec<&[f64]> = centred.chunks_exact(width).collect();
    let estimate = shares(rows.iter().copied(), values)?;
    let z = normal::quantile(0.5 + confidence / 2.0);
    let mut random = RandomStream::new(seed, "campaign/bootstrap");
    let mut spreads = vec![[Spread::default(); 2]; values];
    for _ in 0..RESAMPLED {
        let drawn = (0..rows.len()).map(|_| {
            let place = (random.uniform() * rows.len() as f64) as usize;
            rows[place.min(rows.len() - 1)]
        });
        let Some(resampled) = shares(drawn, values) else {
            continue; // every drawn row was the same
        };
        for (spread, share) in spreads.iter_mut().zip(resampled) {
            for (spread, share) in spread.iter_mut().zip(share) {
                spread.add(share);
            }
        }
    }
    let all = estimate.into_iter().zip(spreads);
    let all = all.map(|([first, total], [of_first, of_total])| Indices {
        first,
        first_within: z * of_first.deviation(),
        total,
        total_within: z * of_total.deviation(),
    });
    Some(all.collect())
}

/// Estimates first and total index of each value; `None` without a variance.
fn shares<'a>(rows: impl Iterator<Item = &'a [f64]>, values: usize) -> Option<Vec<[f64; 2]>> {
    let mut sums = vec![[0.0; 2]; values];
    let (mut sum, mut squares, mut count) = (0.0, 0.0, 0.0);
    for row in rows {
        let (a, b) = (row[0], row[1]);
        sum += a + b;
        squares += a * a + b * b;
        count += 1.0;
        for (sums, mixed) in sums.iter_mut().zip(&row[2..]) {
            sums[0] += b * (mixed - a);
            sums[1] += (a - mixed) * (a - mixed) / 2.0;
        }
    }
    let mean = sum / (2.0 * count);
    let variance = squares / (2.0 * count) - mean * mean;
    let share = |sums: [f64; 2]| sums.map(|sum| sum / count / variance);
    (variance > 0.0).then(|| sums.into_iter().map(share).collect())
}

/// Running mean and sum of squares (Welford 1962).
#[derive(Clone, Copy, Default)]
struct Spread {
    count: f64,
    mean: f64,
    squares: f64,
}

impl Spread {
    fn add(&mut self, value: f64) {
        self.count += 1.0;
        let before = value - self.mean;
        self.mean += before / self.count;
        self.squares += before * (value - self.mean);
    }

    fn deviation(self) -> f64 {
        match self.count {
            count if count > 1.0 => (self.squares / (count - 1.0)).sqrt(),
            _ => f64::NAN,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use hil_config::study::Study;

    use super::*;
    use crate::draws::{Drawn, Draws};
    use crate::table::Cell;

    /// Draws the rows of a study of uniform values and applies a function to each draw.
    fn results(names: &[&str], range: [f64; 2], rows: u64, f: impl Fn(&[f64]) -> f64) -> Vec<f64> {
        let [min, max] = range;
        let mut text =
            format!("schema = 1\nscenario = \"a.toml\"\nsampling = \"saltelli\"\ncases = {rows}\n");
        for name in names {
            text += &format!(
                "[[vary]]\nkey = \"a.{name}\"\nkind = \"uniform\"\nmin = {min:?}\nmax = {max:?}\n"
            );
        }
        let study = Study::parse(&text, "demo.toml").unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(study.draws, rows * draws_of_row(names.len() as u64));
        let draws = Draws::new(study).unwrap_or_else(|error| panic!("{error}"));
        let number = |value: &Drawn| match value.cell() {
            Cell::Number(number) => number,
            other => panic!("{other} is no number"),
        };
        (0..draws.study().draws)
            .map(|draw| {
                let values: Vec<f64> = draws.values(draw).iter().map(number).collect();
                f(&values)
            })
            .collect()
    }

    #[test]
    fn the_intervals_contain_the_indices_of_ishigamis_function() {
        // Ishigami and Homma, An importance quantification technique in uncertainty analysis for computer models, 1990.
        let (a, b) = (7.0, 0.1);
        let ishigami = |x: &[f64]| {
            let sine = libm::sin(x[1]);
            libm::sin(x[0]) * (1.0 + b * libm::pow(x[2], 4.0)) + a * sine * sine
        };
        let results = results(&["x1", "x2", "x3"], [-PI, PI], 4096, ishigami);
        let indices = indices(&results, 3, 0.95, 1).expect("indices");
        let (p4, p8) = (libm::pow(PI, 4.0), libm::pow(PI, 8.0));
        let variance = a * a / 8.0 + b * p4 / 5.0 + b * b * p8 / 18.0 + 0.5;
        let one = 0.5 * (1.0 + b * p4 / 5.0) * (1.0 + b * p4 / 5.0);
        let two = a * a / 8.0;
        let both = b * b * p8 * (1.0 / 18.0 - 1.0 / 50.0);
        let expected = [[one, one + both], [two, two], [0.0, both]];
        for (indices, [first, total]) in indices.iter().zip(expected) {
            let (first, total) = (first / variance, total / variance);
            assert!(
                (indices.first - first).abs() < indices.first_within,
                "{indices:?} {first}"
            );
            assert!(
                (indices.total - total).abs() < indices.total_within,
                "{indices:?} {total}"
            );
            // An interval that contains everything would say nothing.
            assert!(
                indices.first_within < 0.06 && indices.total_within < 0.06,
                "{indices:?}"
            );
        }
    }

    #[test]
    fn the_indices_of_a_sum_are_the_shares_of_its_parts() {
        let results = results(&["a", "b", "unused"], [0.0, 1.0], 1024, |x| {
            3.0 * x[0] + x[1]
        });
        let indices = indices(&results, 3, 0.95, 1).expect("indices");
        for (indices, share) in indices.iter().zip([0.9, 0.1, 0.0]) {
            assert!((indices.first - share).abs() < 5e-3, "{indices:?}");
            assert!((indices.total - share).abs() < 5e-3, "{indices:?}");
        }
        assert_eq!(indices[2].total, 0.0, "nothing depends on it");
    }

    #[test]
    fn results_that_are_equal_or_not_numbers_have_no_indices() {
        assert_eq!(indices(&[1.0; 40], 3, 0.95, 1), None);
        let mut results: Vec<f64> = (0..40).map(f64::from).collect();
        assert!(indices(&results, 3, 0.95, 1).is_some());
        assert_eq!(indices(&results[..39], 3, 0.95, 1), None);
        results[7] = f64::NEG_INFINITY;
        assert_eq!(indices(&results, 3, 0.95, 1), None);
    }
}
