//! Bench `campaign`: what does a campaign add to the cost of its runs?
//!
//! `cargo bench -p tests --bench campaign` compares, in turns, the paper's severe leakage in a campaign of one
//! worker with the same number of plain in-process runs without a recording, on one core; two workers with two such workers on
//! folders of their own; and prints the time of a case of ten steps, built in and with programs of its own, the
//! memory of a worker after some and after very many cases, and the time to collect and to show a million rows
//! beside duckdb; and 1,000 evaluations, as searches make them, with the same cases of a campaign. `-- ROWS` takes
//! another number than 100,000 cases and 1,000,000 rows, `-- tables [ROWS]` and `-- evaluations [CASES]` do that part
//! alone. Medians; there is no limit on any number.

mod evaluations;
#[path = "../shared/measure.rs"]
#[expect(dead_code, reason = "needs the machine and a median")]
mod measure;
#[path = "../shared/programs.rs"]
#[expect(dead_code, reason = "starts campaigns, not runs")]
mod programs;
mod tables;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use hil_session::realtime::pin;
use tempfile::TempDir;

/// Rounds; the results are medians over them.
const ROUNDS: usize = 5;
/// Cases of the paper's run in a round.
const CASES: u64 = 16;
/// Cases of the worker whose memory is observed.
const ROWS: u64 = 100_000;
/// Rows to collect and show.
const TABLE_ROWS: u64 = 1_000_000;
/// Evaluations that are compared with the cases of a campaign.
const EVALUATIONS: u64 = 1000;
/// Cases that run with programs of their own.
const OWN: u64 = 2000;
/// Interval between two samples of a worker's memory.
const LOOK: Duration = Duration::from_millis(20);

fn main() -> std::process::ExitCode {
    // `cargo test --all-targets` starts benches too, without this argument.
    if std::env::args().any(|argument| argument == "--bench") {
        println!("machine: {}\n", measure::machine());
        let desk = Desk::new();
        let rows = std::env::args().find_map(|one| one.parse().ok());
        if std::env::args().any(|argument| argument == "tables") {
            tables::measure(&desk, rows.unwrap_or(TABLE_ROWS));
            return std::process::ExitCode::SUCCESS;
        }
        if std::env::args().any(|argument| argument == "evaluations") {
            evaluations::compare(&desk, rows.unwrap_or(EVALUATIONS));
            return std::process::ExitCode::SUCCESS;
        }
        // On one core: a plain run has a thread for its recorder, a case of a campaign has none.
        let on_one_core = || {
            pin(0).expect("a core");
            desk.overhead();
        };
        std::thread::scope(|scope| scope.spawn(on_one_core).join()).expect("measured");
        desk.two_workers();
        evaluations::compare(&desk, EVALUATIONS);
        desk.short_cases();
        desk.many(rows.unwrap_or(ROWS));
        tables::measure(&desk, rows.unwrap_or(TABLE_ROWS));
    } else {
        println!("run me with `cargo bench -p tests --bench campaign`");
    }
    std::process::ExitCode::SUCCESS
}

struct Desk {
    hil: PathBuf,
    folder: TempDir,
}

fn scenario(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../scenarios")
        .join(name);
    path.to_str().expect("a path in UTF-8").to_owned()
}

/// A study of the teaching run cut to ten steps, without metrics or requirements.
fn short(cases: u64) -> String {
    format!(
        "schema = 1\nscenario = \"{}\"\ncases = {cases}\n\
         set = [\"run.duration_s=0.01\", \"stimuli[0].at_s=0\", \"metrics=[]\", \"requirements=[]\"]\n\
         [[vary]]\nkey = \"plant.parameters.mass_kg\"\nkind = \"uniform\"\nmin = 0.5\nmax = 2\n",
        scenario("spring-mass.toml")
    )
}

/// A study of the paper's run, whose cases differ only in their seeds.
fn severe(cases: u64) -> String {
    format!(
        "schema = 1\nscenario = \"{}\"\ncases = {cases}\n",
        scenario("severe-leakage.toml")
    )
}

impl Desk {
    fn new() -> Self {
        Self {
            hil: programs::Programs::built().hil,
            folder: TempDir::new().expect("a folder"),
        }
    }

    fn campaign(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(&self.hil);
        command
            .arg("campaign")
            .args(arguments)
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        command
    }

    /// Plans a campaign in a new folder.
    fn planned(&self, name: &str, study: &str, more: &[&str]) -> String {
        let file = self.folder.path().join("study.toml");
        fs::write(&file, study).expect("written");
        let folder = self.folder.path().join(name);
        let _ = fs::remove_dir_all(&folder); // of the round before
        let folder = folder.to_str().expect("a path in UTF-8").to_owned();
        let mut plan = self.campaign(&["plan", file.to_str().expect("UTF-8"), "-o", &folder]);
        ended(plan.args(more).spawn().expect("hil"));
        folder
    }

    fn overhead(&self) {
        let (mut campaign, mut plain) = (Vec::new(), Vec::new());
        for round in 0..ROUNDS {
            let folder = self.planned("severe", &severe(CASES), &[]);
            campaign.push(time_s(&mut self.campaign(&["work", &folder])));
            let out = self.folder.path().join(format!("plain{round}"));
            let mut runs = Command::new(&self.hil);
            runs.args([
                "run",
                &scenario("severe-leakage.toml"),
                "--link",
                "in-process",
                "--no-record",
            ]);
            runs.args(["--jobs", "1", "--repeat", &CASES.to_string(), "--out"])
                .arg(out);
            plain.push(time_s(runs.stdout(Stdio::null()).stderr(Stdio::null())));
        }
        let each = |times: Vec<f64>| measure::median(times) / CASES as f64;
        let (campaign, plain) = (each(campaign), each(plain));
        println!(
            "{:<52} {:>9.1} ms",
            "severe leakage, a case of a campaign",
            campaign * 1e3
        );
        println!(
            "{:<52} {:>9.1} ms",
            "severe leakage, a plain run in process",
            plain * 1e3
        );
        println!(
            "{:<52} {:>9.2}",
            "campaign over plain, time",
            campaign / plain
        );
    }

    fn two_workers(&self) {
        let (mut together, mut apart) = (Vec::new(), Vec::new());
        for _ in 0..ROUNDS {
            let one = self.planned("together", &severe(2 * CASES), &[]);
            together.push(two_s([(&one, "0/2"), (&one, "1/2")], self));
            let [a, b] = ["a", "b"].map(|name| self.planned(name, &severe(CASES), &[]));
            apart.push(two_s([(&a, "0/1"), (&b, "0/1")], self));
        }
        let [together, apart] = [together, apart].map(measure::median);
        println!(
            "{:<52} {:>9.2}",
            "two workers on a folder over two on their own, speed",
            apart / together
        );
    }

    fn short_cases(&self) {
        let folder = self.planned("short", &short(5000), &[]);
        let time = time_s(&mut self.campaign(&["work", &folder])) / 5000.0;
        println!(
            "{:<52} {:>9.2} ms",
            "a case of 10 steps, built in",
            time * 1e3
        );
        let beside = |name: &str| {
            self.hil
                .with_file_name(name)
                .to_str()
                .expect("UTF-8")
                .to_owned()
        };
        let (plant, controller) = (beside("plant-process"), beside("controller-process"));
        let own = ["--plant-bin", &plant, "--controller-bin", &controller];
        let folder = self.planned("own", &short(OWN), &own);
        let time = time_s(&mut self.campaign(&["work", &folder])) / OWN as f64;
        println!(
            "{:<52} {:>9.2} ms",
            "a case of 10 steps, programs of its own",
            time * 1e3
        );
    }

    /// Memory over very many cases.
    fn many(&self, rows: u64) {
        let folder = self.planned("many", &short(rows), &[]);
        let mut worker = self
            .campaign(&["work", &folder, "--task", "0/1"])
            .spawn()
            .expect("hil");
        let mut seen: Vec<u64> = Vec::new();
        while matches!(worker.try_wait(), Ok(None)) {
            seen.extend(resident_kb(worker.id()));
            std::thread::sleep(LOOK);
        }
        let part = |from: usize, to: usize| {
            let some = &seen[seen.len() * from / 10..seen.len() * to / 10];
            measure::median(some.iter().map(|kb| *kb as f64)) / 1e3
        };
        println!(
            "{:<52} {:>9.1} MB",
            "a worker after a tenth of the cases",
            part(1, 2)
        );
        println!(
            "{:<52} {:>9.1} MB",
            "a worker at the last tenth",
            part(9, 10)
        );
    }
}

/// Returns the time until both workers have finished.
fn two_s(work: [(&String, &str); 2], desk: &Desk) -> f64 {
    let started = Instant::now();
    let workers = work.map(|(folder, task)| {
        let mut worker = desk.campaign(&["work", folder, "--task", task]);
        worker.spawn().expect("hil")
    });
    workers.into_iter().for_each(ended);
    started.elapsed().as_secs_f64()
}

fn time_s(command: &mut Command) -> f64 {
    let started = Instant::now();
    ended(command.spawn().expect("hil"));
    started.elapsed().as_secs_f64()
}

fn ended(mut child: Child) {
    let status = child.wait().expect("a child");
    assert!(status.success(), "{status}");
}

/// Returns the resident memory of a running process in kB.
fn resident_kb(process: u32) -> Option<u64> {
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.split_whitespace().next()?.parse().ok()
}
