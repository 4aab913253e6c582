//! Properties of record streams that a recorder relies on to lose no record.

use std::thread::yield_now;
use std::time::{Duration, Instant};

use super::Sentence;
use crate::record::{Event, FaultBegun, RecordLayout};
use crate::stream::{Item, RecordSink, RecordSource};
use crate::table::Field;

/// Meeting point of a plant's sink and a recorder's source.
pub trait Fixture {
    /// The plant's end.
    type Sink: RecordSink;
    /// The recorder's end.
    type Source: RecordSource;

    /// Time after which an undelivered item counts as lost.
    const PATIENCE: Duration = Duration::from_secs(20);

    /// Creates the meeting point, which outlives the ends opened in it.
    fn new() -> Self;

    /// Connects the sink of a plant that must deliver every record, and a function that opens the source on any thread.
    fn connect(&mut self) -> (Self::Sink, impl FnOnce() -> Self::Source + Send + 'static);
}

/// Lists the properties for one implementation.
#[must_use]
pub fn sentences<F: Fixture>() -> Vec<Sentence> {
    crate::conformance!(@stream list F)
}

/// More records than any stream accepts without credit.
const MANY: u64 = 1 << 20;
/// Items that a property publishes unless it needs many.
const SOME: u64 = 100;

fn layout() -> RecordLayout {
    let field = Field::signal("angle_rad", "rad", "x");
    RecordLayout {
        truth: vec![field.clone()],
        measured: vec![field],
        command_signals: 1,
        ..RecordLayout::default()
    }
}

fn event(text: &str) -> Event {
    Event::Fault(FaultBegun {
        effect: 0,
        wall_only: false,
        id: 1,
        step: 2,
        kind: "leakage".into(),
        target: "actuator1".into(),
        parameter: text.into(),
        canonical: String::new(),
    })
}

/// Publishes the record of a step; each of its words is the step.
fn publish(sink: &mut impl RecordSink, step: u64) {
    let words = vec![step; layout().words()];
    sink.record(&words).expect("a record is published");
}

fn record(step: u64) -> String {
    format!("record {step}")
}

/// Drains the source into text: each record as its step, or as its difference from the expected words.
fn take(source: &mut impl RecordSource, items: &mut Vec<String>) -> usize {
    let result = source.drain(&mut |item| {
        items.push(match item {
            Item::Record(words) if words == vec![words[0]; layout().words()] => record(words[0]),
            Item::Event(Event::Fault(fault)) => format!("event {}", fault.parameter.len()),
            other => format!("{other:?}"),
        });
    });
    result.expect("a source drains")
}

/// Drains until N items arrived and no more follow.
fn drained<F: Fixture>(source: &mut F::Source, items: usize) -> Vec<String> {
    let mut list = Vec::new();
    let since = Instant::now();
    while take(source, &mut list) > 0 || list.len() < items {
        assert!(
            since.elapsed() < F::PATIENCE,
            "only {} of {items} items came: {:?}",
            list.len(),
            &list[list.len().saturating_sub(3)..]
        );
        yield_now();
    }
    list
}

/// Opens both ends; the recorder has polled once, and there is room.
fn opened<F: Fixture>(place: &mut F) -> (F::Sink, F::Source) {
    let (mut sink, opens) = place.connect();
    sink.open(&layout()).expect("a sink opens");
    let mut source = opens();
    assert!(drained::<F>(&mut source, 0).is_empty());
    room::<F>(&mut sink);
    (sink, source)
}

/// Waits until there is room.
fn room<F: Fixture>(sink: &mut F::Sink) {
    let since = Instant::now();
    while !sink.has_room().expect("a sink can be asked") {
        assert!(since.elapsed() < F::PATIENCE, "there is never room");
        yield_now();
    }
}

/// Records and events, also events longer than a record, arrive in order.
pub fn records_and_events_arrive_in_order_and_once<F: Fixture>() {
    let mut place = F::new();
    let (mut sink, mut source) = opened(&mut place);
    publish(&mut sink, 0);
    let long = event(&"long ".repeat(500));
    sink.event(&long).expect("an event is published");
    publish(&mut sink, 1);
    let expected = ["record 0", "event 2500", "record 1"];
    assert_eq!(drained::<F>(&mut source, expected.len()), expected);
    assert!(drained::<F>(&mut source, 0).is_empty(), "they came already");
}

/// A sink reports that it is full before a record could be lost, and reports room again once records are drained.
pub fn a_plant_without_credit_waits_and_loses_nothing<F: Fixture>() {
    let mut place = F::new();
    let (mut sink, mut source) = opened(&mut place);
    let mut expected = Vec::new();
    for round in 0..3 {
        let mut count = 0;
        while sink.has_room().expect("a sink can be asked") {
            publish(&mut sink, count);
            expected.push(record(count));
            count += 1;
            assert!(count < MANY, "it never waits for its recorder");
        }
        assert!(
            count > SOME,
            "in round {round} it waits after {count} records"
        );
        assert_eq!(drained::<F>(&mut source, expected.len()), expected);
        expected.clear();
        room::<F>(&mut sink);
    }
}

/// A plant sees how many records its recorder has drained, or that it need not wait for one.
pub fn credit_counts_what_was_taken<F: Fixture>() {
    let mut place = F::new();
    let (mut sink, mut source) = opened(&mut place);
    for step in 0..SOME {
        publish(&mut sink, step);
    }
    let (sent_count, taken_count) = sink.sent_and_taken().expect("a sink can be asked");
    assert!(
        (sent_count, taken_count) == (SOME, 0) || sent_count == taken_count,
        "{taken_count} of {sent_count}"
    );
    drained::<F>(&mut source, SOME as usize);
    let since = Instant::now();
    loop {
        let (sent_count, taken_count) = sink.sent_and_taken().expect("a sink can be asked");
        if sent_count == taken_count {
            return;
        }
        let waited = since.elapsed();
        assert!(
            waited < F::PATIENCE,
            "{taken_count} of {sent_count} after {waited:?}"
        );
        yield_now();
    }
}

/// A record is never a mix of two records, and no record is missing.
pub fn records_are_whole_while_both_ends_work<F: Fixture>() {
    const LAST: u64 = 20_000;
    let mut place = F::new();
    let (mut sink, opens) = place.connect();
    sink.open(&layout()).expect("a sink opens");
    let takes = std::thread::spawn(move || {
        let mut source = opens();
        let (mut items, mut next, mut since) = (Vec::new(), 0, Instant::now());
        while next < LAST {
            if take(&mut source, &mut items) > 0 {
                since = Instant::now();
            }
            for item in items.drain(..) {
                assert_eq!(item, record(next));
                next += 1;
            }
            let waited = since.elapsed();
            assert!(waited < F::PATIENCE, "no record {next} within {waited:?}");
            yield_now();
        }
    });
    for step in 0..LAST {
        while !sink.has_room().expect("a sink can be asked") && !takes.is_finished() {
            yield_now();
        }
        publish(&mut sink, step);
    }
    takes.join().expect("every record came whole");
}

/// Items that a plant published before its death arrive; the silence after them is no error.
pub fn a_dead_plant_is_silent_after_its_last_record<F: Fixture>() {
    let mut place = F::new();
    let (mut sink, mut source) = opened(&mut place);
    for step in 0..SOME {
        publish(&mut sink, step);
    }
    drop(sink);
    let expected: Vec<String> = (0..SOME).map(record).collect();
    assert_eq!(drained::<F>(&mut source, expected.len()), expected);
    assert!(drained::<F>(&mut source, 0).is_empty());
}

/// A vanished recorder drains no more records; the plant does not treat this as an error.
pub fn a_dead_recorder_holds_nobody_up<F: Fixture>() {
    let mut place = F::new();
    let (mut sink, source) = opened(&mut place);
    drop(source);
    let mut count = 0;
    while count < SOME && sink.has_room().expect("a sink can be asked") {
        publish(&mut sink, count);
        count += 1;
    }
    assert_eq!(count, SOME, "there was room for as many");
}
