use std::path::{Path, PathBuf};

use hil_config::table_file::{Refusal, TableSource};
use parquet::file::writer::SerializedFileWriter;

use super::FORMATS;
use crate::fixture::{Content, layout, record, recorded};

fn open(path: &Path, columns: &[&str]) -> Result<Box<dyn TableSource>, Refusal> {
    let ending = path.extension().and_then(|ending| ending.to_str());
    let format = FORMATS.iter().find(|one| Some(one.ending) == ending);
    (format.expect("a format").open)(path, columns)
}

/// Rows of the columns of these names.
fn rows(path: &Path, columns: &[&str]) -> Result<Vec<Vec<f64>>, Refusal> {
    let mut source = open(path, columns)?;
    let place = |name: &&str| source.columns().iter().position(|one| one.name == **name);
    let places: Vec<usize> = columns
        .iter()
        .map(|name| place(name).expect("a column"))
        .collect();
    let mut rows = Vec::new();
    source.read(&places, &mut |_, row| {
        rows.push(row.to_vec());
        Ok(())
    })?;
    Ok(rows)
}

/// File made by `tests/golden/flight.py`.
fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../tests/golden")
        .join(name)
}

#[test]
fn a_parquet_file_of_pandas_is_a_table() {
    let path = golden("flight.parquet");
    let source = open(&path, &[]).expect("a table");
    let names: Vec<&str> = source
        .columns()
        .iter()
        .map(|one| one.name.as_str())
        .collect();
    assert_eq!(names, ["timestamp", "elevator [deg]", "mode", "gust_mps"]);
    let units: Vec<&str> = source
        .columns()
        .iter()
        .map(|one| one.unit.as_deref().unwrap_or(""))
        .collect();
    assert_eq!(units, ["us", "deg", "", "m/s"]);
    assert!(source.columns()[0].is_time());
    let all = rows(&path, &["gust_mps", "timestamp", "elevator [deg]", "mode"]).expect("rows");
    let expected = [
        [0.5, 0.0, 0.0, 1.0],
        [0.25, 10_500.0, 1.5, 2.0],
        [1.0, 21_000.0, -3.0, 3.0],
    ];
    assert_eq!(all, expected);
}

#[test]
fn a_compression_that_cannot_be_read_is_named_with_those_that_can() {
    let mut bytes = std::fs::read(golden("flight.parquet")).expect("the file");
    // Metadata of a column: its path, then the field of the codec.
    let path = b"gust_mps\x15";
    let at = bytes.windows(path.len()).position(|window| window == path);
    let codec = at.expect("the path") + path.len();
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("x.parquet");
    // Codecs of the Parquet format, in zigzag encoding: 2, 4, 6 and 7.
    for (code, name) in [(4, "gzip"), (8, "Brotli"), (12, "zstd"), (14, "LZ4")] {
        bytes[codec] = code;
        std::fs::write(&file, &bytes).expect("a file");
        let refusal = rows(&file, &["gust_mps"]).expect_err("compressed");
        let message = format!("the column `gust_mps` is compressed with {name}");
        assert_eq!(refusal.message, message);
        assert!(refusal.expected.contains("Snappy"), "{refusal:?}");
        assert_eq!(rows(&file, &["mode"]).expect("another column").len(), 3);
    }
}

#[test]
fn a_column_without_numbers_is_named_with_its_content() {
    let schema = "message table { required double time_s; required boolean valid; \
        required binary name (STRING); required fixed_len_byte_array(2) half (FLOAT16); }";
    let schema = parquet::schema::parser::parse_message_type(schema).expect("a schema");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("x.parquet");
    let file = std::fs::File::create(&path).expect("a file");
    let properties = std::sync::Arc::default();
    SerializedFileWriter::new(file, schema.into(), properties)
        .and_then(SerializedFileWriter::close)
        .expect("a file without rows");
    for (column, content) in [
        ("valid", "Booleans"),
        ("name", "texts"),
        ("half", "floats of 16 bits"),
    ] {
        let refusal = open(&path, &[column]).err().expect("no numbers");
        let message = format!("the column `{column}` contains {content}, not numbers");
        assert_eq!(refusal.message, message);
    }
    open(&path, &["time_s"]).expect("numbers");
}

#[test]
fn messages_of_ros_are_a_table_with_the_time_since_the_first_one() {
    let all = rows(&golden("flight.mcap"), &["log_time [s]", "/imu.rate.x"]).expect("rows");
    assert_eq!(all, [[0.0, 0.0], [0.01, 0.5], [0.02, 1.0], [0.03, 1.5]]);
}

#[test]
fn a_recording_is_a_table_whose_last_record_may_lack_a_value() {
    let contents = (0..4).map(|step| {
        let command = if step == 3 {
            f64::NAN
        } else {
            2.0 * step as f64
        };
        Content::Record(record(step, -0.0, command))
    });
    let folder = recorded(&layout(), &contents.collect::<Vec<_>>(), Vec::new());
    let path = folder.join("run.mcap");
    let source = open(&path, &[]).expect("a table");
    let names: Vec<&str> = source
        .columns()
        .iter()
        .map(|one| one.name.as_str())
        .collect();
    assert_eq!(names[..2], ["time_s", "truth.x_m"]);
    let commands = rows(&path, &["time_s", "command.u_n"]).expect("rows");
    assert_eq!(commands, [[0.0, 0.0], [0.001, 2.0], [0.002, 4.0]]);
    let truth = rows(&path, &["truth.x_m"]).expect("rows");
    assert_eq!(truth.len(), 4);
    assert!(
        truth.iter().all(|row| row[0].is_sign_negative()),
        "bits are kept"
    );
}

#[test]
fn a_missing_value_before_the_end_is_named_with_its_step() {
    let contents = (0..4).map(|step| {
        let command = if step == 1 { f64::NAN } else { 0.0 };
        Content::Record(record(step, 0.0, command))
    });
    let folder = recorded(&layout(), &contents.collect::<Vec<_>>(), Vec::new());
    let refusal = rows(&folder.join("run.mcap"), &["command.u_n"]).expect_err("a gap");
    assert!(
        refusal
            .message
            .contains("`command.u_n` has no value at step 1"),
        "{refusal:?}"
    );
}

#[test]
fn files_of_another_kind_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    for name in ["x.mcap", "x.parquet"] {
        let path = folder.path().join(name);
        for content in ["", "time_s,value\n0,1\n"] {
            std::fs::write(&path, content).expect("a file");
            assert!(open(&path, &[]).is_err(), "{name}");
        }
    }
}
