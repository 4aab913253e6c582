use std::path::PathBuf;

use super::*;

/// Messages written by another program; `tests/golden/flight.py` makes them.
fn flight() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/flight.mcap")
}

type Rows = Vec<(u64, Vec<f64>)>;

fn rows(columns: &[&str]) -> Result<Rows, RosError> {
    let file = RosFile::open(&flight(), columns)?;
    let places: Vec<usize> = columns
        .iter()
        .map(|column| file.fields().iter().position(|field| field == column))
        .map(|place| place.expect("a field"))
        .collect();
    let mut rows = Vec::new();
    file.read(&places, |time_ns, row| {
        rows.push((time_ns, row.to_vec()));
        Ok(())
    })?;
    Ok(rows)
}

#[test]
fn numbers_are_listed_by_topic_and_path() {
    let file = RosFile::open(&flight(), &[]).expect("messages");
    let expected = [
        "/imu.header.stamp.sec",
        "/imu.header.stamp.nanosec",
        "/imu.valid",
        "/imu.rate.x",
        "/imu.rate.y",
        "/imu.rate.z",
        "/imu.gains[0]",
        "/imu.gains[1]",
        "/imu.gains[2]",
        "/imu.position[0]",
        "/load.data",
    ];
    assert_eq!(file.fields(), expected);
}

#[test]
fn fields_behind_texts_and_sequences_are_read() {
    let columns = [
        "/imu.position[1]",
        "/imu.rate.y",
        "/imu.valid",
        "/imu.gains[1]",
        "/imu.header.stamp.sec",
    ];
    let rows = rows(&columns).expect("messages");
    assert_eq!(rows.len(), 4);
    for (k, (time_ns, row)) in rows.iter().enumerate() {
        assert_eq!(*time_ns, 1_764_290_797_123_456_789 + 10_000_000 * k as u64);
        let (valid, k) = (f64::from(u8::from(k % 2 == 0)), k as f64);
        assert_eq!(row[..], [20.0 + k, -k, valid, 2.0 + k, k]);
    }
}

#[test]
fn fields_of_two_topics_have_no_common_rows() {
    let error = rows(&["/imu.rate.x", "/load.data"]).expect_err("two topics");
    assert!(error.to_string().contains("several topics"), "{error}");
    let error = rows(&["/imu.position[7]"]).expect_err("two elements");
    assert_eq!(
        error.to_string(),
        "message 1: `/imu.position` has 2 elements"
    );
}

#[test]
fn a_damaged_file_is_refused_and_never_a_panic() {
    let bytes = std::fs::read(flight()).expect("the file");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("x.mcap");
    for at in (0..bytes.len()).step_by(7) {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x55;
        std::fs::write(&path, damaged).expect("a file");
        if let Ok(file) = RosFile::open(&path, &[]) {
            let _ = file.read(&[0], |_, _| Ok::<_, ()>(()));
        }
    }
}

#[test]
fn a_message_that_ends_early_does_not_fit() {
    let message =
        Message::parse("string name\nfloat64[] values\nfloat64 last\n").expect("a schema");
    // "ab" with its zero, padding, one element, padding to a multiple of 8, 1.5, and 2.5.
    let mut data = vec![
        0, 1, 0, 0, 3, 0, 0, 0, b'a', b'b', 0, 0, 1, 0, 0, 0, 0, 0, 0, 0,
    ];
    data.extend(1.5_f64.to_le_bytes());
    data.extend(2.5_f64.to_le_bytes());
    let mut row = [0.0; 2];
    let paths = ["last", "values[0]"];
    assert_eq!(message.read(&data, &paths, &mut row), Ok(()));
    assert_eq!(row, [2.5, 1.5]);
    for length in 0..data.len() {
        assert_eq!(
            message.read(&data[..length], &paths, &mut row),
            Err(message::Unread::Damaged),
            "{length}"
        );
    }
}
