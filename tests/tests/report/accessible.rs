//! Pages that everybody can read and operate, as axe-core sees them: on a light desk and a dark phone.

use std::path::Path;

use serde_json::Value;

use super::browser::told;
use super::page::Page;
use super::spike_scenario;
use crate::support::harness::Rig;
use crate::support::node::node_packages;
use crate::support::programs::skip;

/// Waits until all plots are drawn, opens what is folded, and reports the rules that are broken and the overflow.
const CHECK: &str = "<script>addEventListener('load', () => {
  const isDrawn = () => document.documentElement.dataset.drawn === 'true' || document.querySelectorAll('figure.plot').length === document.querySelectorAll('figure[data-drawn]').length;
  const check = async () => {
    if (!isDrawn()) return setTimeout(check, 50);
    for (const one of document.querySelectorAll('details')) one.open = true;
    const broken = [];
    const look = async () => {
      const { violations } = await axe.run(document, { runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa', 'best-practice'] });
      broken.push(...violations.flatMap((rule) => rule.nodes.map((node) => rule.id + ' ' + node.target + ': ' + node.failureSummary)));
    };
    await look();
    // With a hidden curve, with cursors and their figures, then with the list of everything over them.
    const press = (key, options) => document.activeElement.dispatchEvent(new KeyboardEvent('keydown', { key, bubbles: true, cancelable: true, ...options }));
    if (document.getElementById('measure')) {
      document.querySelector('.legend button').click();
      document.querySelector('figure.plot').focus();
      for (const key of 'ab>') press(key);
      const rows = document.querySelectorAll('#figures tr').length;
      if (!rows) broken.push('no figures at the cursors');
      await look();
      press('k', { ctrlKey: true });
      if (!document.querySelector('#found li')) broken.push('nothing in the list');
      await look();
      document.getElementById('palette').close();
    }
    const box = document.createElement('pre');
    box.id = 'told';
    box.textContent = JSON.stringify({ broken, overflow: document.documentElement.scrollWidth - innerWidth }).replace(/[&<>]/g, '');
    document.body.append(box);
  };
  check();
});</script>";

/// Returns what axe-core finds wrong with a page; `None` without axe-core or Chromium.
pub(crate) fn broken(rig: &Rig, page: &str, width: u32, dark: bool) -> Option<Vec<String>> {
    let Some(packages) = node_packages("axe-core") else {
        skip("axe-core of tests/node is not installed", "HIL_TEST_NODE");
        return None;
    };
    let script = packages.join(Path::new("node_modules/axe-core/axe.min.js"));
    let axe = std::fs::read_to_string(script).expect("axe-core");
    let page = page.replacen(
        "</body>",
        &format!("<script>{axe}</script>{CHECK}</body>"),
        1,
    );
    let result: Value = serde_json::from_str(&told(rig, &page, width, dark)?).expect("JSON");
    let overflow = result["overflow"].as_i64().expect("a number");
    assert!(overflow <= 0, "{overflow} pixels wider than {width}");
    let broken = result["broken"].as_array().expect("a list").iter();
    Some(broken.map(ToString::to_string).collect())
}

#[test]
fn a_report_breaks_no_rule_of_accessibility_on_a_light_desk_and_a_dark_phone() {
    let rig = Rig::new();
    let scenario = spike_scenario(&rig);
    let run = rig.run(scenario.to_str().expect("text")).expect(1);
    let one = Page::of(&rig, &[&run], &[]).text;
    let two = Page::of(&rig, &[&run, &run], &[]).text;
    for page in [&one, &two] {
        for (width, dark) in [(1280, false), (500, true)] {
            let Some(broken) = broken(&rig, page, width, dark) else {
                return;
            };
            assert_eq!(broken, [""; 0], "{width} {dark}");
        }
    }
}
