//! Bench `panel`: what does `hil panel` cost the run, the connection and the page?
//!
//! `cargo bench -p tests --bench panel` prints these tables, or one of them by name
//! (`cargo bench -p tests --bench panel -- page`):
//!
//! - `loop`: runs at full speed alone and with a client that reads and acknowledges all that a page is sent and draws
//!   nothing, in turns;
//! - `page`: of a run paced at real time the script time of a frame with 20 curves in sight, bytes and messages to
//!   the browser, and the time from the start of `hil panel` to the first curve; skipped by name without Chromium or
//!   a Python with playwright.
//!
//! There is no limit on any number. `HIL_BENCH_QUICK=1` only tries whether they work.

#[path = "../shared/effort.rs"]
#[expect(dead_code, reason = "asks for rounds alone")]
mod effort;
#[path = "../shared/measure.rs"]
mod measure;
mod page;
#[path = "../../shared/panel_socket.rs"]
mod panel_socket;
#[path = "../shared/programs.rs"]
#[expect(dead_code, reason = "its runs go on while they are watched")]
mod programs;
#[path = "../shared/watched.rs"]
mod watched;

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, ExitCode, Stdio};

use serde_json::{Value, json};
use tungstenite::Message;

use panel_socket::{connected, parts};
use programs::Programs;
use watched::Comparison;

fn main() -> ExitCode {
    // `cargo test --all-targets` starts benches too, without this argument.
    if !std::env::args().any(|argument| argument == "--bench") {
        println!("run me with `cargo bench -p tests --bench panel`");
        return ExitCode::SUCCESS;
    }
    println!("machine: {}\n", measure::machine());
    let programs = Programs::built();
    let wanted: Vec<String> = (std::env::args().skip(1))
        .filter(|argument| !argument.starts_with('-'))
        .collect();
    let is_wanted = |name: &str| wanted.is_empty() || wanted.iter().any(|wanted| wanted == name);
    if is_wanted("loop") {
        beside_the_loop(&programs);
    }
    if is_wanted("page") {
        page::measure(&programs);
    }
    ExitCode::SUCCESS
}

/// Returns the paper's scenario.
fn scenario() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/severe-leakage.toml")
}

/// Prints what a client of the panel changes.
fn beside_the_loop(programs: &Programs) {
    let scenario = scenario();
    let scenario = scenario.to_str().expect("a path in UTF-8");
    let comparison = Comparison {
        hil: &programs.hil,
        arguments: &[scenario, "--no-record", "--set", "requirements=[]"],
        title: "severe-leakage.toml without a recording, alone and with a client of `hil panel` that draws nothing",
        bench: "panel/loop",
    };
    comparison.print(|session| {
        let panel = Panel::start(&programs.hil, session);
        follow(&panel.url);
        panel
    });
}

/// A panel, which ends when it is dropped.
struct Panel {
    process: Child,
    url: String,
    _stdout: BufReader<ChildStdout>,
}

impl Panel {
    /// Starts a panel, and waits until it prints its address.
    fn start(hil: &Path, session: &str) -> Self {
        let mut process = Command::new(hil)
            .args(["panel", "--no-open", "--json", "--session", session])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .expect("hil");
        let mut stdout = BufReader::new(process.stdout.take().expect("piped"));
        let mut line = String::new();
        stdout.read_line(&mut line).expect("text");
        let told: Value = serde_json::from_str(&line).unwrap_or_else(|e| panic!("{e}: {line}"));
        let url = told["url"].as_str().expect("an address").to_owned();
        Self {
            process,
            url,
            _stdout: stdout,
        }
    }
}

impl Drop for Panel {
    fn drop(&mut self) {
        let _ = self.process.kill(); // it may have ended by itself
        let _ = self.process.wait();
    }
}

/// Reads everything sent to a page, on a thread, until the panel has ended; returns after the first points.
fn follow(url: &str) {
    let mut socket = connected(url);
    let mut say = move |text: String| socket.send(text.into()).and_then(|()| socket.read());
    let greeting = json!({ "secret": parts(url).1 }).to_string();
    let mut next = say(greeting).expect("it is welcome");
    let (first, is_there) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let mut number = 0;
        loop {
            if let Message::Binary(bytes) = &next {
                number = u64::from_le_bytes(bytes[8..16].try_into().expect("8 bytes"));
                let _ = first.send(()); // nobody waits after the first one
            }
            let seen = json!({ "ask": "seen", "number": number }).to_string();
            match say(seen) {
                Ok(told) => next = told,
                Err(_) => return,
            }
        }
    });
    is_there.recv().expect("points of the held run");
}
