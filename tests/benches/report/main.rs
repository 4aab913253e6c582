//! Bench `report`: how long does `hil report` take, and how large is the page?
//!
//! `cargo bench -p tests --bench report` records the paper's severe leakage, 20 s at 10 kHz, under each law,
//! and reports one run and all three. Printed are medians of the time from start to end and the size of the
//! file. There is no limit on any number.

#[path = "../shared/measure.rs"]
#[expect(dead_code, reason = "needs the machine and a median")]
mod measure;
#[path = "../shared/programs.rs"]
#[expect(dead_code, reason = "its runs leave their files here")]
mod programs;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use tempfile::TempDir;

/// Rounds, of which medians are taken.
const ROUNDS: usize = 7;
const LAWS: [&str; 3] = ["pid", "nrsc", "ftsc"];

fn main() -> std::process::ExitCode {
    // `cargo test --all-targets` starts benches too, without this argument.
    if std::env::args().any(|argument| argument == "--bench") {
        println!("machine: {}\n", measure::machine());
        compare();
    } else {
        println!("run me with `cargo bench -p tests --bench report`");
    }
    std::process::ExitCode::SUCCESS
}

fn compare() {
    let programs = programs::Programs::built();
    let folder = TempDir::new().expect("a folder");
    let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/severe-leakage.toml");
    let scenario = scenario.to_str().expect("a path in UTF-8");
    let runs = LAWS.map(|law| {
        let run = folder.path().join(law);
        let law = format!("controller.law={law}");
        // Whether its requirements hold does not matter here.
        let settings = ["--set", &law, "--set", "requirements=[]"];
        programs.run_in(&run, &[&[scenario], &settings[..]].concat());
        run
    });
    println!("{:<24} {:>8} {:>8}", "hil report", "time", "size");
    for (what, runs) in [("one run", &runs[2..]), ("three runs", &runs[..])] {
        let page = folder.path().join("page.html");
        let times_s = (0..ROUNDS).map(|_| time_s(&programs.hil, runs, &page));
        let median_s = measure::median(times_s);
        let bytes = std::fs::metadata(&page).expect("the page is there").len();
        let size = bytes as f64 / 1e6;
        println!("{what:<24} {median_s:>6.2} s {size:>5.1} MB");
    }
}

fn time_s(hil: &Path, runs: &[PathBuf], page: &Path) -> f64 {
    let mut command = Command::new(hil);
    command
        .arg("report")
        .args(runs)
        .arg("--force")
        .arg("-o")
        .arg(page);
    let started = Instant::now();
    let output = command.output().expect("hil can be run");
    let taken = started.elapsed();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    taken.as_secs_f64()
}
