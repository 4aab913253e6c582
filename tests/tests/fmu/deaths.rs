//! FMUs that end their process where nobody expects it, or take long to start: each end is named, and each limit can be set.

use rustix::process::Signal;

use super::shipped::{COUNTED, OUTPUT, description, fmu, library, odd};
use super::{Place, scenario};
use crate::support::fmus::proportional;
use crate::support::harness::{send, until};
use crate::support::mcap_reader::Recording;

/// Time that a start takes in ms, longer than any program may take without a limit of the user's.
const SLOW: &str = "slow 11000";

#[test]
fn a_library_that_ends_the_process_when_it_is_loaded_is_named() {
    let Some(place) = Place::new() else { return };
    for (options, named) in [
        (&["-DAT_LOAD=give_up()"][..], "exit(7) was called in dlopen"),
        (
            &["-DAT_LOAD=give_up()", "-DEXIT_CODE=0"],
            "exit(0) was called in dlopen",
        ),
        (&["-DAT_LOAD=abort()"], "SIGABRT in dlopen"),
        (&["-DAT_LOAD=_Exit(0)"], "it ended without a description"),
    ] {
        let library = library(&[&[COUNTED], options].concat());
        let described = description("t", OUTPUT, "");
        place.fmu("odd.fmu", &fmu(described, &library));
        place.hil(&["describe", "odd.fmu"]).expect(0);
        let loaded = place.hil(&["describe", "odd.fmu", "--load"]);
        loaded.expect(2).says(&["odd.fmu: ", named]);
    }
}

#[test]
fn an_fmu_that_exits_with_0_in_its_start_is_named_before_the_run() {
    let Some(place) = Place::new() else { return };
    let exits = library(&[COUNTED, "-DEXIT_CODE=0"]);
    for call in [
        "fmi2Instantiate",
        "fmi2ExitInitializationMode",
        "fmi2GetReal",
    ] {
        let token = format!("exit {call}");
        place.fmu("odd.fmu", &fmu(description(&token, OUTPUT, ""), &exits));
        let named = format!("exit(0) was called in {call}");
        let run = place.run(&odd(), "").expect(2).says(&[&named]);
        assert!(!run.folder.exists(), "{call}: it was started");
    }
    // One that ends its process when it is taken down was checked.
    let token = "exit fmi2Terminate";
    place.fmu("odd.fmu", &fmu(description(token, OUTPUT, ""), &exits));
    let run = place.run(&odd(), "");
    assert!(run.folder.exists(), "{}", run.stderr);
    let silent = library(&[COUNTED, "-DAT_LOAD=_Exit(0)"]);
    place.fmu("odd.fmu", &fmu(description("t", OUTPUT, ""), &silent));
    let message = "the process ended with exit code 0 during the check";
    place.run(&odd(), "").expect(2).says(&[message]);
}

#[test]
fn an_fmu_that_cannot_save_its_state_is_reported_with_the_missing_capability() {
    let Some(place) = Place::new() else { return };
    let described = description("t", OUTPUT, "");
    place.fmu("odd.fmu", &fmu(described, &library(&[COUNTED])));
    let told = [
        "plant `odd` cannot save its state",
        "`canGetAndSetFMUstate`",
    ];
    let run = place
        .run(&odd(), "--checkpoint-at 0.5")
        .expect(2)
        .says(&told);
    assert!(!run.stderr.contains("Plant::state"), "{}", run.stderr);
}

#[test]
fn an_empty_message_gives_no_reason_for_an_end() {
    let Some(place) = Place::new() else { return };
    let silent = description("say ", OUTPUT, "");
    place.fmu("odd.fmu", &fmu(silent, &library(&[COUNTED])));
    let run = place.run(&odd(), "").expect(3);
    let words = format!("{}{}", run.stdout, run.stderr);
    assert!(words.contains("answered DoStep with Error\n"), "{words}");
}

#[test]
fn a_killed_fmu_is_named_by_the_call_in_which_it_died() {
    let Some(place) = Place::new() else { return };
    place.fmu("p.fmu", &proportional());
    let as_plant = scenario("proportional", "p.fmu", 100.0, 100.0);
    let endless = "--set plant.parameters.trouble=11 --wait-limit 600";
    let path = place.rig.write("scenario.toml", &as_plant);
    let arguments = format!("{} {endless}", path.display());
    let running = place.rig.start_with(place.command(), &arguments);
    let log = running.folder().join("plant.log");
    until("the step has begun", || {
        std::fs::read_to_string(&log).is_ok_and(|log| log.contains("the solver looks for a root"))
    });
    let [plant, _] = running.children_at_once();
    send(plant.pid, Signal::KILL);
    let run = running.finish().expect(3);
    place.assert_nothing_unpacked();
    let output = format!("{}{}", run.stdout, run.stderr);
    assert!(
        output.contains("plant was killed by SIGKILL (9) in fmi3DoStep"),
        "{output}"
    );
}

#[test]
fn a_study_may_give_an_fmu_more_time_to_start() {
    let Some(place) = Place::new() else { return };
    let marker = format!("-DMARKER=\"{}\"", place.rig.path("started").display());
    let slow = library(&[COUNTED, &marker]);
    place.fmu("odd.fmu", &fmu(description(SLOW, OUTPUT, ""), &slow));
    place.rig.write("odd.toml", &odd());
    place.rig.write(
        "study.toml",
        "schema = 1\nscenario = \"odd.toml\"\nseed = 1\nsampling = \"grid\"\nwait_limit_s = 60.0\n\
         [[vary]]\nkey = \"controller.hold.value\"\nkind = \"list\"\nvalues = [1, 2]\n",
    );
    place.hil(&["campaign", "check", "study.toml"]).expect(0);
    assert!(place.rig.path("started").exists(), "it was slow once");
}

#[test]
fn an_fmu_that_takes_over_may_have_more_time_to_start() {
    let Some(place) = Place::new() else { return };
    let marker = format!("-DMARKER=\"{}\"", place.rig.path("started").display());
    let slow = library(&[COUNTED, &marker]);
    let force = "<ScalarVariable name=\"force_n\" valueReference=\"1\" causality=\"output\"><Real unit=\"N\"/></ScalarVariable>";
    let law = place.fmu("odd.fmu", &fmu(description(SLOW, force, ""), &slow));
    let text = "schema = 1\nname = \"takeover\"\n[run]\nduration_s = 1.0\nrate_hz = 1000\n\
                [plant]\nmodel = \"spring-mass\"\n[controller]\nlaw = \"hold\"\n";
    let scenario = place.rig.write("scenario.toml", text);
    let arguments = format!("{} --pause-at 0.5", scenario.display());
    let running = place.rig.start_with(place.command(), &arguments);
    place.rig.until_held_at(500);
    let swap = |limit: &[&str]| {
        let law = [
            "--bin",
            law.to_str().expect("text"),
            "--set",
            "controller.law=odd",
        ];
        let session = ["--session", place.rig.session()];
        let words = [&["controller", "swap"][..], &law, limit, &session].concat();
        place.rig.beside(&words)
    };
    swap(&["--wait-limit", "0"]).expect(2).says(&["above 0"]);
    swap(&["--wait-limit", "60"]).expect(0);
    assert!(place.rig.path("started").exists(), "it was slow once");
    place.rig.in_session("resume").expect(0);
    let run = running.finish().expect(0);
    // Its own steps, from where it took over.
    let force_n = Recording::open(&run.recording()).column("applied.force_n");
    assert!(force_n[999] > 400.0, "{}", force_n[999]);
}
