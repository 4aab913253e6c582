//! Response at the beginning of a sweep, where one turn may span several times the first frequency.

use std::f64::consts::PI;

use super::chirp::Chirp;

/// Ratio by which the frequency may rise over the fitted turns, if there are enough of them.
const RISE: f64 = 1.2;
/// Minimum number of turns.
const TURNS: f64 = 2.0;
/// A constant, and `x` with its first four derivatives.
const TERMS: usize = 6;

/// Fit over the first turns of a chirp `x = sin(phi(t))`.
///
/// A stable system of transfer function `H(s) = h_0 + h_1 s + h_2 s^2 + ..` responds with
/// `h_0 x + h_1 x' + h_2 x'' + ..`, however fast the frequency rises. Input and output are each fitted with this series
/// up to `h_4` plus a constant, by least squares; the ratio of their `H(j 2 pi f_0)` is the response at the first
/// frequency. Over a narrow band the terms describe a parabola for the real part and a straight line for the imaginary
/// part, so the series need not converge well around 0.
///
/// The first turn, in which the system still leaves its rest, is skipped if the frequency hardly rises during that
/// turn.
#[derive(Clone, Debug)]
pub(super) struct LowEnd {
    chirp: Chirp,
    /// First and last turn.
    turns: [f64; 2],
    /// Angular frequency that scales the derivatives.
    scale_radps: f64,
    products: [[f64; TERMS]; TERMS],
    input: [f64; TERMS],
    output: [f64; TERMS],
}

impl LowEnd {
    pub(super) fn new(chirp: Chirp) -> Self {
        let all = libm::floor(chirp.turns());
        let low_hz = RISE * chirp.start_hz();
        let is_slow = chirp.frequency_hz(1.0) < low_hz && all > TURNS;
        let first = if is_slow { 1.0 } else { 0.0 };
        let last = match libm::floor(chirp.turns_to(low_hz)) {
            turns if turns > first + TURNS => turns,
            _ => first + TURNS,
        };
        Self {
            chirp,
            turns: [first, last],
            scale_radps: 2.0 * PI * chirp.frequency_hz(last),
            products: Default::default(),
            input: Default::default(),
            output: Default::default(),
        }
    }

    /// Processes an existing sample, with the turns at its time and the sine and cosine of its phase.
    pub(super) fn take(
        &mut self,
        time_s: f64,
        (turns, sin, cos): (f64, f64, f64),
        input: f64,
        output: f64,
    ) {
        let [first, last] = self.turns;
        if !(first..last).contains(&turns) {
            return;
        }
        let scale = self.scale_radps;
        // Time in units of 1 / scale.
        let mut unit = 1.0;
        let [w, w_1, w_2, w_3] = self.chirp.angular(time_s).map(|derivative| {
            unit *= scale;
            derivative / unit
        });
        let (w_w, w_w_w) = (w * w, w * w * w);
        let terms: [f64; TERMS] = [
            1.0,
            sin,
            w * cos,
            w_1 * cos - w_w * sin,
            (w_2 - w_w_w) * cos - 3.0 * w * w_1 * sin,
            (w_3 - 6.0 * w_w * w_1) * cos + (w_w * w_w - 4.0 * w * w_2 - 3.0 * w_1 * w_1) * sin,
        ];
        for (row, one) in terms.iter().enumerate() {
            for (product, other) in self.products[row].iter_mut().zip(&terms) {
                *product += one * other;
            }
            self.input[row] += one * input;
            self.output[row] += one * output;
        }
    }

    /// Returns the real and imaginary part of the response at the first frequency; `None` if there were too few samples
    /// to fit.
    pub(super) fn response(&self) -> Option<(f64, f64)> {
        let (a, b) = self.part(&self.input)?;
        let (c, d) = self.part(&self.output)?;
        let square = a * a + b * b;
        // (c + j d) / (a + j b)
        (square > 0.0).then(|| ((c * a + d * b) / square, (d * a - c * b) / square))
    }

    /// Returns the real and imaginary part of a fitted signal relative to the chirp at the first frequency.
    fn part(&self, values: &[f64; TERMS]) -> Option<(f64, f64)> {
        let [_, h_0, h_1, h_2, h_3, h_4] = solved(self.products, *values)?;
        let w = 2.0 * PI * self.chirp.start_hz() / self.scale_radps;
        let square = w * w;
        Some((
            h_0 - h_2 * square + h_4 * square * square,
            (h_1 - h_3 * square) * w,
        ))
    }
}

/// Solves symmetric normal equations by elimination, largest diagonal element first; `None` if the solution is not
/// unique.
fn solved(mut a: [[f64; TERMS]; TERMS], mut b: [f64; TERMS]) -> Option<[f64; TERMS]> {
    let largest = (0..TERMS).fold(
        0.0,
        |most: f64, i| if a[i][i] > most { a[i][i] } else { most },
    );
    let mut order: [usize; TERMS] = std::array::from_fn(|i| i);
    for eliminated in 0..TERMS {
        let place = (eliminated..TERMS).reduce(|best, i| {
            let (i_th, best_th) = (order[i], order[best]);
            if a[i_th][i_th] > a[best_th][best_th] {
                i
            } else {
                best
            }
        })?;
        order.swap(eliminated, place);
        let pivot = order[eliminated];
        let size = a[pivot][pivot];
        if size.is_nan() || size <= 1e-12 * largest {
            return None;
        }
        for &row in &order[eliminated + 1..] {
            let factor = a[row][pivot] / a[pivot][pivot];
            for &column in &order[eliminated..] {
                a[row][column] -= factor * a[pivot][column];
            }
            b[row] -= factor * b[pivot];
        }
    }
    let mut x = [0.0; TERMS];
    for eliminated in (0..TERMS).rev() {
        let row = order[eliminated];
        let rest: f64 = order[eliminated + 1..]
            .iter()
            .map(|&i| a[row][i] * x[i])
            .sum();
        x[row] = (b[row] - rest) / a[row][row];
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_equations_are_solved_in_any_order() {
        // A^T A of a matrix of whole numbers, times (1, -2, 3, -4, 5, -6).
        let rows: [[f64; TERMS]; 7] = [
            [1.0, 0.0, 2.0, 1.0, 0.0, 0.0],
            [0.0, 3.0, 0.0, 1.0, 1.0, 0.0],
            [4.0, 0.0, 1.0, 0.0, 2.0, 1.0],
            [0.0, 1.0, 0.0, 7.0, 0.0, 0.0],
            [1.0, 1.0, 0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 5.0, 0.0, 1.0, 2.0],
            [2.0, 0.0, 0.0, 1.0, 0.0, 3.0],
        ];
        let expected = [1.0, -2.0, 3.0, -4.0, 5.0, -6.0];
        let mut a = [[0.0; TERMS]; TERMS];
        let mut b = [0.0; TERMS];
        for row in rows {
            let value: f64 = row.iter().zip(expected).map(|(x, w)| x * w).sum();
            for i in 0..TERMS {
                for j in 0..TERMS {
                    a[i][j] += row[i] * row[j];
                }
                b[i] += row[i] * value;
            }
        }
        let actual = solved(a, b).expect("a solution");
        for (actual, expected) in actual.iter().zip(expected) {
            assert!(
                (actual - expected).abs() < 1e-12,
                "{actual}, not {expected}"
            );
        }
        a[2] = [0.0; TERMS];
        for row in &mut a {
            row[2] = 0.0;
        }
        assert_eq!(solved(a, b), None);
    }
}
