//! Credibility of a recording that states its own end.

use shared_types::record::{Event, RunEnd};

use super::*;
use crate::fixture::{Content, recorded};
use crate::rig::{SCENARIO, attachments, described, plan};

/// Returns a recording of some records whose plant reports that it completed all 1000 steps.
fn of_records(records: u64) -> RecordedOutcome {
    let [plant, controller] = described();
    let plan = plan();
    let layout = plan.record_layout(&plant.plants[0], &controller.laws[0]);
    let epoch = layout.values_start() + layout.values() + 1;
    let mut contents: Vec<Content> = (0..records)
        .map(|step| {
            let mut words = vec![0; layout.words()];
            (words[0], words[epoch]) = (step, 1);
            Content::Record(words)
        })
        .collect();
    contents.push(Content::Event(Event::End(RunEnd::new(
        1000,
        Outcome::Completed,
    ))));
    let attachments = attachments(SCENARIO.to_owned());
    let folder = recorded(&layout, &contents, attachments);
    RecordedOutcome::of(&folder, None).expect("a recording")
}

#[test]
fn an_end_contradicted_by_the_records_is_not_accepted() {
    assert_eq!(of_records(1001).outcome(None), (Outcome::Completed, None));
    let (outcome, reason) = of_records(858).outcome(None);
    assert_eq!(outcome, Outcome::Failed);
    let reason = reason.expect("why");
    assert!(reason.contains("1001 records, but 858 arrived"), "{reason}");
}
