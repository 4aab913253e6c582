//! Seal of a recording whose programs were named: proof that this user made it.
//!
//! A recording from another user may name any path and any hash, so running the programs it names would run whatever
//! its author wants. The seal is a keyed hash over these names; the key is a file of the user and never part of a
//! recording.

use std::collections::BTreeMap;
use std::fs;
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use blake3::{Hash, Hasher};

use super::trusted;

/// Fact with the seal.
pub(crate) const SEAL: &str = "programs_seal";
/// Facts covered by the seal.
const SEALED: [&str; 5] = [
    "session_id",
    "plant_binary",
    "plant_blake3",
    "controller_binary",
    "controller_blake3",
];
const KEY_BYTES: usize = 32;

/// Seals the facts of a recording.
///
/// # Errors
/// If there is no key and a new key cannot be created.
pub fn seal(facts: &mut BTreeMap<String, String>) -> Result<(), String> {
    let path = key_file()?;
    let key = match read(&path) {
        Ok(key) => key,
        Err(_) => make(&path).and_then(|()| read(&path))?,
    };
    let sealed = hash(&key, |name| facts.get(name).map(String::as_str));
    facts.insert(SEAL.into(), sealed.to_hex().to_string());
    Ok(())
}

/// Returns `true` if this user sealed these facts; without a key, nobody did.
///
/// # Errors
/// If the facts have a seal and the key cannot be used to check it.
pub(crate) fn is_own<'a>(fact: impl Fn(&str) -> Option<&'a str>) -> Result<bool, String> {
    if fact(SEAL).is_none() {
        return Ok(false);
    }
    let path = key_file()?;
    if fs::symlink_metadata(&path).is_err_and(|error| error.kind() == ErrorKind::NotFound) {
        return Ok(false);
    }
    Ok(is_of(&read(&path)?, fact))
}

fn is_of<'a>(key: &[u8; KEY_BYTES], fact: impl Fn(&str) -> Option<&'a str>) -> bool {
    let stored = fact(SEAL).and_then(|seal| Hash::from_hex(seal).ok());
    // Comparison of hashes takes constant time.
    stored.is_some_and(|stored| stored == hash(key, fact))
}

/// Returns the hash over all facts, each with its length, so that text cannot move from one fact to the next.
fn hash<'a>(key: &[u8; KEY_BYTES], fact: impl Fn(&str) -> Option<&'a str>) -> Hash {
    let mut hasher = Hasher::new_keyed(key);
    for name in SEALED {
        let value = fact(name).unwrap_or_default();
        hasher.update(&(value.len() as u64).to_le_bytes());
        hasher.update(value.as_bytes());
    }
    hasher.finalize()
}

/// Returns the path of the key, in the standard location for program state.
fn key_file() -> Result<PathBuf, String> {
    let folder = |name| {
        let folder = std::env::var_os(name).map(PathBuf::from);
        folder.filter(|folder| folder.is_absolute())
    };
    let state = folder("XDG_STATE_HOME");
    let state = state.or_else(|| Some(folder("HOME")?.join(".local/state")));
    let state = state.ok_or("neither XDG_STATE_HOME nor HOME is set to a folder")?;
    Ok(state.join("hil/key"))
}

/// Reads a key that nobody else can have read or written.
fn read(path: &Path) -> Result<[u8; KEY_BYTES], String> {
    let (path, metadata) = trusted::file(path)?;
    if metadata.mode() & 0o077 != 0 {
        return Err(format!("{} can be read by others", path.display()));
    }
    let mut key = Vec::new();
    (fs::File::open(&path))
        .and_then(|file| file.take(KEY_BYTES as u64 + 1).read_to_end(&mut key))
        .map_err(|error| format!("{}: {error}", path.display()))?;
    (key.try_into()).map_err(|_| format!("{} is not a valid key; remove it", path.display()))
}

/// Creates a key if there is none; if two are created at once, one is kept.
fn make(path: &Path) -> Result<(), String> {
    let in_words = |error: std::io::Error| format!("{}: {error}", path.display());
    let folder = path.parent().unwrap_or(Path::new("/"));
    (fs::DirBuilder::new().recursive(true).mode(0o700))
        .create(folder)
        .map_err(in_words)?;
    let mut key = [0; KEY_BYTES];
    (fs::File::open("/dev/urandom"))
        .and_then(|mut random| random.read_exact(&mut key))
        .map_err(in_words)?;
    let mut file = tempfile::Builder::new()
        .permissions(fs::Permissions::from_mode(0o600))
        .tempfile_in(folder)
        .map_err(in_words)?;
    file.write_all(&key).map_err(in_words)?;
    match file.persist_noclobber(path) {
        Err(refused) if refused.error.kind() != ErrorKind::AlreadyExists => {
            Err(in_words(refused.error))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEY: [u8; KEY_BYTES] = [7; KEY_BYTES];

    fn facts() -> BTreeMap<String, String> {
        let mut facts: BTreeMap<String, String> = (SEALED.iter())
            .map(|name| ((*name).to_owned(), format!("{name} is this")))
            .collect();
        let sealed = hash(&KEY, |name| facts.get(name).map(String::as_str));
        facts.insert(SEAL.into(), sealed.to_hex().to_string());
        facts
    }

    fn holds(key: &[u8; KEY_BYTES], facts: &BTreeMap<String, String>) -> bool {
        is_of(key, |name| facts.get(name).map(String::as_str))
    }

    #[test]
    fn a_seal_is_valid_only_for_its_facts_and_its_key() {
        let sealed = facts();
        assert!(holds(&KEY, &sealed));
        assert!(!holds(&[8; KEY_BYTES], &sealed));
        for name in SEALED {
            let mut other = sealed.clone();
            other.insert(name.into(), "another".into());
            assert!(!holds(&KEY, &other), "{name}");
            other.remove(name);
            assert!(!holds(&KEY, &other), "without {name}");
        }
        let mut other = sealed.clone();
        other.remove(SEAL);
        assert!(!holds(&KEY, &other));
        other.insert(SEAL.into(), "no hash".into());
        assert!(!holds(&KEY, &other));
    }

    #[test]
    fn text_that_moves_from_one_fact_to_the_next_breaks_the_seal() {
        let mut moved = facts();
        let (plant, hash) = (moved["plant_binary"].clone(), moved["plant_blake3"].clone());
        let (head, tail) = plant.split_at(4);
        moved.insert("plant_binary".into(), head.into());
        moved.insert("plant_blake3".into(), format!("{tail}{hash}"));
        assert!(!holds(&KEY, &moved));
    }

    #[test]
    fn a_key_is_created_once_and_readable_only_by_its_owner() {
        let place = tempfile::TempDir::new().expect("a folder");
        let path = place.path().join("state/hil/key");
        make(&path).expect("made");
        let key = read(&path).expect("it is there");
        make(&path).expect("it exists");
        assert_eq!(read(&path), Ok(key));
        fs::set_permissions(&path, fs::Permissions::from_mode(0o644)).expect("it is ours");
        assert!(read(&path).expect_err("open").contains("read by others"));
        fs::write(&path, [1; 3]).expect("it is ours");
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).expect("it is ours");
        assert!(
            read(&path)
                .expect_err("short")
                .contains("is not a valid key")
        );
    }
}
