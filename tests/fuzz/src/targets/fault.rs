//! Faults of a running plant: the words of `hil inject`, and the `[[faults]]` of a request.
//!
//! Text with a line break or `[[` is a request, any other text a command line, with `'` around a word with spaces.
//! `hil` always turns a command line into TOML. An accepted fault survives the recording, can be shown, and can be
//! prepared in bounded memory.

use std::ffi::OsString;

use clap::Parser;
use hil::{Command, CommandLine};
use hil_config::expression::Columns;
use hil_config::live_requests::RequestContext;
use hil_config::plan::{FaultEvent, Trigger};
use hil_config::problem::ProblemKind;
use hil_config::show::fault_toml;
use hil_facts::arguments::inject::arrange;
use hil_facts::results::faults::LiveFault;
use hil_facts::session::inject;
use plant_process::faults::{FaultBuilder, kinds};
use shared_types::describe::PlantDescription;
use shared_types::live::Possible;
use shared_types::record::FaultAccepted;
use shared_types::table::Field;
use shared_types::time::Step;

use super::rig::{rig, small_plan};

/// Runs the target.
pub fn run(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    if text.contains("[[") || text.contains('\n') {
        requested(text);
    } else if let Some(toml) = typed(text) {
        requested(&toml);
    }
}

/// The plant of the small scenario.
fn plant() -> &'static PlantDescription {
    let model = &small_plan().plant.model;
    let mut plants = rig().plants.iter();
    plants
        .find(|plant| plant.name == *model)
        .expect("it is there")
}

fn reference() -> Vec<Field> {
    let stimuli = small_plan().stimuli.iter();
    stimuli.flat_map(|stimulus| stimulus.fields()).collect()
}

/// Returns the request that a command line produces; none if it is refused or asks for something else.
fn typed(line: &str) -> Option<String> {
    let words = line.split('\'').enumerate().flat_map(|(index, part)| {
        if index % 2 == 1 {
            vec![part]
        } else {
            part.split_whitespace().collect()
        }
    });
    let words = ["hil", "inject"].into_iter().chain(words);
    let arranged = arrange(words.map(OsString::from));
    let Ok(CommandLine {
        command: Command::Inject(arguments),
    }) = CommandLine::try_parse_from(arranged)
    else {
        return None;
    };
    let possible = Possible {
        rate: small_plan().run.rate,
        plant: plant().clone(),
        reference: reference(),
        inputs: Vec::new(),
        kinds: rig().kinds.clone(),
        networks: 1,
    };
    match inject::toml(&arguments, &possible) {
        Ok(toml) => Some(toml),
        Err(refusals) => {
            assert!(!refusals.is_empty());
            assert!(refusals.iter().all(|refusal| !refusal.message.is_empty()));
            None
        }
    }
    .inspect(|toml| {
        if let Err(problems) = check(toml, &[]) {
            let syntax = problems.0.iter().find(|p| p.kind == ProblemKind::Syntax);
            assert_eq!(syntax, None, "{line} became no TOML: {toml}");
        }
    })
}

fn check(
    toml: &str,
    names: &[(String, u32)],
) -> Result<Vec<FaultEvent>, hil_config::problem::Problems> {
    let context = RequestContext {
        names: names.to_vec(),
        first_id: 1,
        ..RequestContext::of(small_plan(), plant(), &rig().kinds)
    };
    context.check(toml, &[])
}

fn requested(toml: &str) {
    let events = match check(toml, &[]) {
        Ok(events) => events,
        Err(problems) => return super::assert_told(&problems.to_string()),
    };
    assert!(!events.is_empty());
    let plan = small_plan();
    let builder = FaultBuilder::new(
        plant(),
        &reference(),
        &kinds::all(),
        &plan.plant.parameters,
        (plan.run.rate, plan.run.seed),
        &[],
    );
    let builder = builder.expect("the parameters are those of the plant");
    let columns = Columns::of(plant(), &plan.stimuli, &[]);
    for event in events {
        let accepted = FaultAccepted {
            id: event.id,
            step: 0,
            fault: serde_json::to_value(&event).expect("plain data"),
        };
        let kept = LiveFault::try_from(&accepted).expect("what was written can be read");
        assert_eq!(format!("{:?}", kept.event), format!("{event:?}"));
        // What the pieces mean together, the kind may still refuse; by name, and never by its end.
        if let Err(invalid) = builder.build(event.clone(), &columns) {
            assert!(!invalid.0.is_empty());
        }
        shown(event);
    }
}

/// Checks that an effective fault, as shown, is accepted again with the same meaning.
fn shown(event: FaultEvent) {
    let rate = small_plan().run.rate;
    if matches!(event.trigger, Trigger::After { .. }) {
        return; // by the name of another, which is not shown with it
    }
    let step = Step(0);
    let trigger = match event.trigger {
        Trigger::Now => Trigger::Step {
            step,
            at_s: rate.seconds(step),
        },
        trigger => trigger,
    };
    let event = FaultEvent { trigger, ..event };
    let text = fault_toml(&event, plant(), &rig().kinds, rate).expect("what was checked is known");
    let again = check(&text, &[]).unwrap_or_else(|problems| panic!("{problems}\n{text}"));
    let [again] = again.as_slice() else {
        panic!("one fault became {}: {text}", again.len());
    };
    let again = FaultEvent {
        id: event.id,
        ..again.clone()
    };
    assert_eq!(format!("{again:?}"), format!("{event:?}"), "{text}");
}
