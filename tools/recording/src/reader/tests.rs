use shared_types::record::{Outcome, RunEnd, Timing};

use super::*;
use crate::compression::Compression;
use crate::fixture::{Content, chunked, layout, record, recorded, taken};
use crate::writer::Attachment;
use shared_types::time::Step;

#[test]
fn a_recording_is_read_back_unchanged() {
    let end = Event::End(RunEnd::new(2, Outcome::Completed));
    let contents = [
        Content::Record(record(0, 0.5, 2.0)),
        Content::Event(taken(1)),
        Content::Record(record(1, -0.0, f64::NAN)),
        Content::Event(end.clone()),
    ];
    let attachment = Attachment {
        name: "scenario.toml",
        media_type: "application/toml",
        text: "schema = 1".into(),
    };
    let folder = recorded(&layout(), &contents, vec![attachment]);
    let mut reader = RunReader::open(&folder).expect("opens");
    assert_eq!(reader.rate().expect("a rate").hz(), 1000.0);
    assert_eq!(
        reader.attachment("scenario.toml").expect("enclosed"),
        "schema = 1"
    );
    assert!(reader.attachment("other.toml").is_err());
    let names: Vec<&str> = reader
        .columns()
        .iter()
        .map(|column| column.name.as_str())
        .collect();
    let signals = [
        "truth.x_m",
        "measured.x_m",
        "command.u_n",
        "applied.u_n",
        "sensed.x_m",
        "parameter.mass_kg",
    ];
    let bits = ["step", "sample_invalid[0]", "command_invalid[0]"];
    assert_eq!(names, [&bits[..], &signals, &Timing::NAMES].concat());
    assert_eq!(
        (reader.columns()[4].unit.as_str(), reader.hashed_words()),
        ("m", 7)
    );
    assert!(reader.advance().expect("read"));
    assert_eq!(
        (reader.words(), reader.events()),
        (&record(0, 0.5, 2.0)[..], &[][..])
    );
    assert!(reader.advance().expect("read"));
    assert_eq!((reader.step(), reader.events()), (1, &[taken(1)][..]));
    assert_eq!(reader.words(), record(1, -0.0, f64::NAN));
    assert!(!reader.advance().expect("read"));
    assert_eq!((reader.events(), reader.records()), (&[end][..], 2));
    assert_eq!(
        (reader.result("outcome"), reader.is_whole()),
        (Some("completed"), true)
    );
    // Computed from the definition of the digest.
    let text = "1 bias measured.x_m x_m bias=0 step";
    let mut hasher = blake3::Hasher::new();
    let words = |hasher: &mut blake3::Hasher, words: &[u64]| {
        words.iter().for_each(|word| {
            hasher.update(&word.to_le_bytes());
        });
    };
    words(&mut hasher, &record(0, 0.5, 2.0)[..7]);
    words(&mut hasher, &[text.len() as u64]);
    hasher.update(text.as_bytes());
    words(&mut hasher, &record(1, -0.0, f64::NAN)[..7]);
    assert_eq!(reader.digest(), hasher.finalize().to_hex().to_string());
}

#[test]
fn records_are_read_into_a_batch_behind_one_another() {
    let contents = [
        Content::Record(record(0, 0.5, 2.0)),
        Content::Event(taken(1)),
        Content::Record(record(1, -0.0, f64::NAN)),
    ];
    let folder = recorded(&layout(), &contents, vec![]);
    let mut reader = RunReader::open(&folder).expect("opens");
    let mut batch = vec![7];
    assert!(reader.advance_into(&mut batch).expect("read"));
    assert_eq!((reader.step(), reader.events()), (0, &[][..]));
    assert!(reader.advance_into(&mut batch).expect("read"));
    assert_eq!((reader.step(), reader.events()), (1, &[taken(1)][..]));
    assert!(!reader.advance_into(&mut batch).expect("read"));
    assert_eq!((reader.step(), reader.records()), (1, 2));
    let expected = [record(0, 0.5, 2.0), record(1, -0.0, f64::NAN)].concat();
    assert_eq!(batch, [&[7], &expected[..]].concat());
}

#[test]
fn a_truncated_file_is_read_as_far_as_it_goes() {
    let contents: Vec<Content> = (0..2000)
        .map(|step| Content::Record(record(step, step as f64, 0.0)))
        .collect();
    let folder = recorded(&layout(), &contents, vec![]);
    let path = folder.join(RECORDING);
    let bytes = std::fs::read(&path).expect("read");
    std::fs::write(&path, &bytes[..bytes.len() / 2]).expect("written");
    let mut reader = RunReader::open(&path).expect("opens");
    let mut records = 0;
    while reader.advance().expect("reads on") {
        assert_eq!(reader.words(), record(records, records as f64, 0.0));
        records += 1;
    }
    assert!(!reader.is_whole() && records < 2000, "{records}");
}

#[test]
fn files_that_are_not_recordings_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = folder.path().join("text");
    std::fs::write(&text, "not an MCAP file at all").expect("written");
    let message = |path: &Path| RunReader::open(path).err().expect("refused").to_string();
    assert!(message(folder.path()).contains("has no recording"));
    assert!(message(&text).contains("is not a recording of a run"));
    assert!(message(&folder.path().join("nothing")).starts_with("cannot read"));
}

#[test]
fn a_recording_truncated_before_its_first_record_is_reported_as_cut_off() {
    let contents = [Content::Record(record(0, 0.0, 0.0))];
    let folder = recorded(&layout(), &contents, vec![]);
    let path = folder.join(RECORDING);
    let whole = std::fs::read(&path).expect("read");
    let channel = whole.windows(7).position(|bytes| bytes == b"/record");
    for length in [0, 4, 8, 60, channel.expect("a channel") - 20] {
        std::fs::write(&path, &whole[..length]).expect("written");
        let message = RunReader::open(&folder).err().expect("refused").to_string();
        let expected = format!("was cut off after {length} bytes, before its first record");
        assert!(message.contains(&expected), "{message}");
    }
}

#[test]
fn steps_out_of_order_or_out_of_range_are_damage() {
    #[rustfmt::skip] // a table
    let cases = [
        ("twice", [3, 3], "after 1 records: step 3, but expected step 4"),
        ("back", [3, 2], "after 1 records: step 2, but expected step 4"),
        ("huge", [3, u64::MAX], "after 1 records: step 18446744073709551615"),
    ];
    for (name, steps, message) in cases {
        let contents = steps.map(|step| Content::Record(record(step, 0.0, 0.0)));
        let folder = recorded(&layout(), &contents, vec![]);
        let mut reader = RunReader::open(&folder).expect("opens");
        assert!(reader.advance().expect("the first is right"), "{name}");
        let error = reader.advance().expect_err(name).to_string();
        assert!(
            error.contains("is damaged at byte ") && error.contains(message),
            "{error}"
        );
        assert_eq!((reader.step(), reader.records()), (3, 1), "{name}");
    }
}

#[test]
fn a_schema_with_too_many_words_is_refused() {
    let words = |count: &str| schema::columns_of(&format!("uint64 step\nuint64[{count}] x"));
    assert_eq!(words("3").map(|columns| columns.len()), Some(4));
    for count in ["100000", "18446744073709551615", "-1", ""] {
        assert_eq!(words(count), None, "{count}");
    }
}

#[test]
fn a_schema_of_absurd_width_is_refused() {
    for schema in [
        "uint64 step\nuint64[99999999999] sample_invalid\n",
        "uint64 step\nuint64[1025] sample_invalid\n",
        "uint64 step\nuint32[2052] sample_invalid\n",
        "uint64 step\nuint32[3] sample_invalid\n",
        "uint64[0] step\n",
        "",
    ] {
        assert!(schema::columns_of(schema).is_none(), "{schema}");
    }
    let widest = "uint64 step\nuint64[1024] sample_invalid\n";
    assert_eq!(schema::columns_of(widest).map(|all| all.len()), Some(1025));
}

#[test]
fn a_span_is_read_from_the_chunks_that_contain_it() {
    const TIME: usize = 9;
    let row = |step: u64| {
        let mut row = record(step, step as f64, -1.0);
        row[TIME] = step * 1_000_000; // at 1000 Hz
        row
    };
    let contents: Vec<Content> = (0..40_000).map(|step| Content::Record(row(step))).collect();
    let folder = chunked(&layout(), &contents, Vec::new(), Compression::Lz4, 5000);
    let reader = RunReader::open(&folder).expect("opens");
    let spans = SpanReader::of(&reader).expect("located");
    let read = |first: u64, last: u64| {
        let mut rows = Vec::new();
        let count = spans.read(Step(first), Step(last), |words| rows.push(words.to_vec()));
        (rows, count)
    };
    let (rows, all) = read(0, 40_000);
    let all = all.expect("read");
    assert_eq!(rows, (0..40_000).map(row).collect::<Vec<_>>());
    assert!(all >= 8, "{all} chunks");
    let (rows, some) = read(20_000, 20_002);
    assert_eq!(rows, [row(20_000), row(20_001), row(20_002)]);
    assert!(some.expect("read") <= 2);
    assert_eq!(read(40_000, 50_000).0, Vec::<Vec<u64>>::new());

    // A changed bit in the first chunk is found there, and nowhere else.
    let path = folder.join(RECORDING);
    let mut bytes = std::fs::read(&path).expect("the file");
    let first = bytes.len() / (2 * all);
    bytes[first] ^= 1;
    std::fs::write(&path, &bytes).expect("written");
    assert!(read(20_000, 20_002).1.is_ok());
    assert!(read(0, 1).1.is_err());
    // A truncated file is read up to its last complete chunk.
    bytes[first] ^= 1;
    std::fs::write(&path, &bytes[..bytes.len() * 7 / 10]).expect("written");
    let spans = SpanReader::of(&RunReader::open(&folder).expect("opens")).expect("located");
    let mut last = 0;
    spans
        .read(Step(0), Step(40_000), |words| last = words[0])
        .expect("read");
    assert!((20_000..39_000).contains(&last), "{last}");
}
