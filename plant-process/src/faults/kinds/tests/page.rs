//! The user's page `docs/faults.md` agrees with the code.

use hil_config::live_requests::RequestContext;
use hil_config::plan::{FaultAction, Stimulus, Waveform};
use shared_types::describe::ActsOn;
use shared_types::number::exact as number;
use shared_types::table::Field;

use super::*;
use crate::plant::PlantKind;

const PAGE: &str = include_str!("../../../../../docs/faults.md");
const TESTS: [&str; 7] = [
    include_str!("../tests.rs"),
    include_str!("messages.rs"),
    include_str!("numbers.rs"),
    include_str!("page.rs"),
    include_str!("stages.rs"),
    include_str!("timing.rs"),
    include_str!("../../profile.rs"),
];

/// Formats the line of a parameter in the table of its kind.
fn row(field: &Field) -> String {
    let default = field.default.map_or("required".into(), number);
    let (min, max) = (number(field.min), number(field.max));
    let Field {
        name,
        unit,
        description,
        ..
    } = field;
    format!("| `{name}` | {unit} | {min} to {max} | {default} | {description} |")
}

/// Returns the section of a kind, without its heading.
fn section(kind: &str) -> &str {
    let heading = format!("\n### `{kind}`\n");
    let (_, rest) = PAGE
        .split_once(&heading)
        .unwrap_or_else(|| panic!("{kind}"));
    let end = rest.find("\n##").expect("something comes after the kinds");
    &rest[..end]
}

#[test]
fn every_kind_is_on_the_page_with_its_equation_and_every_parameter() {
    for FaultKindEntry { description, .. } in all() {
        let kind = &description.kind;
        let section = section(kind);
        let acts_on = match description.acts_on {
            ActsOn::Signals => "Acts on signals. ",
            ActsOn::Numbers => "Acts on signals and faultable parameters. ",
            ActsOn::Links => "Acts on `link.sample` and `link.command`. ",
            ActsOn::Sides => "Acts on `controller` and `plant`. ",
            ActsOn::Controller => "Acts on `controller`. ",
        };
        let mut lines = vec![
            format!("\n{}\n", description.summary),
            format!("```text\n{}\n```\n", description.equation),
            acts_on.into(),
            format!("kind = \"{kind}\""),
            format!("hil inject {kind} "),
        ];
        lines.extend(description.parameters.iter().map(row));
        if let Some(list) = &description.list {
            lines.push(format!("| `{}` |", list.key));
            lines.push(format!("| {} |", list.description));
        }
        for text in lines {
            assert!(section.contains(&text), "{kind}: `{text}`\n{section}");
        }
    }
}

#[test]
fn every_test_that_the_page_names_exists() {
    let mut named = 0;
    for (_, tests) in PAGE.lines().filter_map(|line| line.split_once("Test: ")) {
        for name in tests.split('`').skip(1).step_by(2) {
            let head = format!("\nfn {name}() {{");
            let indented = format!("\n    fn {name}() {{");
            let exists = |text: &&str| text.contains(&head) || text.contains(&indented);
            assert!(TESTS.iter().any(exists), "{name}");
            named += 1;
        }
    }
    assert!(named >= all().len(), "{named}");
}

#[test]
fn every_example_on_the_page_is_a_fault_that_starts() {
    let plant = PlantKind::of::<crate::models::drhas::Drhas>().description;
    let mut parameters = Settings::default();
    for field in &plant.parameters {
        parameters.set(&field.name, field.default.expect("has a default"));
    }
    let stimuli = vec![Stimulus {
        aliases: Vec::new(),
        target: "surface_angle_rad".into(),
        unit: "rad".into(),
        range: Stimulus::any_range(),
        is_whole: false,
        waveform: Waveform::Paper {
            amplitude: 0.2,
            frequency_hz: 1.0,
            onset_per_s3: 0.1,
        },
    }];
    let context = RequestContext {
        plant,
        kinds: all().into_iter().map(|entry| entry.description).collect(),
        parameters,
        stimuli,
        constants: Settings::default(),
        taps: [Vec::new(), Vec::new()],
        derived: vec![],
        networks: 1,
        rate: rate(10_000.0),
        steps: 200_000,
        names: vec![],
        first_id: 1,
    };
    let mut examples = 0;
    for example in PAGE.split("```toml\n").skip(1) {
        let (toml, _) = example.split_once("```").expect("a block has an end");
        let events = context
            .check(toml, &[])
            .unwrap_or_else(|e| panic!("{toml}\n{e}"));
        for event in events {
            for effect in &event.effects {
                let FaultAction::Kind { parameters, list } = &effect.action else {
                    panic!("{toml}");
                };
                let setup = AnySetup {
                    parameters,
                    list,
                    rate: rate(10_000.0),
                    signals: 4,
                    is_instrument: false,
                };
                let started = (entry(&event.kind).start)(&setup);
                assert!(started.is_ok(), "{toml}");
            }
            examples += 1;
        }
    }
    assert!(examples > all().len(), "{examples}");
}
