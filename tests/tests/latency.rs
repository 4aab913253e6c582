//! `hil latency`, and the same figures of a run: each counts the right number of steps, they are consistent, and
//! nothing is left behind. The duration of a step is never asserted.

use std::collections::BTreeMap;
use std::path::Path;

use hil_session::session::SessionInfo;
use rustix::process::Signal;
use rustix::thread::{CpuSet, sched_getaffinity};
use serde_json::Value;

use crate::clocks::{SCENARIO, busy_for};
use crate::support::harness::{Rig, text, until};
use crate::support::mcap_reader::{Record, Recording};

/// Checks that percentiles increase and none is 0; returns their count and maximum.
#[track_caller]
fn percentiles(figures: &Value) -> (u64, u64) {
    let of = |key: &str| {
        figures[key]
            .as_u64()
            .unwrap_or_else(|| panic!("no {key}: {figures}"))
    };
    let rising = ["p50", "p90", "p99", "p999", "p9999", "max"].map(of);
    assert!(rising.is_sorted() && rising[0] > 0, "{figures}");
    (of("count"), of("max"))
}

/// Returns the cores available to this process and its children.
fn cores() -> Vec<usize> {
    let allowed = sched_getaffinity(None).expect("told");
    let all = 0..CpuSet::MAX_CPU;
    all.filter(|core| allowed.is_set(*core)).collect()
}

/// Checks the invariants of any case; returns the number of its steps.
#[track_caller]
fn case(case: &Value) -> u64 {
    let (steps, longest_ns) = percentiles(&case["round_trip_ns"]);
    for leg in ["exchange_ns", "controller_ns", "sample_ns", "command_ns"] {
        let (count, max_ns) = percentiles(&case[leg]);
        assert_eq!(count, steps, "{leg}");
        assert!(max_ns <= longest_ns, "{leg}");
    }
    for (ratio, to) in [
        ("ratio_p50", "raw_limit_ns"),
        ("ratio_bare_p50", "bare_exchange_ns"),
    ] {
        percentiles(&case[to]);
        let p50 = |figures: &Value| figures["p50"].as_f64().expect("p50");
        let expected = p50(&case["round_trip_ns"]) / p50(&case[to]);
        assert_eq!(case[ratio].as_f64(), Some(expected), "{ratio}");
    }
    let spikes = case["spikes"].as_array().expect("spikes");
    assert_eq!(spikes.len(), 10);
    let of = |spike: &Value, key: &str| spike[key].as_u64().expect("a number");
    assert!(spikes.is_sorted_by_key(|spike| std::cmp::Reverse(of(spike, "round_trip_ns"))));
    assert_eq!(of(&spikes[0], "round_trip_ns"), longest_ns);
    let warm_up = case["warm_up_steps"].as_u64().expect("a number");
    for spike in spikes {
        let step = of(spike, "step");
        assert!((warm_up..warm_up + steps).contains(&step), "{spike}");
    }
    let p9999_ns = case["grade"]["p9999_ns"].as_u64().expect("a grade");
    let grade = match p9999_ns {
        0..20_000 => "excellent",
        20_000..50_000 => "good",
        50_000..=500_000 => "usable",
        _ => "unfit",
    };
    assert_eq!(case["grade"]["grade"], grade, "{p9999_ns} ns");
    steps
}

#[test]
fn every_figure_counts_the_steps_after_the_warm_up_and_no_other() {
    let rig = Rig::new();
    let csv = rig.path("latency.csv");
    let arguments = "latency --json --signals 8,33 --rates max,500 --steps 300 --duration 200ms \
                     --warm-up 50 --csv";
    let mut arguments: Vec<&str> = arguments.split_ascii_whitespace().collect();
    arguments.push(csv.to_str().expect("plain text"));
    let run = rig
        .hil(&arguments)
        .expect(0)
        .says(&["measuring 33 signals"]);
    let report = run.json();

    let cases = report["cases"].as_array().expect("cases");
    let entries: Vec<_> = (cases.iter())
        .map(|case| (case["signals"].as_u64(), case["rate_hz"].as_f64()))
        .collect();
    let expected = [(8, None), (8, Some(500.0)), (33, None), (33, Some(500.0))];
    assert_eq!(
        entries,
        expected.map(|(signals, rate)| (Some(signals), rate))
    );
    for each in cases {
        let paced = each["rate_hz"].is_number();
        assert_eq!(case(each), if paced { 100 } else { 300 });
        assert_eq!(percentiles(&each["raw_limit_ns"]).0, 300);
        assert_eq!(percentiles(&each["bare_exchange_ns"]).0, 300);
        assert_eq!(each["warm_up_steps"], 50);
        if paced {
            assert_eq!(percentiles(&each["release_ns"]).0, 100);
        } else {
            assert!(each["release_ns"].is_null(), "nothing is due in lockstep");
        }
        // A checksum and a header of 12 words, one of validity bits, then room for 16 or 64 numbers.
        let (there, back) = match each["signals"].as_u64() {
            Some(8) => (8 * (12 + 1 + 16), 8 * (12 + 1 + 16)),
            _ => (8 * (12 + 1 + 64), 8 * (12 + 1 + 16)),
        };
        assert_eq!(each["frame_bytes"], serde_json::json!([there, back]));
    }
    // No case has 32 signals: the first stands for all.
    for (key, value) in cases[0].as_object().expect("figures") {
        assert_eq!(report[key], *value, "{key}");
    }
    assert_eq!(report["cores"], serde_json::json!(cores()));
    assert_eq!(report["realtime"]["plant"]["wait"]["asked"], "hybrid");
    assert_eq!(
        report["wait"],
        report["realtime"]["controller"]["wait"]["granted"]
    );

    let csv = std::fs::read_to_string(csv).expect("written");
    let mut lines = csv.lines();
    assert_eq!(
        lines.next(),
        Some("signals,rate_hz,leg,from_ns,to_ns,count")
    );
    let mut counts: BTreeMap<(&str, &str, &str), u64> = BTreeMap::new();
    for line in lines {
        let [signals, rate, leg, from, to, count] = line
            .split(',')
            .collect::<Vec<_>>()
            .try_into()
            .expect("six columns");
        let number = |text: &str| text.parse::<u64>().expect("a number");
        assert!(number(from) < number(to) && number(count) > 0, "{line}");
        *counts.entry((signals, rate, leg)).or_default() += number(count);
    }
    for signals in ["8", "33"] {
        for leg in ["round_trip", "exchange", "controller", "sample", "command"] {
            assert_eq!(counts[&(signals, "max", leg)], 300, "{leg}");
            assert_eq!(counts[&(signals, "500", leg)], 100, "{leg}");
        }
        for limit in ["raw_limit", "bare_exchange"] {
            assert_eq!(counts[&(signals, "", limit)], 300, "{limit}");
        }
    }
}

#[test]
fn table_bars_and_spikes_fit_80_columns() {
    let rig = Rig::new();
    // Both sides on one core, where neither can spin.
    let core = cores().pop().expect("a core").to_string();
    let arguments = "latency --signals 32 --rates max --steps 200 --warm-up 20 --wait spin";
    let mut arguments: Vec<&str> = arguments.split_ascii_whitespace().collect();
    arguments.extend(["--plant-core", &core, "--controller-core", &core]);
    let text = rig.hil(&arguments).expect(0).stdout;
    for expected in [
        format!("\nwait: hybrid; cores: {core}; class: "),
        "\nplant's wait was not granted: ".into(),
        "\ncontroller's wait was not granted: ".into(),
    ] {
        assert!(text.contains(&expected), "no `{expected}` in:\n{text}");
    }
    let (_, table) = text.split_once("\n32 signals").expect("a table");
    let too_wide = table.lines().find(|line| line.chars().count() > 80);
    assert_eq!(too_wide, None, "{text}");
    for part in [
        "raw shared memory",
        "bare iceoryx2",
        "  round trip",
        "times raw",
        "99.99 %",
    ] {
        assert!(table.contains(part), "no `{part}` in:\n{text}");
    }
    let bars = table.lines().filter(|line| line.ends_with('#'));
    let count = |line: &str| line.split_ascii_whitespace().nth(5)?.parse::<u64>().ok();
    assert_eq!(bars.filter_map(count).sum::<u64>(), 200, "{text}");
}

#[test]
fn a_recording_gives_the_latency_of_its_summary() {
    let rig = Rig::new();
    let run = rig
        .run("scenarios/spring-mass.toml --set metrics=[]")
        .expect(0);
    let summary = run.summary();
    let legs = &summary["latency_ns"];
    assert_eq!(percentiles(&legs["round_trip"]).0, summary["steps"]);
    assert!(legs["release"].is_null(), "nothing is due in lockstep");
    assert_eq!(summary["spikes"].as_array().map(Vec::len), Some(10));
    let worst = &summary["spikes"][0];
    assert_eq!(worst["round_trip_ns"], legs["round_trip"]["max"]);
    assert_eq!(legs["plant"]["count"], summary["steps"]);
    assert_eq!(legs["without_command"], 0);
    // One line and no grade: timing was not requested.
    let lines = run.stdout.lines();
    let lines: Vec<&str> = lines
        .skip_while(|line| !line.starts_with("  round trip "))
        .collect();
    assert!(lines[0].ends_with(" max"), "{}", run.stdout);
    assert_eq!(lines[1], "  hybrid waits");

    let folder = run.folder.to_str().expect("plain text");
    let read = |more: &[&str]| -> Value {
        let read = rig.hil(&[&["latency", folder, "--json"], more].concat());
        read.expect(0).json()
    };
    let report = read(&[]);
    for (figure, leg) in [
        ("round_trip_ns", "round_trip"),
        ("exchange_ns", "exchange"),
        ("controller_ns", "controller"),
        ("plant_ns", "plant"),
    ] {
        assert_eq!(report[figure], legs[leg], "{leg}");
    }
    for key in ["spikes", "late_releases", "grade"] {
        assert_eq!(report[key], summary[key], "{key}");
    }
    assert_eq!(report["wait"], summary["realtime"]["wait"]);
    for side in ["plant", "controller"] {
        assert_eq!(report["realtime"][side], summary["realtime"][side]);
    }
    for unknown in ["raw_limit_ns", "bare_exchange_ns", "ratio_p50", "cores"] {
        assert!(report[unknown].is_null(), "{unknown}");
    }
    let page = rig.path("lockstep.html");
    rig.hil(&["report", folder, "-o", text(&page)]).expect(0);
    let page = std::fs::read_to_string(&page).expect("it was written");
    let table = page.split_once("id=\"latency\"").expect("a section").1;
    let (table, _) = table.split_once("</section>").expect("its end");
    assert_eq!(table.matches("<td>round trip</td>").count(), 1);
    for part in ["<td>plant</td>", "by the limits", "The longest round trips"] {
        assert!(!table.contains(part), "{part}");
    }
    let later = read(&["--warm-up", "10"]);
    let steps = summary["steps"].as_u64().expect("a number");
    assert_eq!(later["round_trip_ns"]["count"], steps - 10);
}

/// End of the sentence in a report that grades a run.
const GRADED: &str = "unfit for servo loops, by the limits that are usual in machine control.";

/// Compares figures with the exact order statistics of the same times.
#[track_caller]
fn assert_figures(figures: &Value, mut times_ns: Vec<u64>, leg: &str) {
    times_ns.sort_unstable();
    let count = times_ns.len();
    assert_eq!(figures["count"], count, "{leg}");
    assert_eq!(figures["max"], times_ns[count - 1], "{leg}");
    for (name, share) in [
        ("p50", 0.5),
        ("p90", 0.9),
        ("p99", 0.99),
        ("p999", 0.999),
        ("p9999", 0.9999),
    ] {
        let rank = (share * count as f64).ceil() as usize;
        let exact = times_ns[rank.max(1) - 1];
        let result = figures[name].as_u64().expect("a number");
        let is_within = result >= exact && result as f64 <= exact as f64 * 1.001;
        assert!(
            is_within,
            "{name} of {leg}: {result} ns, exactly {exact} ns"
        );
    }
}

/// Recomputes the latency of a real-time run of 200 steps from its recording; returns the number of steps without a
/// command.
#[track_caller]
fn assert_latency(summary: &Value, recording: &Path) -> usize {
    let recording = Recording::open(recording);
    let records: Vec<Record> = recording.records().collect();
    let column = |name: &str| -> Vec<u64> {
        let place = recording.place(name);
        records.iter().map(|record| record.words[place]).collect()
    };
    let legs = &summary["latency_ns"];
    let steps = records.iter().filter(|record| record.step() < 200).count();
    let answered: Vec<u64> = column("round_trip_ns")
        .into_iter()
        .filter(|ns| *ns > 0)
        .collect();
    let without = steps - answered.len();
    assert_eq!(legs["without_command"], without);
    assert_figures(&legs["round_trip"], answered, "round_trip");
    // The record after the last step was not sent to a controller; that of step 0 has no step before it.
    let late = column("late_ns")[..steps].to_vec();
    let latest = late.iter().max().expect("a step");
    assert_eq!(summary["late_releases"][0]["late_ns"], *latest);
    assert_figures(&legs["release"], late, "release");
    assert_figures(&legs["plant"], column("plant_ns")[1..].to_vec(), "plant");
    without
}

#[test]
fn the_worst_steps_of_a_loaded_real_time_run_count() {
    let rig = Rig::new();
    // The controller is busy for more than two periods at ten steps, the plant for more than one: commands are missed
    // and samples are late.
    let (controller, plant) = (busy_for(12, "controller", 0.2), busy_for(7, "plant", 0.3));
    let scenario = rig.write("loaded.toml", &[SCENARIO, &controller, &plant].concat());
    let run = rig.run(&format!("{} --clock realtime", scenario.display()));
    let run = run.expect(0);
    let summary = run.summary();
    let without = assert_latency(&summary, &run.recording());
    // A busy step of the controller misses no command while the plant catches up, so not every one of the ten counts.
    assert!(without > 0, "no command was missed");
    let latest_ns = summary["late_releases"][0]["late_ns"].as_u64();
    assert!(latest_ns >= Some(2_000_000), "{latest_ns:?}");
    assert_eq!(summary["grade"]["grade"], "unfit");
    for line in [
        format!(", {without} steps without a command: unfit for servo loops\n"),
        "\n  late by ".into(),
        format!("\n  latest: step {}, ", summary["late_releases"][0]["step"]),
    ] {
        assert!(
            run.stdout.contains(&line),
            "no `{line}` in:\n{}",
            run.stdout
        );
    }

    let folder = text(&run.folder);
    let read = rig.hil(&["latency", folder, "--json"]).expect(0).json();
    for (figure, leg) in [
        ("round_trip_ns", "round_trip"),
        ("plant_ns", "plant"),
        ("release_ns", "release"),
    ] {
        assert_eq!(read[figure], summary["latency_ns"][leg], "{leg}");
    }
    assert_eq!(read["without_command"], without);
    for key in ["spikes", "late_releases", "grade"] {
        assert_eq!(read[key], summary[key], "{key}");
    }

    let page = rig.path("loaded.html");
    rig.hil(&["report", folder, "-o", text(&page)]).expect(0);
    let page = std::fs::read_to_string(&page).expect("it was written");
    for part in [GRADED, "The longest round trips", "The latest releases"] {
        assert!(page.contains(part), "{part}");
    }

    // Removes the end of the file, and the summary with it.
    let bytes = std::fs::read(run.recording()).expect("it was written");
    std::fs::write(run.recording(), &bytes[..bytes.len() * 3 / 4]).expect("it is ours");
    std::fs::remove_file(run.folder.join("summary.json")).expect("it is ours");
    rig.hil(&["recover", folder]).expect(0);
    let recovered = std::fs::read_to_string(run.folder.join("summary.json")).expect("a summary");
    let recovered: Value = serde_json::from_str(&recovered).expect("JSON");
    assert_latency(&recovered, &run.recording());
}

#[test]
fn an_interrupted_measurement_leaves_nothing() {
    let rig = Rig::new();
    let running = rig.start_hil(&[
        "latency",
        "--signals",
        "8",
        "--rates",
        "1000",
        "--steps",
        "100",
        "--duration",
        "1000s",
    ]);
    let mut children = Vec::new();
    until("the other process is there", || {
        children = sessions(&rig).flat_map(|info| info.children).collect();
        !children.is_empty()
    });
    running.signal(Signal::INT);
    running.finish().expect(130);
    assert!(children.iter().all(|child| !child.is_alive()));
    assert_eq!(sessions(&rig).count(), 0);
}

/// Lists the sessions of a test.
fn sessions(rig: &Rig) -> impl Iterator<Item = SessionInfo> {
    let folders = std::fs::read_dir(rig.sessions());
    let folders = folders.into_iter().flatten().flatten();
    folders.filter_map(|folder| SessionInfo::read(&folder.path()).ok())
}

#[test]
fn impossible_measurements_are_refused_at_once() {
    let rig = Rig::new();
    for (arguments, fragment) in [
        ("--signals 0", "1 to 512 signals"),
        ("--signals 8,513", "1 to 512 signals"),
        ("--rates fast", "max, or a rate"),
        ("--duration 0", "must be above 0"),
        ("--steps 0", "--steps"),
        ("--plant-core 1000", "cannot be used"),
        ("--wait long", "--wait"),
        ("--csv no/such/folder.csv", "its folder does not exist"),
        ("scenarios", "no recording"),
        ("scenarios --signals 8", "cannot be used with"),
    ] {
        let arguments: Vec<&str> = ["latency"]
            .into_iter()
            .chain(arguments.split(' '))
            .collect();
        let run = rig.hil(&arguments).expect(2).says(&[fragment]);
        assert_eq!(run.stdout, "", "{arguments:?}");
        assert!(!run.stderr.contains("measuring"), "{arguments:?}");
    }
}
