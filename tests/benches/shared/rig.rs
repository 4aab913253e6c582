//! A run of `hil` in the background, and what may be left of one.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use hil_session::process::ProcessId;
use hil_session::session::SessionInfo;

/// Time limit of anything, after which it counts as hanging.
const WATCHDOG: Duration = Duration::from_secs(30);

/// A scenario that is small and as long as it is wanted to be.
pub(crate) fn scenario(folder: &Path, rate_hz: u32, duration_s: f64) -> PathBuf {
    let path = folder.join(format!("small-{rate_hz}-{duration_s}.toml"));
    let text = format!(
        "schema = 1\nname = \"small\"\n[run]\nduration_s = {duration_s:?}\nrate_hz = {rate_hz}\n\
         [plant]\nmodel = \"spring-mass\"\n[controller]\nlaw = \"pid\"\n\
         [[stimuli]]\ntarget = \"position_m\"\nkind = \"sine\"\namplitude = 0.01\nfrequency_hz = 0.5\n"
    );
    std::fs::write(&path, text).expect("the folder can be written");
    path
}

/// Waits for something; false if it does not come.
pub(crate) fn comes(mut has_come: impl FnMut() -> bool) -> bool {
    let since = Instant::now();
    while !has_come() {
        if since.elapsed() > WATCHDOG {
            return false;
        }
        std::thread::sleep(Duration::from_micros(200));
    }
    true
}

/// Returns the folder of a session of this user.
pub(crate) fn session_folder(name: &str) -> PathBuf {
    let uid = rustix::process::geteuid().as_raw();
    PathBuf::from(format!("/dev/shm/hil-{uid}")).join(name)
}

/// A `hil run` at work.
pub(crate) struct Running {
    pub(crate) hil: Child,
    pub(crate) session: String,
    pub(crate) folder: PathBuf,
}

impl Running {
    /// Starts one in a session and a folder of its own.
    pub(crate) fn start(hil: &Path, folder: PathBuf, session: String, arguments: &[&str]) -> Self {
        let hil = Command::new(hil)
            .arg("run")
            .args(arguments)
            .args(["--session", &session, "--out"])
            .arg(&folder)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("hil");
        Self {
            hil,
            session,
            folder,
        }
    }

    /// Plant and controller, once both were started; `None` if that never happens.
    pub(crate) fn children(&self) -> Option<[ProcessId; 2]> {
        let mut children = None;
        comes(|| {
            let info = SessionInfo::read(&session_folder(&self.session));
            children = info.ok().and_then(|info| info.children.try_into().ok());
            children.is_some()
        });
        children
    }

    /// Returns the number of the process that runs the session, which has a guard.
    pub(crate) fn owner(&self) -> u32 {
        let info = SessionInfo::read(&session_folder(&self.session));
        info.map_or_else(|_| self.hil.id(), |info| info.owner.pid)
    }

    /// Waits for the end of `hil`; returns true if it came in time.
    pub(crate) fn ends(&mut self) -> bool {
        comes(|| matches!(self.hil.try_wait(), Ok(Some(_))))
    }
}

/// Lists what is left of sessions whose names begin so, after the next command of `hil`.
pub(crate) fn left(hil: &Path, prefix: &str) -> Vec<String> {
    let swept = Command::new(hil).arg("sessions").output();
    assert!(swept.expect("hil").status.success());
    let names = |folder: &Path| {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
        names.collect::<Vec<String>>()
    };
    // In this order: a session removes its folder last. Others may run.
    let segments = names(Path::new("/dev/shm"));
    let sessions = names(&session_folder(""));
    let infos = sessions
        .iter()
        .map(|name| SessionInfo::read(&session_folder(name)));
    let prefixes: Vec<String> = infos.flatten().map(|info| info.prefix).collect();
    let mut left: Vec<String> = (sessions.into_iter())
        .filter(|name| name.starts_with(prefix))
        .collect();
    left.extend(segments.into_iter().filter(|name| {
        let claimed = prefixes.iter().any(|prefix| name.starts_with(prefix));
        name.starts_with("hil_") && !claimed && Path::new("/dev/shm").join(name).exists()
    }));
    for process in std::fs::read_dir("/proc").expect("/proc").flatten() {
        let line = std::fs::read(process.path().join("cmdline")).unwrap_or_default();
        let line = String::from_utf8_lossy(&line).replace('\0', " ");
        if line.contains(prefix) {
            left.push(line);
        }
    }
    left
}
