//! `hil compare RUN --baseline NAME`: whether a run is still the one that was agreed on.
//!
//! 1. `figures` reads the run: digest, statistics, metrics.
//! 2. `file` has the named run with its tolerances. It is made for review and for version control.
//! 3. `changes` says what differs between the two.
//! 4. With the same digest all signals are the same. Otherwise the recording of the baseline is compared
//!    sample by sample, or, where it is not there, figure by figure. Metrics are compared always.
//!
//! `--update` shows what changes, then writes it; with `--dry-run` it only shows.

mod changes;
mod figures;
mod file;

use std::fmt::Write as _;
use std::path::Path;

use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use serde::Serialize;

use crate::arguments::recordings::CompareArguments;
use crate::arguments::tolerance::Tolerances;
use crate::compare::{Comparison, Verdict, compare};
use changes::{
    Change, TextChange, identity_changes, metric_changes, signal_changes, write_changes,
    write_identity,
};
use figures::Figures;
use file::{Baseline, BaselineFile};

/// A run, held against a baseline.
#[derive(Debug, Serialize)]
struct Judgement {
    baseline: String,
    file: String,
    run: String,
    verdict: Verdict,
    /// Basis of the verdict on signals.
    compared_by: ComparedBy,
    /// Reason for which the samples are not the basis; null if they are, or need not be.
    note: Option<String>,
    /// Changes that show another run: of scenario, versions, binaries. None is a difference by itself.
    identity: Vec<TextChange>,
    /// Figures that differ.
    figures: Vec<Change>,
    /// The samples, if they were compared.
    comparison: Option<Comparison>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum ComparedBy {
    Digest,
    Samples,
    Figures,
}

/// Changes that an update makes.
#[derive(Debug, Serialize)]
struct Update {
    baseline: String,
    file: String,
    is_new: bool,
    written: bool,
    identity: Vec<TextChange>,
    figures: Vec<Change>,
}

/// Runs the command.
///
/// # Errors
/// If there is no such baseline, or the run cannot be read, or the file not be written.
pub fn command(arguments: &CompareArguments, name: &str) -> Result<Exit, Failure> {
    let legal = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
    if name.is_empty() || !name.chars().all(legal) {
        return Err(Failure::usage(format!(
            "`{name}` is no name of a baseline: letters, digits, - and _"
        )));
    }
    let mut file = BaselineFile::read(&arguments.baselines, arguments.update)?;
    if arguments.update {
        return update(arguments, name, &mut file);
    }
    let baseline = file.find(name)?;
    let judgement = judge(&arguments.a, name, baseline, &file)?;
    output::result(arguments.json, &judgement, || judgement.describe())?;
    Ok(judgement.verdict.exit())
}

fn judge(
    run: &Path,
    name: &str,
    baseline: &Baseline,
    file: &BaselineFile,
) -> Result<Judgement, Failure> {
    let figures = Figures::of(run)?;
    if figures.scenario != baseline.scenario {
        let (theirs, ours) = (&baseline.scenario, &figures.scenario);
        return Err(Failure::usage(format!(
            "baseline `{name}` is of scenario `{theirs}`, {} of `{ours}`",
            run.display()
        )));
    }
    let mut changes = metric_changes(baseline, &figures);
    let (mut note, mut comparison) = (None, None);
    let recording = file.recording(baseline);
    let compared_by = if figures.digest == baseline.digest {
        ComparedBy::Digest
    } else if let Some(recording) = recording.filter(|recording| recording.exists()) {
        comparison = Some(against(&recording, run, name, baseline, &figures)?);
        ComparedBy::Samples
    } else {
        note = Some(match &baseline.recording {
            Some(recording) => format!(
                "{} is not there: only digest and figures are compared",
                file.recording(baseline)
                    .unwrap_or_else(|| recording.clone())
                    .display()
            ),
            None => "the baseline keeps no recording: only digest and figures are compared".into(),
        });
        changes.extend(signal_changes(baseline, &figures));
        ComparedBy::Figures
    };
    let signals = match (&comparison, compared_by) {
        (Some(comparison), _) => comparison.verdict(),
        (None, ComparedBy::Digest) => Verdict::Same,
        // Another digest, and no figure may show in what: what may not differ at all does.
        (None, _) if baseline.is_exact() => Verdict::Different,
        (None, _) => Verdict::WithinTolerance,
    };
    let verdict = if signals == Verdict::Different || changes.iter().any(|change| !change.within) {
        Verdict::Different
    } else if signals == Verdict::Same && changes.is_empty() {
        Verdict::Same
    } else {
        Verdict::WithinTolerance
    };
    Ok(Judgement {
        baseline: name.into(),
        file: file.path().display().to_string(),
        run: run.display().to_string(),
        verdict,
        compared_by,
        note,
        identity: identity_changes(baseline, &figures),
        figures: changes,
        comparison,
    })
}

/// Compares the samples of a baseline's recording with those of a run.
fn against(
    recording: &Path,
    run: &Path,
    name: &str,
    baseline: &Baseline,
    figures: &Figures,
) -> Result<Comparison, Failure> {
    let mut tolerances = Tolerances::default();
    for signal in &figures.signals {
        if let Some(before) = baseline.signals.get(&signal.name) {
            tolerances.set(&signal.name, before.tolerance);
        }
    }
    let comparison = compare(recording, run, &[], &tolerances)?;
    if comparison.digest_of_a() != baseline.digest {
        return Err(Failure::usage(format!(
            "{} is not the recording of baseline `{name}`: its digest is {}",
            recording.display(),
            comparison.digest_of_a()
        )));
    }
    Ok(comparison)
}

fn update(
    arguments: &CompareArguments,
    name: &str,
    file: &mut BaselineFile,
) -> Result<Exit, Failure> {
    let figures = Figures::of(&arguments.a)?;
    let before = file.get(name).cloned();
    let is_new = before.is_none();
    let before = before.unwrap_or_default();
    let mut changes = metric_changes(&before, &figures);
    changes.extend(signal_changes(&before, &figures));
    let told = Update {
        baseline: name.into(),
        file: file.path().display().to_string(),
        is_new,
        written: !arguments.dry_run,
        identity: identity_changes(&before, &figures),
        figures: changes,
    };
    let is_changed = !told.identity.is_empty() || !told.figures.is_empty();
    output::result(arguments.json, &told, || told.describe())?;
    if arguments.dry_run {
        return Ok(if is_changed { Exit::Failed } else { Exit::Pass });
    }
    file.update(name, &arguments.a, &figures)?;
    Ok(Exit::Pass)
}

impl Judgement {
    fn describe(&self) -> String {
        output::text(|text| self.write(text))
    }

    fn write(&self, text: &mut String) -> std::fmt::Result {
        let verdict = match self.verdict {
            Verdict::Same => "same as",
            Verdict::WithinTolerance => "within the tolerance of",
            Verdict::Different => "DIFFERENT from",
        };
        writeln!(text, "{verdict} baseline {} ({})", self.baseline, self.file)?;
        if let Some(note) = &self.note {
            writeln!(text, "  {note}")?;
        }
        write_identity(text, &self.identity)?;
        write_changes(text, &self.figures)?;
        if let Some(comparison) = &self.comparison {
            writeln!(text, "\nsamples: a is the baseline, b the run")?;
            text.push_str(&comparison.describe());
        }
        Ok(())
    }
}

impl Update {
    fn describe(&self) -> String {
        output::text(|text| self.write(text))
    }

    fn write(&self, text: &mut String) -> std::fmt::Result {
        let (name, file) = (&self.baseline, &self.file);
        let what = if self.is_new {
            "new baseline"
        } else {
            "baseline"
        };
        let count = self.figures.len();
        let would = if self.written { "" } else { " would" };
        writeln!(
            text,
            "{what} {name} ({file}): {count} figures{would} change"
        )?;
        write_identity(text, &self.identity)?;
        write_changes(text, &self.figures)
    }
}

#[cfg(test)]
mod tests;
