//! Programs named by scenarios and recordings: which one runs, and which are not run.

mod place;

use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use rustix::process::Signal;
use serde_json::Value;

use place::{Place, naming};

use crate::support::harness::{Rig, Run, send, text, until};
use crate::support::mcap_reader::Recording;
use crate::support::programs::{example, program};

fn mode(path: &Path, mode: u32) {
    std::fs::set_permissions(path, Permissions::from_mode(mode)).expect("it is ours");
}

#[test]
fn program_paths_are_relative_to_the_folder_of_the_scenario() {
    let place = Place::new();
    let run = place.recorded();
    let summary = run.summary();
    assert_eq!(summary["plant"]["binary"], text(&place.plant));
    assert_eq!(summary["controller"]["binary"], text(&place.law));
    // The effective scenario can be run from anywhere.
    let effective = run.folder.join("scenario.toml");
    let again = place.rig.run(text(&effective)).expect(0);
    assert_eq!(again.digest(), run.digest());
    place
        .run("--link in-process")
        .expect(2)
        .says(&["in-process", "bin/plant", "plant.program of"]);
    let checked = place.rig.hil(&["config", "check", text(&place.scenario)]);
    checked.expect(0).prints(&["pendulum under state-feedback"]);
}

#[test]
fn flags_win_over_the_environment_and_that_over_the_scenario() {
    let place = Place::new();
    let hil = |variable: &str, arguments: &str| {
        let mut hil = place.rig.command(program("hil"));
        hil.env("HIL_PLANT_BIN", variable);
        let arguments = format!("{} {arguments}", place.scenario.display());
        place.rig.start_with(hil, &arguments).finish()
    };
    hil("/no/such/plant", "")
        .expect(2)
        .says(&["cannot run /no/such/plant (HIL_PLANT_BIN): "]);
    let given = format!("--plant-bin {}", place.plant.display());
    hil("/no/such/plant", &given).expect(0);
    hil("", "").expect(0);
    place
        .run("--plant-bin /another/plant")
        .expect(2)
        .says(&["cannot run /another/plant"]);
}

#[test]
fn several_scenarios_run_with_the_programs_of_each() {
    let place = Place::new();
    let both = format!("{} scenarios/spring-mass.toml", place.scenario.display());
    let run = place.rig.run(&both).expect(0);
    for (name, plant) in [
        ("pendulum", place.plant.clone()),
        ("spring-mass", program("plant-process")),
    ] {
        let summary = std::fs::read_to_string(run.folder.join(name).join("summary.json"));
        let summary: Value = serde_json::from_str(&summary.expect("a run")).expect("JSON");
        assert_eq!(summary["plant"]["binary"], text(&plant), "{name}");
    }
}

#[test]
fn a_recorded_run_is_repeated_with_its_programs_while_they_are_unchanged() {
    let place = Place::new();
    let run = place.recorded();
    let (plant, law) = (text(&place.plant), text(&place.law));
    let which = [
        format!("plant: {plant} (recorded in"),
        format!("controller: {law} (recorded in"),
    ];
    place
        .rerun(&run, "again", &[])
        .expect(0)
        .says(&[&which[0], &which[1]]);
    place.on(&run, &["replay"]).expect(0);
    place.on(&run, &["judge"]).expect(0);

    // Programs may ignore data after their end; their hash does not.
    let mut rebuilt = std::fs::read(&place.plant).expect("it is there");
    rebuilt.push(0);
    std::fs::remove_file(&place.plant).expect("it is ours");
    std::fs::write(&place.plant, rebuilt).expect("it is ours");
    mode(&place.plant, 0o755);
    let hash = run.summary()["plant"]["blake3"]
        .as_str()
        .expect("a hash")
        .to_owned();
    place.rerun(&run, "never", &[]).expect(2).says(&[
        "is no longer the plant program that was recorded in",
        &hash,
        "--plant-bin",
    ]);
    assert!(!place.rig.path("never").exists());
    place
        .rerun(&run, "rebuilt", &["--plant-bin", plant])
        .expect(0)
        .says(&["is not the binary of the recorded run", &hash]);
    // The controller is still the same.
    place.on(&run, &["replay"]).expect(0);
    std::fs::remove_file(&place.law).expect("it is ours");
    let gone = ["No such file", "--controller-bin"];
    place.on(&run, &["replay"]).expect(2).says(&gone);
}

#[test]
fn a_run_is_resumed_with_the_programs_of_its_checkpoint() {
    let rig = Rig::new();
    let (plant, own) = (rig.path("plant"), example("own-plant"));
    std::fs::copy(own, &plant).expect("copied");
    let still = "--set plant.parameters.initial_angle_rad=1e-3";
    let text = naming("\"plant\"", "\"none\"").replace("program = \"none\"\n", "");
    let text = text.replace("law = \"state-feedback\"", "law = \"hold\"");
    let text = text.replace("[controller.state-feedback]\nangle_nm_per_rad = 9.0\n", "");
    let scenario = rig.write(
        "hold.toml",
        &text.replace("duration_s = 3.0", "duration_s = 1.0"),
    );
    let made = format!(
        "{} {still} --set metrics=[] --checkpoint-at 0.1",
        scenario.display()
    );
    let run = rig.run(&made).expect(0);
    let from = format!("--from {}", run.folder.join("checkpoint-100").display());
    let resumed = rig.run(&from).expect(0).says(&["/plant (recorded in"]);
    assert_eq!(resumed.digest(), run.digest());
}

#[test]
fn a_foreign_recording_runs_no_program_without_a_flag() {
    let place = Place::new();
    let run = place.recorded();
    // Another user or another machine has another key.
    std::fs::rename(place.rig.path("state"), place.rig.path("other")).expect("it was made");
    let expected = [
        "was not recorded by this user on this machine",
        "/bin/plant",
        "--plant-bin",
    ];
    place.rerun(&run, "never", &[]).expect(2).says(&expected);
    place.on(&run, &["replay"]).expect(2).says(&[
        "was not recorded by this user on this machine",
        "--controller-bin",
    ]);
    let flags = [
        "--plant-bin",
        text(&place.plant),
        "--controller-bin",
        text(&place.law),
    ];
    place.rerun(&run, "again", &flags).expect(0);
    place.on(&run, &["replay", flags[2], flags[3]]).expect(0);
    place.on(&run, &["judge"]).expect(0);

    let folder = text(&run.folder);
    let theirs = place
        .rig
        .hil(&["scenario", "from", folder])
        .expect(0)
        .stdout;
    assert!(!theirs.contains("\nprogram"), "{theirs}");
    assert!(theirs.contains("# Recorded by another user or elsewhere with the plant program"));
    std::fs::remove_dir_all(place.rig.path("state")).expect("made for the second run");
    std::fs::rename(place.rig.path("other"), place.rig.path("state")).expect("it is there");
    let ours = place
        .rig
        .hil(&["scenario", "from", folder])
        .expect(0)
        .stdout;
    let named = format!("program = \"{}\"", place.plant.display());
    assert!(ours.contains(&named), "{ours}");
}

#[test]
fn an_unusable_key_is_reported_and_a_missing_program_must_be_built() {
    let place = Place::new();
    let run = place.recorded();
    mode(&place.rig.path("state/hil/key"), 0o644);
    let expected = [
        "cannot determine whether",
        "can be read by others",
        "--plant-bin",
    ];
    place.rerun(&run, "never", &[]).expect(2).says(&expected);
    mode(&place.rig.path("state/hil/key"), 0o600);
    std::fs::remove_file(&place.plant).expect("it is ours");
    let refused = place.run("").expect(2);
    assert!(!refused.stderr.contains("spelling"), "{}", refused.stderr);
    refused.says(&[
        "it does not exist; build it",
        "choose a program with --plant-bin PATH",
    ]);
}

#[test]
fn setting_a_program_has_no_effect_without_one_in_the_scenario_and_is_refused() {
    let place = Place::new();
    let run = place.recorded();
    for (key, flag) in [
        ("plant.program", "--plant-bin PATH"),
        ("controller.program.x86_64", "--controller-bin PATH"),
    ] {
        let set = format!("{key}=/bin/true");
        let refused = place.rerun(&run, "never", &["--set", &set]).expect(2);
        refused.says(&["has no effect", key, flag]);
    }
    assert!(!place.rig.path("never").exists());
    let set = [
        "controller",
        "swap",
        "--set",
        "controller.program=/bin/true",
    ];
    let refused = place.rig.hil(&set).expect(2);
    refused.says(&["has no effect", "--bin PATH"]);
}

#[test]
fn only_runs_with_user_programs_are_sealed() {
    let rig = Rig::new();
    let run = rig.run("scenarios/spring-mass.toml").expect(0);
    assert!(!rig.path("state").exists());
    let facts = &Recording::open(&run.recording()).metadata()["hil.run"];
    for name in ["programs_seal", "plant_binary", "controller_binary"] {
        assert!(!facts.contains_key(name), "{name}");
    }
}

#[test]
fn programs_that_others_can_write_are_not_run() {
    let place = Place::new();
    let folder = place.rig.path("bin");
    let rig = place.rig.path("");
    for (path, open, own) in [
        (&place.scenario, 0o666, 0o644),
        (&place.plant, 0o757, 0o755),
        (&place.law, 0o777, 0o755),
        (&folder, 0o777, 0o755),
        (&rig, 0o777, 0o700),
    ] {
        mode(path, open);
        let refused = place.run("").expect(2);
        refused.says(&["which is not run", "can be written by others", "-bin PATH"]);
        mode(path, own);
    }
    // The command line is the user's own responsibility.
    mode(&place.plant, 0o777);
    let flags = format!("--plant-bin {}", place.plant.display());
    let run = place.run(&flags).expect(0);
    place
        .rerun(&run, "never", &[])
        .expect(2)
        .says(&["can be written by others"]);
    mode(&place.plant, 0o4755);
    place.run("").expect(2).says(&["setuid"]);
    place.recorded_refusals();
}

impl Place {
    /// Checks files that are not programs.
    fn recorded_refusals(&self) {
        for (named, expected) in [
            ("\"bin\"", "is a folder"),
            ("\"bin/none\"", "it does not exist"),
            ("\"/dev/null\"", "/dev/null"),
            ("{ pdp11 = \"x\" }", "no program for this machine"),
        ] {
            let scenario = self.rig.write("none.toml", &naming("\"/bin/true\"", named));
            let text = text(&scenario).to_owned();
            self.rig
                .run(&format!(
                    "{text} --plant-bin {}",
                    example("own-plant").display()
                ))
                .expect(2)
                .says(&[expected, "--controller-bin PATH"]);
        }
    }
}

#[test]
fn advice_names_only_unused_options_of_the_command() {
    let place = Place::new();
    let run = place.recorded();
    let advice = |run: Run, message: &str| {
        let output = run.expect(2).says(&[message]).stderr;
        for flag in ["--plant-bin", "--controller-bin", "--bin "] {
            assert!(message.contains(flag) || !output.contains(flag), "{output}");
        }
    };
    let plant = format!("--plant-bin {}", place.plant.display());
    advice(
        place
            .rig
            .run(&format!("scenarios/spring-mass.toml {plant}")),
        &format!(
            "these are the plants of {} (--plant-bin)",
            place.plant.display()
        ),
    );
    advice(
        place.run("--set plant.model=x"),
        &format!(
            "these are the plants of {} (plant.program of",
            place.plant.display()
        ),
    );
    advice(
        place.on(
            &run,
            &["judge", "--requirements", "scenarios/severe-leakage.toml"],
        ),
        "these are the laws of the run's own controller program",
    );
    let running = place.rig.held();
    let at = ["--session", place.rig.session()];
    let swap = |arguments: &[&str]| {
        place
            .rig
            .beside(&[&["controller", "swap"], arguments, &at].concat())
    };
    advice(
        swap(&["--set", "controller.law=x"]),
        "name the program with --bin PATH",
    );
    advice(
        swap(&["--bin", text(&place.law), "--set", "controller.law=x"]),
        &format!("these are the laws of {} (--bin)", place.law.display()),
    );
    running.signal(Signal::INT);
    running.finish().expect(130);
}

#[test]
fn several_sessions_are_distinguished_by_scenario_age_and_folder() {
    let place = Place::new();
    let running = place.rig.held();
    let (name, folder) = (place.rig.session(), place.rig.path("beside"));
    let other = format!("{name}-b");
    let arguments = [
        "run",
        text(&place.scenario),
        "--pause-at",
        "0.5",
        "--wait-limit",
        "60",
    ];
    let at = ["--session", &other, "--out", text(&folder)];
    let beside = place.rig.start_hil(&[&arguments[..], &at].concat());
    let describe = |name: &str, scenario: &str| format!("`{name}` with {scenario} for ");
    until("both are told", || {
        let request = place.rig.beside(&["pause"]);
        let all = [
            describe(name, "spring-mass"),
            describe(&other, "pendulum"),
            format!(" in {}", folder.display()),
        ];
        // Other tests may have running sessions.
        request.code == Some(2) && all.iter().all(|one| request.stderr.contains(one))
    });
    beside.signal(Signal::INT);
    beside.finish_beside_another();
    running.signal(Signal::INT);
    running.finish().expect(130);
}

#[test]
fn hold_fits_every_plant_even_with_a_user_controller() {
    let place = Place::new();
    let run = place.run("--set controller.law=hold --set controller.hold.value=0.5 --set plant.parameters.initial_angle_rad=0");
    let summary = run.expect(1).summary();
    assert!(
        summary["reason"]
            .as_str()
            .is_some_and(|why| why.contains("angle_rad")),
        "{summary}"
    );
    let listed = place.run("--set controller.law=holt").expect(2);
    listed.says(&["`hold`", "`state-feedback`"]);
}

#[test]
fn a_lost_controller_is_not_restarted_from_another_file() {
    let rig = Rig::new();
    let law = rig.path("law");
    std::fs::copy(program("controller-process"), &law).expect("copied");
    let running = rig.start(&format!(
        "scenarios/spring-mass.toml --pace 1 --set run.duration_s=600 --controller-bin {} \
         --set run.on_controller_loss=wait-for-restart",
        law.display()
    ));
    let [_, controller] = running.children_at_once();
    // Before the first step there is no policy for losses.
    until("steps are exchanged", || rig.status().step > 0);
    std::fs::remove_file(&law).expect("it is ours");
    std::fs::copy(program("controller-process"), &law).expect("copied");
    send(controller.pid, Signal::KILL);
    let run = running.finish().expect(3);
    let reason = run.summary()["reason"].to_string();
    let expected = "it cannot be restarted: ";
    assert!(reason.contains(expected), "{reason}");
    assert!(
        reason.contains("was replaced or changed after the check"),
        "{reason}"
    );
}

#[test]
fn a_program_replaced_during_the_run_is_not_started_as_the_old_one() {
    let rig = Rig::new();
    let law = rig.path("law");
    std::fs::copy(program("controller-process"), &law).expect("copied");
    let running = rig.start(&format!(
        "scenarios/spring-mass.toml --pause-at 2.5 --wait-limit 60 --controller-bin {}",
        law.display()
    ));
    let at = ["--session", rig.session()];
    rig.until_held_at(2500);
    let swap = ["controller", "swap", "--set", "controller.law=hold"];
    let swap = |more: &[&str]| rig.beside(&[&swap, more, &at[..]].concat());
    std::fs::remove_file(&law).expect("it is ours");
    let cannot = format!("cannot run {}", law.display());
    let help = "; use --bin PATH for another";
    swap(&[]).expect(2).says(&[&cannot, help]);
    // Programs ignore bytes after their end.
    let own = std::fs::read(program("controller-process")).expect("a program");
    let changed = [&own[..], b"0"].concat();
    std::fs::copy(program("controller-process"), &law).expect("copied");
    std::fs::write(&law, &changed).expect("written");
    let [now, then] = [changed, own].map(|content| blake3::hash(&content).to_hex());
    let expected = format!(
        "its hash was {then} and is now {now}; use --bin {} to accept the new file",
        law.display()
    );
    swap(&[]).expect(2).says(&[&expected]);
    swap(&["--bin", text(&law)]).expect(0);
    // A copy of the original program counts as the same program.
    std::fs::remove_file(&law).expect("it is ours");
    std::fs::copy(program("controller-process"), &law).expect("copied");
    swap(&["--set", "controller.hold.value=2"]).expect(0);
    rig.in_session("resume").expect(0);
    let run = running.finish();
    // Of two that took over at one step, only the later one answered.
    let expected = "(pid, hold (hold.value=2) from 2.5 s on spring-mass";
    assert!(run.stdout.contains(expected), "{}", run.stdout);
    let summary = run.summary();
    let values = ["controller.law=hold", "controller.hold.value=2"];
    assert_eq!(summary["controllers"][2]["set"], serde_json::json!(values));
    let facts = &Recording::open(&run.recording()).metadata()["hil.run"];
    assert_eq!(
        facts["controller_3_set"],
        serde_json::json!(values).to_string()
    );
    assert!(!facts.contains_key("controller_1_set"));
}
