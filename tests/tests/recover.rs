//! No data lost, nothing left behind: the state after a death, on a full disk and of a damaged file, and advice
//! from every command.

use std::path::Path;

use hil_session::session::SessionInfo;
use rustix::process::Signal;
use serde_json::Value;

use crate::bad_input::damages::of_any_file;
use crate::support::harness::{Rig, names, text, until, until_gone};
use crate::support::mcap_reader::{Record, Recording};
use crate::support::programs::{program, workspace};

/// Two actuators for 4 s: 40,000 steps, long enough to be killed and short enough to be repeated.
const RUN: &str = "tests/scenarios/leakage.toml --set run.duration_s=4";
/// Half a second of the teaching plant.
const SMALL: &str = "\
schema = 1
name = \"small\"
[run]
duration_s = 0.5
rate_hz = 1000
[plant]
model = \"spring-mass\"
[controller]
law = \"pid\"
[[stimuli]]
target = \"position_m\"
kind = \"step\"
at_s = 0.1
after = 0.01
";

fn records(path: &Path) -> Vec<Record> {
    let records: Vec<Record> = Recording::open(path).records().collect();
    for (step, record) in (0..).zip(&records) {
        assert_eq!(record.step(), step, "a step is missing");
    }
    records
}

#[test]
fn the_recording_of_a_killed_hil_becomes_a_normal_run() {
    let rig = Rig::new();
    let running = rig.start(RUN);
    let children = running.children();
    running.kill();
    until_gone(&children);
    rig.hil(&["sessions", "--clean"]).expect(0);
    let folder = rig.path("run0");
    let (run, file) = (text(&folder), folder.join("run.mcap"));
    let before = records(&file);
    for command in [
        &["judge", run][..],
        &["compare", run, run],
        &["export", run, "-o", "/dev/null", "--format", "csv"],
        &["scenario", "from", run],
        &["replay", run],
        &["latency", run],
    ] {
        let output = rig.hil(command);
        let message = output.stdout + &output.stderr;
        assert!(message.contains("hil recover "), "{command:?}: {message}");
    }

    let recovered = rig.hil(&["recover", run, "--json"]).expect(0).json();
    assert_eq!(recovered["state"], "broken-off");
    let after = records(&file);
    assert!(after.starts_with(&before));
    assert_eq!(recovered["records"], after.len());
    let recording = Recording::open(&file);
    let digest = recording.digest(|_| ());
    assert_eq!(recovered["digest"], digest);
    let result = &recording.metadata()["hil.result"];
    assert_eq!(result["outcome"], "failed");
    assert_eq!(result["digest"], digest);
    assert!(result["reason"].starts_with("recovered: "), "{result:?}");
    let summary = std::fs::read_to_string(folder.join("summary.json"));
    let summary: Value = serde_json::from_str(&summary.expect("a summary")).expect("JSON");
    assert_eq!(summary["verdict"], "aborted");
    assert_eq!(summary["digest"], digest);
    assert_eq!(summary["recording"]["records"], after.len());
    assert_eq!(summary["session"], rig.session());
    assert_eq!(summary["plant"]["binary"], "plant-process");

    let judged = rig.hil(&["judge", run, "--json"]).expect(1);
    let judgement = judged.json();
    assert_eq!(judgement["metrics"], summary["metrics"]);
    assert_eq!(judgement["outcome"], "failed");
    assert!(!judged.stderr.contains("hil recover"), "{}", judged.stderr);
    rig.hil(&["compare", run, run]).expect(0);
    let table = rig.path("table.csv");
    rig.hil(&["export", run, "-o", text(&table)]).expect(0);
    let lines = std::fs::read_to_string(&table).expect("a table");
    assert_eq!(lines.lines().count(), 1 + after.len());
    rig.hil(&["replay", run]).expect(0);
    let again = rig.rerun(&folder, &["--json"]).expect(0).json();
    assert_eq!(
        (&again["same"], &again["records"]),
        (&true.into(), &after.len().into())
    );

    rig.hil(&["recover", run])
        .expect(0)
        .prints(&["is complete"]);
}

#[test]
fn a_live_recording_is_not_touched() {
    let rig = Rig::new();
    let running = rig.start("scenarios/severe-leakage.toml --set run.duration_s=100");
    running.wait_for_records();
    let folder = rig.path("run0");
    let refused = rig.beside(&["recover", text(&folder)]);
    refused.expect(2).says(&["is still writing", rig.session()]);
    running.signal(Signal::INT);
    let run = running.finish().expect(130);
    assert_eq!(
        run.summary()["recording"]["records"],
        records(&run.recording()).len()
    );
}

#[test]
fn every_completed_step_of_a_killed_plant_is_recorded() {
    let rig = Rig::new();
    let running = rig.start("scenarios/severe-leakage.toml --set run.duration_s=100");
    let [plant, _] = running.children();
    // The recorder is stopped, so that the plant's records stay in its stream.
    running.signal(Signal::STOP);
    let size = || std::fs::metadata(rig.path("run0/run.mcap")).map_or(0, |data| data.len());
    let mut last = 0;
    until("the recorder stands still", || {
        std::mem::replace(&mut last, size()) == size()
    });
    // Far more steps than were left in the stream.
    std::thread::sleep(std::time::Duration::from_millis(100));
    plant.kill();
    running.signal(Signal::CONT);
    let run = running.finish().expect(3);
    let result = records(&run.recording());
    assert_eq!(run.summary()["recording"]["records"], result.len());
    let log = std::fs::read_to_string(run.folder.join("controller.log")).expect("a log");
    let (_, step) = log.split_once("plant is gone at step ").expect("its step");
    let awaited: usize = step.trim().parse().expect("a number");
    // It had answered the previous step; the record of the one before may have been on its way.
    assert!(
        result.len() + 2 >= awaited,
        "{} records, step {awaited} was awaited",
        result.len()
    );
}

#[test]
fn every_answered_step_of_a_killed_controller_is_recorded() {
    let rig = Rig::new();
    let running = rig.start("scenarios/severe-leakage.toml --set run.duration_s=100");
    let [_, controller] = running.children();
    controller.kill();
    let run = running.finish().expect(3);
    let summary = run.summary();
    let result = records(&run.recording());
    assert_eq!(summary["recording"]["records"], result.len());
    assert_eq!(
        summary["steps"],
        result.len(),
        "steps that the plant executed"
    );
    let run = text(&run.folder);
    let judged = rig.hil(&["judge", run, "--json"]).expect(1);
    assert_eq!(judged.json()["records"], result.len());
}

#[test]
fn a_replay_reports_the_death_of_its_controller_in_json_too() {
    let rig = Rig::new();
    let run = rig.run(RUN);
    let run = text(&run.folder).to_owned();
    let replay = rig.start_hil(&["replay", &run, "--json", "--session", rig.session()]);
    let mut controller = None;
    until("the controller is started", || {
        let info = SessionInfo::read(&rig.session_folder());
        controller = info.ok().and_then(|info| info.children.first().copied());
        controller.is_some()
    });
    controller.expect("started").kill();
    let output = replay.finish().expect(3);
    let aborted = output.json();
    assert_eq!(aborted["verdict"], "aborted");
    assert_eq!(aborted["run"], run);
    let reason = aborted["reason"].as_str().expect("a reason");
    assert!(
        reason.contains("controller was killed by SIGKILL"),
        "{reason}"
    );
}

#[test]
fn chunks_are_closed_in_time_however_slow_the_run_is() {
    let rig = Rig::new();
    // 2 s at 50 Hz, a record every 20 ms: far less than would fill a chunk.
    let slow = SMALL.replace("1000", "50").replace("0.5", "2.0");
    let slow = rig.write("slow.toml", &slow);
    let run = rig.run(&format!("{} --clock paced", slow.display()));
    let run = run.expect(0);
    let chunks = Recording::open(&run.recording()).summary().chunk_indexes;
    // One per 100 ms would be 20; a loaded machine may delay the recorder now and then.
    assert!(chunks.len() >= 10, "{} chunks", chunks.len());
}

#[test]
fn a_full_disk_stops_the_run_with_a_readable_file_and_a_summary() {
    let rig = Rig::new();
    // Files of at most 40 MB, in blocks of 512 bytes: enough for shared memory, too little for the run.
    let mut limited = rig.command("sh");
    limited
        .arg("-c")
        .arg("trap '' XFSZ; ulimit -f 80000; exec \"$0\" \"$@\"")
        .arg(program("hil"));
    let long = "scenarios/severe-leakage.toml --set run.duration_s=100 --compression none";
    let run = rig.start_with(limited, long).finish().expect(3);
    let summary = run.summary();
    let reason = summary["reason"].as_str().expect("a reason");
    let path = run.recording();
    for fragment in ["cannot write ", text(&path), "File too large"] {
        assert!(reason.contains(fragment), "{reason}");
    }
    let result = records(&path);
    assert!(result.len() > 10_000, "{} records", result.len());
    assert_eq!(summary["recording"]["kept"], result.len());
    // The digest covers all received records, and both numbers are reported with the reason for their difference.
    let digested = &summary["recording"]["digested"];
    assert_eq!(digested, &summary["recording"]["records"]);
    assert!(digested.as_u64() > summary["recording"]["kept"].as_u64());
    let cut_short = summary["recording"]["cut_short"].as_str();
    assert!(
        cut_short.is_some_and(|why| why.contains("File too large")),
        "{summary:#}"
    );
    let both = format!(
        "of {digested} records, of which the file has {}",
        result.len()
    );
    assert!(run.stdout.contains(&both), "{}", run.stdout);
    assert_eq!(summary["verdict"], "aborted");
    // It has an end, or the reason states how to complete it.
    let recovered = rig.hil(&["recover", text(&run.folder)]).expect(0);
    let was_whole = recovered.stdout.contains("is complete");
    assert_eq!(was_whole, !reason.contains("hil recover "), "{reason}");
    let recording = Recording::open(&path);
    assert_eq!(recording.metadata()["hil.result"]["outcome"], "failed");
    assert_eq!(recording.records().count(), result.len());
}

#[test]
fn remains_of_a_killed_command_are_removed_by_the_next() {
    let rig = Rig::new();
    let run = rig.run(RUN);
    let folder = run.folder;
    let view = text(&folder);
    let unfinished = || {
        let names = names(&folder).into_iter();
        names.filter(|name| name.starts_with('.')).count()
    };
    let table = folder.join("table.csv");
    let export = ["export", view, "-o", text(&table)];
    let exporting = rig.start_hil(&export);
    until("a file is being written", || unfinished() == 1);
    exporting.kill();
    assert_eq!(unfinished(), 1, "nobody was there to remove it");
    rig.hil(&["compare", view, view]).expect(0);
    assert_eq!(unfinished(), 0);
    assert!(!table.exists());
}

#[test]
fn every_command_names_a_damaged_recording() {
    let rig = Rig::new();
    let small = rig.write("small.toml", SMALL);
    let sound = rig.run(&small.display().to_string()).expect(0).folder;
    let sound = text(&sound);
    let broken = rig.path("broken");
    std::fs::create_dir(&broken).expect("made");
    let file = broken.join("run.mcap");
    let (run, path) = (text(&broken), text(&file));
    let made = ["table.csv", "page.html", "l.json", "baselines.toml"].map(|name| rig.path(name));
    let [table, page, layout, baselines] = made.each_ref().map(|path| text(path));
    let update = ["compare", sound, "--baseline", "a", "--update"];
    rig.hil(&[&update[..], &["--baselines", baselines]].concat())
        .expect(0);
    let commands = [
        vec!["judge", run],
        vec!["judge", run, "--json"],
        vec!["compare", sound, run],
        vec!["compare", run, sound],
        vec!["compare", run, "--baseline", "a", "--baselines", baselines],
        vec!["export", run, "-o", table, "--force"],
        vec!["rerun", run, "--no-record"],
        vec!["replay", run],
        vec!["latency", run],
        vec!["scenario", "from", run],
        vec!["recover", run],
        vec!["report", run, "-o", page, "--force"],
        vec!["report", sound, run, "-o", page, "--force", "--json"],
        vec!["layout", run, "foxglove", "-o", layout, "--force"],
        vec!["export", run, "-o", table, "--force", "--format", "parquet"],
    ];
    let bytes = std::fs::read(Path::new(sound).join("run.mcap")).expect("read");
    let made = [
        "attachment-shorter-than-its-sum",
        "text-longer-than-its-record",
    ]
    .map(|name| {
        let path = workspace().join("tests/fuzz/corpus/recording").join(name);
        (name, std::fs::read(path).expect("of the corpus"))
    });
    for (damage, bytes) in of_any_file(&bytes).into_iter().chain(made) {
        for command in &commands {
            std::fs::write(&file, &bytes).expect("written");
            let output = rig.hil(command);
            let about = format!("{damage}: {command:?}: {}{}", output.stdout, output.stderr);
            assert!(!about.contains("panicked"), "{about}");
            assert!(matches!(output.code, Some(0..=3)), "{about}");
            if damage == "half" && !about.contains(" before its first record") {
                // Readable up to the damage.
                let says = about.contains("hil recover ") || command[0] == "recover";
                assert!(says, "{about}");
                continue;
            }
            assert_eq!(output.code, Some(2), "{about}");
            assert!(output.stderr.contains(path), "{about}");
            assert!(output.stderr.contains("error: "), "{about}");
        }
    }
}

#[test]
fn every_other_damaged_file_is_named() {
    let rig = Rig::new();
    let small = rig.write("small.toml", SMALL);
    let run = rig.run(&format!("{} --checkpoint-at 0.2", small.display()));
    let run = run.expect(0);
    let checkpoint = run.folder.join("checkpoint-200");
    let sound = text(&run.folder);
    let baselines = rig.path("baselines.toml");
    let compare = ["compare", sound, "--baseline", "a", "--baselines"];
    let compared = [&compare[..], &[text(&baselines)]].concat();
    rig.hil(&[&compared[..], &["--update"]].concat()).expect(0);
    let scenario = rig.path("scenario.toml");
    std::fs::copy(run.folder.join("scenario.toml"), &scenario).expect("copied");
    let out = rig.path("out");
    let checked = vec!["config", "check", text(&scenario)];
    let gone_on = vec!["run", "--from", text(&checkpoint), "--out", text(&out)];
    for (file, command) in [
        (checkpoint.join("checkpoint.json"), &gone_on),
        (checkpoint.join("plant.state"), &gone_on),
        (checkpoint.join("controller.state"), &gone_on),
        (run.folder.join("run.mcap"), &gone_on),
        (baselines.clone(), &compared),
        (scenario.clone(), &checked),
    ] {
        let sound = std::fs::read(&file).expect("read");
        let mut damages = of_any_file(&sound);
        if file
            .extension()
            .is_some_and(|extension| extension == "toml")
        {
            // Half of its lines may be a valid file too; half of a line is not.
            damages.retain(|(damage, _)| *damage != "half");
            let text = String::from_utf8_lossy(&sound);
            let quote = text.rfind(" = \"").expect("a text") + 4;
            damages.push(("half of a line", sound[..quote].to_vec()));
        }
        for (damage, bytes) in damages {
            std::fs::write(&file, &bytes).expect("written");
            let output = rig.hil(command);
            let about = format!(
                "{}, {damage}: {}{}",
                file.display(),
                output.stdout,
                output.stderr
            );
            assert_eq!(output.code, Some(2), "{about}");
            assert!(!about.contains("panicked"), "{about}");
            let name = file.file_name().and_then(|name| name.to_str());
            assert!(output.stderr.contains(name.expect("text")), "{about}");
            assert!(output.stderr.contains("error: "), "{about}");
        }
        std::fs::write(&file, &sound).expect("written");
    }
}
