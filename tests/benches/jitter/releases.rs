//! Release times of the samples of a paced `hil run`, read from its recording.

use std::path::Path;

use hil_recording::reader::{RECORDING, RunReader};
use serde_json::Value;
use tempfile::TempDir;

use crate::measure::median;
use crate::programs::Programs;
use crate::{Class, Jitter, PRIORITY, Setting};

/// Run.
pub(crate) struct Releases {
    pub(crate) jitter: Jitter,
    pub(crate) drift_ns: f64,
    pub(crate) lost_steps: u64,
}

/// A sample that was sent.
#[derive(Clone, Copy)]
struct Sent {
    step: u64,
    sent_ns: u64,
    /// Delay of the sample after its due time, as the plant noted it.
    late_ns: u64,
}

/// Returns true if a run gets the real-time class when it requests it.
pub(crate) fn may_be_real_time(programs: &Programs) -> bool {
    let scenario = scenario();
    let priority = PRIORITY.to_string();
    let summary = programs.run(&[&*scenario, "--priority", &priority]);
    assert_eq!(summary["verdict"], "pass", "{summary}");
    granted(&summary, PRIORITY)
}

fn granted(summary: &Value, priority: u32) -> bool {
    ["plant", "controller"].iter().all(|side| {
        summary["realtime"][side]["priority"]["granted"].as_u64() == Some(priority.into())
    })
}

fn scenario() -> String {
    let tests = Path::new(env!("CARGO_MANIFEST_DIR"));
    let scenario = tests.join("../scenarios/spring-mass.toml");
    scenario.into_os_string().into_string().expect("plain text")
}

impl Releases {
    /// Runs the scenario at its pace.
    ///
    /// # Panics
    /// If it does not run or its recording cannot be read.
    pub(crate) fn measure(programs: &Programs, setting: &Setting) -> Self {
        let folder = TempDir::new().expect("a folder");
        let run = folder.path().join("run");
        let priority = match setting.class {
            Class::Other => 0,
            Class::Fifo => PRIORITY,
        };
        let scenario = scenario();
        let rate = format!("run.rate_hz={}", setting.rate_hz);
        let duration = format!("run.duration_s={:?}", setting.seconds());
        let [core, other_core] = [setting.core, setting.other_core].map(|core| core.to_string());
        let arguments = [
            &*scenario,
            "--pace",
            "1",
            "--set",
            &rate,
            "--set",
            &duration,
            "--plant-core",
            &core,
            "--controller-core",
            &other_core,
            "--priority",
            &priority.to_string(),
            "--lock-memory",
            "--dma-latency",
            "0",
        ];
        let summary = programs.run_in(&run, &arguments);
        assert!(granted(&summary, priority), "{}", summary["realtime"]);
        Self::read(&run.join(RECORDING), setting)
    }

    fn read(recording: &Path, setting: &Setting) -> Self {
        let mut reader = RunReader::open(recording).expect("a recording");
        let column = |name: &str| {
            let place = reader.columns().iter().position(|it| it.name == name);
            place.unwrap_or_else(|| panic!("no {name} in a record"))
        };
        let [published, round_trip, late] =
            ["published_ns", "round_trip_ns", "late_ns"].map(column);
        let mut sent = Vec::with_capacity(setting.samples as usize);
        while reader.advance().expect("a whole recording") {
            let words = reader.words();
            // The last record answers no sample.
            if reader.step() < setting.samples {
                sent.push(Sent {
                    step: reader.step(),
                    sent_ns: words[published] - words[round_trip],
                    late_ns: words[late],
                });
            }
        }
        let lost_steps = setting.samples - sent.len() as u64;
        // Time begins when the first sample is answered.
        let sent = &sent[1..];
        let late_ns = lateness(sent, setting.period_ns());
        Self {
            drift_ns: drift(&late_ns),
            lost_steps,
            jitter: without_holes(sent, &late_ns, setting),
        }
    }
}

/// Returns the lateness of each sample against the grid of the first one, in ns.
fn lateness(sent: &[Sent], period_ns: u64) -> Vec<f64> {
    let first = sent.first().expect("a sample");
    let start_ns = first.sent_ns - first.late_ns;
    let due_ns = |sample: &Sent| start_ns + (sample.step - first.step) * period_ns;
    sent.iter()
        .map(|sample| sample.sent_ns as f64 - due_ns(sample) as f64)
        .collect()
}

fn drift(late_ns: &[f64]) -> f64 {
    let tenth = late_ns.len() / 10;
    let (first, last) = (&late_ns[..tenth], &late_ns[late_ns.len() - tenth..]);
    median(last.iter().copied()) - median(first.iter().copied())
}

/// Returns the jitter that is left when all that was due before the one before was sent, or before the end of
/// a hole, is removed.
fn without_holes(sent: &[Sent], late_ns: &[f64], setting: &Setting) -> Jitter {
    let (mut left, mut holes, mut busy_until_ns) = (Vec::with_capacity(sent.len()), 0, 0.0);
    for (sample, &late_ns) in sent.iter().zip(late_ns) {
        let sent_ns = sample.sent_ns as f64;
        let was_due_before = sent_ns - late_ns <= busy_until_ns;
        if late_ns > setting.hole_ns() as f64 {
            holes += u64::from(!was_due_before);
            busy_until_ns = sent_ns;
        } else if !was_due_before {
            left.push(late_ns);
            busy_until_ns = sent_ns;
        }
    }
    left.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let place = (share * left.len() as f64).ceil() as usize;
        left.get(place.max(1) - 1).copied().unwrap_or(f64::NAN)
    };
    Jitter {
        p50_ns: at(0.5),
        p99_ns: at(0.99),
        p999_ns: at(0.999),
        holes_hz: holes as f64 / setting.seconds(),
        removed: 1.0 - left.len() as f64 / sent.len() as f64,
    }
}
