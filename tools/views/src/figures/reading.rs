//! Recorded run, read once for the plots of its scenario: only their signals, and the faults that they mark.
//!
//! Courses over time are reduced while they are read; signals of spectra and of plots over another signal are kept for
//! the time that the plot shows. Never judges a run.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use hil_config::Response;
use hil_config::plan::{Plan, Plot, PlotKind};
use hil_console::terminal::exit::Failure;
use hil_facts::results::evaluation::RecordEvaluation;
use hil_facts::results::handover::Laws;
use hil_facts::results::recorded_run::RecordedRun;
use hil_recording::reader::RunReader;
use shared_types::record::{ControllerChange, Event, Validity};
use shared_types::time::{Rate, Step};

use super::course::Course;
use crate::plots::bounds::{Bound, bounds};
use crate::plots::signal::recorded_name;

/// Number of records between two looks for a signal of the user.
const LOOK: u64 = 4096;

/// Run with its plots, not read yet.
pub(super) struct Source {
    path: PathBuf,
    reader: RunReader,
    run: RecordedRun,
    pub(super) plots: Vec<Plot>,
}

/// Run, read for its plots.
pub(super) struct RunData {
    pub(super) path: PathBuf,
    pub(super) rate: Rate,
    pub(super) end_s: f64,
    /// Laws that were active.
    pub(super) laws: Vec<String>,
    /// Beginning in s and kind of each fault.
    pub(super) faults: Vec<(f64, String)>,
    pub(super) bounds: Vec<Bound>,
    /// Descriptions and units of signals, by their recorded names.
    pub(super) descriptions: BTreeMap<String, String>,
    pub(super) units: BTreeMap<String, String>,
    /// Plots, each with its signals: that of the horizontal axis first, if it has one.
    pub(super) plots: Vec<(Plot, Vec<Read>)>,
    pub(super) responses: BTreeMap<String, Vec<Response>>,
    /// Reason why the run could not be read to its end.
    pub(super) damage: Option<String>,
    /// Note on how the recording ends.
    pub(super) caveat: Option<String>,
}

/// Signal, as far as a plot needs it.
pub(super) struct Read {
    pub(super) name: String,
    place: Place,
    pub(super) values: Values,
}

#[derive(Clone, Copy)]
enum Place {
    /// Word of a record.
    Word(usize),
    /// Derived signal.
    Derived(usize),
    /// The recording does not have it.
    Missing,
}

/// Values of a signal.
pub(super) enum Values {
    /// Reduced course.
    Course(Course),
    /// Every value; NaN where a record is missing.
    All(Vec<f64>),
}

impl Read {
    pub(super) const fn is_missing(&self) -> bool {
        matches!(self.place, Place::Missing)
    }
}

impl Source {
    /// Opens a run with its own plots, or with those of another scenario, that `choose` selects.
    pub(super) fn open(
        path: &Path,
        by: Option<&Path>,
        choose: &dyn Fn(&Plot) -> bool,
    ) -> Result<Self, Failure> {
        let reader = RunReader::open(path).map_err(Failure::usage)?;
        let reader = reader.without_digest().patient();
        let run = RecordedRun::of(&reader, path)?;
        let run = match by {
            Some(by) => run.judged_by(by)?,
            None => run,
        };
        let plots = run.plan.plots.iter().filter(|plot| choose(plot));
        Ok(Self {
            path: path.to_owned(),
            plots: plots.cloned().collect(),
            reader,
            run,
        })
    }

    /// Returns names and units of all signals, and of derived ones.
    pub(super) fn columns(&self) -> Vec<hil_recording::reader::Column> {
        let recorded = self.reader.columns().iter();
        let recorded = recorded.filter(|column| column.is_signal()).cloned();
        let derived = self.run.plan.derived.iter();
        let derived = derived.map(|one| hil_recording::reader::Column {
            name: one.name.clone(),
            unit: one.unit.clone(),
        });
        recorded.chain(derived).collect()
    }

    /// Returns the aliases of signals, each with the recorded name.
    pub(super) fn aliases(&self) -> Vec<(String, String)> {
        self.run.aliases()
    }

    /// Reads the run to its end, or as far as it can be read.
    pub(super) fn read(
        mut self,
        check: &dyn Fn() -> Result<(), Failure>,
    ) -> Result<RunData, Failure> {
        let rate = self.reader.rate().map_err(Failure::usage)?;
        let plan = self.plan();
        let derived_names: Vec<&str> = plan.derived.iter().map(|one| one.name.as_str()).collect();
        let place = |name: &str| match self.reader.place(name) {
            Some(place) => Place::Word(place),
            None => {
                let derived = derived_names.iter().position(|one| *one == name);
                derived.map_or(Place::Missing, Place::Derived)
            }
        };
        let plots = std::mem::take(&mut self.plots).into_iter().map(|plot| {
            let signals = plot.read_signals().map(|name| recorded_name(name));
            let signals: Vec<Read> = signals
                .map(|name| Read {
                    place: place(&name),
                    values: match plot.kind {
                        PlotKind::Time => Values::Course(Course::default()),
                        _ => Values::All(Vec::new()),
                    },
                    name,
                })
                .collect();
            (plot, signals)
        });
        let mut plots: Vec<(Plot, Vec<Read>)> = plots.collect();
        let columns = self.columns().into_iter();
        let units = columns.map(|column| (column.name, column.unit)).collect();
        let is_derived = |read: &Read| matches!(read.place, Place::Derived(_));
        let needs_evaluation =
            !plan.analyses.is_empty() || plots.iter().flat_map(|(_, reads)| reads).any(is_derived);
        let mut evaluation = None;
        if needs_evaluation && !self.reader.is_excerpt() {
            evaluation = Some(self.run.evaluation(&self.reader, &plan).map_err(|error| {
                let path = self.path.display();
                Failure::usage(format!(
                    "{path}: the scenario does not fit the run: {error}"
                ))
            })?);
        } else {
            // An excerpt lacks the signals that others are derived from.
            for (_, reads) in &mut plots {
                for read in reads.iter_mut().filter(|read| is_derived(read)) {
                    read.place = Place::Missing;
                }
            }
        }
        let mut data = RunData {
            rate,
            end_s: 0.0,
            laws: Vec::new(),
            faults: Vec::new(),
            bounds: Vec::new(),
            descriptions: descriptions(&self.run, &plan),
            units,
            plots,
            responses: BTreeMap::new(),
            damage: None,
            caveat: None,
            path: self.path.clone(),
        };
        let validity = self.run.validity(&self.reader);
        let changes = data.read(&mut self.reader, &validity, evaluation.as_mut(), check)?;
        if self.reader.records() == 0 {
            let file = self.reader.path().display();
            return Err(Failure::usage(format!("{file} has no record to show")));
        }
        data.end_s = rate.seconds(Step(self.reader.step()));
        data.caveat = self.reader.caveat();
        let fact = |name: &str| self.reader.fact(name).map(Into::into);
        let laws = Laws::of(&self.run.plan.controller.law, &changes, fact);
        data.laws = laws.names().map(Into::into).collect();
        data.bounds = bounds(&self.run.plan, data.end_s).0;
        if let Some(evaluation) = &evaluation {
            let responses = evaluation.so_far().responses();
            data.responses = responses
                .map(|(name, responses)| (name.to_owned(), responses))
                .collect();
        }
        Ok(data)
    }

    /// Returns the scenario with what the plots need alone.
    fn plan(&self) -> Plan {
        let metrics: Vec<&str> = (self.plots.iter())
            .filter_map(|plot| match &plot.kind {
                PlotKind::Bode { metric } | PlotKind::Nichols { metric } => metric.as_deref(),
                _ => None,
            })
            .collect();
        let analyses = self.run.plan.analyses.iter();
        let analyses = analyses.filter(|one| metrics.contains(&one.name.as_str()));
        Plan {
            analyses: analyses.cloned().collect(),
            ..self.run.plan.clone().without_judgement()
        }
    }
}

impl RunData {
    /// Reads all records; returns the changes of the controller.
    fn read(
        &mut self,
        reader: &mut RunReader,
        validity: &Validity,
        mut evaluation: Option<&mut RecordEvaluation>,
        check: &dyn Fn() -> Result<(), Failure>,
    ) -> Result<Vec<ControllerChange>, Failure> {
        let first = reader
            .columns()
            .iter()
            .position(|column| column.is_signal());
        let first = first.unwrap_or(0);
        let mut changes = Vec::new();
        let mut known = std::collections::BTreeSet::new();
        let mut invalid: Vec<usize> = Vec::new();
        let mut next_step = None;
        loop {
            let advanced = reader.advance();
            for event in reader.events() {
                match event {
                    Event::Fault(begun) if known.insert(begun.id) => {
                        let at_s = self.rate.seconds(Step(begun.step));
                        self.faults.push((at_s, begun.kind.clone()));
                    }
                    Event::Controller(change) => changes.push(change.clone()),
                    _ => {}
                }
                if let Some(evaluation) = &mut evaluation {
                    evaluation.event(event);
                }
            }
            match advanced {
                Ok(true) => {}
                Ok(false) => return Ok(changes),
                Err(error) => {
                    self.damage = Some(error.to_string());
                    return Ok(changes);
                }
            }
            if reader.records().is_multiple_of(LOOK) {
                check()?;
            }
            let (step, words) = (reader.step(), reader.words());
            let lost = next_step.map_or(0, |next| step - next);
            next_step = Some(step + 1);
            invalid.clear();
            invalid.extend(validity.invalid(words).map(|place| first + place));
            let derived = match &mut evaluation {
                Some(evaluation) => evaluation.record(words),
                None => &[],
            };
            self.take(step, lost, |place| match place {
                Place::Word(place) if invalid.contains(&place) => f64::NAN,
                Place::Word(place) => f64::from_bits(words[place]),
                Place::Derived(place) => derived[place],
                Place::Missing => f64::NAN,
            });
        }
    }

    /// Adds a record to the plots that show its time; `lost` records are missing before it.
    fn take(&mut self, step: u64, lost: u64, value: impl Fn(Place) -> f64) {
        let time_s = self.rate.seconds(Step(step));
        for (plot, reads) in &mut self.plots {
            let [from_s, until_s] = plot.span_s;
            let is_before = from_s.is_some_and(|from_s| time_s < from_s);
            if is_before || until_s.is_some_and(|until_s| time_s > until_s) {
                continue;
            }
            for read in reads.iter_mut().filter(|read| !read.is_missing()) {
                let value = value(read.place);
                match &mut read.values {
                    Values::Course(course) => course.push(time_s, value),
                    Values::All(values) => {
                        // One missing value is enough to show that some are.
                        if lost > 0 && !values.is_empty() {
                            values.push(f64::NAN);
                        }
                        values.push(value);
                    }
                }
            }
        }
    }
}

/// Returns the descriptions of a run's signals, by their recorded names.
fn descriptions(run: &RecordedRun, plan: &Plan) -> BTreeMap<String, String> {
    let layout = plan.record_layout(&run.plant, &run.law);
    let groups = hil_config::expression::Group::ALL
        .into_iter()
        .zip(layout.groups());
    let all = groups.flat_map(|(group, fields)| {
        fields.iter().map(move |field| {
            let name = recorded_name(&format!("{}.{}", group.prefix(), field.name));
            (name, field.description.clone())
        })
    });
    all.filter(|(_, text)| !text.is_empty()).collect()
}
