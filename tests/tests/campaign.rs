//! Campaigns: each case runs once and has the digest of a separate run, however workers end.

mod damage;
mod engines;
mod every_fault;
mod growth;
mod leaks;
mod mistakes;
mod outcomes;
mod own;
mod page;
mod sensitivity;
mod slurm;
mod trust;

use std::io::Write as _;
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::process::Command;

use rustix::process::Signal;
use serde_json::Value;

use crate::support::harness::{Rig, Run, names, send, text, until};
use crate::support::programs::{program, skip, workspace};
use crate::support::python::{python, succeeds};

/// Study of the teaching run: some masses and springs, under a law that fails and one that passes.
pub(crate) const STUDY: &str = r#"
schema = 1
scenario = "SCENARIO"
cases = 30
seed = 3
set = ["plant.substeps=4"]

[[vary]]
key = "plant.parameters.mass_kg"
kind = "normal"
mean = 1.0
deviation = 0.3
min = 0.2
max = 3.0

[[vary]]
key = "plant.parameters.stiffness_n_per_m"
kind = "uniform"
min = 50
max = 200

[[vary]]
name = "frequency"
kind = "expression"
expression = "sqrt(stiffness_n_per_m / mass_kg)"

[[variants]]
name = "pid"

[[variants]]
name = "hold"
set = ["controller.law=hold"]
"#;

/// Writes a study of the shipped scenario.
pub(crate) fn study(rig: &Rig, text: &str) -> PathBuf {
    let scenario = workspace().join("scenarios/spring-mass.toml");
    let scenario = scenario.to_str().expect("plain text");
    rig.write("demo.toml", &text.replace("SCENARIO", scenario))
}

/// Planned campaign, in the test's folder.
pub(crate) struct Planned<'r> {
    rig: &'r Rig,
    folder: PathBuf,
}

impl<'r> Planned<'r> {
    /// Plans a campaign of [`STUDY`].
    fn demo(rig: &'r Rig) -> Self {
        planned(rig, &study(rig, STUDY), "demo")
    }

    /// Plans and runs a campaign of [`STUDY`].
    fn completed(rig: &'r Rig) -> Self {
        let demo = Self::demo(rig);
        demo.on("run").expect(0);
        demo
    }

    /// Runs `hil campaign` with a verb, this folder, and options separated by spaces.
    fn on(&self, line: &str) -> Run {
        let mut words = line.split(' ');
        let verb = words.next().unwrap_or_default();
        let options: Vec<&str> = words.collect();
        campaign(self.rig, &[&[verb, text(self)], &options[..]].concat())
    }

    /// Returns the digest of the complete campaign.
    fn digest(&self) -> String {
        let collected = self.on("collect --json").expect(0).json();
        collected["digest"].as_str().expect("a digest").to_owned()
    }
}

impl Deref for Planned<'_> {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.folder
    }
}

/// Plans a campaign in the test's folder.
pub(crate) fn planned<'r>(rig: &'r Rig, study: &Path, name: &str) -> Planned<'r> {
    let folder = rig.path(name);
    rig.hil(&["campaign", "plan", text(study), "-o", text(&folder)])
        .expect(0);
    Planned { rig, folder }
}

fn campaign(rig: &Rig, arguments: &[&str]) -> Run {
    rig.hil(&[&["campaign"], arguments].concat())
}

#[test]
fn any_number_of_workers_gives_one_digest_even_if_some_are_killed() {
    let rig = Rig::new();
    let study = study(&rig, STUDY);
    let one = planned(&rig, &study, "one");
    one.on("run --jobs 1").expect(0);
    let expected = one.digest();

    let three = planned(&rig, &study, "three");
    for signal in [Signal::KILL, Signal::INT, Signal::KILL] {
        let running = rig.start_hil(&["campaign", "run", text(&three), "--jobs", "3"]);
        let before = done(&rig, &three);
        until("a case is done", || {
            done(&rig, &three) > before || before == 60
        });
        running.signal(signal);
        running.finish_beside_another();
        until("the workers are gone", || rig.processes().is_empty());
    }
    three.on("run --jobs 3").expect(0);
    assert_eq!(three.digest(), expected);
    let [of_one, of_three] = [&one, &three].map(|folder| page::data(&rig, folder));
    assert_eq!(of_one["envelopes"], of_three["envelopes"]);
    let status = three.on("status --json").expect(0).json();
    assert_eq!(
        (&status["published"], &status["missing"]),
        (&60.into(), &0.into())
    );
    for entry in std::fs::read_dir(three.join("shards")).expect("shards") {
        let left = names(&entry.expect("a shard").path());
        let required = ["claim", "curves.json", "part.parquet"];
        assert_eq!(left, required.map(String::from).into());
    }
}

/// Counts cases with a result.
fn done(rig: &Rig, folder: &Path) -> u64 {
    let run = rig.beside(&["campaign", "status", text(folder), "--json"]);
    let status = run.json();
    let count = |name: &str| status[name].as_u64().expect("a count");
    count("published") + count("begun")
}

#[test]
fn a_case_equals_the_run_of_its_values_in_one_process_and_in_two() {
    let rig = Rig::new();
    let demo = Planned::completed(&rig);
    // The shown scenario needs nothing of the campaign.
    let view = demo.on("case 4 --show").expect(0);
    let scenario = rig.write("case.toml", &view.stdout);
    let alone = rig.run(text(&scenario)).expect(0);
    for flags in [&[][..], &["--in-process"]] {
        let out = rig.path(&format!("case{}", flags.len()));
        let mut arguments = vec!["case", text(&demo), "4", "--json", "--out", text(&out)];
        arguments.extend(flags);
        let run = campaign(&rig, &arguments)
            .expect(0)
            .says(&["reproduced the campaign's digest"]);
        assert_eq!(run.json()["digest"], alone.digest());
        assert!(out.join("run.mcap").exists());
    }
    // The planned programs run, regardless of how hil is called, of programs beside it and of the environment.
    let broken = demo.join("programs/plant-process");
    let plant = std::fs::read(&broken).expect("a copy");
    let mut other = plant.clone();
    other.push(0);
    std::fs::write(&broken, other).expect("written");
    demo.on("case 4")
        .expect(2)
        .says(&["programs/plant-process has hash"]);
    std::fs::write(&broken, plant).expect("written");
    let out = rig.path("named");
    let arguments = [
        "campaign",
        "case",
        text(&demo),
        "4",
        "--json",
        "--out",
        text(&out),
    ];
    let other = rig.path("hil");
    std::fs::copy(program("hil"), &other).expect("copied");
    let mut file = std::fs::File::options()
        .append(true)
        .open(&other)
        .expect("a copy");
    file.write_all(b"another").expect("written");
    drop(file);
    let wrong = rig.script("wrong", "#!/bin/sh\nexit 9\n");
    let mut hil = rig.command(other);
    hil.args(arguments).env("HIL_PLANT_BIN", wrong);
    let run = rig.program(hil).expect(0);
    assert_eq!(run.json()["digest"], alone.digest());
    // A failing case has the exit code of a failing run.
    campaign(
        &rig,
        &[
            "case",
            text(&demo),
            "5",
            "--in-process",
            "--out",
            text(&rig.path("five")),
        ],
    )
    .expect(1);
}

#[test]
fn a_second_result_that_differs_ends_with_exit_code_1() {
    let rig = Rig::new();
    let demo = Planned::completed(&rig);
    let conflict =
        r#"{"case": 7, "column": "digest", "first": "a", "second": "b", "by": "a test"}"#;
    std::fs::write(demo.join("conflicts/000000007-0.json"), conflict).expect("written");
    for verb in ["run", "collect", "show", "status"] {
        let run = demo.on(verb).expect(1);
        let output = run.stdout + &run.stderr;
        assert!(
            output.contains("case 7 has two different results: digest is a, but b from a test"),
            "{verb}: {output}"
        );
    }
    campaign(&rig, &["compare", text(&demo), text(&demo)])
        .expect(1)
        .says(&["case 7 has two different results"]);
}

/// Lists files below a folder, with their times.
fn below(folder: &Path) -> Vec<(PathBuf, std::time::SystemTime)> {
    let mut entries = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        match path.is_dir() {
            true => entries.extend(below(&path)),
            false => {
                let file = path.metadata().expect("a file");
                entries.push((path, file.modified().expect("a time")));
            }
        }
    }
    entries.sort();
    entries
}

#[test]
fn reading_a_campaign_writes_nothing_into_its_folder() {
    let rig = Rig::new();
    let demo = Planned::completed(&rig);
    for table in ["results.parquet", "circumstances.parquet"] {
        std::fs::remove_file(demo.join(table)).expect("a table");
    }
    let page = rig.path("page.html");
    let content = || below(&demo);
    let before = content();
    demo.on("show").expect(0);
    campaign(&rig, &["compare", text(&demo), text(&demo)]).expect(0);
    demo.on("status").expect(0);
    rig.hil(&["report", text(&demo), "-o", text(&page)])
        .expect(0);
    assert_eq!(content(), before);
    demo.on("collect").expect(0);
    assert_ne!(content(), before);
}

#[test]
fn the_bounds_of_goals_decide_the_exit_code() {
    let rig = Rig::new();
    // All 30 pass: 0.05^(1/30) = 0.9050 is shown at 95 %.
    for (probability, code) in [(0.90, 0), (0.91, 1)] {
        let goal = format!("{STUDY}\n[[goals]]\nvariant = \"pid\"\nprobability = {probability}\n");
        let folder = planned(&rig, &study(&rig, &goal), &format!("goal{code}"));
        let run = folder.on("run --json").expect(code);
        let answers = run.json();
        let lower = answers["goals"][0]["lower"].as_f64().expect("a bound");
        assert!((lower - 0.904_966_147).abs() < 1e-9, "{lower}");
        let passes = &answers["variants"][0]["passes"];
        assert_eq!((&passes["count"], &passes["of"]), (&30.into(), &30.into()));
        // 0.025^(1/30) = 0.8843: each of two bounds has half of the risk, even if all pass.
        let lower = passes["bounds"]["lower"].as_f64().expect("a bound");
        assert!((lower - 0.884_296_692).abs() < 1e-9, "{lower}");
        assert_eq!(passes["bounds"]["sided"], "both");
        assert_eq!(answers["variants"][1]["classes"][1], 30);
    }
    // A grid is not a sample.
    let grid = "schema = 1\nscenario = \"SCENARIO\"\nsampling = \"grid\"\n[[vary]]\nkey = \"plant.parameters.mass_kg\"\nkind = \"grid\"\nmin = 0.5\nmax = 2\npoints = 3\n";
    let folder = planned(&rig, &study(&rig, grid), "grid");
    let run = folder.on("run --json").expect(0);
    assert_eq!(run.json()["variants"][0]["passes"]["bounds"], Value::Null);
}

#[test]
fn a_margin_that_varies_by_rounding_correlates_with_nothing() {
    let rig = Rig::new();
    let demo = Planned::completed(&rig);
    let answers = demo.on("show --json").expect(0);
    let answers = answers.json();
    // Each loop has settled to a tenth of a millionth of the limit; its speed depends on the plant.
    let [settles, answers_the_step] =
        [0, 1].map(|place| &answers["variants"][0]["requirements"][place]);
    assert_eq!(settles["is_rounding"], true, "{settles}");
    assert_eq!(settles["correlations"], Value::Array(Vec::new()));
    assert_eq!(answers_the_step["is_rounding"], false);
    let strongest = answers_the_step["correlations"][0][1].as_f64();
    assert!(strongest < Some(-0.8), "{answers_the_step}");
    let table = demo.on("show").expect(0).stdout;
    assert_eq!(
        table.matches("varies by rounding only").count(),
        1,
        "{table}"
    );
}

#[test]
fn an_unfinished_campaign_reports_no_probability_and_says_why() {
    let rig = Rig::new();
    let demo = Planned::demo(&rig);
    demo.on("work --shards 0-3").expect(0);
    for verb in ["collect", "show"] {
        demo.on(verb)
            .expect(3)
            .says(&["of 60 cases have no result", "slow cases come last"]);
    }
    let run = demo.on("collect --partial --json").expect(3);
    assert_eq!(run.json()["digest"], Value::Null);
    // Tasks of other engines work on the rest.
    for part in ["0/2", "1/2"] {
        campaign(&rig, &["work", text(&demo), "--task", part]).expect(0);
    }
    demo.on("show").expect(0);
}

/// Plans a campaign that takes longer than it takes to interrupt it.
fn long(rig: &Rig) -> Planned<'_> {
    let many = STUDY.replace("cases = 30", "cases = 500");
    planned(rig, &study(rig, &many), "long")
}

#[test]
fn status_and_show_count_the_same_cases_without_a_result() {
    let rig = Rig::new();
    let demo = long(&rig);
    let running = rig.start_hil(&["campaign", "run", text(&demo), "--jobs", "1"]);
    until("a case is done", || done(&rig, &demo) > 0);
    running.signal(Signal::INT);
    running.finish_beside_another();
    let status = demo.on("status --json").expect(0).json();
    let missing = &status["missing"];
    demo.on("show")
        .expect(3)
        .says(&[&format!("{missing} of 1000 cases have no result")]);
}

#[test]
fn a_worker_that_ctrl_c_reaches_first_is_not_said_to_have_died() {
    let rig = Rig::new();
    let demo = long(&rig);
    let running = rig.start_hil(&["campaign", "run", text(&demo), "--jobs", "1"]);
    until("a case is done", || done(&rig, &demo) > 0);
    send(running.pid(), Signal::STOP);
    running.signal(Signal::INT);
    until("the worker is gone", || rig.processes().len() == 1);
    send(running.pid(), Signal::CONT);
    let run = running.finish_beside_another().expect(130);
    let run = run.says(&["interrupted; hil campaign run", "continues"]);
    assert!(!run.stderr.contains("died"), "{}", run.stderr);
}

#[test]
fn a_damaged_result_is_set_aside_and_recomputed() {
    let rig = Rig::new();
    let demo = Planned::completed(&rig);
    let expected = demo.digest();
    let part = demo.join("shards/00000002/part.parquet");
    let damage = || {
        let mut bytes = std::fs::read(&part).expect("a part");
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(&part, bytes).expect("written");
    };
    damage();
    // Read-only commands report it and leave it in place.
    demo.on("show")
        .expect(3)
        .says(&["shard 2", "its checksum does not match"]);
    demo.on("collect").expect(3).says(&["shard 2", "set aside"]);
    demo.on("run").expect(0);
    assert_eq!(demo.digest(), expected);
    // One run finds it, sets it aside and recomputes it.
    damage();
    demo.on("run").expect(0).says(&["shard 2", "set aside"]);
    assert_eq!(demo.digest(), expected);
}

#[test]
fn campaigns_are_compared_case_by_case() {
    let rig = Rig::new();
    // The passing loop is given an impossible requirement.
    let hard = STUDY.replace(
        "name = \"pid\"",
        "name = \"pid\"\nset = [\"requirements[0].formula=always[0s,5s](abs(truth.position_m) < 1e-9)\"]",
    );
    let [a, b] = [("a", STUDY), ("b", &hard)].map(|(name, varied)| {
        let folder = planned(&rig, &study(&rig, varied), name);
        folder.on("run").expect(0);
        folder
    });
    let same = campaign(&rig, &["compare", text(&a), text(&a), "--json"])
        .expect(0)
        .json();
    assert_eq!(
        (&same[0]["p"], &same[0]["cases"]),
        (&1.0.into(), &30.into())
    );
    let flipped = campaign(&rig, &["compare", text(&a), text(&b), "--json"])
        .expect(1)
        .json();
    assert_eq!(flipped[0]["first_only"].as_array().map(Vec::len), Some(30));
    assert_eq!(flipped[1]["first_only"].as_array().map(Vec::len), Some(0));
    // All 30 flipped one way: 2 / 2^30.
    let p = flipped[0]["p"].as_f64().expect("a number");
    assert!((p * f64::from(1 << 29) - 1.0).abs() < 1e-9, "{p}");
    let other = STUDY.replace("seed = 3", "seed = 4");
    let folder = planned(&rig, &study(&rig, &other), "other");
    folder.on("run").expect(0);
    campaign(&rig, &["compare", text(&a), text(&folder)])
        .expect(2)
        .says(&["only campaigns on the same draws"]);
}

#[test]
fn duckdb_polars_and_pandas_read_the_tables_with_equal_counts() {
    let Some(python) = python("duckdb, polars, pandas, pyarrow") else {
        let why = "python3 with duckdb, polars, pandas and pyarrow is missing";
        return skip(why, "HIL_TEST_PYTHON");
    };
    let rig = Rig::new();
    let demo = Planned::demo(&rig);
    let run = demo.on("run --json").expect(0);
    let script = workspace().join("tests/python/campaign_tables.py");
    let output = succeeds(Command::new(python).arg(script).arg(&*demo));
    let output: Value = serde_json::from_str(&output).expect("JSON");
    for reader in ["duckdb", "polars", "pandas"] {
        assert_eq!(output[reader]["rows"], 60, "{reader}");
        for variant in run.json()["variants"].as_array().expect("variants") {
            let name = variant["name"].as_str().expect("a name");
            assert_eq!(
                output[reader]["pass"][name], variant["passes"]["count"],
                "{reader}"
            );
            assert_eq!(
                output[reader]["worst"][name], variant["requirements"][0]["worst"][0]["margin"],
                "{reader}"
            );
        }
    }
}
