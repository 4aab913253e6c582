//! Derivatives of a map by differences whose step is chosen by the map itself, with an error of each.
//!
//! Used by the linearisation of plants and laws. A derivative that does not exist is refused, never averaged.
//!
//! 1. Central differences at steps that double, `D(h) = (f(x + h) - f(x - h)) / (2 h)`.
//! 2. Richardson's extrapolation of three neighbours, of order 6; its error is the difference to that of order 4, and
//!    the rounding of `f` over the smallest of the three steps.
//! 3. Each output takes the step with its smallest error.
//!
//! At a kink the differences to the left and to the right stay apart however small the step is; at a root they grow
//! without limit; at a jump the output itself stays apart. All are refused.

use crate::extremes::larger;

mod jump;

/// Derivative of every output by one number.
#[derive(Clone, Debug, PartialEq)]
pub struct Derivative {
    /// Derivative of each output.
    pub values: Vec<f64>,
    /// Error of each derivative, absolute.
    pub errors: Vec<f64>,
    /// Step of the derivative with the largest relative error.
    pub step: f64,
    /// Largest relative error of a derivative that differs from 0.
    pub error: f64,
}

/// Reason why there is no derivative.
#[derive(Clone, Debug, PartialEq)]
pub enum NoDerivative {
    /// The map failed at the point itself.
    Failed(String),
    /// The differences of an output to the left and to the right stay apart.
    Kink {
        /// Index of the output.
        output: usize,
        /// Difference quotient to the left.
        left: f64,
        /// Difference quotient to the right.
        right: f64,
    },
    /// An output jumps at the point.
    Jump {
        /// Index of the output.
        output: usize,
        /// Rise from the left to the point.
        left: f64,
        /// Rise from the point to the right.
        right: f64,
    },
    /// The differences of an output do not converge.
    Diverges {
        /// Index of the output.
        output: usize,
        /// Best difference quotient.
        value: f64,
        /// Its error.
        error: f64,
    },
}

/// Rounding of an output, in units of its last bit: that of the few operations at the end of a step.
const ROUNDING: f64 = 4.0 * f64::EPSILON;
/// Relative error at which no better step is looked for.
const ENOUGH: f64 = 1e-11;
/// Relative error above which an output that had [settled](SETTLED) has left its neighbourhood.
const LEFT: f64 = 1e-4;
/// Relative error of a good derivative.
const GOOD: f64 = 1e-6;
/// Number of good levels in a row after which a derivative has settled: rounding alone does not agree that often.
const SETTLED: u32 = 4;
/// Range of the ratio of two central differences of a root, of which one has half the step of the other: `sqrt(2)` of a
/// square root. That of rounding is 2, with any sign.
const ROOT: (f64, f64) = (1.25, 1.75);
/// Number of such ratios in a row that make a root.
const ROOTS: usize = 8;
/// Relative distance of the differences to both sides from which a kink is refused; a smaller one is part of the error.
const KINK: f64 = 1e-3;
/// Smallest step relative to the number, and the smallest step of any, as powers of two: what a smaller one changes
/// inside of the map may be lost beside larger terms.
const SMALLEST: (i32, i32) = (-20, -34);
/// Largest step of a number below 4096, as a power of two; of others a quarter of the number.
const LARGEST: i32 = 10;

/// Differences at one step.
struct Level {
    step: f64,
    central: Vec<f64>,
    right: Vec<f64>,
    left: Vec<f64>,
    /// Largest value of each output up to this level.
    scale: Vec<f64>,
}

/// Best derivative of an output so far.
#[derive(Clone, Copy)]
struct Best {
    value: f64,
    error: f64,
    level: usize,
}

impl Best {
    fn relative(&self) -> f64 {
        match self.error == 0.0 {
            true => 0.0,
            false => self.error / self.value.abs(),
        }
    }
}

/// Treatment of a kink or a root.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kinks {
    /// Refused.
    Refused,
    /// Counted with the best difference quotient, for an iteration that needs a direction only.
    Passed,
}

/// Course of an output from level to level.
#[derive(Clone, Copy, Default)]
struct Track {
    best: Option<Best>,
    /// Derivative of the last level.
    last: Option<f64>,
    /// Number of good levels in a row.
    streak: u32,
    /// Level at which the derivative first settled.
    settled_at: Option<usize>,
}

/// Differentiates all outputs of a map by its number, at `x`; `terms` has the largest term of each output, whose
/// rounding is that of the output, or nothing where only the output itself is known.
///
/// # Errors
/// If the map fails at `x`, or an output has no derivative there.
pub fn derivative(
    map: &mut dyn FnMut(f64) -> Result<Vec<f64>, String>,
    x: f64,
    kinks: Kinks,
    terms: &[f64],
) -> Result<Derivative, NoDerivative> {
    let here = finite(map(x)).map_err(NoDerivative::Failed)?;
    let mut levels: Vec<Level> = Vec::new();
    let mut tracks = vec![Track::default(); here.len()];
    let mut scale: Vec<f64> = here.iter().map(|value| value.abs()).collect();
    for (scale, term) in scale.iter_mut().zip(terms) {
        *scale = larger(*scale, *term);
    }
    let (mut step, largest) = steps(x);
    let mut failure = None;
    while step <= largest {
        let both = finite(map(x + step)).and_then(|up| Ok((up, finite(map(x - step))?)));
        let (up, down) = match both {
            Ok(both) => both,
            Err(reason) => {
                failure = Some(reason);
                // Beyond it the map means nothing.
                break;
            }
        };
        for (place, scale) in scale.iter_mut().enumerate() {
            *scale = larger(*scale, larger(up[place].abs(), down[place].abs()));
        }
        let quotients = |high: &[f64], low: &[f64], width: f64| {
            let both = high.iter().zip(low);
            both.map(|(high, low)| (high - low) / width).collect()
        };
        levels.push(Level {
            step,
            central: quotients(&up, &down, 2.0 * step),
            right: quotients(&up, &here, step),
            left: quotients(&here, &down, step),
            scale: scale.clone(),
        });
        if improve(&levels, &mut tracks) {
            break;
        }
        step *= 2.0;
    }
    let best: Option<Vec<Best>> = tracks.iter().map(|track| track.best).collect();
    let Some(mut best) = best else {
        let reason = failure.unwrap_or_else(|| "no step can be taken".into());
        return Err(NoDerivative::Failed(format!(
            "close to the point: {reason}"
        )));
    };
    // Beyond it the map is no longer that of the point, although a tiny derivative may be most exact there.
    let is_good = |best: &&Best| best.value != 0.0 && best.relative() < GOOD;
    let last = best.iter().filter(is_good).map(|best| best.level).max();
    let last = last.unwrap_or(levels.len() - 1);
    for (output, best) in best.iter_mut().enumerate() {
        if kinks == Kinks::Passed {
            break;
        }
        jump::refuse(&levels, output)?;
        if let Some(settled_at) = tracks[output].settled_at {
            let first = (settled_at + 1).saturating_sub(SETTLED as usize);
            let near = &levels[first..=last.min(best.level).max(settled_at)];
            best.error += kink(near, output)?;
        }
        if grows(&levels, output) {
            return Err(NoDerivative::Diverges {
                output,
                value: best.value,
                error: best.error,
            });
        }
    }
    // A value below its error is not distinguishable from 0.
    let is_zero = |best: &Best| best.value.abs() <= best.error;
    let worst = best.iter().filter(|best| !is_zero(best));
    let worst = worst.max_by(|a, b| a.relative().total_cmp(&b.relative()));
    let own = |best: &Best| if is_zero(best) { 0.0 } else { best.value };
    Ok(Derivative {
        values: best.iter().map(own).collect(),
        errors: best.iter().map(|best| best.error).collect(),
        step: levels[worst.map_or(levels.len() - 1, |worst| worst.level)].step,
        error: worst.map_or(0.0, Best::relative),
    })
}

/// Returns `true` if small steps of the number `x` may have been lost beside the largest term of an output, so that its
/// derivative has to be taken again with these terms.
#[must_use]
pub fn is_hidden(derivative: &Derivative, x: f64, terms: &[f64]) -> bool {
    let (smallest, _) = steps(x);
    let mut both = derivative.values.iter().zip(terms);
    both.any(|(value, term)| *value != 0.0 && ROUNDING * term > GOOD * smallest * value.abs())
}

/// Returns the smallest and the largest step at a number; powers of two, so that sums with the number are exact.
fn steps(x: f64) -> (f64, f64) {
    let power = |exponent: i32| libm::exp2(f64::from(exponent));
    let own = libm::ilogb(x);
    let smallest = match x == 0.0 {
        true => power(SMALLEST.1),
        false => power((own + SMALLEST.0).max(SMALLEST.1)),
    };
    let largest = larger(power(LARGEST), x.abs() / 4.0);
    (smallest, largest)
}

/// Improves the derivatives by the newest level; returns `true` if no larger step is worthwhile.
fn improve(levels: &[Level], tracks: &mut [Track]) -> bool {
    let [.., small, middle, large] = levels else {
        return false;
    };
    let (mut is_enough, mut has_left) = (true, false);
    for (output, track) in tracks.iter_mut().enumerate() {
        let [d_1, d_2, d_4] = [small, middle, large].map(|level| level.central[output]);
        let (fine, coarse) = ((4.0 * d_1 - d_2) / 3.0, (4.0 * d_2 - d_4) / 3.0);
        let value = (16.0 * fine - coarse) / 15.0;
        let noise = ROUNDING * large.scale[output] / small.step;
        // Cancellation inside of the map rounds more than its result shows; the level before shows it.
        let change = track.last.map_or(value, |last| value - last).abs();
        let now = Best {
            value,
            error: larger((value - fine).abs(), change) + noise,
            level: levels.len() - 2,
        };
        track.last = Some(value);
        // At a kink the central difference may be 0.
        let size = larger(small.right[output].abs(), small.left[output].abs());
        has_left |= track.settled_at.is_some() && now.error > LEFT * size;
        track.streak = if now.error < GOOD * size {
            track.streak + 1
        } else {
            0
        };
        if track.streak >= SETTLED {
            track.settled_at.get_or_insert(levels.len() - 1);
        }
        let best = track.best.get_or_insert(now);
        if now.error < best.error {
            *best = now;
        }
        // A difference of 0 may yet be below the rounding.
        is_enough &= track.settled_at.is_some() && best.value != 0.0 && best.relative() < ENOUGH;
    }
    is_enough || has_left
}

/// Returns half the distance by which the differences of an output to both sides stay apart at every step; 0 if the
/// distance vanishes.
///
/// # Errors
/// If they stay apart by more than [`KINK`] of them.
fn kink(levels: &[Level], output: usize) -> Result<f64, NoDerivative> {
    let gap = |level: &Level| level.right[output] - level.left[output];
    let counts = |level: &&Level| {
        let noise = ROUNDING * level.scale[output] / level.step;
        let size = larger(level.right[output].abs(), level.left[output].abs());
        gap(level).abs() > larger(100.0 * noise, 1e-6 * size)
    };
    let clear: Vec<&Level> = levels.iter().filter(counts).collect();
    // Of a smooth map the gap is proportional to the step, or to a higher power.
    let [first, second, third, ..] = clear[..] else {
        return Ok(0.0);
    };
    let stays = |a: &Level, b: &Level| {
        let ratio = gap(b) / gap(a);
        b.step == 2.0 * a.step && ratio > 0.6 && ratio < 1.6
    };
    if !(stays(first, second) && stays(second, third)) {
        return Ok(0.0);
    }
    let (left, right) = (first.left[output], first.right[output]);
    if (right - left).abs() <= KINK * larger(left.abs(), right.abs()) {
        return Ok((right - left).abs() / 2.0);
    }
    Err(NoDerivative::Kink {
        output,
        left,
        right,
    })
}

/// Returns `true` if the central differences of an output grow without limit as the step shrinks, as those of a root do.
fn grows(levels: &[Level], output: usize) -> bool {
    let ratios = levels
        .windows(2)
        .map(|pair| pair[0].central[output] / pair[1].central[output]);
    let mut streak = 0;
    for ratio in ratios {
        streak = if ratio > ROOT.0 && ratio < ROOT.1 {
            streak + 1
        } else {
            0
        };
        if streak >= ROOTS {
            return true;
        }
    }
    false
}

fn finite(values: Result<Vec<f64>, String>) -> Result<Vec<f64>, String> {
    let values = values?;
    match values.iter().all(|value| value.is_finite()) {
        true => Ok(values),
        false => Err("a value is not a finite number".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Function = fn(f64) -> f64;

    fn of(map: Function, x: f64) -> Result<Derivative, NoDerivative> {
        derivative(&mut |x| Ok(vec![map(x)]), x, Kinks::Refused, &[])
    }

    #[test]
    fn smooth_functions_have_their_derivative_within_the_stated_error() {
        let cases: [(Function, f64, f64); 6] = [
            (libm::sin, 1.0, 0.540_302_305_868_139_8),
            (libm::exp, -3.0, 0.049_787_068_367_863_944),
            (libm::sqrt, 1e7, 1.581_138_830_084_189_6e-4),
            (|x| 3.0 * x, 0.0, 3.0),
            (|x| 1e9 + 2e-3 * x, 1e6, 2e-3),
            (|x| x * x * x, 0.0, 0.0),
        ];
        for (map, x, expected) in cases {
            let result = of(map, x).expect("a derivative");
            let off = (result.values[0] - expected).abs();
            assert!(
                off <= larger(result.errors[0], 1e-16),
                "{x}: {off} {result:?}"
            );
            assert!(result.error < 1e-6, "{x}: {result:?}");
        }
    }

    #[test]
    fn kinks_and_roots_are_refused() {
        let kink = of(f64::abs, 0.0).expect_err("a kink");
        let expected = NoDerivative::Kink {
            output: 0,
            left: -1.0,
            right: 1.0,
        };
        assert_eq!(kink, expected);
        let one_sided = of(|x| if x > 2.0 { 3.0 * x } else { x + 4.0 }, 2.0);
        assert!(
            matches!(one_sided, Err(NoDerivative::Kink { .. })),
            "{one_sided:?}"
        );
        let mut map = |x: f64| Ok(vec![x.abs() + x]);
        let passed = derivative(&mut map, 0.0, Kinks::Passed, &[]).expect("a direction");
        assert!((passed.values[0] - 1.0).abs() < 1e-9, "{passed:?}");
        let root = |x: f64| libm::copysign(libm::sqrt(x.abs()), x);
        let root = of(root, 0.0).expect_err("a root");
        assert!(matches!(root, NoDerivative::Diverges { .. }), "{root:?}");
    }

    #[test]
    fn steps_do_not_reach_across_a_kink() {
        // The second output is so flat that its derivative has no digit on this side of the kink at 0.
        let mut map = |x: f64| {
            let slope = if x > 0.0 { 3.0 } else { 2.5 };
            Ok(vec![slope * x, 5e-3 + 1e-15 * slope * x])
        };
        let result = derivative(&mut map, 0.03, Kinks::Refused, &[]).expect("a derivative");
        assert!((result.values[0] - 3.0).abs() < 1e-9, "{result:?}");
        assert!(
            (result.values[1] - 3e-15).abs() <= result.errors[1],
            "{result:?}"
        );
    }

    #[test]
    fn a_kink_that_hardly_matters_is_part_of_the_error() {
        let result = of(|x| if x > 0.0 { 1.000_1 * x } else { x }, 0.0).expect("a derivative");
        assert!((result.values[0] - 1.000_05).abs() < 1e-9, "{result:?}");
        assert!((result.errors[0] - 5e-5).abs() < 1e-9, "{result:?}");
    }

    #[test]
    fn a_kink_beside_the_point_does_not_matter() {
        let result = of(|x| (x - 1.001).abs() + x * x, 1.0).expect("a derivative");
        assert!((result.values[0] - 1.0).abs() < 1e-9, "{result:?}");
    }

    #[test]
    fn outputs_that_do_not_depend_on_the_number_have_no_derivative_at_all() {
        let result = derivative(&mut |_| Ok(vec![1.4e7, 0.0]), 2.0, Kinks::Refused, &[])
            .expect("a derivative");
        assert_eq!((result.values, result.error), (vec![0.0, 0.0], 0.0));
    }

    #[test]
    fn a_number_far_below_its_own_scale_has_its_derivative() {
        let result = derivative(
            &mut |x| Ok(vec![1.4e7 + 3e4 * x, x]),
            2.4e-17,
            Kinks::Refused,
            &[],
        );
        let result = result.expect("a derivative");
        assert!((result.values[0] / 3e4 - 1.0).abs() < 1e-10, "{result:?}");
    }

    #[test]
    fn rounding_inside_of_a_map_does_not_mislead() {
        // A mass held by a spring: the forces cancel, so the result is far smaller than the rounding of its parts.
        let mut map = |v: f64| {
            Ok(vec![
                0.01 + 1e-3 * v,
                v + 1e-3 * (1.0 - 100.0 * 0.01 - 2.0 * v),
            ])
        };
        for v in [1.26e-15, 6.3e-15, -3.1e-17, 7.7e-13] {
            let result = derivative(&mut map, v, Kinks::Refused, &[]).expect("a derivative");
            assert!((result.values[0] - 1e-3).abs() < 1e-12, "{v:e}: {result:?}");
            assert!((result.values[1] - 0.998).abs() < 1e-9, "{v:e}: {result:?}");
        }
    }

    #[test]
    fn a_map_that_fails_close_by_is_differentiated_within_its_domain() {
        let mut map = |x: f64| match x > 0.0 {
            true => Ok(vec![libm::log(x)]),
            false => Err("below 0".to_owned()),
        };
        let result = derivative(&mut map, 0.5, Kinks::Refused, &[]).expect("a derivative");
        assert!((result.values[0] - 2.0).abs() < 1e-9, "{result:?}");
        let failed = derivative(&mut map, -1.0, Kinks::Refused, &[]).expect_err("outside");
        assert_eq!(failed, NoDerivative::Failed("below 0".into()));
    }
}
