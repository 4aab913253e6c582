//! Jumps at the point of a derivative: what a difference to one side keeps however small its step is.
//!
//! A central difference averages such a jump away as its step grows. Only [`derivative`](super::derivative) calls this
//! module, which judges no kink and no root.

use super::{Level, NoDerivative, ROUNDING};

/// Number of the smallest steps at which the height of a jump is the same.
const STEPS: usize = 7;
/// Largest ratio of the heights at neighbouring steps; that of a root is `sqrt(2)` for a square root.
const ALIKE: f64 = 1.2;

/// Refuses an output that jumps at the point.
///
/// # Errors
/// If it does, with the height of the jump to each side.
pub(super) fn refuse(levels: &[Level], output: usize) -> Result<(), NoDerivative> {
    let left = height(levels, output, |level| level.left[output]);
    let right = height(levels, output, |level| level.right[output]);
    match left == 0.0 && right == 0.0 {
        true => Ok(()),
        false => Err(NoDerivative::Jump {
            output,
            left,
            right,
        }),
    }
}

/// Returns the height of the jump to one side, 0 if there is none.
///
/// The height is `2 d(h) - d(2 h)`, the limit of the change `d(h) = |f(x +- h) - f(x)|` at `h = 0` without its linear
/// part. That of a smooth output vanishes with the square of the step, that of a kink too.
fn height(levels: &[Level], output: usize, quotient: impl Fn(&Level) -> f64) -> f64 {
    let Some(near) = levels.get(..STEPS) else {
        return 0.0;
    };
    let noise = 100.0 * ROUNDING * near[STEPS - 1].scale[output];
    let change = |level: &Level| quotient(level) * level.step;
    let heights: Vec<f64> = (near.windows(2))
        .map(|pair| 2.0 * change(&pair[0]) - change(&pair[1]))
        .collect();
    let is_clear = heights.iter().all(|height| height.abs() > noise);
    let is_alike = heights.windows(2).all(|pair| {
        let ratio = pair[1] / pair[0];
        ratio < ALIKE && ratio > 1.0 / ALIKE
    });
    match is_clear && is_alike {
        true => heights[0],
        false => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Derivative, Kinks, derivative};
    use super::*;

    type Function = fn(f64) -> f64;

    fn of(map: Function, x: f64) -> Result<Derivative, NoDerivative> {
        derivative(&mut |x| Ok(vec![map(x)]), x, Kinks::Refused, &[])
    }

    #[test]
    fn a_jump_at_the_point_is_refused_with_its_height() {
        let cases: [(Function, f64, [f64; 2]); 7] = [
            // A relay whose value at 0 is between both sides.
            (
                |x| if x == 0.0 { 0.0 } else { 1.0_f64.copysign(x) },
                0.0,
                [1.0; 2],
            ),
            // A threshold: the value at the point is that of one side.
            (|x| if x > 2.0 { x + 5.0 } else { x }, 2.0, [0.0, 5.0]),
            (|x| if x < 2.0 { x - 5.0 } else { x }, 2.0, [5.0, 0.0]),
            // A step that is small beside the slope, and one beside a large value.
            (
                |x| if x > 1.0 { 1e6 * x + 0.1 } else { 1e6 * x },
                1.0,
                [0.0, 0.1],
            ),
            (|x| if x > 1.0 { x + 1e-9 } else { x }, 1.0, [0.0, 1e-9]),
            // A single value beside both sides.
            (|x| if x == 3.0 { x + 1.0 } else { x }, 3.0, [1.0, -1.0]),
            // A curve beside a jump.
            (
                |x| if x > 0.5 { 7.0 } else { libm::sin(x) },
                0.5,
                [0.0, 7.0 - 0.479_425_538_604_203],
            ),
        ];
        for (map, x, expected) in cases {
            let Err(NoDerivative::Jump { left, right, .. }) = of(map, x) else {
                panic!("{x}: {:?}", of(map, x));
            };
            for (height, expected) in [left, right].into_iter().zip(expected) {
                let tolerance = 1e-3 * expected.abs();
                assert!((height - expected).abs() <= tolerance, "{left} {right}");
            }
        }
    }

    #[test]
    fn a_jump_beside_the_point_does_not_matter() {
        let beside = of(|x| if x > 1.01 { 3.0 * x } else { 2.0 * x }, 1.0).expect("a derivative");
        assert!((beside.values[0] - 2.0).abs() < 1e-9, "{beside:?}");
    }

    #[test]
    fn an_iteration_passes_a_jump() {
        let mut relay = |x: f64| Ok(vec![if x > 0.0 { 1.0 } else { 0.0 }]);
        assert!(derivative(&mut relay, 0.0, Kinks::Passed, &[]).is_ok());
    }
}
