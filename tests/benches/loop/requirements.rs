//! Costs of requirements: twenty of them in the recorder of whole runs, and on their own.

use std::fmt::Write as _;
use std::hint::black_box;

use hil_config::evaluation::Evaluation;
use hil_config::expression::Columns;
use hil_config::plan::Plan;
use hil_config::scenario::Scenario;
use hil_session::clock::monotonic_ns;
use plant_process::faults::kinds;
use plant_process::models;
use serde_json::{Value, json};
use shared_types::time::Step;

use crate::effort::rounds;
use crate::experiment::scenario_file;
use crate::measure::{Bystanders, cores, machine, median};
use crate::programs::Programs;

/// Steps of an evaluation on its own.
const STEPS: u64 = 200_000;

/// Prints both tables.
pub(crate) fn compare(programs: &Programs) {
    let folder = tempfile::TempDir::new().expect("a folder");
    let text = std::fs::read_to_string(scenario_file()).expect("the scenario");
    let begin = text.find("[[requirements]]").unwrap_or(text.len());
    let bare = &text[..begin];
    let texts = [bare.to_owned(), format!("{bare}{}", twenty())];
    let files = ["none", "twenty"].map(|name| folder.path().join(format!("{name}.toml")));
    for (file, text) in files.iter().zip(&texts) {
        std::fs::write(file, text).expect("the folder can be written");
    }
    let cores = cores();
    // A core for each side and one for the recorder, if there are three.
    let apart = match cores[..] {
        [plant, controller, recorder, ..] => {
            let settings = [
                ("--plant-core", plant),
                ("--controller-core", controller),
                ("--recorder-core", recorder),
            ];
            Some(settings.map(|(flag, core)| [flag.to_owned(), core.to_string()]))
        }
        _ => None,
    };
    let (mut runs, mut alone) = ([Vec::new(), Vec::new()], [Vec::new(), Vec::new()]);
    let mut runs_apart = [Vec::new(), Vec::new()];
    let bystanders = Bystanders::watch();
    for _ in 0..rounds() {
        for at in 0..2 {
            alone[at].push(record_ns(&texts[at]));
            let mut arguments = vec![files[at].to_str().expect("plain text")];
            runs[at].push(step_ns(&programs.run(&arguments)));
            if let Some(apart) = &apart {
                arguments.extend(apart.iter().flatten().map(String::as_str));
                runs_apart[at].push(step_ns(&programs.run(&arguments)));
            }
        }
    }
    let others = bystanders.share();
    let change_of = |[none, with]: &[Vec<f64>; 2]| {
        let changes = none.iter().zip(with).map(|(none, with)| with / none - 1.0);
        median(changes)
    };
    let change = change_of(&runs);
    let change_apart = apart.map(|_| change_of(&runs_apart));
    let [none_ns, twenty_ns] = alone.map(median);
    let [none_step_ns, twenty_step_ns] = runs.map(median);
    println!(
        "20 requirements at the paper's scenario, medians of {}, other programs took {:.0} % of the machine",
        rounds(),
        100.0 * others
    );
    println!("  evaluation of a record alone, without  {none_ns:7.1} ns");
    println!("  with 20 requirements                   {twenty_ns:7.1} ns");
    println!("  a step of two processes, without       {none_step_ns:7.0} ns");
    println!("  with 20 requirements                   {twenty_step_ns:7.0} ns");
    println!(
        "  change, median over the rounds         {:+7.1} %",
        100.0 * change
    );
    match change_apart {
        Some(change) => println!(
            "  the same with a core for the recorder  {:+7.1} %",
            100.0 * change
        ),
        None => println!("  the same with a core for the recorder  skipped: needs 3 cores"),
    }
    let line = json!({
        "bench": "loop/requirements",
        "machine": machine(),
        "rounds": rounds(),
        "others_share": others,
        "record_ns": [none_ns, twenty_ns],
        "step_ns": [none_step_ns, twenty_step_ns],
        "change": change,
        "change_apart": change_apart,
    });
    println!("{line}\n");
}

fn step_ns(summary: &Value) -> f64 {
    let number = |key: &str| summary[key].as_f64().expect("a number");
    1e9 * number("wall_time_s") / number("steps")
}

/// Twenty requirements that examine the whole run and hold until its end: windows at the beginning, up to the end and
/// nested, the past, and the time after an event.
fn twenty() -> String {
    let formulas = [
        "always(abs(tracking_error_rad) < 1)",
        "always(abs(truth.force_fight_n) < 1e6)",
        "always(truth.surface_angle_rad < 1 and truth.surface_angle_rad > -1)",
        "always(abs(command.actuator1_valve_current_a) < 100)",
        "always(abs(command.actuator2_valve_current_a) < 100)",
        "always[0s,7s](abs(tracking_error_rad) < 3e-4)",
        "always[7s,8s](abs(tracking_error_rad) < 9e-4)",
        "always[15s,20s](abs(tracking_error_rad) < 3e-4)",
        "always[0s,7s](abs(truth.force_fight_n) < 150)",
        "always[7s,8s](abs(truth.force_fight_n) < 5500)",
        "always[15s,20s](abs(truth.force_fight_n) < 150)",
        "eventually[7s,15s] always[0s,5s](abs(truth.force_fight_n) < 150)",
        "eventually[7s,9s] always[0s,1s](abs(truth.force_fight_n) < 500)",
        "eventually[8s,20s](abs(truth.force_fight_n) > 1e7)",
        "always(abs(truth.force_fight_n) > 1e6 implies eventually[0s,200ms](abs(truth.force_fight_n) < 150))",
        "always(rise(abs(truth.force_fight_n) > 4000) implies eventually[0s,1s](abs(truth.force_fight_n) < 4000))",
        "always[0s,10s](once[0s,500ms](abs(truth.force_fight_n) > 1e6) implies abs(tracking_error_rad) < 1e-3)",
        "abs(truth.force_fight_n) < 500 until[6s,8s] abs(truth.force_fight_n) > 1000",
        "always[0s,19s](abs(tracking_error_rad) < 1 or abs(truth.force_fight_n) < 10)",
        "always[1s,20s](abs(reference.surface_angle_rad - measured.surface_angle_rad) < 1)",
    ];
    let mut text = String::new();
    for (number, formula) in (1..).zip(formulas) {
        writeln!(
            text,
            "[[requirements]]\nname = \"requirement-{number}\"\nformula = \"{formula}\""
        )
        .expect("a string");
    }
    text
}

/// Measures the time that the evaluation of one record takes.
fn record_ns(text: &str) -> f64 {
    let plan = plan(text);
    let plants = models::all();
    let plant = plants
        .iter()
        .find(|plant| plant.description.name == "drhas");
    let laws = controller_process::laws::all();
    let law = laws.iter().find(|law| law.description.name == "ftsc");
    let internals = &law.expect("built in").description.internals;
    let plant = &plant.expect("built in").description;
    let columns = Columns::of(plant, &plan.stimuli, internals);
    let mut evaluation = Evaluation::new(&plan, &columns).expect("known names");
    // Something that moves, and more in the second of the fault.
    let rows: Vec<Vec<f64>> = (0..997_u32)
        .map(|at| vec![1e-6 * f64::from(at % 101); columns.len()])
        .collect();
    let begin_ns = monotonic_ns();
    for (step, row) in (0..=STEPS).zip(rows.iter().cycle()) {
        evaluation.observe(Step(step), black_box(row), []);
    }
    let spent_ns = monotonic_ns() - begin_ns;
    black_box(evaluation.requirements());
    spent_ns as f64 / (STEPS + 1) as f64
}

fn plan(text: &str) -> Plan {
    let plants: Vec<_> = (models::all().iter())
        .map(|plant| plant.description.clone())
        .collect();
    let laws: Vec<_> = (controller_process::laws::all().iter())
        .map(|law| law.description.clone())
        .collect();
    let kinds: Vec<_> = (kinds::all().into_iter())
        .map(|kind| kind.description)
        .collect();
    let scenario = Scenario::parse(text, "required.toml").expect("TOML");
    let checked = scenario.check(&plants, &laws, &kinds);
    checked.unwrap_or_else(|problems| panic!("{problems}"))
}
