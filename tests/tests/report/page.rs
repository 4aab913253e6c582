//! Page of a report, read without the reporter's code.

use std::path::PathBuf;

use serde_json::Value;

use crate::support::harness::{Rig, Run};

/// Page with the data in it.
pub(crate) struct Page {
    pub(super) path: PathBuf,
    pub(super) text: String,
    pub(crate) data: Value,
}

impl Page {
    pub(crate) fn of(rig: &Rig, runs: &[&Run], options: &[&str]) -> Self {
        Self::with_exit(rig, runs, options, 0).0
    }

    /// Returns the page of a command that ends with this exit code, and the command's output.
    pub(super) fn with_exit(
        rig: &Rig,
        runs: &[&Run],
        options: &[&str],
        code: i32,
    ) -> (Self, String) {
        let path = rig.path("page.html");
        let folders: Vec<&str> = runs
            .iter()
            .map(|run| run.folder.to_str().expect("text"))
            .collect();
        let file = ["-o", path.to_str().expect("text"), "--force"];
        let output = rig.hil(&[&["report"], &folders[..], &file, options].concat());
        let output = output.expect(code).stderr;
        let text = std::fs::read_to_string(&path).expect("the page is there");
        let (_, rest) = text
            .split_once("<script id=\"data\" type=\"application/json\">")
            .expect("data");
        let (json, _) = rest.split_once("</script>").expect("its end");
        let data = serde_json::from_str(json).expect("JSON");
        (Self { path, text, data }, output)
    }

    pub(crate) fn plots(&self) -> &[Value] {
        self.data["plots"].as_array().expect("plots")
    }

    /// Returns the plot that shows exactly these signals.
    pub(super) fn plot(&self, signals: &[&str]) -> &Value {
        let is_it = |plot: &&Value| plot["signals"] == serde_json::json!(signals);
        let titles: Vec<&Value> = self.plots().iter().map(|plot| &plot["signals"]).collect();
        self.plots()
            .iter()
            .find(is_it)
            .unwrap_or_else(|| panic!("{signals:?} in {titles:?}"))
    }

    /// Returns the starts of the buckets in s.
    pub(super) fn grid(&self) -> Vec<f64> {
        let bytes = base64(self.data["grid"].as_str().expect("text"));
        bytes
            .as_chunks()
            .0
            .iter()
            .map(|bytes| f64::from_le_bytes(*bytes))
            .collect()
    }

    /// Returns the minimum and maximum of each bucket.
    pub(super) fn envelope(&self, run: usize, signal: &str) -> (Vec<f32>, Vec<f32>) {
        let run_data = &self.data["runs"][run];
        let signal = &run_data["signals"][signal];
        if let Some(same) = signal["same"].as_str() {
            return self.envelope(run, same);
        }
        if let Some(value) = signal["value"].as_f64() {
            let flat = vec![value as f32; self.grid().len()];
            return (flat.clone(), flat);
        }
        let is_double = signal["is_double"] == true;
        let numbers = |key: &str| -> Vec<f32> {
            let bytes = base64(signal[key].as_str().unwrap_or_else(|| panic!("{signal}")));
            match is_double {
                true => bytes
                    .as_chunks()
                    .0
                    .iter()
                    .map(|one| f64::from_le_bytes(*one) as f32)
                    .collect(),
                false => bytes
                    .as_chunks()
                    .0
                    .iter()
                    .map(|one| f32::from_le_bytes(*one))
                    .collect(),
            }
        };
        let (least, wide) = (numbers("least"), numbers("greatest"));
        if wide.is_empty() {
            return (least.clone(), least);
        }
        let records = repeated(&run_data["counts"]);
        let missing = match &signal["missing"] {
            Value::Null => vec![0; records.len()],
            pairs => repeated(pairs),
        };
        // A bucket of one value has it as both.
        let mut wide = wide.into_iter();
        let greatest = (least.iter().zip(records.iter().zip(missing)))
            .map(|(least, (records, missing))| match records - missing {
                0 | 1 => *least,
                _ => wide.next().expect("one for each bucket of several values"),
            })
            .collect();
        assert_eq!(wide.next(), None, "of {signal}");
        (least, greatest)
    }
}

/// Returns the numbers written as pairs of number and how often it follows.
fn repeated(pairs: &Value) -> Vec<u64> {
    let pairs = pairs.as_array().expect("pairs").iter();
    let times = |pair: &Value| pair[1].as_u64().expect("a number") as usize;
    pairs
        .flat_map(|pair| vec![pair[0].as_u64().expect("a number"); times(pair)])
        .collect()
}

/// Decodes base 64 by its definition (RFC 4648).
pub(super) fn base64(text: &str) -> Vec<u8> {
    const LETTERS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let (mut bits, mut filled, mut bytes) = (0_u32, 0, Vec::new());
    for letter in text.bytes().filter(|letter| *letter != b'=') {
        let six = LETTERS
            .iter()
            .position(|one| *one == letter)
            .expect("a letter");
        bits = bits << 6 | six as u32;
        filled += 6;
        if filled >= 8 {
            filled -= 8;
            bytes.push((bits >> filled) as u8);
        }
    }
    bytes
}
