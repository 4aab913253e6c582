//! What the table of the cursors measures in a headless Chromium, compared with the records.

use shared_types::extremes::larger;

use super::browser::{Play, assert_drawn, begun};
use super::closer::{assert_near, played, range};
use super::{SCENARIO, heavy};
use crate::support::harness::{Rig, Run};
use crate::support::mcap_reader::Recording;
use crate::support::programs::shipped;

/// Returns the numbers of a signal in a copied table.
fn figures(text: &str, name: &str) -> Vec<f64> {
    let row = text.lines().find(|line| line.starts_with(name));
    let row = row.unwrap_or_else(|| panic!("no {name} in {text}"));
    let numbers = row.split('\t').skip(2).map(|cell| cell.parse());
    numbers.map(|number| number.unwrap_or(f64::NAN)).collect()
}

/// Returns value at both ends, difference, mean, RMS, peak to peak, least and greatest value.
fn expected(part: &[f64]) -> [f64; 8] {
    let count = part.len() as f64;
    let (first, last) = (part[0], part[part.len() - 1]);
    let least = part.iter().copied().min_by(f64::total_cmp).expect("some");
    let greatest = part.iter().copied().max_by(f64::total_cmp).expect("some");
    let mean = part.iter().sum::<f64>() / count;
    let rms = (part.iter().map(|value| value * value).sum::<f64>() / count).sqrt();
    let height = greatest - least;
    [
        first,
        last,
        last - first,
        mean,
        rms,
        height,
        least,
        greatest,
    ]
}

fn assert_figures(text: &str, name: &str, part: &[f64]) {
    let figures = figures(text, name);
    let expected = expected(part);
    assert_eq!(figures.len(), 8, "{text}");
    for (figure, expected) in figures.iter().zip(expected) {
        let tolerance = 1e-12 * expected.abs() + 1e-18;
        assert!(
            (figure - expected).abs() <= tolerance,
            "{figures:?} {expected:?}"
        );
    }
}

#[test]
fn two_cursors_measure_every_step_and_give_a_requirement_that_holds() {
    let rig = Rig::new();
    let run = rig.run(SCENARIO).expect(0);
    let Some(output) = played(&rig, &run, "cursors", &[]) else {
        return;
    };
    let text = |key: &str| {
        output[key]
            .as_str()
            .unwrap_or_else(|| panic!("no {key}: {output}"))
    };
    assert!(text("single").contains("at A") && !text("single").contains("mean"));
    let clicked = ["0", "1"].map(|nth| {
        let nth: usize = nth.parse().expect("a place");
        output["clicked"][nth]
            .as_str()
            .expect("a time")
            .parse::<f64>()
            .expect("a number")
    });
    assert_near(clicked, [1.0, 2.0], 0.02);
    assert!(
        text("table").contains("B - A: 0.5 s, 1/(B - A): 2 Hz"),
        "{output}"
    );
    assert!(text("table").contains("from every step (501)"), "{output}");
    assert_eq!(text("clipboard").trim_end(), text("text").trim_end());
    let recording = Recording::open(&run.recording());
    for name in ["truth.position_m", "command.force_n"] {
        assert_figures(
            text("clipboard"),
            name,
            &recording.column(name)[1250..=1750],
        );
    }
    assert_eq!(output["cleared"], true);

    // Pasted into the scenario, the requirement is valid, holds, and has no margin left.
    let requirement = text("requirement");
    let scenario = rig.write(
        "pasted.toml",
        &format!("{}\n{requirement}", shipped(SCENARIO)),
    );
    let path = scenario.to_str().expect("text");
    rig.hil(&["config", "check", path]).expect(0);
    let judged = rig.run(path).expect(0);
    let requirements = judged.summary()["requirements"].clone();
    let pasted = &requirements.as_array().expect("requirements")[2];
    assert_eq!(pasted["name"], "truth_position_m_1_25s_to_1_75s");
    assert_eq!(
        (&pasted["verdict"], &pasted["robustness"]),
        (&"pass".into(), &0.0.into())
    );
}

/// Returns the ends of what a legend reads, in SI units.
fn legend_range(text: &str) -> [f64; 2] {
    let (numbers, unit) = text.rsplit_once(' ').expect("a unit");
    let factor = match unit {
        "m" => 1.0,
        "mm" => 1e-3,
        _ => panic!("{text}"),
    };
    let (low, high) = numbers.split_once(" to ").unwrap_or((numbers, numbers));
    [low, high].map(|number| factor * number.parse::<f64>().expect("a number"))
}

#[test]
fn a_legend_reads_the_stretch_in_which_a_cursor_at_the_pointer_stands() {
    let rig = Rig::new();
    let run = rig.run(SCENARIO).expect(0);
    let Some(output) = played(&rig, &run, "pointer", &[]) else {
        return;
    };
    let column = Recording::open(&run.recording()).column("truth.position_m");
    let length = usize::try_from(output["length"].as_u64().expect("steps")).expect("small");
    assert!(length > 4, "{output}");
    for read in output["read"].as_array().expect("readings") {
        let [time, legend] = [0, 1].map(|nth| read[nth].as_str().expect("text"));
        let step = (1000.0 * time.parse::<f64>().expect("a time")).round() as usize;
        let begin = step / length * length;
        let stretch = expected(&column[begin..(begin + length).min(column.len())]);
        let least_greatest = [stretch[6], stretch[7]];
        // Five digits are written.
        let room = 1e-4 * larger(least_greatest[0].abs(), least_greatest[1].abs());
        for (end, expected) in legend_range(legend).iter().zip(least_greatest) {
            assert!(
                (end - expected).abs() <= room,
                "{legend} at {time}: {least_greatest:?}"
            );
        }
    }
}

#[test]
fn a_held_run_is_looked_back_at_and_measured_from_what_its_panel_kept() {
    let rig = Rig::new();
    // So slow that a panel without a core of its own sees every step.
    let (run, panel) = begun(&rig, "--pace 1", &[]);
    let Some(play) = Play::closer("back", &panel.url) else {
        return;
    };
    let output = play.result();
    assert_drawn(&output["ink"]);
    let range = range(&output["range"]);
    assert!(range[1] - range[0] < 1.2, "{output}");
    let length = output["read"][0].as_u64().expect("steps");
    assert!((1..=4).contains(&length), "{output}");
    assert_eq!(output["followed"], "");
    assert_eq!(output["basis"], "from every step (501)");
    drop(panel);
    rig.in_session("resume").expect(0);
    let run = run.finish().expect(0);
    let recording = Recording::open(&run.recording());
    let text = output["text"].as_str().expect("text");
    let name = "truth.position_m";
    assert_figures(text, name, &recording.column(name)[1250..=1750]);
}

#[test]
fn another_run_is_drawn_behind_the_curves_and_its_difference_is_read() {
    let rig = Rig::new();
    let run = rig.run(SCENARIO).expect(0);
    let heavy = heavy(&rig);
    let over = heavy.folder.to_str().expect("text").to_owned();
    let Some(output) = played(&rig, &run, "ghost", &["--over", &over]) else {
        return;
    };
    assert!(output["over"].as_str().expect("text").ends_with(&over));
    assert!(output["ink"].as_u64() > Some(100), "{output}");
    let value = |run: &Run| Recording::open(&run.recording()).column("truth.position_m")[600];
    let (own, other) = (value(&run), value(&heavy));
    let text = output["text"].as_str().expect("text");
    assert_ne!(own, other);
    assert_eq!(figures(text, "truth.position_m"), [own, other, own - other]);
    assert_eq!([&output["wide"], &output["narrow"]], [false, true]);
    assert_eq!(output["differ"][0], "Where the runs first differ");
    let compare = output["compare"].as_str().expect("text");
    assert!(
        compare.starts_with("hil compare ") && compare.contains(&over),
        "{output}"
    );
}
