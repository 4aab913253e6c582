//! Bench `kills`: who notices a death, and how soon?
//!
//! `cargo bench -p tests --bench kills -- [N [SEED]]` runs the teaching plant N times (1000), ends or
//! stops the plant, the controller or `hil` itself at a random moment, in each clock, and prints for
//! each kind how long the others took to notice. `hil` is ended after its recording has its first chunk.
//! Nothing may hang, no recording may be unreadable or lack a completed step, and nothing may be left.
//! Every recording, recovered or not, must be a prefix of the same run left alone, record by record; in
//! real time, where runs differ, its steps must follow each other.

#[path = "../shared/programs.rs"]
#[expect(dead_code, reason = "other benches use the rest")]
mod programs;
#[path = "../shared/rig.rs"]
mod rig;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use hil_recording::reader::{RECORDING, ReadError, RunReader};
use hil_session::process::ProcessId;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};
use tempfile::TempDir;

use programs::Programs;
use rig::{Running, comes, left, scenario};

/// Time for which a side waits for one that lives and says nothing, in s.
const WAIT_LIMIT_S: f64 = 0.3;
const CLOCKS: [&str; 3] = ["lockstep", "paced", "realtime"];
const VICTIMS: [&str; 3] = ["plant", "controller", "hil"];

/// Signals that end a process. Of ten processes, six are killed, three abort, as one without memory
/// does, and one is stopped.
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

/// Tally of what went wrong.
#[derive(Default)]
struct Wrong {
    hangs: u64,
    unreadable: u64,
    missing: u64,
    left: u64,
    untold: u64,
    /// Recordings that say other than the undisturbed run.
    prefixes: u64,
    /// Recovered recordings that no check sum vouches for.
    unvouched: u64,
}

/// Recordings that a killed `hil` left and that were recovered: their records, and how many of these no
/// check sum vouches for.
#[derive(Default)]
struct Recovered {
    records: Vec<f64>,
    unvouched: Vec<f64>,
}

/// Judge of recordings.
struct Judge<'a> {
    hil: &'a Path,
    /// The recording of a run that was left alone.
    undisturbed: PathBuf,
    wrong: Wrong,
    recovered: Recovered,
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
    let alone = folder.path().join("undisturbed");
    // In one process: the same records, and soon there on a busy machine.
    let in_process = ["--link", "in-process"];
    programs.run_in(
        &alone,
        &[&[fast.to_str().expect("plain text")][..], &in_process].concat(),
    );
    let mut judge = Judge {
        hil: &programs.hil,
        undisturbed: alone.join(RECORDING),
        wrong: Wrong::default(),
        recovered: Recovered::default(),
    };
    let mut noticed_ms: BTreeMap<(&str, &str, &str), Vec<f64>> = BTreeMap::new();
    for run in 0..count {
        let clock = CLOCKS[random.below(3) as usize];
        let victim = VICTIMS[random.below(3) as usize];
        let (how, signal) = SIGNALS[random.below(10) as usize];
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
        let longest_us = if victim == "hil" { 400_000 } else { 60_000 };
        let moment = Duration::from_micros(random.below(longest_us));
        let ms = judge.one(running, victim, clock, (how, signal), moment);
        if let Some(ms) = ms {
            noticed_ms.entry((how, victim, clock)).or_default().push(ms);
        }
        let left = left(&programs.hil, "gone-");
        if !left.is_empty() {
            judge.wrong.left += 1;
            eprintln!("run {run}: {victim} {how} in {clock} left {left:?}");
        }
        if run % 50 == 49 {
            eprintln!("{} of {count}", run + 1);
        }
    }
    report(count, seed, noticed_ms, judge);
}

impl Judge<'_> {
    /// Ends a process of a run after a moment; gives how long the others took to notice, in ms.
    fn one(
        &mut self,
        mut running: Running,
        victim: &str,
        clock: &str,
        (how, signal): (&str, Signal),
        moment: Duration,
    ) -> Option<f64> {
        let recording = running.folder.join(RECORDING);
        let children = running.children();
        // A chunk is closed after 100 ms, or later on a busy machine.
        let has_begun = victim != "hil" || comes(|| has_records(&recording));
        let (Some([plant, controller]), true) = (children, has_begun) else {
            self.wrong.hangs += 1;
            eprintln!("never started");
            let _ = running.hil.kill();
            let _ = running.hil.wait();
            return None;
        };
        std::thread::sleep(moment);
        // The guard's death is that of both; its stop is its own.
        let own = match how {
            "STOP" => running.owner(),
            _ => running.hil.id(),
        };
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
            self.wrong.hangs += 1;
            eprintln!("{victim} {how}: hangs in {}", running.folder.display());
            let _ = running.hil.kill();
            let _ = running.hil.wait();
            return None;
        }
        if let Err(error) = self.judge(&running, victim, clock, how) {
            eprintln!(
                "{}: {victim} {how} in {clock}: {error}",
                running.folder.display()
            );
        } else {
            // What is right is not kept.
            let _ = std::fs::remove_dir_all(&running.folder);
        }
        Some(ms)
    }

    /// Looks at what a run left.
    fn judge(
        &mut self,
        running: &Running,
        victim: &str,
        clock: &str,
        how: &str,
    ) -> Result<(), String> {
        let recording = running.folder.join(RECORDING);
        let killed = victim == "hil" && how != "STOP";
        if killed {
            self.recover(&running.folder)?;
        }
        if !recording.exists() {
            return Ok(());
        }
        let undisturbed = (clock != "realtime").then_some(&*self.undisturbed);
        let records = match prefix(&recording, undisturbed) {
            Ok(Ok(records)) => records,
            Ok(Err(differs)) => {
                self.wrong.prefixes += 1;
                return Err(differs);
            }
            Err(error) => {
                self.wrong.unreadable += 1;
                return Err(error.to_string());
            }
        };
        if killed {
            return Ok(());
        }
        let text = std::fs::read_to_string(running.folder.join("summary.json"));
        let text = text.unwrap_or_default();
        let summary: Value = serde_json::from_str(&text).unwrap_or_default();
        let reason = summary["reason"].as_str().unwrap_or_default();
        if reason.is_empty() {
            self.wrong.untold += 1;
            return Err(format!("no reason in `{text}`"));
        }
        // The step that was not answered is the number of those that were; a plant that is gone tells none.
        let step = (reason.split_once("step ")).map(|(_, rest)| {
            let digits: String = rest.chars().take_while(char::is_ascii_digit).collect();
            digits.parse::<u64>().unwrap_or(u64::MAX)
        });
        if let Some(step) = step
            && victim == "controller"
            && clock != "realtime"
            && step != records
        {
            self.wrong.missing += 1;
            return Err(format!("{records} records, {reason}"));
        }
        Ok(())
    }

    /// Makes a whole recording of what a killed `hil` left.
    fn recover(&mut self, folder: &Path) -> Result<(), String> {
        let recover = Command::new(self.hil)
            .args(["recover", "--json"])
            .arg(folder)
            .output();
        let recover = recover.expect("hil");
        let recovered: Value = serde_json::from_slice(&recover.stdout).unwrap_or_default();
        let number = |name: &str| recovered[name].as_u64();
        let (Some(records), Some(vouched)) = (number("records"), number("vouched_records")) else {
            self.wrong.unreadable += 1;
            return Err(String::from_utf8_lossy(&recover.stderr).into_owned());
        };
        // It had a chunk, with its sum.
        if vouched == 0 || vouched < records && recovered["unvouched"].is_null() {
            self.wrong.unvouched += 1;
            return Err(recovered.to_string());
        }
        self.recovered.records.push(records as f64);
        self.recovered.unvouched.push((records - vouched) as f64);
        Ok(())
    }
}

/// Returns true if a live recording has a chunk.
fn has_records(recording: &Path) -> bool {
    let reader = RunReader::open(recording);
    reader.is_ok_and(|mut reader| matches!(reader.advance(), Ok(true)))
}

/// The records of a recording, which must follow each other and be those of another run; how they differ.
fn prefix(recording: &Path, of: Option<&Path>) -> Result<Result<u64, String>, ReadError> {
    let mut reader = RunReader::open(recording)?;
    let mut other = of.map(RunReader::open).transpose()?;
    let mut records = 0;
    while reader.advance()? {
        if reader.step() != records {
            return Ok(Err(format!(
                "step {} after {records} records",
                reader.step()
            )));
        }
        if let Some(other) = &mut other {
            let hashed = reader.hashed_words();
            if !other.advance()? || other.words()[..hashed] != reader.words()[..hashed] {
                return Ok(Err(format!(
                    "step {records} is not that of the undisturbed run"
                )));
            }
        }
        records += 1;
    }
    Ok(Ok(records))
}

fn report(
    count: u64,
    seed: u64,
    noticed_ms: BTreeMap<(&str, &str, &str), Vec<f64>>,
    judge: Judge<'_>,
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
    let Judge {
        wrong,
        mut recovered,
        ..
    } = judge;
    for values in [
        &mut deaths,
        &mut recovered.records,
        &mut recovered.unvouched,
    ] {
        values.sort_by(f64::total_cmp);
    }
    let of = |values: &[f64], share: f64| {
        let place = share * values.len().saturating_sub(1) as f64;
        values.get(place as usize).copied()
    };
    let at = |share: f64| of(&deaths, share);
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
        "wrong_prefixes": wrong.prefixes,
        "not_vouched_for": wrong.unvouched,
        "left": wrong.left,
        "recovered": {
            "recordings": recovered.records.len(),
            "records_p50": of(&recovered.records, 0.5),
            "records_max": of(&recovered.records, 1.0),
            "unvouched_p50": of(&recovered.unvouched, 0.5),
            "unvouched_max": of(&recovered.unvouched, 1.0),
        },
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
