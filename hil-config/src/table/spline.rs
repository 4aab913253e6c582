//! Cubic splines through points, by their second derivatives ("moments") M at the points.
//!
//! On an interval of length h with `s` since its beginning:
//! `y(s) = y0 + c1 s + M0 s^2 / 2 + (M1 - M0) s^3 / (6 h)` with `c1 = (y1 - y0) / h - h (2 M0 + M1) / 6`.
//! The first derivative is continuous if `h0 M0 + 2 (h0 + h1) M1 + h1 M2 = 6 (d1 - d0)` at every inner point, with the
//! slopes d of the straight lines (de Boor, *A Practical Guide to Splines*, chapter IV, in moments).

/// Returns the second derivatives of the natural spline, which are 0 at both ends.
pub(super) fn natural(times: &[f64], values: &[f64]) -> Vec<f64> {
    let count = times.len();
    let mut moments = vec![0.0; count];
    if count < 3 {
        return moments;
    }
    let system = Rows::of(times, values);
    let inner = system.solve(&system.right);
    moments[1..count - 1].copy_from_slice(&inner);
    moments
}

/// Returns the second derivatives of the periodic spline, whose last point is the first one of the next period.
pub(super) fn periodic(times: &[f64], values: &[f64]) -> Vec<f64> {
    let count = times.len();
    if count < 3 {
        return vec![0.0; count];
    }
    // Unknowns are M1 .. M(n-2), and M0 = M(n-1) = m: the inner equations give M = u + m v, and the equation at the
    // seam gives m.
    let system = Rows::of(times, values);
    let (first, last) = (times[1] - times[0], times[count - 1] - times[count - 2]);
    let slope = |at: usize| (values[at + 1] - values[at]) / (times[at + 1] - times[at]);
    let mut edges = vec![0.0; count - 2];
    edges[0] -= first;
    edges[count - 3] -= last;
    let (u, v) = (system.solve(&system.right), system.solve(&edges));
    let jump = 6.0 * (slope(0) - slope(count - 2));
    let of = |inner: &[f64]| first * inner[0] + last * inner[count - 3];
    let seam = (jump - of(&u)) / (2.0 * (first + last) + of(&v));
    let mut moments = vec![seam; count];
    for (moment, (u, v)) in moments[1..count - 1].iter_mut().zip(u.iter().zip(&v)) {
        *moment = u + seam * v;
    }
    moments
}

/// Equations at the inner points: symmetric, tridiagonal and dominated by their diagonal.
struct Rows {
    lengths: Vec<f64>,
    right: Vec<f64>,
}

impl Rows {
    fn of(times: &[f64], values: &[f64]) -> Self {
        let lengths: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let slope = |at: usize| (values[at + 1] - values[at]) / lengths[at];
        let right = (1..lengths.len()).map(|at| 6.0 * (slope(at) - slope(at - 1)));
        Self {
            right: right.collect(),
            lengths,
        }
    }

    /// Solves for a right side by elimination (Thomas).
    fn solve(&self, right: &[f64]) -> Vec<f64> {
        let h = &self.lengths;
        let mut above = Vec::with_capacity(right.len());
        let mut solution: Vec<f64> = Vec::with_capacity(right.len());
        for (at, right) in right.iter().enumerate() {
            let diagonal = 2.0 * (h[at] + h[at + 1]);
            let (before, factor) = match at {
                0 => (0.0, 0.0),
                _ => (h[at] * solution[at - 1], h[at] * above[at - 1]),
            };
            above.push(h[at + 1] / (diagonal - factor));
            solution.push((right - before) / (diagonal - factor));
        }
        for at in (0..solution.len().saturating_sub(1)).rev() {
            solution[at] -= above[at] * solution[at + 1];
        }
        solution
    }
}

/// Returns the value and five derivatives between two points, each with its value and second derivative; the third
/// derivative is that of the interval, the others are 0.
pub(super) fn evaluate([[y0, m0], [y1, m1]]: [[f64; 2]; 2], length: f64, since: f64) -> [f64; 6] {
    let (h, s) = (length, since);
    let c1 = (y1 - y0) / h - h * (2.0 * m0 + m1) / 6.0;
    let c3 = (m1 - m0) / (6.0 * h);
    [
        y0 + s * (c1 + s * (m0 / 2.0 + s * c3)),
        c1 + s * (m0 + s * 3.0 * c3),
        m0 + s * 6.0 * c3,
        6.0 * c3,
        0.0,
        0.0,
    ]
}
