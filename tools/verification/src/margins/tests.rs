//! Loops of the teaching plant against the exact discrete closed form: the plant behind a zero-order hold, an integral by
//! trapezoids and a backward difference.

use std::f64::consts::TAU;

use hil_run::alone;

use super::*;
use measurement::Measured;

type Complex = (f64, f64);

const PERIOD_S: f64 = 1e-3;

fn times(a: Complex, b: Complex) -> Complex {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

fn over(a: Complex, b: Complex) -> Complex {
    let square = b.0 * b.0 + b.1 * b.1;
    let (re, im) = times(a, (b.0, -b.1));
    (re / square, im / square)
}

/// `z^n` at a frequency.
fn z(frequency_hz: f64, n: f64) -> Complex {
    let (sin, cos) = libm::sincos(TAU * frequency_hz * PERIOD_S * n);
    (cos, sin)
}

/// L of `m = 1`, `c = 2`, `k = 100` under a `pid` with 300, 2000 and 30.
fn closed_form(frequency_hz: f64) -> Complex {
    closed_form_of(2.0, [300.0, 2000.0, 30.0], frequency_hz)
}

/// L of `m = 1`, `k = 100` and this damping under a `pid` with these gains.
fn closed_form_of(damping: f64, [p, i, d]: [f64; 3], frequency_hz: f64) -> Complex {
    let sigma = 0.5 * damping;
    let damped = libm::sqrt(100.0 - sigma * sigma);
    let (sin, cos) = libm::sincos(damped * PERIOD_S);
    let alpha = libm::exp(-sigma * PERIOD_S);
    let z1 = z(frequency_hz, 1.0);
    let z2 = z(frequency_hz, 2.0);
    let b1 = 0.01 * (1.0 - alpha * (cos + sigma / damped * sin));
    let b2 = 0.01 * (alpha * alpha + alpha * (sigma / damped * sin - cos));
    let numerator = (b1 * z1.0 + b2, b1 * z1.1);
    let a1 = -2.0 * alpha * cos;
    let denominator = (z2.0 + a1 * z1.0 + alpha * alpha, z2.1 + a1 * z1.1);
    let plant = over(numerator, denominator);
    let (above, below) = ((z1.0 + 1.0, z1.1), (z1.0 - 1.0, z1.1));
    let integral = over(above, below);
    let derivative = over(below, z1);
    let (k_i, k_d) = (i * 0.5 * PERIOD_S, d / PERIOD_S);
    let law = (
        p + k_i * integral.0 + k_d * derivative.0,
        k_i * integral.1 + k_d * derivative.1,
    );
    times(plant, law)
}

const SCENARIO: &str = r#"
schema = 1
name = "loop"
[run]
duration_s = 1.0
rate_hz = 1000
[plant]
model = "spring-mass"
substeps = 4
[controller]
law = "pid"
[[stimuli]]
target = "position_m"
kind = "step"
at_s = 0.1
after = 0.01
"#;

/// Measures the loop of the scenario with this text added.
fn measured(further: &str) -> Result<Measured, String> {
    measured_by(1.0, further)
}

/// Measures the loop of the scenario with this text added by a probe of this amplitude.
fn measured_by(amplitude: f64, further: &str) -> Result<Measured, String> {
    let rig = Rig::BuiltIn(Box::new(alone::built_in()));
    let scenario = Scenario::parse(&format!("{SCENARIO}{further}"), "loop.toml").expect("TOML");
    let (plants, laws, kinds) = rig.described();
    let plan = scenario.check(plants, laws, kinds);
    let plan = plan.unwrap_or_else(|problems| panic!("{problems}"));
    let span = Span::new(Some("0.5..400/20"), 1000.0).expect("a range");
    let loops = Loops {
        rig: &rig,
        plan: &plan,
        commands: &["force_n".into()],
        course: Course {
            first_step: 1000,
            period_steps: span.period_steps(),
        },
        interruption: &Interruption::default(),
    };
    let own = refusable(loops.run(None)).expect("a run")?;
    let measurement = Measurement {
        loops: &loops,
        own: &own,
        command: 0,
        amplitude: Some(amplitude),
        span,
    };
    refusable(measurement.run()).expect("a run")
}

/// Compares every measured response with the closed form times a factor.
fn assert_closed_form(measured: &Measured, factor: impl Fn(f64) -> Complex) {
    assert_loop(measured, |hz| times(closed_form(hz), factor(hz)));
}

/// Compares every measured response with an expected loop.
fn assert_loop(measured: &Measured, expected: impl Fn(f64) -> Complex) {
    assert!(measured.points.len() >= 20);
    for point in &measured.points {
        let hz = point.frequency_hz;
        let expected = expected(hz);
        let error = over((point.l.0 - expected.0, point.l.1 - expected.1), expected);
        let error = libm::hypot(error.0, error.1);
        assert!(error < 1e-5, "{hz} Hz: {:?}, not {expected:?}", point.l);
    }
}

#[test]
fn the_loop_of_the_teaching_plant_is_that_of_its_closed_form() {
    let measured = measured("").expect("margins");
    assert_closed_form(&measured, |_| (1.0, 0.0));
    let [crossover_hz, phase_deg] = measured.margins.crossover().expect("a crossover");
    assert!((crossover_hz - 5.21).abs() < 0.005, "{crossover_hz} Hz");
    assert!((phase_deg - 73.97).abs() < 0.005, "{phase_deg} degrees");
    let disc = measured.margins.disc[1];
    assert!((disc - 0.972).abs() < 0.0005, "{disc}");
    // The crossover of the closed form, by bisection.
    let (mut low, mut high) = (5.0, 5.5);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        let (re, im) = closed_form(middle);
        if libm::hypot(re, im) > 1.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    let (re, im) = closed_form(low);
    let expected_deg = 180.0 + libm::atan2(im, re).to_degrees();
    assert!((crossover_hz / low - 1.0).abs() < 1e-4);
    assert!((phase_deg / expected_deg - 1.0).abs() < 1e-4);
}

fn late(link: &str) -> String {
    format!(
        "[[faults]]\nkind = \"message-delay\"\nat_s = 0.0\n[[faults.effects]]\ntarget = \"link.{link}\"\nsteps = 5\n"
    )
}

#[test]
fn late_messages_on_either_link_lower_the_phase_by_their_delay() {
    for link in ["command", "sample"] {
        let measured = measured(&late(link)).expect("margins");
        assert_closed_form(&measured, |hz| z(hz, -5.0));
    }
}

#[test]
fn a_scaled_command_scales_the_loop() {
    let fault = "[[faults]]\nkind = \"scale\"\nat_s = 0.0\n[[faults.effects]]\ntarget = \"command.force_n\"\nfactor = 0.5\n";
    let measured = measured(fault).expect("margins");
    assert_closed_form(&measured, |_| (0.5, 0.0));
}

#[test]
fn the_lag_of_an_actuator_belongs_to_the_loop() {
    let measured = measured("[[actuators]]\nsignal = \"force_n\"\nlag_hz = 20.0\n");
    let turned = TAU * 20.0 * PERIOD_S;
    let held = -libm::expm1(-turned);
    let ramp = 1.0 + libm::expm1(-turned) / turned;
    assert_closed_form(&measured.expect("margins"), |hz| {
        let before = z(hz, -1.0);
        let above = (ramp + (held - ramp) * before.0, (held - ramp) * before.1);
        let below = (1.0 - (1.0 - held) * before.0, -(1.0 - held) * before.1);
        over(above, below)
    });
}

#[test]
fn an_actuator_at_its_limit_is_refused() {
    let reason = measured("[[actuators]]\nsignal = \"force_n\"\nrange = [-1.1, 1.1]\n");
    let reason = reason.expect_err("a refusal");
    assert!(reason.contains("saturation: the actuator"), "{reason}");
}

/// Reason why the loop under a law with these parameters has no margins.
fn reason(amplitude: f64, parameters: &str) -> String {
    let further = format!("[controller.pid]\n{parameters}");
    measured_by(amplitude, &further).expect_err("a refusal")
}

#[test]
fn no_amplitude_is_advised_where_the_loops_own_motion_is_at_the_laws_limit() {
    // Without a limit, the characteristic polynomial s^3 - 3 s^2 + 400 s + 2000 has roots in the right half plane.
    for (limit, amplitudes) in [("2.0", [0.02, 1e-6]), ("1e3", [10.0, 1e-6])] {
        for amplitude in amplitudes {
            let law = format!("derivative_n_s_per_m = -5.0\ncommand_limit_n = {limit}\n");
            let reason = reason(amplitude, &law);
            assert!(reason.contains("saturation: the law's"), "{reason}");
            assert!(reason.contains("own motion takes it there"), "{reason}");
            assert!(reason.contains("no --amplitude helps"), "{reason}");
        }
    }
}

#[test]
fn a_law_that_is_always_at_its_limit_is_saturated_and_not_without_crossover() {
    // At rest the spring takes 100 N/m * 0.01 m = 1 N; the integral waits at the limit.
    let reason = reason(0.01, "command_limit_n = 0.5\n");
    let text = "saturation: the law's command stands at 0.5 throughout";
    assert!(reason.contains(text), "{reason}");
    assert!(!reason.contains("amplitude"), "{reason}");
}

#[test]
fn a_law_that_rests_at_its_limit_and_answers_half_of_the_probe_is_saturated() {
    // Without an integral, 300 (0.01 - x) = 100 x at rest: x = 0.0075 m and a command of 0.75 N. The response of a clamped
    // half-wave is the same at every amplitude.
    let law = "integral_n_per_m_s = 0.0\ncommand_limit_n = ";
    let at_limit = reason(0.01, &format!("{law}0.75\n"));
    assert!(at_limit.contains("stands at 0.75 for"), "{at_limit}");
    assert!(at_limit.contains("no --amplitude helps"), "{at_limit}");
    // Where there is room between rest and limit, a smaller probe fits.
    let beside = reason(1.0, &format!("{law}0.8\n"));
    assert!(beside.contains("stands at"), "{beside}");
    assert!(beside.contains("lower --amplitude"), "{beside}");
    let fits = measured_by(1e-3, &format!("[controller.pid]\n{law}0.8\n"));
    fits.expect("margins");
}

#[test]
fn a_loop_without_crossover_has_no_phase_margin_but_the_other_figures() {
    let further = "[plant.parameters]\ndamping_n_s_per_m = 16.0\n[controller.pid]\n\
                   proportional_n_per_m = 30.0\nintegral_n_per_m_s = 0.0\nderivative_n_s_per_m = 3.0\n";
    let measured = measured(further).expect("figures");
    let expected = |hz| closed_form_of(16.0, [30.0, 0.0, 3.0], hz);
    assert_loop(&measured, expected);
    let reason = measured.crossover_refused.expect("a reason");
    assert!(reason.contains("no crossover"), "{reason}");
    assert!(reason.contains("stays below 1"), "{reason}");
    assert_eq!(measured.margins.crossover(), None);
    let locus = (0..100_000).map(|n| expected(0.5 * libm::pow(800.0, f64::from(n) / 1e5)));
    let locus: Vec<Complex> = locus.collect();
    let distances = locus.iter().map(|(re, im)| libm::hypot(1.0 + re, *im));
    let least = distances.reduce(extremes::smaller).expect("frequencies");
    assert!((measured.margins.disc[1] / least - 1.0).abs() < 1e-4);
    let at_turn = locus
        .windows(2)
        .find(|pair| pair[0].1 < 0.0 && pair[1].1 >= 0.0);
    let expected_db = -20.0 * libm::log10(-at_turn.expect("a phase of -180 degrees")[0].0);
    let [_, gain_db] = measured.margins.phase_crossover().expect("a gain margin");
    assert!((gain_db - expected_db).abs() < 0.01, "{gain_db} dB");
    assert_eq!([measured.gain_refused, measured.disc_refused], [None, None]);
}

#[test]
fn a_loop_that_does_not_answer_has_no_figures() {
    // The dead band takes the command of 300 N/m * 0.01 m = 3 N and the probe.
    let gain = "[controller.pid]\nintegral_n_per_m_s = 0.0\n";
    let actuator = "[[actuators]]\nsignal = \"force_n\"\ndead_band = 20.0\n";
    let reason = measured(&format!("{gain}{actuator}")).expect_err("a refusal");
    assert!(reason.contains("no crossover: |L| is 0.0000"), "{reason}");
}
