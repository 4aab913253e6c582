//! Properties specific to the ring within one process and to the assembler; `conformance` covers those of every stream.

#[path = "../../tests/shared/drained.rs"]
mod drained;

use super::*;
use drained::{drained, layout};

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

/// Returns the output of an assembler for items with these numbers, kinds and bytes.
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
