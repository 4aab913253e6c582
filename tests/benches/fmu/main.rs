//! Bench `fmu`: what does an FMU cost compared with FMPy, and how long does it take to open a large one?
//!
//! `cargo bench -p tests --bench fmu` measures in turns `Dahlquist` of FMI 3 in `hil run --no-record`, which is two
//! processes in lockstep, and the same steps in a loop over FMPy's low-level interface in one process. Then it opens
//! the FMU of 500 variables that the tests check, by `hil-fmu --describe` and by `hil describe`, which hashes both
//! files too, and an FMU of one variable beside it. Without a C compiler it says so and ends; without a Python that
//! has `fmpy`, `numpy` and `mcap` the loop is left out. There is no limit on any number.

#[path = "../shared/effort.rs"]
#[expect(dead_code, reason = "its pairs are more than the rounds of others")]
mod effort;
#[path = "../../shared/fmus.rs"]
#[expect(dead_code, reason = "needs one Reference-FMU")]
mod fmus;
#[path = "../shared/measure.rs"]
mod measure;
#[path = "../shared/programs.rs"]
mod programs;
#[path = "../../shared/vendor_fmu.rs"]
#[expect(dead_code, reason = "needs the FMU and not its tables")]
mod vendor_fmu;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use tempfile::TempDir;

use effort::shortened;
use measure::{Bystanders, machine, median};
use programs::Programs;
use serde_json::json;

/// Pairs of `hil run` and FMPy's loop.
const PAIRS: usize = 7;
/// Number of times that each FMU is opened.
const OPENINGS: usize = 21;
/// Steps of a run.
const STEPS: u64 = 100_000;
/// Rate of the steps of `Dahlquist`.
const RATE_HZ: f64 = 10.0;

fn main() {
    // `cargo test --all-targets` starts benches too, without this argument.
    if !std::env::args().any(|argument| argument == "--bench") {
        println!("run me with `cargo bench -p tests --bench fmu`");
        return;
    }
    if !fmus::has_compiler() {
        println!("there is no C compiler `cc` here: no FMU can be made");
        return;
    }
    println!("machine: {}\n", machine());
    let programs = Programs::built();
    let folder = TempDir::new().expect("a folder");
    let small = folder.path().join("Dahlquist.fmu");
    fmus::write(&small, &fmus::reference("Dahlquist", 3));
    steps(&programs, folder.path(), &small);
    for version in [2, 3] {
        let large = folder.path().join(format!("vendor{version}.fmu"));
        fmus::write(&large, &vendor_fmu::vendor(version));
        openings(
            &programs,
            &format!("500 variables, FMI {version}.0"),
            &large,
        );
    }
    openings(&programs, "Dahlquist, FMI 3.0", &small);
}

/// Steps in turns with FMPy's loop.
fn steps(programs: &Programs, folder: &Path, fmu: &Path) {
    let steps = shortened(STEPS);
    let duration_s = steps as f64 / RATE_HZ;
    let scenario = folder.join("dahlquist.toml");
    let text = format!(
        "schema = 1\nname = \"dahlquist\"\n[run]\nduration_s = {duration_s:?}\nrate_hz = {RATE_HZ:?}\n\
         [plant]\nmodel = \"Dahlquist\"\nprogram = \"Dahlquist.fmu\"\n[controller]\nlaw = \"hold\"\n"
    );
    std::fs::write(&scenario, text).expect("the folder can be written");
    let scenario = scenario.to_str().expect("a path in UTF-8");
    let python = python();
    let (mut ours_us, mut theirs_us) = (Vec::new(), Vec::new());
    let bystanders = Bystanders::watch();
    for _ in 0..PAIRS {
        let summary = programs.run(&[scenario, "--no-record"]);
        assert_eq!(summary["steps"], steps, "the run is whole: {summary}");
        let wall_s = summary["wall_time_s"].as_f64().expect("a number");
        ours_us.push(wall_s * 1e6 / steps as f64);
        if let Some(python) = &python {
            theirs_us.push(looped_ns(python, fmu, steps) / 1e3);
        }
    }
    let others = 100.0 * bystanders.share();
    println!(
        "a step of Dahlquist, medians of {PAIRS} runs of {steps} steps in turns, other programs took {others:.0} % of the machine"
    );
    let ratios: Vec<f64> = { ours_us.iter().zip(&theirs_us) }
        .map(|(ours, theirs)| ours / theirs)
        .collect();
    show("hil run --no-record", "us", &ours_us);
    if python.is_none() {
        println!("no Python here has fmpy, numpy and mcap: nothing to compare with\n");
        return;
    }
    show("FMPy's loop", "us", &theirs_us);
    show("ratio", "", &ratios);
    let to_fmpy = median(ratios);
    println!(
        "{}\n",
        json!({ "bench": "fmu", "machine": machine(), "to_fmpy": to_fmpy })
    );
}

/// A Python that has FMPy: the machine's, or that of `.ci/run tools`.
fn python() -> Option<PathBuf> {
    let made = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/python/bin/python");
    [PathBuf::from("python3"), made].into_iter().find(|python| {
        let imports = ["-c", "import fmpy, numpy, mcap"];
        let imported = Command::new(python).args(imports).output();
        imported.is_ok_and(|output| output.status.success())
    })
}

/// Time of a step in FMPy's loop, in ns.
fn looped_ns(python: &Path, fmu: &Path, steps: u64) -> f64 {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("python/loop_fmu.py");
    let mut command = Command::new(python);
    command.arg(script).arg(fmu);
    command.args([RATE_HZ.to_string(), steps.to_string()]);
    let told = printed_by(&mut command);
    told.trim().parse().expect("a number")
}

/// Opens an FMU many times, by both programs in turns.
fn openings(programs: &Programs, what: &str, fmu: &Path) {
    let bytes = std::fs::metadata(fmu).expect("it was written").len();
    let host = programs.hil.with_file_name("hil-fmu");
    let (mut described_ms, mut by_hil_ms) = (Vec::new(), Vec::new());
    let bystanders = Bystanders::watch();
    for _ in 0..OPENINGS {
        let mut describe = Command::new(&host);
        describe.arg("plant").arg(fmu).arg("--describe");
        described_ms.push(time_ms(&mut describe));
        let mut describe = Command::new(&programs.hil);
        describe.args(["describe", "--json"]).arg(fmu);
        by_hil_ms.push(time_ms(&mut describe));
    }
    let others = 100.0 * bystanders.share();
    println!(
        "{what}, {:.1} MiB, opened {OPENINGS} times, other programs took {others:.0} % of the machine",
        bytes as f64 / f64::from(1 << 20)
    );
    show("hil-fmu --describe", "ms", &described_ms);
    show("hil describe", "ms", &by_hil_ms);
    println!();
}

fn time_ms(command: &mut Command) -> f64 {
    let started = Instant::now();
    let told = printed_by(command);
    let taken_ms = started.elapsed().as_secs_f64() * 1e3;
    assert!(told.contains("co-simulation"), "{told}");
    taken_ms
}

fn printed_by(command: &mut Command) -> String {
    let output = command.output();
    let output = output.unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {said}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn show(name: &str, unit: &str, values: &[f64]) {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (least, most) = (sorted[0], sorted[sorted.len() - 1]);
    let middle = median(sorted);
    println!("{name:<22} {middle:>7.1} {unit:<2} ({least:.1} to {most:.1})");
}
