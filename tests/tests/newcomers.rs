//! Mistakes of first-time users of `hil`: each is answered with advice.

use std::fs;

use crate::support::harness::{Rig, Run, text};
use crate::support::programs::{program, workspace};

/// Checks that a command line is refused as wrong usage, and that the message has these parts.
fn refused(run: Run, line: &str, parts: &[&str]) {
    let run = run.expect(2);
    for part in parts {
        assert!(run.stderr.contains(part), "{line}: {part}\n{}", run.stderr);
    }
}

#[test]
fn a_run_without_requirements_is_called_completed_and_not_a_pass() {
    const WORDS: &str = "completed, no requirements";
    let rig = Rig::new();
    let scenario = rig.scenario(0.1, "spring-mass", "hold");
    let markdown = rig.path("verdicts.md");
    let line = format!("{} --markdown {}", scenario.display(), markdown.display());
    let run = rig.run(&line).expect(0);
    assert!(
        run.stdout.starts_with(&format!("small: {WORDS}  (")),
        "{}",
        run.stdout
    );
    let markdown = fs::read_to_string(markdown).expect("written");
    assert!(
        markdown.contains(&format!("0 of 1 runs pass; 1 {WORDS}")),
        "{markdown}"
    );
    assert!(markdown.contains(&format!("| **{WORDS}** |")), "{markdown}");
    let summary = fs::read_to_string(run.folder.join("summary.json")).expect("written");
    let summary: serde_json::Value = serde_json::from_str(&summary).expect("JSON");
    assert_eq!(summary["verdict"], "pass");

    let folder = run.folder.to_str().expect("plain");
    let judged = rig.hil(&["judge", folder]).expect(0);
    assert!(
        judged.stdout.contains(&format!("small: {WORDS}  (")),
        "{}",
        judged.stdout
    );
    let runs = rig
        .hil(&["runs", rig.path("").to_str().expect("plain")])
        .expect(0);
    assert!(runs.stdout.contains(WORDS), "{}", runs.stdout);
    let page = rig.path("page.html");
    rig.hil(&["report", folder, "-o", page.to_str().expect("plain")])
        .expect(0);
    let page = fs::read_to_string(page).expect("written");
    assert!(
        page.contains(&format!("data-verdict=\"{WORDS}\">{WORDS}<")),
        "no badge"
    );

    let repeated = ["run", "scenario.toml", "--repeat", "2"];
    let table = rig.hil_in(&rig.path(""), &repeated).expect(0);
    let count = format!("2 runs: 2 {WORDS}");
    assert!(table.stdout.contains(&count), "{}", table.stdout);
}

#[test]
fn a_file_of_the_wrong_kind_is_answered_with_the_commands_that_accept_it() {
    const SCENARIO: &str = "scenarios/spring-mass.toml";
    const STUDY: &str = "studies/spring-mass.toml";
    let rig = Rig::new();
    let hil = program("hil");
    let hil = hil.to_str().expect("plain");
    let run = rig.path("run");
    rig.hil(&["run", SCENARIO, "--link", "in-process", "--out", text(&run)])
        .expect(0);
    let summary = run.join("summary.json");
    let summary = text(&summary);
    let campaign = rig.path("campaign");
    rig.hil(&["campaign", "plan", STUDY, "-o", text(&campaign)])
        .expect(0);
    let campaign = text(&campaign);
    #[rustfmt::skip] // a table
    let cases: [(&[&str], [&str; 2]); 21] = [
        (&["run", "run.mcap"], ["run.mcap is a recording and not a scenario", "`hil report`"]),
        (&["run", STUDY], ["is a study and not a scenario", "`hil campaign plan`"]),
        (&["config", "check", STUDY], ["is a study and not a scenario", "`hil campaign check`"]),
        (&["campaign", "plan", SCENARIO], ["is a scenario and not a study", "`hil run`"]),
        (&["campaign", "check", SCENARIO], ["is a scenario and not a study", "`hil config check`"]),
        (&["describe", SCENARIO], ["is a scenario and not a program or an FMU or a port file", "`hil config show`"]),
        (&["judge", SCENARIO], ["is a scenario and not a recording", "`hil run`"]),
        (&["report", STUDY], ["is a study and not a recording or the folder of a campaign", "`hil campaign plan`"]),
        (&["run", summary], ["is the summary of a run and not a scenario", "its folder is a run"]),
        (&["report", summary], ["is the summary of a run and not a recording", "`hil report`"]),
        (&["compare", SCENARIO, SCENARIO], ["is a scenario and not a recording", "`hil run`"]),
        (&["recover", SCENARIO], ["is a scenario and not a recording", "`hil run`"]),
        (&["recover", campaign], ["is the folder of a campaign and not a recording", "`hil campaign show`"]),
        (&["run", "--from", SCENARIO], ["is a scenario and not a recording", "`hil run`"]),
        (&["run", "--from", STUDY], ["is a study and not a recording", "`hil campaign plan`"]),
        (&["latency", SCENARIO], ["is a scenario and not a recording", "`hil run`"]),
        (&["campaign", "status", SCENARIO], ["is a scenario and not the folder of a campaign", "`hil run`"]),
        (&["campaign", "status", STUDY], ["is a study and not the folder of a campaign", "`hil campaign plan`"]),
        (&["campaign", "compare", campaign, STUDY], ["is a study and not the folder of a campaign", "`hil campaign plan`"]),
        (&["run", "examples/ports/lines.port.toml"], ["is a port file and not a scenario", "`hil describe` takes a port file"]),
        (&["run", hil], ["is a program and not a scenario", "`hil describe`"]),
    ];
    for (words, parts) in cases {
        refused(rig.hil(words), &words.join(" "), &parts);
    }
}

#[test]
fn a_folder_that_was_deleted_is_named_as_the_reason() {
    let rig = Rig::new();
    let mut command = rig.command("sh");
    let folder = rig.path("gone");
    fs::create_dir(&folder).expect("a folder");
    let script = "cd \"$2\" && rmdir \"$2\" && exec \"$1\" run x.toml";
    command.args(["-c", script, "sh"]);
    command.args([program("hil"), folder]);
    let run = rig.program(command);
    refused(
        run,
        "in a folder that is gone",
        &["the current folder was deleted"],
    );
}

#[test]
fn too_many_open_files_are_not_answered_with_a_build() {
    let rig = Rig::new();
    let mut command = rig.command("sh");
    let script = "ulimit -n 12 && exec \"$1\" run \"$2\"";
    command.args(["-c", script, "sh"]);
    command.args([
        program("hil"),
        workspace().join("scenarios/spring-mass.toml"),
    ]);
    let run = rig.program(command);
    assert!(run.stderr.contains("`ulimit -n 4096`"), "{}", run.stderr);
    assert!(!run.stderr.contains("cargo build"), "{}", run.stderr);
}

#[test]
fn hil_without_its_programs_names_the_expected_location_and_a_remedy() {
    let rig = Rig::new();
    let alone = rig.path("hil");
    fs::copy(program("hil"), &alone).expect("copied");
    let mut command = rig.command(&alone);
    command
        .args(["run", "scenarios/spring-mass.toml"])
        .current_dir(workspace());
    command
        .env_remove("HIL_CONTROLLER_BIN")
        .env_remove("HIL_PLANT_BIN");
    let place = rig.path("controller-process").display().to_string();
    let parts = [
        "no controller program is named, and there is none next to hil",
        &place,
        "`cargo build --release`",
        "--controller-bin PATH or HIL_CONTROLLER_BIN",
    ];
    let run = rig.program(command);
    assert!(
        !run.stderr.contains("relative to the current folder"),
        "{}",
        run.stderr
    );
    refused(run, "run", &parts);
}

#[test]
fn a_program_that_cargo_built_elsewhere_is_found_there() {
    let rig = Rig::new();
    let text = |program: &str| {
        format!(
            "schema = 1\nname = \"own\"\n[run]\nduration_s = 0.1\nrate_hz = 1000\n\
             [plant]\nmodel = \"spring-mass\"\nprogram = \"target/release/{program}\"\n\
             [controller]\nlaw = \"hold\"\n"
        )
    };
    let scenario = rig.write("own.toml", &text("own"));
    let folder = rig.path("shared folder");
    fs::create_dir_all(folder.join("release")).expect("made");
    let built = folder.join("release/own");
    fs::copy(program("plant-process"), &built).expect("copied");
    let run = || {
        let mut hil = rig.command(program("hil"));
        hil.env("CARGO_TARGET_DIR", &folder)
            .env_remove("HIL_PLANT_BIN");
        rig.start_with(hil, &format!("{} --no-record", scenario.display()))
            .finish()
    };
    // Without a package beside it, `target` is an ordinary folder.
    refused(
        run(),
        "no package",
        &[
            "target/release/own",
            "paths in a scenario are relative to its folder",
        ],
    );
    rig.write("Cargo.toml", "");
    run().expect(0);
    fs::remove_file(&built).expect("removed");
    let place = built.display().to_string();
    refused(
        run(),
        "nothing built",
        &[
            "target/release/own",
            &place,
            "where CARGO_TARGET_DIR points",
        ],
    );
}

#[test]
fn a_missing_scenario_of_a_study_is_answered_with_its_folder() {
    let rig = Rig::new();
    fs::create_dir(rig.path("sub")).expect("made");
    rig.write(
        "sub/study.toml",
        "schema = 1\nscenario = \"nope.toml\"\ncases = 3\nseed = 1\n",
    );
    let run = rig.hil_in(&rig.path(""), &["campaign", "check", "sub/study.toml"]);
    assert!(
        !run.stderr.contains("relative to the current folder"),
        "{}",
        run.stderr
    );
    let path = rig.path("sub/nope.toml").canonicalize();
    assert!(path.is_err());
    let parts = [
        "the scenario cannot be read: it does not exist",
        "sub/study.toml:2:12",
        "paths in a study are relative to the folder of the study, /",
        "/sub/nope.toml",
    ];
    refused(run, "campaign check", &parts);
}

#[test]
fn a_built_in_plant_or_law_is_described_by_its_name() {
    let rig = Rig::new();
    let text = rig.hil(&["describe", "drhas"]).expect(0).stdout;
    for part in [
        "plant drhas: Dual",
        "actuator1_valve_current_a",
        "surface_angle_rad",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert!(!text.contains("plant spring-mass"), "{text}");
    let laws = rig.hil(&["describe", "pid", "--json"]).expect(0).json();
    let laws = laws["description"]["laws"].as_array().expect("a list");
    let plants: Vec<&str> = laws
        .iter()
        .filter_map(|law| law["plants"][0].as_str())
        .collect();
    assert_eq!(plants, ["drhas", "spring-mass"]);
    rig.hil(&["describe", "drhass"]).expect(2).says(&[
        "neither a file `drhass` nor a plant or a law of that name; there are `drhas`, `ftsc`",
    ]);
}
