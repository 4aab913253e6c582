//! Stages with memory against independent solutions: lags, wandering errors, coupling.

use super::*;

/// Inputs of the lags, at 8 steps a second.
const INPUTS: [f64; 10] = [1.0, 2.0, -0.5, 0.25, 3.0, 3.0, 3.0, -1.0, -1.0, 0.125];

// Python 3.12, decimal with 60 digits: matrix exponential (Taylor series of A / 2^20, squared 20 times) of
// the filter's state space with its input and the input's slope as two states more.
#[rustfmt::skip] // a row is a filter
const FIRST_ORDER: [(f64, [f64; 10]); 3] = [
    (0.002, [1.0, 1.000784987091321, 1.0003908505480663, 0.998624632493959, 0.9996083332674484, 1.0027480745570772, 1.0058828878240944, 1.005872832438059, 1.0027244881120514, 1.0004641957894014]),
    (0.7, [1.0, 1.2307404893377658, 0.9792264250800741, 0.5266836472294366, 1.0442042517861763, 1.8713542884883674, 2.3486839598271114, 1.7011782135991904, 0.5587891576058752, 0.1591251931287458]),
    (5.0, [1.0, 1.7503693864592584, 0.11915809357968926, 0.07497623312088048, 2.310067341714502, 2.986406344464482, 2.99973216593156, -0.0014828229376658997, -0.9803263428853853, -0.1554468126660227]),
];
#[rustfmt::skip] // a row is a filter
const SECOND_ORDER: [(f64, f64, [f64; 10]); 6] = [
    (0.7, 0.25, [1.0, 1.046405517525879, 1.1709561230847216, 0.9708364323512081, 0.7303619694760556, 1.0213930754572278, 1.7523444721593504, 2.4435028732233577, 2.2428678760030043, 1.3070048581490608]),
    (0.7, 1.0, [1.0, 1.0385584738804345, 1.1047184878869172, 0.9242724393687053, 0.8329252697149313, 1.128924554461902, 1.5621647733293167, 1.809384019752385, 1.478221392242645, 0.9680531994147963]),
    (0.7, 3.0, [1.0, 1.0258525419292706, 1.0410138835517335, 0.941106425275964, 0.9448577086129344, 1.107931268097466, 1.2773561189431182, 1.3289735582300786, 1.1509102170071124, 0.9876618911696042]),
    (0.01, 0.5, [1.0, 1.0000102606515813, 1.0000460114434098, 1.0000225616411498, 0.9999737630385845, 1.0000201278244372, 1.000189014867781, 1.0004384126668067, 1.000603827966819, 1.0006565691024445]),
    (6.0, 0.7, [1.0, 1.6922607726720715, 0.280359893067225, -0.008707340299194207, 2.162921258808778, 3.0299724774920507, 2.9989830415701535, 0.23098927215776327, -1.0440482427574198, -0.21971317517399033]),
    (0.02, 40.0, [1.0, 1.000030875934343, 1.000086393557063, 0.9999559924657729, 0.9998860415699727, 1.000101592632303, 1.000443853797142, 1.0006986260537254, 1.0005562692433658, 1.00026948288153]),
];

/// Applies a stage at full size to a series of readings.
fn course(fault: &mut dyn Fault, inputs: &[f64]) -> Vec<f64> {
    let one = |(since, x): (u64, &f64)| fault.number(&moment(since, 1.0), valid(*x)).value;
    (0..).zip(inputs).map(one).collect()
}

fn assert_near(what: &str, values: &[f64], expected: &[f64]) {
    for (step, (value, expected)) in values.iter().zip(expected).enumerate() {
        let error = (value - expected).abs();
        assert!(error < 1e-12, "{what} at step {step}: {value} {expected}");
    }
}

#[test]
fn lags_are_exact_for_an_input_that_is_linear_between_steps() {
    for (lag_hz, expected) in FIRST_ORDER {
        let mut fault = start("lag", &[("lag_hz", lag_hz)], &[]);
        let values = course(fault.as_mut(), &INPUTS);
        assert_near(&format!("{lag_hz} Hz"), &values, &expected);
    }
    for (lag_hz, damping, expected) in SECOND_ORDER {
        let parameters = [("lag_hz", lag_hz), ("lag_damping", damping)];
        let mut fault = start("second-order-lag", &parameters, &[]);
        let values = course(fault.as_mut(), &INPUTS);
        assert_near(
            &format!("{lag_hz} Hz, damping {damping}"),
            &values,
            &expected,
        );
    }
}

#[test]
fn a_lag_of_a_staircase_is_the_mean_of_each_step() {
    // dv/dt = w (1 - v) from v = 0 has the mean 1 - exp(-w t) (1 - exp(-w T)) / (w T) over a step from t.
    let (lag_hz, period_s) = (0.3, 1.0 / RATE_HZ);
    let mut fault = start("lag", &[("lag_hz", lag_hz)], &[]);
    let z = std::f64::consts::TAU * lag_hz * period_s;
    let inputs: Vec<f64> = (0..40).map(|step| f64::from(u8::from(step > 0))).collect();
    let values = course(fault.as_mut(), &inputs);
    let mean = |step: i32| match step {
        0 => 0.0,
        step => 1.0 - libm::exp(-z * f64::from(step - 1)) * (1.0 - libm::exp(-z)) / z,
    };
    let expected: Vec<f64> = (0..40).map(mean).collect();
    assert_near("mean", &values, &expected);
}

#[test]
fn a_lag_keeps_a_constant_to_the_last_bit_and_scales_with_the_profile() {
    for kind in ["lag", "second-order-lag"] {
        let parameters = [("lag_hz", 0.37), ("lag_damping", 0.3)];
        let parameters = &parameters[..if kind == "lag" { 1 } else { 2 }];
        let mut fault = start(kind, parameters, &[]);
        assert_eq!(course(fault.as_mut(), &[0.1; 50]), [0.1; 50]);
        let (mut full, mut half) = (start(kind, parameters, &[]), start(kind, parameters, &[]));
        for (since, x) in (0..).zip(INPUTS) {
            let lagged = full.number(&moment(since, 1.0), valid(x)).value;
            let value = half.number(&moment(since, 0.5), valid(x)).value;
            assert_eq!(value, x + (lagged - x) * 0.5, "{kind} at step {since}");
        }
    }
}

#[test]
fn cross_coupling_adds_shares_of_the_other_signals() {
    let mut fault = start("cross-coupling", &[], &[2.0, 0.5, 4.0, -0.25]);
    let row = [1.0, 3.0, 100.0, 8.0];
    for (gain, expected) in [(0.0, 1.0), (0.5, 0.75), (1.0, 0.5)] {
        let value = fault.coupled(&moment(0, gain), valid(row[0]), &row).value;
        assert_eq!(value, expected);
    }
}

/// Errors that a stage adds to 0 at a rate of 100 steps a second.
fn errors(kind: &str, parameters: Parameters<'_>, count: u64) -> Vec<f64> {
    let entry = entry(kind);
    let mut settings = Settings::default();
    for (name, value) in parameters {
        settings.set(name, *value);
    }
    let fault = (entry.start)(&AnySetup {
        parameters: &settings,
        list: &[],
        rate: rate(100.0),
        signals: 1,
        is_instrument: false,
    });
    let mut fault = fault.unwrap_or_else(|e| panic!("{kind}: {e}"));
    fault.hold(RandomStream::new(1, kind));
    let error = |since| {
        fault
            .number(&moment_at(since, 1.0, 100.0), valid(0.0))
            .value
    };
    (0..count).map(error).collect()
}

/// Overlapping Allan deviation of rates over `m` samples (IEEE 952, annex C).
fn allan_deviation(values: &[f64], m: usize) -> f64 {
    let mut sums = vec![0.0];
    for value in values {
        sums.push(sums[sums.len() - 1] + value);
    }
    let terms = sums.len() - 2 * m;
    let square = |k: usize| {
        let difference = (sums[k + 2 * m] - 2.0 * sums[k + m] + sums[k]) / m as f64;
        difference * difference
    };
    ((0..terms).map(square).sum::<f64>() / (2.0 * terms as f64)).sqrt()
}

#[test]
fn allan_deviations_are_those_of_the_closed_forms() {
    // IEEE 952-1997, annex C: N^2 / t for white noise of the coefficient N, K^2 t / 3 for a rate random walk,
    // and the form for a Gauss-Markov process of standard deviation s and time T, whose q^2 is 2 s^2 / T.
    const COUNT: u64 = 1_000_000;
    const PERIOD_S: f64 = 0.01;
    let (s, t) = (0.3, 0.5);
    let white = errors("noise", &[("standard_deviation", s)], COUNT);
    let walk = errors("random-walk", &[("walk_per_sqrt_s", s)], COUNT);
    let process = [("standard_deviation", s), ("time_constant_s", t)];
    let markov = errors("gauss-markov", &process, COUNT);
    for m in [10, 20, 50, 100, 200] {
        assert!(m as u64 <= COUNT / 5000);
        let tau = m as f64 * PERIOD_S;
        let n = s * PERIOD_S.sqrt();
        let x = tau / t;
        let markov_variance =
            2.0 * s * s / x * (1.0 - (3.0 - 4.0 * libm::exp(-x) + libm::exp(-2.0 * x)) / (2.0 * x));
        for (what, values, expected) in [
            ("white noise", &white, n / tau.sqrt()),
            ("random walk", &walk, s * (tau / 3.0).sqrt()),
            ("Gauss-Markov", &markov, markov_variance.sqrt()),
        ] {
            let ratio = allan_deviation(values, m) / expected;
            assert!((ratio - 1.0).abs() < 0.03, "{what} over {m} steps: {ratio}");
        }
    }
}

#[test]
fn a_walk_has_normal_steps_of_the_variance_that_it_says() {
    // A public simulator drove its walk with uniform numbers, whose kurtosis is 1.8 and not 3.
    let values = errors("random-walk", &[("walk_per_sqrt_s", 2.0)], 400_000);
    let steps: Vec<f64> = values.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let moment = |power| {
        steps
            .iter()
            .map(|step| libm::pow(*step, power))
            .sum::<f64>()
            / steps.len() as f64
    };
    let variance = 2.0 * 2.0 * 0.01;
    assert!(
        (moment(2.0) / variance - 1.0).abs() < 0.01,
        "{}",
        moment(2.0)
    );
    let kurtosis = moment(4.0) / (moment(2.0) * moment(2.0));
    assert!((kurtosis - 3.0).abs() < 0.05, "{kurtosis}");
    assert!(moment(1.0).abs() < 5.0 * (variance / steps.len() as f64).sqrt());
    assert_eq!(values[0], 0.0);
}

#[test]
fn a_wandering_error_begins_in_its_stationary_state() {
    let first = |seed| {
        let parameters = [("standard_deviation", 3.0), ("time_constant_s", 1e3)];
        let mut fault = seeded("gauss-markov", &parameters, &[], seed);
        fault.number(&moment(0, 1.0), valid(0.0)).value
    };
    let values: Vec<f64> = (0..4000).map(first).collect();
    let variance = values.iter().map(|value| value * value).sum::<f64>() / 4000.0;
    // Five standard deviations of the variance's estimate, s^2 sqrt(2 / n).
    assert!((variance / 9.0 - 1.0).abs() < 5.0 * (2.0_f64 / 4000.0).sqrt());
}
