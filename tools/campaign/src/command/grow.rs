//! `hil campaign grow`: adds draws of the same study and keeps the existing results.
//!
//! The `hil` with which the campaign was planned does the work, and every new case is checked before anything is
//! written. Earlier shards remain unchanged. The manifest is replaced last and atomically, so that workers using the
//! folder meanwhile lose nothing.

use std::fs::{File, Permissions};
use std::io::Write as _;
use std::os::unix::fs::PermissionsExt;

use hil_console::files::part_file::PartFile;
use hil_console::terminal::duration::shown_ns;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;

use crate::folder::Folder;
use crate::manifest::{Copied, GROWN, MANIFEST, Manifest, Stage};
use hil_config::study::{Sampling, Study};
use rustix::fs::{FlockOperation, flock};
use serde_json::json;
use shared_types::number::counted;

use super::cases::Cases;
use super::envelopes::DRAWS;
use super::plan::{every_plan, refuse_ineffective, shard_cases};
use super::planned::{self, become_planned, cannot};
use super::quoted;
use super::study_text::with_cases;
use super::values;
use super::work::open;
use crate::arguments::GrowArguments;

/// File whose lock prevents two processes from adding draws at once.
const LOCK: &str = ".growth";

/// Adds draws to a campaign.
///
/// # Errors
/// If existing cases would change, a new case is invalid, or the folder cannot be written.
pub(super) fn grow(arguments: &GrowArguments) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    let folder = open(&arguments.folder)?;
    become_planned(&folder)?;
    let cannot = |error: std::io::Error| cannot(&folder, &error);
    let lock = File::create(folder.path().join(LOCK)).map_err(cannot)?;
    if flock(&lock, FlockOperation::NonBlockingLockExclusive).is_err() {
        return Err(Failure::usage(
            "another hil campaign grow is running on this folder",
        ));
    }
    // Reopened under the lock, so that the content is current.
    let folder = open(&arguments.folder)?;
    planned::check(&folder)?;
    let cases = Cases::of_folder(&folder, &interruption)?;
    refuse(cases.study(), arguments.cases)?;
    let origin = folder.path().join(&folder.manifest().study.path);
    let text = with_cases(cases.study().text(), arguments.cases)
        .ok_or_else(|| Failure::usage("the study does not set `cases`"))?;
    let study = Study::parse(&text, origin)?;
    let before = folder.manifest().cases;
    let cases = Cases::by_folder(study, &folder, &interruption)?;
    refuse_ineffective(&cases)?;
    every_plan(&cases, before, None, &interruption)?;
    let manifest = write(&folder, &cases)?;
    let more = manifest.cases - before;
    let core_s = manifest.case_s * more as f64;
    let result = json!({
        "study": manifest.name,
        "draws": cases.study().draws,
        "cases": manifest.cases,
        "new_cases": more,
        "core_s": core_s,
    });
    output::result(arguments.json, &result, || {
        let is_judged = !cases.study().goals.is_empty();
        let note = match is_judged {
            true => "  adding draws until a goal is met invalidates its confidence\n",
            false => "",
        };
        format!(
            "{}: {} now, {more} of them new, about {} on one core; earlier results are kept\n{note}hil campaign run {}\n",
            manifest.name,
            counted(manifest.cases, "case"),
            shown_ns((core_s * 1e9) as u64),
            quoted(folder.path())
        )
    })?;
    Ok(Exit::Pass)
}

/// Refuses changes that would alter existing cases.
fn refuse(study: &Study, draws: u64) -> Result<(), Failure> {
    let why = match study.sampling {
        Sampling::LatinHypercube => {
            "a Latin hypercube divides the range of each value by the number of draws, so adding draws would change every case: plan another campaign, or use sampling = \"independent\" or \"sobol\""
        }
        Sampling::Grid => {
            "a grid has one draw per point, so adding draws would change its cases: plan another campaign"
        }
        Sampling::Independent | Sampling::Sobol | Sampling::Saltelli if draws <= study.rows() => {
            let word = match study.sampling {
                Sampling::Saltelli => "row",
                _ => "draw",
            };
            return Err(Failure::usage(format!(
                "--cases {draws}: the campaign already has {}, and draws are never removed",
                counted(study.rows(), word)
            )));
        }
        Sampling::Independent | Sampling::Sobol | Sampling::Saltelli => return Ok(()),
    };
    Err(Failure::usage(why))
}

/// Writes the new files into the folder, the manifest last.
fn write(folder: &Folder, cases: &Cases) -> Result<Manifest, Failure> {
    let cannot = |error: std::io::Error| cannot(folder, &error);
    let (old, study) = (folder.manifest(), cases.study());
    let put = |name: &str, text: &[u8]| {
        let path = folder.path().join(name);
        let part = PartFile::beside(&path)?;
        part.file().write_all(text)?;
        // Independent of the umask: a file that others can write is not trusted.
        let mode = part.file().metadata()?.permissions().mode();
        let own = Permissions::from_mode(mode & !0o022);
        part.file().set_permissions(own)?;
        part.complete(&path, true)
    };
    let copy = Copied {
        path: format!("study-{}.toml", study.draws),
        blake3: blake3::hash(study.text().as_bytes()).to_hex().to_string(),
    };
    put(&copy.path, study.text().as_bytes()).map_err(cannot)?;
    let mut manifest = Manifest {
        schema: GROWN,
        cases: study.cases(),
        shard_cases: shard_cases(study.cases() - old.cases, old.case_s),
        study: copy,
        ..old.clone()
    };
    manifest.grown.push(Stage {
        id: folder.id().into(),
        cases: old.cases,
        shard_cases: old.shard_cases,
    });
    if let Some(grid) = &mut manifest.curves {
        // A multiple of the old stride, so that the sampled draws are a subset of the previous ones.
        grid.every *= study.draws.div_ceil(DRAWS * grid.every);
    }
    values::write(folder.path(), &manifest, &cases.draws)?;
    let text = manifest.sealed_text().map_err(Failure::infrastructure)?;
    put(MANIFEST, text.as_bytes()).map_err(cannot)?;
    Ok(manifest)
}
