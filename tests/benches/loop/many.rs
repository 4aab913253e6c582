//! Very many short runs by one `hil run`: the cost of each, and the resources that remain in use afterwards.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

use serde_json::{Value, json};
use tempfile::TempDir;

use crate::effort::{rounds, shortened};
use crate::measure::{Bystanders, machine, median};
use crate::programs::Programs;

/// Runs in each suite of short ones.
const SHORT: u64 = 500;
/// Runs in the suite that shows whether they slow down.
const LASTING: u64 = 1000;
/// Simulated time of a run of 10 steps at 1 kHz.
const SHORT_S: f64 = 0.01;
/// Simulated time of a run of the lasting suite.
const LASTING_S: f64 = 1.0;
/// Simulated time of a run long enough that its files cost little.
const LONG_S: f64 = 20.0;

/// A running process.
#[derive(Clone, Copy, Default)]
struct Held {
    threads: u64,
    files: u64,
    memory_mib: f64,
}

impl Held {
    fn by(pid: u32) -> Self {
        let process = format!("/proc/{pid}");
        let status = std::fs::read_to_string(format!("{process}/status")).unwrap_or_default();
        let number = |name: &str| -> u64 {
            let line = status.lines().find_map(|line| line.strip_prefix(name));
            let word = line.and_then(|line| line.split_ascii_whitespace().next());
            word.and_then(|word| word.parse().ok()).unwrap_or_default()
        };
        let files = std::fs::read_dir(format!("{process}/fd"));
        Self {
            threads: number("Threads:"),
            files: files.map_or(0, |files| files.count() as u64),
            memory_mib: number("VmRSS:") as f64 / 1024.0,
        }
    }

    /// Returns the larger value of each number.
    fn most(self, other: Self) -> Self {
        Self {
            threads: self.threads.max(other.threads),
            files: self.files.max(other.files),
            memory_mib: if self.memory_mib > other.memory_mib {
                self.memory_mib
            } else {
                other.memory_mib
            },
        }
    }
}

/// Results of a suite.
struct Suite {
    /// Time from the start of `hil` to its end, for each run.
    each_ms: f64,
    /// Times between the ends of two runs.
    between_ms: Vec<f64>,
    /// State of the process after each run.
    held: Vec<Held>,
}

/// Runs one scenario this many times, with all results below a folder, and observes the process if it is `watched`.
///
/// Results are removed only when the bench ends, because a file system may be slow for seconds after removals.
fn suite(hil: &Path, folder: &Path, length: (f64, u64), watched: bool, ways: &[&str]) -> Suite {
    let (seconds, count) = length;
    let folder = tempfile::tempdir_in(folder).expect("a folder").keep();
    let scenario = folder.join("many.toml");
    let text = format!(
        "schema = 1\nname = \"many\"\n[run]\nduration_s = {seconds}\nrate_hz = 1000\n\
         [plant]\nmodel = \"spring-mass\"\n[controller]\nlaw = \"pid\"\n\
         [[stimuli]]\ntarget = \"position_m\"\nkind = \"step\"\nafter = 0.01\n"
    );
    std::fs::write(&scenario, text).expect("written");
    let begun = Instant::now();
    let mut running = Command::new(hil)
        .args(["run", "--repeat", &count.to_string()])
        .arg("--out")
        .arg(folder.join("runs"))
        .args(ways)
        .arg(&scenario)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("hil");
    let said = BufReader::new(running.stderr.take().expect("piped"));
    let (mut ends_ms, mut held) = (Vec::new(), Vec::new());
    for line in said.lines().map_while(Result::ok) {
        assert!(line.ends_with(": pass"), "{line}");
        ends_ms.push(1e3 * begun.elapsed().as_secs_f64());
        if watched {
            held.push(Held::by(running.id()));
        }
    }
    assert!(running.wait().expect("our child").success());
    let each_ms = 1e3 * begun.elapsed().as_secs_f64() / count as f64;
    assert_eq!(ends_ms.len() as u64, count);
    let between_ms = ends_ms.windows(2).map(|pair| pair[1] - pair[0]).collect();
    Suite {
        each_ms,
        between_ms,
        held,
    }
}

/// Lists the files of all sessions in shared memory.
fn in_shared_memory() -> Vec<String> {
    let uid = rustix::process::geteuid().as_raw();
    let sessions = format!("/dev/shm/hil-{uid}");
    let entries = ["/dev/shm", &sessions]
        .into_iter()
        .flat_map(std::fs::read_dir);
    let names = entries.flatten().flatten().map(|entry| entry.path());
    names
        .map(|path| path.display().to_string())
        .filter(|path| path.starts_with("/dev/shm/hil_") || path.starts_with(&sessions))
        .collect()
}

/// Suites of a row: name, folder of the results, simulated seconds, number of runs and arguments.
type Way<'a> = (&'a str, &'a TempDir, (f64, u64), &'a [&'a str]);

/// Prints the cost of a short run, and whether the thousandth run costs more than the first.
pub(crate) fn compare(programs: &Programs) {
    let hil = &programs.hil;
    let count = shortened(SHORT);
    let disk = TempDir::new().expect("a folder");
    let memory = TempDir::new_in("/dev/shm").expect("a folder");
    let unrecorded = ["--link", "in-process", "--no-record"];
    let one_job = ["--link", "in-process", "--no-record", "--jobs", "1"];
    // Fewer of those that take longer; a suite has two runs at least.
    let few = if count < 20 { 2 } else { count / 10 };
    let (short, few_short, long) = ((SHORT_S, count), (SHORT_S, few), (LONG_S, few));
    let ways: [Way<'_>; 8] = [
        ("in-process", &disk, short, &unrecorded),
        ("in-process, results in memory", &memory, short, &unrecorded),
        ("in-process, --jobs 1", &disk, short, &one_job),
        (
            "in-process, recorded",
            &disk,
            short,
            &["--link", "in-process"],
        ),
        ("in-process, 20,000 steps", &disk, long, &unrecorded),
        ("in-process, 20,000 steps, --jobs 1", &disk, long, &one_job),
        ("two processes", &disk, few_short, &["--no-record"]),
        ("two processes, recorded", &disk, few_short, &[]),
    ];
    let mut each_ms = [const { Vec::new() }; 8];
    let bystanders = Bystanders::watch();
    for _ in 0..rounds() {
        for ((_, folder, length, arguments), each_ms) in ways.iter().zip(&mut each_ms) {
            each_ms.push(suite(hil, folder.path(), *length, false, arguments).each_ms);
        }
    }
    let others = bystanders.share();
    println!(
        "suites of {count} runs of 10 steps ({few} where runs take longer), medians of {}, \
         other programs took {:.0} % of the machine",
        rounds(),
        100.0 * others
    );
    println!("{:<34} {:>12}", "", "ms a run");
    let each_ms = each_ms.map(median);
    for ((name, ..), each_ms) in ways.iter().zip(each_ms) {
        println!("{name:<34} {each_ms:>12.3}");
    }
    let lines = ways.iter().zip(each_ms);
    let lines: Vec<Value> = lines
        .map(|((name, ..), each_ms)| json!({"way": name, "each_ms": each_ms}))
        .collect();
    let line = json!({
        "bench": "loop/many",
        "machine": machine(),
        "rounds": rounds(),
        "others_share": others,
        "ways": lines,
    });
    println!("{line}\n");
    last_and_first(hil, disk.path());
}

fn last_and_first(hil: &Path, folder: &Path) {
    let count = shortened(LASTING);
    let part = (count / 10) as usize;
    let before = in_shared_memory();
    let bystanders = Bystanders::watch();
    let arguments = ["--link", "in-process", "--no-record"];
    let suite = suite(hil, folder, (LASTING_S, count), true, &arguments);
    let others = bystanders.share();
    let left = in_shared_memory().into_iter();
    let left = left.filter(|path| !before.contains(path)).count();
    let of = |times: &[f64], held: &[Held]| {
        let most = held.iter().copied().fold(Held::default(), Held::most);
        (median(times.iter().copied()), most)
    };
    let (times, held) = (&suite.between_ms, &suite.held);
    let first = of(&times[..part], &held[..part]);
    let last = of(&times[times.len() - part..], &held[held.len() - part..]);
    println!(
        "{count} runs of {LASTING_S} s simulated in one process, other programs took {:.0} % of the machine",
        100.0 * others
    );
    println!(
        "{:<12} {:>12} {:>9} {:>11} {:>12}",
        "", "ms a run", "threads", "open files", "memory MiB"
    );
    let row = |name: &str, (ms, most): (f64, Held)| {
        let Held {
            threads,
            files,
            memory_mib,
        } = most;
        println!("{name:<12} {ms:>12.3} {threads:>9} {files:>11} {memory_mib:>12.1}");
        json!({"part": name, "ms": ms, "threads": threads, "open_files": files, "memory_mib": memory_mib})
    };
    let parts = [
        row(&format!("first {part}"), first),
        row(&format!("last {part}"), last),
    ];
    let ratio = last.0 / first.0;
    println!("last over first {ratio:.2}; left in shared memory: {left}");
    let line = json!({
        "bench": "loop/many/lasting",
        "machine": machine(),
        "others_share": others,
        "each_ms": suite.each_ms,
        "parts": parts,
        "ratio": ratio,
        "left": left,
    });
    println!("{line}\n");
}
