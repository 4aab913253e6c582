//! Minimisation without derivatives: the evolution strategy with covariance matrix adaptation (Hansen, The CMA
//! Evolution Strategy: A Tutorial, 2016, arXiv:1604.00772, with the parameters of its table 1).
//!
//! Candidates are drawn and ranked in turns; only their order counts, so that failures without a number can be ranked
//! too. Knows no runs, and no bounds of its search space.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use shared_types::random::RandomStream;

use crate::normal;

/// Search distribution.
pub(crate) struct CmaEs {
    mean: DVector<f64>,
    /// Standard deviation of the whole distribution.
    step: f64,
    covariance: DMatrix<f64>,
    step_path: DVector<f64>,
    covariance_path: DVector<f64>,
    generation: i32,
    constants: Constants,
    random: RandomStream,
    /// Axes of the distribution as columns, each scaled by its standard deviation, and the same without the scale.
    axes: DMatrix<f64>,
    directions: DMatrix<f64>,
}

struct Constants {
    population: usize,
    /// Weights of the best half of the candidates, best first.
    weights: Vec<f64>,
    /// Effective number of selected candidates, called mu_eff.
    selected: f64,
    c_step: f64,
    damping: f64,
    c_path: f64,
    c_one: f64,
    c_mu: f64,
    /// Expected length of a standard normal vector.
    length: f64,
}

impl Constants {
    fn of(dimensions: usize) -> Self {
        let n = dimensions as f64;
        let population = 4 + (3.0 * libm::log(n)) as usize;
        let half = population / 2;
        let raw = (1..=half).map(|rank| {
            let middle = libm::log((population as f64 + 1.0) / 2.0);
            middle - libm::log(rank as f64)
        });
        let raw: Vec<f64> = raw.collect();
        let sum: f64 = raw.iter().sum();
        let weights: Vec<f64> = raw.iter().map(|weight| weight / sum).collect();
        let selected = 1.0 / weights.iter().map(|weight| weight * weight).sum::<f64>();
        let c_step = (selected + 2.0) / (n + selected + 5.0);
        let c_one = 2.0 / ((n + 1.3) * (n + 1.3) + selected);
        let c_mu = 2.0 * (selected - 2.0 + 1.0 / selected) / ((n + 2.0) * (n + 2.0) + selected);
        Self {
            population,
            weights,
            selected,
            c_step,
            damping: 1.0 + 2.0 * positive(((selected - 1.0) / (n + 1.0)).sqrt() - 1.0) + c_step,
            c_path: (4.0 + selected / n) / (n + 4.0 + 2.0 * selected / n),
            c_one,
            c_mu: if c_mu < 1.0 - c_one {
                c_mu
            } else {
                1.0 - c_one
            },
            length: n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n)),
        }
    }
}

/// Returns a positive number unchanged, and 0 for any other.
const fn positive(value: f64) -> f64 {
    if value > 0.0 { value } else { 0.0 }
}

impl CmaEs {
    /// Begins at a point with the same standard deviation in all directions.
    pub(crate) fn new(start: &[f64], step: f64, seed: u64) -> Self {
        let n = start.len();
        Self {
            mean: DVector::from_row_slice(start),
            step,
            covariance: DMatrix::identity(n, n),
            step_path: DVector::zeros(n),
            covariance_path: DVector::zeros(n),
            generation: 0,
            constants: Constants::of(n),
            random: RandomStream::new(seed, "campaign/cma-es"),
            axes: DMatrix::identity(n, n),
            directions: DMatrix::identity(n, n),
        }
    }

    /// Returns the largest standard deviation of a coordinate.
    pub(crate) fn deviation(&self) -> f64 {
        let largest = self
            .covariance
            .diagonal()
            .iter()
            .copied()
            .fold(
                0.0,
                |largest, one| if one > largest { one } else { largest },
            );
        self.step * largest.sqrt()
    }

    /// Draws the candidates of a generation.
    pub(crate) fn candidates(&mut self) -> Vec<Vec<f64>> {
        let n = self.mean.len();
        let mut all = Vec::new();
        for _ in 0..self.constants.population {
            let z = DVector::from_fn(n, |_, _| {
                let u = self.random.uniform();
                normal::quantile(u.clamp(f64::EPSILON, 1.0 - f64::EPSILON))
            });
            let candidate = &self.mean + self.step * (&self.axes * z);
            all.push(candidate.iter().copied().collect());
        }
        all
    }

    /// Adapts the distribution to the ranked candidates of the generation, the best first.
    pub(crate) fn adapt(&mut self, ranked: &[Vec<f64>]) {
        let c = &self.constants;
        let n = self.mean.len();
        let steps: Vec<DVector<f64>> = (ranked.iter().take(c.weights.len()))
            .map(|one| (DVector::from_row_slice(one) - &self.mean) / self.step)
            .collect();
        let mut moved = DVector::zeros(n);
        for (weight, step) in c.weights.iter().zip(&steps) {
            moved += *weight * step;
        }
        self.mean += self.step * &moved;
        self.generation += 1;

        // Equation 43: the path of the step size, in coordinates in which the distribution is a sphere.
        let whitened = self.whitened(&moved);
        let gain = (c.c_step * (2.0 - c.c_step) * c.selected).sqrt();
        self.step_path = (1.0 - c.c_step) * &self.step_path + gain * whitened;
        let length = self.step_path.norm();
        let decay = libm::pow(1.0 - c.c_step, 2.0 * f64::from(self.generation));
        let is_short = length / (1.0 - decay).sqrt() < (1.4 + 2.0 / (n as f64 + 1.0)) * c.length;

        // Equations 45 and 47: the path of the covariance, and both updates of the covariance.
        let h = f64::from(u8::from(is_short));
        let gain = h * (c.c_path * (2.0 - c.c_path) * c.selected).sqrt();
        self.covariance_path = (1.0 - c.c_path) * &self.covariance_path + gain * &moved;
        let lost = (1.0 - h) * c.c_path * (2.0 - c.c_path);
        let kept = 1.0 + c.c_one * lost - c.c_one - c.c_mu;
        let path = &self.covariance_path;
        self.covariance = kept * &self.covariance + c.c_one * path * path.transpose();
        for (weight, step) in c.weights.iter().zip(&steps) {
            self.covariance += c.c_mu * *weight * step * step.transpose();
        }

        // Equation 44: the step size.
        self.step *= libm::exp(c.c_step / c.damping * (length / c.length - 1.0));
        self.decompose();
    }

    /// Removes the shape of the distribution from a step.
    fn whitened(&self, step: &DVector<f64>) -> DVector<f64> {
        let mut along = self.directions.transpose() * step;
        for (place, value) in along.iter_mut().enumerate() {
            let deviation = self.axes.column(place).norm();
            *value = if deviation > 0.0 {
                *value / deviation
            } else {
                0.0
            };
        }
        &self.directions * along
    }

    fn decompose(&mut self) {
        let symmetric = 0.5 * (&self.covariance + self.covariance.transpose());
        let eigen = SymmetricEigen::new(symmetric.clone());
        self.covariance = symmetric;
        self.directions = eigen.eigenvectors;
        self.axes = self.directions.clone();
        for (mut column, value) in self.axes.column_iter_mut().zip(eigen.eigenvalues.iter()) {
            column *= positive(*value).sqrt();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::CmaEs;

    /// Minimises a function and returns the point and the number of evaluations.
    fn minimum(start: &[f64], step: f64, most: usize, f: impl Fn(&[f64]) -> f64) -> Vec<f64> {
        let mut search = CmaEs::new(start, step, 1);
        let mut evaluations = 0;
        let mut best = start.to_vec();
        while evaluations < most && search.deviation() > 1e-9 {
            let mut all = search.candidates();
            evaluations += all.len();
            all.sort_by(|a, b| f(a).total_cmp(&f(b)));
            if f(&all[0]) < f(&best) {
                best.clone_from(&all[0]);
            }
            search.adapt(&all);
        }
        best
    }

    fn assert_near(point: &[f64], expected: &[f64]) {
        for (value, expected) in point.iter().zip(expected) {
            assert!((value - expected).abs() < 1e-5, "{point:?}");
        }
    }

    #[test]
    fn the_minimum_of_a_sphere_is_its_centre() {
        let sphere = |x: &[f64]| x.iter().map(|one| (one - 0.3) * (one - 0.3)).sum();
        assert_near(&minimum(&[0.9; 4], 0.3, 3000, sphere), &[0.3; 4]);
        assert_near(&minimum(&[0.9], 0.3, 1000, sphere), &[0.3]);
    }

    #[test]
    fn a_narrow_curved_valley_is_followed_to_its_end() {
        // Rosenbrock, An automatic method for finding the greatest or least value of a function, 1960: least at (1, 1).
        let valley = |x: &[f64]| {
            let (a, b) = (x[1] - x[0] * x[0], 1.0 - x[0]);
            100.0 * a * a + b * b
        };
        assert_near(&minimum(&[-1.2, 1.0], 0.3, 4000, valley), &[1.0, 1.0]);
    }

    #[test]
    fn axes_that_differ_a_thousandfold_and_are_rotated_do_not_matter() {
        let rotated = |x: &[f64]| {
            let (a, b) = (0.6 * x[0] + 0.8 * x[1], 0.8 * x[0] - 0.6 * x[1]);
            1e6 * a * a + b * b
        };
        assert_near(&minimum(&[0.5, 0.5], 0.3, 4000, rotated), &[0.0, 0.0]);
    }

    #[test]
    fn the_same_seed_gives_the_same_candidates() {
        let draw = || CmaEs::new(&[0.5, 0.5], 0.2, 7).candidates();
        assert_eq!(draw(), draw());
    }
}
