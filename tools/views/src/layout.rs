//! `hil layout`: generates a Foxglove or PlotJuggler layout for a run.
//!
//! [`pages`] groups the plots that every view of the run shares; one module per program writes them in its format.
//! Records are read only where value ranges are needed.

mod foxglove;
pub(crate) mod pages;
mod plotjuggler;

use std::collections::BTreeMap;
use std::path::Path;

use hil_config::plan::Plan;
use hil_console::files::destination::{Destination, deliver};
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use hil_facts::results::recorded_run::RecordedRun;

use crate::arguments::layout::{LayoutArguments, Viewer};
use hil_recording::reader::{ReadError, RunReader};

/// Minimum and maximum of signals, by name.
type Ranges = BTreeMap<String, [f64; 2]>;

/// Runs the command.
///
/// # Errors
/// If the run cannot be read or has no signals, or if the file cannot be written.
pub fn layout(arguments: &LayoutArguments) -> Result<Exit, Failure> {
    let mut reader = RunReader::open(&arguments.run)
        .map_err(Failure::usage)?
        .without_digest();
    let plan = plan(&reader, &arguments.run);
    let pages = pages::of(reader.columns(), plan.as_ref());
    if pages.is_empty() {
        let run = reader.path().display();
        return Err(Failure::usage(format!("{run} has nothing to plot")));
    }
    let path = (arguments.output.as_deref()).filter(|path| *path != Path::new("-"));
    let text = match arguments.viewer {
        Viewer::Foxglove => {
            let ranges = ranges(&mut reader).map_err(Failure::usage)?;
            if let Some(caveat) = reader.caveat() {
                tell!("note: {caveat}");
            }
            foxglove::text(&pages, &ranges)?
        }
        Viewer::PlotJuggler => {
            // Provenance is read before the first record.
            reader.advance().map_err(Failure::usage)?;
            let beside = path.and_then(|path| name_of_neighbour(path, reader.path()));
            plotjuggler::text(&pages, beside.as_deref()).map_err(Failure::infrastructure)?
        }
    };
    let Some(path) = path else {
        output::write(&text)?;
        return Ok(Exit::Pass);
    };
    let destination = Destination::open(Some(path), arguments.force)?;
    deliver(&text, destination, Some(path))?;
    let plots: usize = pages.iter().map(|page| page.plots.len()).sum();
    let (file, pages) = (path.display(), pages.len());
    output::write(&format!("{file}: {plots} plots on {pages} pages\n"))?;
    Ok(Exit::Pass)
}

/// Returns the checked scenario of a run, if it is valid; without it, names and units alone still give a layout.
fn plan(reader: &RunReader, run: &Path) -> Option<Plan> {
    RecordedRun::of(reader, run).ok().map(|run| run.plan)
}

/// Returns the minimum and maximum of each signal that has a value, up to the point where a recording is damaged.
fn ranges(reader: &mut RunReader) -> Result<Ranges, ReadError> {
    let signals = reader.columns().iter().enumerate();
    let signals = signals.filter(|(_, column)| column.is_signal());
    let mut ranges: Vec<(usize, String, Option<[f64; 2]>)> = signals
        .map(|(place, column)| (place, column.name.clone(), None))
        .collect();
    while reader.advance()? {
        for (place, _, range) in &mut ranges {
            let value = f64::from_bits(reader.words()[*place]);
            if value.is_finite() {
                let [least, greatest] = range.get_or_insert([value; 2]);
                *least = if value < *least { value } else { *least };
                *greatest = if value > *greatest { value } else { *greatest };
            }
        }
    }
    let bounded = ranges.into_iter();
    let bounded = bounded.filter_map(|(_, name, range)| Some((name, range?)));
    Ok(bounded.collect())
}

/// Returns the name of a recording if it lies in the folder of the output file.
fn name_of_neighbour(file: &Path, recording: &Path) -> Option<String> {
    let folder = |path: &Path| match path.parent()? {
        here if here.as_os_str().is_empty() => Path::new(".").canonicalize().ok(),
        folder => folder.canonicalize().ok(),
    };
    let name = recording.file_name()?.to_str()?.to_owned();
    (folder(file)? == folder(recording)?).then_some(name)
}
