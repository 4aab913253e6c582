//! Handling of stream items, whatever happens to the publisher.

use hil_config::plan::Clock;
use hil_facts::results::recorded::Recorded;
use shared_types::link::LinkError;
use shared_types::lockstep::OnLoss;
use shared_types::record::{
    ControllerFate, Event, LONGEST_MARK, MOST_MARKS, Mark, Outcome, RunEnd,
};
use shared_types::stream::Item;
use shared_types::time::Step;

use super::*;
use crate::fixture::{layout, record};
use crate::rig::plan;

/// Stream of some records whose plant is dead; each poll delivers a few.
struct Remainder {
    records: u64,
    consumed: u64,
}

/// Returns the expected record of a step of the plan, answered by a controller.
fn due(step: u64) -> Vec<u64> {
    let mut words = record(step, 0.0, 0.0);
    let time = layout().values_start() + layout().values();
    words[time] = plan().run.rate.nanoseconds(Step(step));
    words
}

/// Returns the recorder's results after these items, with this clock.
fn recorded(clock: Clock, items: Vec<Item<'_>>) -> Recorded {
    struct Once<'a>(Vec<Item<'a>>);
    impl RecordSource for Once<'_> {
        fn drain(&mut self, take: &mut dyn FnMut(Item<'_>)) -> Result<usize, LinkError> {
            let items = std::mem::take(&mut self.0);
            let count = items.len();
            items.into_iter().for_each(take);
            Ok(count)
        }
    }
    let shared = Arc::new(Shared::default());
    shared.finish.store(true, Ordering::Release);
    let mut plan = plan();
    plan.run.clock = clock;
    let mut work = RecorderWork::new(plan, None, vec![], shared);
    work.layout = layout();
    work.drain(&mut Once(items));
    work.finish()
}

#[track_caller]
fn refused(clock: Clock, items: Vec<Item<'_>>, records: u64, expected: &str) {
    let recorded = recorded(clock, items);
    let error = recorded.error.expect("it is refused");
    assert!(error.contains(expected), "{error}");
    assert_eq!(recorded.records, records);
}

#[test]
fn each_record_must_be_of_the_next_step() {
    let records: Vec<_> = (0..=1000).map(due).collect();
    let some = |steps: &[usize]| {
        steps
            .iter()
            .map(|step| Item::Record(&records[*step]))
            .collect()
    };
    assert_eq!(recorded(Clock::Lockstep, some(&[0, 1, 2])).error, None);
    #[rustfmt::skip] // a table
    let cases = [
        (&[0, 1, 3, 4][..], 2, "received a record of step 3 instead of step 2"),
        (&[0, 1, 1], 2, "received a record of step 1 instead of step 2"),
        (&[0, 2, 1], 1, "received a record of step 2 instead of step 1"),
        (&[1], 0, "received a record of step 1 instead of step 0"),
    ];
    for (steps, came, expected) in cases {
        for clock in [
            Clock::Lockstep,
            Clock::Paced { factor: 1.0 },
            Clock::Realtime,
        ] {
            refused(clock, some(steps), came, expected);
        }
    }
    let mut all: Vec<_> = records.iter().map(|words| Item::Record(words)).collect();
    all.push(Item::Record(&records[1000]));
    refused(
        Clock::Lockstep,
        all,
        1001,
        "step 1000 after the last record",
    );
    let mut late = due(0);
    late[layout().values_start() + layout().values()] = 1;
    refused(
        Clock::Lockstep,
        vec![Item::Record(&late)],
        0,
        "instead of 0 ns",
    );
}

#[test]
fn lost_items_are_counted_in_real_time_and_refused_in_lockstep() {
    let [zero, three, five] = [due(0), due(3), due(5)];
    let lossy = || vec![Item::Record(&zero), Item::Lost(2), Item::Record(&three)];
    let recorded = recorded(Clock::Realtime, lossy());
    assert_eq!(
        (recorded.records, recorded.lost, recorded.error),
        (2, 2, None)
    );
    for clock in [Clock::Lockstep, Clock::Paced { factor: 1.0 }] {
        refused(
            clock,
            lossy(),
            1,
            "2 items of the record stream were lost before step 1",
        );
    }
    // Step 4 was lost without notice.
    let more = [lossy(), vec![Item::Record(&five)]].into_iter().flatten();
    refused(
        Clock::Realtime,
        more.collect(),
        2,
        "step 5 instead of step 4",
    );
    refused(
        Clock::Lockstep,
        vec![Item::Lost(u64::MAX), Item::Lost(2)],
        0,
        "were lost",
    );
}

#[test]
fn impossible_events_are_refused() {
    let change = |step: u64, change: ControllerFate| {
        let epoch = 1;
        Item::Event(Event::Controller(ControllerChange {
            epoch,
            step,
            change,
        }))
    };
    let refusal = || ControllerFate::Refused {
        reason: "late".into(),
    };
    let lost = ControllerFate::Lost {
        reason: "gone".into(),
        policy: OnLoss::Hold,
    };
    let (clock, expected) = (Clock::Lockstep, "the run has the policy `abort`");
    refused(clock, vec![change(0, lost)], 0, expected);
    refused(
        clock,
        vec![change(1001, refusal())],
        0,
        "an event of step 1001",
    );
    let many = (0..1000).map(|_| change(0, refusal())).collect();
    refused(clock, many, 0, "changes of controllers");
    let end = || {
        Item::Event(Event::End(RunEnd {
            reason: Some("well \u{1b}[2J".into()),
            ..RunEnd::new(0, Outcome::Stopped)
        }))
    };
    refused(
        clock,
        vec![end(), Item::Record(&due(0))],
        0,
        "continued after the end",
    );
    let recorded = recorded(clock, vec![end()]);
    assert_eq!(recorded.error, None);
    let reason = recorded.end.and_then(|end| end.reason);
    assert_eq!(reason.as_deref(), Some("well \u{fffd}[2J"));
}

impl RecordSource for Remainder {
    fn drain(&mut self, take: &mut dyn FnMut(Item<'_>)) -> Result<usize, LinkError> {
        let until = (self.consumed + 7).min(self.records);
        let count = until - self.consumed;
        for step in self.consumed..until {
            take(Item::Record(&due(step)));
        }
        self.consumed = until;
        Ok(count as usize)
    }
}

#[test]
fn the_stream_of_a_dead_plant_is_drained() {
    let shared = Arc::new(Shared::default());
    // All that is known of the run is that it is over.
    shared.finish.store(true, Ordering::Release);
    let mut work = RecorderWork::new(plan(), None, vec![], Arc::clone(&shared));
    work.layout = layout();
    work.drain(&mut Remainder {
        records: 500,
        consumed: 0,
    });
    let recorded = work.finish();
    assert_eq!((recorded.records, recorded.lost), (500, 0));
    assert_eq!((recorded.end, recorded.error), (None, None));
    assert_eq!(shared.next_step.load(Ordering::Relaxed), 500);
}

#[test]
fn a_recorder_stuck_in_an_incomplete_stream_is_freed() {
    let (free, freed) = std::sync::mpsc::channel();
    let attach = move || {
        // iceoryx2 waits like this for a service whose creator died: here until it is freed, or given up.
        let freed = freed.recv_timeout(Duration::from_secs(60));
        freed
            .map(|()| None::<(Remainder, RecordLayout)>)
            .map_err(|_| "never freed".to_owned())
    };
    let recorder = Recorder::start(plan(), None, vec![], None, None, || attach);
    // There may be no thread left to free.
    let unblock = move || free.send(()).unwrap_or_default();
    let recorded = recorder.unblocked_by(None, unblock).finish();
    assert_eq!(recorded.expect("no panic").error, None);
}

#[test]
fn a_recorder_that_never_returns_from_the_stream_is_abandoned() {
    let (free, freed) = std::sync::mpsc::channel::<()>();
    // iceoryx2 loops like this for ever in corrupted memory.
    let attach = move || {
        let _ = freed.recv(); // until the test drops the other end
        Ok(None::<(Remainder, RecordLayout)>)
    };
    let recorder = Recorder::start(plan(), None, vec![], None, None, || attach);
    let mut recorder = recorder.unblocked_by(Some(STUCK), || ());
    let thread = recorder.thread.take().expect("started");
    assert!(!recorder.comes_back(&thread));
    recorder.shared.finish.store(true, Ordering::Release);
    drop(free);
    assert!(recorder.comes_back(&thread));
}

#[test]
fn more_or_longer_marks_than_a_plant_accepts_are_refused() {
    let mark = |text: &str| {
        Item::Event(Event::Mark(Mark {
            step: 1,
            text: text.into(),
        }))
    };
    let allowed = (0..MOST_MARKS).map(|_| mark(&"µ".repeat(LONGEST_MARK)));
    let recorded = recorded(Clock::Lockstep, allowed.collect());
    assert_eq!((recorded.error, recorded.marks.len()), (None, MOST_MARKS));
    let more = (0..=MOST_MARKS).map(|_| mark("x")).collect();
    refused(Clock::Lockstep, more, 0, "more than 10000 marks");
    let longer = vec![mark(&"x".repeat(LONGEST_MARK + 1))];
    refused(Clock::Lockstep, longer, 0, "a mark of 401 characters");
}
