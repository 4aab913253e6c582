//! Failures during a run: side, cause and step are named, the exit code gives the kind, the recording up to then is
//! readable, and nothing is left behind.

mod long;
mod remains;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use rustix::process::Signal;

use crate::support::harness::{EXPIRES_S, Rig, Run, send, until, until_gone};
use crate::support::mcap_reader::{Record, Recording};
use crate::support::programs::{misbehaving_controller, misbehaving_plant, program};

/// Twenty seconds of the hydraulic system: long enough to be interrupted. Kills and stops need an active run, not a
/// short one.
const LONG: &str = "scenarios/severe-leakage.toml --set run.duration_s=100";

const PLANT: usize = 0;

const CONTROLLER: usize = 1;

/// Aborted run: exit code, reason, and a readable recording without a gap.
struct Aborted {
    reason: String,
    records: Vec<Record>,
    recording: Recording,
}

impl Aborted {
    #[track_caller]
    fn of(run: Run, code: i32, fragments: &[&str]) -> Self {
        let run = run.expect(code);
        let summary = run.summary();
        assert_eq!(summary["verdict"], "aborted");
        let reason = summary["reason"].as_str().expect("a reason").to_owned();
        for fragment in fragments {
            assert!(
                reason.contains(fragment),
                "`{fragment}` is not in `{reason}`"
            );
        }
        let recording = Recording::open(&run.recording());
        let metadata = recording.metadata();
        let records: Vec<Record> = recording.records().collect();
        for (step, record) in (0..).zip(&records) {
            assert_eq!(record.step(), step);
        }
        assert!(records.len() > 1);
        assert_eq!(summary["recording"]["records"], records.len());
        assert_eq!(metadata["hil.result"]["records"], records.len().to_string());
        Self {
            reason,
            records,
            recording,
        }
    }

    /// Returns the number after the word `step` in the reason.
    fn step(&self) -> u64 {
        let (_, after) = self.reason.split_once("step ").expect("a step is named");
        let digits = after.split(|c: char| !c.is_ascii_digit()).next();
        let step = digits.expect("there is always a part").parse();
        step.unwrap_or_else(|_| panic!("no step in `{}`", self.reason))
    }

    /// Fails if a signal of any record is NaN or infinite.
    fn assert_only_numbers(&self) {
        let signals = self.recording.columns.iter().enumerate();
        for (place, name) in signals.filter(|(_, name)| name.contains('.')) {
            for record in &self.records {
                let value = f64::from_bits(record.words[place]);
                assert!(value.is_finite(), "{name} at step {}", record.step());
            }
        }
    }
}

#[track_caller]
fn after_signal(side: usize, signal: Signal, fragments: &[&str]) -> Aborted {
    let rig = Rig::new();
    let running = rig.start(&format!("{LONG} --wait-limit {EXPIRES_S}"));
    let child = running.children()[side];
    send(child.pid, signal);
    Aborted::of(running.finish(), 3, fragments)
}

#[test]
fn a_killed_plant_is_named() {
    after_signal(PLANT, Signal::KILL, &["plant was killed by SIGKILL"]);
}

#[test]
fn a_killed_controller_is_named_with_the_step_it_did_not_answer() {
    let fragments = ["controller", "step ", "killed by SIGKILL"];
    let aborted = after_signal(CONTROLLER, Signal::KILL, &fragments);
    assert_eq!(aborted.step(), aborted.records.len() as u64);
}

#[test]
fn a_stopped_plant_is_named() {
    after_signal(PLANT, Signal::STOP, &["plant was stopped"]);
}

#[test]
fn a_stopped_controller_is_named_with_the_step_it_did_not_answer() {
    let fragments = ["controller did not answer step ", "controller was stopped"];
    let aborted = after_signal(CONTROLLER, Signal::STOP, &fragments);
    assert_eq!(aborted.step(), aborted.records.len() as u64);
}

#[test]
fn a_stopped_hil_ends_the_run_with_every_clock() {
    // So slow that the recorder's buffer would last for minutes, and that no run ends by itself.
    for (clock, rate_hz) in [("lockstep", 10_000), ("paced", 50), ("realtime", 50)] {
        let rig = Rig::new();
        let running = rig.start(&format!(
            "scenarios/spring-mass.toml --set run.duration_s=1e5 --set run.rate_hz={rate_hz} \
             --set metrics=[] --set requirements=[] --clock {clock} --wait-limit {EXPIRES_S}"
        ));
        let children = running.children_at_once();
        let mut sizes = BTreeSet::new();
        until("records reach the file", || {
            let recording = std::fs::metadata(rig.path("run0/run.mcap"));
            sizes.insert(recording.map_or(0, |data| data.len()));
            sizes.len() > 4
        });
        running.signal(Signal::STOP);
        until_gone(&children);
        running.signal(Signal::CONT);
        let summary = running.finish().expect(3).summary();
        let reason = summary["reason"].as_str().expect("a reason");
        let stuck = "the recorder took no record within the wait limit";
        assert!(reason.contains(stuck), "{clock}: {reason}");
    }
}

/// Runs a law of the misbehaving controller on the teaching plant; each misbehaves at step 100.
fn misbehaves(rig: &Rig, law: &str) -> Run {
    misbehaves_as(rig, law, &misbehaving_controller())
}

fn misbehaves_as(rig: &Rig, law: &str, controller: &Path) -> Run {
    let scenario = rig.scenario(1.0, "spring-mass", law);
    let (scenario, controller) = (scenario.display(), controller.display());
    let wait_limit_s = wait_limit_s(law);
    rig.run(&format!(
        "{scenario} --controller-bin {controller} --wait-limit {wait_limit_s}"
    ))
}

/// Returns the wait limit: only a sleeping side is detected by waiting; a busy machine is slow to allocate memory.
fn wait_limit_s(deed: &str) -> f64 {
    if deed == "sleeps" { EXPIRES_S } else { 30.0 }
}

#[test]
fn a_controller_that_leaves_early_is_named_with_the_step() {
    let rig = Rig::new();
    let run = misbehaves(&rig, "leaves");
    let aborted = Aborted::of(run, 3, &["controller", "step 100"]);
    assert_eq!(aborted.records.len(), 100);
}

#[test]
fn the_message_of_a_controller_that_panics_is_shown_and_kept() {
    let rig = Rig::new();
    let run = misbehaves(&rig, "panics").says(&["the law fell over"]);
    let log = std::fs::read_to_string(run.folder.join("controller.log")).expect("a log");
    assert!(log.contains("the law fell over"), "{log}");
    let aborted = Aborted::of(run, 3, &["controller", "step 100", "panicked"]);
    assert_eq!(aborted.records.len(), 100);
}

/// Fails if output or files of a run contain terminal control characters.
#[track_caller]
fn assert_shows_only_text(run: &Run) {
    let summary = std::fs::read_to_string(run.folder.join("summary.json")).expect("a summary");
    for text in [&run.stdout, &run.stderr, &summary] {
        let obeyed = text
            .chars()
            .find(|c| c.is_control() && !matches!(c, '\n' | '\t'));
        assert_eq!(obeyed, None, "{text:?}");
    }
}

#[test]
fn output_of_a_side_cannot_control_the_terminal() {
    let rig = Rig::new();
    let run = misbehaves(&rig, "mutters").says(&["muttered"]);
    assert_shows_only_text(&run);
    Aborted::of(run, 3, &["controller", "step 100"]);
    let run = plant_misbehaves(&rig, "mutters").says(&["muttered"]);
    assert_shows_only_text(&run);
    Aborted::of(run, 3, &["plant ended with exit code 7", "muttered"]);
}

#[test]
fn an_answer_without_end_is_refused() {
    let rig = Rig::new();
    let scenario = "scenarios/spring-mass.toml";
    let endless = rig.script("endless", "#!/bin/sh\nexec yes\n");
    let run = rig.run(&format!(
        "{scenario} --controller-bin {}",
        endless.display()
    ));
    run.expect(2).says(&["the answer is longer than 16 MiB"]);
    // Error output may be endless too; only the answer matters.
    let own = program("controller-process");
    let text = format!(
        "#!/bin/sh\nyes complaint | head -c 100000000 >&2\nexec '{}' \"$@\"\n",
        own.display()
    );
    let loud = rig.script("loud", &text);
    rig.run(&format!("{scenario} --controller-bin {}", loud.display()))
        .expect(0);
}

#[test]
fn a_controller_that_never_answers_again_is_named_with_the_step() {
    let rig = Rig::new();
    let run = misbehaves(&rig, "sleeps");
    let fragments = ["controller did not answer step 100", "stuck"];
    assert_eq!(Aborted::of(run, 3, &fragments).records.len(), 100);
}

/// Runs a misbehaving plant; each misbehaves at the end of its hundredth step.
fn plant_misbehaves(rig: &Rig, model: &str) -> Run {
    let scenario = rig.scenario(1.0, model, "hold");
    let plant = poor(rig, &misbehaving_plant());
    let (scenario, plant) = (scenario.display(), plant.display());
    let wait_limit_s = wait_limit_s(model);
    rig.run(&format!(
        "{scenario} --plant-bin {plant} --wait-limit {wait_limit_s}"
    ))
}

/// Returns a script that runs the same program with little memory.
fn poor(rig: &Rig, program: &Path) -> PathBuf {
    let program = program.display();
    let script = format!("#!/bin/sh\nulimit -v 2000000\nexec '{program}' \"$@\"\n");
    rig.script("poor", &script)
}

#[test]
fn a_plant_that_exits_early_is_named_and_its_records_are_kept() {
    for (model, reason) in [
        ("leaves", "plant ended before the run was over"),
        ("panics", "plant panicked"),
        ("sleeps", "plant was stuck"),
        ("hoards", "plant was killed by SIGABRT"),
    ] {
        let rig = Rig::new();
        let aborted = Aborted::of(plant_misbehaves(&rig, model), 3, &[reason]);
        // The record of the hundredth step would come with the next one, which never comes.
        assert_eq!(aborted.records.len(), 99, "{model}");
    }
}

#[test]
fn a_controller_without_memory_is_named_with_the_step() {
    let rig = Rig::new();
    let controller = poor(&rig, &misbehaving_controller());
    let run = misbehaves_as(&rig, "hoards", &controller);
    let aborted = Aborted::of(run, 3, &["step 100", "controller was killed by SIGABRT"]);
    assert_eq!(aborted.records.len(), 100);
}

#[test]
fn a_nan_command_is_refused_by_name() {
    let rig = Rig::new();
    let run = misbehaves(&rig, "babbles");
    let aborted = Aborted::of(run, 3, &["controller", "step 100", "force_n"]);
    assert_eq!(aborted.records.len(), 100);
    aborted.assert_only_numbers();
}

#[test]
fn a_plant_outside_its_range_has_diverged() {
    let rig = Rig::new();
    let run = misbehaves(&rig, "pushes");
    let aborted = Aborted::of(run, 1, &["diverged", "_m"]);
    // 1e12 m/s2 on 1 kg carries it beyond 1e6 m/s and, at 5e5 m, not yet beyond 1e6 m in a step.
    assert!(
        aborted.reason.contains("velocity_mps"),
        "{}",
        aborted.reason
    );
    assert_eq!(aborted.step(), 101);
    aborted.assert_only_numbers();
}

#[test]
fn an_unstable_loop_ends_as_diverged_and_never_records_nan() {
    for (changes, signal) in [
        (
            "scenarios/spring-mass.toml --set controller.pid.proportional_n_per_m=-1e5",
            "mps",
        ),
        (
            "scenarios/slight-leakage.toml --set controller.law=pid --set controller.pid.proportional_a_per_m=-1e3",
            "position_m",
        ),
    ] {
        let rig = Rig::new();
        let aborted = Aborted::of(rig.run(changes), 1, &["diverged", signal]);
        aborted.assert_only_numbers();
    }
}

#[test]
fn truncated_shared_memory_is_named_and_nothing_is_left() {
    let rig = Rig::new();
    let (junit, markdown) = (rig.path("all.xml"), rig.path("all.md"));
    let running = rig.start(&format!(
        "scenarios/spring-mass.toml --pause-at 2.5 --wait-limit 60 --junit {} --markdown {}",
        junit.display(),
        markdown.display()
    ));
    rig.until_held_at(2500);
    let session = hil_session::session::SessionInfo::read(&rig.session_folder());
    let session = session.expect("it runs");
    // The recorder's stream: both sides are stopped, and `hil` alone reads it.
    let maps = std::fs::read_to_string(format!("/proc/{}/maps", session.owner.pid));
    let maps = maps.expect("it runs");
    let mapped = |path: &PathBuf| maps.contains(path.to_str().expect("plain text"));
    let segments: Vec<PathBuf> = session.segments().into_iter().filter(mapped).collect();
    assert!(!segments.is_empty());
    for segment in segments {
        // The session may end at the first damage.
        if let Ok(file) = std::fs::File::options().write(true).open(segment) {
            file.set_len(0).expect("our own");
        }
    }
    let run = running.finish().expect(3);
    // The plant may have met the damage first.
    let reason = run.summary()["reason"].to_string();
    assert!(reason.contains("SIGBUS"), "{reason}");
    let output = run.stderr + &run.stdout;
    assert!(output.contains("SIGBUS"), "{output}");
    for file in [junit, markdown] {
        let text = std::fs::read_to_string(&file).expect("written");
        assert!(text.contains("SIGBUS"), "{}: {text}", file.display());
    }
}

#[test]
fn too_few_open_files_are_reported_with_a_remedy() {
    let rig = Rig::new();
    let hil = program("hil");
    let limited = |limit: &str| {
        let mut shell = rig.command("sh");
        shell.args(["-c", &format!("ulimit {limit} && exec \"$0\" \"$@\"")]);
        shell.arg(&hil);
        rig.start_with(shell, "scenarios/spring-mass.toml").finish()
    };
    let run = limited("-n 40").expect(3);
    run.says(&["40 files may be open at once", "`ulimit -n 256`"]);
    // `hil` may raise the soft limit.
    limited("-Sn 40").expect(0);
}

#[test]
fn a_scenario_limit_ends_the_run_at_the_first_step_beyond_it() {
    let rig = Rig::new();
    let limited = "scenarios/spring-mass.toml --set plant.limits.position_m=[-1.0,0.005]";
    let aborted = Aborted::of(rig.run(limited), 1, &["diverged", "position_m"]);
    let (last, before) = aborted.records.split_last().expect("records");
    let position_m = |record: &Record| aborted.recording.value(record, "truth.position_m");
    assert!(position_m(last) > 0.005);
    assert!(before.iter().all(|record| position_m(record) <= 0.005));
    assert_eq!(last.step(), aborted.step());
}
