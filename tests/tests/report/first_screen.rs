//! First screen of a report at 1280 x 800: the answer and the plots that decide, before any table.

use serde_json::{Value, json};

use super::browser::told;
use super::page::Page;
use crate::support::harness::Rig;
use crate::support::programs::shipped;

/// Waits until the first plots are drawn; reports where things are, in pixels from the top of the page.
const MEASURE: &str = "<script>addEventListener('load', () => {
  const top = (one) => one ? Math.round(one.getBoundingClientRect().top + scrollY) : null;
  const look = () => {
    const figures = [...document.querySelectorAll('figure.plot')].sort((a, b) => top(a) - top(b) || a.getBoundingClientRect().left - b.getBoundingClientRect().left).slice(0, 2);
    if (!figures.every((one) => one.querySelector('canvas'))) return setTimeout(look, 50);
    const texts = (query) => [...document.querySelectorAll(query)].map((one) => one.textContent.replace(/\\s+/g, ' ').trim());
    const box = document.createElement('pre');
    box.id = 'told';
    box.textContent = JSON.stringify({
      tops: figures.map(top), bottoms: figures.map((one) => top(one) + Math.round(one.querySelector('.canvas').getBoundingClientRect().bottom - one.getBoundingClientRect().top)),
      titles: figures.map((one) => one.querySelector('figcaption').firstChild.textContent), table: top(document.querySelector('table')), latency: top(document.getElementById('latency')), provenance: top(document.getElementById('provenance')),
      verdicts: texts('.verdict'), bars: texts('.uses li').map((text) => text.replace(/^[^\\w]+ ?/, '')), buttons: texts('.tools button'),
      widths: [...document.querySelectorAll('.uses li')].map((one) => parseFloat(one.querySelector('.fill')?.style.width ?? NaN)),
    }).replace(/[&<>]/g, '');
    document.body.append(box);
  };
  look();
});</script>";

/// Measures a page in a window of 1280 pixels.
fn measured(rig: &Rig, page: &Page) -> Option<Value> {
    let text = page
        .text
        .replacen("</body>", &format!("{MEASURE}</body>"), 1);
    let text = told(rig, &text, 1280, false)?;
    Some(serde_json::from_str(&text).expect("JSON"))
}

#[test]
fn the_first_screen_has_the_verdict_the_bars_and_the_two_plots_that_decide() {
    let rig = Rig::new();
    // Of the limit of 0.3 m the step to 0.01 m leaves more than 96 %, of 0.0106 m less than 2 %.
    let requirements = "
[[requirements]]
name = \"far\"
formula = \"always(abs(truth.position_m) < 0.3)\"
[[requirements]]
name = \"near\"
formula = \"always(measured.position_m < 0.0106)\"
[[requirements]]
name = \"no_share\"
formula = \"always(truth.velocity_mps - 1 < 0)\"
";
    let scenario = rig.write(
        "near.toml",
        &(shipped("scenarios/spring-mass.toml") + requirements),
    );
    let run = rig.run(scenario.to_str().expect("text")).expect(0);
    let page = Page::of(&rig, &[&run], &[]);
    let Some(result) = measured(&rig, &page) else {
        return;
    };
    for (at, bottom) in [(0, 800), (1, 800)] {
        let top = result["tops"][at].as_u64().expect("a top");
        let end = result["bottoms"][at].as_u64().expect("a bottom");
        assert!(top > 0 && end <= bottom, "{result}");
        assert!(result["table"].as_u64() > Some(end), "{result}");
    }
    // Nothing was asked of the clock, so its figures come after all else.
    assert!(result["latency"].as_u64() > result["provenance"].as_u64());
    let summary = run.summary();
    let margin = |name: &str| {
        let mut requirements = summary["requirements"].as_array().expect("a list").iter();
        let one = requirements.find(|one| one["name"] == name).expect("it");
        one["robustness"].as_f64().expect("a margin")
    };
    let share = |name: &str, limit: f64| 100.0 * (1.0 - margin(name) / limit);
    let near = format!("{:.0} % used", share("near", 0.0106));
    let verdict = format!("pass; nearest to its limit: near, {near}");
    assert_eq!(result["verdicts"], json!([verdict]));
    let bars = result["bars"].as_array().expect("bars");
    let far = format!("{:.0} % used", share("far", 0.3));
    let texts: Vec<&str> = bars.iter().filter_map(Value::as_str).collect();
    let place = |text: &str| texts.iter().position(|one| one.contains(text));
    assert_eq!(place(&near), Some(0), "{texts:?}");
    assert!(
        place(&far).is_some() && place("margin ").is_some(),
        "{texts:?}"
    );
    // The full width of a bar is 125 %.
    let width = result["widths"][0].as_f64().expect("a width");
    assert!(
        (width - share("near", 0.0106) / 1.25).abs() < 0.1,
        "{result}"
    );
    // The plot of the signal that is nearest to its limit comes first.
    let first = result["titles"][0].as_str().expect("a title");
    let marks = page.plots().iter().find(|plot| {
        plot["heading"]
            .as_str()
            .is_some_and(|heading| first.starts_with(heading))
    });
    let marks = marks.expect("the plot")["marks"].to_string();
    assert!(marks.contains("\"near\""), "{first}: {marks}");
}

#[test]
fn the_plot_of_a_failed_requirement_comes_first_and_its_bar_passes_the_limit() {
    let rig = Rig::new();
    let run = rig
        .run("scenarios/spring-mass.toml --set controller.pid.proportional_n_per_m=20 --set controller.pid.integral_n_per_m_s=0")
        .expect(1);
    let page = Page::of(&rig, &[&run], &[]);
    let Some(result) = measured(&rig, &page) else {
        return;
    };
    let verdict = result["verdicts"][0].as_str().expect("a line");
    assert!(
        verdict.starts_with("fail; ")
            && verdict.contains(" failed, farthest beyond its limit: settles, "),
        "{verdict}"
    );
    let width = result["widths"][0].as_f64().expect("a width");
    assert!(
        width > 80.0 && width <= 100.0,
        "beyond the limit at 80 %: {result}"
    );
    assert!(result["bottoms"][0].as_u64() <= Some(800), "{result}");
}

#[test]
fn a_run_that_asked_for_a_clock_has_its_latency_before_the_provenance() {
    let rig = Rig::new();
    let run = rig
        .run("scenarios/spring-mass.toml --clock paced --set run.duration_s=0.6 --set requirements=[] --set metrics=[]")
        .expect(0);
    let page = Page::of(&rig, &[&run], &[]);
    let place = |id: &str| {
        page.text
            .find(&format!("<section id=\"{id}\""))
            .expect("a section")
    };
    assert!(place("first") < place("latency") && place("latency") < place("provenance"));
    assert!(page.text.contains("completed, no requirements"));
}
