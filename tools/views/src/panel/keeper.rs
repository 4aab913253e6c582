//! Plots that were arranged on a page, as `[[plots]]` of the scenario.
//!
//! Answers a page with their TOML and, if it asks for it, replaces the scenario's file. Only a file that the recording
//! names, that has not changed since the run and that belongs to this user is replaced, atomically, and only by a text
//! that reads as the same scenario with these plots. Whatever prevents it is a reason in words.

use std::fs;
use std::io::Write;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use hil_config::plan::{Plan, PlotKind, Scale};
use hil_config::scenario::read_regular;
use hil_console::files::part_file::PartFile;
use hil_facts::programs::checked::checked;
use hil_facts::programs::scenario::ScenarioFile;
use hil_facts::results::recorded_run::RecordedRun;
use hil_recording::reader::RunReader;
use rustix::fs::{Access, access};
use serde_json::{Value, json};

use super::message::{ArrangedPlot, ClientMessage};
use crate::plots::arranged::{Arranged, Arrangement};
use crate::plots::signal::recorded_name;

/// Writer of the plots of a run's scenario.
pub(crate) struct Keeper {
    /// Folder or recording of the run; `None` if the run is not recorded.
    recording: Option<PathBuf>,
    own: Mutex<Own>,
}

/// Text that this panel has written.
#[derive(Default)]
struct Own {
    /// Hash of the file's text, which replaces the recorded one.
    blake3: Option<String>,
    /// Titles of the plots.
    titles: Vec<String>,
}

/// Scenario of a run in which plots are kept.
struct Subject {
    run: RecordedRun,
    /// Signals as expressions name them, by their names in recordings.
    names: Vec<(String, String)>,
    /// Text that is edited: that of the file or, without it, the effective scenario.
    text: String,
    /// File to write; or the reason why there is none.
    file: Result<PathBuf, String>,
    /// File for messages and for the paths in the text.
    origin: PathBuf,
}

impl Keeper {
    /// Creates the writer for a run, given its folder or its recording.
    pub(crate) fn of(recording: Option<PathBuf>) -> Self {
        Self {
            recording,
            own: Mutex::default(),
        }
    }

    /// Answers a page that was given this description of its run; `None` if the message is not for it.
    pub(super) fn answer(&self, message: &ClientMessage, about: &Value) -> Option<Value> {
        let ClientMessage::Keep {
            number,
            plots,
            write,
        } = message
        else {
            return None;
        };
        let mut answer = match self.keep(plots, *write, about) {
            Ok(answer) => answer,
            Err(error) => json!({ "error": error }),
        };
        answer["tell"] = "kept".into();
        answer["number"] = (*number).into();
        Some(answer)
    }

    fn keep(&self, plots: &[ArrangedPlot], write: bool, about: &Value) -> Result<Value, String> {
        let mut own = self.own.lock().unwrap_or_else(PoisonError::into_inner);
        let subject = Subject::of(self.recording.as_deref(), own.blake3.as_deref())?;
        let (arrangement, left_out) = subject.arrangement(plots, &own.titles, about)?;
        subject.check(&arrangement)?;
        let toml = arrangement.alone(&subject.text)?;
        let mut reason = subject.file.as_ref().err().cloned();
        let mut is_written = false;
        if let (true, Ok(file)) = (write, &subject.file) {
            match replace(
                file,
                &subject.text,
                &arrangement.in_scenario(&subject.text)?,
            ) {
                Ok(blake3) => {
                    is_written = true;
                    own.blake3 = Some(blake3);
                    own.titles = arrangement.plots.into_iter().map(|one| one.title).collect();
                }
                Err(why) => reason = Some(why),
            }
        }
        Ok(json!({
            "toml": toml,
            "file": subject.file.as_ref().ok().map(|file| file.display().to_string()),
            "refused": reason,
            "left_out": left_out,
            "is_written": is_written,
        }))
    }
}

impl Subject {
    /// Reads the run, and the file of its scenario, whose text must have the recorded hash or this one.
    ///
    /// # Errors
    /// If the run cannot be read.
    fn of(recording: Option<&Path>, blake3: Option<&str>) -> Result<Self, String> {
        let recording = recording.ok_or("the run is not recorded; omit --no-record")?;
        let reader = RunReader::open(recording).map_err(|error| error.to_string())?;
        let run = RecordedRun::of(&reader, recording).map_err(|failure| failure.reason())?;
        let (columns, _) = run.columns(&reader)?;
        let derived = run.plan.derived.iter().map(|one| one.name.as_str());
        // Parameters and the signals of probes have columns too, but no place in expressions.
        let can_be = |name: &&str| !name.starts_with("parameter.") && !name.starts_with("cut.");
        let names = columns.names().filter(can_be).chain(derived);
        let names = names.map(|name| (recorded_name(name), name.to_owned()));
        let names = names.collect();
        let file = ScenarioFile::recorded(|name| reader.fact(name));
        let is_here = {
            let host = rustix::system::uname();
            let host = host.nodename().to_string_lossy();
            reader.fact("host").is_none_or(|recorded| recorded == host)
        };
        let effective = reader.attachment("scenario.toml");
        let effective = effective.map_err(|error| error.to_string())?.to_owned();
        let file = file.ok_or("the recording names no file of a scenario".to_owned());
        let file = file.and_then(|mut file| {
            if !is_here {
                return Err(format!(
                    "the run was recorded on another machine, {}",
                    reader.fact("host").unwrap_or_default()
                ));
            }
            file.blake3 = blake3.map_or(file.blake3, Into::into);
            read(&file).map(|text| (file.path, text))
        });
        let (file, origin, text) = match file {
            Ok((path, text)) => (writable(&path), path, text),
            Err(reason) => (Err(reason), recording.to_owned(), effective),
        };
        Ok(Self {
            run,
            names,
            text,
            file,
            origin,
        })
    }

    /// Returns the plots of a page as the scenario can have them, and what is left out with the reason.
    ///
    /// # Errors
    /// If two plots have one title.
    fn arrangement(
        &self,
        plots: &[ArrangedPlot],
        titles: &[String],
        about: &Value,
    ) -> Result<(Arrangement, Vec<String>), String> {
        let list = |key: &str| about[key].as_array().into_iter().flatten();
        let columns: Vec<&str> = list("signals")
            .filter_map(|one| one["name"].as_str())
            .collect();
        let own = |column: &str| {
            let is_it = |(recorded, name): &&(String, String)| recorded == column || name == column;
            self.names.iter().find(is_it).map(|(_, name)| name.clone())
        };
        let (mut kept, mut left_out) = (Vec::<Arranged>::new(), Vec::new());
        for plot in plots {
            let of_plot: Vec<&str> = (plot.signals.iter())
                .filter_map(|place| columns.get(*place).copied())
                .collect();
            let (mut signals, mut unknown) = (Vec::new(), Vec::new());
            for column in of_plot {
                match own(column) {
                    Some(name) => signals.push(name),
                    None => unknown.push(column),
                }
            }
            if !unknown.is_empty() {
                left_out.push(format!(
                    "{}: a plot of a scenario cannot name `{}`",
                    plot.title,
                    unknown.join("`, `")
                ));
            }
            if signals.is_empty() {
                continue;
            }
            // Of two plots of one title a report draws the first.
            if kept.iter().any(|one| one.title == plot.title) {
                return Err(format!(
                    "two plots are called `{}`: change a title",
                    plot.title
                ));
            }
            kept.push(Arranged {
                title: plot.title.clone(),
                was: plot.was.clone(),
                signals,
                is_log: plot.log,
            });
        }
        let of_scenario = list("plots").filter(|plot| plot["section"] == "Figures");
        let titles_before = of_scenario
            .filter_map(|plot| plot["title"].as_str())
            .map(Into::into);
        let titles_before: Vec<String> = titles_before.chain(titles.iter().cloned()).collect();
        // Signals of plots at first that are in none now, and that another plot would bring back.
        let of_first =
            list("plots").flat_map(|plot| plot["signals"].as_array().into_iter().flatten());
        let mut of_first =
            of_first.filter_map(|place| columns.get(place.as_u64()? as usize).copied());
        let is_removed = |column: &str| {
            own(column).is_some_and(|name| !kept.iter().any(|one| one.signals.contains(&name)))
        };
        let arrangement = Arrangement {
            is_all: of_first.any(is_removed),
            law: self.run.plan.controller.law.clone(),
            plots: kept,
            titles_before,
        };
        Ok((arrangement, left_out))
    }

    /// Checks that the new text is the same scenario with these plots.
    ///
    /// # Errors
    /// If the old or the new text is invalid, or they differ in more.
    fn check(&self, arrangement: &Arrangement) -> Result<(), String> {
        let plan = |text: &str| {
            let (plant, controller) = (&self.run.plant_program, &self.run.controller_program);
            checked(text, &self.origin, plant, controller).map_err(|failure| failure.reason())
        };
        let before = plan(&self.text)?;
        let after = plan(&arrangement.in_scenario(&self.text)?)?;
        let over_time = after
            .plots
            .iter()
            .filter(|plot| plot.kind == PlotKind::Time);
        let is_kept = (over_time.zip(&arrangement.plots)).all(|(plot, one)| {
            plot.title == one.title
                && plot.signals == one.signals
                && (plot.scale == Scale::Log) == one.is_log
        });
        let expected = Plan {
            plots: after.plots.clone(),
            further_plots: after.further_plots,
            ..before
        };
        let is_same = is_kept && after.plots.len() >= arrangement.plots.len() && after == expected;
        is_same.then_some(()).ok_or_else(|| {
            "the plots cannot be written without changing more of the scenario: copy them".into()
        })
    }
}

/// Reads the file of a scenario, which must not have changed.
fn read(file: &ScenarioFile) -> Result<String, String> {
    let path = file.path.display();
    let text =
        read_regular(&file.path).map_err(|error| format!("{path} cannot be read: {error}"))?;
    match ScenarioFile::of(&file.path, &text).blake3 == file.blake3 {
        true => Ok(text),
        false => Err(format!("{path} has changed since the run")),
    }
}

/// Returns the file itself, behind all links, if this user may replace it.
fn writable(path: &Path) -> Result<PathBuf, String> {
    let name = path.display();
    let unwritable = |reason: &dyn std::fmt::Display| format!("{name} cannot be written: {reason}");
    let file = path.canonicalize().map_err(|error| unwritable(&error))?;
    let metadata = fs::metadata(&file).map_err(|error| unwritable(&error))?;
    if metadata.uid() != rustix::process::geteuid().as_raw() {
        return Err(format!("{name} belongs to another user"));
    }
    let folder = file.parent().unwrap_or(Path::new("/"));
    let is_open =
        access(&file, Access::WRITE_OK).is_ok() && access(folder, Access::WRITE_OK).is_ok();
    if metadata.permissions().readonly() || !is_open {
        return Err(format!("{name} is read-only"));
    }
    Ok(file)
}

/// Replaces the text of a file atomically, and keeps its permissions; returns the hash of the new text.
fn replace(file: &Path, before: &str, after: &str) -> Result<String, String> {
    let write = || {
        let part = PartFile::beside(file)?;
        part.file()
            .set_permissions(fs::metadata(file)?.permissions())?;
        part.file().write_all(after.as_bytes())?;
        // As late as possible: an editor may be open.
        if read_regular(file)? != before {
            return Err(std::io::Error::other("it has changed meanwhile"));
        }
        part.complete(file, true)
    };
    write().map_err(|error| format!("{} cannot be written: {error}", file.display()))?;
    Ok(ScenarioFile::of(file, after).blake3)
}
