//! Loops whose margins are refused, each with its reason and the exit code 1, and wrong usage.

use super::{SPRING_MASS, TWENTY, crossed, measured, number, teaching_with};
use crate::foreign::compiled;
use crate::support::harness::{Rig, text};
use crate::support::run::Run;

/// Measures the loops of a scenario, of which all are refused with these texts.
#[track_caller]
pub(super) fn refused(rig: &Rig, scenario: &str, further: &[&str], reasons: &[&str]) -> Run {
    let arguments = [&["margins", scenario, "--json"], further].concat();
    let run = rig.hil(&arguments).expect(1);
    let report = run.json();
    for input in report["inputs"].as_array().expect("a list") {
        let reason = input["refused"].as_str().expect("a reason");
        for text in reasons {
            assert!(reason.contains(text), "`{text}` is not in `{reason}`");
        }
        for figure in [
            "gain_margin_db",
            "phase_margin_deg",
            "delay_margin_s",
            "disc_margin",
            "crossover_hz",
        ] {
            assert!(input[figure].is_null(), "{figure} of a refused loop");
        }
        assert_eq!(input["responses"].as_array().map(Vec::len), Some(0));
    }
    let plain = rig.hil(&[&["margins", scenario], further].concat());
    plain.expect(1).prints(&["  refused: "]);
    run
}

#[test]
fn a_paper_plant_that_moves_more_than_the_probe_does_is_refused() {
    let rig = Rig::new();
    let small = ["--fault", "0", "--at", "1", "--amplitude", "1e-4"];
    let few = ["--frequencies", "1..2000/20"];
    let run = refused(
        &rig,
        "scenarios/severe-leakage.toml",
        &[&small[..], &few].concat(),
        &["the loop moves by itself", "raise --amplitude"],
    );
    let together = &run.json()["together"][0];
    assert_eq!(together["refused"], "the margins of a command were refused");
}

#[test]
fn a_loop_that_diverges_is_refused() {
    let rig = Rig::new();
    let negative = ["--set", "controller.pid.derivative_n_s_per_m=-5"];
    let reasons = ["the loop is unstable", "diverge"];
    refused(&rig, SPRING_MASS, &negative, &reasons);
}

#[test]
fn a_loop_whose_own_motion_grows_is_refused() {
    let rig = Rig::new();
    // The closed loop has a growth rate of about 0.04 per second.
    let slow = ["--set", "controller.pid.derivative_n_s_per_m=2.7"];
    let reasons = ["the loop is unstable, or", "its own motion grows"];
    refused(&rig, SPRING_MASS, &[TWENTY, &slow].concat(), &reasons);
}

#[test]
fn an_actuator_at_the_end_of_its_range_is_refused() {
    let rig = Rig::new();
    let actuator = "[[actuators]]\nsignal = \"force_n\"\nrange = [-2.0, 2.0]\n";
    let scenario = teaching_with(&rig, actuator);
    let large = ["--amplitude", "5"];
    let reasons = [
        "saturation: the actuator of command.force_n",
        "lower --amplitude",
    ];
    refused(&rig, &scenario, &[TWENTY, &large].concat(), &reasons);
    // A probe that stays inside is not.
    let small = ["--amplitude", "0.1"];
    measured(&rig, &scenario, &[TWENTY, &small].concat());
}

#[test]
fn a_limit_cycle_is_named_and_not_taken_for_the_work_of_the_probe() {
    let rig = Rig::new();
    let actuator = "[[actuators]]\nsignal = \"force_n\"\nrange = [-2.0, 2.0]\n";
    let scenario = teaching_with(&rig, actuator);
    // The loop is unstable, and its actuator bounds its motion.
    let unstable = ["--set", "controller.pid.derivative_n_s_per_m=-5"];
    let reasons = [
        "saturation",
        "as a limit cycle does",
        "so no --amplitude helps",
    ];
    let few = ["--frequencies", "1..100/20"];
    refused(&rig, &scenario, &[few, unstable].concat(), &reasons);
}

#[test]
fn a_probe_that_is_far_too_large_is_not_taken_for_an_unstable_loop() {
    let rig = Rig::new();
    let large = ["--amplitude", "1e300", "--frequencies", "1..100/20"];
    let reasons = ["or the probe too large", "lower --amplitude"];
    refused(&rig, SPRING_MASS, &large, &reasons);
}

#[test]
fn a_law_at_its_own_limit_is_refused() {
    let rig = Rig::new();
    let Some([plant, law]) = crossed::programs(&rig) else {
        return;
    };
    let scenario = crossed::scenario(&rig, [2.0, 2.0], 0.0, "limit_n = 0.2\n");
    let bins = ["--plant-bin", text(&plant), "--controller-bin", text(&law)];
    let probe = ["--amplitude", "1", "--frequencies", "0.2..50/40"];
    let reasons = ["saturation: the law's command stands at", "0.2"];
    refused(
        &rig,
        text(&scenario),
        &[&probe[..], &bins].concat(),
        &reasons,
    );
}

#[test]
fn a_law_that_gives_no_number_is_refused_with_its_step() {
    let rig = Rig::new();
    let Some([plant, _]) = crossed::programs(&rig) else {
        return;
    };
    let scenario = crossed::scenario(&rig, [2.0, 2.0], 0.0, "");
    let probe = ["--amplitude", "1", "--frequencies", "0.2..50/40"];
    for (square, run) in [("-1.0", "without the probe"), ("1e-4", "with the probe")] {
        let option = format!("-DFAILS_ABOVE={square}");
        let options = ["-DLAW", &option];
        let law = compiled(&rig, "cc", crossed::SOURCE, "failing-law", &options);
        let bins = ["--plant-bin", text(&plant), "--controller-bin", text(&law)];
        let reasons = [
            "the law gives no usable command",
            run,
            "controller's command of step",
            "is not a finite number",
        ];
        let all = [&probe[..], &bins].concat();
        refused(&rig, text(&scenario), &all, &reasons);
    }
}

#[test]
fn a_response_that_depends_on_the_amplitude_is_refused() {
    let rig = Rig::new();
    let actuator = "[[actuators]]\nsignal = \"force_n\"\ndead_band = 0.5\n";
    let scenario = teaching_with(&rig, actuator);
    let probe = ["--amplitude", "1"];
    let reasons = ["depends on the amplitude", "choose another --amplitude"];
    refused(&rig, &scenario, &[TWENTY, &probe].concat(), &reasons);
}

#[test]
fn a_loop_without_crossover_has_the_figures_that_need_none() {
    let rig = Rig::new();
    // A gain of 0.3 at rest, and of 0.27 at the resonance.
    let weak = [
        "plant.parameters.damping_n_s_per_m=16",
        "controller.pid.proportional_n_per_m=30",
        "controller.pid.integral_n_per_m_s=0",
        "controller.pid.derivative_n_s_per_m=3",
    ];
    let weak = weak.map(|change| ["--set", change]).concat();
    let further = [TWENTY, &weak[..]].concat();
    let run = rig.hil(&[&["margins", SPRING_MASS, "--json"], &further[..]].concat());
    let report = run.expect(1).json();
    let input = &report["inputs"][0];
    let reason = input["crossover_refused"].as_str().expect("a reason");
    assert!(reason.contains("no crossover: |L| is"), "{reason}");
    assert!(reason.contains("stays below 1 between"), "{reason}");
    assert!(input["refused"].is_null());
    for figure in ["phase_margin_deg", "delay_margin_s", "crossover_hz"] {
        assert!(input[figure].is_null(), "{figure} without a crossover");
    }
    assert!(number(&input["gain_margin_db"]) > 0.0 && number(&input["disc_margin"]) > 0.0);
    let plain = rig.hil(&[&["margins", SPRING_MASS], &further[..]].concat());
    plain.expect(1).prints(&[
        "  gain margin   5",
        "  phase margin  refused: no crossover",
        "  delay margin  refused: no crossover",
        "  least |1 + L| 0.",
    ]);
}

#[test]
fn a_command_without_motion_needs_an_amplitude() {
    let rig = Rig::new();
    let hold = ["--set", "controller.law=hold"];
    let reasons = ["the command is 0 throughout", "give --amplitude"];
    refused(&rig, SPRING_MASS, &[TWENTY, &hold].concat(), &reasons);
}

#[test]
fn an_amplitude_that_is_lost_in_rounding_is_no_loop_without_crossover() {
    let rig = Rig::new();
    for amplitude in ["1e-16", "1e-15", "1e-13"] {
        let probe = ["--amplitude", amplitude];
        let reasons = ["lost in rounding", amplitude, "raise --amplitude"];
        refused(&rig, SPRING_MASS, &[TWENTY, &probe].concat(), &reasons);
    }
}

#[test]
fn a_slower_law_is_refused_and_measured_at_its_own_rate_as_the_refusal_says() {
    let rig = Rig::new();
    let slow = ["--set", "controller.rate_hz=250"];
    let cure = "--set run.rate_hz=250 --set plant.substeps=16";
    let reasons = ["at every 4th sample only", cure];
    refused(&rig, SPRING_MASS, &slow, &reasons);
    let cure: Vec<&str> = cure.split(' ').collect();
    let report = measured(&rig, SPRING_MASS, &[&slow[..], &cure].concat());
    // The hold of 4 ms instead of 1 ms costs about 1.5 ms more delay.
    let phase_deg = number(&report["inputs"][0]["phase_margin_deg"]);
    assert!((60.0..73.0).contains(&phase_deg), "{phase_deg} degrees");
}

#[test]
fn wrong_usage_is_refused_with_two() {
    let rig = Rig::new();
    for (arguments, reason) in [
        (&["--at=-1"][..], "--at must be from 0"),
        (&["--amplitude", "0"], "--amplitude must be greater than 0"),
        (&["--frequencies", "5"], "write LO..HI in Hz"),
        (&["--frequencies", "1..600"], "at most 0.45 times the rate"),
        (&["--frequencies", "0.0005..100"], "from at least 0.001 Hz"),
        (&["--fault", "1"], "--fault 1: the scenario has 0 faults"),
        (
            &["--command", "force"],
            "the plant has no command `force`; it has force_n",
        ),
        (&["--set", "run.clock=realtime"], "--set run.clock=lockstep"),
        (&["--set", "controller.law=none"], "unknown law `none`"),
    ] {
        let arguments = [&["margins", SPRING_MASS], arguments].concat();
        rig.hil(&arguments).expect(2).says(&[reason]);
    }
}
