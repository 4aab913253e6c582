//! Plots over another signal, spectra and responses: their figures, and the tables of the page, against closed forms
//! and numpy.

use std::fs;
use std::process::Command;

use super::{drawn, text, texts};
use crate::report::page::Page;
use crate::support::harness::{Rig, Run};
use crate::support::mcap_reader::Recording;
use crate::support::programs::{shipped, skip};
use crate::support::python::{python, succeeds};

/// Plots of every kind, for the teaching run under a sine.
const PLOTS: &str = "
[[plots]]
title = \"Position over force\"
kind = \"xy\"
name = \"loop\"
caption = \"Position over force, 50 % of it\"
x = \"command.force_n\"
signals = [\"truth.position_m\"]

[[plots]]
title = \"Amplitudes\"
kind = \"spectrum\"
signals = [\"reference.position_m\", \"truth.position_m\"]
until_s = 7.999

[[plots]]
title = \"Density\"
kind = \"spectrum\"
quantity = \"density\"
window = \"flat-top\"
resolution_hz = 1.0
signals = [\"truth.position_m\"]
until_s = 7.999

[[plots]]
title = \"Nothing of this run\"
signals = [\"internal.of_another\"]
laws = [\"hold\"]
";

fn sine(rig: &Rig) -> Run {
    let text = shipped("scenarios/spring-mass.toml");
    let text = text.replace("duration_s = 5.0", "duration_s = 8.0");
    let text = text.replace(
        "kind = \"step\"\nat_s = 0.5\nafter = 0.01",
        "kind = \"sine\"\namplitude = 0.01\nfrequency_hz = 1.5",
    );
    let (text, _) = text
        .split_once("# The textbook figures")
        .expect("metrics of a step");
    let path = rig.write("sine.toml", &format!("{text}{PLOTS}"));
    rig.run(path.to_str().expect("text")).expect(0)
}

#[test]
fn every_kind_of_plot_is_drawn_and_captioned_in_order() {
    let rig = Rig::new();
    let run = sine(&rig);
    let output = drawn(&rig, &[&run], "figures", &[]).expect(0);
    assert!(!output.stdout.contains("Nothing of this run"));
    let captions = text(&rig.path("figures/captions.tex"));
    let names = captions.split("\\includegraphics{").skip(1);
    let names: Vec<&str> = names
        .map(|rest| rest.split_once('}').expect("its end").0)
        .collect();
    assert_eq!(names, ["loop", "amplitudes", "density"]);
    assert!(
        captions.contains("\\caption{Position over force, 50 \\% of it}"),
        "{captions}"
    );
    let words = |name: &str| texts(&text(&rig.path(&format!("figures/{name}.svg"))));
    let amplitudes = words("amplitudes");
    for expected in [
        "Frequency [Hz]",
        "reference",
        "truth",
        "Hann window, lines 0.125 Hz apart",
    ] {
        assert!(
            amplitudes.iter().any(|text| text == expected),
            "{expected} in {amplitudes:?}"
        );
    }
    let density = words("density");
    assert!(
        density
            .iter()
            .any(|text| text == "Flat-top window, lines 1 Hz apart, 15 segments"),
        "{density:?}"
    );
    assert!(
        density.iter().any(|text| text.ends_with("[m/√Hz]")),
        "{density:?}"
    );
    assert!(words("loop").iter().any(|text| text.ends_with("[N]")));
}

#[test]
fn the_spectrum_of_a_sine_has_its_amplitude_and_that_of_a_run_agrees_with_numpy() {
    let rig = Rig::new();
    let run = sine(&rig);
    let page = Page::of(&rig, &[&run], &[]);
    let (_, table) = page
        .text
        .split_once("<figcaption>Amplitudes</figcaption>")
        .expect("a figure");
    let (table, rest) = table.split_once("</figure>").expect("its end");
    assert!(table.contains("<svg ") && table.contains("<th scope=\"col\">frequency [Hz]</th>"));
    let row = "<th scope=\"row\">reference</th><td>1.5</td><td>0.01</td>";
    assert!(table.contains(row), "{table}");
    let rows = table.matches("<th scope=\"row\">reference</th>").count();
    assert_eq!(rows, 1, "rounding is no line: {table}");
    let Some(python) = python("numpy") else {
        return skip("Python has no numpy", "HIL_TEST_PYTHON");
    };
    let recording = Recording::open(&run.recording());
    let values: Vec<String> = (recording.column("truth.position_m").iter().take(8000))
        .map(|value| format!("{value:e}"))
        .collect();
    let path = rig.write("values.txt", &values.join("\n"));
    let script = "import sys, numpy as n\nx = n.loadtxt(sys.argv[1])\nN = len(x)\n\
        w = 0.5 - 0.5 * n.cos(2 * n.pi * n.arange(N) / N)\n\
        a = 2 * abs(n.fft.rfft((x - x.mean()) * w)) / w.sum()\nprint(*a[1:])\n\
        a0, a1, a2, a3, a4 = 0.21557895, 0.41663158, 0.277263158, 0.083578947, 0.006947368\n\
        p = 2 * n.pi * n.arange(1000) / 1000\n\
        w = a0 - a1 * n.cos(p) + a2 * n.cos(2 * p) - a3 * n.cos(3 * p) + a4 * n.cos(4 * p)\n\
        s = [x[k:k + 1000] for k in range(0, 7001, 500)]\n\
        d = sum(abs(n.fft.rfft((y - y.mean()) * w)) ** 2 for y in s) / len(s)\n\
        print(*n.sqrt(2 * d / (1000 * (w ** 2).sum()))[1:])\n";
    let output = succeeds(Command::new(python).args(["-c", script]).arg(path));
    let expected: Vec<Vec<f64>> = output
        .lines()
        .map(|line| {
            line.split(' ')
                .map(|one| one.parse().expect("a number"))
                .collect()
        })
        .collect();
    let (_, density) = rest
        .split_once("<figcaption>Density</figcaption>")
        .expect("a figure");
    let (density, _) = density.split_once("</figure>").expect("its end");
    for (table, name, step_hz, expected) in [
        (table, "truth", 0.125, &expected[0]),
        (density, "truth.position_m", 1.0, &expected[1]),
    ] {
        let head = format!("<th scope=\"row\">{name}</th>");
        let rows = table.split(&head).skip(1);
        let mut count = 0;
        for row in rows {
            let numbers: Vec<f64> = (row.split("<td>").skip(1).take(2))
                .map(|cell| cell.split_once("</td>").expect("its end").0)
                .map(|cell| cell.parse().expect("a number"))
                .collect();
            if numbers[1] < 1e-9 {
                continue; // rounding
            }
            let place = (numbers[0] / step_hz).round() as usize - 1;
            let off = (numbers[1] / expected[place] - 1.0).abs();
            assert!(
                off < 1e-4,
                "{name} at {} Hz: {} and {}",
                numbers[0],
                numbers[1],
                expected[place]
            );
            count += 1;
        }
        assert!(count > 0, "{name} has lines");
    }
}

#[test]
fn responses_are_drawn_from_a_metric_and_from_the_file_of_margins() {
    let rig = Rig::new();
    let text_of = shipped("scenarios/spring-mass.toml");
    let text_of = text_of
        .replace("duration_s = 5.0", "duration_s = 20.0")
        .replace(
            "kind = \"step\"\nat_s = 0.5\nafter = 0.01",
            "kind = \"chirp\"\namplitude = 0.01\nstart_hz = 0.2\nend_hz = 20.0\nduration_s = 20.0",
        );
    let (head, _) = text_of
        .split_once("# The textbook figures")
        .expect("metrics of a step");
    let own = "[[metrics]]\nname = \"loop\"\nkind = \"frequency-response\"\noutput = \"truth.position_m\"\n\
        [[plots]]\ntitle = \"Closed loop\"\nkind = \"bode\"\nmetric = \"loop\"\n\
        [[plots]]\ntitle = \"Open loop\"\nkind = \"nichols\"\n";
    let scenario = rig.write("chirp.toml", &format!("{head}{own}"));
    let run = rig.run(scenario.to_str().expect("text")).expect(0);
    let refused = drawn(&rig, &[&run], "without", &[]).expect(2);
    assert!(
        refused.stderr.contains("no figure `Open loop`")
            && refused.stderr.contains("--margins FILE"),
        "{}",
        refused.stderr
    );
    assert!(
        rig.path("without/closed-loop.pdf").exists() && !rig.path("without/open-loop.svg").exists()
    );
    let csv = rig.path("loop.csv");
    // L = 10 / (j f): -90 degrees throughout, 0 dB at 10 Hz.
    let rows = ["1,0,-10", "10,0,-1", "100,0,-0.1"]
        .map(|row| format!("command.force_n,5,{row},0,-90,1,1,0\n"));
    let head =
        "command,at_s,frequency_hz,real,imaginary,gain_db,phase_deg,amplitude,coherence,change\n";
    fs::write(&csv, format!("{head}{}", rows.concat())).expect("written");
    let margins = ["--margins", csv.to_str().expect("text")];
    drawn(&rig, &[&run], "with", &margins).expect(0);
    let svg = text(&rig.path("with/open-loop.svg"));
    let words = texts(&svg);
    assert!(
        words.iter().any(|text| text == "Gain [dB]")
            && words.iter().any(|text| text == "Phase [°]"),
        "{words:?}"
    );
    let page = Page::of(&rig, &[&run], &margins);
    assert!(
        page.text.contains("<td>10</td><td>0</td><td>-90</td>"),
        "gain and phase of L"
    );
    let (_, table) = page
        .text
        .split_once("<figcaption>Closed loop</figcaption>")
        .expect("a figure");
    let cells = table.split("<td>").skip(1);
    let cells = cells.map(|cell| cell.split_once("</td>").expect("its end").0);
    let numbers: Vec<f64> = cells.map_while(|cell| cell.parse().ok()).collect();
    // Well inside the sweep, because the ends of a chirp are biased.
    let mut rows = numbers.chunks_exact(3);
    let row = rows.find(|row| row[0] > 4.0).expect("a row");
    let [frequency_hz, gain_db] = [row[0], row[1]];
    // (k_d s^2 + k_p s + k_i) / (m s^3 + (c + k_d) s^2 + (k + k_p) s + k_i)
    let w = std::f64::consts::TAU * frequency_hz;
    let above = libm::hypot(2000.0 - 30.0 * w * w, 300.0 * w);
    let below = libm::hypot(2000.0 - 32.0 * w * w, 400.0 * w - w * w * w);
    let expected_db = 20.0 * libm::log10(above / below);
    assert!(
        (gain_db - expected_db).abs() < 0.4,
        "{gain_db} dB at {frequency_hz} Hz, expected {expected_db}"
    );
}
