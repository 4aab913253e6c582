//! FMUs that never answer or are killed, and those that cannot be started by hand or on a target: each is named,
//! and nothing is left behind.

use rustix::process::Signal;

use super::{Place, scenario};
use crate::support::board::Board;
use crate::support::fmus::proportional;
use crate::support::harness::{EXPIRES_S, send, until};

/// Scenario with the FMU as the controller of the mass on a spring.
const AS_CONTROLLER: &str = "schema = 1
name = \"fmu\"
[run]
duration_s = 1.0
rate_hz = 100
[plant]
model = \"spring-mass\"
[controller]
law = \"proportional\"
program = \"p.fmu\"
[[stimuli]]
target = \"position_m\"
kind = \"step\"
at_s = 0.5
after = 0.01
";

#[test]
fn an_endless_loop_is_named_at_the_wait_limit() {
    let Some(place) = Place::new() else { return };
    place.fmu("p.fmu", &proportional());
    let as_plant = scenario("proportional", "p.fmu", 100.0, 100.0);
    for (text, key, expected) in [
        (as_plant.as_str(), "plant.parameters", "plant was stuck"),
        (
            AS_CONTROLLER,
            "controller.proportional",
            "controller did not answer step 2",
        ),
    ] {
        // Leftover processes and files are checked when the run has ended.
        let run = place.run(
            text,
            &format!("--set {key}.trouble=11 --wait-limit {EXPIRES_S}"),
        );
        let run = run.expect(3);
        let output = format!("{}{}", run.stdout, run.stderr);
        for fragment in [expected, "the solver looks for a root"] {
            assert!(output.contains(fragment), "`{fragment}` is not in {output}");
        }
    }
}

#[test]
fn a_rounding_mode_left_by_an_fmu_is_named_and_changes_no_digest() {
    let Some(place) = Place::new() else { return };
    place.fmu("p.fmu", &proportional());
    let plain = place.run(AS_CONTROLLER, "").expect(0);
    let run = place
        .run(AS_CONTROLLER, "--set controller.proportional.trouble=13")
        .expect(0);
    assert_eq!(run.digest(), plain.digest());
    let warning = "warning: `DoStep` left the floating-point unit at rounding up";
    let log = std::fs::read_to_string(run.folder.join("controller.log")).expect("a log");
    assert_eq!(log.matches(warning).count(), 1, "{log}");
    let line = format!("controller: {warning}");
    assert!(run.stderr.contains(&line), "{}", run.stderr);
}

#[test]
fn the_loss_of_a_killed_fmu_is_reported_with_its_last_message() {
    let Some(place) = Place::new() else { return };
    place.fmu("p.fmu", &proportional());
    let as_plant = scenario("proportional", "p.fmu", 100.0, 100.0);
    for (text, key, side) in [
        (as_plant.as_str(), "plant.parameters", "plant"),
        (AS_CONTROLLER, "controller.proportional", "controller"),
    ] {
        let path = place.rig.write("scenario.toml", text);
        let held = format!("--set {key}.trouble=12 --pause-at 0.5 --wait-limit 60");
        let arguments = format!("{} {held}", path.display());
        let running = place.rig.start_with(place.command(), &arguments);
        let log = running.folder().join(format!("{side}.log"));
        until("the FMU says something", || {
            std::fs::read_to_string(&log).is_ok_and(|log| log.contains("the filter clogs"))
        });
        let [plant, controller] = running.children_at_once();
        let fmu = if side == "plant" { plant } else { controller };
        let program = std::fs::read_link(format!("/proc/{}/exe", fmu.pid)).expect("it runs");
        assert!(program.ends_with("hil-fmu"), "{}", program.display());
        send(fmu.pid, Signal::KILL);
        let run = running.finish().expect(3);
        place.assert_nothing_unpacked();
        let expected = format!("{}{}", run.stdout, run.stderr);
        for fragment in [
            format!("{side} was killed by SIGKILL").as_str(),
            "the filter clogs",
        ] {
            assert!(
                expected.contains(fragment),
                "`{fragment}` is not in {expected}"
            );
        }
    }
}

#[test]
fn a_model_with_a_host_program_cannot_be_started_by_hand() {
    let Some(place) = Place::new() else { return };
    // By its content as well as by its name.
    for name in ["p.fmu", "renamed"] {
        place.fmu(name, &proportional());
        let plant = scenario("proportional", name, 100.0, 100.0);
        let controller = AS_CONTROLLER.replace("p.fmu", name);
        for (side, text) in [("plant", plant), ("controller", controller)] {
            let run = place.run(&text, &format!("--{side} external"));
            let named = place.rig.path(name).display().to_string();
            let expected = format!(
                "--{side} external: {named} is a model, which another program runs; name a program instead"
            );
            let run = run.expect(2).says(&[&expected]);
            assert!(!run.folder.exists(), "nothing was started");
            assert!(!run.stderr.contains("start it"), "{}", run.stderr);
        }
    }
}

#[test]
fn an_fmu_cannot_be_a_controller_on_a_target() {
    let Some(place) = Place::new() else { return };
    place.fmu("p.fmu", &proportional());
    let path = place.rig.write("scenario.toml", AS_CONTROLLER);
    let board = Board::new(&place.rig);
    let arguments = format!("{} --target me@board", path.display());
    let run = place.rig.start_with(board.hil(), &arguments).finish();
    run.expect(2)
        .says(&["an FMU can run only on this machine, not on me@board"]);
}
