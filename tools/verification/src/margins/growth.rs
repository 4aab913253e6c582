//! Steady growth of a motion, which shows an unstable loop long before it diverges.

/// Parts of the motion whose sizes are compared.
const PARTS: usize = 10;
/// Least ratio of the slope of the logarithm of the size to its standard error: far beyond the scatter of noise.
const CERTAIN: f64 = 8.0;

/// Returns the growth per period of what changes from one period to the next, if that grows steadily; changes below
/// `floor` are rounding.
///
/// A motion with the period of the tones, and one that stands still, cancel in the difference of two periods. Of a
/// linear loop only its modes are left, and stable ones decay.
pub(super) fn of(values: &[f64], period: usize, floor: f64) -> Option<f64> {
    let changes: Vec<f64> = values
        .iter()
        .zip(values.get(period..)?)
        .map(|(a, b)| b - a)
        .collect();
    let length = changes.len() / PARTS;
    if length == 0 {
        return None;
    }
    let sizes = changes.chunks_exact(length).take(PARTS).map(|part| {
        let squares: f64 = part.iter().map(|change| change * change).sum();
        (squares / length as f64).sqrt()
    });
    let sizes: Vec<f64> = sizes.collect();
    if sizes
        .iter()
        .any(|size| !(size.is_finite() && *size > floor))
    {
        return None;
    }
    let logarithms: Vec<f64> = sizes.into_iter().map(libm::log).collect();
    let mean = logarithms.iter().sum::<f64>() / PARTS as f64;
    let place = |index: usize| index as f64 - 0.5 * (PARTS - 1) as f64;
    let (mut products, mut squares) = (0.0, 0.0);
    for (index, value) in logarithms.iter().enumerate() {
        products += place(index) * (value - mean);
        squares += place(index) * place(index);
    }
    let slope = products / squares;
    let rest = logarithms.iter().enumerate().map(|(index, value)| {
        let error = value - mean - slope * place(index);
        error * error
    });
    let error = (rest.sum::<f64>() / (PARTS - 2) as f64 / squares).sqrt();
    let parts_of_period = period as f64 / length as f64;
    (slope > 0.0 && slope > CERTAIN * error).then(|| libm::expm1(slope * parts_of_period))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: usize = 1000;
    const WINDOWS: usize = 3;

    fn motion(of: impl Fn(f64) -> f64) -> Vec<f64> {
        (0..WINDOWS * PERIOD).map(|k| of(k as f64)).collect()
    }

    #[test]
    fn a_mode_that_grows_slowly_beside_a_periodic_motion_grows() {
        let values =
            motion(|k| libm::sin(k * 0.02 * std::f64::consts::PI) + 1e-3 * libm::exp(1e-5 * k));
        let growth = of(&values, PERIOD, 1e-7).expect("growth");
        assert!((growth - libm::expm1(0.01)).abs() < 1e-4, "{growth}");
    }

    #[test]
    fn a_mode_that_decays_and_a_motion_that_repeats_do_not_grow() {
        assert_eq!(of(&motion(|k| libm::exp(-1e-5 * k)), PERIOD, 1e-7), None);
        assert_eq!(
            of(
                &motion(|k| libm::sin(k * 0.02 * std::f64::consts::PI)),
                PERIOD,
                1e-7
            ),
            None
        );
    }

    /// A linear congruential generator.
    #[test]
    fn noise_does_not_grow() {
        let mut state = 1_u32;
        let mut draw = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state) / f64::from(u32::MAX)
        };
        for _ in 0..100 {
            let values: Vec<f64> = (0..WINDOWS * PERIOD).map(|_| draw()).collect();
            assert_eq!(of(&values, PERIOD, 1e-7), None);
        }
    }
}
