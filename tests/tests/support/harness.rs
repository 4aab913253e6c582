//! Harness in which tests run `hil`: a [`Rig`] for each test.
//!
//! A rig has a session name, a group of sessions, a folder and a watchdog. Processes it starts see only the
//! sessions of its group: neither those of another test nor those of the user. After every `hil` it checks for
//! leftover processes, shared memory and folders. An expired watchdog fails the test; no test measures time.

use std::collections::BTreeSet;
use std::ffi::{OsStr, OsString};
use std::io::Read;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use hil_session::live::{LiveError, ask};
use hil_session::process::ProcessId;
use hil_session::session::{GROUP, SessionInfo};
use rustix::process::{Pid, Signal, kill_process, kill_process_group};
use shared_types::live::{Request, Response, Status};
use tempfile::TempDir;

use crate::support::leftovers::{left_before, segments_of_nobody};
use crate::support::programs::{program, words, workspace};
pub(crate) use crate::support::run::Run;
use crate::support::signals::set_default_signals;

/// Time limit of anything, after which it counts as hanging.
pub(crate) const WATCHDOG: Duration = Duration::from_secs(120);
/// Wait limit in seconds for a test in which it expires: the default, which a loaded machine meets.
pub(crate) const EXPIRES_S: f64 = 5.0;
/// Polling interval.
const LOOK: Duration = Duration::from_millis(2);

/// Environment of a test, which shares nothing with that of another.
pub(crate) struct Rig {
    folder: TempDir,
    session: String,
    runs: AtomicU32,
}

impl Rig {
    pub(crate) fn new() -> Self {
        left_before();
        set_default_signals();
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        Self {
            folder: TempDir::with_prefix("hil-test-").expect("a temporary folder"),
            session: format!("test-{}-{number}", std::process::id()),
            runs: AtomicU32::new(0),
        }
    }

    /// Returns a path in the test's folder.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a file to the test's folder.
    pub(crate) fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, text).expect("the test's folder can be written");
        path
    }

    /// Writes a scenario of a plant at 1 kHz under a law, without stimuli.
    pub(crate) fn scenario(&self, duration_s: f64, model: &str, law: &str) -> PathBuf {
        let text = format!(
            "schema = 1\nname = \"small\"\n[run]\nduration_s = {duration_s:?}\nrate_hz = 1000\n\
             [plant]\nmodel = \"{model}\"\n[controller]\nlaw = \"{law}\"\n"
        );
        self.write("scenario.toml", &text)
    }

    /// Writes an executable script.
    pub(crate) fn script(&self, name: &str, text: &str) -> PathBuf {
        let path = self.write(name, text);
        let mode = std::fs::Permissions::from_mode(0o755);
        std::fs::set_permissions(&path, mode).expect("own files can be made executable");
        path
    }

    pub(crate) fn session(&self) -> &str {
        &self.session
    }

    /// Starts the teaching run and waits until it is paused before step 2500.
    pub(crate) fn held(&self) -> Running<'_> {
        let running = self.start("scenarios/spring-mass.toml --pause-at 2.5 --wait-limit 60");
        self.until_held_at(2500);
        running
    }

    /// Queries the plant of this test's session, which may be just starting. Starts no process, unlike repeated
    /// calls of `hil`.
    pub(crate) fn ask(&self, request: &Request) -> Response {
        let mut answer = None;
        until("the plant takes requests", || {
            let Ok(session) = SessionInfo::read(&self.session_folder()) else {
                return false; // not created yet
            };
            match ask(&session, request, Duration::from_secs(60)) {
                Ok(response) => answer = Some(response),
                Err(LiveError::Absent(_)) => {}
                Err(error) => panic!("{error}"),
            }
            answer.is_some()
        });
        answer.expect("answered")
    }

    /// Returns the status of this test's run.
    pub(crate) fn status(&self) -> Status {
        match self.ask(&Request::Status) {
            Response::Status(status) => status,
            other => panic!("{other:?}"),
        }
    }

    /// Waits until this test's run is paused before a step.
    pub(crate) fn until_held_at(&self, step: u64) {
        until("the run is held", || {
            let status = self.status();
            status.paused && status.step == step
        });
    }

    /// Runs `hil run` with arguments separated by spaces, in this test's session and folder.
    pub(crate) fn run(&self, arguments: &str) -> Run {
        self.start(arguments).finish()
    }

    /// Starts the command of [`run`](Self::run) without waiting.
    pub(crate) fn start(&self, arguments: &str) -> Running<'_> {
        self.start_with(self.command(program("hil")), arguments)
    }

    /// Creates a command for a program, one of ours or one that starts ours: `hil` sees this test's sessions only,
    /// and no program from the environment. Nothing of a test is kept for the user.
    pub(crate) fn command(&self, program: impl AsRef<OsStr>) -> Command {
        let mut command = Command::new(program);
        command.current_dir(workspace());
        self.surround(&mut command);
        command
    }

    /// Sets the environment of a command, except for variables that it has already.
    fn surround(&self, command: &mut Command) {
        let (group, state) = (OsString::from(&self.session), self.path("state"));
        for (name, value) in [(GROUP, group), ("XDG_STATE_HOME", state.into())] {
            if command.get_envs().all(|(set, _)| set != name) {
                command.env(name, value);
            }
        }
        for name in ["HIL_PLANT_BIN", "HIL_CONTROLLER_BIN"] {
            if command.get_envs().all(|(set, _)| set != name) {
                command.env_remove(name);
            }
        }
        // A backtrace would push the message of a panic out of the excerpt.
        command.env_remove("RUST_BACKTRACE");
    }

    /// Starts the same with another `hil`, or one behind `taskset`.
    pub(crate) fn start_with(&self, hil: Command, arguments: &str) -> Running<'_> {
        let number = self.runs.fetch_add(1, Ordering::Relaxed);
        let folder = self.path(&format!("run{number}"));
        let mut hil = hil;
        hil.current_dir(workspace());
        hil.arg("run").args(words(arguments));
        hil.arg("--session").arg(&self.session);
        hil.arg("--out").arg(&folder);
        Running::start(self, hil, folder)
    }

    /// Runs any `hil` command, without this test's session and folder.
    pub(crate) fn hil(&self, arguments: &[&str]) -> Run {
        self.start_hil(arguments).finish()
    }

    /// Starts the command of [`hil`](Self::hil) without waiting.
    pub(crate) fn start_hil(&self, arguments: &[&str]) -> Running<'_> {
        let mut hil = self.command(program("hil"));
        hil.args(arguments);
        Running::start(self, hil, self.path("none"))
    }

    /// Runs any `hil` command in another working directory.
    pub(crate) fn hil_in(&self, folder: &Path, arguments: &[&str]) -> Run {
        let mut hil = self.command(program("hil"));
        hil.args(arguments).current_dir(folder);
        Running::start(self, hil, self.path("none")).finish()
    }

    /// Runs another program, under this test's watchdog.
    pub(crate) fn program(&self, command: Command) -> Run {
        Running::start(self, command, self.path("none")).finish_beside_another()
    }

    /// Runs any `hil` command during this test's run.
    pub(crate) fn beside(&self, arguments: &[&str]) -> Run {
        self.start_hil(arguments).finish_beside_another()
    }

    /// Runs a `hil` command, whose words are separated by spaces, on this test's session.
    pub(crate) fn in_session(&self, line: &str) -> Run {
        let session = ["--session", self.session()];
        let line = words(line);
        let words: Vec<&str> = line.iter().map(String::as_str).chain(session).collect();
        self.beside(&words)
    }

    /// Runs `hil rerun` of a recorded run, into the folder `again` of the test.
    pub(crate) fn rerun(&self, run: &Path, options: &[&str]) -> Run {
        let folder = self.path("again");
        let rerun = ["rerun", text(run), "--out", text(&folder)];
        let run = self.hil(&[&rerun, options].concat());
        Run { folder, ..run }
    }

    /// Returns the folder of all sessions of this test, which exists while there is one.
    pub(crate) fn sessions(&self) -> PathBuf {
        let uid = rustix::process::geteuid().as_raw();
        PathBuf::from(format!("/dev/shm/hil-{uid}-{}", self.session))
    }

    /// Returns the folder of the session, which exists while it runs.
    pub(crate) fn session_folder(&self) -> PathBuf {
        self.sessions().join(&self.session)
    }

    /// Fails if processes or shared memory of this test are left.
    pub(crate) fn assert_nothing_left(&self) {
        let processes = self.processes();
        assert_eq!(processes, [""; 0], "these processes are left");
        let folder = self.session_folder();
        assert!(!folder.exists(), "{} is left", folder.display());
        let segments = segments_of_nobody();
        let segments: Vec<_> = (segments.iter())
            .filter(|segment| !left_before().contains(segment))
            .collect();
        assert!(segments.is_empty(), "{segments:?} belong to no session");
    }

    /// Lists command lines of live processes that mention this test's session or folder.
    pub(crate) fn processes(&self) -> Vec<String> {
        let own_folder = self.folder.path().to_str().expect("plain text");
        let session = self.session_folder();
        let session = session.to_str().expect("plain text");
        let processes = std::fs::read_dir("/proc")
            .expect("/proc is there")
            .flatten();
        let mut entries = Vec::new();
        for process in processes {
            let Ok(line) = std::fs::read(process.path().join("cmdline")) else {
                continue; // not a process, or ended
            };
            let line = String::from_utf8_lossy(&line).replace('\0', " ");
            // Sessions are numbered: the name of one may be a prefix of another's.
            let of_session = |word: &str| {
                let rest = word.strip_prefix(session);
                rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
            };
            if line.contains(own_folder) || line.split(' ').any(of_session) {
                entries.push(line);
            }
        }
        entries
    }
}

impl Drop for Rig {
    /// Removes the remains of a killed `hil` of the test: no other process knows its group.
    fn drop(&mut self) {
        if self.sessions().exists() {
            let clean = self
                .command(program("hil"))
                .args(["sessions", "--clean"])
                .output();
            let is_clean = clean.is_ok_and(|clean| clean.status.success());
            assert!(is_clean || std::thread::panicking(), "sessions are left");
        }
    }
}

/// Running `hil`. Dropped before its end, it is killed with all its descendants.
pub(crate) struct Running<'r> {
    rig: &'r Rig,
    process: Child,
    output: Vec<JoinHandle<String>>,
    folder: PathBuf,
    ended: bool,
}

impl<'r> Running<'r> {
    fn start(rig: &'r Rig, mut hil: Command, folder: PathBuf) -> Self {
        hil.stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            // In its own process group, which receives signals like that of a terminal.
            .process_group(0);
        rig.surround(&mut hil);
        println!("{:?}", hil.get_args()); // shown if the test fails
        let mut process = hil
            .spawn()
            .unwrap_or_else(|error| panic!("{hil:?}: {error}"));
        let stdout = process.stdout.take().expect("piped");
        let stderr = process.stderr.take().expect("piped");
        Self {
            rig,
            process,
            output: vec![collect(stdout), collect(stderr)],
            folder,
            ended: false,
        }
    }

    /// Waits for the end and checks that nothing is left behind.
    pub(crate) fn finish(self) -> Run {
        let rig = self.rig;
        self.end(|| rig.assert_nothing_left())
    }

    /// Waits for the end like [`finish`](Self::finish), ten times as long.
    pub(crate) fn finish_late(mut self) -> Run {
        let since = Instant::now();
        while since.elapsed() < 9 * WATCHDOG && matches!(self.process.try_wait(), Ok(None)) {
            std::thread::sleep(10 * LOOK);
        }
        self.finish()
    }

    /// Waits for the end while another run of the same session continues.
    pub(crate) fn finish_beside_another(self) -> Run {
        self.end(|| ())
    }

    fn end(mut self, check: impl FnOnce()) -> Run {
        let status = ended(&mut self.process);
        self.ended = true;
        // Checked before its output is read to the end: a leftover process may hold it open.
        check();
        let mut output = self.output.drain(..).map(|text| text.join().expect("read"));
        Run {
            code: status.code(),
            stdout: output.next().expect("stdout"),
            stderr: output.next().expect("stderr"),
            folder: std::mem::take(&mut self.folder),
        }
    }

    /// Waits until steps are being exchanged and some of them are stored in closed chunks.
    pub(crate) fn wait_for_records(&self) {
        let recording = self.folder.join("run.mcap");
        until("the recording grows", || {
            std::fs::metadata(&recording).is_ok_and(|data| data.len() > 3 << 20)
        });
    }

    /// Waits until steps are being exchanged, and returns plant and controller.
    pub(crate) fn children(&self) -> [ProcessId; 2] {
        self.wait_for_records();
        let info = SessionInfo::read(&self.rig.session_folder()).expect("the session is there");
        info.children.try_into().expect("two children")
    }

    /// Waits until both sides have started and the plant accepts requests, and returns plant and controller.
    pub(crate) fn children_at_once(&self) -> [ProcessId; 2] {
        let folder = self.rig.session_folder();
        let mut children = None;
        until("both sides are there", || {
            let info = SessionInfo::read(&folder).ok();
            children = info.and_then(|info| info.children.try_into().ok());
            children.is_some() && folder.join("layout.json").exists()
        });
        children.expect("both are there")
    }

    /// Returns the run folder, or that of all runs.
    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Returns the process ID.
    pub(crate) fn pid(&self) -> u32 {
        self.process.id()
    }

    /// Returns the ID of the working process: that of a guard's child, once it exists.
    pub(crate) fn worker(&self) -> u32 {
        let own = self.process.id();
        let children = std::fs::read_to_string(format!("/proc/{own}/task/{own}/children"));
        let children = children.unwrap_or_default();
        // A program being described is not a guard's child.
        let is_hil = |process: &u32| {
            let name = std::fs::read_to_string(format!("/proc/{process}/comm"));
            name.is_ok_and(|name| name == "hil\n")
        };
        let mut children = (children.split(' ')).filter_map(|word| word.parse().ok());
        let child = children.find(is_hil);
        child.unwrap_or(own)
    }

    /// Sends a signal to the process group of `hil`, as a terminal does.
    pub(crate) fn signal(&self, signal: Signal) {
        kill_process_group(process_id(self.process.id()), signal).expect("`hil` is there");
    }

    /// Kills `hil`, with no chance to clean up.
    pub(crate) fn kill(mut self) {
        self.process.kill().expect("hil is our child");
        self.process.wait().expect("hil is our child");
        self.ended = true;
    }
}

impl Drop for Running<'_> {
    fn drop(&mut self) {
        if self.ended {
            return;
        }
        let info = SessionInfo::read(&self.rig.session_folder());
        let _ = self.process.kill(); // it may have ended by itself
        let _ = self.process.wait();
        for child in info.iter().flat_map(|info| &info.children) {
            child.kill();
        }
    }
}

/// Sends a signal to a process.
pub(crate) fn send(pid: u32, signal: Signal) {
    kill_process(process_id(pid), signal).expect("the process is there");
}

fn process_id(pid: u32) -> Pid {
    let pid = i32::try_from(pid).ok().and_then(Pid::from_raw);
    pid.expect("a process number")
}

/// Reads a path as text, for a command line.
pub(crate) fn text(path: &Path) -> &str {
    path.to_str().expect("plain text")
}

/// Lists the names of a folder's entries.
pub(crate) fn names(folder: &Path) -> BTreeSet<String> {
    let entries = std::fs::read_dir(folder).expect("a folder").flatten();
    let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
    names.collect()
}

/// Waits for a condition that must occur; the watchdog fails the test otherwise.
#[track_caller]
pub(crate) fn until(what: &str, mut happened: impl FnMut() -> bool) {
    let since = Instant::now();
    while !happened() {
        assert!(
            since.elapsed() < WATCHDOG,
            "watchdog: {what}: not within {WATCHDOG:?}"
        );
        std::thread::sleep(LOOK);
    }
}

/// Waits until processes have ended by themselves.
pub(crate) fn until_gone(processes: &[ProcessId]) {
    until("all processes end by themselves", || {
        processes.iter().all(|process| !process.is_alive())
    });
}

/// Waits for the end of a process.
#[track_caller]
pub(crate) fn ended(process: &mut Child) -> ExitStatus {
    let mut status = None;
    until("the process ends", || {
        status = process.try_wait().expect("it is our child");
        status.is_some()
    });
    status.expect("it ended")
}

fn collect(mut pipe: impl Read + Send + 'static) -> JoinHandle<String> {
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        pipe.read_to_end(&mut bytes).expect("a pipe can be read");
        String::from_utf8_lossy(&bytes).into_owned()
    })
}
