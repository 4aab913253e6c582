//! Deaths and stops at random moments, and long runs under random faults. `.ci/run long`.

use std::path::Path;
use std::time::Duration;

use hil_recording::reader::RunReader;
use hil_session::process::ProcessId;
use hil_session::session::SessionInfo;
use rustix::process::Signal;
use shared_types::random::RandomStream;

use crate::support::harness::{Rig, Running, send, until, until_gone};

/// A small run of a minute, which no test waits for.
const SMALL: &str = "schema = 1\nname = \"small\"\n[run]\nduration_s = 60.0\nrate_hz = 10000\n\
    [plant]\nmodel = \"spring-mass\"\n[controller]\nlaw = \"pid\"\n\
    [[stimuli]]\ntarget = \"position_m\"\nkind = \"sine\"\namplitude = 0.01\nfrequency_hz = 0.5\n";

/// Wait limit in s for a stopped process.
const WAIT_LIMIT_S: f64 = 0.3;
const CLOCKS: [&str; 3] = ["lockstep", "paced", "realtime"];
const VICTIMS: [&str; 3] = ["plant", "controller", "hil"];

/// A number below a bound.
fn below(random: &mut RandomStream, bound: u64) -> usize {
    (random.uniform() * bound as f64) as usize
}

#[test]
#[ignore = "long: .ci/run long"]
fn whoever_dies_or_stops_at_a_random_moment_nothing_hangs_and_no_completed_step_is_lost() {
    let undisturbed = Rig::new();
    let scenario = undisturbed.write("small.toml", SMALL);
    let scenario = scenario.to_str().expect("plain text");
    // In one process: the same records, and soon there on a busy machine.
    let whole = undisturbed.run(&format!("{scenario} --link in-process"));
    let whole = whole.expect(0).recording();
    for number in 0..300 {
        let mut random = RandomStream::new(number, "deaths");
        let clock = CLOCKS[below(&mut random, 3)];
        let victim = VICTIMS[below(&mut random, 3)];
        // Of ten processes, six are killed, three abort, as one without memory does, and one is stopped.
        let signal = match below(&mut random, 10) {
            0..6 => Signal::KILL,
            6..9 => Signal::ABORT,
            _ => Signal::STOP,
        };
        let longest_us = if victim == "hil" { 400_000 } else { 60_000 };
        let moment = Duration::from_micros(below(&mut random, longest_us) as u64);
        println!("{number}: {victim} {signal:?} in {clock} after {moment:?}"); // shown if the test fails
        let rig = Rig::new();
        let rate = if clock == "realtime" {
            "--set run.rate_hz=1000"
        } else {
            ""
        };
        let running = rig.start(&format!(
            "{scenario} {rate} --clock {clock} --wait-limit {WAIT_LIMIT_S}"
        ));
        let is_struck = strike(&rig, &running, (victim, signal), moment);
        let run = running.finish_beside_another();
        // A guard that is killed can remove nothing; the next command does, once its child has ended too.
        until("nothing runs", || rig.processes().is_empty());
        rig.hil(&["sessions"]).expect(0);
        rig.assert_nothing_left();
        if !is_struck {
            continue;
        }

        let is_hil_dead = victim == "hil" && signal != Signal::STOP;
        let folder = run.folder.to_str().expect("plain text");
        if is_hil_dead {
            let recovery = rig.hil(&["recover", "--json", folder]).expect(0).json();
            let count = |name: &str| recovery[name].as_u64().expect("a number");
            let (records, vouched) = (count("records"), count("vouched_records"));
            assert!(vouched > 0, "it had a chunk, with its sum: {recovery}");
            assert!(vouched == records || !recovery["unvouched"].is_null());
        }
        if !run.recording().exists() {
            continue; // it ended before
        }
        let records = records(&run.recording(), (clock != "realtime").then_some(&whole));
        if is_hil_dead {
            continue;
        }
        let summary = run.summary();
        let reason = summary["reason"].as_str().expect("a reason");
        // The step that was not answered is the number of those that were; a plant that is gone tells none.
        if let Some((_, rest)) = reason.split_once("step ")
            && victim == "controller"
            && clock != "realtime"
        {
            let digits = rest.split(|letter: char| !letter.is_ascii_digit()).next();
            let step = digits.and_then(|digits| digits.parse().ok());
            assert_eq!(Some(records), step, "{reason}");
        }
    }
}

/// Ends or stops a process of a run after a moment, and waits until the others have ended; returns `false` if the run
/// reached its wait limit before, as on a busy machine.
fn strike(
    rig: &Rig,
    running: &Running<'_>,
    (victim, signal): (&str, Signal),
    moment: Duration,
) -> bool {
    let info = || SessionInfo::read(&rig.session_folder()).ok();
    let mut children: Option<[ProcessId; 2]> = None;
    until("both sides are there", || {
        children = info().and_then(|info| info.children.try_into().ok());
        children.is_some()
    });
    let [plant, controller] = children.expect("both are there");
    if victim == "hil" {
        // A chunk is closed after 100 ms, or later on a busy machine.
        let recording = running.folder().join("run.mcap");
        until("the recording has a chunk", || {
            let reader = RunReader::open(&recording);
            let has_chunk = reader.is_ok_and(|mut reader| matches!(reader.advance(), Ok(true)));
            has_chunk || !plant.is_alive()
        });
    }
    std::thread::sleep(moment);
    if !(plant.is_alive() && controller.is_alive()) {
        return false;
    }
    // The guard's death is that of both; its child's stop is its own.
    let hil = match signal {
        Signal::STOP => info().map_or(running.pid(), |info| info.owner.pid),
        _ => running.pid(),
    };
    let (pid, survivors) = match victim {
        "plant" => (plant.pid, vec![controller]),
        "controller" => (controller.pid, vec![plant]),
        _ => (hil, vec![plant, controller]),
    };
    send(pid, signal);
    until_gone(&survivors);
    if victim == "hil" && signal == Signal::STOP {
        send(pid, Signal::CONT);
    }
    true
}

/// Counts the records of a recording, which follow each other and are those of a whole run.
fn records(recording: &Path, whole: Option<&std::path::PathBuf>) -> u64 {
    let open = |path: &Path| RunReader::open(path).expect("readable");
    let (mut reader, mut whole) = (open(recording), whole.map(|path| open(path)));
    let mut records = 0;
    while reader.advance().expect("readable") {
        assert_eq!(reader.step(), records);
        if let Some(whole) = &mut whole {
            let hashed = reader.hashed_words();
            assert!(whole.advance().expect("readable"));
            let (words, expected) = (&reader.words()[..hashed], &whole.words()[..hashed]);
            assert_eq!(words, expected, "step {records}");
        }
        records += 1;
    }
    records
}

/// Memory of a process that is in use, in KiB.
fn resident_kib(pid: u32) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let line = status.lines().find(|line| line.starts_with("VmRSS:"))?;
    line.split_ascii_whitespace().nth(1)?.parse().ok()
}

#[test]
#[ignore = "long: .ci/run long"]
fn two_million_steps_under_random_faults_lose_none_and_need_no_more_memory() {
    const STEPS: u64 = 2_000_000;
    let rig = Rig::new();
    let scenario = rig.write("small.toml", SMALL);
    let duration = format!("--set run.duration_s={}", STEPS as f64 / 10_000.0);
    let running = rig.start(&format!("{} {duration}", scenario.display()));
    let [plant, controller] = running.children();
    let pids = [plant.pid, controller.pid, running.worker()];
    let mut random = RandomStream::new(1, "faults");
    let mut resident: Vec<[u64; 3]> = Vec::new();
    let mut injected = 0;
    while plant.is_alive() {
        if let [Some(plant), Some(controller), Some(hil)] = pids.map(resident_kib) {
            resident.push([plant, controller, hil]);
        }
        let size = format!("{:e}", random.uniform() * 1e-6);
        let fault = match below(&mut random, 4) {
            0 => format!("bias measured.position_m {size}"),
            1 => format!("noise measured.position_m {size}"),
            2 => "stuck measured.position_m".into(),
            _ => format!("drift measured.position_m {size}"),
        };
        let answer = rig.in_session(&format!("inject {fault} --duration 0.05"));
        if answer.code == Some(0) {
            injected += 1;
        } else if plant.is_alive() {
            let text = &answer.stderr;
            assert!(
                ["running", "ended", "over"]
                    .iter()
                    .any(|word| text.contains(word)),
                "{text}"
            );
        }
    }
    let summary = running.finish_late().expect(0).summary();
    assert_eq!(summary["recording"]["lost"], 0);
    assert_eq!(summary["recording"]["records"], STEPS + 1);
    assert!(injected > 10, "{injected} faults");
    // The first tenth is the start; then the largest of a third in the middle against the least of the last.
    let tenth = resident.len() / 10;
    let third = (resident.len() - tenth) / 3;
    for (place, name) in ["plant", "controller", "hil"].into_iter().enumerate() {
        let of = |part: &[[u64; 3]]| part.iter().map(|kib| kib[place]).collect::<Vec<u64>>();
        let early = of(&resident[tenth..tenth + third]).into_iter().max();
        let late = of(&resident[resident.len() - third..]).into_iter().min();
        let (early, late) = early.zip(late).expect("looks of both times");
        assert!(
            10 * late < 11 * early,
            "{name}: {early} KiB, then {late} KiB"
        );
    }
}

#[test]
#[ignore = "long: .ci/run long"]
fn five_hundred_runs_and_sixteen_sessions_at_once_have_one_digest() {
    let rig = Rig::new();
    let scenario = rig.write("small.toml", SMALL);
    let short = format!("{} --set run.rate_hz=1000 --no-record", scenario.display());
    let mut digests: Vec<String> = (0..500)
        .map(|_| {
            rig.run(&format!("{short} --set run.duration_s=0.02"))
                .expect(0)
                .digest()
        })
        .collect();
    digests.dedup();
    assert_eq!(digests.len(), 1, "{digests:?}");

    let short = format!("{short} --set run.duration_s=2.0");
    let alone = rig.run(&short).expect(0).digest();
    let rigs: Vec<Rig> = (0..16).map(|_| Rig::new()).collect();
    let runs: Vec<Running<'_>> = rigs.iter().map(|rig| rig.start(&short)).collect();
    for run in runs {
        assert_eq!(run.finish().expect(0).digest(), alone);
    }
}
