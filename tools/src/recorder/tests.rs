//! What the recorder takes of a stream, whatever became of who published it.

use std::path::Path;

use shared_types::describe::{Description, LawDescription};
use shared_types::link::LinkError;
use shared_types::stream::Item;

use super::*;
use crate::inject::a_rig;
use crate::repetition::checked;
use crate::run_reader::tests::{layout, record};

const SCENARIO: &str = r#"
schema = 1
name = "demo"
[run]
duration_s = 1.0
rate_hz = 1000
[plant]
model = "rig"
[plant.parameters]
actuator1.leak = 0.0
actuator2.leak = 0.0
[controller]
law = "quiet"
[[stimuli]]
target = "surface_angle_rad"
kind = "step"
at_s = 0.0
after = 1.0
"#;

fn plan() -> Plan {
    let possible = a_rig();
    let mut plant = Description::new("some-plant", "1");
    plant.plants = vec![possible.plant];
    plant.faults = possible.kinds;
    let mut controller = Description::new("some-controller", "1");
    controller.laws = vec![LawDescription {
        name: "quiet".into(),
        summary: "Does nothing.".into(),
        plants: vec![],
        parameters: vec![],
        model: vec![],
        measured: vec![],
        reference: vec![],
        commands: None,
        internals: vec![],
        saves: false,
    }];
    let checked = checked(SCENARIO, Path::new("demo"), &plant, &controller);
    checked.expect("a right scenario")
}

/// A stream of so many records whose plant is dead: a few come with each look.
struct Left {
    records: u64,
    taken: u64,
}

impl RecordSource for Left {
    fn drain(&mut self, take: &mut dyn FnMut(Item<'_>)) -> Result<usize, LinkError> {
        let until = (self.taken + 7).min(self.records);
        let count = until - self.taken;
        for step in self.taken..until {
            take(Item::Record(&record(step, 0.0, 0.0)));
        }
        self.taken = until;
        Ok(count as usize)
    }
}

#[test]
fn the_stream_of_a_dead_plant_is_taken_to_its_end() {
    let shared = Arc::new(Shared::default());
    // All that is known of the run: it is over.
    shared.finish.store(true, Ordering::Release);
    let mut work = Work::new(plan(), None, vec![], Arc::clone(&shared));
    work.layout = layout();
    work.drain(&mut Left {
        records: 500,
        taken: 0,
    });
    let recorded = work.finish();
    assert_eq!((recorded.records, recorded.lost), (500, 0));
    assert_eq!((recorded.end, recorded.error), (None, None));
    assert_eq!(shared.next_step.load(Ordering::Relaxed), 500);
}
