//! The file of baselines: named runs with their figures and tolerances, made for review.
//!
//! The file is read as data but written by editing, so that comments, order and manual tolerances are preserved.
//!
//! ```toml
//! schema = 1
//!
//! [baselines.severe-leakage-ftsc]
//! scenario = "severe-leakage"
//! recording = "baselines/severe-leakage-ftsc.mcap"
//! digest = "4208..."
//!
//! [baselines.severe-leakage-ftsc.metrics]
//! "max_abs_tracking_error_rad 0 s to 7 s" = { unit = "rad", tolerance = 0.0, value = 1.2e-4 }
//!
//! [baselines.severe-leakage-ftsc.signals]
//! "truth.x_m" = { unit = "m", tolerance = 1e-9, min = 0.0, max = 0.01, rms = 0.007, final = 0.01 }
//! ```

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};

use hil_console::files::folder;
use hil_console::files::part_file::{self, PartFile};
use hil_console::terminal::exit::Failure;
use serde::Deserialize;
use shared_types::number::exact;
use shared_types::table::near;
use toml_edit::{DocumentMut, InlineTable, Item, Table, TableLike, Value};

use super::figures::{Figures, STATISTICS};

/// Version of the file format.
const SCHEMA: i64 = 1;
/// Header of a new file.
const NEW: &str = "\
# Runs to compare others with: hil compare RUN --baseline NAME
# Figures are written by hil compare RUN --baseline NAME --update; tolerances are yours: absolute, in
# the signal's unit, for each sample and for each figure.
schema = 1
";

/// Contents of the baselines file.
pub(super) struct BaselineFile {
    path: PathBuf,
    document: DocumentMut,
    content: Content,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Content {
    schema: i64,
    #[serde(default)]
    baselines: BTreeMap<String, Baseline>,
}

/// Named run.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Baseline {
    pub(super) scenario: String,
    /// Path of the baseline's recording, relative to the folder of the file; without a recording only figures are
    /// compared.
    pub(super) recording: Option<PathBuf>,
    pub(super) digest: String,
    pub(super) records: u64,
    pub(super) rate_hz: f64,
    pub(super) scenario_blake3: String,
    pub(super) hil_version: String,
    pub(super) plant_blake3: String,
    pub(super) controller_blake3: String,
    #[serde(default)]
    pub(super) metrics: BTreeMap<String, MetricFigure>,
    #[serde(default)]
    pub(super) signals: BTreeMap<String, SignalFigures>,
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MetricFigure {
    pub(super) unit: String,
    pub(super) tolerance: f64,
    pub(super) value: f64,
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SignalFigures {
    pub(super) unit: String,
    pub(super) tolerance: f64,
    min: f64,
    max: f64,
    rms: f64,
    #[serde(rename = "final")]
    last: f64,
}

impl Baseline {
    /// Returns `true` if all signals have zero tolerance.
    pub(super) fn is_exact(&self) -> bool {
        self.signals
            .values()
            .all(|figures| figures.tolerance == 0.0)
    }
}

impl SignalFigures {
    /// Returns the values in the order of [`STATISTICS`].
    pub(super) const fn values(&self) -> [f64; STATISTICS.len()] {
        [self.min, self.max, self.rms, self.last]
    }
}

impl BaselineFile {
    /// Reads the file; a missing file is created later if `may_be_new`.
    ///
    /// # Errors
    /// If the file is missing or invalid.
    pub(super) fn read(path: &Path, may_be_new: bool) -> Result<Self, Failure> {
        let path_text = path.display();
        let text = match std::fs::read_to_string(path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound && may_be_new => NEW.into(),
            Err(error) => {
                let hint = "hil compare RUN --baseline NAME --update creates one, --baselines selects another";
                return Err(Failure::usage(format!(
                    "cannot read {path_text}: {error}; {hint}"
                )));
            }
        };
        let refused =
            |error: &dyn std::fmt::Display| Failure::usage(format!("{path_text}: {error}"));
        let document: DocumentMut = text.parse().map_err(|e| refused(&e))?;
        let content: Content = toml_edit::de::from_str(&text).map_err(|e| refused(&e))?;
        if content.schema != SCHEMA {
            let what = format!(
                "schema {} is not supported; use schema {SCHEMA}",
                content.schema
            );
            return Err(refused(&what));
        }
        for (name, baseline) in &content.baselines {
            let tolerances = (baseline
                .signals
                .iter()
                .map(|(key, figures)| (key, figures.tolerance)))
            .chain(
                baseline
                    .metrics
                    .iter()
                    .map(|(key, figure)| (key, figure.tolerance)),
            );
            for (key, tolerance) in tolerances {
                if tolerance.is_nan() || tolerance < 0.0 {
                    let what = format!(
                        "baseline `{name}`: `{key}`: a tolerance must be at least 0, not {}",
                        exact(tolerance)
                    );
                    return Err(refused(&what));
                }
            }
        }
        Ok(Self {
            path: path.to_owned(),
            document,
            content,
        })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn get(&self, name: &str) -> Option<&Baseline> {
        self.content.baselines.get(name)
    }

    /// Returns a baseline by name.
    ///
    /// # Errors
    /// If the baseline does not exist; the message suggests the nearest names.
    pub(super) fn find(&self, name: &str) -> Result<&Baseline, Failure> {
        self.get(name).ok_or_else(|| {
            let near = near(name, self.content.baselines.keys().map(String::as_str));
            let path_text = self.path.display();
            Failure::usage(format!(
                "{path_text} has no baseline `{name}`{near}; create it with hil compare RUN --baseline {name} --update"
            ))
        })
    }

    /// Returns the path of a baseline's recording, if it has one.
    pub(super) fn recording(&self, baseline: &Baseline) -> Option<PathBuf> {
        Some(self.folder().join(baseline.recording.as_ref()?))
    }

    /// Returns the folder for new recordings, which is next to the file and named after it, so that files do not share
    /// recordings.
    fn recordings(&self) -> PathBuf {
        let name = self.path.file_name().unwrap_or_default();
        let name = Path::new(name);
        if name
            .extension()
            .is_some_and(|extension| extension == "toml")
        {
            name.with_extension("")
        } else {
            // Must differ from the file itself.
            PathBuf::from(format!("{}.d", name.display()))
        }
    }

    fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    /// Stores the figures of a run under a name, and replaces the file atomically. A new baseline gets a recording, but
    /// a baseline whose recording was removed by hand gets no new one.
    ///
    /// # Errors
    /// If the file or the recording cannot be written.
    pub(super) fn update(
        &mut self,
        name: &str,
        run: &Path,
        figures: &Figures,
    ) -> Result<(), Failure> {
        let recording = match self.get(name) {
            Some(baseline) => baseline.recording.clone(),
            None => Some(self.recordings().join(format!("{name}.mcap"))),
        };
        if let Some(recording) = &recording {
            folder::refuse_odd(recording)?;
            keep(run, &self.folder().join(recording))?;
        }
        let unexpected = |what: &str| {
            Failure::usage(format!("{}: `{what}` is not a table", self.path.display()))
        };
        let baselines = self.document.entry("baselines").or_insert_with(implicit);
        let baselines = baselines
            .as_table_like_mut()
            .ok_or_else(|| unexpected("baselines"))?;
        let entry = baselines
            .entry(name)
            .or_insert_with(|| Item::Table(Table::new()));
        let entry = entry.as_table_like_mut().ok_or_else(|| unexpected(name))?;
        put(entry, "scenario", figures.scenario.as_str().into());
        if let Some(recording) = recording {
            put(entry, "recording", recording.display().to_string().into());
        }
        put(entry, "digest", figures.digest.as_str().into());
        put(entry, "records", Value::from(figures.records as i64));
        put(entry, "rate_hz", float(figures.rate_hz));
        put(
            entry,
            "scenario_blake3",
            figures.scenario_blake3.as_str().into(),
        );
        put(entry, "hil_version", figures.hil_version.as_str().into());
        put(entry, "plant_blake3", figures.plant_blake3.as_str().into());
        put(
            entry,
            "controller_blake3",
            figures.controller_blake3.as_str().into(),
        );
        let metrics = figures.metrics.iter().map(|metric| {
            let value = vec![("value", metric.value)];
            (metric.name.as_str(), metric.unit.as_str(), value)
        });
        put_all(entry, "metrics", metrics).ok_or_else(|| unexpected("metrics"))?;
        let signals = figures.signals.iter().map(|signal| {
            let values = STATISTICS.into_iter().zip(signal.values);
            (signal.name.as_str(), signal.unit.as_str(), values.collect())
        });
        put_all(entry, "signals", signals).ok_or_else(|| unexpected("signals"))?;
        part_file::write_text(&self.path, &self.document.to_string())
    }
}

fn implicit() -> Item {
    let mut table = Table::new();
    table.set_implicit(true);
    Item::Table(table)
}

/// Sets the figures of a table's entries without changing their tolerances; removes entries without figures.
fn put_all<'a>(
    entry: &mut dyn TableLike,
    key: &str,
    figures: impl Iterator<Item = (&'a str, &'a str, Vec<(&'static str, f64)>)>,
) -> Option<()> {
    let table = entry
        .entry(key)
        .or_insert_with(|| Item::Table(Table::new()));
    let table = table.as_table_like_mut()?;
    let mut obsolete: Vec<String> = table.iter().map(|(name, _)| name.to_owned()).collect();
    for (name, unit, values) in figures {
        obsolete.retain(|known| known != name);
        let line = table.entry(name).or_insert_with(|| {
            let mut line = InlineTable::new();
            line.insert("unit", unit.into());
            line.insert("tolerance", float(0.0));
            Item::Value(Value::InlineTable(line))
        });
        let line = line.as_table_like_mut()?;
        put(line, "unit", unit.into());
        for (statistic, value) in values {
            put(line, statistic, float(value));
        }
    }
    for name in obsolete {
        table.remove(&name);
    }
    Some(())
}

/// Sets a value and preserves the comments around it.
fn put(table: &mut dyn TableLike, key: &str, mut value: Value) {
    match table.get_mut(key).and_then(Item::as_value_mut) {
        Some(before) => {
            *value.decor_mut() = before.decor().clone();
            *before = value;
        }
        None => {
            table.insert(key, Item::Value(value));
        }
    }
}

/// Formats a number with all significant digits, as short as possible.
fn float(value: f64) -> Value {
    let text = if value.is_nan() {
        "nan".into() // Rust formats it as "NaN"
    } else {
        format!("{value:?}")
    };
    text.parse().unwrap_or_else(|_| Value::from(value))
}

/// Copies a run's recording to the folder of the file, atomically.
fn keep(run: &Path, copy: &Path) -> Result<(), Failure> {
    let recording = if run.is_dir() {
        run.join(hil_recording::reader::RECORDING)
    } else {
        run.to_owned()
    };
    let is_itself = match (recording.canonicalize(), copy.canonicalize()) {
        (Ok(recording), Ok(copy)) => recording == copy,
        _ => false,
    };
    if is_itself {
        return Ok(());
    }
    let folder = copy.parent().unwrap_or(Path::new(""));
    let copied = || {
        std::fs::create_dir_all(folder)?;
        let part = PartFile::beside(copy)?;
        std::io::copy(&mut File::open(&recording)?, &mut part.file())?;
        part.complete(copy, true)
    };
    copied().map_err(|error: std::io::Error| {
        Failure::infrastructure(format!("cannot write {}: {error}", copy.display()))
    })
}
