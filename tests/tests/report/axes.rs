//! Axes of a report's plots: prefixes, a spike that would flatten the rest, curves above each other, limits in words.

use serde_json::{Value, json};

use super::browser::{CATCH, told};
use super::page::Page;
use super::spike_scenario;
use crate::support::harness::Rig;

/// Once all plots are drawn, tells of each plot what stands in and around it: at first, then after a press of its
/// first button, then of its second one too.
const PRESS: &str = "<script>addEventListener('load', () => {
  const all = () => [...document.querySelectorAll('figure[data-plot]')];
  const tell = () => all().map((figure) => ({
    title: figure.querySelector('figcaption').textContent, note: figure.querySelector('.tools .hint')?.textContent,
    buttons: [...figure.querySelectorAll('.tools button')].map((one) => [one.textContent, one.getAttribute('aria-pressed')]),
    limits: [...figure.querySelectorAll('.limit')].map((one) => one.textContent), legend: [...figure.querySelectorAll('.legend button')].map((one) => one.textContent.trim()),
    texts: (figure.querySelector('canvas').texts || []).map(([text, , y]) => [text, y]), height: figure.querySelector('canvas').height,
  }));
  const press = (nth) => all().forEach((figure) => figure.querySelectorAll('.tools button')[nth]?.click());
  const wait = (then) => setTimeout(() => document.querySelectorAll('[data-drawn]').length === document.querySelectorAll('figure.plot').length ? then() : wait(then), 100);
  wait(() => {
    const states = [tell()];
    press(0);
    wait(() => {
      states.push(tell());
      press(1);
      wait(() => {
        states.push(tell(), wrong);
        const box = document.createElement('pre');
        box.id = 'told';
        box.textContent = JSON.stringify(states).replace(/[&<>]/g, '');
        document.body.append(box);
      });
    });
  });
});</script>";

/// Returns the three states of each plot.
fn states(rig: &Rig, page: &Page) -> Option<[Value; 3]> {
    let text = page.text.replacen("<head>", &format!("<head>{CATCH}"), 1);
    let text = text.replacen("</body>", &format!("{PRESS}</body>"), 1);
    let states: [Value; 4] = serde_json::from_str(&told(rig, &text, 1280, false)?).expect("JSON");
    let [first, second, third, wrong] = states;
    assert_eq!(wrong, json!([]));
    Some([first, second, third])
}

fn plot<'a>(state: &'a Value, title: &str) -> &'a Value {
    let mut plots = state.as_array().expect("plots").iter();
    let is_it = |plot: &&Value| {
        plot["title"]
            .as_str()
            .is_some_and(|one| one.contains(title))
    };
    plots
        .find(is_it)
        .unwrap_or_else(|| panic!("{title}: {state}"))
}

/// Returns the share of a plot's height between two of its ticks.
fn apart(plot: &Value, ticks: [&str; 2]) -> f64 {
    let [a, b] = ticks.map(|tick| {
        // The time axis, which has a 0 too, is drawn first.
        let mut texts = plot["texts"].as_array().expect("texts").iter().rev();
        let text = texts.find(|text| text[0] == tick);
        text.unwrap_or_else(|| panic!("{tick}: {plot}"))[1]
            .as_f64()
            .expect("a number")
    });
    (a - b).abs() / plot["height"].as_f64().expect("a height")
}

#[test]
fn a_spike_leaves_room_for_the_rest_and_the_user_can_choose_otherwise() {
    let rig = Rig::new();
    let scenario = spike_scenario(&rig);
    let run = rig.run(scenario.to_str().expect("text")).expect(1);
    let page = Page::of(&rig, &[&run], &[]);
    let Some([first, linear, offset]) = states(&rig, &page) else {
        return;
    };
    // 0.01 m for most of 10 s, and 0.51 m for one step.
    let title = "Position x [m] measured.position_m";
    let spike = plot(&first, title);
    let note = spike["note"].as_str().expect("a note");
    assert!(
        note.starts_with("Linear to ±") && note.ends_with("logarithmic beyond"),
        "{note}"
    );
    assert_eq!(spike["buttons"][0], json!(["symmetric log", "true"]));
    assert!(apart(spike, ["0", "0.01"]) > 0.1, "{spike}");
    let flat = plot(&linear, title);
    assert_eq!(
        (&flat["note"], &flat["buttons"][0]),
        (&json!(""), &json!(["symmetric log", "false"]))
    );
    // There 0.2 m take about the room that 0.01 m took.
    assert!(apart(flat, ["0", "0.2"]) < 0.3, "{flat}");
    let raised = plot(&offset, "Position, wanted and true");
    let note = raised["note"].as_str().expect("a note");
    assert!(
        note.starts_with("Curves ") && note.contains(" mm apart"),
        "{note}"
    );
    // A step answer has no spike, so its axis is linear until the user asks for another.
    let answer = plot(&first, "Position, wanted and true");
    assert_eq!(
        (&answer["note"], &answer["buttons"][0]),
        (&json!(""), &json!(["symmetric log", "false"]))
    );
    let asked = plot(&linear, "Position, wanted and true");
    assert_eq!(asked["buttons"][0], json!(["symmetric log", "true"]));
}

#[test]
fn plots_name_signals_units_times_and_each_limit_once() {
    let rig = Rig::new();
    let run = rig
        .run("scenarios/severe-leakage.toml --set metrics=[]")
        .expect(0);
    let page = Page::of(&rig, &[&run], &[]);
    let Some([first, ..]) = states(&rig, &page) else {
        return;
    };
    let pressure = plot(
        &first,
        "Actuator pressure [MPa] truth.actuator*_pressure*_pa",
    );
    let legend = pressure["legend"].as_array().expect("a legend");
    assert_eq!(
        legend[0],
        "Pressure P_h11 of the active chamber of actuator 1 truth.actuator1_pressure1_pa"
    );
    for plot in first.as_array().expect("plots") {
        let texts = plot["texts"].as_array().expect("texts");
        assert!(texts.iter().any(|text| text[0] == "Time [s]"), "{plot}");
        // Limits are named in the legend, once each, and not in the plot.
        let limits = plot["limits"].as_array().expect("limits");
        let mut distinct = limits.clone();
        distinct.dedup();
        assert_eq!(&distinct, limits);
        for limit in limits.iter().filter_map(Value::as_str) {
            let (_, names) = limit.split_once(": ").expect("names");
            assert!(texts.iter().all(|text| text[0] != names), "{plot}");
        }
    }
    assert_eq!(
        plot(&first, "Figure 5")["limits"],
        json!([
            "limit ±150 N: healthy_force_fight, adapted_force_fight, recovers",
            "limit ±5500 N: transient_force_fight"
        ])
    );
    let note = &plot(&first, "Figure 5")["note"];
    assert_eq!(note, "Linear to ±100 N, logarithmic beyond");
}
