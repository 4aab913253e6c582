//! Items that the recorder takes of a stream, whatever became of the publisher.

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

/// A stream of N records whose plant is dead: a few come with each look.
struct Left {
    records: u64,
    taken: u64,
}

/// The record of a step of the plan, answered by a controller.
fn due(step: u64) -> Vec<u64> {
    let mut words = record(step, 0.0, 0.0);
    let time = layout().values_start() + layout().values();
    words[time] = plan().run.rate.nanoseconds(Step(step));
    words
}

/// Returns the facts that a recorder has after these items, against this clock.
fn taken(clock: Clock, items: Vec<Item<'_>>) -> Recorded {
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
fn refused(clock: Clock, items: Vec<Item<'_>>, records: u64, wanted: &str) {
    let recorded = taken(clock, items);
    let error = recorded.error.expect("it is refused");
    assert!(error.contains(wanted), "{error}");
    assert_eq!(recorded.records, records);
}

#[test]
fn each_record_is_the_step_after_the_one_before() {
    let records: Vec<_> = (0..=1000).map(due).collect();
    let some = |steps: &[usize]| {
        steps
            .iter()
            .map(|step| Item::Record(&records[*step]))
            .collect()
    };
    assert_eq!(taken(Clock::Lockstep, some(&[0, 1, 2])).error, None);
    for (steps, came, wanted) in [
        (
            &[0, 1, 3, 4][..],
            2,
            "a record of step 3 came where that of step 2 was due",
        ),
        (
            &[0, 1, 1],
            2,
            "a record of step 1 came where that of step 2 was due",
        ),
        (
            &[0, 2, 1],
            1,
            "a record of step 2 came where that of step 1 was due",
        ),
        (
            &[1],
            0,
            "a record of step 1 came where that of step 0 was due",
        ),
    ] {
        for clock in [
            Clock::Lockstep,
            Clock::Paced { factor: 1.0 },
            Clock::Realtime,
        ] {
            refused(clock, some(steps), came, wanted);
        }
    }
    let mut all: Vec<_> = records.iter().map(|words| Item::Record(words)).collect();
    all.push(Item::Record(&records[1000]));
    refused(
        Clock::Lockstep,
        all,
        1001,
        "step 1000 came after the last one",
    );
    let mut late = due(0);
    late[layout().values_start() + layout().values()] = 1;
    refused(
        Clock::Lockstep,
        vec![Item::Record(&late)],
        0,
        "its time is 0 ns",
    );
}

#[test]
fn what_is_lost_is_counted_against_the_clock_and_refused_in_lockstep() {
    let [zero, three, five] = [due(0), due(3), due(5)];
    let lossy = || vec![Item::Record(&zero), Item::Lost(2), Item::Record(&three)];
    let recorded = taken(Clock::Realtime, lossy());
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
    // Nobody said that step 4 was lost too.
    let more = [lossy(), vec![Item::Record(&five)]].into_iter().flatten();
    refused(
        Clock::Realtime,
        more.collect(),
        2,
        "step 5 came where that of step 4 was due",
    );
    refused(
        Clock::Lockstep,
        vec![Item::Lost(u64::MAX), Item::Lost(2)],
        0,
        "were lost",
    );
}

#[test]
fn events_that_cannot_be_are_refused() {
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
    let (clock, wanted) = (Clock::Lockstep, "the run has `abort`");
    refused(clock, vec![change(0, lost)], 0, wanted);
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
        "went on after the end",
    );
    let heard = taken(clock, vec![end()]);
    assert_eq!(heard.error, None);
    let reason = heard.end.and_then(|end| end.reason);
    assert_eq!(reason.as_deref(), Some("well \u{fffd}[2J"));
}

impl RecordSource for Left {
    fn drain(&mut self, take: &mut dyn FnMut(Item<'_>)) -> Result<usize, LinkError> {
        let until = (self.taken + 7).min(self.records);
        let count = until - self.taken;
        for step in self.taken..until {
            take(Item::Record(&due(step)));
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
    let mut work = RecorderWork::new(plan(), None, vec![], Arc::clone(&shared));
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

#[test]
fn a_recorder_that_is_stuck_in_what_the_dead_left_is_freed() {
    let (free, freed) = std::sync::mpsc::channel();
    let attach = move || {
        // As iceoryx2 waits for a service whose maker died: here until it is freed, or given up.
        let freed = freed.recv_timeout(Duration::from_secs(60));
        freed
            .map(|()| None::<(Left, RecordLayout)>)
            .map_err(|_| "never freed".to_owned())
    };
    let recorder = Recorder::start(plan(), None, vec![], None, None, || attach);
    // Nobody may be there any more to be freed.
    let unblock = move || free.send(()).unwrap_or_default();
    let recorded = recorder.unblocked_by(None, unblock).finish();
    assert_eq!(recorded.expect("no panic").error, None);
}

#[test]
fn a_recorder_that_never_comes_back_from_the_stream_is_given_up() {
    let (free, freed) = std::sync::mpsc::channel::<()>();
    // As iceoryx2 goes round for ever in memory that was written over.
    let attach = move || {
        let _ = freed.recv(); // until the test drops the other end
        Ok(None::<(Left, RecordLayout)>)
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
fn more_or_longer_marks_than_a_plant_takes_are_refused() {
    let mark = |text: &str| {
        Item::Event(Event::Mark(Mark {
            step: 1,
            text: text.into(),
        }))
    };
    let allowed = (0..MOST_MARKS).map(|_| mark(&"µ".repeat(LONGEST_MARK)));
    let recorded = taken(Clock::Lockstep, allowed.collect());
    assert_eq!((recorded.error, recorded.marks.len()), (None, MOST_MARKS));
    let more = (0..=MOST_MARKS).map(|_| mark("x")).collect();
    refused(Clock::Lockstep, more, 0, "more than 10000 marks");
    let longer = vec![mark(&"x".repeat(LONGEST_MARK + 1))];
    refused(Clock::Lockstep, longer, 0, "a mark of 401 characters");
}
