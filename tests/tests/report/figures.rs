//! `hil report --figures`: what the files show, read without the code that draws, against the recording and numpy.

mod kinds;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

use crate::support::harness::{Rig, Run};
use crate::support::mcap_reader::Recording;
use crate::support::programs::{program, shipped, skip, works};
use crate::support::python::succeeds;

const LEAKAGE: &str = "tests/scenarios/leakage.toml";

/// Writes the figures of runs to a folder.
fn drawn(rig: &Rig, runs: &[&Run], folder: &str, options: &[&str]) -> Run {
    let folder = rig.path(folder);
    let runs = runs.iter().map(|run| run.folder.to_str().expect("text"));
    let mut arguments = vec!["report"];
    arguments.extend(runs);
    arguments.extend(["--figures", folder.to_str().expect("text")]);
    arguments.extend(options);
    rig.hil(&arguments)
}

/// Returns the files of a folder by name.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(folder).expect("a folder");
    let files = entries.map(|entry| {
        let path = entry.expect("an entry").path();
        let name = path.file_name().expect("a name").to_string_lossy().into();
        (name, fs::read(path).expect("a file"))
    });
    files.collect()
}

fn text(path: &Path) -> String {
    fs::read_to_string(path).expect("text")
}

/// Returns an attribute of an element.
fn attribute<'a>(element: &'a str, name: &str) -> &'a str {
    let (_, rest) = element
        .split_once(&format!(" {name}=\""))
        .expect("an attribute");
    rest.split_once('"').expect("its end").0
}

/// Returns the elements with this name, each with its content.
fn elements<'a>(svg: &'a str, name: &str) -> Vec<&'a str> {
    svg.split(&format!("<{name} ")).skip(1).collect()
}

/// Returns the texts of a figure.
fn texts(svg: &str) -> Vec<String> {
    let texts = elements(svg, "text").into_iter();
    let content = texts.map(|text| text.split_once('>').expect("content").1);
    content
        .map(|text| text.split_once("</text>").expect("its end").0.to_owned())
        .collect()
}

/// Returns value and height in the figure of each tick of the vertical axis.
fn ticks(svg: &str) -> Vec<[f64; 2]> {
    let ends = elements(svg, "text").into_iter();
    let ends = ends.filter(|text| text.contains("text-anchor=\"end\""));
    let tick = |text: &str| {
        let (_, value) = text.split_once('>').expect("content");
        let value = value.split_once('<').expect("its end").0.replace('−', "-");
        // The base line of a text lies below its tick by 0.36 of the font's size.
        let height = attribute(&format!(" {text}"), "y")
            .parse::<f64>()
            .expect("a number")
            - 0.36 * 7.0;
        [value.parse().expect("a number"), height]
    };
    ends.map(tick).collect()
}

/// Returns the points of all lines that a panel clips.
fn curves(svg: &str) -> Vec<Vec<[f64; 2]>> {
    let lines = elements(svg, "path").into_iter();
    let clipped = lines.filter(|line| line.contains("clip-path="));
    let points = |line: &str| {
        let commands = attribute(line, "d").split(['M', 'L']).skip(1);
        let point = |command: &str| {
            let (x, y) = command.split_once(' ').expect("two numbers");
            [x, y].map(|one| one.parse().expect("a number"))
        };
        commands.map(point).collect()
    };
    clipped.map(points).collect()
}

#[test]
fn figures_have_titles_with_units_their_fonts_and_the_same_bytes_every_time() {
    let rig = Rig::new();
    let run = rig.run(LEAKAGE).expect(0);
    let all = [
        "--signal",
        "truth.force_fight_n",
        "--signal",
        "truth.actuator1_pressure*_pa",
    ];
    let json = drawn(&rig, &[&run], "first", &[&all[..], &["--json"]].concat())
        .expect(0)
        .json();
    drawn(&rig, &[&run], "again", &all).expect(0);
    let first = files(&rig.path("first"));
    assert_eq!(first, files(&rig.path("again")), "the same bytes");
    let names: Vec<&str> = first.keys().map(String::as_str).collect();
    let figures = json["figures"].as_array().expect("figures");
    assert_eq!(names.len(), 2 * figures.len() + 1, "{names:?}");
    let svg = text(&rig.path("first/truth-force_fight_n.svg"));
    assert!(svg.contains("width=\"85mm\"") && svg.contains("url(data:font/ttf;base64,"));
    let words = texts(&svg);
    for expected in ["Time [s]", "leakage"] {
        assert!(
            words.iter().any(|text| text == expected),
            "{expected} in {words:?}"
        );
    }
    assert!(words.iter().any(|text| text.ends_with("[N]")), "{words:?}");
    let pressures = texts(&text(&rig.path("first/truth-actuator_pressure_pa.svg")));
    assert!(
        pressures.iter().any(|text| text.ends_with("[MPa]")),
        "{pressures:?}"
    );
    assert!(!svg.contains("href") && !svg.contains("http://fonts"));

    let pdf = rig.path("first/truth-force_fight_n.pdf");
    if !works(&["pdffonts", "-v"]) {
        return skip("poppler-utils are not installed", "HIL_TEST_POPPLER");
    }
    let fonts = succeeds(Command::new("pdffonts").arg(&pdf));
    let line = fonts.lines().nth(2).expect("a font");
    assert!(
        line.contains("Arimo") && line.contains("yes yes yes"),
        "{fonts}"
    );
    let words = succeeds(
        Command::new("pdftotext")
            .args(["-layout"])
            .arg(&pdf)
            .arg("-"),
    );
    assert!(
        words.contains("Time [s]") && words.contains("leakage"),
        "{words}"
    );
    let size = succeeds(Command::new("pdfinfo").arg(&pdf));
    assert!(size.contains("240.9"), "85 mm are 240.9 pt: {size}");
}

#[test]
fn a_curve_has_the_extremes_of_its_records() {
    let rig = Rig::new();
    let run = rig.run(LEAKAGE).expect(0);
    drawn(
        &rig,
        &[&run],
        "figures",
        &["--signal", "truth.force_fight_n"],
    )
    .expect(0);
    let svg = text(&rig.path("figures/truth-force_fight_n.svg"));
    let ticks = ticks(&svg);
    let [[v0, y0], .., [v1, y1]] = ticks[..] else {
        panic!("{ticks:?}");
    };
    let value = |y: f64| v0 + (y - y0) * (v1 - v0) / (y1 - y0);
    // Hundredths of a point.
    let rounding = 0.02 * ((v1 - v0) / (y1 - y0)).abs();
    let curves = curves(&svg);
    let curve = curves
        .iter()
        .max_by_key(|curve| curve.len())
        .expect("a curve");
    let recorded = Recording::open(&run.recording()).column("truth.force_fight_n");
    let extremes = |values: &mut dyn Iterator<Item = f64>| {
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], one| {
            [
                if one < low { one } else { low },
                if one > high { one } else { high },
            ]
        })
    };
    let actual = extremes(&mut curve.iter().map(|[_, y]| value(*y)));
    let expected = extremes(&mut recorded.into_iter());
    for (actual, expected) in actual.into_iter().zip(expected) {
        assert!(
            (actual - expected).abs() < rounding,
            "{actual}, not {expected}"
        );
    }
}

#[test]
fn limits_are_named_once_and_several_runs_are_told_apart_without_colour() {
    let rig = Rig::new();
    let scenario = rig.write(
        "limited.toml",
        &(shipped("scenarios/spring-mass.toml")
            + "\n[[requirements]]\nname = \"stays_in_reach\"\nformula = \"always(abs(truth.position_m) < 0.012)\"\n"),
    );
    let line = scenario.to_str().expect("text");
    let run = rig.run(line).expect(0);
    let other = rig.run(&format!(
        "{line} --set controller.pid.proportional_n_per_m=200"
    ));
    drawn(&rig, &[&run, &other], "figures", &["--width", "6in"]).expect(0);
    let svg = text(&rig.path("figures/position-wanted-and-true.svg"));
    assert!(svg.contains("width=\"152.4mm\""));
    let words = texts(&svg);
    let named: Vec<&String> = words
        .iter()
        .filter(|text| text.contains("stays_in_reach"))
        .collect();
    assert_eq!(named, ["±12 mm: stays_in_reach"]);
    let samples = elements(&svg, "path").into_iter();
    let samples = samples
        .filter(|line| !line.contains("clip-path=") && line.contains("stroke-width=\"0.9\""));
    let mut dashes: Vec<&str> = samples
        .map(|line| match line.contains("stroke-dasharray") {
            true => attribute(line, "stroke-dasharray"),
            false => "solid",
        })
        .collect();
    dashes.sort_unstable();
    dashes.dedup();
    assert_eq!(dashes.len(), 4, "two signals of two runs: {dashes:?}");
}

#[test]
fn a_shared_limit_is_named_once_and_no_name_is_cut_in_a_narrow_figure() {
    let rig = Rig::new();
    let requirements = ["stays_within_its_reach", "keeps_off_the_end_stops", "near"].map(|name| {
        format!("\n[[requirements]]\nname = \"{name}\"\nformula = \"always(abs(truth.position_m) < 0.012)\"\n")
    });
    let scenario = shipped("scenarios/spring-mass.toml") + &requirements.concat();
    let scenario = rig.write("shared.toml", &scenario);
    let run = rig.run(scenario.to_str().expect("text")).expect(0);
    let limit = "±12 mm: stays_within_its_reach, keeps_off_the_end_stops, near";
    drawn(&rig, &[&run], "wide", &["--width", "160mm"]).expect(0);
    let words = texts(&text(&rig.path("wide/position-wanted-and-true.svg")));
    let named: Vec<&String> = words.iter().filter(|one| one.contains("±12 mm")).collect();
    assert_eq!(named, [limit]);
    drawn(&rig, &[&run], "narrow", &["--width", "40mm"]).expect(0);
    let words = texts(&text(&rig.path("narrow/position-wanted-and-true.svg")));
    assert!(words.iter().all(|one| !one.contains('…')), "{words:?}");
    let all = words.concat().replace(' ', "");
    assert!(all.contains(&limit.replace(' ', "")), "{words:?}");
}

#[test]
fn files_of_different_plots_differ_in_more_than_capitals() {
    let rig = Rig::new();
    let plot = |title: &str, name: &str| {
        format!("\n[[plots]]\ntitle = \"{title}\"\n{name}signals = [\"truth.position_m\"]\n")
    };
    let plots = [
        plot("first", "name = \"A\"\n"),
        plot("second", "name = \"a\"\n"),
        plot("Ω", ""),
        plot("ω", ""),
        plot("力", ""),
    ];
    let scenario = shipped("scenarios/spring-mass.toml") + &plots.concat();
    let scenario = rig.write("names.toml", &scenario);
    let run = rig.run(scenario.to_str().expect("text")).expect(0);
    drawn(&rig, &[&run], "figures", &[]).expect(0);
    let mut names: Vec<String> = files(&rig.path("figures")).into_keys().collect();
    for name in ["A", "a-2", "omega", "omega-2", "u529b"] {
        assert!(names.contains(&format!("{name}.pdf")), "{name}: {names:?}");
    }
    names
        .iter_mut()
        .for_each(|name| name.make_ascii_lowercase());
    let count = names.len();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), count);
}

#[test]
fn what_cannot_be_drawn_or_written_is_refused_with_its_reason() {
    let rig = Rig::new();
    let run = rig.run("scenarios/spring-mass.toml").expect(0);
    drawn(&rig, &[&run], "figures", &[]).expect(0);
    let before = files(&rig.path("figures"));
    drawn(&rig, &[&run], "figures", &[])
        .expect(2)
        .says(&["already exists; --force overwrites it"]);
    drawn(&rig, &[&run], "figures", &["--force"]).expect(0);
    assert_eq!(before, files(&rig.path("figures")));
    rig.write("in-the-way", "");
    drawn(&rig, &[&run], "in-the-way", &[])
        .expect(2)
        .says(&["cannot create", "in-the-way"]);
    drawn(&rig, &[&run], "x", &["--signal", "truth.positon_m"])
        .expect(2)
        .says(&["no run has a signal `truth.positon_m`", "truth.position_m"]);
    drawn(&rig, &[&run], "x", &["--width", "85"])
        .expect(2)
        .says(&["85mm"]);
    drawn(&rig, &[&run], "x", &["-o", "page.html"])
        .expect(2)
        .says(&["cannot be used with"]);
    assert!(!rig.path("x").exists());
    let unrecorded = rig.path("nothing");
    fs::create_dir(&unrecorded).expect("a folder");
    let folder = unrecorded.to_str().expect("text");
    rig.hil(&["report", folder, "--figures", "y"])
        .expect(2)
        .says(&["nothing"]);

    // An excerpt has fewer signals than its scenario's plots name.
    let part = rig.run("scenarios/spring-mass.toml --record command.force_n");
    let part = part.expect(0);
    drawn(&rig, &[&part], "part", &[]).expect(2).says(&[
        "no figure `Position, wanted and true`",
        "reference.position_m, truth.position_m were not recorded",
    ]);
    assert!(rig.path("part/force.pdf").exists());
    assert!(!rig.path("part/position-wanted-and-true.pdf").exists());
}

#[test]
fn a_full_disk_leaves_no_half_figure() {
    if !works(&["unshare", "-m", "mount", "-t", "tmpfs", "tmpfs", "/mnt"]) {
        return skip("this user may not mount anything", "HIL_TEST_UNSHARE");
    }
    let rig = Rig::new();
    let run = rig.run("scenarios/spring-mass.toml").expect(0);
    let room = rig.path("room");
    fs::create_dir(&room).expect("a folder");
    let script = "set -e\nmount -t tmpfs -o size=64k tmpfs \"$2\"\ncode=0\n\
        \"$1\" report \"$3\" --figures \"$2/figures\" || code=$?\nls -A \"$2/figures\"\nexit $code";
    let mut command = rig.command("unshare");
    command.args(["-m", "sh", "-c", script, "sh"]);
    command.args([&program("hil"), &room, &run.folder]);
    let output = rig
        .program(command)
        .expect(3)
        .says(&["No space left on device"]);
    assert_eq!(output.stdout, "", "no file is left");
}
