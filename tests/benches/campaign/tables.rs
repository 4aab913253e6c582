//! `collect` and `show` for very many rows, compared with duckdb on the same parts, in turns.
//!
//! The rows are made up and published as workers publish theirs: readers do not depend on the content of a case.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use hil_campaign::folder::Folder;
use hil_campaign::manifest::{MANIFEST, Manifest};
use hil_campaign::shard::{Shard, missing};
use hil_campaign::table::{Cell, Column, ColumnKind, Row};
use serde_json::Value;
use shared_types::random::RandomStream;

use super::{Desk, LOOK, ROUNDS, measure, scenario};

/// Cases of a shard.
const SHARD: u64 = 15_625;

/// Measures both programs at N rows.
pub(super) fn measure(desk: &Desk, rows: u64) {
    let Some(python) = python() else {
        println!("no python3 with duckdb: collect and show are not compared");
        return;
    };
    let folder = desk.planned("tables", &study(100), &[]);
    let folder = fill(Path::new(&folder), rows);
    for verb in ["collect", "show"] {
        let (mut ours, mut theirs) = (Vec::new(), Vec::new());
        let mut memory = [0_u64; 2];
        for _ in 0..ROUNDS {
            let (time_s, memory_mb, told) = run(&mut desk.campaign(&[verb, &folder, "--json"]));
            ours.push(time_s);
            memory[0] = memory[0].max(memory_mb);
            let mut duckdb = Command::new(&python);
            let script = concat!(env!("CARGO_MANIFEST_DIR"), "/python/campaign_duckdb.py");
            let answer = run(duckdb.args([script, verb, &folder])).2;
            theirs.push(answer["s"].as_f64().expect("a time"));
            memory[1] = memory[1].max(answer["memory_mb"].as_u64().expect("a size"));
            if verb == "show" {
                let variant = &told["variants"][0];
                assert_eq!(variant["passes"]["count"], answer["pass"]);
                let worst = &variant["requirements"][0]["worst"][0]["case"];
                assert_eq!(*worst, answer["worst"]);
            }
        }
        let ratios = ours.iter().zip(&theirs).map(|(ours, theirs)| ours / theirs);
        let ratio = measure::median(ratios);
        let [ours, theirs] = [ours, theirs].map(measure::median);
        println!(
            "{verb} {rows} rows: hil {ours:.2} s and {} MB, duckdb {theirs:.2} s and {} MB, ratio {ratio:.2}",
            memory[0], memory[1]
        );
    }
}

/// A study of the teaching run cut to ten steps, with two values and one requirement.
fn study(cases: u64) -> String {
    format!(
        "schema = 1\nscenario = \"{}\"\ncases = {cases}\n\
         set = [\"run.duration_s=0.01\", \"stimuli[0].at_s=0\", \"metrics=[]\", \
         'requirements=[{{name=\"stays\", formula=\"always(abs(truth.position_m) < 1)\"}}]']\n\
         [[vary]]\nkey = \"plant.parameters.mass_kg\"\nkind = \"uniform\"\nmin = 0.5\nmax = 2\n\
         [[vary]]\nkey = \"plant.parameters.stiffness_n_per_m\"\nkind = \"uniform\"\nmin = 50\nmax = 200\n",
        scenario("spring-mass.toml")
    )
}

/// Turns a planned campaign into one of N cases, and publishes a row for each.
fn fill(path: &Path, rows: u64) -> String {
    let mut manifest = Manifest::read(path).expect("a campaign");
    let study = study(rows);
    manifest.cases = rows;
    manifest.shard_cases = SHARD;
    manifest.curves = None;
    manifest.study.blake3 = blake3::hash(study.as_bytes()).to_hex().to_string();
    std::fs::write(path.join(&manifest.study.path), study).expect("written");
    let text = serde_json::to_vec(&manifest).expect("JSON");
    std::fs::write(path.join(MANIFEST), text).expect("written");
    let folder = Folder::open(path).expect("a campaign");
    let mut random = RandomStream::new(1, "rows");
    for number in missing(&folder) {
        let shard = Shard::of(&folder, number);
        let mut attempt = shard.attempt().expect("an attempt");
        for case in shard.cases() {
            let row = row(case, &folder.manifest().columns, &mut random);
            attempt.row(row, 1e-3, None).expect("noted");
        }
        attempt.publish().expect("published");
    }
    path.to_str().expect("a path in UTF-8").to_owned()
}

/// Makes up the row of a case.
fn row(case: u64, columns: &[Column], random: &mut RandomStream) -> Row {
    let margin = random.uniform() - 0.2;
    let cell = |column: &Column| match (&*column.name, column.kind) {
        ("case" | "draw", _) => Cell::Count(case),
        ("seed", _) => Cell::Count((random.uniform() * (1_u64 << 53) as f64) as u64),
        (_, ColumnKind::Count) => Cell::Count(10),
        ("variant", _) => Cell::Text("scenario".into()),
        ("reason", _) => Cell::Text(String::new()),
        ("digest", _) => Cell::Text(
            (0..4)
                .map(|_| format!("{:016x}", random.uniform().to_bits()))
                .collect(),
        ),
        (_, ColumnKind::Text) => Cell::Text(if margin < 0.0 { "fail" } else { "pass" }.into()),
        (name, ColumnKind::Number) if name.starts_with("robustness.") => Cell::number(margin),
        (_, ColumnKind::Number) => Cell::number(random.uniform()),
    };
    columns.iter().map(cell).collect()
}

/// Runs a program; returns its time in s, its peak resident memory in MB and its output.
fn run(command: &mut Command) -> (f64, u64, Value) {
    let began = Instant::now();
    let output = tempfile::NamedTempFile::new().expect("a file");
    let file = output.reopen().expect("a file");
    let mut child = command
        .stdout(file)
        .stderr(Stdio::inherit())
        .spawn()
        .expect("a program");
    let mut memory_kb = 0_u64;
    let status = loop {
        if let Some(status) = child.try_wait().expect("a child") {
            break status;
        }
        let status = std::fs::read_to_string(format!("/proc/{}/status", child.id()));
        let status = status.unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let seen = line.and_then(|line| line.split_whitespace().next()?.parse().ok());
        memory_kb = seen.unwrap_or(memory_kb);
        std::thread::sleep(LOOK);
    };
    let time_s = began.elapsed().as_secs_f64();
    assert!(status.success(), "{command:?}: {status}");
    let text = std::fs::read_to_string(output.path()).expect("an answer");
    let answer = serde_json::from_str(&text).expect("JSON");
    (time_s, memory_kb / 1000, answer)
}

/// Finds a Python with duckdb: the machine's, or the one that tests made.
fn python() -> Option<PathBuf> {
    let own = std::env::current_exe().expect("a path to this program");
    let target = own
        .ancestors()
        .nth(3)
        .expect("it lies in target/release/deps");
    let all = ["python3".into(), target.join("python/bin/python")];
    all.into_iter().find(|python: &PathBuf| {
        let imported = Command::new(python)
            .args(["-c", "import duckdb"])
            .stderr(Stdio::null())
            .status();
        imported.is_ok_and(|status| status.success())
    })
}
