//! Sine fits of an input and an output at one frequency: the estimator that the closed-loop frequency response and
//! `hil margins` share.

/// Sums of the least-squares fits of an input and an output with `a sin(phi) + b cos(phi) + c`.
#[derive(Clone, Debug, Default)]
pub struct SineFit {
    rows: f64,
    sin: f64,
    cos: f64,
    sin_sin: f64,
    sin_cos: f64,
    cos_cos: f64,
    input: Sums,
    output: Sums,
}

#[derive(Clone, Debug, Default)]
struct Sums {
    value: f64,
    value_sin: f64,
    value_cos: f64,
}

impl SineFit {
    /// Adds a sample of input and output at a phase with this sine and cosine.
    pub fn take(&mut self, sin: f64, cos: f64, [input, output]: [f64; 2]) {
        self.rows += 1.0;
        self.sin += sin;
        self.cos += cos;
        self.sin_sin += sin * sin;
        self.sin_cos += sin * cos;
        self.cos_cos += cos * cos;
        for (sums, value) in [(&mut self.input, input), (&mut self.output, output)] {
            sums.value += value;
            sums.value_sin += value * sin;
            sums.value_cos += value * cos;
        }
    }

    /// Returns `a + j b` of input and of output; `None` if there were too few samples to fit.
    #[must_use]
    pub fn phasors(&self) -> Option<[(f64, f64); 2]> {
        Some([self.fit(&self.input)?, self.fit(&self.output)?])
    }

    /// Returns gain and phase of the output relative to the input; `None` if there were too few samples to fit.
    pub(super) fn response(&self) -> Option<(f64, f64)> {
        let [(a, b), (c, d)] = self.phasors()?;
        let square = a * a + b * b;
        // (c + j d) / (a + j b)
        let (real, imaginary) = ((c * a + d * b) / square, (d * a - c * b) / square);
        let gain = libm::hypot(real, imaginary);
        (square > 0.0 && gain.is_finite()).then(|| (gain, libm::atan2(imaginary, real)))
    }

    /// Returns a and b of `a sin + b cos + c`, by the normal equations with means removed.
    fn fit(&self, sums: &Sums) -> Option<(f64, f64)> {
        let n = self.rows;
        let without_mean = |products: f64, one: f64, other: f64| products - one * other / n;
        let ss = without_mean(self.sin_sin, self.sin, self.sin);
        let sc = without_mean(self.sin_cos, self.sin, self.cos);
        let cc = without_mean(self.cos_cos, self.cos, self.cos);
        let vs = without_mean(sums.value_sin, sums.value, self.sin);
        let vc = without_mean(sums.value_cos, sums.value, self.cos);
        let determinant = ss * cc - sc * sc;
        // Far from singular for the eight samples or more of a turn.
        (n >= 4.0 && determinant > 1e-6 * n * n).then(|| {
            (
                (vs * cc - vc * sc) / determinant,
                (vc * ss - vs * sc) / determinant,
            )
        })
    }
}
