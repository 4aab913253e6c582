//! Discrete Fourier transform of any length.
//!
//! Written here because the transforms of others choose their arithmetic by the processor, and a figure has the same
//! bytes everywhere. Powers of two are transformed by the radix-2 algorithm of Cooley and Tukey, other lengths as a
//! convolution (Bluestein, 1970). Knows nothing of units and windows.

use std::f64::consts::PI;

/// Complex number.
pub(super) type Complex = [f64; 2];

/// Computes `X_k = sum x_n exp(-2 pi j k n / N)`.
pub(super) fn transform(values: &[Complex]) -> Vec<Complex> {
    let n = values.len();
    if n <= 1 || n.is_power_of_two() {
        let mut values = values.to_vec();
        radix_2(&mut values, -1.0);
        return values;
    }
    // k n = (k^2 + n^2 - (k - n)^2) / 2, so the sum is a convolution with a chirp.
    let chirp: Vec<Complex> = (0..n as u64)
        .map(|k| {
            // The remainder keeps the angle exact for large k.
            let turn = (k * k) % (2 * n as u64);
            let (sin, cos) = libm::sincos(PI * turn as f64 / n as f64);
            [cos, -sin]
        })
        .collect();
    let size = (2 * n - 1).next_power_of_two();
    let mut signal = vec![[0.0; 2]; size];
    let mut kernel = vec![[0.0; 2]; size];
    for (k, (value, turn)) in values.iter().zip(&chirp).enumerate() {
        signal[k] = product(*value, *turn);
        let [re, im] = *turn;
        kernel[k] = [re, -im];
        kernel[(size - k) % size] = [re, -im];
    }
    radix_2(&mut signal, -1.0);
    radix_2(&mut kernel, -1.0);
    for (one, other) in signal.iter_mut().zip(&kernel) {
        *one = product(*one, *other);
    }
    radix_2(&mut signal, 1.0);
    let scale = 1.0 / size as f64;
    (signal.iter().zip(&chirp))
        .map(|(one, turn)| {
            let [re, im] = product(*one, *turn);
            [re * scale, im * scale]
        })
        .collect()
}

fn product([a, b]: Complex, [c, d]: Complex) -> Complex {
    [a * c - b * d, a * d + b * c]
}

/// Transforms in place, with this sign of the exponent; the length is a power of two.
fn radix_2(values: &mut [Complex], sign: f64) {
    let n = values.len();
    if n < 2 {
        return;
    }
    let bits = n.trailing_zeros();
    for k in 0..n {
        let other = k.reverse_bits() >> (usize::BITS - bits);
        if other > k {
            values.swap(k, other);
        }
    }
    let turns: Vec<Complex> = (0..n / 2)
        .map(|k| {
            let (sin, cos) = libm::sincos(2.0 * PI * k as f64 / n as f64);
            [cos, sign * sin]
        })
        .collect();
    let mut length = 2;
    while length <= n {
        let (half, stride) = (length / 2, n / length);
        for block in values.chunks_exact_mut(length) {
            let (low, high) = block.split_at_mut(half);
            for (k, (a, b)) in low.iter_mut().zip(high).enumerate() {
                let turned = product(*b, turns[k * stride]);
                let sum = [a[0] + turned[0], a[1] + turned[1]];
                *b = [a[0] - turned[0], a[1] - turned[1]];
                *a = sum;
            }
        }
        length *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_length_agrees_with_the_sum_that_defines_the_transform() {
        for n in [1_usize, 2, 3, 5, 8, 12, 17, 64, 100, 101] {
            let values: Vec<Complex> = (0..n)
                .map(|k| [libm::sin(1.7 * k as f64) + 0.3, libm::cos(0.9 * k as f64)])
                .collect();
            for (k, actual) in transform(&values).into_iter().enumerate() {
                let mut expected = [0.0; 2];
                for (place, value) in values.iter().enumerate() {
                    let angle = -2.0 * PI * ((k * place) % n) as f64 / n as f64;
                    let term = product(*value, [libm::cos(angle), libm::sin(angle)]);
                    expected = [expected[0] + term[0], expected[1] + term[1]];
                }
                let off = libm::hypot(actual[0] - expected[0], actual[1] - expected[1]);
                assert!(off < 1e-11 * n as f64, "{n}, {k}: {off}");
            }
        }
    }
}
