use ::parquet::file::reader::{FileReader, SerializedFileReader};
use ::parquet::record::Field as Value;
use clap::Parser;
use hil_recording::reader::RECORDING;
use tempfile::TempDir;

use super::*;
use crate::fixture::{Content, Folder, layout, record, recorded};

const STEPS: u64 = 50;

/// Command line of `hil export` alone.
#[derive(Parser)]
struct Line {
    #[command(flatten)]
    arguments: ExportArguments,
}

/// Returns the truth at a step: all values differ and need all their digits. One is a negative zero, as another
/// recorder writes it.
fn truth(step: u64) -> f64 {
    match step {
        9 => -0.0,
        step => 1.0 / (step as f64 - 7.3),
    }
}

/// Records a run at 1 kHz without a scenario, and creates a folder to write to.
fn a_run() -> (Folder, TempDir) {
    let mut contents: Vec<Content> = (0..=STEPS)
        .map(|step| Content::Record(record(step, truth(step), f64::NAN)))
        .collect();
    // Its measured signal is invalid.
    let mut invalid = record(STEPS + 1, truth(STEPS + 1), f64::INFINITY);
    invalid[1] = 1;
    contents.push(Content::Record(invalid));
    let run = recorded(&layout(), &contents, vec![]);
    (run, tempfile::tempdir().expect("a folder"))
}

/// Runs `hil export RUN` with arguments separated by spaces.
fn exported(run: &Path, arguments: &str) -> Result<Exit, Failure> {
    let words = ["hil export", run.to_str().expect("plain text")];
    let words = words.into_iter().chain(arguments.split_ascii_whitespace());
    export(&Line::parse_from(words).arguments)
}

/// Returns header and rows of the exported table.
fn csv(run: &Path, folder: &TempDir, arguments: &str) -> (String, Vec<Vec<String>>) {
    let path = folder.path().join("table.csv");
    let arguments = format!("{arguments} --force -o {}", path.display());
    assert_eq!(exported(run, &arguments).expect("exported"), Exit::Pass);
    let text = std::fs::read_to_string(path).expect("written");
    let (header, lines) = text.split_once('\n').expect("a header");
    let rows = lines
        .lines()
        .map(|line| line.split(',').map(Into::into).collect());
    (header.into(), rows.collect())
}

#[test]
fn a_table_has_every_step_and_the_bits_of_every_number() {
    let (run, folder) = a_run();
    let (header, rows) = csv(&run, &folder, "");
    assert_eq!(
        header,
        "step,time_s,truth.x_m,measured.x_m,command.u_n,applied.u_n,sensed.x_m,parameter.mass_kg"
    );
    assert_eq!(rows.len() as u64, STEPS + 2);
    for (step, row) in (0..).zip(&rows) {
        let number = |place: usize| row[place].parse::<f64>().expect("a number");
        assert_eq!(row[0], step.to_string());
        assert_eq!(number(1).to_bits(), (step as f64 / 1000.0).to_bits());
        assert_eq!(number(2).to_bits(), truth(step).to_bits());
        assert_eq!(row[4], if step > STEPS { "inf" } else { "NaN" });
        assert_eq!(number(7), 1.0);
    }
}

#[test]
fn a_time_window_includes_both_ends_and_decimation_starts_at_its_first_step() {
    let (run, folder) = a_run();
    let steps = |arguments: &str| -> Vec<u64> {
        let (_, rows) = csv(&run, &folder, arguments);
        rows.iter()
            .map(|row| row[0].parse().expect("a step"))
            .collect()
    };
    for (arguments, expected) in [
        ("--from 10ms --until 13ms", vec![10, 11, 12, 13]),
        ("--from 0.0101 --until 0.0129", vec![11, 12]),
        ("--from 49ms", vec![49, 50, 51]),
        ("--until 1ms", vec![0, 1]),
        ("--every 20", vec![0, 20, 40]),
        ("--from 3ms --until 23ms --every 10", vec![3, 13, 23]),
        ("--from 7ms --until 7ms --every 1000", vec![7]),
    ] {
        assert_eq!(steps(arguments), expected, "{arguments}");
    }
    for (arguments, message) in [
        ("--from 1s", "ends at 0.051 s"),
        ("--from 0.0101 --until 0.0102", "no step"),
        ("--from 2s --until 1s", "--from 2 is after --until 1"),
    ] {
        let path = folder.path().join("none.csv");
        let arguments = format!("{arguments} -o {}", path.display());
        let failure = exported(&run, &arguments).expect_err("refused");
        assert_eq!(failure.exit(), Exit::Usage);
        assert!(failure.to_string().contains(message), "{failure}");
        assert!(!path.exists());
    }
}

#[test]
fn signals_are_selected_by_name_and_by_pattern_in_the_requested_order() {
    let (run, folder) = a_run();
    #[rustfmt::skip] // a table
    let cases = [
        ("--signal command.u_n --signal truth.x_m", "command.u_n,truth.x_m"),
        ("--signal *.x_m", "truth.x_m,measured.x_m,sensed.x_m"),
        ("--signal truth.* --signal *.x_m", "truth.x_m,measured.x_m,sensed.x_m"),
        ("--signal ?????.x_m", "truth.x_m"),
        ("--signal controller_ns", "controller_ns"),
        ("--signal truth.* --signal measured.* --validity", "truth.x_m,measured.x_m,measured.x_m.valid"),
    ];
    for (arguments, expected) in cases {
        let (header, _) = csv(&run, &folder, arguments);
        assert_eq!(header, format!("step,time_s,{expected}"), "{arguments}");
    }
    let (_, rows) = csv(&run, &folder, "--signal measured.x_m --validity");
    let valid: Vec<&str> = rows.iter().map(|row| row[3].as_str()).collect();
    assert_eq!(valid[..=50], ["true"; 51]);
    assert_eq!(valid[51..], ["false"]);
    for (arguments, message) in [
        (
            "--signal truth.y_m",
            "has no signal `truth.y_m`; nearest: `truth.x_m`",
        ),
        ("--signal truht.*", "nearest"),
        ("--signal [", "--signal `[`"),
        // Needs the descriptions of plant and law, which this run lacks.
        (
            "--signal command.u_n --validity",
            "the validity bit of `command.u_n` is unknown",
        ),
    ] {
        let failure = exported(&run, arguments).expect_err("refused");
        assert_eq!(failure.exit(), Exit::Usage);
        assert!(failure.to_string().contains(message), "{failure}");
    }
}

#[test]
fn parquet_holds_the_same_bits_and_their_provenance() {
    let (run, folder) = a_run();
    let path = folder.path().join("table.parquet");
    let chosen = "--signal truth.x_m --signal measured.x_m --signal controller_ns --signal published_ns --validity";
    exported(&run, &format!("{chosen} -o {}", path.display())).expect("exported");
    let file = SerializedFileReader::new(std::fs::File::open(&path).expect("there"));
    let file = file.expect("a Parquet file");
    let mut steps = 0;
    for row in file.get_row_iter(None).expect("rows") {
        let row = row.expect("a row");
        let cells: Vec<Value> = row
            .get_column_iter()
            .map(|(_, cell)| cell.clone())
            .collect();
        let [
            step,
            time_s,
            x_m,
            measured,
            valid,
            controller_ns,
            published_ns,
        ] = &cells[..]
        else {
            panic!("{cells:?}");
        };
        let bits = |cell: &Value| match cell {
            Value::Double(value) => value.to_bits(),
            other => panic!("{other:?}"),
        };
        assert_eq!(*step, Value::ULong(steps));
        assert_eq!(bits(time_s), (steps as f64 / 1000.0).to_bits());
        assert_eq!(bits(x_m), truth(steps).to_bits());
        assert_eq!(bits(measured), truth(steps).to_bits());
        assert_eq!(*valid, Value::Bool(steps <= STEPS));
        // Nothing was measured.
        assert_eq!(*controller_ns, Value::Null);
        assert_eq!(*published_ns, Value::ULong(77));
        steps += 1;
    }
    assert_eq!(steps, STEPS + 2);
    let pairs = file.metadata().file_metadata().key_value_metadata();
    let pairs = pairs.expect("metadata");
    let value_of = |key: &str| {
        let pair = pairs.iter().find(|pair| pair.key == key);
        pair.and_then(|pair| pair.value.clone()).unwrap_or_default()
    };
    assert_eq!(
        value_of("units"),
        r#"{"measured.x_m":"m","time_s":"s","truth.x_m":"m"}"#
    );
    let digest = hil_recording::reader::digest_of_first(&run, u64::MAX).expect("read");
    assert_eq!(value_of("hil.digest"), digest);
    assert_eq!(
        (value_of("hil.rate_hz"), value_of("hil.whole")),
        ("1000".into(), "true".into())
    );
}

#[test]
fn a_truncated_recording_is_exported_up_to_its_last_complete_record() {
    let contents: Vec<Content> = (0..20_000)
        .map(|step| Content::Record(record(step, truth(step), 0.0)))
        .collect();
    let run = recorded(&layout(), &contents, vec![]);
    let folder = tempfile::tempdir().expect("a folder");
    let file = run.join(RECORDING);
    let bytes = std::fs::read(&file).expect("read");
    std::fs::write(&file, &bytes[..bytes.len() * 9 / 10]).expect("written");
    let (_, rows) = csv(&run, &folder, "--signal truth.x_m");
    assert!((1..20_000).contains(&rows.len()), "{}", rows.len());
    for (step, row) in (0..).zip(&rows) {
        let value: f64 = row[2].parse().expect("a number");
        assert_eq!(
            (row[0].as_str(), value),
            (step.to_string().as_str(), truth(step))
        );
    }
}

#[test]
fn a_table_that_cannot_be_written_is_refused_and_leaves_no_file() {
    let (run, folder) = a_run();
    let there = folder.path().join("there.csv");
    std::fs::write(&there, "mine").expect("written");
    let odd = folder.path().join("table.xlsx");
    for (arguments, code, message) in [
        (format!("-o {}", there.display()), Exit::Usage, "--force"),
        (format!("-o {}", odd.display()), Exit::Usage, "--format"),
        ("--json".into(), Exit::Usage, "name a file"),
        (
            "--format csv -o /dev/full".into(),
            Exit::Infrastructure,
            "/dev/full",
        ),
        (
            "--format parquet -o /dev/full".into(),
            Exit::Infrastructure,
            "/dev/full",
        ),
    ] {
        let failure = exported(&run, &arguments).expect_err("refused");
        assert_eq!(failure.exit(), code, "{failure}");
        assert!(failure.to_string().contains(message), "{failure}");
    }
    assert_eq!(std::fs::read_to_string(&there).expect("there"), "mine");
    assert_eq!(
        std::fs::read_dir(folder.path()).expect("a folder").count(),
        1
    );
}
