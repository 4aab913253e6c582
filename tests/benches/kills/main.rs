//! Bench `kills`: who notices a death, and how soon?
//!
//! `cargo bench -p tests --bench kills -- [N [SEED]]` runs the teaching plant N times (1000), ends or
//! stops the plant, the controller or `hil` itself at a random moment, in each clock, and prints for
//! each kind how long the others took to notice. Nothing may hang, no recording may be unreadable or lack a
//! completed step, and nothing may be left.

#[path = "../programs.rs"]
#[expect(dead_code, reason = "other benches use the rest")]
mod programs;
#[path = "../rig.rs"]
mod rig;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};
use shared_types::process::ProcessId;
use tempfile::TempDir;
use tools::run_reader::RunReader;

use programs::Programs;
use rig::{Running, comes, left, scenario};

/// How long a side waits for one that lives and says nothing, in s.
const WAIT_LIMIT_S: f64 = 0.3;
const CLOCKS: [&str; 3] = ["lockstep", "paced", "realtime"];
const VICTIMS: [&str; 3] = ["plant", "controller", "hil"];

/// How a process is ended. Of ten, six are killed, three abort, as one without memory does, and one is
/// stopped.
const SIGNALS: [(&str, Signal); 10] = {
    const KILL: (&str, Signal) = ("KILL", Signal::KILL);
    const ABORT: (&str, Signal) = ("ABRT", Signal::ABORT);
    [
        KILL,
        KILL,
        KILL,
        KILL,
        KILL,
        KILL,
        ABORT,
        ABORT,
        ABORT,
        ("STOP", Signal::STOP),
    ]
};

/// What went wrong in all of it.
#[derive(Default)]
struct Wrong {
    hangs: u64,
    unreadable: u64,
    missing: u64,
    left: u64,
    untold: u64,
    /// Not wrong: `hil` was killed before its recording had a chunk.
    early: u64,
}

fn main() {
    let mut arguments = std::env::args()
        .skip(1)
        .filter(|argument| argument != "--bench");
    if !std::env::args().any(|argument| argument == "--bench") {
        println!("run me with `cargo bench -p tests --bench kills`");
        return;
    }
    let mut number = |default| {
        let given = arguments.next();
        given.map_or(default, |text| text.parse().expect("a number"))
    };
    let (count, seed) = (number(1000), number(1));
    let programs = Programs::built();
    let folder = TempDir::with_prefix("hil-kills-").expect("a folder");
    let fast = scenario(folder.path(), 10_000, 60.0);
    let slow = scenario(folder.path(), 1000, 60.0);
    let mut random = Random(seed);
    let mut wrong = Wrong::default();
    let mut noticed_ms: BTreeMap<(&str, &str, &str), Vec<f64>> = BTreeMap::new();
    for run in 0..count {
        let clock = CLOCKS[random.below(3) as usize];
        let victim = VICTIMS[random.below(3) as usize];
        let (how, signal) = SIGNALS[random.below(10) as usize];
        // In real time nobody waits for a stopped `hil`: there is nothing to notice.
        let victim = match (how, victim, clock) {
            ("STOP", "hil", "realtime") => "plant",
            _ => victim,
        };
        let path = if clock == "realtime" { &slow } else { &fast };
        let limit = WAIT_LIMIT_S.to_string();
        let arguments = [
            path.to_str().expect("plain text"),
            "--clock",
            clock,
            "--wait-limit",
            &limit,
        ];
        let place = folder.path().join(format!("run{run}"));
        let session = format!("gone-{}-{run}", std::process::id());
        let running = Running::start(&programs.hil, place, session, &arguments);
        // A recording gets its first chunk after 100 ms.
        let longest_us = if victim == "hil" { 400_000 } else { 60_000 };
        let moment = Duration::from_micros(random.below(longest_us));
        let ms = one(
            &programs.hil,
            running,
            victim,
            (how, signal),
            moment,
            &mut wrong,
        );
        if let Some(ms) = ms {
            noticed_ms.entry((how, victim, clock)).or_default().push(ms);
        }
        let left = left(&programs.hil, "gone-");
        if !left.is_empty() {
            wrong.left += 1;
            eprintln!("run {run}: {victim} {how} in {clock} left {left:?}");
        }
        if run % 50 == 49 {
            eprintln!("{} of {count}", run + 1);
        }
    }
    report(count, seed, noticed_ms, &wrong);
}

/// Ends a process of a run after a moment; gives how long the others took to notice, in ms.
fn one(
    hil: &Path,
    mut running: Running,
    victim: &str,
    (how, signal): (&str, Signal),
    moment: Duration,
    wrong: &mut Wrong,
) -> Option<f64> {
    let Some([plant, controller]) = running.children() else {
        wrong.hangs += 1;
        eprintln!("never started");
        return None;
    };
    std::thread::sleep(moment);
    let own = running.hil.id();
    let (pid, survivors) = match victim {
        "plant" => (plant.pid, vec![controller]),
        "controller" => (controller.pid, vec![plant]),
        _ => (own, vec![plant, controller]),
    };
    let pid = Pid::from_raw(pid as i32).expect("a process number");
    let since = Instant::now();
    kill_process(pid, signal).expect("it is there");
    let notice = comes(|| !survivors.iter().any(|one: &ProcessId| one.is_alive()));
    let ms = since.elapsed().as_secs_f64() * 1e3;
    if victim == "hil" && how == "STOP" {
        kill_process(pid, Signal::CONT).expect("it is there");
    }
    if !(notice && running.ends()) {
        wrong.hangs += 1;
        eprintln!("{victim} {how}: hangs in {}", running.folder.display());
        let _ = running.hil.kill();
        let _ = running.hil.wait();
        return None;
    }
    let records = judge(hil, &running, victim, how, wrong);
    if records.is_some() {
        // What is right is not kept.
        let _ = std::fs::remove_dir_all(&running.folder);
    }
    Some(ms)
}

/// Looks at what a run left; gives its number of records if all is well.
fn judge(hil: &Path, running: &Running, victim: &str, how: &str, wrong: &mut Wrong) -> Option<u64> {
    let recording = running.folder.join("run.mcap");
    let killed = victim == "hil" && how != "STOP";
    if killed && recording.exists() {
        let recovered = Command::new(hil)
            .arg("recover")
            .arg(&running.folder)
            .output();
        let recovered = recovered.expect("hil");
        let said = String::from_utf8_lossy(&recovered.stderr);
        if !recovered.status.success() {
            // It died while it wrote the first lines of the file, or before the first chunk was closed.
            if said.contains("ends before it says what a record is")
                || said.contains("broke off before its first record")
            {
                wrong.early += 1;
                return Some(0);
            }
            wrong.unreadable += 1;
            eprintln!("{}: {said}", running.folder.display());
            return None;
        }
    }
    if !recording.exists() {
        return Some(0);
    }
    let records = match count(&recording) {
        Ok(records) => records,
        Err(error) => {
            wrong.unreadable += 1;
            eprintln!("{}: {error}", recording.display());
            return None;
        }
    };
    if killed {
        return Some(records);
    }
    let text = std::fs::read_to_string(running.folder.join("summary.json")).unwrap_or_default();
    let summary: Value = serde_json::from_str(&text).unwrap_or_default();
    let reason = summary["reason"].as_str().unwrap_or_default();
    if reason.is_empty() {
        wrong.untold += 1;
        eprintln!("{}: no reason in `{text}`", running.folder.display());
        return None;
    }
    // The step that was not answered is the number of those that were; a plant that is gone tells none.
    let step = (reason.split_once("step ")).map(|(_, rest)| {
        let digits: String = rest.chars().take_while(char::is_ascii_digit).collect();
        digits.parse::<u64>().unwrap_or(u64::MAX)
    });
    let lockstep = summary["clock"] != "realtime";
    if let Some(step) = step
        && victim == "controller"
        && lockstep
        && step != records
    {
        wrong.missing += 1;
        eprintln!("{}: {records} records, {reason}", running.folder.display());
        return None;
    }
    Some(records)
}

/// The records of a recording, which must follow each other.
fn count(recording: &Path) -> Result<u64, String> {
    let mut reader = RunReader::open(recording).map_err(|error| error.to_string())?;
    let mut records = 0;
    while reader.advance().map_err(|error| error.to_string())? {
        if reader.step() != records {
            return Err(format!("step {} after {records} records", reader.step()));
        }
        records += 1;
    }
    Ok(records)
}

fn report(
    count: u64,
    seed: u64,
    noticed_ms: BTreeMap<(&str, &str, &str), Vec<f64>>,
    wrong: &Wrong,
) {
    println!("| ended by | who | clock | runs | noticed after, p50 ms | p99 ms | max ms |");
    println!("|---|---|---|---|---|---|---|");
    let mut deaths = Vec::new();
    for ((how, victim, clock), mut ms) in noticed_ms {
        ms.sort_by(f64::total_cmp);
        let at = |share: f64| ms[(share * (ms.len() - 1) as f64) as usize];
        let (p50, p99, max) = (at(0.5), at(0.99), at(1.0));
        println!(
            "| {how} | {victim} | {clock} | {} | {p50:.1} | {p99:.1} | {max:.1} |",
            ms.len()
        );
        if how != "STOP" {
            deaths.extend(ms);
        }
    }
    deaths.sort_by(f64::total_cmp);
    let at = |share: f64| deaths[(share * (deaths.len() - 1) as f64) as usize];
    let all = json!({
        "bench": "kills",
        "runs": count,
        "seed": seed,
        "deaths": deaths.len(),
        "noticed_ms": {"p50": at(0.5), "p99": at(0.99), "max": at(1.0)},
        "hangs": wrong.hangs,
        "unreadable": wrong.unreadable,
        "missing_steps": wrong.missing,
        "without_reason": wrong.untold,
        "left": wrong.left,
        "killed_before_the_first_chunk": wrong.early,
    });
    println!("{all}");
}

/// Numbers that repeat for a seed (xorshift).
struct Random(u64);

impl Random {
    fn below(&mut self, bound: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) % bound
    }
}
