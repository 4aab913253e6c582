//! `[[plots]]`: existing signals and frequency responses, and names of files.

use std::collections::{BTreeSet, HashSet};

use shared_types::describe::LawDescription;
use shared_types::number::exact;

use crate::expression::Columns;
use crate::keys::PLOTS;
use crate::plan::{Plot, PlotKind, Scale, SpectralWindow, SpectrumPlan};
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};
use crate::source::Place;
use crate::title::{TITLE, is_title};

/// Context of plots.
pub(super) struct PlotContext<'a> {
    /// Signals; without them, because plant, law or stimuli are faulty, names are not looked up.
    pub(super) columns: Option<&'a Columns>,
    /// Law of the scenario.
    pub(super) law: Option<&'a str>,
    /// All laws.
    pub(super) laws: &'a [LawDescription],
    /// Metrics of kind frequency-response, by name.
    pub(super) responses: Vec<&'a str>,
}

impl PlotContext<'_> {
    /// Returns the valid plots and reports the others.
    pub(super) fn check(&self, reader: &mut Reader, root: &Section<'_>) -> Vec<Plot> {
        let mut names = HashSet::new();
        let sections = reader.list(root, "plots");
        let plots = sections
            .iter()
            .filter_map(|section| self.plot(reader, section, &mut names));
        plots.collect()
    }

    fn plot<'a>(
        &self,
        reader: &mut Reader,
        common: &Section<'a>,
        names: &mut HashSet<&'a str>,
    ) -> Option<Plot> {
        let title = reader.text(common, "title");
        let laws = self.laws_of(reader, common);
        let name = name(reader, common, names);
        let caption = optional_text(reader, common, "caption");
        let kinds = PLOTS.iter().map(|kind| (kind.name, kind.keys));
        let (kind_name, section) = reader.of_kind(common, "plot", kinds)?;
        let section = &section;
        let is_for = |law| laws.iter().flatten().any(|one| one == law);
        let is_shown =
            (laws.as_ref()).is_none_or(|laws| laws.is_empty() || self.law.is_some_and(is_for));
        let columns = self.columns.filter(|_| is_shown);
        let is_response = matches!(kind_name, "bode" | "nichols");
        let signals = match is_response {
            true => Some(Vec::new()),
            false => signals(reader, section, columns),
        };
        let kind = match kind_name {
            "time" => Some(PlotKind::Time),
            "xy" => x(reader, section, columns).map(|x| PlotKind::Xy { x }),
            "spectrum" => spectrum(reader, section).map(PlotKind::Spectrum),
            "bode" => self
                .metric(reader, section)
                .map(|metric| PlotKind::Bode { metric }),
            _ => self
                .metric(reader, section)
                .map(|metric| PlotKind::Nichols { metric }),
        };
        let scale = match kind_name {
            "time" | "spectrum" => reader.text(section, "scale").map(|scale| match scale {
                "log" => Scale::Log,
                _ => Scale::Linear,
            }),
            _ => Some(Scale::Linear),
        };
        let lines = match section.table.get("lines").filter(|_| kind_name == "time") {
            Some(entry) => reader.numbers(&section.path_of("lines"), &entry.node),
            None => Some(Vec::new()),
        };
        let span_s = match is_response {
            true => Some([None; 2]),
            false => span(reader, section),
        };
        Some(Plot {
            title: title?.into(),
            kind: kind?,
            name: name?.map(Into::into),
            caption: caption?.map(Into::into),
            signals: signals?,
            span_s: span_s?,
            laws: laws?,
            scale: scale?,
            lines: lines?,
        })
    }

    /// Returns the name of a frequency response; the inner `None` if the plot names none.
    fn metric(&self, reader: &mut Reader, section: &Section<'_>) -> Option<Option<String>> {
        let metric = optional_text(reader, section, "metric")?;
        if let Some(metric) = metric.filter(|metric| !self.responses.contains(metric)) {
            let path = section.path_of("metric");
            let message =
                format!("`{path}` is `{metric}`, which is not a metric of kind frequency-response");
            reader
                .report_at(section, "metric", ProblemKind::UnknownName, message)
                .one_of(metric, self.responses.iter().copied());
            return None;
        }
        Some(metric.map(Into::into))
    }

    fn laws_of(&self, reader: &mut Reader, section: &Section<'_>) -> Option<Vec<String>> {
        if section.table.get("laws").is_none() {
            return Some(Vec::new());
        }
        let names = reader.texts(section, "laws")?;
        // Two plants may each have a law of the same name.
        let law_names: BTreeSet<&str> = self.laws.iter().map(|law| law.name.as_str()).collect();
        let mut are_known = true;
        for (path, place, name) in &names {
            if law_names.contains(name) {
                continue;
            }
            are_known = false;
            let message = format!("`{path}` is `{name}`, which is not a law");
            reader
                .report(ProblemKind::UnknownName, path, place, message)
                .one_of(name, law_names.iter().copied());
        }
        let names = names.into_iter().map(|(_, _, name)| name.to_owned());
        are_known.then(|| names.collect())
    }
}

/// Returns a text that may be missing; the outer `None` means a faulty one.
fn optional_text<'a>(
    reader: &mut Reader,
    section: &Section<'a>,
    key: &str,
) -> Option<Option<&'a str>> {
    match section.table.get(key) {
        Some(_) => reader.text(section, key).map(Some),
        None => Some(None),
    }
}

/// Returns the name of the plot's files, which no other plot may have.
fn name<'a>(
    reader: &mut Reader,
    section: &Section<'a>,
    names: &mut HashSet<&'a str>,
) -> Option<Option<&'a str>> {
    let Some(name) = optional_text(reader, section, "name")? else {
        return Some(None);
    };
    if !is_title(name) {
        reader.refuse(section, "name", name, TITLE);
        return None;
    }
    if !names.insert(name) {
        let path = section.path_of("name");
        let message = format!("`{path}` is `{name}`, as is the name of an earlier plot");
        reader.report_at(section, "name", ProblemKind::Duplicate, message);
        return None;
    }
    Some(Some(name))
}

fn spectrum(reader: &mut Reader, section: &Section<'_>) -> Option<SpectrumPlan> {
    let quantity = reader.text(section, "quantity");
    let window = reader.text(section, "window");
    let resolution_hz = reader.optional_number(section, "resolution_hz");
    let (window, mut windows) = (window?, SpectralWindow::ALL.into_iter());
    Some(SpectrumPlan {
        window: windows.find(|one| one.name() == window)?,
        is_density: quantity? == "density",
        resolution_hz: resolution_hz?,
    })
}

/// Returns the first and last time of a plot.
fn span(reader: &mut Reader, section: &Section<'_>) -> Option<[Option<f64>; 2]> {
    let from_s = reader.optional_number(section, "from_s");
    let until_s = reader.optional_number(section, "until_s");
    let (from_s, until_s) = (from_s?, until_s?);
    if let Some(until_s) = until_s.filter(|until_s| *until_s <= from_s.unwrap_or(0.0)) {
        let message = format!("`{}` is {}", section.path_of("until_s"), exact(until_s));
        reader
            .report_at(section, "until_s", ProblemKind::OutOfRange, message)
            .expected(format!("a time after {}", exact(from_s.unwrap_or(0.0))));
        return None;
    }
    Some([from_s, until_s])
}

fn x(reader: &mut Reader, section: &Section<'_>, columns: Option<&Columns>) -> Option<String> {
    let name = reader.text(section, "x")?;
    let path = section.path_of("x");
    signal(reader, columns, (&path, section.place_of("x"), name))
}

fn signals(
    reader: &mut Reader,
    section: &Section<'_>,
    columns: Option<&Columns>,
) -> Option<Vec<String>> {
    let names = reader.texts(section, "signals")?.into_iter();
    let signals: Vec<Option<String>> = names
        .map(|(path, place, name)| signal(reader, columns, (&path, place, name)))
        .collect();
    signals.into_iter().collect()
}

/// Returns the name of a signal as records have it.
fn signal(
    reader: &mut Reader,
    columns: Option<&Columns>,
    (path, place, name): (&str, &Place, &str),
) -> Option<String> {
    let Some(columns) = columns else {
        return Some(name.to_owned());
    };
    if columns.index_of(name).is_some() {
        return Some(columns.own_name(name).to_owned());
    }
    let message = format!("`{path}` is `{name}`, which is not a signal of this run");
    let problem = reader.report(ProblemKind::UnknownName, path, place, message);
    problem.nearest = columns.nearest(name);
    if name.starts_with("internal.") {
        problem.help("if only some laws have it, name them in `laws`");
    }
    None
}
