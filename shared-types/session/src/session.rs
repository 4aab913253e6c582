//! Sessions: names, the private folder, and complete clean-up.
//!
//! `hil` owns a session; the processes of a run share it. All files of a session are in shared memory under two names,
//! its folder and a file prefix, so that the next `hil` can remove all of them. The owner holds a lock that the kernel
//! releases with the process; a session whose lock is free is dead, and the next `hil` sweeps it away.

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

/// Maximum length of a session or group name: the paths of sockets below the folder must stay under 108 bytes.
const LONGEST_NAME: usize = 24;

/// Name, paths and processes of a session; the content of its `session.json`.
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
    /// Process that owns the session.
    pub owner: ProcessId,
    /// Guard process; the owner ends when the guard dies.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub guard: Option<ProcessId>,
    /// Processes started by the owner.
    pub children: Vec<ProcessId>,
    /// Controller that the owner started last.
    #[serde(default)]
    pub controller: Option<Launched>,
    /// Output folder of the session's run, if it writes one.
    pub run_dir: Option<PathBuf>,
}

/// Controller that was started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Launched {
    /// Number of the controller in the session, from 1.
    pub epoch: u32,
    /// Process of the controller.
    pub process: ProcessId,
}

/// Failure to create, find or remove a session.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// Invalid session name.
    #[error("`{0}` is not a session name: 1 to 24 of a-z, 0-9 and -")]
    Name(String),
    /// Invalid name of a session group.
    #[error(
        "`{0}` in HIL_SESSION_GROUP is not the name of a session group: 1 to 24 of a-z, 0-9 and -"
    )]
    Group(String),
    /// Name of a live session.
    #[error(
        "session `{name}` is running (process {pid}); choose another --session, or see `hil sessions`"
    )]
    Taken {
        /// The name.
        name: String,
        /// Process number of the owner.
        pid: u32,
    },
    /// Unknown session.
    #[error("no session `{0}`; see `hil sessions`")]
    Unknown(String),
    /// Folder of all sessions that belongs to another user or is open to others.
    #[error("{0} is not your private folder; remove it or have it removed")]
    NotPrivate(PathBuf),
    /// Lock over all sessions that another `hil` holds for too long.
    #[error(
        "{0} has been locked for more than 10 s; if a stopped `hil` holds the lock, resume or end it"
    )]
    Locked(PathBuf),
    /// Refusal by the operating system.
    #[error("cannot {action} {}: {error}", path.display())]
    Io {
        /// Attempted action.
        action: &'static str,
        /// File concerned.
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
    /// If the file is missing or belongs to another folder.
    pub fn read(folder: &Path) -> Result<Self, SessionError> {
        let path = folder.join("session.json");
        let info: Self = read_json(&path)?;
        // These two fields select the files that a sweep removes: a torn or foreign file must not decide that.
        if is_prefix(&info.prefix) && is_same(&info.folder, folder) {
            Ok(info)
        } else {
            let error = io::Error::new(ErrorKind::InvalidData, "it belongs to another folder");
            Err(SessionError::io("use", &path)(error))
        }
    }

    /// Reads a JSON file of the session.
    ///
    /// # Errors
    /// If the file is missing or malformed.
    pub fn read_file<T: DeserializeOwned>(&self, name: &str) -> Result<T, SessionError> {
        read_json(&self.folder.join(name))
    }

    /// Writes a JSON file of the session; it appears atomically.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_file<T: Serialize>(&self, name: &str, content: &T) -> Result<(), SessionError> {
        let path = self.folder.join(name);
        let part = self.folder.join(format!("{name}.part"));
        let bytes = serde_json::to_vec_pretty(content)
            .map_err(|e| SessionError::io("write", &path)(e.into()))?;
        let mut file = private_file(&part).map_err(SessionError::io("create", &part))?;
        io::Write::write_all(&mut file, &bytes).map_err(SessionError::io("write", &part))?;
        fs::rename(&part, &path).map_err(SessionError::io("write", &path))
    }

    /// Returns the iceoryx2 configuration that isolates a session from everything else on the machine.
    ///
    /// # Errors
    /// If iceoryx2 rejects the names.
    pub fn iceoryx_config(&self) -> Result<Config, String> {
        // Not the global configuration, which reads files of the user and the machine.
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

    /// Lists the session's files in shared memory outside its folder. Files of other users with such a name are left
    /// out.
    #[must_use]
    pub fn segments(&self) -> Vec<PathBuf> {
        segments_of(&self.prefix)
    }

    /// Removes empty segments once the sides are dead: a side that dies before setting a segment's size leaves it
    /// empty, and iceoryx2 0.10 would wait for the size without a limit when opening the service.
    pub fn remove_unfinished(&self) {
        for path in self.segments() {
            if fs::symlink_metadata(&path)
                .is_ok_and(|metadata| metadata.is_file() && metadata.len() == 0)
            {
                let _ = fs::remove_file(&path); // it may be gone by now
            }
        }
    }

    /// Removes other users' access to files and folders of the session; iceoryx2 leaves some of them accessible.
    ///
    /// No other mode may be changed: iceoryx2 marks a file under construction with mode 0200, and a process that opens
    /// the file too early would read missing data.
    pub fn tighten(&self) {
        for path in self.open_to_others() {
            // The file may have been removed meanwhile.
            let _ = fs::symlink_metadata(&path).and_then(|metadata| {
                let mode = if metadata.is_dir() { 0o700 } else { 0o600 };
                fs::set_permissions(&path, Permissions::from_mode(mode))
            });
        }
    }

    /// Lists files and folders of the session that other users may read, write or enter.
    #[must_use]
    pub fn open_to_others(&self) -> Vec<PathBuf> {
        let mut open = Vec::new();
        let mut paths = self.segments();
        paths.push(self.folder.clone());
        while let Some(path) = paths.pop() {
            // The file may have been removed meanwhile.
            let Ok(metadata) = fs::symlink_metadata(&path) else {
                continue;
            };
            if metadata.is_dir() {
                let inside = fs::read_dir(&path).into_iter().flatten().flatten();
                paths.extend(inside.map(|entry| entry.path()));
            }
            if metadata.mode() & 0o077 != 0 {
                open.push(path);
            }
        }
        open
    }

    /// Returns `true` if the session has not ended: its folder is unchanged and its owner alive. Takes no lock, so
    /// frequent polling disturbs nobody.
    #[must_use]
    pub fn is_there(&self) -> bool {
        self.has_folder() && self.owner.is_alive()
    }

    fn has_folder(&self) -> bool {
        Self::read(&self.folder).is_ok_and(|info| info.id == self.id)
    }

    /// Removes files that an observer left after the owner removed everything.
    pub fn clear_after(&self) {
        if !self.has_folder() {
            for segment in self.segments() {
                let _ = fs::remove_file(segment); // whoever else removes it does as well
            }
        }
        let _ = sweep(); // what cannot be removed now the next one tries again
    }

    fn remove(&self) -> Result<(), SessionError> {
        // The folder last: while it exists, the next sweep knows the prefix.
        remove_below(&self.prefix)?;
        remove_folder(&self.folder)
    }
}

/// Returns `true` if the session's lock is held or cannot be checked: a session that may still be alive is left alone.
fn is_live(folder: &Path) -> bool {
    match open_at_once(&folder.join("lock")) {
        Ok(lock) => flock(&lock, FlockOperation::NonBlockingLockExclusive).is_err(),
        Err(error) => error.kind() != ErrorKind::NotFound,
    }
}

fn remove_folder(folder: &Path) -> Result<(), SessionError> {
    unless_gone(fs::remove_dir_all(folder)).map_err(SessionError::io("remove", folder))
}

/// Returns `true` if two paths lead to the same folder.
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

/// Session owned by this process. Dropping the value removes the whole session.
#[derive(Debug)]
pub struct Session {
    info: SessionInfo,
    /// `true` if processes share memory in the session.
    is_shared: bool,
    // Held, never read: the kernel releases it with the process.
    _lock: File,
}

impl Session {
    /// Creates a session, after sweeping away dead ones. An unnamed session gets a random name.
    ///
    /// # Errors
    /// If the name is taken or invalid, or shared memory cannot be used.
    pub fn create(name: Option<&str>) -> Result<Self, SessionError> {
        Self::new(name, true)
    }

    /// Creates a session for this process alone: a folder without links, in which no process may be started.
    ///
    /// # Errors
    /// If the name is taken or invalid, or the folder cannot be created.
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
        let result = info.make().and_then(|lock| {
            if is_shared {
                info.make_links()?;
            }
            Ok(lock)
        });
        match result {
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

    /// Returns the session's name, paths and processes.
    #[must_use]
    pub const fn info(&self) -> &SessionInfo {
        &self.info
    }

    /// Records the output folder of the run.
    ///
    /// # Errors
    /// If `session.json` cannot be written.
    pub fn set_run_dir(&mut self, run_dir: &Path) -> Result<(), SessionError> {
        self.info.run_dir = Some(run_dir.to_owned());
        self.info.write_file("session.json", &self.info)
    }

    /// Records a started process, so that a sweep can end it.
    ///
    /// # Errors
    /// If `session.json` cannot be written.
    pub fn add_child(&mut self, pid: u32) -> Result<(), SessionError> {
        debug_assert!(self.is_shared, "a session of one process has no others");
        self.info.children.extend(ProcessId::of(pid));
        self.info.write_file("session.json", &self.info)
    }

    /// Records the controller of an epoch, the only process accepted as such.
    ///
    /// # Errors
    /// If `session.json` cannot be written.
    pub fn add_controller(&mut self, epoch: u32, pid: u32) -> Result<(), SessionError> {
        // Recorded even if it has already ended: otherwise it would be awaited.
        let process = ProcessId::of(pid).unwrap_or(ProcessId {
            pid,
            start_ticks: 0,
        });
        self.info.controller = Some(Launched { epoch, process });
        self.add_child(pid)
    }
}

impl SessionInfo {
    /// Fills the new folder, beginning with the lock, so that no sweep takes the folder for dead.
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

    /// Creates the files that iceoryx2 needs, after `session.json`, from which a sweep learns of them.
    fn make_links(&self) -> Result<(), SessionError> {
        let root = self.folder.join("i");
        private_folder(&root).map_err(SessionError::io("create", &root))?;
        let counter = self.node_counter();
        (self.make_node_counter()).map_err(SessionError::io("create", &counter))?;
        // Creating the first node proves that iceoryx2 accepts that file.
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
        // There is no one to report a failure to; the next sweep retries.
        let _ = if self.is_shared {
            self.info.remove()
        } else {
            remove_folder(&self.info.folder)
        };
        // Left by a crashed side.
        crate::private_folder::sweep();
        drop(AllSessions::lock());
    }
}

/// Returns `true` if the text is a valid name of a session or a group of sessions.
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
