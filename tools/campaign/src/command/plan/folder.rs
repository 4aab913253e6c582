//! Writing a campaign folder: copies of everything that the cases need, with their hashes, and the values of every
//! case.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs;
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use hil_console::files::part_file::PartFolder;
use hil_console::terminal::exit::Failure;
use hil_facts::programs::binaries::host::ModelKind;
use hil_facts::programs::binaries::named::{CONTROLLER, PLANT};
use hil_facts::programs::binaries::trusted;
use hil_facts::programs::binaries::{Binaries, Binary, beside};

use crate::folder::{CONFLICTS, SHARDS, try_out};
use crate::manifest::{self, Copied, MANIFEST, Manifest, SCHEMA};
use hil_session::file::hash;

use super::{Checked, ports};
use crate::command::planned::{PORT, PROGRAMS};
use crate::command::study_text::with_cases;
use crate::command::{quoted, values};

/// Target duration of a shard with enough cases, in s.
const SHARD_S: f64 = 20.0;
/// Smallest and largest number of shards of a large campaign.
const SHARDS_WANTED: [u64; 2] = [64, 20_000];

/// Refuses a folder with another campaign or other content.
pub(super) fn refuse_other(out: &Path, checked: &Checked) -> Result<(), Failure> {
    let out_text = out.display();
    let is_empty = fs::read_dir(out).map_or(true, |mut entries| entries.next().is_none());
    if is_empty {
        return Ok(());
    }
    let Ok(existing) = Manifest::read(out) else {
        return Err(Failure::usage(format!(
            "{out_text} is not empty; a campaign needs an empty folder"
        )));
    };
    let folder = tempfile::tempdir().map_err(Failure::infrastructure)?;
    let new = copied(checked, folder.path())?;
    let differences = manifest::differences(&existing, &new);
    let study = fs::read_to_string(out.join(&existing.study.path));
    let study = study
        .ok()
        .and_then(|text| with_cases(&text, checked.cases.study().rows()));
    if differences.len() == 1 && study.as_deref() == Some(checked.cases.study().text()) {
        return Err(Failure::usage(format!(
            "{out_text} holds this campaign with another number of cases; hil campaign grow {} --cases {} adds cases to it",
            quoted(out),
            checked.cases.study().rows()
        )));
    }
    Err(Failure::usage(if differences.is_empty() {
        format!(
            "{out_text} already holds this campaign; hil campaign run {}",
            quoted(out)
        )
    } else {
        format!(
            "{out_text} holds another campaign, which differs in {}; choose another folder with -o",
            differences.join("; ")
        )
    }))
}

/// Writes the folder atomically.
pub(super) fn write(checked: &Checked, out: &Path) -> Result<(), Failure> {
    let out_text = out.display();
    let cannot = |error: io::Error| Failure::usage(format!("cannot write {out_text}: {error}"));
    let parent = out.parent().filter(|parent| *parent != Path::new(""));
    if let Some(parent) = parent {
        fs::create_dir_all(parent).map_err(cannot)?;
    }
    let absolute = std::path::absolute(out).map_err(cannot)?;
    let beside = absolute.parent().unwrap_or(Path::new("/"));
    // Otherwise `run` would refuse the campaign.
    trusted::folder(beside).map_err(|why| {
        Failure::usage(format!(
            "a campaign in {out_text} could not be run: {why}; with -o, choose a folder that only you can write to"
        ))
    })?;
    let part = PartFolder::beside(&absolute).map_err(cannot)?;
    try_out(part.path()).map_err(Failure::usage)?;
    let manifest = copied(checked, part.path())?;
    let text = manifest.sealed_text().map_err(Failure::infrastructure)?;
    fs::write(part.path().join(MANIFEST), text).map_err(cannot)?;
    values::write(part.path(), &manifest, &checked.cases.draws)?;
    for folder in [SHARDS, CONFLICTS] {
        fs::create_dir(part.path().join(folder)).map_err(cannot)?;
    }
    keep_others_out(part.path()).map_err(cannot)?;
    part.complete(&absolute).map_err(cannot)
}

/// Revokes write access of group and others, which the umask may have granted, because `run` refuses a folder that
/// others can write to.
fn keep_others_out(path: &Path) -> io::Result<()> {
    let metadata = fs::symlink_metadata(path)?;
    let mode = metadata.permissions().mode();
    fs::set_permissions(path, fs::Permissions::from_mode(mode & !0o022))?;
    if metadata.is_dir() {
        for entry in fs::read_dir(path)? {
            keep_others_out(&entry?.path())?;
        }
    }
    Ok(())
}

/// Copies everything that the cases need into a folder.
fn copied(checked: &Checked, folder: &Path) -> Result<Manifest, Failure> {
    let cases = &checked.cases;
    let study = cases.study();
    let cannot = |path: &Path, error: io::Error| {
        Failure::infrastructure(format!("cannot copy {}: {error}", path.display()))
    };
    let text = |name: &str, text: &str| {
        fs::write(folder.join(name), text).map_err(|error| cannot(Path::new(name), error))?;
        Ok::<_, Failure>(Copied {
            path: name.into(),
            blake3: blake3::hash(text.as_bytes()).to_hex().to_string(),
        })
    };
    let copy = |from: &Path, path: String| {
        let to = folder.join(&path);
        let folder_result = to.parent().map_or(Ok(()), fs::create_dir_all);
        let copy_result = folder_result.and_then(|()| fs::copy(from, &to));
        copy_result.map_err(|error| cannot(from, error))?;
        let blake3 = hash(&to).map_err(|error| cannot(from, error))?;
        Ok::<_, Failure>(Copied { path, blake3 })
    };
    let mut tables = BTreeMap::new();
    let beside = cases.scenario().path().parent().unwrap_or(Path::new(""));
    for (number, name) in cases.named_tables().into_iter().enumerate() {
        let from: PathBuf = beside.join(&name);
        if let Some(text) = ports::text_of(&from) {
            let names = ports::dbc_beside(&from, &text)?;
            tables.extend(copies_beside(
                &from,
                names,
                &format!("tables/{number}"),
                copy,
            )?);
            tables.insert(name, copy(&from, format!("tables/{number}/bus.toml"))?);
            continue;
        }
        // An FMU may depend on the file extension.
        let ending = from.extension().and_then(OsStr::to_str).unwrap_or("csv");
        tables.insert(name, copy(&from, format!("tables/{number}.{ending}"))?);
    }
    let own = std::env::current_exe().map_err(Failure::infrastructure)?;
    let program = |side: &str, binary: &Binary| {
        let host = binary.host.as_ref();
        // An FMU is recognised by its content, a Python file by its name; its modules lie beside it.
        let place = match host.is_some_and(|host| host.kind == ModelKind::Python) {
            true => format!("{PROGRAMS}/of_{side}/{side}.py"),
            false => format!("{PROGRAMS}/{side}"),
        };
        copy(&binary.path, place).map(Some)
    };
    for (side, binary) in cases.binaries().into_iter().flat_map(sides_of) {
        for (file, place) in binary.modules_beside()? {
            let copied = copy(&file, format!("{PROGRAMS}/of_{side}/{}", place.display()))?;
            tables.insert(file.to_string_lossy().into_owned(), copied);
        }
    }
    let (plant, controller) = match cases.binaries() {
        None => (None, None),
        Some(binaries) => (
            program("plant", &binaries.plant)?,
            match cases.port()? {
                // In a folder of its own, with what the far end needs.
                Some(port) => {
                    let names = ports::all_beside(port)?;
                    tables.extend(copies_beside(port, names, PORT, copy)?);
                    Some(copy(port, format!("{PORT}/controller.port.toml"))?)
                }
                None => program("controller", &binaries.controller)?,
            },
        ),
    };
    let pair = match cases.binaries() {
        Some(_) => None,
        None => beside_hil()?,
    };
    let pair = pair.map(|[plant, controller]| {
        Ok::<_, Failure>([
            copy(&plant, format!("{PROGRAMS}/plant-process"))?,
            copy(&controller, format!("{PROGRAMS}/controller-process"))?,
        ])
    });
    // Placed beside the copy of `hil`, which looks for it there.
    let sides = cases.binaries().map(|both| [&both.plant, &both.controller]);
    let hosts = { sides.into_iter().flatten() }.filter_map(|one| one.host.as_ref());
    for host in hosts {
        for (file, place) in host.companions().map_err(Failure::usage)? {
            copy(&file, format!("{PROGRAMS}/{}", place.display()))?;
        }
    }
    Ok(Manifest {
        schema: SCHEMA,
        name: study.name.clone(),
        cases: study.cases(),
        shard_cases: shard_cases(study.cases(), checked.facts.case_s),
        grown: Vec::new(),
        study: text("study.toml", study.text())?,
        scenario: text("scenario.toml", cases.scenario().text())?,
        tables,
        hil: copy(&own, format!("{PROGRAMS}/hil"))?,
        plant,
        controller,
        pair: pair.transpose()?,
        columns: checked.columns.clone(),
        curves: checked.curves.clone(),
        faults: checked.faults.clone(),
        case_s: checked.facts.case_s,
    })
}

/// Returns both programs with the names of their sides.
fn sides_of(binaries: &Binaries) -> [(&'static str, &Binary); 2] {
    [
        (PLANT.side, &binaries.plant),
        (CONTROLLER.side, &binaries.controller),
    ]
}

/// Copies files that lie beside another one into a folder; returns the copies by the paths of the files.
fn copies_beside(
    file: &Path,
    names: Vec<String>,
    to: &str,
    copy: impl Fn(&Path, String) -> Result<Copied, Failure>,
) -> Result<Vec<(String, Copied)>, Failure> {
    let home = file.parent().unwrap_or(Path::new(""));
    let copies = names.into_iter().map(|name| {
        let from = home.join(&name);
        let copy = copy(&from, format!("{to}/{name}"))?;
        Ok((from.to_string_lossy().into_owned(), copy))
    });
    copies.collect()
}

/// Finds the plant and controller programs next to `hil`, if both exist.
fn beside_hil() -> Result<Option<[PathBuf; 2]>, Failure> {
    let both = [beside(PLANT.beside)?, beside(CONTROLLER.beside)?];
    Ok(both.iter().all(|path| path.is_file()).then_some(both))
}

/// Chooses the number of cases per shard: several seconds of work, enough shards for many cores, and not too many
/// files.
pub(in crate::command) fn shard_cases(cases: u64, case_s: f64) -> u64 {
    let [least, most] = SHARDS_WANTED;
    let by_time = (SHARD_S / case_s) as u64;
    let by_cores = cases.div_ceil(least);
    let size = by_time.min(by_cores);
    size.max(cases.div_ceil(most)).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_owner_can_write_to_a_planned_folder() {
        let folder = tempfile::tempdir().expect("a folder");
        let inner = folder.path().join("programs");
        let file = inner.join("hil");
        fs::create_dir(&inner).expect("a folder");
        fs::write(&file, "").expect("a file");
        let set = |path: &Path, mode| {
            fs::set_permissions(path, fs::Permissions::from_mode(mode)).expect("it is ours");
        };
        set(&file, 0o775);
        set(&inner, 0o777);
        keep_others_out(folder.path()).expect("it is ours");
        let mode = |path: &Path| fs::metadata(path).expect("there").permissions().mode() & 0o777;
        assert_eq!((mode(&inner), mode(&file)), (0o755, 0o755));
    }

    #[test]
    fn shards_take_several_seconds_and_are_neither_too_few_nor_too_many() {
        assert_eq!(shard_cases(30_000, 1.0), 20);
        assert_eq!(shard_cases(1_000_000, 1e-3), 15_625);
        assert_eq!(shard_cases(1_000_000, 10.0), 50);
        assert_eq!(shard_cases(10, 1e-3), 1);
        assert_eq!(shard_cases(1, 100.0), 1);
    }
}
