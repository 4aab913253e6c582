//! `hil report`: the content of the page, checked by independent readers, and its rendering in a real browser.
//!
//! The expected content comes from the recording, read without the reporter's code, and from the run's
//! `summary.json`. The browser is a headless Chromium; without one its tests say so and pass, unless
//! `HIL_TEST_CHROMIUM=1` demands it.

pub(crate) mod accessible;
mod axes;
mod bands;
pub(crate) mod browser;
mod closer;
mod figures;
mod first_screen;
mod numbers;
pub(crate) mod page;

use std::path::PathBuf;

use serde_json::Value;

use crate::support::harness::{Rig, Run};
use crate::support::mcap_reader::Recording;
use crate::support::programs::shipped;
use page::Page;

const LEAKAGE: &str = "tests/scenarios/leakage.toml";
/// The teaching run at 1 kHz for 10 s with a one-step spike on its sensor.
const SPIKE: &str = "
[[faults]]
kind = \"spike\"
at_s = 6.789
effects = [{ target = \"measured.position_m\", amplitude = 0.5 }]

[[requirements]]
name = \"stays_in_reach\"
formula = \"always[1s,9s](abs(truth.position_m) < 0.4)\"

[[requirements]]
name = \"sensor_and_truth\"
formula = \"always(measured.position_m - truth.position_m < 0.1)\"

[[requirements]]
name = \"one_of_two\"
formula = \"always(not measured.position_m > 0.3 and truth.position_m > -2)\"
";

fn spike_scenario(rig: &Rig) -> PathBuf {
    let text = shipped("scenarios/spring-mass.toml");
    let text = text.replace("duration_s = 5.0", "duration_s = 10.0");
    rig.write("spike.toml", &(text + SPIKE))
}

#[test]
fn a_step_that_decided_has_the_command_that_reaches_it_from_a_checkpoint() {
    let rig = Rig::new();
    let made = rig.run("scenarios/spring-mass.toml --checkpoint-at 0.4 --checkpoint-at 4.6");
    let made = made.expect(0);
    let none = rig.run("scenarios/spring-mass.toml").expect(0);
    let report = |run: &Run| {
        let (path, output) = (run.folder.display().to_string(), rig.path("report.html"));
        let output = output.display().to_string();
        rig.hil(&["report", &path, "-o", &output, "--force"])
            .expect(0);
        std::fs::read_to_string(&output).expect("the page")
    };
    let page = report(&made);
    let summary = made.summary();
    let requirements = summary["requirements"].as_array().expect("requirements");
    let mut count = 0;
    for at_s in requirements.iter().filter_map(|one| one["at_s"].as_f64()) {
        let step = match at_s {
            0.4..4.6 => 400,
            4.6.. => 4600,
            _ => continue,
        };
        count += 1;
        let folder = made.folder.join(format!("checkpoint-{step}"));
        let line = format!(
            "hil run --from {} --pause-at {at_s} --panel<",
            folder.display()
        );
        assert!(page.contains(&line), "{line}");
    }
    assert!(count > 0, "{summary}");
    assert_eq!(page.matches("hil run --from").count(), count);
    assert_eq!(report(&none).matches("hil run --from").count(), 0);
}

#[test]
fn every_bucket_has_the_extremes_of_its_records() {
    let rig = Rig::new();
    let run = rig.run(LEAKAGE).expect(0);
    let page = Page::of(&rig, &[&run], &[]);
    let starts_s = page.grid();
    let recording = Recording::open(&run.recording());
    for name in [
        "truth.force_fight_n",
        "command.actuator1_valve_current_a",
        "internal.lyapunov_v3",
        "sensed.surface_angle_rad",
    ] {
        let mut expected = vec![[f32::NAN; 2]; starts_s.len()];
        for record in recording.records() {
            let time_s = record.step() as f64 / 10_000.0;
            let bucket = starts_s.partition_point(|start_s| *start_s < time_s + 1e-9) - 1;
            let value = recording.value(&record, name) as f32;
            if !value.is_nan() {
                let [least, greatest] = expected[bucket];
                expected[bucket] = [
                    if least < value { least } else { value },
                    if greatest > value { greatest } else { value },
                ];
            }
        }
        let (least, greatest) = page.envelope(0, name);
        assert_eq!(
            (least.len(), greatest.len()),
            (starts_s.len(), starts_s.len())
        );
        for (bucket, expected) in expected.iter().enumerate() {
            let text = [least[bucket], greatest[bucket]].map(f32::to_bits);
            assert_eq!(text, expected.map(f32::to_bits), "{name}, bucket {bucket}");
        }
    }
    // Around the fault a bucket is one step.
    let near = starts_s
        .iter()
        .filter(|start_s| (**start_s - 1.0).abs() < 0.01045);
    assert_eq!(near.count(), 209, "steps -104 to 104");
}

#[test]
fn a_page_agrees_with_the_summary_and_marks_the_origin_of_each_margin() {
    let rig = Rig::new();
    let scenario = spike_scenario(&rig);
    let run = rig.run(scenario.to_str().expect("text")).expect(1);
    let summary = run.summary();
    let page = Page::of(&rig, &[&run], &[]);
    let digest = summary["digest"].as_str().expect("a digest");
    assert!(
        page.text.contains(&format!("title=\"{digest}\""))
            && page.text.contains("recomputed: equal")
    );
    for requirement in summary["requirements"].as_array().expect("requirements") {
        let name = requirement["name"].as_str().expect("a name");
        let at_s = requirement["at_s"].as_f64().expect("a time");
        let at = format!("data-requirement=\"{name}\" data-run=\"0\" data-at=\"{at_s}\"");
        assert!(page.text.contains(&at), "{at}");
    }
    // 0.5 m are added to the sensor at step 6789: the margin against 0.1 m is -0.4 m.
    let sides = page.plot(&["measured.position_m - truth.position_m"]);
    assert_eq!(sides["limits"][0]["level"], 0.1);
    let mark = &sides["marks"][0];
    assert_eq!(
        (&mark["holds"], &mark["at_s"]),
        (&Value::Bool(false), &6.789.into())
    );
    let value = mark["decisive"][0].as_f64().expect("a value");
    assert!((value - 0.5).abs() < 1e-9, "{value}");
    // The other comparison has 2 m left, so it is not marked.
    let both = page.plot(&["truth.position_m", "measured.position_m"]);
    let marks: Vec<&Value> = (both["marks"].as_array().expect("marks").iter())
        .filter(|mark| mark["requirement"] == "one_of_two")
        .collect();
    let recording = Recording::open(&run.recording());
    let record = recording.records().find(|record| record.step() == 6789);
    let sensed = recording.value(&record.expect("a record"), "measured.position_m");
    let [mark] = marks[..] else {
        panic!("{marks:?}");
    };
    assert_eq!(mark["signal"], "measured.position_m");
    assert_eq!(mark["decisive"], serde_json::json!([sensed, 0.3]));
    // A magnitude has two limits, in the time in which they apply.
    let reach = page.plot(&["reference.position_m", "truth.position_m"]);
    let limits: Vec<_> = (reach["limits"].as_array().expect("limits").iter())
        .filter(|limit| limit["requirement"] == "stays_in_reach")
        .map(|limit| [&limit["level"], &limit["from_s"], &limit["until_s"]].map(|one| one.as_f64()))
        .collect();
    assert_eq!(
        limits,
        [
            [Some(0.4), Some(1.0), Some(9.0)],
            [Some(-0.4), Some(1.0), Some(9.0)]
        ]
    );
    assert_eq!(page.data["runs"][0]["faults"][0]["from_s"], 6.789);
    page.plot(&["truth.position_m", "measured.position_m"]);
    let facts = &Recording::open(&run.recording()).metadata()["hil.run"];
    assert!(
        facts.keys().any(|name| name.starts_with("doctor_")) && facts.contains_key("hil_commit")
    );
    for (name, fact) in facts {
        let escape = |text: String, (from, to): (char, &str)| text.replace(from, to);
        let escapes = [
            ('&', "&amp;"),
            ('<', "&lt;"),
            ('>', "&gt;"),
            ('"', "&quot;"),
        ];
        let escaped = escapes.into_iter().fold(fact.clone(), escape);
        assert!(page.text.contains(&escaped), "{name}: {fact}");
    }
    for text in ["software in the loop", "duration_s = 10.0"] {
        assert!(page.text.contains(text), "{text}");
    }
}

#[test]
fn a_page_loads_nothing_and_escapes_texts_of_a_recording() {
    let rig = Rig::new();
    let scenario = spike_scenario(&rig);
    let text = std::fs::read_to_string(&scenario).expect("a scenario");
    let text = text.replace(
        "description = \"",
        "description = \"</script><script>alert(1)</script><img src=x onerror=alert(2)> ",
    );
    let scenario = rig.write("hostile.toml", &text);
    let run = rig.run(scenario.to_str().expect("text")).expect(1);
    let page = Page::of(&rig, &[&run], &[]);
    assert!(page.text.contains("&lt;img src=x"));
    let rest = page.text.replace("&lt;img src=x", "");
    for loads in [
        "<img",
        "<link",
        "src=",
        "@import",
        "url(",
        "alert(1)</script>",
    ] {
        assert!(!rest.contains(loads), "{loads}");
    }
    // Addresses: the home page of uPlot in a comment, and the name of a namespace.
    let addresses = rest.matches("http://").count() + rest.matches("https://").count();
    assert_eq!(addresses, 2);
    assert!(page.text.contains("default-src 'none'"));
}

#[test]
fn several_runs_are_overlaid_and_distinguishable() {
    let rig = Rig::new();
    let runs = ["pid", "nrsc", "ftsc"].map(|law| {
        rig.run(&format!("scenarios/severe-leakage.toml --set run.duration_s=8 --set requirements=[] --set metrics=[] --set controller.law={law}")).expect(0)
    });
    let page = Page::of(&rig, &[&runs[0], &runs[1], &runs[2]], &[]);
    let labels: Vec<&Value> = (0..3).map(|run| &page.data["runs"][run]["label"]).collect();
    assert_eq!(labels, ["pid", "nrsc", "ftsc"]);
    let figures: Vec<&str> = (page.plots().iter())
        .filter_map(|plot| {
            plot["title"]
                .as_str()
                .filter(|title| title.starts_with("Figure"))
        })
        .map(|title| title.split(':').next().expect("a number"))
        .collect();
    assert_eq!(
        figures,
        [
            "Figure 3", "Figure 4", "Figure 5", "Figure 6", "Figure 6", "Figure 7", "Figure 7"
        ]
    );
    let bound = page.plot(&["internal.lyapunov_v3", "internal.lyapunov_bound"]);
    assert_eq!(
        (&bound["runs"], &bound["log"]),
        (&serde_json::json!([1, 2]), &Value::Bool(true))
    );
    // The same run three times needs numbers.
    let page = Page::of(&rig, &[&runs[0], &runs[0]], &[]);
    let labels: Vec<&Value> = (0..2).map(|run| &page.data["runs"][run]["label"]).collect();
    assert_eq!(labels, ["1 pid", "2 pid"]);
}

#[test]
fn a_change_of_the_controller_is_in_title_label_plots_and_published_figures() {
    let rig = Rig::new();
    let run = rig.start("scenarios/severe-leakage.toml --set requirements=[] --pause-at 7.5");
    rig.until_held_at(75_000);
    rig.in_session("controller swap --set controller.law=nrsc")
        .expect(0);
    rig.in_session("resume").expect(0);
    let run = run.finish().expect(0);
    // The paper's Tables 3 and 4: of the first law until 7 s, of the second one from 15 s on, and of neither from 7
    // to 8 s.
    let published = |text: &str, window: &str| {
        let lines = text.lines().filter(|line| line.contains(window));
        let lines = lines.filter(|line| line.contains("max_abs_"));
        let figures = lines.map(|line| {
            let (head, _) = line.split_once(" (Table")?;
            head.split_ascii_whitespace().last()?.parse::<f64>().ok()
        });
        figures.collect::<Vec<_>>()
    };
    let judged = rig
        .hil(&["judge", run.folder.to_str().expect("text")])
        .expect(0);
    for text in [&run.stdout, &judged.stdout] {
        assert_eq!(published(text, " 0 to 7 "), [Some(2.4546e-4), Some(133.97)]);
        assert_eq!(published(text, " 7 to 8 "), [None, None]);
        assert_eq!(published(text, " 15 to 20 "), [Some(1.8e-3), Some(8175.9)]);
    }
    let laws = "ftsc, nrsc from 7.5 s";
    assert!(
        run.stdout.contains(&format!("({laws} on drhas")),
        "{}",
        run.stdout
    );

    let page = Page::of(&rig, &[&run], &[]);
    assert_eq!(page.data["runs"][0]["label"], laws);
    let title = format!("<title>severe-leakage: {laws}</title>");
    assert!(page.text.contains(&title));
    let change =
        serde_json::json!([{"label": "controller 2: nrsc", "from_s": 7.5, "until_s": 7.5}]);
    assert_eq!(page.data["runs"][0]["changes"], change);
    assert_eq!(page.text.matches("(Table 3)").count(), 2);
    assert_eq!(page.text.matches("(Table 4)").count(), 2);
}

#[test]
fn impossible_reports_are_refused_with_the_reason() {
    let rig = Rig::new();
    let run = rig.run("scenarios/spring-mass.toml").expect(0);
    let folder = run.folder.to_str().expect("text");
    let path = rig.write("there.html", "mine");
    let there = path.to_str().expect("text");
    rig.hil(&["report", folder, "-o", there])
        .expect(2)
        .says(&["already exists", "--force"]);
    assert_eq!(std::fs::read_to_string(&path).expect("it is there"), "mine");
    rig.hil(&[
        "report",
        folder,
        "-o",
        there,
        "--force",
        "--signal",
        "truth.positon_m",
    ])
    .expect(2)
    .says(&[
        "no run has a signal `truth.positon_m`",
        "nearest: `truth.position_m`",
    ]);
    rig.hil(&["report", folder, "-o", "/dev/full"])
        .expect(3)
        .says(&["No space left"]);
    rig.hil(&["report", "none", "-o", there, "--force"])
        .expect(2)
        .says(&["none"]);
    rig.hil(&["report"]).expect(2);
    rig.hil(&[&["report"], &[folder; 9][..]].concat())
        .expect(2)
        .says(&["at most 8"]);
    let unrecorded = rig.run("scenarios/spring-mass.toml --no-record").expect(0);
    let unrecorded = unrecorded.folder.to_str().expect("text");
    rig.hil(&["report", unrecorded, "-o", there, "--force"])
        .expect(2)
        .says(&["--no-record"]);
    let report = rig
        .hil(&["report", folder, "-o", there, "--force", "--json"])
        .expect(0)
        .json();
    let bytes = std::fs::metadata(&path).expect("it is there").len();
    assert_eq!(
        (&report["file"], report["bytes"].as_u64()),
        (&there.into(), Some(bytes))
    );
}

#[test]
fn aborted_and_partial_runs_are_shown_as_far_as_possible() {
    let rig = Rig::new();
    // The shaft is pushed out of its range of validity.
    let run = rig
        .run("scenarios/spring-mass.toml --set plant.limits.position_m=[-1,0.005]")
        .expect(1);
    let page = Page::of(&rig, &[&run], &[]);
    assert!(page.text.contains("data-verdict=\"aborted\"") && page.text.contains("position_m"));
    let excerpt = rig
        .run("scenarios/spring-mass.toml --record truth.* --record-every 10")
        .expect(0);
    let page = Page::of(&rig, &[&excerpt], &[]);
    assert!(page.text.contains("an excerpt") && page.text.contains("data-verdict=\"pass\""));
    page.plot(&["truth.position_m"]);
    // Several chunks, one closed every 100 ms.
    let damaged = rig
        .run("scenarios/spring-mass.toml --compression none --clock paced")
        .expect(0);
    let whole = std::fs::read(damaged.recording()).expect("a recording");
    let middle = whole.len() / 2;
    // One bit of one byte is flipped: part of the shown data was never recorded.
    let mut bytes = whole.clone();
    bytes[middle] ^= 1;
    std::fs::write(damaged.recording(), &bytes).expect("it can be written");
    let (page, output) = Page::with_exit(&rig, &[&damaged, &excerpt], &[], 2);
    let path = damaged.recording();
    let path = path.to_str().expect("text");
    assert!(
        output.contains("error: ") && output.contains(path),
        "{output}"
    );
    assert!(output.contains("damaged at byte"), "{output}");
    let (_, runs) = page
        .text
        .split_once("<section id=\"runs\">")
        .expect("the runs");
    let (_, verdict) = runs.split_once("data-verdict=\"").expect("a verdict");
    assert!(!verdict.starts_with("pass"), "whatever the bit was part of");
    assert!(page.text.contains("damaged") || page.text.contains("differs from the recorded one"));
    // Truncated there.
    std::fs::write(damaged.recording(), &whole[..middle]).expect("it can be written");
    let (page, output) = Page::with_exit(&rig, &[&damaged], &[], 0);
    assert!(output.contains("hil recover "), "{output}");
    assert!(
        page.text.contains("was cut off after") && page.text.contains("data-verdict=\"aborted\"")
    );
}
