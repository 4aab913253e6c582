//! The evaluator that searches call, beside `hil campaign run`: the same cases of the paper's severe leakage, in turns.

use std::time::Instant;

use hil_campaign::command::evaluator::Evaluator;
use hil_config::study::Study;
use hil_console::terminal::interruption::Interruption;
use hil_facts::arguments::BinaryArguments;
use serde_json::Value;

use super::{Desk, ROUNDS, measure, scenario, time_s};

/// Largest time of the evaluations over that of the campaign that the project aims at.
const AIM: f64 = 1.05;

/// Compares this number of evaluations, in rounds.
pub(super) fn compare(desk: &Desk, cases: u64) {
    let each = cases.div_ceil(ROUNDS as u64).max(2);
    let text = |head: &str, factor: &str| {
        format!(
            "schema = 1\nscenario = \"{}\"\n{head}[[vary]]\nname = \"factor\"\nmin = 1.0\nmax = 2.0\n{factor}\
             [[vary]]\nname = \"leakage1\"\nkey = \"faults[0].effects[0].coefficient_m3ps_per_sqrt_pa\"\n\
             kind = \"expression\"\nexpression = \"5e-7 * factor\"\n",
            scenario("severe-leakage.toml")
        )
    };
    let grid = format!("kind = \"grid\"\npoints = {each}\n");
    let of_campaign = text("sampling = \"grid\"\n", &grid);
    let of_evaluator = text("[search]\n", "kind = \"uniform\"\n");
    let place = |n: u64| n as f64 / (each - 1) as f64;
    let points: Vec<Vec<f64>> = (0..each).map(|n| vec![1.0 + place(n)]).collect();
    let interruption = Interruption::listen().expect("signals");
    let (mut campaign_s, mut evaluations_s) = (Vec::new(), Vec::new());
    for round in 0..ROUNDS {
        let folder = desk.planned("of-campaign", &of_campaign, &[]);
        campaign_s.push(time_s(&mut desk.campaign(&["run", &folder])));
        let results = desk.campaign(&["show", "--json", &folder]);
        let fails_of_campaign = failed(results);

        let folder = desk.folder.path().join(format!("evaluations{round}"));
        let file = desk.folder.path().join("search.toml");
        std::fs::write(&file, &of_evaluator).expect("written");
        let began = Instant::now();
        let study = Study::read(&file);
        let (study, programs) = (study.expect("a study"), BinaryArguments::default());
        let evaluator = Evaluator::open(study, 0, &programs, &folder, &interruption);
        let evaluations = evaluator.expect("an evaluator").evaluate(&points);
        evaluations_s.push(began.elapsed().as_secs_f64());
        let evaluations = evaluations.expect("results");
        let fails = evaluations.iter().filter(|one| one.class == "fail");
        assert_eq!(
            fails.count() as u64,
            fails_of_campaign,
            "both run the same cases"
        );
    }
    let count = each * ROUNDS as u64;
    let [campaign_s, evaluations_s] = [campaign_s, evaluations_s].map(measure::median);
    let ratio = evaluations_s / campaign_s;
    for (name, wall_s) in [
        ("hil campaign run", campaign_s),
        ("evaluator", evaluations_s),
    ] {
        let case_ms = 1e3 * wall_s / each as f64;
        println!(
            "{:<52} {case_ms:>9.1} ms",
            format!("severe leakage, a case, {name}")
        );
    }
    println!(
        "{:<52} {ratio:>9.3}",
        format!("evaluator over campaign, {count} cases (aim {AIM})")
    );
}

/// Returns the number of failed cases that `hil campaign show` counts.
fn failed(mut shown: std::process::Command) -> u64 {
    let output = shown
        .stdout(std::process::Stdio::piped())
        .output()
        .expect("hil");
    let answers: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    answers["variants"][0]["classes"][1]
        .as_u64()
        .expect("a number")
}
