//! Numbers alike on every page, in every table and on every terminal.

use std::process::Command;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use hil_console::terminal::duration::shown_ns;
use hil_views::offline_page::PAGE;
use hil_views::prefix::ShownUnit;
use shared_types::number::{short, short_in};

use super::browser::told;
use super::page::Page;
use crate::support::harness::Rig;
use crate::support::programs::{shipped, workspace};
use crate::support::python::succeeds;

/// Numbers at the limits of each rule, and halfway between two that are written.
const NUMBERS: [f64; 30] = [
    0.0,
    -0.0,
    1.0,
    -80.0,
    250_123.0,
    250_122.5,
    250_123.5,
    -250_123.5,
    99_999.5,
    99_999.4,
    100_000.5,
    999_999.4,
    999_999.7,
    1e6,
    1_234_567.0,
    28e6,
    1e16,
    1e21,
    -1.5e300,
    1234.25,
    1234.75,
    -0.031_251,
    0.001,
    9.999_96e-4,
    9.999_94e-4,
    2.116_57e-5,
    5e-324,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::NAN,
];

/// Units with prefixes upwards, with some and with none.
const UNITS: [&str; 5] = ["Pa", "rad/s", "m3/s", "1", "ns"];

/// Numbers of every size, the same in each test.
fn many() -> Vec<f64> {
    let mut state = 1_u64;
    let random = std::iter::repeat_with(|| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        f64::from_bits(state)
    });
    // Of those, some with few digits, which lie halfway between others.
    let random = random.take(2000).flat_map(|value| {
        let coarse = (value.fract() * 4e6).round() / 16.0;
        [value, coarse]
    });
    NUMBERS.into_iter().chain(random).collect()
}

#[test]
fn pages_write_numbers_times_and_units_as_tables_and_terminals_do() {
    let rig = Rig::new();
    let numbers = many();
    let times_ns: Vec<u64> = (0..40)
        .flat_map(|power| [0, 1, 2, 5].map(|more| (1_u64 << power) + more))
        .chain([
            999, 9_994, 9_995, 9_996, 99_949, 99_950, 999_500, 1_125, 1_135,
        ])
        .collect();
    let encoded = |values: &mut dyn Iterator<Item = f64>| {
        let bytes: Vec<u8> = values.flat_map(f64::to_le_bytes).collect();
        BASE64_STANDARD.encode(bytes)
    };
    let script = format!(
        "const listed = (text, write) => Array.from(new Float64Array(bytesOf(text).buffer), write).join(' ; ');
        const box = document.createElement('pre');
        box.id = 'told';
        const values = '{}';
        const inUnit = ({{ power, unit }}) => `${{power}} ${{unit}}`;
        const units = {UNITS:?}.flatMap((unit) => listed(values, (value) => inUnit(shownUnit(unit, value)))).join(' ; ');
        box.textContent = [listed(values, (value) => number(value)), listed(values, typed), listed('{}', nanoseconds), units].join('|');
        document.body.append(box);",
        encoded(&mut numbers.iter().copied()),
        encoded(&mut times_ns.iter().map(|ns| *ns as f64)),
    );
    let page = format!("<body><script>{PAGE}</script><script>{script}</script></body>");
    let Some(text) = told(&rig, &page, 800, false) else {
        return;
    };
    let lists: Vec<Vec<&str>> = text
        .split('|')
        .map(|list| list.split(" ; ").collect())
        .collect();
    let [page_numbers, page_fields, page_times, page_units] = &lists[..] else {
        panic!("{} lists", lists.len());
    };
    assert_eq!(page_numbers.len(), numbers.len());
    for (value, text) in numbers.iter().zip(page_numbers) {
        assert_eq!(*text, short(*value), "{value:e}");
    }
    assert_eq!(page_fields.len(), numbers.len());
    for (value, text) in numbers.iter().zip(page_fields) {
        let read: f64 = text.parse().expect("a number");
        let table = short(*value);
        let is_exact = table.parse() == Ok(*value);
        let error = (read - value).abs() / value.abs();
        assert!(!is_exact || *text == table, "{text} for {table}");
        assert!(error.is_nan() || error <= 5e-5, "{text} for {value:e}");
    }
    assert_eq!(page_times.len(), times_ns.len());
    for (ns, text) in times_ns.iter().zip(page_times) {
        assert_eq!(*text, shown_ns(*ns), "{ns} ns");
    }
    let units = UNITS
        .iter()
        .flat_map(|unit| numbers.iter().map(move |value| (unit, value)));
    assert_eq!(page_units.len(), UNITS.len() * numbers.len());
    for ((unit, value), text) in units.zip(page_units) {
        let expected = ShownUnit::of(unit, *value);
        let expected = format!("{} {}", expected.power, expected.unit);
        assert_eq!(text.trim_end(), expected.trim_end(), "{value:e} {unit}");
    }
}

#[test]
fn a_value_is_the_same_text_on_the_terminal_and_in_the_table_and_has_the_axis_unit_below_the_plot()
{
    let rig = Rig::new();
    let values = [
        250_122.5,
        123_456.7,
        1234.25,
        2.116_57e-5,
        28e6,
        -0.001,
        999_999.7,
        1e-7,
    ];
    let mut scenario = shipped("scenarios/spring-mass.toml");
    let names: Vec<String> = (0..values.len())
        .map(|nth| format!("constant{nth}"))
        .collect();
    for (name, value) in names.iter().zip(values) {
        scenario += &format!(
            "\n[[derived]]\nname = \"{name}\"\nunit = \"m\"\nexpression = \"0 * truth.position_m + {value:e}\"\n\
             [[metrics]]\nname = \"{name}_max\"\nexpression = \"max({name})\"\n"
        );
    }
    let signals = format!("{names:?}");
    scenario += &format!("[[plots]]\ntitle = \"constants\"\nsignals = {signals}\n");
    let scenario = rig.write("constants.toml", &scenario);
    let run = rig.run(scenario.to_str().expect("text")).expect(0);
    let page = Page::of(&rig, &[&run], &[]);
    for value in values {
        let text = short_in(value, "m");
        assert!(run.stdout.contains(&text), "{text} in {}", run.stdout);
        let cell = format!(">{text}<");
        assert!(page.text.contains(&cell), "{text} in the table");
    }
    // Once every plot is drawn, a key shows the values below it.
    let look = "<script>addEventListener('load', () => {
        const drawn = () => document.querySelectorAll('[data-drawn]').length === document.querySelectorAll('figure.plot').length;
        const figure = [...document.querySelectorAll('figure.plot')].find((one) => one.textContent.startsWith('constants'));
        const values = () => [...figure.querySelectorAll('.legend button .value')].map((one) => one.textContent);
        const look = () => {
            if (drawn()) figure.dispatchEvent(new KeyboardEvent('keydown', { key: 'a', bubbles: true }));
            if (!drawn() || !values().every(Boolean)) return setTimeout(look, 50);
            const box = document.createElement('pre');
            box.id = 'told';
            box.textContent = values().join(' ; ');
            document.body.append(box);
        };
        look();
    });</script>";
    let text = page.text.replacen("</body>", &format!("{look}</body>"), 1);
    let Some(text) = told(&rig, &text, 1280, false) else {
        return;
    };
    let below: Vec<&str> = text.split(" ; ").collect();
    // In the unit of the axis, which suits the largest.
    assert_eq!(below, values.map(|value| short_in(value / 1e6, "Mm")));
}

#[test]
fn no_page_has_a_number_format_of_its_own() {
    let shared: Vec<&str> = PAGE
        .lines()
        .filter_map(|line| line.strip_prefix("const ")?.split_once(" = "))
        .map(|(name, _)| name)
        .collect();
    assert!(shared.contains(&"number") && shared.contains(&"ticks"));
    let mut list = Command::new("git");
    list.args(["ls-files", "tools/*.js"])
        .current_dir(workspace());
    let scripts = succeeds(&mut list);
    let own = |script: &&str| !script.ends_with("/page.js") && !script.ends_with(".min.js");
    let scripts: Vec<&str> = scripts.lines().filter(own).collect();
    assert!(scripts.len() >= 3, "{scripts:?}");
    for script in scripts {
        let text = shipped(script);
        for formatter in [
            "toPrecision",
            "toFixed",
            "toExponential",
            "toLocale",
            "Intl.",
        ] {
            assert!(!text.contains(formatter), "{script} has `{formatter}`");
        }
        for name in &shared {
            let own = ["const", "let", "class", "function"].map(|word| format!("{word} {name} "));
            assert!(
                !own.iter().any(|own| text.contains(own)),
                "{script} has a `{name}` of its own"
            );
        }
    }
}
