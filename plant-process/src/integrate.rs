//! Fixed-step integration: the classical Runge-Kutta method of order 4.
//!
//! Called by models inside [`Plant::advance`](crate::plant::Plant::advance). The integrator never chooses a step size,
//! estimates no error and never allocates, so that a run takes the same path on every machine.

use std::ops::{Add, Mul};

use shared_types::time::Interval;

/// Integrates `dx/dt = rates(t, x)` over an interval in its equal substeps.
///
/// Most models need only this function:
///
/// ```
/// use plant_process::integrate::integrate;
/// use shared_types::time::Interval;
///
/// let mut x = [1.0];
/// let second = Interval { start_s: 0.0, length_s: 1.0, substeps: 100 };
/// integrate(&mut x, &second, |_, [x]| [-x]);
/// assert!((x[0] - libm::exp(-1.0)).abs() < 1e-9);
/// ```
pub fn integrate<const N: usize>(
    state: &mut [f64; N],
    interval: &Interval,
    mut rates: impl FnMut(f64, &[f64; N]) -> [f64; N],
) {
    let h = interval.substep_s();
    for substep in 0..interval.substeps {
        let time_s = interval.start_s + f64::from(substep) * h;
        let nodes_s = [time_s, time_s + 0.5 * h, time_s + h];
        rk4_step(state, h, &nodes_s, |t, x| rates(*t, x));
    }
}

/// Takes a step of the classical Runge-Kutta method.
///
/// `k1 = f(u(t), x)`, `k2 = f(u(t + h/2), x + h/2 k1)`, `k3 = f(u(t + h/2), x + h/2 k2)`,
/// `k4 = f(u(t + h), x + h k3)`, `x += h/6 (k1 + 2 k2 + 2 k3 + k4)`
/// (Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, 2nd ed., table II.1.2).
/// The local error is of order `h^5` if `f` is four times differentiable.
///
/// `inputs` are the quantities that depend on time alone, at the beginning, middle and end of the step: the method
/// needs no other times, and a costly input is evaluated once although the method uses it twice.
///
/// A component of the state is a number or an array of numbers.
#[inline(always)]
pub fn rk4_step<const N: usize, Component, Input>(
    state: &mut [Component; N],
    step_s: f64,
    inputs: &[Input; 3],
    mut rates: impl FnMut(&Input, &[Component; N]) -> [Component; N],
) where
    Component: Copy + Add<Output = Component> + Mul<f64, Output = Component>,
{
    let (x, h) = (*state, step_s);
    let [begin, middle, end] = inputs;
    let k1 = rates(begin, &x);
    let k2 = rates(middle, &along(&x, 0.5 * h, &k1));
    let k3 = rates(middle, &along(&x, 0.5 * h, &k2));
    let k4 = rates(end, &along(&x, h, &k3));
    for i in 0..N {
        state[i] = x[i] + (k1[i] + (k2[i] + k3[i]) * 2.0 + k4[i]) * (h / 6.0);
    }
}

/// Computes `x + k h`.
#[inline]
fn along<const N: usize, Component>(
    x: &[Component; N],
    h: f64,
    k: &[Component; N],
) -> [Component; N]
where
    Component: Copy + Add<Output = Component> + Mul<f64, Output = Component>,
{
    std::array::from_fn(|i| x[i] + k[i] * h)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Error at 1 s of `x' = -x + cos t`, `x(0) = 0`, whose solution is `(cos t + sin t - exp(-t)) / 2`.
    fn error_at_one_second(substeps: u32) -> f64 {
        let mut x = [0.0];
        let interval = Interval {
            start_s: 0.0,
            length_s: 1.0,
            substeps,
        };
        integrate(&mut x, &interval, |t, [x]| [libm::cos(t) - x]);
        let exact = 0.5 * (libm::cos(1.0) + libm::sin(1.0) - libm::exp(-1.0));
        (x[0] - exact).abs()
    }

    #[test]
    fn halving_the_step_divides_the_error_by_sixteen() {
        for substeps in [8, 16, 32, 64] {
            let ratio = error_at_one_second(substeps) / error_at_one_second(2 * substeps);
            assert!((14.5..17.5).contains(&ratio), "{substeps}: {ratio}");
        }
    }

    #[test]
    fn a_polynomial_of_degree_four_in_time_is_integrated_exactly() {
        // The method's weights are Simpson's rule, exact up to degree 3 in the derivative.
        let mut x = [0.0];
        let interval = Interval {
            start_s: 1.0,
            length_s: 2.0,
            substeps: 1,
        };
        integrate(&mut x, &interval, |t, _| [4.0 * t * t * t]);
        assert!((x[0] - 80.0).abs() < 1e-12, "{}", x[0]);
    }

    #[test]
    fn a_coupled_oscillator_returns_after_one_period() {
        let mut x = [1.0, 0.0];
        let interval = Interval {
            start_s: 0.0,
            length_s: std::f64::consts::TAU,
            substeps: 1000,
        };
        integrate(&mut x, &interval, |_, [x, v]| [*v, -x]);
        assert!((x[0] - 1.0).abs() < 1e-10 && x[1].abs() < 1e-10, "{x:?}");
    }

    #[test]
    fn inputs_are_evaluated_at_beginning_middle_and_end() {
        let mut times = Vec::new();
        rk4_step(&mut [0.0], 1.0, &[1, 2, 3], |input, _| {
            times.push(*input);
            [0.0]
        });
        assert_eq!(times, [1, 2, 2, 3]);
    }
}
