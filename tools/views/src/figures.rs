//! Figures of recorded runs: each plot of the scenario as SVG and PDF for a document, or as a part of the report.
//!
//! 1. A run is [opened](reading::Source), and its scenario names the plots.
//! 2. It is [read](reading::RunData) once, for the signals of these plots alone.
//! 3. [`content`] makes a [chart](chart::Chart) of each plot, or says why there is none.
//! 4. The chart is [drawn](drawing) as a [scene], which becomes [`svg`] or [`pdf`].
//!
//! The same runs give the same bytes. Nothing is judged here, and no browser or font of the system is used.

mod axis;
mod captions;
mod chart;
mod content;
mod course;
mod drawing;
mod font;
mod fourier;
mod legend;
mod margins_file;
mod pdf;
mod reading;
mod scene;
mod spectrum;
mod svg;
mod table;
mod thinning;
mod unit;
mod wording;

use std::collections::BTreeMap;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use glob::Pattern;
use hil_config::plan::{Plot, PlotKind, Scale};
use hil_console::files::destination::{Destination, not_written};
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use maud::{Markup, PreEscaped, html};
use serde::Serialize;
use shared_types::number::counted;
use shared_types::table::near;

use crate::arguments::report::ReportArguments;
use crate::plots::by_unit;
use crate::plots::signal::own_names;
use captions::{captions, name_of};
use content::{Figure, figures};
use reading::{RunData, Source};
use scene::POINTS_PER_MM;

/// Maximum number of runs in a figure: more curves cannot be told apart.
const MOST_RUNS: usize = 8;
/// Width of a figure in a page.
const PAGE_WIDTH_MM: f64 = 160.0;
/// File of captions.
const CAPTIONS: &str = "captions.tex";

/// Summary of the written files.
#[derive(Debug, Default, Serialize)]
struct Written {
    folder: String,
    figures: Vec<WrittenFigure>,
    missing: Vec<Missing>,
}

#[derive(Debug, Serialize)]
struct WrittenFigure {
    name: String,
    title: String,
    caption: String,
    files: [String; 2],
}

#[derive(Debug, Serialize)]
struct Missing {
    title: String,
    reason: String,
}

/// Figure in a page.
pub(crate) struct PageFigure {
    pub(crate) title: String,
    pub(crate) caption: Option<String>,
    /// SVG and table of values, or the reason why there is none.
    pub(crate) drawn: Result<(String, Markup), String>,
}

/// Writes the figures of some runs to a folder.
///
/// # Errors
/// If a run cannot be read or has no plots, or a file cannot be written. If a figure cannot be drawn or a run is
/// damaged, the error comes after the other figures have been written.
pub(crate) fn write(arguments: &ReportArguments, folder: &Path) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    let loops = arguments.margins.as_deref().map(margins_file::read);
    let loops = loops.transpose()?;
    let mut sources = open(&arguments.runs, arguments.scenario.as_deref(), &|_| true)?;
    add_patterns(&mut sources, &arguments.signal)?;
    if loops.is_some() {
        add_loops(&mut sources);
    }
    let names = names(&sources);
    if names.is_empty() {
        return Err(Failure::usage(
            "the scenario has no [[plots]]; name some there, or choose signals with --signal",
        ));
    }
    fs::create_dir_all(folder)
        .map_err(|error| Failure::usage(format!("cannot create {}: {error}", folder.display())))?;
    // Opened early: an unwritable file should fail before the work.
    let mut files = Files::open(folder, names, arguments.force)?;
    let runs = read(sources, &|| interruption.check())?;
    let width = arguments.width.millimetres() * POINTS_PER_MM;
    let mut written = Written {
        folder: folder.display().to_string(),
        ..Written::default()
    };
    for Figure { plot, chart } in figures(&runs, loops.as_deref()) {
        interruption.check()?;
        match chart {
            Ok((chart, _)) => {
                let scene = chart.draw(width);
                let texts = [svg::file(&scene).into_bytes(), pdf::file(&scene)];
                written.figures.push(files.add(&plot, texts));
            }
            Err(reason) => written.missing.push(Missing {
                title: plot.title,
                reason,
            }),
        }
    }
    files.write(&written)?;
    tell(arguments, &written)?;
    let damages = runs.iter().filter_map(|run| run.damage.clone());
    let undrawn =
        (written.missing.iter()).map(|one| format!("no figure `{}`: {}", one.title, one.reason));
    let problems: Vec<String> = damages.chain(undrawn).collect();
    for caveat in runs.iter().filter_map(|run| run.caveat.as_ref()) {
        tell!("note: {caveat}");
    }
    match problems.is_empty() {
        true => Ok(Exit::Pass),
        false => Err(Failure::usage(problems.join("\nerror: "))),
    }
}

/// Returns the figures of a page: those of some runs that are not plots over time, which the page draws itself.
///
/// # Errors
/// If a run cannot be read.
pub(crate) fn for_page(arguments: &ReportArguments) -> Result<Vec<PageFigure>, Failure> {
    let loops = arguments.margins.as_deref().map(margins_file::read);
    let loops = loops.transpose()?;
    let is_other = |plot: &Plot| plot.kind != PlotKind::Time;
    let by = arguments.scenario.as_deref();
    let sources = arguments.runs.iter();
    // A run whose scenario is invalid has no such plots; the page says why.
    let sources = sources.filter_map(|path| Source::open(path, by, &is_other).ok());
    let mut sources: Vec<Source> = sources.collect();
    if loops.is_some() {
        add_loops(&mut sources);
    }
    if sources.iter().all(|source| source.plots.is_empty()) {
        return Ok(Vec::new());
    }
    let runs = read(sources, &|| Ok(()))?;
    let figures = (1..).zip(figures(&runs, loops.as_deref()));
    let page_figures = figures.map(|(number, figure)| PageFigure {
        title: figure.plot.title,
        caption: figure.plot.caption,
        drawn: figure.chart.map(|(chart, table)| {
            let scene = chart.draw(PAGE_WIDTH_MM * POINTS_PER_MM);
            (
                svg::part(&scene, &format!("figure-{number}")),
                table.markup(),
            )
        }),
    });
    Ok(page_figures.collect())
}

fn open(
    runs: &[PathBuf],
    by: Option<&Path>,
    choose: &dyn Fn(&Plot) -> bool,
) -> Result<Vec<Source>, Failure> {
    let number = runs.len();
    if number > MOST_RUNS {
        return Err(Failure::usage(format!(
            "{number} runs are too many to tell apart in one figure; it shows at most {MOST_RUNS}"
        )));
    }
    runs.iter()
        .map(|path| Source::open(path, by, choose))
        .collect()
}

fn read(
    sources: Vec<Source>,
    check: &dyn Fn() -> Result<(), Failure>,
) -> Result<Vec<RunData>, Failure> {
    let runs = sources.into_iter().map(|source| source.read(check));
    runs.collect()
}

/// Renders the figures of a page.
pub(crate) fn markup(figures: &[PageFigure]) -> Markup {
    html! {
        @if !figures.is_empty() { h3 { "Responses and spectra" } }
        @for figure in figures {
            figure.drawn {
                figcaption { (figure.title) }
                @match &figure.drawn {
                    Ok((svg, table)) => {
                        div.scroll tabindex="0" role="region" aria-label=(figure.title) { (PreEscaped(svg)) }
                        @if let Some(caption) = &figure.caption { p.hint { (caption) } }
                        details { summary { "Values" } (table) }
                    }
                    Err(reason) => p.note { (reason) },
                }
            }
        }
    }
}

/// Adds plots over time of the signals that match patterns, by unit.
fn add_patterns(sources: &mut [Source], texts: &[String]) -> Result<(), Failure> {
    if texts.is_empty() {
        return Ok(());
    }
    let columns: Vec<_> = sources.iter().flat_map(Source::columns).collect();
    let names = columns.iter().map(|column| column.name.as_str());
    let aliases: Vec<_> = sources.iter().flat_map(Source::aliases).collect();
    for text in own_names(texts, names.clone(), &aliases) {
        let pattern = Pattern::new(&text)
            .map_err(|error| Failure::usage(format!("--signal `{text}`: {error}")))?;
        let mut is_known = false;
        for source in &mut *sources {
            let columns = source.columns().into_iter();
            let columns: Vec<_> = columns.filter(|one| pattern.matches(&one.name)).collect();
            is_known |= !columns.is_empty();
            let plots = by_unit(&columns)
                .into_iter()
                .map(|plot| time_plot(plot.title, plot.signals));
            source.plots.extend(plots);
        }
        if !is_known {
            let near = near(&text, names);
            return Err(Failure::usage(format!(
                "no run has a signal `{text}`{near}\n  `hil export RUN --list` shows all"
            )));
        }
    }
    Ok(())
}

fn time_plot(title: String, signals: Vec<String>) -> Plot {
    Plot {
        signals,
        ..plot_of(title, PlotKind::Time)
    }
}

const fn plot_of(title: String, kind: PlotKind) -> Plot {
    Plot {
        title,
        kind,
        name: None,
        caption: None,
        signals: Vec::new(),
        span_s: [None; 2],
        laws: Vec::new(),
        scale: Scale::Linear,
        lines: Vec::new(),
    }
}

/// Adds plots of open loops, unless the scenario has some.
fn add_loops(sources: &mut [Source]) {
    let is_open = |plot: &Plot| {
        matches!(
            plot.kind,
            PlotKind::Bode { metric: None } | PlotKind::Nichols { metric: None }
        )
    };
    let has_some = sources.iter().flat_map(|source| &source.plots).any(is_open);
    if let (false, Some(first)) = (has_some, sources.first_mut()) {
        first.plots.extend([
            plot_of("Open loop".into(), PlotKind::Bode { metric: None }),
            plot_of(
                "Open loop over phase".into(),
                PlotKind::Nichols { metric: None },
            ),
        ]);
    }
}

/// Returns a name for the files of each plot, by its title and kind; names of the scenario come first.
fn names(sources: &[Source]) -> BTreeMap<(String, &'static str), String> {
    let plots = || sources.iter().flat_map(|source| &source.plots);
    let mut names: BTreeMap<(String, &'static str), String> = BTreeMap::new();
    let named = plots().filter(|plot| plot.name.is_some());
    for plot in named.chain(plots().filter(|plot| plot.name.is_none())) {
        let key = key(plot);
        if names.contains_key(&key) {
            continue;
        }
        let own = plot.name.clone().unwrap_or_else(|| name_of(&plot.title));
        // Some file systems do not tell capitals from small letters.
        let is_free = |name: &String| !names.values().any(|other| other.eq_ignore_ascii_case(name));
        let numbered = (2..).map(|number| format!("{own}-{number}"));
        let mut candidates = std::iter::once(own.clone()).chain(numbered);
        if let Some(name) = candidates.find(is_free) {
            names.insert(key, name);
        }
    }
    names
}

fn key(plot: &Plot) -> (String, &'static str) {
    (plot.title.clone(), plot.kind.name())
}

/// Files that do not exist yet: all appear, or none.
struct Files<'a> {
    folder: &'a Path,
    names: BTreeMap<(String, &'static str), String>,
    open: BTreeMap<PathBuf, Destination>,
    ready: Vec<(PathBuf, Vec<u8>)>,
}

impl<'a> Files<'a> {
    fn open(
        folder: &'a Path,
        names: BTreeMap<(String, &'static str), String>,
        may_replace: bool,
    ) -> Result<Self, Failure> {
        let mut open = BTreeMap::new();
        let files = names.values().flat_map(|name| files_of(name));
        for file in files.chain([CAPTIONS.to_owned()]) {
            let path = folder.join(file);
            let destination = Destination::open(Some(&path), may_replace)?;
            open.insert(path, destination);
        }
        Ok(Self {
            folder,
            names,
            open,
            ready: Vec::new(),
        })
    }

    fn add(&mut self, plot: &Plot, texts: [Vec<u8>; 2]) -> WrittenFigure {
        let name = self.names[&key(plot)].clone();
        let files = files_of(&name);
        let paths = files.iter().map(|file| self.folder.join(file));
        self.ready.extend(paths.zip(texts));
        WrittenFigure {
            caption: plot.caption.clone().unwrap_or_else(|| plot.title.clone()),
            title: plot.title.clone(),
            name,
            files,
        }
    }

    /// Writes all files under temporary names, then gives them their own.
    fn write(mut self, written: &Written) -> Result<(), Failure> {
        let figures = written.figures.iter();
        let named = figures.map(|one| (one.name.clone(), one.caption.clone()));
        let text = captions(&named.collect::<Vec<_>>());
        let captions = self.folder.join(CAPTIONS);
        if !self.ready.is_empty() {
            self.ready.push((captions, text.into_bytes()));
        }
        let mut whole = Vec::new();
        for (path, bytes) in self.ready {
            let mut file = self.open.remove(&path).expect("every file was opened");
            file.write_all(&bytes)
                .and_then(|()| file.flush())
                .map_err(|error| not_written(Some(&path), &error))?;
            whole.push((path, file));
        }
        for (path, file) in whole {
            file.complete()
                .map_err(|error| not_written(Some(&path), &error))?;
        }
        Ok(())
    }
}

fn files_of(name: &str) -> [String; 2] {
    ["svg", "pdf"].map(|end| format!("{name}.{end}"))
}

fn tell(arguments: &ReportArguments, written: &Written) -> Result<(), Failure> {
    if arguments.json {
        return output::write(&output::pretty(written)?);
    }
    let mut text = String::new();
    for figure in &written.figures {
        let [svg, pdf] = figure
            .files
            .each_ref()
            .map(|file| Path::new(&written.folder).join(file));
        text += &format!("{}, {}: {}\n", svg.display(), pdf.display(), figure.title);
    }
    let count = counted(written.figures.len() as u64, "figure");
    output::write(&format!("{text}{}: {count}\n", written.folder))
}
