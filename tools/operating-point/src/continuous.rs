//! The continuous model of a discrete one whose inputs are held over each period, and the reverse. Exact: no approximation of the hold.
//!
//! `exp(T [A_c B_c; 0 0]) = [A B; 0 1]`, so the continuous matrices are the logarithm of the discrete ones. The
//! logarithm does not exist, or is not real, where A is singular or has an eigenvalue on the negative real axis.

use nalgebra::DMatrix;
use nalgebra::linalg::balancing::balance_parlett_reinsch;
use shared_types::extremes::larger;
use shared_types::local_map::LocalMap;

use crate::model::LinearModel;
use crate::modes;

/// Distance from the unit matrix below which the series of the logarithm is used.
const CLOSE: f64 = 0.25;
/// Largest number of square roots, and of iterations of each.
const ROOTS: u32 = 60;
/// Relative difference at which the iteration of a square root has converged.
const CONVERGED: f64 = 1e-14;
/// Terms of the series; the first that is left out is below `(CLOSE / 1.7)^41`.
const TERMS: u32 = 20;
/// Largest relative difference of the exponential of the result from the discrete matrices.
const TOLERANCE: f64 = 1e-7;

/// Continuous matrices.
#[derive(Clone, Debug)]
pub(crate) struct Continuous {
    pub(crate) a: DMatrix<f64>,
    pub(crate) b: DMatrix<f64>,
}

/// Derives the continuous matrices of a discrete model.
///
/// # Errors
/// The reason why there are none.
pub(crate) fn of(model: &LinearModel) -> Result<Continuous, String> {
    let (n, m) = (model.states.len(), model.inputs.len());
    for z in modes::eigenvalues(&model.a)? {
        let size = libm::hypot(z.re, z.im);
        if size < 1e-12 {
            return Err("an eigenvalue of A is 0, which no continuous system has".into());
        }
        if z.re < 0.0 && z.im.abs() <= 1e-9 * size {
            return Err(format!(
                "A has the eigenvalue {:.6}, which no continuous system of this order has",
                z.re
            ));
        }
    }
    let mut joined = DMatrix::identity(n + m, n + m);
    joined.view_mut((0, 0), (n, n)).copy_from(&model.a);
    joined.view_mut((0, n), (n, m)).copy_from(&model.b);
    let log =
        logarithm(&joined).ok_or("the logarithm of the discrete matrices does not converge")?;
    let t = model.period_s;
    Ok(Continuous {
        a: log.view((0, 0), (n, n)) / t,
        b: log.view((0, n), (n, m)) / t,
    })
}

/// Creates the model of a map whose first rows are rates: its inputs are held over each period.
pub(crate) fn sampled(map: LocalMap) -> LinearModel {
    let model = LinearModel::of(map);
    let (n, m) = (model.states.len(), model.inputs.len());
    let mut joined = DMatrix::zeros(n + m, n + m);
    joined.view_mut((0, 0), (n, n)).copy_from(&model.a);
    joined.view_mut((0, n), (n, m)).copy_from(&model.b);
    let held = exponential(&(joined * model.period_s));
    LinearModel {
        a: held.view((0, 0), (n, n)).clone_owned(),
        b: held.view((0, n), (n, m)).clone_owned(),
        continuous: Some([model.a, model.b]),
        ..model
    }
}

/// Creates the model of a law's map whose first rows are rates: a step advances them by a period with the sample held,
/// and then reads the command.
pub(crate) fn stepped(map: LocalMap) -> LinearModel {
    let model = sampled(map);
    // y(k) = C x(k+1) + D u(k)
    LinearModel {
        c: &model.c * &model.a,
        d: &model.c * &model.b + &model.d,
        ..model
    }
}

/// Returns the principal logarithm, by inverse scaling and squaring on the balanced matrix.
fn logarithm(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let size = matrix.nrows();
    if size == 0 {
        return Some(matrix.clone());
    }
    let one = DMatrix::identity(size, size);
    let mut root = matrix.clone();
    let scale = balance_parlett_reinsch(&mut root);
    let balanced = root.clone();
    let mut count = 0;
    while norm(&(&root - &one)) > CLOSE {
        root = square_root(&root)?;
        count += 1;
        if count > ROOTS {
            return None;
        }
    }
    // log(M) = 2 atanh(Z), Z = (M - 1) (M + 1)^-1.
    let z = (&root - &one) * (&root + &one).try_inverse()?;
    let square = &z * &z;
    let (mut power, mut sum) = (z.clone(), z);
    for term in 1..TERMS {
        power = &power * &square;
        sum += &power / f64::from(2 * term + 1);
    }
    let log = sum * (2.0 * libm::exp2(f64::from(count)));
    if norm(&(exponential(&log) - &balanced)) > TOLERANCE * norm(&balanced) {
        return None;
    }
    Some(DMatrix::from_fn(size, size, |row, column| {
        log[(row, column)] * scale[row] / scale[column]
    }))
}

/// Returns the exponential, by scaling and squaring of its series.
fn exponential(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    let (mut scaled, mut squarings) = (matrix.clone(), 0);
    while norm(&scaled) > 0.5 && squarings < 1000 {
        scaled *= 0.5;
        squarings += 1;
    }
    let mut power = DMatrix::identity(matrix.nrows(), matrix.ncols());
    let mut sum = power.clone();
    for term in 1..TERMS {
        power = &power * &scaled / f64::from(term);
        sum += &power;
    }
    for _ in 0..squarings {
        sum = &sum * &sum;
    }
    sum
}

/// Returns the principal square root, by the iteration of Denman and Beavers.
fn square_root(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let mut root = matrix.clone();
    let mut inverse = DMatrix::identity(matrix.nrows(), matrix.ncols());
    let mut change = f64::INFINITY;
    for _ in 0..ROOTS {
        let next = (&root + inverse.clone().try_inverse()?) * 0.5;
        inverse = (&inverse + root.clone().try_inverse()?) * 0.5;
        let now = norm(&(&next - &root)) / norm(&next);
        root = next;
        // Rounding ends the decrease.
        if now < CONVERGED || (now < 1e-9 && now >= change) {
            return Some(root);
        }
        change = now;
    }
    None
}

/// Returns the largest sum of the sizes in a column.
fn norm(matrix: &DMatrix<f64>) -> f64 {
    let sums = matrix.column_iter().map(|column| column.lp_norm(1));
    sums.fold(0.0, larger)
}

#[cfg(test)]
mod tests {
    use shared_types::local_map::{Accuracy, Variable};

    use super::*;

    #[test]
    fn a_model_of_rates_is_sampled_with_held_inputs() {
        // x' = -2 x + 3 u over 0.1 s.
        let variable = |name: &str| Variable {
            name: name.into(),
            unit: "1".into(),
            value: 0.0,
        };
        let accuracy = Accuracy {
            step: 0.0,
            error: 0.0,
        };
        let model = sampled(LocalMap {
            period_s: 0.1,
            states: vec![variable("x")],
            inputs: vec![variable("u")],
            outputs: vec![variable("y")],
            truth: Vec::new(),
            next: Vec::new(),
            columns: vec![vec![-2.0, 5.0], vec![3.0, 7.0]],
            accuracy: vec![accuracy; 2],
            is_continuous: true,
        });
        let decay = libm::exp(-0.2);
        assert!((model.a[(0, 0)] - decay).abs() < 1e-15);
        assert!((model.b[(0, 0)] - 1.5 * (1.0 - decay)).abs() < 1e-15);
        assert_eq!((model.c[(0, 0)], model.d[(0, 0)]), (5.0, 7.0));
        let [a, b] = model.continuous.expect("stated");
        assert_eq!((a[(0, 0)], b[(0, 0)]), (-2.0, 3.0));
    }

    fn of_rows<const N: usize>(rows: [[f64; N]; N]) -> DMatrix<f64> {
        DMatrix::from_fn(N, N, |row, column| rows[row][column])
    }

    #[test]
    fn the_logarithm_of_a_rotation_is_its_angle() {
        let (c, s) = (libm::cos(3.0), libm::sin(3.0));
        let log = logarithm(&of_rows([[c, -s], [s, c]])).expect("exists");
        let off = norm(&(log - of_rows([[0.0, -3.0], [3.0, 0.0]])));
        assert!(off < 1e-12, "{off}");
    }

    #[test]
    fn units_that_differ_by_ten_orders_do_not_matter() {
        // A stiff pressure beside a position: x' = 2e-9 p - x, p' = -1e10 x - 50 p.
        let continuous = of_rows([[-1.0, 2e-9], [-1e10, -50.0]]);
        // Exponentiated with p in a unit that is a power of 2, because the series needs comparable sizes.
        let unit = libm::exp2(31.0);
        let alike = of_rows([[-1.0, 2e-9 * unit], [-1e10 / unit, -50.0]]);
        let mut discrete = exponential(&(alike * 0.05));
        discrete[(0, 1)] /= unit;
        discrete[(1, 0)] *= unit;
        let log = logarithm(&discrete).expect("exists") / 0.05;
        for (value, expected) in log.iter().zip(continuous.iter()) {
            assert!((value / expected - 1.0).abs() < 1e-9, "{log}");
        }
    }

    #[test]
    fn a_defective_matrix_has_its_logarithm() {
        let log = logarithm(&of_rows([[1.0, 5.0], [0.0, 1.0]])).expect("exists");
        assert!(norm(&(log - of_rows([[0.0, 5.0], [0.0, 0.0]]))) < 1e-12);
    }
}
