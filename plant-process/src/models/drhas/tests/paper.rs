//! The paper's experiment under its proportional law, against the verified values of an independent simulation, with
//! which Tables 3 and 4 of the paper agree to the printed digits.

use shared_types::time::{Rate, Step};

use super::super::*;
use super::{paper_command_rad, proportional_law};

/// Largest |theta_d - theta_r| and |Delta F| in a window of time.
#[derive(Debug)]
struct Worst {
    window_s: [f64; 2],
    tracking_rad: f64,
    fight_n: f64,
}

/// Coefficient C_t and speed mu of a leak from 7 s on.
type Leak = (f64, f64);

/// Runs the closed loop at 10 kHz with 4 substeps to the end of the last window.
fn run(leaks: [Leak; 2], windows_s: &[[f64; 2]]) -> Vec<Worst> {
    let rate = Rate::new(10_000.0).unwrap();
    let mut worst: Vec<Worst> = windows_s
        .iter()
        .map(|&window_s| Worst {
            window_s,
            tracking_rad: 0.0,
            fight_n: 0.0,
        })
        .collect();
    let end_s = windows_s[windows_s.len() - 1][1];
    let mut parameters = Parameters::default();
    let mut plant = Drhas::start(&parameters).unwrap();
    for k in 0..=rate.step_at_or_after(end_s).0 {
        let time_s = rate.seconds(Step(k));
        if time_s >= 7.0 {
            let [c_t1, c_t2] = leaks.map(|(c_t, mu)| c_t * -libm::expm1(-mu * (time_s - 7.0)));
            parameters.actuator1.leakage_coefficient_m3ps_per_sqrt_pa = c_t1;
            parameters.actuator2.leakage_coefficient_m3ps_per_sqrt_pa = c_t2;
            plant.retune(&parameters);
        }
        let reference_rad = paper_command_rad(time_s);
        let command = proportional_law(reference_rad, &plant.measure());
        let truth = plant.truth(time_s, &command);
        for worst in &mut worst {
            if worst.window_s[0] <= time_s && time_s <= worst.window_s[1] {
                let tracking_rad = (truth.surface_angle_rad - reference_rad).abs();
                if tracking_rad > worst.tracking_rad {
                    worst.tracking_rad = tracking_rad;
                }
                if truth.force_fight_n.abs() > worst.fight_n {
                    worst.fight_n = truth.force_fight_n.abs();
                }
            }
        }
        let interval = Interval {
            start_s: time_s,
            length_s: rate.period_s(),
            substeps: 4,
        };
        plant.advance(&interval, &command);
    }
    worst
}

fn assert_within_a_thousandth(worst: &Worst, tracking_rad: f64, fight_n: f64) {
    assert!(
        (worst.tracking_rad / tracking_rad - 1.0).abs() < 1e-3,
        "{worst:?}"
    );
    assert!((worst.fight_n / fight_n - 1.0).abs() < 1e-3, "{worst:?}");
}

#[test]
fn a_severe_leak_under_the_proportional_law_matches_the_paper() {
    let worst = run(
        [(5e-7, 10.0), (1e-7, 0.5)],
        &[[0.0, 7.0], [7.0, 8.0], [15.0, 20.0]],
    );
    assert_within_a_thousandth(&worst[0], 2.49715e-2, 560.80);
    assert_within_a_thousandth(&worst[1], 3.42275e-2, 25401.0);
    assert_within_a_thousandth(&worst[2], 5.55432e-2, 17942.0);
}

#[test]
fn a_slight_leak_under_the_proportional_law_matches_the_paper() {
    let worst = run(
        [(1e-9, 5.0), (0.5e-9, 10.0)],
        &[[0.0, 7.0], [7.0, 8.0], [15.0, 20.0]],
    );
    assert_within_a_thousandth(&worst[0], 2.49715e-2, 560.80);
    assert_within_a_thousandth(&worst[1], 2.49933e-2, 1210.78);
    assert_within_a_thousandth(&worst[2], 2.50675e-2, 1244.87);
}
