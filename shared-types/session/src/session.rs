//! Sessions: names, the private folder, and complete clean-up.
//!
//! `hil` owns a session and the processes of a run share it. Everything of a session lives in
//! shared memory under two names, its folder and a file prefix, so that whoever comes next can
//! remove all of it. The owner holds a lock that the kernel drops with the process; a session whose
//! lock is free is dead, and the next `hil` sweeps it away.

use std::fs::{self, DirBuilder, File, Permissions};
use std::io::{self, ErrorKind};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use iceoryx2::prelude::{Config, FileName, Path as IceoryxPath, SemanticString};
use rustix::fs::{FlockOperation, flock};
use serde::{Deserialize, Serialize, de::DeserializeOwned};

use crate::private_folder::{open_at_once, private_file};
use crate::process::ProcessId;
use crate::shared_memory::FOLDER as SHARED_MEMORY;
use all::AllSessions;
pub use all::{GROUP, abandon, dead, list, peek, sweep};
use prefix::{is_prefix, noted_prefix, remove_below, segments_of};

mod all;
mod counter;
pub mod guard;
mod node;
mod prefix;

/// Longest name of a session or a group: the paths of sockets below the folder must stay under 108 bytes.
const LONGEST_NAME: usize = 24;

/// Name of a session, its places and its processes; the content of its `session.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SessionInfo {
    /// Version of this file.
    pub schema: u32,
    /// Name of the session.
    pub name: String,
    /// Random number that every frame carries.
    pub id: u64,
    /// Private folder of the session.
    pub folder: PathBuf,
    /// Prefix of its files in shared memory.
    pub prefix: String,
    /// The process that owns it.
    pub owner: ProcessId,
    /// Process whose death the owner does not survive.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub guard: Option<ProcessId>,
    /// The processes that it started.
    pub children: Vec<ProcessId>,
    /// The controller that it started last.
    #[serde(default)]
    pub controller: Option<Launched>,
    /// Folder in which the session's run is written, if it is.
    pub run_dir: Option<PathBuf>,
}

/// A controller that was started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Launched {
    /// Number of the controller in the session, from 1.
    pub epoch: u32,
    /// Process of the controller.
    pub process: ProcessId,
}

/// A session cannot be created, found or removed.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The name is not one.
    #[error("`{0}` is no session name: 1 to 24 of a-z, 0-9 and -")]
    Name(String),
    /// The name of the group of sessions is none.
    #[error(
        "`{0}` in HIL_SESSION_GROUP is no name of a group of sessions: 1 to 24 of a-z, 0-9 and -"
    )]
    Group(String),
    /// A live session has that name.
    #[error(
        "session `{name}` is running (process {pid}); choose another --session, or see `hil sessions`"
    )]
    Taken {
        /// The name.
        name: String,
        /// Process number of the owner.
        pid: u32,
    },
    /// There is no such session.
    #[error("no session `{0}`; see `hil sessions`")]
    Unknown(String),
    /// The folder of all sessions belongs to someone else or is open to others.
    #[error("{0} is not a folder of yours alone; remove it or have it removed")]
    NotPrivate(PathBuf),
    /// Another `hil` holds the lock over all sessions for too long.
    #[error("{0} is locked for more than 10 s; is a stopped `hil` holding it?")]
    Locked(PathBuf),
    /// The operating system refused.
    #[error("cannot {action} {}: {error}", path.display())]
    Io {
        /// Action that was tried.
        action: &'static str,
        /// File on which it was tried.
        path: PathBuf,
        /// Error of the operating system.
        error: io::Error,
    },
}

impl SessionError {
    fn io(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |error| Self::Io {
            action,
            path,
            error,
        }
    }
}

impl SessionInfo {
    /// Reads the `session.json` of a session's folder.
    ///
    /// # Errors
    /// If it is missing or not one of this folder.
    pub fn read(folder: &Path) -> Result<Self, SessionError> {
        let path = folder.join("session.json");
        let info: Self = read_json(&path)?;
        // What is swept away goes by these two: a torn or foreign file must not decide it.
        if is_prefix(&info.prefix) && is_same(&info.folder, folder) {
            Ok(info)
        } else {
            let error = io::Error::new(ErrorKind::InvalidData, "it is not of this folder");
            Err(SessionError::io("use", &path)(error))
        }
    }

    /// Reads a JSON file of the session.
    ///
    /// # Errors
    /// If it is missing or not of that form.
    pub fn read_file<T: DeserializeOwned>(&self, name: &str) -> Result<T, SessionError> {
        read_json(&self.folder.join(name))
    }

    /// Writes a JSON file of the session, at once as seen by readers.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write_file<T: Serialize>(&self, name: &str, content: &T) -> Result<(), SessionError> {
        let path = self.folder.join(name);
        let part = self.folder.join(format!("{name}.part"));
        let bytes = serde_json::to_vec_pretty(content)
            .map_err(|e| SessionError::io("write", &path)(e.into()))?;
        let mut file = private_file(&part).map_err(SessionError::io("create", &part))?;
        io::Write::write_all(&mut file, &bytes).map_err(SessionError::io("write", &part))?;
        fs::rename(&part, &path).map_err(SessionError::io("write", &path))
    }

    /// The iceoryx2 configuration that keeps a session apart from everything else on the machine.
    ///
    /// # Errors
    /// If the names do not suit iceoryx2.
    pub fn iceoryx_config(&self) -> Result<Config, String> {
        // Not the global configuration: that reads files of the user and the machine.
        let mut config = Config::default();
        let prefix = FileName::new(self.prefix.as_bytes());
        config.global.prefix = prefix.map_err(|e| format!("{e:?}"))?;
        let root = self.folder.join("i");
        let root = IceoryxPath::new(root.as_os_str().as_encoded_bytes());
        config
            .global
            .set_root_path(&root.map_err(|e| format!("{e:?}"))?);
        Ok(config)
    }

    /// The session's files in shared memory, beside its folder. Others may make files with such a name
    /// there; those are theirs.
    #[must_use]
    pub fn segments(&self) -> Vec<PathBuf> {
        segments_of(&self.prefix)
    }

    /// Removes segments without content, once the sides are dead: whoever made one died before it had a
    /// size, and iceoryx2 0.10 waits for that size without a limit when it opens the service.
    pub fn remove_unfinished(&self) {
        for path in self.segments() {
            if fs::symlink_metadata(&path).is_ok_and(|found| found.is_file() && found.len() == 0) {
                let _ = fs::remove_file(&path); // it may be gone by now
            }
        }
    }

    /// Closes the files and folders of the session that are open to other users; iceoryx2 leaves
    /// some so.
    ///
    /// Nothing else may be touched: by the mode 0200 iceoryx2 tells that it still fills a file,
    /// and whoever opens it then reads what is not there yet.
    pub fn tighten(&self) {
        for path in self.open_to_others() {
            // It may be gone again by now.
            let _ = fs::symlink_metadata(&path).and_then(|found| {
                let mode = if found.is_dir() { 0o700 } else { 0o600 };
                fs::set_permissions(&path, Permissions::from_mode(mode))
            });
        }
    }

    /// Files and folders of the session that other users may read, write or look into.
    #[must_use]
    pub fn open_to_others(&self) -> Vec<PathBuf> {
        let mut open = Vec::new();
        let mut left = self.segments();
        left.push(self.folder.clone());
        while let Some(path) = left.pop() {
            // It may be gone again by now.
            let Ok(found) = fs::symlink_metadata(&path) else {
                continue;
            };
            if found.is_dir() {
                let inside = fs::read_dir(&path).into_iter().flatten().flatten();
                left.extend(inside.map(|entry| entry.path()));
            }
            if found.mode() & 0o077 != 0 {
                open.push(path);
            }
        }
        open
    }

    /// Checks whether the session has not ended: its folder is still its own and its owner lives. Takes no
    /// lock, so that one who looks again and again is in nobody's way.
    #[must_use]
    pub fn is_there(&self) -> bool {
        self.has_folder() && self.owner.is_alive()
    }

    fn has_folder(&self) -> bool {
        Self::read(&self.folder).is_ok_and(|found| found.id == self.id)
    }

    /// Removes what one who watched left after the owner had removed everything.
    pub fn clear_after(&self) {
        if !self.has_folder() {
            for segment in self.segments() {
                let _ = fs::remove_file(segment); // whoever else removes it does as well
            }
        }
        let _ = sweep(); // what cannot be removed now the next one tries again
    }

    fn remove(&self) -> Result<(), SessionError> {
        // The folder last: as long as it stands, the next sweep knows the prefix.
        remove_below(&self.prefix)?;
        remove_folder(&self.folder)
    }
}

/// Checks whether someone holds the session's lock, or nobody can tell: a session that is not known to be
/// dead is left alone.
fn is_live(folder: &Path) -> bool {
    match open_at_once(&folder.join("lock")) {
        Ok(lock) => flock(&lock, FlockOperation::NonBlockingLockExclusive).is_err(),
        Err(error) => error.kind() != ErrorKind::NotFound,
    }
}

fn remove_folder(folder: &Path) -> Result<(), SessionError> {
    unless_gone(fs::remove_dir_all(folder)).map_err(SessionError::io("remove", folder))
}

/// Checks whether two paths lead to one folder.
fn is_same(one: &Path, other: &Path) -> bool {
    match (fs::metadata(one), fs::metadata(other)) {
        (Ok(one), Ok(other)) => (one.dev(), one.ino()) == (other.dev(), other.ino()),
        _ => false,
    }
}

fn unless_gone(result: io::Result<()>) -> io::Result<()> {
    match result {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
        other => other,
    }
}

fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, SessionError> {
    let file = open_at_once(path).map_err(SessionError::io("open", path))?;
    let text = io::read_to_string(file).map_err(SessionError::io("read", path))?;
    serde_json::from_str(&text).map_err(|e| SessionError::io("read", path)(e.into()))
}

fn private_folder(path: &Path) -> io::Result<()> {
    DirBuilder::new().mode(0o700).create(path)
}

/// A session that this process owns. Dropping it removes all of it.
#[derive(Debug)]
pub struct Session {
    info: SessionInfo,
    /// True if processes share memory in it.
    is_shared: bool,
    // Held, never read: the kernel releases it with the process.
    _lock: File,
}

impl Session {
    /// Creates a session, after sweeping away dead ones. Without a name it gets a random one.
    ///
    /// # Errors
    /// If the name is taken or unusable, or shared memory cannot be used.
    pub fn create(name: Option<&str>) -> Result<Self, SessionError> {
        Self::new(name, true)
    }

    /// Creates a session of this process alone: a folder without links, in which no process may be
    /// started.
    ///
    /// # Errors
    /// If the name is taken or unusable, or the folder cannot be made.
    pub fn of_one_process(name: Option<&str>) -> Result<Self, SessionError> {
        Self::new(name, false)
    }

    fn new(name: Option<&str>, is_shared: bool) -> Result<Self, SessionError> {
        let id = random_number();
        let name = name.map_or_else(|| format!("s{:08x}", id >> 32), str::to_owned);
        if !is_name(&name) {
            return Err(SessionError::Name(name));
        }
        let all = AllSessions::lock()?;
        all.sweep()?;
        let folder = all.folder.join(&name);
        match private_folder(&folder) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {
                let pid = SessionInfo::read(&folder).map_or(0, |info| info.owner.pid);
                return Err(SessionError::Taken { name, pid });
            }
            other => other.map_err(SessionError::io("create", &folder))?,
        }
        let info = SessionInfo {
            schema: 1,
            name,
            id,
            prefix: format!("hil_{:08x}_", id as u32),
            owner: ProcessId::own(),
            guard: guard::own(),
            children: Vec::new(),
            controller: None,
            run_dir: None,
            folder,
        };
        let made = info.make().and_then(|lock| {
            if is_shared {
                info.make_links()?;
            }
            Ok(lock)
        });
        match made {
            Ok(lock) => Ok(Self {
                info,
                is_shared,
                _lock: lock,
            }),
            Err(error) => {
                let _ = info.remove(); // the first error tells more
                Err(error)
            }
        }
    }

    /// Returns the name of the session, its places and its processes.
    #[must_use]
    pub const fn info(&self) -> &SessionInfo {
        &self.info
    }

    /// Notes where the run is written.
    ///
    /// # Errors
    /// If `session.json` cannot be written.
    pub fn set_run_dir(&mut self, run_dir: &Path) -> Result<(), SessionError> {
        self.info.run_dir = Some(run_dir.to_owned());
        self.info.write_file("session.json", &self.info)
    }

    /// Notes a process that was started, so that a sweep can end it.
    ///
    /// # Errors
    /// If `session.json` cannot be written.
    pub fn add_child(&mut self, pid: u32) -> Result<(), SessionError> {
        debug_assert!(self.is_shared, "a session of one process has no others");
        self.info.children.extend(ProcessId::of(pid));
        self.info.write_file("session.json", &self.info)
    }

    /// Notes the controller of an epoch, which alone may speak as such.
    ///
    /// # Errors
    /// If `session.json` cannot be written.
    pub fn add_controller(&mut self, epoch: u32, pid: u32) -> Result<(), SessionError> {
        // One that ended at once is named all the same: else it would be awaited.
        let process = ProcessId::of(pid).unwrap_or(ProcessId {
            pid,
            start_ticks: 0,
        });
        self.info.controller = Some(Launched { epoch, process });
        self.add_child(pid)
    }
}

impl SessionInfo {
    /// Fills the new folder; the lock goes first, so that no sweep takes it for dead.
    fn make(&self) -> Result<File, SessionError> {
        let path = self.folder.join("lock");
        let lock = private_file(&path).map_err(SessionError::io("create", &path))?;
        flock(&lock, FlockOperation::NonBlockingLockExclusive)
            .map_err(|e| SessionError::io("lock", &path)(e.into()))?;
        self.note_prefix(&lock)
            .map_err(SessionError::io("write", &path))?;
        self.write_file("session.json", self)?;
        Ok(lock)
    }

    /// Makes what iceoryx2 needs; after `session.json`, which tells a sweep of it.
    fn make_links(&self) -> Result<(), SessionError> {
        let root = self.folder.join("i");
        private_folder(&root).map_err(SessionError::io("create", &root))?;
        let counter = self.node_counter();
        (self.make_node_counter()).map_err(SessionError::io("create", &counter))?;
        // The first node shows that iceoryx2 takes that file for its own.
        self.node("session").map_err(|reason| SessionError::Io {
            action: "use shared memory below",
            path: root,
            error: io::Error::other(format!("shared memory: {reason}")),
        })?;
        (self.check_node_counter()).map_err(SessionError::io("use", &counter))
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        // Nobody is left to tell; the next sweep tries again.
        let _ = if self.is_shared {
            self.info.remove()
        } else {
            remove_folder(&self.info.folder)
        };
        // Of a side that crashed.
        crate::private_folder::sweep();
        drop(AllSessions::lock());
    }
}

/// Returns `true` if a session, or a group of sessions, may have that name.
fn is_name(name: &str) -> bool {
    let legal = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    (1..=LONGEST_NAME).contains(&name.len()) && name.chars().all(legal)
}

fn random_number() -> u64 {
    use std::hash::{BuildHasher, RandomState};
    RandomState::new().hash_one(std::process::id())
}

#[cfg(test)]
mod tests;
