//! Scenarios of the repository.
//!
//! Checked here against descriptions written by hand that use the names of the real plants; the workspace's own tests
//! check the scenarios against the descriptions of the real binaries.

use std::path::PathBuf;

use hil_config::plan::{FaultAction, Plan, Profile, Trigger};
use hil_config::problem::Problems;
use hil_config::scenario::Scenario;
use shared_types::time::Step;

use crate::descriptions::Checked;

fn shipped(name: &str, flags: &[&str]) -> Result<Plan, Problems> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../scenarios");
    Scenario::read(folder.join(name))?.set(flags).checked()
}

#[test]
fn the_papers_scenarios_are_valid_with_every_law() {
    for file in ["severe-leakage.toml", "slight-leakage.toml"] {
        for law in ["ftsc", "nrsc", "pid", "hold"] {
            let plan = shipped(file, &[&format!("controller.law={law}")])
                .unwrap_or_else(|problems| panic!("{file}, {law}:\n{problems}"));
            assert_eq!(plan.controller.law, law);
            assert_eq!(format!("{}.toml", plan.name), file);
        }
    }
}

#[test]
fn the_papers_faults_strike_together_at_7_s() {
    // Section 4 of the paper.
    let expected = [
        ("severe-leakage.toml", [(5e-7, 10.0), (1e-7, 0.5)]),
        ("slight-leakage.toml", [(1e-9, 5.0), (0.5e-9, 10.0)]),
    ];
    for (file, effects) in expected {
        let plan = shipped(file, &[]).expect("right");
        assert_eq!((plan.run.steps, plan.run.rate.hz()), (200_000, 10_000.0));
        assert_eq!(plan.faults.len(), 1);
        let trigger = Trigger::Step {
            step: Step(70_000),
            at_s: 7.0,
        };
        assert_eq!(plan.faults[0].trigger, trigger);
        for (effect, (size, speed_per_s)) in plan.faults[0].effects.iter().zip(effects) {
            let FaultAction::Move { moves, .. } = &effect.action else {
                panic!("a fault of the plant");
            };
            assert_eq!((moves.len(), moves[0].by), (1, size));
            assert_eq!(effect.skew_steps, 0);
            assert_eq!(effect.profile, Profile::Exponential { speed_per_s });
        }
        for metric in &plan.metrics {
            let steps: Vec<(u64, u64)> = metric
                .windows
                .iter()
                .map(|w| (w.first.0, w.last.0))
                .collect();
            assert_eq!(steps, [(0, 70_000), (70_000, 80_000), (150_000, 200_000)]);
        }
    }
}

#[test]
fn the_chirp_of_the_surface_is_valid_with_every_law() {
    for law in ["ftsc", "nrsc", "pid"] {
        let plan = shipped(
            "frequency-response.toml",
            &[&format!("controller.law={law}")],
        )
        .unwrap_or_else(|problems| panic!("{law}:\n{problems}"));
        assert_eq!(plan.analyses.len(), 1);
    }
}

#[test]
fn the_teaching_scenario_is_valid_with_its_laws() {
    for law in ["pid", "hold"] {
        let plan = shipped("spring-mass.toml", &[&format!("controller.law={law}")])
            .unwrap_or_else(|problems| panic!("{problems}"));
        assert_eq!(plan.run.steps, 5000);
    }
}
