//! Long tables of a run: kept once in its folder, named by the hash of their content, so that neither the scenario's
//! text nor the plant's job has their numbers.

use std::fs::{self, File};
use std::io::BufWriter;
use std::path::Path;

use hil_config::plan::Plan;
use hil_config::table::{PACKED, Points};
use hil_console::terminal::exit::Failure;

/// Longest text of all tables in a scenario, in bytes.
const LONGEST_TEXT: usize = 16 << 20;
/// Folder of long tables.
const FOLDER: &str = "tables";

/// Replaces the numbers of long tables by files below a folder, which [`write`] creates. Tables stay in the text as
/// long as there is room.
pub(super) fn refer(plan: &mut Plan, folder: &Path) -> Vec<Points> {
    let mut left = LONGEST_TEXT;
    let mut long = Vec::new();
    for table in plan.tables_mut() {
        let points = table.points_mut();
        let name = points
            .file()
            .and_then(Path::file_name)
            .map(ToOwned::to_owned);
        let name = match name {
            Some(name) if is_hash(Path::new(&name)) => name,
            _ => {
                let bytes = points.text_bytes(left);
                if bytes <= left && points.file().is_none() {
                    left -= bytes;
                    continue;
                }
                points.packed_name().into()
            }
        };
        points.refer_to(folder.join(FOLDER).join(name));
        long.push(points.clone());
    }
    long
}

fn is_hash(name: &Path) -> bool {
    let stem = name.file_stem().and_then(|stem| stem.to_str());
    name.extension().is_some_and(|ending| ending == PACKED)
        && stem.is_some_and(|stem| stem.len() == 64 && stem.bytes().all(|b| b.is_ascii_hexdigit()))
}

/// Writes long tables to their files, each once.
///
/// # Errors
/// If one cannot be written.
pub(super) fn write(long: &[Points]) -> Result<(), Failure> {
    for points in long {
        let Some(path) = points.file().filter(|path| !path.exists()) else {
            continue;
        };
        let result = path
            .parent()
            .map_or(Ok(()), fs::create_dir_all)
            .and_then(|()| {
                let mut file = BufWriter::new(File::create(path)?);
                points.write(&mut file)?;
                file.into_inner()
                    .map_err(std::io::IntoInnerError::into_error)
            });
        result.map_err(|error| {
            Failure::infrastructure(format!("cannot write {}: {error}", path.display()))
        })?;
    }
    Ok(())
}

/// Returns the plan whose long tables are files in the folder of a session, from which the plant reads them.
///
/// # Errors
/// If one cannot be written.
pub(super) fn in_session(plan: &Plan, session: &Path) -> Result<Plan, Failure> {
    let mut plan = plan.clone();
    write(&refer(&mut plan, session))?;
    Ok(plan)
}
