//! The page in a headless Chromium, which `tests/hosts/panel_page.py` drives.

use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};

use crate::effort::rounds;
use crate::measure::{Bystanders, machine, median};
use crate::programs::Programs;
use crate::watched::until;
use crate::{Panel, scenario};

/// Time for which the load of other programs is measured.
const BEFORE: Duration = Duration::from_secs(3);

/// Prints the results of the page.
pub(crate) fn measure(programs: &Programs) {
    let Some((python, chromium)) = browser() else {
        println!("page: skipped: chromium, or a Python with playwright, is missing\n");
        return;
    };
    let bystanders = Bystanders::watch();
    std::thread::sleep(BEFORE);
    let others = bystanders.share();
    let run = Run::start(&programs.hil);
    let start = |play: &str, url: &str| Play::start(&python, chromium, play, url);
    let first_s: Vec<f64> = (0..rounds())
        .map(|_| {
            let mut play = start("first", "-");
            play.expect("go");
            let since = Instant::now();
            let panel = Panel::start(&programs.hil, &run.session);
            writeln!(play.stdin, "{}", panel.url).expect("it listens");
            play.expect("drawn");
            let taken_s = since.elapsed().as_secs_f64();
            play.told();
            taken_s
        })
        .collect();
    let panel = Panel::start(&programs.hil, &run.session);
    let told = start("pace", &panel.url).told();
    let number = |name: &str| {
        told[name]
            .as_f64()
            .unwrap_or_else(|| panic!("{name}: {told}"))
    };
    let frames: Vec<f64> = (told["frame_ms"].as_array().expect("frames").iter())
        .filter_map(Value::as_f64)
        .collect();
    assert!(!frames.is_empty(), "no frame was drawn: {told}");
    // They are sorted.
    let p95_ms = frames[(frames.len() - 1) * 95 / 100];
    let (median_ms, mean_ms) = (median(frames.iter().copied()), number("processor_ms"));
    let (bytes_per_s, messages_per_s) = (number("bytes_per_s"), number("messages_per_s"));
    let (curves, first_s) = (number("curves"), (median(first_s.iter().copied()), first_s));
    println!(
        "severe-leakage.toml, 10 kHz, paced at 1, headless Chromium; other programs took {:.0} % of the machine before",
        100.0 * others
    );
    println!(
        "script time a frame, {curves} curves in sight   median {median_ms:.2} ms, p95 {p95_ms:.2} ms, {} frames",
        frames.len()
    );
    println!("script on the processor, a frame          mean {mean_ms:.2} ms");
    println!(
        "to the browser                           {:.1} kB and {messages_per_s:.1} messages a second",
        bytes_per_s / 1e3
    );
    println!(
        "from `hil panel` to the first curve      median {:.2} s of {}",
        first_s.0,
        first_s.1.len()
    );
    let line = json!({
        "bench": "panel/page",
        "machine": machine(),
        "others_share": others,
        "curves": curves,
        "frame_ms": { "p50": median_ms, "p95": p95_ms, "count": frames.len(), "processor_mean": mean_ms },
        "bytes_per_s": bytes_per_s,
        "messages_per_s": messages_per_s,
        "first_curve_s": first_s.1,
    });
    println!("{line}\n");
}

/// A Python with playwright, and a Chromium.
fn browser() -> Option<(PathBuf, &'static str)> {
    let paths = [
        "/usr/bin/chromium",
        "/usr/bin/chromium-browser",
        "/usr/bin/chromium-headless-shell",
    ];
    let chromium = paths.into_iter().find(|path| Path::new(path).exists())?;
    let own = std::env::current_exe().expect("a path to this program");
    let target = own.ancestors().nth(3).expect("it lies in target");
    let python = [PathBuf::from("python3"), target.join("python/bin/python")];
    let has_it = |python: &PathBuf| {
        let imported = Command::new(python)
            .args(["-c", "import playwright.sync_api"])
            .output();
        imported.is_ok_and(|output| output.status.success())
    };
    Some((python.into_iter().find(has_it)?, chromium))
}

/// A run paced at real time, which ends when it is dropped.
struct Run {
    process: Child,
    session: String,
}

impl Run {
    fn start(hil: &Path) -> Self {
        let session = format!("bench-{}", std::process::id());
        let process = Command::new(hil)
            .args(["run", "--pace", "1", "--no-record", "--session", &session])
            .args(["--set", "requirements=[]", "--set", "run.duration_s=600"])
            .arg(scenario())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("hil");
        let run = Self { process, session };
        until("the run goes on", || {
            let asked = Command::new(hil)
                .args(["inject", "--active", "--json", "--session", &run.session])
                .output()
                .expect("hil");
            let told: Value = serde_json::from_slice(&asked.stdout).unwrap_or_default();
            told["status"]["step"].as_u64() > Some(0)
        });
        run
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        let pid = Pid::from_raw(self.process.id().cast_signed()).expect("a process");
        let _ = kill_process(pid, Signal::INT); // it may have ended by itself
        let _ = self.process.wait();
    }
}

/// Browser script in progress.
struct Play {
    process: Child,
    stdin: ChildStdin,
    stdout: BufReader<ChildStdout>,
}

impl Play {
    fn start(python: &Path, chromium: &str, play: &str, url: &str) -> Self {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("hosts/panel_page.py");
        let mut process = Command::new(python)
            .arg(script)
            .args([play, url, chromium])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("python");
        Self {
            stdin: process.stdin.take().expect("piped"),
            stdout: BufReader::new(process.stdout.take().expect("piped")),
            process,
        }
    }

    /// Waits for a message of the script.
    fn expect(&mut self, word: &str) {
        let mut line = String::new();
        self.stdout.read_line(&mut line).expect("text");
        assert_eq!(line.trim_end(), word);
    }

    /// Waits for the end of the script, and returns its output.
    fn told(mut self) -> Value {
        let mut text = String::new();
        self.stdout.read_to_string(&mut text).expect("text");
        serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text}"))
    }
}

impl Drop for Play {
    fn drop(&mut self) {
        let _ = self.process.kill(); // it may have ended by itself
        let _ = self.process.wait();
    }
}
