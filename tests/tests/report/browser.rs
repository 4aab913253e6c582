//! Pages in a headless Chromium: every plot is drawn, in both themes and at any width.

use std::process::Command;

use serde_json::Value;

use super::page::{Page, base64};
use super::spike_scenario;
use crate::support::harness::Rig;
use crate::support::programs::{chromium, shipped, skip};

/// Runs before the page's own scripts; collects their errors and the texts drawn on each canvas.
pub(super) const CATCH: &str = "<script>window.wrong = [];
addEventListener('error', (event) => wrong.push(String(event.message)));
addEventListener('unhandledrejection', (event) => wrong.push(String(event.reason)));
addEventListener('securitypolicyviolation', (event) => wrong.push('blocked ' + event.blockedURI));
for (const level of ['error', 'warn']) { const tell = console[level]; console[level] = (...said) => { wrong.push(said.join(' ')); tell(...said); }; }
const context = CanvasRenderingContext2D.prototype; const { fillText, clearRect } = context;
context.clearRect = function (...box) { this.canvas.texts = []; return clearRect.apply(this, box); };
context.fillText = function (text, x, y) { const wide = this.measureText(text).width; (this.canvas.texts ||= []).push([text, x, y, wide, x - wide * ({ right: 1, center: 0.5 }[this.textAlign] || 0)]); return fillText.call(this, text, x, y); };
</script>";

/// Waits for every plot and reports the drawing: of each figure its colours and, of its first series, the column
/// whose ink is highest and its height, as fractions of width and height. Then zooms in and reports the texts.
const LOOK: &str = "<script>(() => {
  const tell = () => {
    const figures = [...document.querySelectorAll('figure.plot')].map((figure) => {
      const canvas = figure.querySelector('canvas');
      const { width, height } = canvas;
      const pixels = canvas.getContext('2d').getImageData(0, 0, width, height).data;
      const lines = [...figure.querySelectorAll('.legend line')].map((line) => getComputedStyle(line).stroke.match(/[\\d.]+/g).map(Number));
      const style = getComputedStyle(document.documentElement);
      const probe = document.createElement('i'); document.body.append(probe);
      const colours = lines.length ? lines : [(probe.style.color = style.getPropertyValue('--c0'), getComputedStyle(probe).color.match(/[\\d.]+/g).map(Number))];
      probe.remove();
      const ink = colours.map(() => 0);
      let top = height; let column = 0;
      for (let y = 0; y < height; y++) for (let x = 0; x < width; x++) {
        const at = 4 * (y * width + x);
        colours.forEach(([r, g, b], i) => {
          if (pixels[at + 3] > 150 && Math.abs(pixels[at] - r) + Math.abs(pixels[at + 1] - g) + Math.abs(pixels[at + 2] - b) < 60) {
            ink[i]++;
            if (i === colours.length - 1 && y < top) { top = y; column = x; }
          }
        });
      }
      const dashes = [...figure.querySelectorAll('.legend button')].map((button) => [button.textContent.trim(), button.querySelector('line').getAttribute('stroke-dasharray')]);
      return { texts: canvas.texts || [], dashes, note: figure.querySelector('.tools .hint')?.textContent, title: figure.querySelector('figcaption').textContent, ink, top: top / height, column: column / width, width: figure.getBoundingClientRect().width };
    });
    const scrolls = [...document.querySelectorAll('.scroll')].map((box) => [box.scrollWidth > box.clientWidth + 1, box.hasAttribute('data-scrolls')]);
    const said = { wrong, figures, scrolls, theme: document.documentElement.dataset.theme, overflow: document.documentElement.scrollWidth - innerWidth };
    for (const key of '+++') document.querySelector('figure.plot').dispatchEvent(new KeyboardEvent('keydown', { key, bubbles: true }));
    setTimeout(() => {
      said.zoomed = [...document.querySelectorAll('figure.plot canvas')].flatMap((canvas) => canvas.texts || []);
      const box = document.createElement('pre'); box.id = 'told'; box.textContent = btoa(unescape(encodeURIComponent(JSON.stringify(said)))); document.body.append(box);
    }, 100);
  };
  const wait = () => document.querySelectorAll('[data-drawn]').length === document.querySelectorAll('figure.plot').length ? setTimeout(tell, 100) : setTimeout(wait, 50);
  addEventListener('load', wait);
})();</script>";

/// Opens a page in Chromium, at a width and in a theme.
fn looked_at(rig: &Rig, page: &Page, width: u32, dark: bool) -> Option<Value> {
    let text = page.text.replacen("<head>", &format!("<head>{CATCH}"), 1);
    let text = text.replacen("</body>", &format!("{LOOK}</body>"), 1);
    Some(serde_json::from_slice(&base64(&told(rig, &text, width, dark)?)).expect("JSON"))
}

/// Loads a page in Chromium; returns what its scripts have written into the element `told`.
pub(crate) fn told(rig: &Rig, page: &str, width: u32, dark: bool) -> Option<String> {
    let Some(chromium) = chromium() else {
        skip("there is no Chromium", "HIL_TEST_CHROMIUM");
        return None;
    };
    let path = rig.write("looked-at.html", page);
    let profile = rig.path(&format!("chromium-{width}-{dark}"));
    let mut browser = Command::new(chromium);
    browser
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-quic",
            "--no-first-run",
            "--disable-sync",
        ])
        .args([
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-dev-shm-usage",
        ])
        .args(["--virtual-time-budget=60000", "--dump-dom"])
        .arg(format!("--window-size={width},900"))
        .arg(format!("--user-data-dir={}", profile.display()))
        .args(dark.then_some("--blink-settings=preferredColorScheme=0"))
        .arg(format!("file://{}", path.display()));
    let browser = rig.program(browser).expect(0);
    let (_, rest) = (browser.stdout.split_once("<pre id=\"told\">"))
        .unwrap_or_else(|| panic!("nothing told: {}", browser.stderr));
    let (text, _) = rest.split_once("</pre>").expect("its end");
    Some(text.to_owned())
}

fn assert_drawn(report: &Value, page: &Page) {
    assert_eq!(report["wrong"], serde_json::json!([]));
    let figures = report["figures"].as_array().expect("figures");
    assert!(figures.len() > page.plots().len(), "histograms too");
    for figure in figures {
        let ink = figure["ink"].as_array().expect("ink");
        assert!(
            // The curve of one run may be almost entirely covered by another.
            ink.iter().any(|ink| ink.as_u64() > Some(20))
                && ink.iter().all(|ink| ink.as_u64() > Some(5)),
            "{figure}"
        );
    }
    assert!(
        report["overflow"].as_i64() <= Some(0),
        "the page is wider than the window"
    );
    let texts = figures.iter().map(|figure| &figure["texts"]);
    for text in texts
        .chain([&report["zoomed"]])
        .filter_map(Value::as_array)
        .flatten()
    {
        assert!(text[4].as_f64() >= Some(0.0), "cut at the left: {text}");
    }
}

#[test]
fn axis_labels_are_complete_in_both_themes_on_a_phone_and_zoomed() {
    let rig = Rig::new();
    let narrow = "\n[[derived]]\nname = \"narrow\"\nunit = \"m\"\nexpression = \"5e-7 + 1e-8 * truth.position_m\"\n\
                  [[plots]]\ntitle = \"a narrow range\"\nsignals = [\"narrow\"]\n";
    let scenario = rig.write(
        "narrow.toml",
        &(shipped("scenarios/spring-mass.toml") + narrow),
    );
    let run = rig.run(scenario.to_str().expect("text")).expect(0);
    let page = Page::of(&rig, &[&run], &[]);
    for (width, dark) in [(1280, false), (1280, true), (500, false)] {
        let Some(result) = looked_at(&rig, &page, width, dark) else {
            return;
        };
        assert_drawn(&result, &page);
        let figures = result["figures"].as_array().expect("figures");
        let is_narrow = |figure: &&Value| figure["title"].to_string().contains("a narrow range");
        let figure = figures.iter().find(is_narrow).expect("the plot");
        // From 0 to 1.05e-10 m above 5e-7 m.
        assert_eq!(figure["note"], "Axis: 500 nm plus the number in pm");
        let texts = figure["texts"].as_array().expect("texts").iter();
        let texts: Vec<&str> = texts.filter_map(|text| text[0].as_str()).collect();
        assert!(texts.contains(&"0") && texts.contains(&"50"), "{figure}");
        assert!(texts.contains(&"Time [s]"), "{figure}");
    }
}

#[test]
fn a_browser_draws_every_plot_without_errors_in_both_themes_and_on_a_phone() {
    let rig = Rig::new();
    let scenario = spike_scenario(&rig);
    let run = rig.run(scenario.to_str().expect("text")).expect(1);
    let page = Page::of(&rig, &[&run], &[]);
    for (width, dark) in [(1280, false), (1280, true), (500, false)] {
        let Some(report) = looked_at(&rig, &page, width, dark) else {
            return;
        };
        assert_eq!(report["theme"], if dark { "dark" } else { "light" });
        assert_drawn(&report, &page);
    }
    assert!(page.path.exists());
}

#[test]
fn many_faults_have_buttons_and_stacked_labels() {
    let rig = Rig::new();
    let times_s = [0.5, 0.5, 0.51, 0.6, 1.0, 2.0, 2.0, 2.0, 2.1, 3.0, 4.9, 4.99];
    let faults = times_s.map(|at_s| {
        format!(
            "[[faults]]\nkind = \"bias\"\nat_s = {at_s}\nduration_s = 0.01\n[[faults.effects]]\n\
             target = \"measured.position_m\"\nbias = 1e-6\n"
        )
    });
    let text = shipped("scenarios/spring-mass.toml") + "\n" + &faults.concat();
    let scenario = rig.write("many.toml", &text);
    let of = |gain: u32| {
        let scenario = scenario.display();
        let set = "requirements=[] --set controller.pid.proportional_n_per_m";
        rig.run(&format!("{scenario} --set {set}={gain}")).expect(0)
    };
    let (soft, hard) = (of(200), of(300));
    let page = Page::of(&rig, &[&soft, &hard], &[]);
    assert_eq!(page.text.matches("data-jump=").count(), times_s.len());
    let labels: Vec<&Value> = (0..2).map(|run| &page.data["runs"][run]["label"]).collect();
    let expected = [
        "pid proportional_n_per_m=200",
        "pid proportional_n_per_m=300",
    ];
    assert_eq!(labels, expected);
    for width in [1280, 500] {
        let Some(report) = looked_at(&rig, &page, width, false) else {
            return;
        };
        assert_drawn(&report, &page);
        let scrolls = report["scrolls"].as_array().expect("tables");
        assert!(scrolls.iter().all(|one| one[0] == one[1]), "{scrolls:?}");
        let is_any = scrolls.iter().any(|one| one[0] == true);
        assert!(is_any || width > 500, "a phone is narrower than a table");
        for figure in report["figures"].as_array().expect("figures") {
            // Text, left, top, width.
            let texts = figure["texts"].as_array().expect("texts").iter();
            let boxes: Vec<(&str, [f64; 3])> = texts
                .map(|one| {
                    let number = |at: usize| one[at].as_f64().expect("a number");
                    (one[0].as_str().expect("text"), [1, 2, 3].map(number))
                })
                .filter(|(text, _)| text.ends_with(" bias"))
                .collect();
            let is_over_time = !figure["title"].as_str().expect("text").contains("by time");
            assert_eq!(is_over_time, !boxes.is_empty(), "{figure}");
            for (at, (text, [x, y, wide])) in boxes.iter().enumerate() {
                for (other, [x2, y2, wide2]) in &boxes[at + 1..] {
                    let is_apart = (y - y2).abs() > 11.0 || x + wide < *x2 || x2 + wide2 < *x;
                    assert!(is_apart, "{text} and {other} in {}", figure["title"]);
                }
            }
            for one in figure["dashes"].as_array().expect("a legend") {
                let label = one[0].as_str().expect("text");
                let is_dashed = one[1].as_str().is_some_and(|dash| dash.starts_with("8 "));
                assert_eq!(is_dashed, label.contains(" reference."), "{label}");
            }
        }
    }
}

#[test]
fn a_one_step_spike_is_visible_when_fully_zoomed_out() {
    let rig = Rig::new();
    // Without a fault, so that the grid is not refined there: 100 s at 1 kHz, one sample of 100,001.
    let scenario = spike_scenario(&rig);
    let run = rig
        .run(&format!("{} --set run.duration_s=100", scenario.display()))
        .expect(1);
    let page = Page::of(&rig, &[&run], &[]);
    let (_, greatest) = page.envelope(0, "measured.position_m");
    let highest = greatest
        .iter()
        .fold(0.0, |a: f32, b| if *b > a { *b } else { a });
    assert!((highest - 0.51).abs() < 0.01, "{highest}");
    let Some(report) = looked_at(&rig, &page, 1280, false) else {
        return;
    };
    let figures = report["figures"].as_array().expect("figures");
    let is_it = |figure: &&Value| {
        figure["title"]
            .as_str()
            .is_some_and(|title| title.ends_with(" position_m"))
    };
    let figure = figures.iter().find(is_it).expect("the plot");
    // The spike ends the axis, so it reaches the top tenth, at 6.789 of the 100 s to the right of the axis, whose
    // width is 70 px.
    let (top, column) = (
        figure["top"].as_f64().expect("a number"),
        figure["column"].as_f64().expect("a number"),
    );
    assert!(top < 0.15, "{figure}");
    let width = figure["width"].as_f64().expect("a number");
    let expected = (70.0 + 0.06789 * (width - 70.0)) / width;
    assert!((column - expected).abs() < 0.01, "{column} and {expected}");
}
