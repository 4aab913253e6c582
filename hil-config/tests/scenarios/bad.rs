//! Faulty scenarios: each has one problem, at the marked place, and is refused with the problem and its remedy.

use std::collections::BTreeSet;

use hil_config::problem::{Problem, ProblemKind, Problems};
use hil_config::scenario::Scenario;

use crate::descriptions::{self, Checked};
use crate::{BASE, base_with, check, only, parse, problems};

/// Marks the expected place in the text of a case; removed before parsing.
const MARK: char = '^';

/// Text of the base, its replacement, and the expected problem: its kind and pieces of its text.
pub(crate) type Case = (
    &'static str,
    &'static str,
    ProblemKind,
    &'static [&'static str],
);

use ProblemKind::{
    Duplicate, Expression, Mismatch, MissingKey, OutOfRange, Syntax, Unbound, UnknownKey,
    UnknownName, Unreadable, WrongType,
};

#[rustfmt::skip] // a table reads best with a case on a line
const CASES: &[Case] = &[
    // The document.
    ("schema = 1", "schema = ^", Syntax, &["not TOML"]),
    ("seed = 7", "seed = 7\n^seed = 8", Syntax, &["not TOML: duplicate key"]),
    ("schema = 1", "schema = ^2", OutOfRange, &["`schema` is 2", "expected: 1"]),
    ("schema = 1", "schema = ^\"1\"", WrongType, &["`schema` is text", "expected: 1"]),
    ("schema = 1\n", "^", MissingKey, &["`schema` is missing"]),
    ("schema = 1", "schema = 1\n^colour = 3", UnknownKey, &["unknown key `colour`", "`stimuli`"]),
    ("\"base\"", "^\"a b\"", OutOfRange, &["`name` is `a b`", "1 to 64 letters, digits, - and _"]),
    ("\"base\"", "^7", WrongType, &["`name` is a number", "expected: text"]),
    ("\"base\"", "^\"\"", OutOfRange, &["`name`"]),
    // [run]
    ("duration_s = 2.0", "^duraton_s = 2.0\nduration_s = 2", UnknownKey, &["unknown key `duraton_s` in `run`", "nearest: `duration_s`"]),
    ("duration_s = 2.0", "duration_s = ^0", OutOfRange, &["`run.duration_s` is 0, out of range", "in s"]),
    ("duration_s = 2.0", "duration_s = ^-2", OutOfRange, &["`run.duration_s` is -2"]),
    ("duration_s = 2.0", "duration_s = ^nan", OutOfRange, &["`run.duration_s` is not a number"]),
    ("duration_s = 2.0", "duration_s = ^true", WrongType, &["`run.duration_s` is true or false", "a number from"]),
    ("duration_s = 2.0", "duration_s = ^2.0004", Mismatch, &["2000.4 steps", "a whole number of steps", "2 or 2.001 s"]),
    ("duration_s = 2.0", "duration_s = ^0.0004", Mismatch, &["0.4 steps", "the nearest durations are 0.001 s"]),
    ("duration_s = 2.0", "duration_s = ^2e9", OutOfRange, &["2e12 steps", "2^40 = 1099511627776"]),
    ("rate_hz = 1000", "rate_hz = ^0", OutOfRange, &["`run.rate_hz` is 0", "from 0.001 to 1e6 in Hz"]),
    ("rate_hz = 1000", "rate_hz = ^1e9", OutOfRange, &["`run.rate_hz` is 1e9"]),
    ("rate_hz = 1000", "rate_hz = ^inf", OutOfRange, &["`run.rate_hz` is inf"]),
    ("rate_hz = 1000", "rate_hz = ^\"fast\"", WrongType, &["`run.rate_hz` is text"]),
    ("rate_hz = 1000", "rate_hz = ^1e999", WrongType, &["a number that is too large"]),
    ("seed = 7", "seed = ^-1", OutOfRange, &["`run.seed` is -1", "a whole number from 0"]),
    ("seed = 7", "seed = ^1.5", WrongType, &["`run.seed` is a number", "a whole number"]),
    ("seed = 7", "seed = ^9223372036854775808", WrongType, &["a number that is too large"]),
    ("\"lockstep\"", "^\"walltime\"", UnknownName, &["`run.clock` is `walltime`", "`lockstep`, `paced`"]),
    ("pace = 1.0", "pace = ^0", OutOfRange, &["`run.pace` is 0"]),
    // [realtime]
    ("plant_core = 2", "^plant_cores = [2]", UnknownKey, &["unknown key `plant_cores` in `realtime`", "nearest: `plant_core`"]),
    ("plant_core = 2", "plant_core = ^[2, 3]", WrongType, &["`realtime.plant_core` is a list", "a whole number from 0 to 1023"]),
    ("controller_core = 3", "controller_core = ^-1", OutOfRange, &["`realtime.controller_core` is -1", "from 0 to 1023"]),
    ("priority = 80", "priority = ^99", OutOfRange, &["`realtime.priority` is 99", "a whole number from 0 to 98"]),
    ("lock_memory = true", "lock_memory = ^1", WrongType, &["`realtime.lock_memory` is a number", "expected: true or false"]),
    ("prefault = false", "prefault = ^\"all\"", WrongType, &["`realtime.prefault` is text", "true or false"]),
    ("dma_latency_us = 20", "dma_latency_us = ^-1", OutOfRange, &["`realtime.dma_latency_us` is -1", "from 0 to"]),
    ("wait = \"spin\"", "wait = ^\"nap\"", UnknownName, &["`realtime.wait` is `nap`", "`hybrid`, `spin`, `yield`, `sleep`"]),
    ("controller_core = 3\nrecorder_core = 0\npriority = 80\nlock_memory = true\nprefault = false\ndma_latency_us = 20\nwait = \"spin\"", "controller_core = 2\nwait = ^\"spin\"", Mismatch, &["plant and controller share core 2", "`yield` or `hybrid`"]),
    ("recorder_core = 0", "recorder_core = ^3", Mismatch, &["core 3 is used by a loop of priority 80", "another core"]),
    ("[realtime]\nplant_core = 2\ncontroller_core = 3\nrecorder_core = 0\npriority = 80\nlock_memory = true\nprefault = false\ndma_latency_us = 20\nwait = \"spin\"", "^[[realtime]]\npriority = 80", WrongType, &["`realtime` is a list", "a table"]),
    // [plant]
    ("model = \"drhas\"", "^moddel = 1\nmodel = \"drhas\"", UnknownKey, &["`moddel` in `plant`", "nearest: `model`"]),
    ("model = \"drhas\"", "model = ^\"dhras\"", UnknownName, &["unknown plant `dhras`", "`drhas`, `spring-mass`", "nearest: `drhas`"]),
    ("substeps = 2", "substeps = ^0", OutOfRange, &["`plant.substeps` is 0", "from 1 to 1000"]),
    ("substeps = 2", "substeps = ^1001", OutOfRange, &["`plant.substeps` is 1001"]),
    ("piston_mass_kg = 50\n", "piston_mass_kg = ^0\n", OutOfRange, &["`plant.parameters.piston_mass_kg` is 0", "from 0.001 to 1e6 in kg"]),
    ("piston_mass_kg = 50\n", "piston_mass_kg = ^\"50 kg\"\n", WrongType, &["is text", "a number from"]),
    ("piston_mass_kg = 50\n", "^piston_mas_kg = 50\n", UnknownKey, &["plant `drhas` has no parameter `piston_mas_kg`", "nearest: `piston_mass_kg`"]),
    ("actuator2.piston_mass_kg = 60.0", "actuator3.^piston_mass_kg = 60.0", UnknownKey, &["no parameter `actuator3.piston_mass_kg`", "nearest: `actuator1.piston_mass_kg`"]),
    ("actuator2.piston_mass_kg = 60.0", "actuator2.piston_mass_kg = ^nan", OutOfRange, &["is not a number"]),
    ("actuator2.piston_mass_kg = 60.0", "actuator2.piston_mass_kg = 60.0\n\"actuator2.piston_mass_kg\" = ^61", Duplicate, &["given twice"]),
    ("actuator2.piston_mass_kg = 60.0", "^actuators = {}", UnknownKey, &["no parameter `actuators`"]),
    ("surface_angle_rad = [-0.4, 0.4]", "^surface_angel_rad = [-0.4, 0.4]", UnknownName, &["no true signal `surface_angel_rad`", "nearest: `surface_angle_rad`"]),
    ("[-0.4, 0.4]", "^[0.4, -0.4]", OutOfRange, &["`plant.limits.surface_angle_rad` is [0.4, -0.4]", "the smaller one first"]),
    ("[-0.4, 0.4]", "^[0.4]", WrongType, &["has 1 entries", "a pair"]),
    ("[-0.4, 0.4]", "^0.4", WrongType, &["is a number", "a pair"]),
    ("[-0.4, 0.4]", "[-0.4, ^nan]", OutOfRange, &["`plant.limits.surface_angle_rad[1]` is not a number", "in rad"]),
    ("[plant.limits]", "[plant.safe_command]\n^actuator_valve_current_a = 0.0\n[plant.limits]", UnknownName, &["takes no command `actuator_valve_current_a`", "one of"]),
    ("[plant.limits]", "[plant.safe_command]\nactuator1_valve_current_a = ^inf\n[plant.limits]", OutOfRange, &["`plant.safe_command.actuator1_valve_current_a` is inf", "in A"]),
    ("\"lockstep\"", "\"lockstep\"\non_controller_loss = ^\"restart\"", UnknownName, &["`run.on_controller_loss` is `restart`", "`abort`, `hold`, `safe-command`, `wait-for-restart`"]),
    // [controller]
    ("law = \"ftsc\"", "law = ^\"ftcs\"", UnknownName, &["unknown law `ftcs`", "`ftsc`, `hold`, `nrsc`, `pid`", "nearest: `ftsc`"]),
    ("rate_hz = 500", "rate_hz = ^300", Mismatch, &["`controller.rate_hz` is 300, not a whole fraction of `run.rate_hz` = 1000", "250 and 333."]),
    ("rate_hz = 500", "rate_hz = ^2000", Mismatch, &["the highest is 1000"]),
    ("command_delay_steps = 1", "command_delay_steps = ^2", OutOfRange, &["from 0 to 1"]),
    ("gain_per_s = 10.0", "gain_per_s = ^-10.0", OutOfRange, &["`controller.ftsc.gain_per_s` is -10", "in 1/s"]),
    ("gain_a_per_m = 80.0", "^gain_a_per_n = 80.0", UnknownKey, &["law `pid` has no parameter `gain_a_per_n`", "one of `gain_a_per_m`"]),
    ("[controller.pid]", "[controller.^lqr]", UnknownKey, &["unknown key `lqr` in `controller`"]),
    ("surface.inertia_kg_m2 = 13.0", "surface.^inertia_kg_m3 = 13.0", UnknownKey, &["the model of a law has no parameter `surface.inertia_kg_m3`"]),
    // [[stimuli]]
    ("target = \"load_n\"", "target = ^\"load n\"", OutOfRange, &["`stimuli[1].target` is `load n`"]),
    ("target = \"load_n\"", "target = ^\"surface_angle_rad\"", Duplicate, &["two stimuli provide the reference signal `surface_angle_rad`"]),
    ("target = \"load_n\"", "target = ^\"surface_angle_d1_radps\"", Duplicate, &["`surface_angle_d1_radps`"]),
    ("target = \"load_n\"", "target = ^\"load\"", MissingKey, &["the unit of `load` is not known"]),
    ("kind = \"step\"", "kind = ^\"setp\"", UnknownName, &["unknown kind of stimulus `setp`", "`paper`, `step`, `ramp`, `sine`, `chirp`, `square`, `pulse`, `prbs`, `multisine`, `sequence`, `table`", "nearest: `step`"]),
    ("kind = \"step\"\nat_s = 0.5\n", "kind = \"step\"\n^at = 0.5\n", UnknownKey, &["unknown key `at` in `stimuli[1]`", "`at_s`"]),
    ("kind = \"step\"\nat_s = 0.5\n", "kind = \"step\"\nat_s = ^2.5\n", OutOfRange, &["`stimuli[1].at_s` is 2.5, which is after the end of the run", "from 0 to 2"]),
    ("[[stimuli]]\ntarget = \"load_n\"\nkind = \"step\"\nat_s = 0.5\nafter = 2.0", "^[[stimuli]]\ntarget = \"load_n\"\nkind = \"step\"\nat_s = 0.5", MissingKey, &["`stimuli[1].after` is missing", "a number"]),
    ("frequency_hz = 1.0", "frequency_hz = ^-1.0", OutOfRange, &["`stimuli[0].frequency_hz` is -1", "in Hz"]),
    ("kind = \"sine\"\namplitude = 0.1\nfrequency_hz = 1.0", "kind = \"ramp\"\nend = 1\nduration_s = ^0", OutOfRange, &["`stimuli[0].duration_s` is 0", "from 1e-9"]),
    // [[faults]]
    ("kind = \"leakage\"", "kind = ^\"leak\"", UnknownName, &["plant `drhas` has no fault `leak`", "nearest: `leakage`"]),
    ("at_s = 1.0", "at_s = ^2.0", OutOfRange, &["the run is already over at 2 s", "from 0 to 1.999 in s"]),
    ("at_s = 1.0", "at_s = ^-1.0", OutOfRange, &["`faults[0].at_s` is -1"]),
    ("at_s = 1.0", "at_s = ^nan", OutOfRange, &["`faults[0].at_s` is not a number"]),
    ("at_s = 1.0", "at_s = 1.0\n^until_s = 1.5", UnknownKey, &["unknown key `until_s` in `faults[0]`"]),
    ("skew_s = 0.25", "skew_s = ^1.25", OutOfRange, &["`faults[0].effects[1].skew_s`: the run is already over at 2.25 s"]),
    ("skew_s = 0.25", "skew_s = ^-0.25", OutOfRange, &["`faults[0].effects[1].skew_s` is -0.25"]),
    ("actuator = 1\n", "actuator = ^3\n", UnknownName, &["plant `drhas` has no actuator 3", "one of `1`, `2`"]),
    ("actuator = 1\n", "actuator = ^\"left\"\n", WrongType, &["`faults[0].effects[0].actuator` is text", "one of `1`, `2`"]),
    ("= 5e-7", "= ^-5e-7", OutOfRange, &["`faults[0].effects[0].coefficient_m3ps_per_sqrt_pa` is -5e-7", "in m3/s/sqrt(Pa)"]),
    ("= 5e-7", "= ^0.5", OutOfRange, &["`actuator1.leakage_coefficient_m3ps_per_sqrt_pa` would become 0 + 0.5 = 0.5", "from 0 to 0.001"]),
    ("speed_per_s = 10.0", "^sped_per_s = 10.0\nspeed_per_s = 1", UnknownKey, &["unknown key `sped_per_s` in `faults[0].effects[0]`", "nearest: `speed_per_s`"]),
    ("[[faults.effects]]\nactuator = 1\ncoefficient_m3ps_per_sqrt_pa = 5e-7\nspeed_per_s = 10.0", "^[[faults.effects]]\nactuator = 1\ncoefficient_m3ps_per_sqrt_pa = 5e-7", MissingKey, &["`faults[0].effects[0].speed_per_s` is missing", "from 0 to 1e6 in 1/s"]),
    // [[derived]]
    ("[[metrics]]\nname = \"max_abs_error_rad\"", "[[derived]]\nname = ^\"error_rad\"\nexpression = \"1\"\n\n[[metrics]]\nname = \"max_abs_error_rad\"", Duplicate, &["already named `error_rad`"]),
    ("[[metrics]]\nname = \"max_abs_error_rad\"", "[[derived]]\nname = ^\"max\"\nexpression = \"1\"\n\n[[metrics]]\nname = \"max_abs_error_rad\"", OutOfRange, &["`derived[2].name` is `max`", "that is not a function"]),
    ("truth.surface_angle_rad - reference", "^truth.surface_angel_rad - reference", Expression, &["unknown signal `truth.surface_angel_rad`", "column 1 of the expression", "nearest: `truth.surface_angle_rad`"]),
    ("truth.surface_angle_rad - reference", "truth.surface_angle_rad - ^reverence", Expression, &["column 27 of the expression: unknown kind of signal `reverence`", "`reference.surface_angle_rad`"]),
    ("abs(error_rad) > 0.1", "abs(^error_m) > 0.1", Expression, &["column 5 of the expression: unknown derived signal `error_m`", "nearest: `error_rad`"]),
    ("abs(error_rad) > 0.1", "abs(^large) > 0.1", Expression, &["unknown derived signal `large`", "only those defined above it"]),
    ("abs(error_rad) > 0.1", "abs(error_rad ^error_rad) > 0.1", Expression, &["column 15 of the expression: expected `,` or `)`, found `error_rad`"]),
    ("mean(large) / 1\"", "mean(large) / ^\"", Expression, &["column 15 of the expression: expected a number, a signal or `(`, found the end"]),
    ("abs(error_rad) > 0.1 and not internal.fault_detected > 0", "^max_abs(error_rad) > 0.1", Expression, &["can be used only in [[metrics]]"]),
    ("abs(error_rad) > 0.1", "1 < 2 ^< 3", Expression, &["two comparisons in a row"]),
    ("abs(error_rad) > 0.1", "1 ^$ 2", Expression, &["unexpected '$'"]),
    ("abs(error_rad) > 0.1", "^sign(error_rad)", Expression, &["unknown function `sign`"]),
    // [[metrics]]
    ("name = \"share_large\"", "name = ^\"max_abs_error_rad\"", Duplicate, &["already named `max_abs_error_rad`"]),
    ("name = \"share_large\"", "name = ^\"large\"", Duplicate, &["already named `large`"]),
    ("mean(large) / 1", "^abs(large)", Expression, &["a metric needs a reduction"]),
    ("mean(large) / 1", "mean(large) / ^large", Expression, &["`large` has a value at every step"]),
    ("mean(large) / 1", "mean(^tiny)", Expression, &["unknown derived signal `tiny`"]),
    ("mean(large) / 1", "^mean(max(large))", Expression, &["a reduction of a reduction"]),
    ("[1.0, 2]]", "^[1.0, 2.5]]", OutOfRange, &["`metrics[0].windows_s[1]` is [1, 2.5], which is not inside the run", "from 0 to 2 in s"]),
    ("[1.0, 2]]", "^[-1, 2]]", OutOfRange, &["not inside the run"]),
    ("[1.0, 2]]", "^[2, 1]]", OutOfRange, &["the smaller one first"]),
    ("[1.0, 2]]", "^[1.0001, 1.0002]]", OutOfRange, &["no step lies in", "0.001 s apart"]),
    ("[1.0, 2]]", "^1.0]", WrongType, &["`metrics[0].windows_s[1]` is a number"]),
    ("[1.0, 2]]", "[1.0, 2]]\npublished = [{ law = \"a\", window_s = ^[0, 2], value = 1, source = \"b\" }]", OutOfRange, &["`metrics[0].published[0].window_s` is not one of the metric's windows"]),
    ("[1.0, 2]]", "[1.0, 2]]\npublished = [^{ law = \"a\", value = 1, source = \"b\" }]", MissingKey, &["`metrics[0].published[0].window_s` is missing", "two numbers"]),
    ("[1.0, 2]]", "[1.0, 2]]\npublished = [{ law = \"a\", window_s = [0, 1], value = ^nan, source = \"b\" }]", OutOfRange, &["`metrics[0].published[0].value` is not a number"]),
    ("[1.0, 2]]", "[1.0, 2]]\npublished = [{ law = \"a\", window_s = [0, 1], value = 1, source = \"b\", ^sauce = 1 }]", UnknownKey, &["nearest: `source`"]),
    ("[[0, 1], [1.0, 2]]", "^[]", OutOfRange, &["`metrics[0].windows_s` is empty"]),
    // Sections
    ("[plant.limits]\nsurface_angle_rad = [-0.4, 0.4]", "^[[plant.limits]]", WrongType, &["`plant.limits` is a list", "a table"]),
];

/// Returns the text without the mark, and the line and column of the mark.
fn marked(text: &str) -> (String, usize, usize) {
    let at = text.find(MARK).expect("a mark");
    let before = &text[..at];
    let line = before.matches('\n').count() + 1;
    let column = at - before.rfind('\n').map_or(0, |at| at + 1) + 1;
    (text.replacen(MARK, "", 1), line, column)
}

pub(crate) fn assert_found(problem: &Problem, kind: ProblemKind, pieces: &[&str]) {
    assert_eq!(problem.kind, kind, "{problem}");
    let text = problem.to_string();
    for piece in pieces {
        assert!(text.contains(piece), "`{piece}` is not in\n{text}");
    }
}

#[test]
fn each_faulty_scenario_is_refused_with_its_place_and_the_expected_value() {
    for (from, to, kind, pieces) in CASES {
        assert_one_problem(&base_with(from, to), *kind, pieces);
    }
}

/// Checks that a text has exactly one problem, at its mark.
pub(crate) fn assert_one_problem(text: &str, kind: ProblemKind, pieces: &[&str]) {
    let (text, line, column) = marked(text);
    let Err(Problems(problems)) = check(&text) else {
        panic!("nothing found wrong with\n{text}");
    };
    let texts: Vec<String> = problems.iter().map(ToString::to_string).collect();
    assert_eq!(problems.len(), 1, "{text}\n{}", texts.join("\n\n"));
    assert_found(&problems[0], kind, pieces);
    let excerpt = problems[0].excerpt.as_ref().expect("a place");
    let place = (excerpt.line, excerpt.column);
    assert_eq!(place, (line, column), "{}", texts[0]);
    assert_eq!(problems[0].source, "folder/base.toml");
}

#[test]
fn all_problems_are_reported_at_once_from_top_to_bottom() {
    let text = base_with("seed = 7", "seed = -7\ncolour = 1")
        .replace("law = \"ftsc\"", "law = \"ftcs\"")
        .replace("[1.0, 2]]", "[1.0, 3]]")
        .replace("substeps = 2", "substeps = true");
    let keys: Vec<String> = problems(&text).into_iter().map(|p| p.key).collect();
    assert_eq!(
        keys,
        [
            "run.seed",
            "run.colour",
            "plant.substeps",
            "controller.law",
            "metrics[0].windows_s[1]",
        ]
    );
}

#[test]
fn every_syntax_error_is_reported() {
    let reported = problems("a = \nb = [1\nc = 'x\n");
    assert!(reported.len() >= 2, "{reported:?}");
    assert!(reported.iter().all(|problem| problem.kind == Syntax));
}

#[test]
fn a_missing_file_is_named() {
    let problems = Scenario::read("no/such/file.toml")
        .expect_err("there is no such file")
        .0;
    assert_eq!(problems.len(), 1);
    assert_found(
        &problems[0],
        Unreadable,
        &["cannot be read", "no/such/file.toml"],
    );
}

#[test]
fn an_empty_scenario_lacks_its_sections_and_nothing_else() {
    let reported = problems("");
    let keys: BTreeSet<&str> = reported
        .iter()
        .map(|problem| problem.key.as_str())
        .collect();
    assert_eq!(
        keys,
        BTreeSet::from(["schema", "run", "plant", "controller"])
    );
    assert!(reported.iter().all(|problem| problem.kind == MissingKey));
}

#[test]
fn a_name_that_cannot_come_from_the_file_is_required() {
    let text = BASE.replace("name = \"base\"\n", "");
    let scenario = Scenario::parse(&text, "folder/my run.toml").expect("TOML");
    let problems = scenario.checked().expect_err("no name");
    assert_found(&problems.0[0], OutOfRange, &["`my run` cannot replace it"]);
}

#[test]
fn a_law_for_another_plant_is_refused_with_those_that_fit() {
    let text = "
schema = 1
run = {duration_s = 1, rate_hz = 100}
plant.model = \"spring-mass\"
controller.law = \"ftsc\"
";
    let problem = only(problems(text));
    assert_found(
        &problem,
        Mismatch,
        &[
            "law `ftsc` is not made for plant `spring-mass`",
            "one of `hold`, `pid`, `strange`",
            "made for `drhas`",
        ],
    );
    assert_eq!(
        problem.excerpt.as_ref().map(|at| (at.line, at.column)),
        Some((5, 18))
    );
}

#[test]
fn unbound_signals_are_named_with_unit_and_remedy() {
    let text = base_with("law = \"ftsc\"", "law = \"strange\"")
        .replace(
            "[controller.pid]",
            "[controller.strange]\ngain = 1\n[controller.pid]",
        )
        .replace(" and not internal.fault_detected > 0", "");
    let scenario = parse(&text)
        .expect("TOML")
        .set(&["controller.model.surface.inertia_kg_m2=1"]);
    let problems = scenario.checked().expect_err("unbound").0;
    assert_eq!(problems.len(), 4, "{problems:?}");
    let expected: [&[&str]; 4] = [
        &[
            "law `strange` needs the measured signal `actuator1_pressure3_pa` in Pa",
            "plant `drhas` does not provide",
            "nearest: `actuator1_pressure1_pa`",
        ],
        &["measured signal `surface_angle_rad` in deg, but plant `drhas` provides it in rad"],
        &[
            "plant `drhas` needs the command `actuator2_valve_current_a` in A",
            "law `strange` does not provide",
        ],
        &[
            "law `strange` needs the reference signal `wind_mps` in m/s, which no stimulus provides",
            "a [[stimuli]] with target = \"wind_mps\"",
        ],
    ];
    for (problem, pieces) in problems.iter().zip(expected) {
        assert_found(problem, Unbound, pieces);
    }
}

#[test]
fn a_waveform_without_the_derivatives_that_a_law_needs_is_refused() {
    let text = base_with(
        "kind = \"sine\"\namplitude = 0.1\nfrequency_hz = 1.0",
        "kind = \"step\"\nafter = 0.1",
    );
    let problem = only(problems(&text));
    assert_found(
        &problem,
        Unbound,
        &[
            "`surface_angle_d1_radps` in rad/s",
            "target = \"surface_angle_rad\"",
            "`paper`, `sine`, `chirp`",
            "first 2 derivatives",
        ],
    );
}

#[test]
fn a_parameter_without_default_is_required() {
    let text = base_with("law = \"ftsc\"", "law = \"strange\"");
    let reported = problems(&text);
    let missing: Vec<&Problem> = reported.iter().filter(|p| p.kind == MissingKey).collect();
    assert_eq!(missing.len(), 1);
    assert_found(
        missing[0],
        MissingKey,
        &["`controller.strange.gain` is missing", "from 0 to 1"],
    );
}

#[test]
fn a_nominal_value_outside_the_laws_range_is_refused() {
    let text = base_with("law = \"ftsc\"", "law = \"strange\"")
        .replace("surface.inertia_kg_m2 = 13.0", "");
    let reported = problems(&text);
    let believed: Vec<&Problem> = reported
        .iter()
        .filter(|p| p.key == "controller.model.surface.inertia_kg_m2")
        .collect();
    assert_eq!(believed.len(), 1);
    assert_found(
        believed[0],
        OutOfRange,
        &["takes the plant's value 13.5", "from 0 to 2"],
    );
}

#[test]
fn a_plant_without_faults_reports_that_it_has_none() {
    let text = "
schema = 1
run = {duration_s = 1, rate_hz = 100}
plant.model = \"spring-mass\"
controller.law = \"hold\"
faults = [{kind = \"leakage\", at_s = 0, effects = []}]
";
    let mut plants = descriptions::plants();
    plants[1].faults.clear();
    let problems = parse(text)
        .and_then(|scenario| scenario.check(&plants, &descriptions::laws(), &[]))
        .expect_err("no faults")
        .0;
    assert_eq!(problems.len(), 2, "{problems:?}");
    assert_found(
        &problems[0],
        UnknownName,
        &["has no fault `leakage`", "offers none"],
    );
    assert_found(&problems[1], MissingKey, &["`faults[0].effects` is empty"]);
}

#[test]
fn a_bad_run_does_not_hide_other_problems() {
    let text = base_with("rate_hz = 1000", "rate_hz = 0").replace("error_rad)\"", "eror_rad)\"");
    let keys: Vec<String> = problems(&text).into_iter().map(|p| p.key).collect();
    assert_eq!(keys, ["run.rate_hz", "metrics[0].expression"]);
}

#[test]
fn the_list_of_problems_is_readable_by_machines() {
    let problems = check(&base_with("rate_hz = 1000", "rate_hz = 0")).expect_err("no rate");
    let json = serde_json::to_value(&problems).expect("serialises");
    assert_eq!(json[0]["kind"], "out-of-range");
    assert_eq!(json[0]["key"], "run.rate_hz");
    assert_eq!(json[0]["excerpt"]["line"], 7);
    assert_eq!(json[0]["excerpt"]["column"], 11);
}
