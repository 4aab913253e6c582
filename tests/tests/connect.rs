//! `[[connect]]`: the law `pid` for a mass on a spring, on plants with other names and units.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::support::harness::{Rig, Run};
use crate::support::mcap_reader::Recording;
use crate::support::programs::program_of_tests;

pub(crate) const RUN: &str = "schema = 1
name = \"connected\"
[run]
duration_s = 2.0
rate_hz = 1000
[plant.parameters]
damping_n_s_per_m = 20.0
";

/// Law on its own plant.
const OWN: &str = "[controller]
law = \"pid\"
[[stimuli]]
target = \"position_m\"
kind = \"step\"
at_s = 0.1
after = 0.01
[plant]
model = \"spring-mass\"
";

/// Law on the plant in millimetres and kilonewtons.
pub(crate) const SLIDER: &str = "[controller]
law = \"pid\"
made_for = \"spring-mass\"
[plant]
model = \"slider\"
[[stimuli]]
target = \"goal_mm\"
unit = \"mm\"
kind = \"step\"
at_s = 0.1
after = 10.0
[[connect]]
law = \"measured.position_m\"
plant = \"measured.s\"
[[connect]]
law = \"reference.position_m\"
plant = \"reference.goal_mm\"
[[connect]]
law = \"command.force_n\"
plant = \"command.f\"
";

/// Law on the plant in halves of a metre and quarters of a newton, which are unknown units.
fn halves() -> String {
    SLIDER
        .replace("\"slider\"", "\"halves\"")
        .replace("\"mm\"", "\"half_m\"")
        .replace("after = 10.0", "after = 0.02")
        .replace("\"measured.s\"", "\"measured.s\"\nfactor = 0.5")
        .replace(
            "\"reference.goal_mm\"",
            "\"reference.goal_mm\"\nfactor = 0.5",
        )
        .replace("\"command.f\"", "\"command.f\"\nfactor = 4")
}

fn scenario(rig: &Rig, name: &str, text: &str) -> PathBuf {
    rig.write(name, &(RUN.to_owned() + text))
}

fn text(path: &Path) -> &str {
    path.to_str().expect("plain text")
}

fn foreign(scenario: &Path, more: &str) -> String {
    let plant = program_of_tests("foreign-plant");
    format!(
        "{} --plant-bin {} {more}",
        scenario.display(),
        plant.display()
    )
}

/// Returns the values of a column as recorded.
fn values(run: &Run, column: &str) -> Vec<f64> {
    Recording::open(&run.recording()).column(column)
}

fn times(values: &[f64], factor: f64) -> Vec<u64> {
    values
        .iter()
        .map(|value| (value * factor).to_bits())
        .collect()
}

#[test]
fn units_in_powers_of_two_give_bitwise_equal_runs() {
    let rig = Rig::new();
    let own = rig.run(text(&scenario(&rig, "own.toml", OWN))).expect(0);
    let run = rig
        .run(&foreign(&scenario(&rig, "halves.toml", &halves()), ""))
        .expect(0);
    let (position_m, s) = (values(&own, "truth.position_m"), values(&run, "truth.s"));
    assert!(position_m.iter().any(|value| *value > 0.005), "it moves");
    assert_eq!(times(&position_m, 2.0), times(&s, 1.0));
    let (force_n, f) = (values(&own, "command.force_n"), values(&run, "command.f"));
    assert_eq!(times(&force_n[..2000], 4.0), times(&f[..2000], 1.0));
}

#[test]
fn in_millimetres_the_mass_settles_at_the_closed_form_position() {
    let rig = Rig::new();
    let slider = scenario(&rig, "slider.toml", SLIDER);
    let p_only =
        "--set controller.pid.integral_n_per_m_s=0 --set controller.pid.derivative_n_s_per_m=0";
    let run = rig.run(&foreign(&slider, p_only)).expect(0);
    // k_p (r - x) = k x with k_p = 300 N/m, k = 100 N/m and r = 10 mm; transients decay with exp(-10 t).
    let s = values(&run, "truth.s");
    let last_mm = s.last().expect("records");
    assert!((last_mm - 7.5).abs() < 1e-6, "{last_mm} mm");
    let f = values(&run, "command.f");
    // 100 N/m times 7.5 mm, in kN.
    assert!((f[1999] - 0.75e-3).abs() < 1e-9, "{} kN", f[1999]);
    // At the step the error is the full 10 mm: 300 N/m times 10 mm.
    assert!((f[100] - 3e-3).abs() < 1e-15, "{} kN", f[100]);
}

#[test]
fn the_recording_has_the_names_of_the_plant_and_every_conversion() {
    let rig = Rig::new();
    let slider = scenario(&rig, "slider.toml", SLIDER);
    let run = rig.run(&foreign(&slider, "")).expect(0);
    let line = "connected: plant command.f [kN] = 0.001 * law command.force_n [N]";
    assert!(run.stdout.contains(line), "{}", run.stdout);
    let connections = run.summary()["connections"].take();
    assert_eq!(
        connections[0],
        json!({"kind": "measured", "law": "position_m", "law_unit": "m", "plant": "s", "plant_unit": "mm",
            "factor": 0.001, "offset": 0.0, "is_given": false})
    );
    let recording = Recording::open(&run.recording());
    for column in [
        "measured.s",
        "measured.der__s",
        "reference.goal_mm",
        "command.f",
        "applied.f",
    ] {
        recording.place(column);
    }
    assert!(
        !recording
            .columns
            .iter()
            .any(|name| name.contains("position_m"))
    );
    let facts = recording.metadata();
    let fact = facts.values().find_map(|facts| facts.get("connections"));
    let fact: Value = serde_json::from_str(fact.expect("they are there")).expect("JSON");
    assert_eq!(fact, connections);
    let effective = &recording.attachments()["scenario.toml"];
    assert!(
        effective
            .contains("[[connect]] # law measured.position_m [m] = 0.001 * plant measured.s [mm]"),
        "{effective}"
    );
}

#[test]
fn connected_runs_can_be_repeated_replayed_and_resumed() {
    let rig = Rig::new();
    let slider = scenario(&rig, "slider.toml", SLIDER);
    let run = rig.run(&foreign(&slider, "--checkpoint-at 0.5")).expect(0);
    let folder = text(&run.folder);
    let plant = program_of_tests("foreign-plant");
    let plant = ["--plant-bin", text(&plant)];
    let out = |name: &str| text(&rig.path(name)).to_owned();

    let again = rig.rerun(&run.folder, &plant).expect(0);
    again.prints(&[&run.digest()]);
    for link in ["iceoryx2", "in-process"] {
        let report = rig
            .hil(&["replay", folder, "--json", "--link", link])
            .expect(0)
            .json();
        assert_eq!(report["verdict"], "same", "{report:#}");
    }
    let from = run.folder.join("checkpoint-500");
    let on = format!("--from {} {}", from.display(), plant.join(" "));
    assert_eq!(rig.run(&on).expect(0).digest(), run.digest());
    let other = format!("{on} --set connect[0].factor=0.002");
    rig.run(&other)
        .expect(2)
        .says(&["connect must stay the same"]);
    let made = out("made.toml");
    rig.hil(&["scenario", "from", folder, "-o", &made])
        .expect(0);
    let repeated = rig.run(&foreign(Path::new(&made), "")).expect(0);
    assert_eq!(repeated.digest(), run.digest());
}

#[test]
fn renaming_changes_no_digest_in_one_process_or_two() {
    let rig = Rig::new();
    let own = rig.run(text(&scenario(&rig, "own.toml", OWN))).expect(0);
    let renamed = OWN.replace("target = \"position_m\"", "target = \"goal\"\nunit = \"m\"")
        + "[[connect]]\nlaw = \"reference.position_m\"\nplant = \"reference.goal\"\n";
    let renamed = scenario(&rig, "renamed.toml", &renamed);
    let run = rig.run(text(&renamed)).expect(0);
    assert_eq!(run.digest(), own.digest());
    // In mm the numbers of the reference differ.
    let in_mm = "--set stimuli[0].unit=mm --set stimuli[0].after=10";
    let two = rig.run(&format!("{} {in_mm}", renamed.display())).expect(0);
    assert_ne!(two.digest(), own.digest());
    let one = rig
        .run(&format!("{} {in_mm} --link in-process", renamed.display()))
        .expect(0);
    assert_eq!(one.digest(), two.digest());
    let paced = rig
        .run(&format!("{} {in_mm} --pace 10", renamed.display()))
        .expect(0);
    assert_eq!(paced.digest(), two.digest());
}

#[test]
fn another_controller_takes_over_under_the_same_names() {
    let rig = Rig::new();
    let slider = scenario(&rig, "slider.toml", SLIDER);
    let running = rig.start(&foreign(&slider, "--pause-at 1 --wait-limit 60"));
    rig.until_held_at(1000);
    rig.in_session("controller swap --set controller.pid.proportional_n_per_m=200")
        .expect(0);
    rig.in_session("resume").expect(0);
    let run = running.finish().expect(0);
    assert_eq!(run.summary()["verdict"], "pass");
    // The integral of the next controller begins at 0 and reaches the target again, in mm.
    let s = values(&run, "truth.s");
    assert!(
        (s.last().expect("records") - 10.0).abs() < 1.0,
        "{:?}",
        s.last()
    );
}

#[test]
fn faults_have_the_names_and_units_of_the_plant() {
    let rig = Rig::new();
    let biased = SLIDER.to_owned()
        + "[[faults]]\nkind = \"bias\"\nat_s = 0.0\n[[faults.effects]]\ntarget = \"measured.s\"\nbias = 1.0\n";
    let run = rig
        .run(&foreign(&scenario(&rig, "biased.toml", &biased), ""))
        .expect(0);
    // The integral brings the reading to 10 mm, and the mass to one millimetre less.
    let s = values(&run, "truth.s");
    assert!(
        (s.last().expect("records") - 9.0).abs() < 0.1,
        "{:?}",
        s.last()
    );
}

#[test]
fn invalid_connections_start_nothing() {
    let rig = Rig::new();
    #[rustfmt::skip] // a table
    let cases = [
        ("\"measured.s\"", "\"measured.der__s\"", "have different dimensions, m/s and m"),
        ("made_for = \"spring-mass\"\n", "", "law `pid` is not made for plant `slider`"),
        ("\"command.f\"", "\"command.g\"", "`command.g` is not a signal of plant `slider`"),
    ];
    for (from, to, expected) in cases {
        let wrong = scenario(&rig, "wrong.toml", &SLIDER.replace(from, to));
        rig.run(&foreign(&wrong, "")).expect(2).says(&[expected]);
    }
}
