//! Start keys of an FMU as the controller: in a run, in its continuations, and in a run with another FMU.

use super::Place;
use super::aliases::{accumulator, row};
use super::start::starts;
use crate::support::fmus::reference;
use crate::support::harness::Run;
use crate::support::mcap_reader::Recording;

/// The mass on a spring under an FMU: its name, one of its outputs as the force, and more of `[controller]`.
fn spring_mass(program: &str, law: &str, output: &str, duration_s: f64, rest: &str) -> String {
    format!(
        "schema = 1\nname = \"controllers\"\n[run]\nduration_s = {duration_s:?}\nrate_hz = 100\n\
         [plant]\nmodel = \"spring-mass\"\n[controller]\nlaw = \"{law}\"\nprogram = \"{program}\"\n{rest}\
         [[connect]]\nlaw = \"command.{output}\"\nplant = \"command.force_n\"\nfactor = 1.0\n"
    )
}

/// The same of `starts.fmu`, which has an input.
fn under_starts(output: &str, duration_s: f64, rest: &str) -> String {
    spring_mass("starts.fmu", "starts", output, duration_s, rest)
        + "[[connect]]\nlaw = \"measured.u\"\nplant = \"measured.position_m\"\nfactor = 1.0\n"
}

#[test]
fn a_controller_has_its_start_keys_in_a_replay_and_from_a_checkpoint() {
    for version in [2, 3] {
        let Some(place) = Place::new() else { return };
        place.fmu("v.fmu", &reference("VanDerPol", version));
        let keys =
            "tolerance = 1e-6\nstart_time_s = 5.0\n[controller.initial]\nx0 = 0.5\nx1 = -0.25\n";
        let text = spring_mass("v.fmu", "VanDerPol", "x0", 4.0, keys);
        let run = place.run(&text, "--checkpoint-at 2").expect(0);
        let force_n = Recording::open(&run.recording()).column("command.force_n");
        // One step of the FMU's solver from 0.5 by x1, which is also how far it gets in its first period.
        assert!((force_n[0] - 0.4975).abs() < 1e-12, "{}", force_n[0]);
        let folder = run.folder.display().to_string();
        let replay = place.hil(&["replay", &folder, "--json"]).expect(0).json();
        assert_eq!(replay["verdict"], "same", "{replay}");
        let from = run.folder.join("checkpoint-200");
        let out = place.rig.path("resumed");
        let [from, to] = [&from, &out].map(|path| path.to_str().expect("text"));
        let resumed = place.hil(&["run", "--from", from, "--out", to]).expect(0);
        let resumed = Run {
            folder: out,
            ..resumed
        };
        assert_eq!(resumed.digest(), run.digest(), "FMI {version}");
    }
}

#[test]
fn texts_and_files_of_a_controller_are_there_in_a_replay() {
    for version in [2, 3] {
        let Some(place) = Place::new() else { return };
        place.fmu("starts.fmu", &starts(version, ""));
        place.rig.write("table.csv", "12345");
        let keys =
            "[controller.texts]\nname = \"seven b\"\n[controller.files]\ntable = \"table.csv\"\n";
        for (output, expected) in [("length", 7.0), ("bytes", 5.0)] {
            let text = under_starts(output, 0.1, keys);
            let run = place.run(&text, "").expect(0);
            let force_n = Recording::open(&run.recording()).column("command.force_n");
            assert_eq!(force_n[5], expected, "{output}");
            let folder = run.folder.display().to_string();
            place.hil(&["replay", &folder]).expect(0);
        }
    }
}

#[test]
fn an_array_has_its_initial_values_by_elements() {
    let Some(place) = Place::new() else { return };
    place.fmu("s.fmu", &reference("StateSpace", 3));
    let text = super::scenario("StateSpace", "s.fmu", 1.0, 3.0);
    let (before, after) = text.split_once("[controller]").expect("a controller");
    // The elements of its inputs by either name; the others have their start values.
    let initial = "[plant.initial]\n\"u[2]\" = 7\nu__3 = 8\n";
    let run = place.run(&format!("{before}{initial}[controller]{after}"), "");
    let run = Recording::open(&run.expect(0).recording());
    let outputs = [1, 2, 3].map(|element| run.column(&format!("truth.y__{element}"))[0]);
    assert_eq!(outputs, [1.0, 7.0, 8.0]);
    let unknown = "[plant.initial]\n\"u[4]\" = 7\n";
    place
        .run(&format!("{before}{unknown}[controller]{after}"), "")
        .expect(2)
        .says(&["`initial.u[4]` is not a variable of the FMU"]);
}

#[test]
fn a_controller_past_its_stop_time_is_lost_at_that_step() {
    let Some(place) = Place::new() else { return };
    place.fmu("starts.fmu", &starts(3, ""));
    let text = under_starts("stop", 1.0, "stop_time_s = 0.5\n");
    let run = place.run(&text, "").expect(3);
    let told = [
        "controller gave up at step 50",
        "`stop_time_s` is 0.5, but the step of 0.01 s from 0.5 would exceed it",
    ];
    let expected = format!("{}{}", run.stdout, run.stderr);
    for fragment in told {
        assert!(
            expected.contains(fragment),
            "`{fragment}` is not in {expected}"
        );
    }
    let whole = place.run(&text, "--set run.duration_s=0.5").expect(0);
    assert_eq!(whole.summary()["steps"], 50);
}

#[test]
fn another_fmu_without_a_variable_that_the_scenario_sets_does_not_take_over() {
    let Some(place) = Place::new() else { return };
    place.fmu("starts.fmu", &starts(3, ""));
    let law = [row("force_n", &[]), row("position_m", &[]), row("g", &[])];
    let other = place.fmu("other.fmu", &accumulator(3, &law, &[]));
    let keys = "[controller.initial]\nbody.x = 1\n";
    let text = under_starts("stop", 1.0, keys);
    let scenario = place.rig.write("scenario.toml", &text);
    let arguments = format!("{} --pause-at 0.5 --wait-limit 60", scenario.display());
    let running = place.rig.start_with(place.command(), &arguments);
    place.rig.until_held_at(50);
    let swap = [
        "controller",
        "swap",
        "--session",
        place.rig.session(),
        "--bin",
        other.to_str().expect("text"),
        "--set",
        "controller.law=accumulators",
    ];
    let refused = place.rig.beside(&swap).expect(2);
    refused.says(&["`initial.body.x` is not a variable of the FMU"]);
    place.rig.in_session("resume").expect(0);
    let run = running.finish().expect(0);
    assert_eq!(run.summary()["controllers"], serde_json::json!([]));
}
