//! Properties specific to the stream over shared memory; `conformance` covers those of every stream.

#[path = "../../../tests/shared/drained.rs"]
mod drained;

use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use super::*;
use crate::session::Session;
use drained::{drained, layout};
use shared_types::wait::Sleeper;

#[test]
fn credit_rings_the_bell_of_a_plant_that_awaits_it() {
    let session = Session::create(None).expect("a session");
    let bell = Bell::create(session.info(), Owner::Plant).expect("creates");
    let sink = IceoryxSink::create(session.info(), Backpressure::Always);
    let mut sink = sink.expect("creates");
    sink.open(&layout()).expect("opens");
    let mut source = IceoryxSource::open(session.info(), true).expect("opens");
    let rings = bell.announce();
    source.drain(&mut |_| ()).expect("drains");
    assert_eq!(bell.announce(), rings + 1, "the first credit");
    source.drain(&mut |_| ()).expect("drains");
    assert_eq!(bell.announce(), rings + 1, "no credit, no ring");
}

#[test]
fn without_credit_the_plant_waits_and_nothing_is_lost() {
    let session = Session::create(None).expect("a session");
    let mut sink = IceoryxSink::create(session.info(), Backpressure::Always).expect("creates");
    sink.open(&layout()).expect("opens");
    assert!(!sink.has_room().expect("asks"), "no observer yet");
    let mut source = IceoryxSource::open(session.info(), true).expect("opens");
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
        count > BUFFER as u64 / 2 && count < BUFFER as u64,
        "{count}"
    );
    let items = drained(&mut source);
    let expected: Vec<String> = (0..count).map(|k| format!("record {k}")).collect();
    assert_eq!(items, expected);
    assert!(sink.has_room().expect("asks"), "credit came back");
}

#[test]
fn an_observer_without_credit_sees_its_losses() {
    let session = Session::create(None).expect("a session");
    let mut sink = IceoryxSink::create(session.info(), Backpressure::None).expect("creates");
    sink.open(&layout()).expect("opens");
    let mut source = IceoryxSource::open(session.info(), false).expect("opens");
    drained(&mut source);
    let mut words = vec![0; layout().words()];
    let sent = BUFFER as u64 + 10;
    for k in 0..sent {
        words[0] = k;
        sink.record(&words).expect("publishes");
    }
    let seen = drained(&mut source);
    assert_eq!(seen[0], "Lost(10)");
    assert_eq!(seen[1], "record 10");
    assert_eq!(seen.len(), BUFFER + 1);
}

#[test]
fn a_stream_that_is_not_there_cannot_be_opened() {
    let session = Session::create(None).expect("a session");
    let opened = IceoryxSource::open(session.info(), true);
    assert!(matches!(opened, Err(LinkError::Absent { .. })));
}

/// Replaces each of these segments by a folder, so that nobody can map them; existing mappings remain.
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
    let mut sink = IceoryxSink::create(info, Backpressure::Always).expect("creates");
    let mut source = IceoryxSource::open(info, true).expect("opens");
    let before = info.segments();
    sink.open(&layout()).expect("opens");
    let mut made = info.segments();
    made.retain(|segment| !before.contains(segment) && segment.is_file());
    made_unusable(&made);
    let error = source.drain(&mut |_| {}).expect_err("it cannot be mapped");
    let later = IceoryxSource::watch(info);
    for folder in &made {
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

#[test]
fn a_half_made_service_blocks_nobody_once_removed() {
    let session = Session::create(None).expect("a session");
    let _sink = IceoryxSink::create(session.info(), Backpressure::Always).expect("creates");
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
    let opens = std::thread::spawn(move || IceoryxSource::open(&theirs, true).err());
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
