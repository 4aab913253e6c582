//! Programs that an agent may run: those in its own cache, identified only by their hashes, or those listed when the
//! agent was started.

use std::fs;
use std::io::{self, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

use hil_session::file::hash;

use crate::machine::free_bytes;
use crate::message::Refusal;

/// Maximum number of files in a cache.
const MOST_FILES: usize = 8;
/// Age at which a partial copy is obsolete: no desk waits that long for its next part.
const PART_LIMIT: Duration = Duration::from_secs(300);
/// Maximum length of a program in bytes.
pub(crate) const MOST_BYTES: u64 = 512 << 20;

/// Programs that an agent may run.
#[derive(Debug)]
pub enum AllowedPrograms {
    /// Any received program, cached in this folder.
    Cached(PathBuf),
    /// Listed programs, with their hashes at the time of listing.
    Listed(Vec<(PathBuf, String)>),
}

impl AllowedPrograms {
    /// Creates the cache in the folder of the running agent, where the desk's script stored the agent.
    ///
    /// # Errors
    /// If the folder is accessible to other users.
    pub fn cached() -> Result<Self, String> {
        let own = std::env::current_exe().map_err(|error| error.to_string())?;
        let folder = own.parent().unwrap_or(Path::new("/")).to_owned();
        let metadata =
            fs::metadata(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        if metadata.uid() != rustix::process::geteuid().as_raw() || metadata.mode() & 0o022 != 0 {
            return Err(format!(
                "{} is not a folder of this user alone; restrict it with `chmod 700`",
                folder.display()
            ));
        }
        make_room(&folder, 0);
        Ok(Self::Cached(folder))
    }

    /// Creates the list of programs.
    ///
    /// # Errors
    /// If a program cannot be read or is not executable.
    pub(crate) fn listed(programs: &[PathBuf]) -> Result<Self, String> {
        let listed = |program: &PathBuf| {
            let in_words = |error: io::Error| format!("{}: {error}", program.display());
            let metadata = fs::metadata(program).map_err(in_words)?;
            if !metadata.is_file() || metadata.mode() & 0o111 == 0 {
                return Err(format!(
                    "{} is not executable; run `chmod +x` on it, or list another program",
                    program.display()
                ));
            }
            Ok((program.clone(), hash(program).map_err(in_words)?))
        };
        programs
            .iter()
            .map(listed)
            .collect::<Result<_, _>>()
            .map(Self::Listed)
    }

    /// Returns the file of a program; its content is verified at each call.
    #[must_use]
    pub fn find(&self, blake3: &str) -> Option<PathBuf> {
        blake3::Hash::from_hex(blake3).ok()?;
        let file = match self {
            Self::Cached(folder) => folder.join(blake3),
            Self::Listed(programs) => {
                let is_it = |(_, listed): &&(PathBuf, String)| listed == blake3;
                programs.iter().find(is_it)?.0.clone()
            }
        };
        hash(&file).is_ok_and(|hash| hash == blake3).then_some(file)
    }

    /// Returns the folder of the cache, if there is one.
    pub(crate) fn folder(&self) -> Option<&Path> {
        match self {
            Self::Cached(folder) => Some(folder),
            Self::Listed(_) => None,
        }
    }

    /// Starts to store a program.
    ///
    /// # Errors
    /// If only listed programs are allowed, or there is no space.
    pub(crate) fn store(&self, blake3: &str, bytes: u64) -> Result<Storing, Refusal> {
        let Self::Cached(folder) = self else {
            let reason = "this agent runs only the programs that were listed when it was started; add the program with --allow";
            return Err((true, reason.into()));
        };
        if blake3::Hash::from_hex(blake3).is_err() {
            return Err((true, "invalid hash of a program".into()));
        }
        if bytes > MOST_BYTES {
            let most = MOST_BYTES >> 20;
            return Err((true, format!("the program has more than {most} MiB")));
        }
        make_room(folder, 1);
        if let Some(free) = free_bytes(folder).filter(|free| *free < bytes) {
            return Err((false, no_room(bytes, free)));
        }
        let part = folder.join(format!("{blake3}.part{}", std::process::id()));
        let mut options = fs::OpenOptions::new();
        let file = options
            .write(true)
            .create(true)
            .truncate(true)
            .mode(0o600)
            .open(&part);
        let file = file.map_err(|error| (true, format!("{}: {error}", part.display())))?;
        Ok(Storing {
            file,
            blake3: blake3.into(),
            part,
            left: bytes,
        })
    }

    /// Removes all cached programs; returns their number.
    #[must_use]
    pub fn clean(&self) -> u32 {
        let Self::Cached(folder) = self else { return 0 };
        let files = files(folder);
        files
            .iter()
            .filter(|file| fs::remove_file(file).is_ok())
            .count() as u32
    }
}

/// Program being received. Dropping the value before the program is complete removes the file.
#[derive(Debug)]
pub(crate) struct Storing {
    file: fs::File,
    blake3: String,
    part: PathBuf,
    left: u64,
}

impl Storing {
    /// Adds a part; returns `true` once the program is complete and matches its hash.
    ///
    /// # Errors
    /// If the program is longer than announced or does not match its hash, or if there is no space.
    pub(crate) fn take(&mut self, part: &[u8]) -> Result<bool, String> {
        let in_words = |error: io::Error| format!("cannot store the program: {error}");
        let remaining = self.left.checked_sub(part.len() as u64);
        self.left = remaining.ok_or("the program is longer than announced")?;
        self.file.write_all(part).map_err(in_words)?;
        if self.left > 0 {
            return Ok(false);
        }
        self.file.sync_all().map_err(in_words)?;
        if hash(&self.part).map_err(in_words)? != self.blake3 {
            return Err("the received program does not match its hash".into());
        }
        self.file
            .set_permissions(fs::Permissions::from_mode(0o500))
            .map_err(in_words)?;
        fs::rename(&self.part, self.part.with_file_name(&self.blake3)).map_err(in_words)?;
        Ok(true)
    }
}

impl Drop for Storing {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.part); // it has been renamed by now, or is obsolete
    }
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let is_hash = |name: &str| name.split('.').next().is_some_and(|stem| stem.len() == 64);
    let files = entries.filter(|entry| entry.file_name().to_str().is_some_and(is_hash));
    files.map(|entry| entry.path()).collect()
}

/// Returns the error for a lack of space for a program of `bytes` bytes.
#[must_use]
pub fn no_room(bytes: u64, free: u64) -> String {
    let mib = |bytes: u64| bytes.div_ceil(1 << 20);
    format!(
        "no room for a program of {} MiB: {} MiB are free in its cache folder, which `hil target clean` empties",
        mib(bytes),
        free >> 20
    )
}

/// Removes the oldest programs to make room for `more`, and remains of interrupted copies.
fn make_room(folder: &Path, more: usize) {
    let mut programs = Vec::new();
    for file in files(folder) {
        let changed = fs::metadata(&file)
            .and_then(|metadata| metadata.modified())
            .ok();
        if file.extension().is_none() {
            programs.push((changed, file));
            continue;
        }
        // Another agent may be writing it.
        let age = changed.and_then(|changed| changed.elapsed().ok());
        if age.is_some_and(|age| age > PART_LIMIT) {
            let _ = fs::remove_file(file); // the next call tries again
        }
    }
    programs.sort();
    let own = std::env::current_exe().ok();
    programs.retain(|(_, file)| Some(file) != own.as_ref());
    // The agent itself is one of the files.
    let surplus = (programs.len() + 1 + more).saturating_sub(MOST_FILES);
    for (_, file) in programs.into_iter().take(surplus) {
        let _ = fs::remove_file(file); // the next call tries again
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn store(programs: &AllowedPrograms, content: &[u8]) -> Result<String, Refusal> {
        let hash = blake3::hash(content).to_hex().to_string();
        let mut storing = programs.store(&hash, content.len() as u64)?;
        let (first, second) = content.split_at(content.len() / 2);
        assert_eq!(storing.take(first), Ok(false));
        assert_eq!(storing.take(second), Ok(true)); // whole
        Ok(hash)
    }

    #[test]
    fn a_program_is_stored_by_its_hash_and_found_only_while_unchanged() {
        let folder = tempfile::tempdir().expect("a folder");
        let programs = AllowedPrograms::Cached(folder.path().into());
        let hash = store(&programs, b"a program").expect("kept");
        let file = programs.find(&hash).expect("found");
        assert_eq!(fs::metadata(&file).expect("there").mode() & 0o777, 0o500);
        fs::set_permissions(&file, fs::Permissions::from_mode(0o600)).expect("writable");
        fs::write(&file, "another").expect("changed");
        assert_eq!(programs.find(&hash), None);
    }

    #[test]
    fn only_executable_files_can_be_listed() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("a.toml");
        assert!(AllowedPrograms::listed(std::slice::from_ref(&file)).is_err()); // it is not there
        fs::write(&file, "no program").expect("written");
        let listed = |file: &Path| AllowedPrograms::listed(&[file.into()]).map(|_| ());
        for none in [&file, folder.path()] {
            let reason = listed(none).expect_err("no program");
            assert!(reason.contains("is not executable"), "{reason}");
        }
        fs::set_permissions(&file, fs::Permissions::from_mode(0o700)).expect("set");
        assert_eq!(listed(&file), Ok(()));
    }

    #[test]
    fn a_corrupted_transfer_leaves_no_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let programs = AllowedPrograms::Cached(folder.path().into());
        let hash = blake3::hash(b"a program").to_hex().to_string();
        let mut other = programs.store(&hash, 9).expect("begins");
        assert!(other.take(b"a PROGRAM").is_err());
        drop(other);
        let mut longer = programs.store(&hash, 9).expect("begins");
        assert!(longer.take(b"a program!").is_err());
        drop(longer);
        drop(programs.store(&hash, 9).expect("begins"));
        assert_eq!(files(folder.path()), Vec::<PathBuf>::new());
        for name in ["", "../x", "a"] {
            assert!(programs.store(name, 9).is_err(), "{name}");
        }
        let (_, reason) = programs.store(&hash, MOST_BYTES + 1).expect_err("large");
        assert_eq!(reason, "the program has more than 512 MiB");
    }

    #[test]
    fn the_cache_is_bounded_and_can_be_emptied() {
        let folder = tempfile::tempdir().expect("a folder");
        let programs = AllowedPrograms::Cached(folder.path().into());
        for number in 0..3 * MOST_FILES {
            store(&programs, format!("program {number}").as_bytes()).expect("kept");
            assert!(files(folder.path()).len() <= MOST_FILES);
        }
        let last = format!("program {}", 3 * MOST_FILES - 1);
        assert!(
            programs
                .find(&blake3::hash(last.as_bytes()).to_hex())
                .is_some()
        );
        assert!(programs.clean() > 0);
        assert!(files(folder.path()).is_empty());
    }

    #[test]
    fn a_contact_that_stores_nothing_removes_no_program() {
        let folder = tempfile::tempdir().expect("a folder");
        let programs = AllowedPrograms::Cached(folder.path().into());
        for number in 0..MOST_FILES {
            store(&programs, format!("program {number}").as_bytes()).expect("kept");
        }
        make_room(folder.path(), 0);
        assert_eq!(files(folder.path()).len(), MOST_FILES - 1);
        make_room(folder.path(), 1);
        assert_eq!(files(folder.path()).len(), MOST_FILES - 2);
    }

    #[test]
    fn partial_copies_do_not_count_as_programs_and_old_ones_are_removed() {
        let folder = tempfile::tempdir().expect("a folder");
        let programs = AllowedPrograms::Cached(folder.path().into());
        for number in 0..MOST_FILES - 1 {
            store(&programs, format!("program {number}").as_bytes()).expect("kept");
        }
        let count = files(folder.path()).len();
        let part = |name: &str, age: Duration| {
            let path = folder.path().join(format!("{name}.part1"));
            let file = fs::File::create(&path).expect("made");
            let changed = std::time::SystemTime::now() - age;
            file.set_modified(changed).expect("set");
            path
        };
        let name = |number: u8| blake3::hash(&[number]).to_hex().to_string();
        let new: Vec<PathBuf> = (0..9)
            .map(|number| part(&name(number), Duration::ZERO))
            .collect();
        let old = part(&name(9), 2 * PART_LIMIT);
        make_room(folder.path(), 1);
        assert!(new.iter().all(|part| part.exists()) && !old.exists());
        assert_eq!(files(folder.path()).len(), count - 1 + new.len());
    }

    #[test]
    fn an_agent_with_a_list_stores_no_program() {
        let own = std::env::current_exe().expect("this");
        let programs = AllowedPrograms::listed(std::slice::from_ref(&own)).expect("there");
        assert_eq!(programs.find(&hash(&own).expect("read")), Some(own));
        assert_eq!(programs.find(&blake3::hash(b"").to_hex()), None);
        assert!(programs.store(&blake3::hash(b"x").to_hex(), 1).is_err());
    }
}
