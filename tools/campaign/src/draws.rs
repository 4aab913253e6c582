//! Values of the cases of a campaign.
//!
//! Case `i` is a pure function of `i` and the study, including its seed and number of draws: it has the same bits on
//! every machine and in any order of computation. Independent draws and Sobol' points do not depend on the number of
//! draws either.

use hil_config::expression::{Columns, Group, Program};
use hil_config::problem::Problems;
use hil_config::study::{Item, MOST_SOBOL, Sampling, Spread, Study, Varied};
use shared_types::random::RandomStream;

use crate::sensitivity::draws_of_row;
use crate::table::Cell;
use crate::{normal, permutation, sobol, truncated};

/// Prefix of the flag that sets the seed of a case.
const SEED: &str = "run.seed=";
/// Upper bound (exclusive) of the seed of a case: JSON and TOML represent smaller integers exactly.
const SEEDS: f64 = (1_u64 << 53) as f64;

const _: () = assert!(
    MOST_SOBOL == sobol::MOST_DIMENSIONS,
    "the sampler must support the dimensions of every study"
);

/// Sampler of a study's varied values.
pub(crate) struct Draws {
    study: Study,
    sources: Vec<Source>,
    /// Lower triangle of the Cholesky factor of the correlations between the values in `normals`.
    factor: Vec<Vec<f64>>,
    /// Indices of the varied values with correlations.
    normals: Vec<usize>,
}

/// Source of a varied value.
enum Source {
    /// Random number of this dimension; the key selects a permutation or a shift.
    Random { dimension: usize, key: u64 },
    /// Expression over earlier values, by their columns.
    Computed { program: Program, from: Vec<usize> },
}

/// A drawn value.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Drawn {
    /// A number.
    Number(f64),
    /// A whole number.
    Whole(f64),
    /// An entry of a list.
    Item(Item),
}

impl Drawn {
    /// Formats the value as `--set` accepts it.
    #[must_use]
    pub(crate) fn toml(&self) -> String {
        match self {
            Self::Number(value) | Self::Whole(value) if value.is_nan() => "nan".into(),
            Self::Number(value) => format!("{value:?}"),
            Self::Whole(value) => format!("{value:.0}"),
            Self::Item(item) => item.toml(),
        }
    }

    /// Converts the value to a table cell.
    pub(crate) fn cell(&self) -> Cell {
        match self {
            Self::Number(value) | Self::Whole(value) | Self::Item(Item::Number(value, _)) => {
                Cell::number(*value)
            }
            Self::Item(Item::Text(text)) => Cell::Text(text.clone()),
            Self::Item(Item::Flag(value)) => Cell::Text(value.to_string()),
            Self::Item(Item::Table { label, .. }) => Cell::Text(label.clone()),
        }
    }

    const fn number(&self) -> f64 {
        match self {
            Self::Number(value) | Self::Whole(value) | Self::Item(Item::Number(value, _)) => *value,
            Self::Item(_) => f64::NAN,
        }
    }
}

impl Draws {
    /// Prepares the sampler of a study.
    ///
    /// # Errors
    /// If the matrix of correlations is not positive definite.
    pub(crate) fn new(study: Study) -> Result<Self, Problems> {
        let mut columns = Columns::default();
        let mut places = Vec::new();
        let mut sources = Vec::new();
        let mut dimension = 0;
        for (place, one) in study.varied.iter().enumerate() {
            let bound = match &one.spread {
                Spread::Expression(expression) => Some(expression.compile_signal(&columns)),
                _ => None,
            };
            sources.push(match bound.and_then(Result::ok) {
                Some(program) => Source::Computed {
                    program,
                    from: places.clone(),
                },
                None => {
                    dimension += 1;
                    Source::Random {
                        dimension: dimension - 1,
                        key: key(study.seed, &one.name),
                    }
                }
            });
            columns.push(Group::Derived, &one.name);
            places.push(place);
        }
        let mut normals: Vec<usize> = study.correlations.iter().flat_map(|one| one.of).collect();
        normals.sort_unstable();
        normals.dedup();
        let factor = factor(&study, &normals)?;
        Ok(Self {
            study,
            sources,
            factor,
            normals,
        })
    }

    /// Returns the study.
    #[must_use]
    pub(crate) const fn study(&self) -> &Study {
        &self.study
    }

    /// Returns the draw and the variant of a case: the cases of one draw, one per variant, are consecutive.
    pub(crate) fn of_case(&self, case: u64) -> (u64, usize) {
        let variants = self.study.variants.len() as u64;
        let variant = usize::try_from(case % variants).unwrap_or_default();
        (case / variants, variant)
    }

    /// Draws `run.seed` of a draw.
    pub(crate) fn seed(&self, draw: u64) -> u64 {
        let path = format!("campaign/run.seed/{draw}");
        (RandomStream::new(self.study.seed, &path).uniform() * SEEDS) as u64
    }

    /// Draws the varied values of a draw, in the order of the study.
    #[must_use]
    pub(crate) fn values(&self, draw: u64) -> Vec<Drawn> {
        let mut uniform: Vec<f64> = self
            .sources
            .iter()
            .map(|source| self.uniform(source, draw))
            .collect();
        self.correlate(&mut uniform);
        self.computed(|place, one| match &one.spread {
            Spread::Choice(items) => {
                let last = items.len() - 1;
                let drawn = (uniform[place] * items.len() as f64) as usize;
                let index = self.chosen(draw, place, drawn);
                Drawn::Item(items[index.min(last)].clone())
            }
            spread if one.is_whole => Drawn::Whole(whole(spread, uniform[place])),
            spread => Drawn::Number(value(spread, uniform[place])),
        })
    }

    /// Returns the varied values at a point, which has a number for each value that is not computed.
    pub(crate) fn at(&self, point: &[f64]) -> Vec<Drawn> {
        let mut point = point.iter();
        self.computed(|_, one| {
            let value = *point.next().unwrap_or(&f64::NAN);
            match one.is_whole {
                true => Drawn::Whole(rounded(value)),
                false => Drawn::Number(value),
            }
        })
    }

    /// Completes values by those that are computed from them.
    fn computed(&self, mut free: impl FnMut(usize, &Varied) -> Drawn) -> Vec<Drawn> {
        let mut values: Vec<Drawn> = Vec::with_capacity(self.sources.len());
        for (place, (source, one)) in self.sources.iter().zip(&self.study.varied).enumerate() {
            values.push(match source {
                Source::Computed { program, from } => {
                    let row: Vec<f64> = from.iter().map(|place| values[*place].number()).collect();
                    match (program.evaluate(&row), one.is_whole) {
                        (value, true) => Drawn::Whole(rounded(value)),
                        (value, false) => Drawn::Number(value),
                    }
                }
                Source::Random { .. } => free(place, one),
            });
        }
        values
    }

    /// Returns the `--set` flags that turn the scenario into a case, in the order of application.
    pub(crate) fn flags(&self, case: u64) -> Vec<String> {
        let (draw, variant) = self.of_case(case);
        self.flags_of(variant, self.seed(draw), &self.values(draw))
    }

    /// Returns the seed of a case with these values: the study's own if it sets one, otherwise the drawn one.
    pub(crate) fn seed_of(&self, variant: usize, drawn: u64, values: &[Drawn]) -> u64 {
        let flags = self.flags_of(variant, drawn, values);
        let own_seed = flags.iter().find_map(|flag| flag.strip_prefix(SEED));
        // TOML allows `_` between digits.
        own_seed
            .and_then(|seed| seed.trim().replace('_', "").parse().ok())
            .unwrap_or_default()
    }

    /// Returns the flags of a case with these values.
    pub(crate) fn flags_of(&self, variant: usize, seed: u64, values: &[Drawn]) -> Vec<String> {
        let mut flags = self.flags_with(variant, values);
        if !flags.iter().any(|flag| flag.starts_with(SEED)) {
            flags.push(format!("{SEED}{seed}"));
        }
        flags
    }

    /// Returns the flags that set these values and nothing else: without a seed of its own, a case has that of the
    /// scenario.
    pub(crate) fn flags_with(&self, variant: usize, values: &[Drawn]) -> Vec<String> {
        let study = &self.study;
        let mut flags = study.set.clone();
        flags.extend(study.variants[variant].set.iter().cloned());
        for (one, value) in study.varied.iter().zip(values) {
            flags.extend(one.key.iter().map(|key| format!("{key}={}", value.toml())));
        }
        flags.extend(study.timing_flag(variant, true));
        flags
    }

    /// Returns the flags of a case of a study with a table of faults, without its fault.
    pub(crate) fn healthy_flags(&self, case: u64) -> Vec<String> {
        let (draw, variant) = self.of_case(case);
        let values = self.values(draw);
        let mut flags = self.flags_of(variant, self.seed(draw), &values);
        let mut of_fault: Vec<String> = self.study.timing_flag(variant, true).into_iter().collect();
        // The first value chooses the fault.
        let first = self.study.varied.first().zip(values.first());
        of_fault.extend(
            first.and_then(|(one, value)| Some(format!("{}={}", one.key.as_ref()?, value.toml()))),
        );
        flags.retain(|flag| !of_fault.contains(flag));
        flags.extend(self.study.timing_flag(variant, false));
        flags
    }

    /// Returns a number in (0, 1) for a dimension of a draw.
    fn uniform(&self, source: &Source, draw: u64) -> f64 {
        let Source::Random { dimension, key } = source else {
            return 0.5;
        };
        let seed = self.study.seed;
        let random = |path: &str| {
            RandomStream::new(seed, &format!("campaign/{path}/{key:x}/{draw}")).uniform()
        };
        match self.study.sampling {
            Sampling::Grid => 0.5,
            // Moved up by half a step: the normal quantile is infinite at 0 and 1.
            Sampling::Independent => random("independent") + 0.5 / SEEDS,
            Sampling::LatinHypercube => {
                let draws = self.study.draws;
                let range = permutation::permuted(draw, draws, *key);
                let u = (range as f64 + random("hypercube") + 0.5 / SEEDS) / draws as f64;
                if u < 1.0 { u } else { 1.0 - 0.5 / SEEDS }
            }
            Sampling::Sobol => {
                let index = u32::try_from(draw).unwrap_or_default();
                sobol_number(index, *dimension, *key)
            }
            Sampling::Saltelli => {
                let values = self.study.drawn() as u64;
                let width = draws_of_row(values);
                let index = u32::try_from(draw / width).unwrap_or_default();
                // The first draw of a row is A, the second B, the others A with one value from B.
                let part = draw % width;
                match part == 1 || part == *dimension as u64 + 2 {
                    false => sobol_number(index, *dimension, *key),
                    // The other half of the key displaces the dimension by another amount.
                    true => {
                        let dimension = *dimension + self.study.drawn();
                        sobol_number(index, dimension, key.rotate_left(32))
                    }
                }
            }
        }
    }

    /// Returns the index of a list entry: by position in a grid, where the last value changes fastest, and drawn
    /// otherwise.
    fn chosen(&self, draw: u64, place: usize, drawn: usize) -> usize {
        if self.study.sampling != Sampling::Grid {
            return drawn;
        }
        let length = |spread: &Spread| match spread {
            Spread::Choice(items) => items.len() as u64,
            _ => 1,
        };
        let after = self.study.varied[place + 1..].iter();
        let period: u64 = after.map(|one| length(&one.spread)).product();
        let index = draw / period % length(&self.study.varied[place].spread);
        usize::try_from(index).unwrap_or_default()
    }

    fn correlate(&self, uniform: &mut [f64]) {
        let free: Vec<f64> = self
            .normals
            .iter()
            .map(|place| normal::quantile(uniform[*place]))
            .collect();
        for (row, place) in self.factor.iter().zip(&self.normals) {
            let z = row
                .iter()
                .zip(&free)
                .fold(0.0, |sum, (weight, z)| sum + weight * z);
            uniform[*place] = normal::cumulative(z);
        }
    }
}

/// Returns a number in (0, 1) of a dimension of Sobol's sequence, displaced by the upper half of a key.
fn sobol_number(index: u32, dimension: usize, key: u64) -> f64 {
    let shifted = sobol::point(index, dimension) ^ (key >> 32) as u32;
    (f64::from(shifted) + 0.5) / (1_u64 << 32) as f64
}

/// Key of a varied value.
fn key(seed: u64, name: &str) -> u64 {
    let stream = format!("campaign/key/{name}");
    let mut stream = RandomStream::new(seed, &stream);
    let half = |u: f64| (u * (1_u64 << 32) as f64) as u64;
    (half(stream.uniform()) << 32) | half(stream.uniform())
}

/// Returns the quantile of a distribution at the probability `u`.
fn value(spread: &Spread, u: f64) -> f64 {
    let inside = |value: f64, [min, max]: [f64; 2]| {
        let value = if value < min { min } else { value };
        if value > max { max } else { value }
    };
    match *spread {
        Spread::Uniform { min, max } => inside(min + (max - min) * u, [min, max]),
        Spread::Normal {
            mean,
            deviation,
            within: [min, max],
        } => truncated::truncated(mean, deviation, min, max, u),
        Spread::Lognormal {
            median,
            sigma,
            within,
        } => {
            let log = |bound: f64| match bound {
                bound if bound > 0.0 => libm::log(bound),
                _ => f64::NEG_INFINITY,
            };
            let exponent =
                truncated::truncated(libm::log(median), sigma, log(within[0]), log(within[1]), u);
            inside(libm::exp(exponent), within)
        }
        Spread::Choice(_) | Spread::Expression(_) => f64::NAN,
    }
}

/// Returns the integer of a distribution at the probability `u`: all integers of a uniform distribution have the same
/// share of the probabilities; values of other distributions are rounded.
fn whole(spread: &Spread, u: f64) -> f64 {
    match *spread {
        Spread::Uniform { min, max } => {
            let number = libm::floor(min + (max - min + 1.0) * u);
            // Rounding of the sum may pass the last number by one.
            if number < max { number } else { max }
        }
        _ => rounded(value(spread, u)),
    }
}

/// Rounds to the nearest integer, halves away from zero; never returns a negative zero.
fn rounded(value: f64) -> f64 {
    libm::round(value) + 0.0
}

/// Computes the lower triangle `L` with `L L' = R` for the matrix `R` of correlations (Golub and Van Loan, Matrix
/// Computations, 4th ed., algorithm 4.2.1).
fn factor(study: &Study, normals: &[usize]) -> Result<Vec<Vec<f64>>, Problems> {
    let correlation = |row: usize, column: usize| {
        let of = [normals[column], normals[row]];
        let correlation = study.correlations.iter().find(|one| one.of == of);
        correlation.map_or(0.0, |one| one.coefficient)
    };
    let mut factor: Vec<Vec<f64>> = Vec::new();
    for (row, place) in normals.iter().enumerate() {
        let mut new: Vec<f64> = Vec::new();
        for column in 0..row {
            let above: &Vec<f64> = &factor[column];
            let known = above.iter().zip(&new).fold(0.0, |sum, (a, b)| sum + a * b);
            new.push((correlation(row, column) - known) / above[column]);
        }
        let rest = new.iter().fold(1.0, |rest, one| rest - one * one);
        if rest <= 1e-12 {
            let key = study.varied[*place].key.clone().unwrap_or_default();
            return Err(Problems(vec![study.problem_of(
                &key,
                "no values have these correlations: their matrix is not positive definite",
                "make the coefficients smaller, or leave one out",
            )]));
        }
        new.push(rest.sqrt());
        factor.push(new);
    }
    Ok(factor)
}

#[cfg(test)]
mod tests;
