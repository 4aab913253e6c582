//! JSON data for the script of a report: signals over the grid, plots, faults and histograms.

use std::collections::{BTreeMap, BTreeSet};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use hil_facts::results::latency::bars::classes;
use hil_facts::results::latency::times::Times;
use serde::Serialize;
use shared_types::record::ControllerFate;
use shared_types::time::Step;

use super::envelope::{Envelope, Written, runs_of};
use super::found::{Found, FoundData};
use super::grid::Grid;
use super::plots::Plot;
use super::reading::Signals;
use super::run::Run;

/// Complete data of a report.
#[derive(Debug, Serialize)]
pub(crate) struct Data {
    /// Starts of the buckets in s, little-endian double precision.
    grid: String,
    /// End of the longest run in s, that of a baseline included.
    end_s: f64,
    runs: Vec<RunData>,
    plots: Vec<Plot>,
    /// Formulas of the command line.
    #[serde(rename = "where")]
    found: Vec<FoundData>,
    /// Band of a baseline behind the curves.
    band: Option<BandData>,
}

#[derive(Debug, Serialize)]
struct RunData {
    label: String,
    period_s: f64,
    faults: Vec<SpanData>,
    /// Handovers and losses of controllers.
    changes: Vec<SpanData>,
    /// Changes of values, and marks.
    marks: Vec<SpanData>,
    /// Number of records in each bucket, equal neighbours together.
    counts: Vec<[u32; 2]>,
    signals: BTreeMap<String, SignalData>,
    spikes: Vec<SpikeData>,
    histograms: Vec<HistogramData>,
}

#[derive(Debug, Serialize)]
struct SpanData {
    label: String,
    from_s: f64,
    until_s: Option<f64>,
}

/// Band of a baseline.
#[derive(Debug, Serialize)]
pub(super) struct BandData {
    /// Name of the baseline.
    pub(super) name: String,
    #[serde(skip)]
    pub(super) label: String,
    /// End of the baseline's run in s; `None` without its recording.
    #[serde(skip)]
    pub(super) end_s: Option<f64>,
    /// Tolerance of each signal of the runs and, without a recording, the ends of its range.
    pub(super) margins: BTreeMap<String, Vec<f64>>,
    /// Number of its records in each bucket, equal neighbours together.
    pub(super) counts: Vec<[u32; 2]>,
    /// Courses of the signals over the grid.
    pub(super) signals: BTreeMap<String, SignalData>,
}

/// Signal over the grid.
#[derive(Debug, Serialize)]
pub(super) struct SignalData {
    unit: String,
    /// Number of records in each bucket that have no value, equal neighbours together; `None` if every record has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    missing: Option<Vec<[u32; 2]>>,
    #[serde(flatten)]
    pub(super) values: Written,
}

#[derive(Debug, Serialize)]
struct SpikeData {
    at_s: f64,
    ns: u64,
}

#[derive(Debug, Serialize)]
struct HistogramData {
    leg: &'static str,
    /// Lower bounds of the classes, and the upper bound of the last one.
    from_ns: Vec<u64>,
    count: Vec<u64>,
}

impl Data {
    pub(super) fn new(
        runs: &[Run],
        signals: &[Signals],
        grid: &Grid,
        plots: &[Plot],
        found: &[Found],
        band: Option<BandData>,
    ) -> Self {
        let starts = grid.starts_s();
        let bytes: Vec<u8> = starts
            .iter()
            .flat_map(|start| start.to_le_bytes())
            .collect();
        let of_band = band.as_ref().and_then(|band| band.end_s);
        let end_s = runs.iter().map(Run::end_s).chain(of_band);
        let end_s = end_s.max_by(f64::total_cmp);
        Self {
            grid: STANDARD.encode(bytes),
            end_s: end_s.unwrap_or_default(),
            runs: runs
                .iter()
                .zip(signals)
                .map(|(run, signals)| RunData::new(run, signals))
                .collect(),
            plots: plots.to_vec(),
            found: found.iter().map(|one| one.data(runs)).collect(),
            band,
        }
    }

    /// Describes the band behind the curves, if there is one.
    pub(super) fn band(&self) -> Option<&str> {
        self.band.as_ref().map(|band| band.label.as_str())
    }

    /// Returns the number of distinct signals of all runs.
    pub(crate) fn signals(&self) -> usize {
        let names = self.runs.iter().flat_map(|run| run.signals.keys());
        names.collect::<BTreeSet<_>>().len()
    }

    /// Returns names and units of all signals.
    pub(super) fn names(&self) -> BTreeMap<&str, &str> {
        let signals = self.runs.iter().flat_map(|run| &run.signals);
        signals
            .map(|(name, data)| (name.as_str(), data.unit.as_str()))
            .collect()
    }
}

/// Maximum number of drawn changes of values.
const MOST_SHOWN: usize = 100;

/// Shortens a mark's text to fit into a plot; the list of events has the full text.
fn shortened(note: &str) -> String {
    const MOST: usize = 40;
    if note.chars().count() <= MOST {
        return note.to_owned();
    }
    note.chars().take(MOST - 3).collect::<String>() + "..."
}

impl RunData {
    fn new(run: &Run, signals: &Signals) -> Self {
        let spans = run.spans.iter().map(|span| SpanData {
            label: format!("{} {}", span.event, span.kind),
            from_s: span.from_s,
            until_s: span.until_s,
        });
        let recorded = &run.outcome.recorded;
        let at = |step: u64, label: String| {
            let from_s = run.rate.seconds(Step(step));
            let until_s = Some(from_s);
            SpanData {
                label,
                from_s,
                until_s,
            }
        };
        let changes = recorded.changes.iter().filter_map(|change| {
            let epoch = change.epoch;
            let label = match &change.change {
                ControllerFate::Joined { law } => format!("controller {epoch}: {law}"),
                ControllerFate::Lost { .. } => format!("controller {epoch} lost"),
                ControllerFate::Refused { .. } => return None,
            };
            Some(at(change.step, label))
        });
        let values = recorded.values.iter().take(MOST_SHOWN);
        let values = values.map(|change| at(change.step, shortened(&change.described())));
        let marks = recorded.marks.iter();
        let marks = marks.map(|mark| at(mark.step, shortened(&mark.text)));
        let spikes = recorded.latency.spikes.iter();
        let spikes = spikes.map(|spike| SpikeData {
            at_s: run.rate.seconds(Step(spike.step)),
            ns: spike.round_trip_ns,
        });
        let histograms = run.outcome.latency.times().into_iter();
        let histograms = histograms
            .filter(|(leg, _)| run.asks_for_timing() || *leg == "round_trip")
            .filter(|(_, times)| !times.is_empty())
            .map(|(leg, times)| HistogramData::new(leg, times));
        Self {
            label: run.label.clone(),
            period_s: run.rate.period_s(),
            faults: spans.collect(),
            changes: changes.collect(),
            marks: values.chain(marks).collect(),
            counts: runs_of(signals.records()),
            signals: written(signals, |_| true),
            spikes: spikes.collect(),
            histograms: histograms.collect(),
        }
    }
}

impl HistogramData {
    fn new(leg: &'static str, times: &Times) -> Self {
        let (mut from_ns, mut count) = (Vec::new(), Vec::new());
        let mut end_ns = None;
        for ((from, to), steps) in classes(times) {
            // Empty classes are left out.
            if let Some(end) = end_ns.filter(|end| *end != from) {
                from_ns.push(end);
                count.push(0);
            }
            from_ns.push(from);
            count.push(steps);
            end_ns = Some(to);
        }
        from_ns.extend(end_ns);
        Self {
            leg,
            from_ns,
            count,
        }
    }
}

/// Encodes each of some signals only once, because many signals are equal to another, like a sensor without a fault.
pub(super) fn written(
    signals: &Signals,
    is_one: impl Fn(&str) -> bool,
) -> BTreeMap<String, SignalData> {
    let mut written: Vec<(&str, &Envelope)> = Vec::new();
    let mut data = BTreeMap::new();
    for (name, unit, envelope) in signals.iter().filter(|(name, ..)| is_one(name)) {
        let same = written.iter().find(|(_, one)| one.is_same(envelope));
        let values = match (envelope.constant(), same) {
            (None, Some((same, _))) => Written::Same {
                same: (*same).to_owned(),
            },
            _ => {
                written.push((name, envelope));
                envelope.written()
            }
        };
        let counts = signals.records().zip(envelope.counts());
        let missing = runs_of(counts.map(|(records, values)| records - values));
        let one = SignalData {
            unit: unit.to_owned(),
            missing: (missing.iter().any(|[count, _]| *count > 0)).then_some(missing),
            values,
        };
        data.insert(name.to_owned(), one);
    }
    data
}
