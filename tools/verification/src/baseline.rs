//! `hil compare RUN --baseline NAME`: checks a run against an agreed baseline.
//!
//! 1. `figures` reads the run: digest, statistics, metrics.
//! 2. `file` holds the baseline with its tolerances, in a form made for review and version control.
//! 3. `changes` determines the differences between the two.
//! 4. If the digests are equal, so are all signals. Otherwise the signals are compared with the baseline's recording
//!    sample by sample or, without a recording, figure by figure. Metrics are always compared.
//!
//! `band` is what plots show of a baseline.
//!
//! `--update` shows the changes and writes them; with `--dry-run` it only shows them.

pub mod band;
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

/// Comparison of a run with a baseline.
#[derive(Debug, Serialize)]
struct Judgement {
    baseline: String,
    file: String,
    run: String,
    verdict: Verdict,
    /// Basis of the verdict on signals.
    compared_by: ComparedBy,
    /// Reason why the samples were not compared; null if they were compared or needed no comparison.
    note: Option<String>,
    /// Changes of scenario, versions and binaries, none of which counts as a difference by itself.
    identity: Vec<TextChange>,
    /// Figures that differ.
    figures: Vec<Change>,
    /// Comparison of the samples, if they were compared.
    comparison: Option<Comparison>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum ComparedBy {
    Digest,
    Samples,
    Figures,
}

/// Changes made by an update.
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
/// If the baseline does not exist, the run cannot be read, or the file cannot be written.
pub fn command(arguments: &CompareArguments, name: &str) -> Result<Exit, Failure> {
    let legal = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
    if name.is_empty() || !name.chars().all(legal) {
        return Err(Failure::usage(format!(
            "`{name}` is not a valid baseline name: use letters, digits, - and _"
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
            "baseline `{name}` belongs to scenario `{theirs}`, but {} belongs to `{ours}`",
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
                "{} is missing, so only the digest and the figures are compared",
                file.recording(baseline)
                    .unwrap_or_else(|| recording.clone())
                    .display()
            ),
            None => {
                "the baseline has no recording, so only the digest and the figures are compared"
                    .into()
            }
        });
        changes.extend(signal_changes(baseline, &figures));
        ComparedBy::Figures
    };
    let signals = match (&comparison, compared_by) {
        (Some(comparison), _) => comparison.verdict(),
        (None, ComparedBy::Digest) => Verdict::Same,
        // The digests differ, so some signal differs, even if no figure shows which one.
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
            "{} is not the recording of baseline `{name}`, because its digest is {}; restore the recording, or remove it to compare figures only",
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
    let update = Update {
        baseline: name.into(),
        file: file.path().display().to_string(),
        is_new,
        written: !arguments.dry_run,
        identity: identity_changes(&before, &figures),
        figures: changes,
    };
    let is_changed = !update.identity.is_empty() || !update.figures.is_empty();
    output::result(arguments.json, &update, || update.describe())?;
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
