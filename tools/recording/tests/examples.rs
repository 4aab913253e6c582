//! Tests of this package's examples.

#[path = "../examples/extremes.rs"]
mod extremes;
#[path = "../examples/fall.rs"]
mod fall;

#[test]
fn one_example_reads_the_recording_of_the_other() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("fall.mcap");
    fall::fall(&path).expect("written");
    let signals = extremes::signals(&path).expect("read");
    assert_eq!(signals, "truth.height_m [m]\n");
    let text = extremes::extremes(&path, "truth.height_m").expect("read");
    // After a second: 10 m - 9.81 m / 2.
    assert_eq!(text.as_deref(), Some("5.095 to 10 in 101 records\n"));
    let none = extremes::extremes(&path, "truth.depth_m").expect("read");
    assert_eq!(none, None);
}
