//! Tests of the complete laws: against an independent implementation and for properties of the design.
//!
//! `tests/golden/law_steps.json` contains measurements of closed loops and the answers of a reference implementation,
//! written from the paper in Python and evaluated with 50 digits (`tests/golden/drhas.py`).

use serde::Deserialize;
use shared_types::describe::{Invalid, Settings};
use shared_types::table::Table;

use super::adaptation::AdaptationGains;
use super::ftsc::{self, Ftsc};
use super::gains::{ComponentGains, TrajectoryGains};
use super::model::Model;
use super::nrsc::{self, Nrsc};
use super::signals::{Internals, Measured, Reference};
use crate::controller::{Controller, Sample, Setup, Transition};
use crate::laws::drhas::Command;

#[derive(Deserialize)]
struct Golden {
    measured: Vec<String>,
    sequences: Vec<Sequence>,
}

#[derive(Deserialize)]
struct Sequence {
    name: String,
    law: String,
    model: serde_json::Map<String, serde_json::Value>,
    gains: Settings,
    rate_hz: f64,
    samples: Vec<Answer>,
}

#[derive(Deserialize)]
struct Answer {
    measured: Vec<f64>,
    reference: Vec<f64>,
    u: [f64; 2],
    v3: f64,
    vr: f64,
    z1: [f64; 2],
    z2: [f64; 2],
    z3: [f64; 2],
    theta_hat: [f64; 2],
}

fn golden() -> Golden {
    let text = include_str!("../../../../tests/golden/law_steps.json");
    serde_json::from_str(text).expect("the golden file parses")
}

impl Sequence {
    fn model(&self) -> Model {
        let mut settings = Settings::default();
        for (group, values) in &self.model {
            for (name, value) in values.as_object().expect("a group of values") {
                settings.set(&format!("{group}.{name}"), value.as_f64().unwrap());
            }
        }
        settings
            .to_table("controller.model")
            .expect("every value of the model")
    }

    fn gain(&self, symbol: &str) -> f64 {
        self.gains.get(symbol).expect(symbol)
    }

    fn trajectory(&self) -> TrajectoryGains {
        TrajectoryGains {
            angle_gain_per_s: self.gain("k_1"),
            rate_gain_per_s: self.gain("k_2"),
        }
    }

    fn component(&self, n: u8) -> ComponentGains {
        ComponentGains {
            position_gain_per_s: self.gain(&format!("k_1{n}")),
            velocity_gain_per_s: self.gain(&format!("k_2s1{n}")),
            force_gain_per_s: self.gain(&format!("k_3s1{n}")),
            disturbance_weight_n2_per_s4: self.gain(&format!("h_2{n}")),
            disturbance_margin_n2_per_s3: self.gain(&format!("epsilon_{n}")),
            leakage_weight_n2_per_s6: self.gain(&format!("h_3{n}")),
            leakage_margin_n2_per_s5: self.gain(&format!("xi_{n}")),
            ..ComponentGains::default()
        }
    }

    fn adaptation(&self, n: u8) -> AdaptationGains {
        AdaptationGains {
            learning_rate_m8s2_per_n3: self.gain(&format!("Gamma_{n}")),
            estimate_min_m3ps_per_sqrt_pa: self.gain(&format!("theta_min_{n}")),
            estimate_max_m3ps_per_sqrt_pa: self.gain(&format!("theta_max_{n}")),
        }
    }

    fn nrsc(&self) -> nrsc::Parameters {
        nrsc::Parameters {
            trajectory: self.trajectory(),
            force_sum: self.component(1),
            force_difference: self.component(2),
            ..nrsc::Parameters::default()
        }
    }

    fn ftsc(&self) -> ftsc::Parameters {
        ftsc::Parameters {
            trajectory: self.trajectory(),
            force_sum: self.component(1),
            force_difference: self.component(2),
            adaptation1: self.adaptation(1),
            adaptation2: self.adaptation(2),
            ..ftsc::Parameters::default()
        }
    }
}

/// Returns a law's answers to the samples of a sequence.
fn answers<C>(parameters: C::Parameters, sequence: &Sequence) -> Vec<(Command, Internals)>
where
    C: Controller<
            Model = Model,
            Measured = Measured,
            Reference = Reference,
            Command = Command,
            Internals = Internals,
        >,
{
    let setup = Setup {
        parameters,
        model: sequence.model(),
        period_s: 1.0 / sequence.rate_hz,
    };
    let mut law = C::start(&setup).expect("starts");
    sequence
        .samples
        .iter()
        .map(|sample| law.step(&valid_sample(sample)))
        .collect()
}

fn valid_sample<C>(sample: &Answer) -> Sample<C>
where
    C: Controller<Measured = Measured, Reference = Reference>,
{
    Sample {
        held_steps: 0,
        time_s: 0.0, // no law reads it
        measured: Measured::from_row(&sample.measured),
        reference: Reference::from_row(&sample.reference),
        valid: true,
    }
}

/// Returns the largest deviation of a quantity over a sequence, relative to the quantity's own largest magnitude.
fn deviation<const N: usize>(pairs: impl Iterator<Item = ([f64; N], [f64; N])>) -> f64 {
    let (mut off, mut size) = (0.0, 0.0);
    for (actual, expected) in pairs {
        for (actual, expected) in actual.into_iter().zip(expected) {
            assert!(actual.is_finite(), "{actual}");
            for (largest, value) in [(&mut off, actual - expected), (&mut size, expected)] {
                if value.abs() > *largest {
                    *largest = value.abs();
                }
            }
        }
    }
    if off == 0.0 { 0.0 } else { off / size }
}

#[test]
fn the_golden_file_lists_the_signals_in_the_laws_order() {
    let names: Vec<String> = Measured::fields().into_iter().map(|f| f.name).collect();
    assert_eq!(golden().measured, names);
}

#[test]
fn both_laws_answer_as_the_independent_reference() {
    // Ten to eleven digits are the limit of doubles: z is the difference of two forces of up to 6e6 N that agree in
    // five digits.
    for sequence in golden().sequences {
        let actual = match sequence.law.as_str() {
            "nrsc" => answers::<Nrsc>(sequence.nrsc(), &sequence),
            "ftsc" => answers::<Ftsc>(sequence.ftsc(), &sequence),
            other => panic!("unknown law {other}"),
        };
        let pairs = || actual.iter().zip(&sequence.samples);
        let u = |c: &Command| [c.actuator1_valve_current_a, c.actuator2_valve_current_a];
        let theta_hat = |i: &Internals| {
            [
                i.leakage_estimate1_m3ps_per_sqrt_pa,
                i.leakage_estimate2_m3ps_per_sqrt_pa,
            ]
        };
        #[rustfmt::skip] // a table
        let cases = [
            ("u", deviation(pairs().map(|((c, _), w)| (u(c), w.u)))),
            ("V_3", deviation(pairs().map(|((_, i), w)| ([i.lyapunov_v3], [w.v3])))),
            ("V_r", deviation(pairs().map(|((_, i), w)| ([i.lyapunov_bound], [w.vr])))),
            ("z_1", deviation(pairs().map(|((_, i), w)| ([i.z11, i.z12], w.z1)))),
            ("z_2", deviation(pairs().map(|((_, i), w)| ([i.z21, i.z22], w.z2)))),
            ("z_3", deviation(pairs().map(|((_, i), w)| ([i.z31, i.z32], w.z3)))),
            ("theta_hat", deviation(pairs().map(|((_, i), w)| (theta_hat(i), w.theta_hat)))),
        ];
        for (quantity, off) in cases {
            assert!(off < 1e-10, "{}, {quantity}: {off:e}", sequence.name);
        }
    }
}

/// Returns the first sequence of the golden file in which the estimate moves.
fn severe_leak() -> Sequence {
    golden()
        .sequences
        .into_iter()
        .find(|s| s.name == "severe leak, adaptation runs")
        .expect("the sequence")
}

#[test]
fn ftsc_without_learning_equals_nrsc() {
    let sequence = severe_leak();
    let mut parameters = sequence.ftsc();
    parameters.adaptation1.learning_rate_m8s2_per_n3 = 0.0;
    parameters.adaptation2.learning_rate_m8s2_per_n3 = 0.0;
    let nrsc = answers::<Nrsc>(sequence.nrsc(), &sequence);
    assert_eq!(answers::<Ftsc>(parameters, &sequence), nrsc);
    assert_ne!(answers::<Ftsc>(sequence.ftsc(), &sequence), nrsc);
}

#[test]
fn a_command_limit_cuts_one_actuators_current_only() {
    let sequence = severe_leak();
    let mut parameters = sequence.nrsc();
    parameters.actuator1.command_limit_a = 0.5;
    let free = answers::<Nrsc>(sequence.nrsc(), &sequence);
    let limited = answers::<Nrsc>(parameters, &sequence);
    assert_eq!(limited[40].0.actuator1_valve_current_a, 0.5);
    for ((free, _), (limited, _)) in free.iter().zip(&limited) {
        assert_eq!(
            limited.actuator1_valve_current_a,
            free.actuator1_valve_current_a.clamp(-0.5, 0.5)
        );
        assert_eq!(
            limited.actuator2_valve_current_a,
            free.actuator2_valve_current_a
        );
    }
}

#[test]
fn an_invalid_sample_repeats_the_answer_and_leaves_no_trace() {
    let sequence = severe_leak();
    let setup = Setup {
        parameters: sequence.ftsc(),
        model: sequence.model(),
        period_s: 1e-4,
    };
    let mut law = Ftsc::start(&setup).expect("starts");
    let first = law.step(&valid_sample(&sequence.samples[0]));
    let mut broken = valid_sample::<Ftsc>(&sequence.samples[1]);
    broken.measured.row_mut().fill(f64::NAN);
    broken.valid = false;
    assert_eq!(law.step(&broken), first);
    let (_, after) = law.step(&valid_sample(&sequence.samples[2]));
    let straight = answers::<Ftsc>(sequence.ftsc(), &sequence)[2].1;
    // Errors and bound depend on the present sample and on time only.
    assert_eq!(
        (after.z31, after.lyapunov_bound),
        (straight.z31, straight.lyapunov_bound)
    );
}

#[test]
fn parameters_that_violate_a_condition_are_refused_at_the_start() {
    let mut parameters = ftsc::Parameters::default();
    parameters.force_sum.leakage_bound_n_per_s3 = 1e12;
    let refusal = |parameters| {
        let setup = Setup {
            parameters,
            model: Model::default(),
            period_s: 1e-4,
        };
        let Err(Invalid(text)) = Ftsc::start(&setup) else {
            panic!("not refused");
        };
        text
    };
    assert!(refusal(parameters).contains("eq. 56"));
    let mut parameters = ftsc::Parameters::default();
    parameters.adaptation1.estimate_max_m3ps_per_sqrt_pa = 0.0;
    parameters.adaptation1.estimate_min_m3ps_per_sqrt_pa = 1e-9;
    assert!(refusal(parameters).contains("adaptation1"));
}

/// Returns a law's currents for samples, the last of which is repeated; its parameters jump before the sample `at`.
fn tuned<C>(
    parameters: [C::Parameters; 2],
    at: usize,
    sequence: &Sequence,
    count: usize,
) -> Vec<[f64; 2]>
where
    C: Controller<Model = Model, Measured = Measured, Reference = Reference, Command = Command>,
{
    let [before, after] = parameters;
    let setup = |parameters| Setup::<C> {
        parameters,
        model: sequence.model(),
        period_s: 1.0 / sequence.rate_hz,
    };
    let mut law = C::start(&setup(before)).expect("starts");
    let tuning = C::tuning().expect("it can be tuned");
    let answers = (0..count).map(|k| {
        if k == at {
            (tuning.take)(&mut law, &setup(after), Transition::Step);
        }
        let sample = sequence.samples.get(k).or(sequence.samples.last());
        let (command, _) = law.step(&valid_sample(sample.expect("there is one")));
        [
            command.actuator1_valve_current_a,
            command.actuator2_valve_current_a,
        ]
    });
    answers.collect()
}

#[test]
fn gains_of_nrsc_change_without_a_jump_and_the_difference_fades() {
    let sequence = severe_leak();
    let (before, mut after) = (sequence.nrsc(), sequence.nrsc());
    after.force_sum.force_gain_per_s *= 2.0;
    after.trajectory.angle_gain_per_s *= 0.5;
    let at = 20;
    // A tenth of a second, and some samples more.
    let samples = (0.1 * sequence.rate_hz).round();
    let count = at + samples as usize + 5;
    // Without an estimate each answer depends on its sample alone, so the commands with either gains are known.
    let old = tuned::<Nrsc>([before; 2], 0, &sequence, count);
    let new = tuned::<Nrsc>([after; 2], 0, &sequence, count);
    let actual = tuned::<Nrsc>([before, after], at, &sequence, count);
    assert_eq!(
        actual[..=at],
        old[..=at],
        "to the last bit, the change included"
    );
    let difference: [f64; 2] = std::array::from_fn(|i| old[at][i] - new[at][i]);
    assert!(difference.iter().all(|d| d.abs() > 1e-6), "{difference:?}");
    for (k, (actual, new)) in actual.iter().zip(&new).enumerate().skip(at) {
        let share = 1.0 - (k - at) as f64 / samples;
        let remainder = if share > 0.0 { share } else { 0.0 };
        for i in 0..2 {
            let expected = new[i] + difference[i] * remainder;
            let off = (actual[i] - expected).abs();
            assert!(
                off <= 1e-9 * difference[i].abs(),
                "{k}: {} {expected}",
                actual[i]
            );
        }
    }
    assert_eq!(actual[count - 1], new[count - 1], "nothing is left of it");
}

#[test]
fn the_estimate_of_ftsc_continues_over_a_change_within_its_new_bounds() {
    let sequence = severe_leak();
    let (before, mut after) = (sequence.ftsc(), sequence.ftsc());
    let last = sequence.samples.len() - 1;
    let theta = sequence.samples[last].theta_hat;
    assert!(theta[0] > 0.0, "the estimate has moved");
    after.adaptation1.estimate_max_m3ps_per_sqrt_pa = 0.5 * theta[0];
    after.adaptation1.learning_rate_m8s2_per_n3 = 0.0;
    let old = tuned::<Ftsc>([before; 2], 0, &sequence, last + 1);
    let actual = tuned::<Ftsc>([before, after], last, &sequence, last + 1);
    assert_eq!(actual, old, "the command does not jump with the estimate");

    let setup = |parameters| Setup::<Ftsc> {
        parameters,
        model: sequence.model(),
        period_s: 1.0 / sequence.rate_hz,
    };
    let mut law = Ftsc::start(&setup(before)).expect("starts");
    for sample in &sequence.samples[..last] {
        law.step(&valid_sample(sample));
    }
    let tuning = Ftsc::tuning().expect("it can be tuned");
    (tuning.take)(&mut law, &setup(after), Transition::Step);
    let (_, internals) = law.step(&valid_sample(&sequence.samples[last]));
    assert_eq!(internals.leakage_estimate1_m3ps_per_sqrt_pa, 0.5 * theta[0]);
}

#[test]
fn gains_on_a_ramp_act_at_once() {
    let sequence = severe_leak();
    let mut after = sequence.nrsc();
    after.force_sum.force_gain_per_s *= 1.25;
    let setup = |parameters| Setup::<Nrsc> {
        parameters,
        model: sequence.model(),
        period_s: 1.0 / sequence.rate_hz,
    };
    let mut law = Nrsc::start(&setup(sequence.nrsc())).expect("starts");
    law.step(&valid_sample(&sequence.samples[0]));
    let tuning = Nrsc::tuning().expect("it can be tuned");
    (tuning.take)(&mut law, &setup(after), Transition::Ramp);
    let answer = law.step(&valid_sample(&sequence.samples[1]));
    assert_eq!(answer, answers::<Nrsc>(after, &sequence)[1]);
}
