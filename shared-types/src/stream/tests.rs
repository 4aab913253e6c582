//! Properties specific to the stream over shared memory and to the assembler; `conformance` has those of every stream.

use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use super::*;
use crate::link::bell::{Bell, Owner};
use crate::record::RecordLayout;
use crate::session::Session;
use crate::table::Field;
use crate::wait::Sleeper;

fn layout() -> RecordLayout {
    let field = Field::signal("angle_rad", "rad", "x");
    RecordLayout {
        truth: vec![field.clone()],
        measured: vec![field],
        command_signals: 1,
        ..RecordLayout::default()
    }
}

/// Drains a source into text.
fn drained(source: &mut dyn RecordSource) -> Vec<String> {
    let mut items = Vec::new();
    loop {
        let count = source.drain(&mut |item| {
            items.push(match item {
                Item::Record(words) => format!("record {}", words[0]),
                other => format!("{other:?}"),
            });
        });
        if count.expect("drains") == 0 {
            return items;
        }
    }
}

#[test]
fn credit_rings_the_bell_of_a_plant_that_awaits_it() {
    let session = Session::create(None).expect("a session");
    let bell = Bell::create(session.info(), Owner::Plant).expect("creates");
    let sink = iceoryx::IceoryxSink::create(session.info(), Backpressure::Always);
    let mut sink = sink.expect("creates");
    sink.open(&layout()).expect("opens");
    let mut source = iceoryx::IceoryxSource::open(session.info(), true).expect("opens");
    let rings = bell.announce();
    source.drain(&mut |_| ()).expect("drains");
    assert_eq!(bell.announce(), rings + 1, "the first credit");
    source.drain(&mut |_| ()).expect("drains");
    assert_eq!(bell.announce(), rings + 1, "no credit, no ring");
}

#[test]
fn without_credit_the_plant_waits_and_nothing_is_lost() {
    let session = Session::create(None).expect("a session");
    let mut sink =
        iceoryx::IceoryxSink::create(session.info(), Backpressure::Always).expect("creates");
    sink.open(&layout()).expect("opens");
    assert!(!sink.has_room().expect("asks"), "no observer yet");
    let mut source = iceoryx::IceoryxSource::open(session.info(), true).expect("opens");
    assert!(
        !sink.has_room().expect("asks"),
        "an observer that has not looked"
    );
    assert!(drained(&mut source).is_empty());
    let mut words = vec![0; layout().words()];
    let mut count = 0;
    while sink.has_room().expect("asks") {
        words[0] = count;
        sink.record(&words).expect("publishes");
        count += 1;
    }
    assert!(
        count > iceoryx::BUFFER as u64 / 2 && count < iceoryx::BUFFER as u64,
        "{count}"
    );
    let items = drained(&mut source);
    let expected: Vec<String> = (0..count).map(|k| format!("record {k}")).collect();
    assert_eq!(items, expected);
    assert!(sink.has_room().expect("asks"), "credit came back");
}

#[test]
fn the_ring_has_room_for_the_longest_fault_whenever_it_has_room() {
    let (mut sink, mut source) = in_process::pair();
    sink.open(&layout()).expect("opens");
    let words = vec![0; layout().words()];
    let mut before = 0;
    loop {
        sink.record(&words).expect("publishes");
        before += 1;
        if !sink.has_room().expect("asks") {
            break;
        }
    }
    // The rest is smaller by one record than the minimum that a sink with room has.
    let text = "0".repeat(10_000 * 2 * 25);
    let mark = crate::record::Mark { step: 0, text };
    (sink.event(&Event::Mark(mark))).expect("two numbers of 25 bytes for each of 10,000 points");
    let items = drained(&mut source);
    assert_eq!(items.len(), before + 1);
    assert!(items[before].starts_with("Event(Mark("));
}

#[test]
fn an_observer_without_credit_sees_its_losses() {
    let session = Session::create(None).expect("a session");
    let mut sink =
        iceoryx::IceoryxSink::create(session.info(), Backpressure::None).expect("creates");
    sink.open(&layout()).expect("opens");
    let mut source = iceoryx::IceoryxSource::open(session.info(), false).expect("opens");
    drained(&mut source);
    let mut words = vec![0; layout().words()];
    let count = iceoryx::BUFFER as u64 + 10;
    for k in 0..count {
        words[0] = k;
        sink.record(&words).expect("publishes");
    }
    let items = drained(&mut source);
    assert_eq!(items[0], "Lost(10)");
    assert_eq!(items[1], "record 10");
    assert_eq!(items.len(), iceoryx::BUFFER + 1);
}

#[test]
fn a_stream_that_is_not_there_cannot_be_opened() {
    let session = Session::create(None).expect("a session");
    let opened = iceoryx::IceoryxSource::open(session.info(), true);
    assert!(matches!(opened, Err(LinkError::Absent { .. })));
}

/// Replaces each of these segments by a folder, so that nobody can map it; existing mappings remain.
fn made_unusable(segments: &[std::path::PathBuf]) {
    for segment in segments {
        std::fs::remove_file(segment).expect("removed");
        std::fs::create_dir(segment).expect("a folder");
    }
}

#[test]
fn an_unmappable_stream_fails_by_name_instead_of_seeming_silent() {
    let session = Session::create(None).expect("a session");
    let info = session.info();
    let mut sink = iceoryx::IceoryxSink::create(info, Backpressure::Always).expect("creates");
    let mut source = iceoryx::IceoryxSource::open(info, true).expect("opens");
    let before = info.segments();
    sink.open(&layout()).expect("opens");
    let mut segments = info.segments();
    segments.retain(|segment| !before.contains(segment) && segment.is_file());
    made_unusable(&segments);
    let error = source.drain(&mut |_| {}).expect_err("it cannot be mapped");
    let later = iceoryx::IceoryxSource::watch(info);
    for folder in &segments {
        std::fs::remove_dir(folder).expect("removed");
    }
    assert!(matches!(error, LinkError::Transport { .. }), "{error}");
    assert!(
        error
            .to_string()
            .contains("iceoryx2 reports ConnectionFailure"),
        "{error}"
    );
    assert!(later.is_err(), "a publisher that was there before");
}

/// Returns what an assembler makes of items with these numbers, kinds and bytes.
fn assembled(items: &[(u64, u64, &[u8])]) -> Vec<String> {
    let mut assembler = Assembler::default();
    let mut list = Vec::new();
    for (sequence, kind, bytes) in items {
        let mut words = vec![0_u64; bytes.len().div_ceil(8)];
        zerocopy::IntoBytes::as_mut_bytes(&mut words[..])[..bytes.len()].copy_from_slice(bytes);
        let head = (*sequence, *kind, bytes.len() as u64);
        assembler.take(head, &words, &mut |item| list.push(format!("{item:?}")));
    }
    list
}

#[test]
fn an_item_with_a_repeated_number_is_broken() {
    let record = |sequence| (sequence, ItemKind::Record as u64, &[][..]);
    let most = LARGEST_LOSS;
    for (before, after) in [(1, 1), (2, 1), (1, 0), (most, most), (most, 0)] {
        let items = assembled(&[record(before), record(after)]);
        let expected = format!("Broken(\"item {after} came after item {before}\")");
        assert_eq!(items.last(), Some(&expected), "{items:?}");
    }
    let expected = format!("Lost({most})");
    let items = assembled(&[record(most + 1)]);
    assert_eq!(items, [expected, "Record([])".into()]);
}

#[test]
fn an_impossible_loss_is_reported_as_broken() {
    let record = |sequence| (sequence, ItemKind::Record as u64, &[][..]);
    for sequence in [LARGEST_LOSS + 2, u64::MAX] {
        let items = assembled(&[record(sequence)]);
        let [one] = &items[..] else {
            panic!("{items:?}")
        };
        assert!(
            one.starts_with("Broken(") && one.contains("was overwritten"),
            "{one}"
        );
    }
}

#[test]
fn an_endless_event_is_abandoned() {
    let piece = vec![b' '; LONGEST_EVENT / 4];
    let part = |sequence| (sequence, ItemKind::EventPart as u64, piece.as_slice());
    let items: Vec<_> = (1..=8).map(part).collect();
    let reported = assembled(&items);
    assert!(
        reported[0].contains("Broken(\"an event of more than"),
        "{reported:?}"
    );
    assert_eq!(reported.len(), 1);
}

#[test]
fn a_half_made_service_blocks_nobody_once_removed() {
    let session = Session::create(None).expect("a session");
    let _sink =
        iceoryx::IceoryxSink::create(session.info(), Backpressure::Always).expect("creates");
    // As after a death between the creation of a segment and setting its size.
    let dynamic = |path: &PathBuf| path.extension().is_some_and(|kind| kind == "dynamic");
    let segments: Vec<PathBuf> = session
        .info()
        .segments()
        .into_iter()
        .filter(dynamic)
        .collect();
    assert!(!segments.is_empty(), "{:?}", session.info().segments());
    for segment in &segments {
        std::fs::remove_file(segment).expect("it is ours");
        let mut options = std::fs::File::options();
        let empty = options
            .write(true)
            .create_new(true)
            .mode(0o600)
            .open(segment);
        empty.expect("an empty one");
    }
    let theirs = session.info().clone();
    let opens = std::thread::spawn(move || iceoryx::IceoryxSource::open(&theirs, true).err());
    let since = Instant::now();
    // Longer than any limit that iceoryx2 has for a service under construction.
    std::thread::sleep(Duration::from_secs(1));
    assert!(
        !opens.is_finished(),
        "iceoryx2 gives up by itself: nothing needs to be removed any more"
    );
    while !opens.is_finished() {
        assert!(
            since.elapsed() < Duration::from_secs(60),
            "it waits for ever"
        );
        std::thread::sleep(Duration::from_millis(10));
        session.info().remove_unfinished();
    }
    let error = opens.join().expect("no panic").expect("nothing to open");
    assert!(matches!(error, LinkError::Absent { .. }), "{error}");
}
