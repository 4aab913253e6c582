//! Strangers to a session get no access: confused processes of the same user, other users, and nonsense on every
//! interface. A run under all these attempts has the digest of an undisturbed one.

use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use hil_session::link::iceoryx::IceoryxLink;
use hil_session::link::service::{Ipc, node};
use hil_session::session::SessionInfo;
use iceoryx2::prelude::*;
use serde_json::json;

use crate::support::company::Companion;
use crate::support::harness::{Rig, ended, until};
use crate::support::programs::program;

const SCENARIO: &str = "scenarios/spring-mass.toml";
/// User ID of `nobody`.
const NOBODY: u32 = 65534;

/// Paused run under attack.
struct Target<'r> {
    rig: &'r Rig,
    session: SessionInfo,
    /// Attempts with their answers.
    refused: Vec<String>,
}

impl Target<'_> {
    /// Records an attempt, which must have failed.
    #[track_caller]
    fn refused<T, E: std::fmt::Debug>(&mut self, attempt: &str, outcome: Result<T, E>) {
        match outcome {
            Ok(_) => panic!("{attempt}: got in"),
            Err(said) => self.refused.push(format!("{attempt}: {said:?}")),
        }
    }

    /// Records an attempt with its answer.
    #[track_caller]
    fn answered(&mut self, attempt: &str, text: &str, expected: &str) {
        assert!(text.contains(expected), "{attempt}: {text}");
        self.refused.push(format!("{attempt}: {text}"));
    }
}

#[test]
fn strangers_get_no_access_and_the_digest_stays_the_same() {
    let rig = Rig::new();
    let alone = rig.run(SCENARIO).expect(0).digest();
    let running = rig.held();
    let session = SessionInfo::read(&rig.session_folder()).expect("it runs");
    let mut target = Target {
        rig: &rig,
        session,
        refused: Vec::new(),
    };
    processes(&mut target);
    ports(&mut target);
    sockets(&mut target);
    let own = target.refused.len();
    other_users(&mut target);
    nothing_listens_on_a_network(&target.session);
    rig.in_session("resume").expect(0);
    let run = running.finish().expect(0);
    assert_eq!(run.digest(), alone, "{:#?}", target.refused);
    let summary = run.summary();
    assert_eq!(
        (&summary["rejected_frames"], &summary["ignored"]),
        (&json!(0), &json!({}))
    );
    assert_eq!(own, 22, "{:#?}", target.refused);
    // Acting as another user needs the privilege to become one.
    if rustix::process::geteuid().is_root() {
        assert_eq!(target.refused.len(), 28, "{:#?}", target.refused);
    } else {
        eprintln!("not root: attempts of other users were left out");
    }
}

/// Starts second processes of the same user.
fn processes(target: &mut Target<'_>) {
    for (binary, expected) in [
        ("controller-process", "already has its controller"),
        ("plant-process", "already has its plant"),
    ] {
        // Its input stays open, like that of a launched side.
        let mut second = target.rig.command(program(binary));
        second
            .arg("--session")
            .arg(&target.session.folder)
            .stdin(Stdio::piped())
            .stderr(Stdio::piped());
        let mut second = Companion::start(&mut second);
        assert!(!ended(&mut second).success(), "{binary}");
        let mut text = String::new();
        let mut stderr = second.stderr.take().expect("piped");
        stderr.read_to_string(&mut text).expect("text");
        target.answered(binary, &text, expected);
    }
    let name = target.session.name.clone();
    let again = target.rig.beside(&["run", SCENARIO, "--session", &name]);
    target.answered(
        "a session of the same name",
        &again.expect(2).stderr,
        "is running",
    );
    let own = IceoryxLink::create(&target.session);
    target.refused("a second plant's link", own.map(drop));
    let own = IceoryxLink::open(&target.session, 1);
    target.refused("a second controller's link", own.map(drop));
    let own = IceoryxLink::open(&target.session, 2);
    target.refused("a controller nobody asked for", own.map(drop));
}

/// Opens ports on the services of the run.
fn ports(target: &mut Target<'_>) {
    let own = node(&target.session, "intruder").expect("a node");
    for name in ["frames/1/samples", "frames/1/commands"] {
        let board = own.service_builder(&name.try_into().expect("a name"));
        let board = board.blackboard_opener::<u8>().open();
        let writer = board
            .expect("it may be looked at")
            .writer_builder()
            .create();
        target.refused(name, writer.map(drop));
        let other = AttributeVerifier::new().require(
            &"layout".try_into().expect("a key"),
            &"0123456789abcdef".try_into().expect("a value"),
        );
        let board = own.service_builder(&name.try_into().expect("a name"));
        let board = board.blackboard_opener::<u8>();
        let opened = board.open_with_attributes(&other.expect("attributes"));
        target.refused(&format!("{name} with another layout"), opened.map(drop));
        let board = own.service_builder(&name.try_into().expect("a name"));
        let opened = board.blackboard_opener::<u64>().open();
        target.refused(&format!("{name} with other keys"), opened.map(drop));
    }
    for name in ["control/1/plant", "control/1/controller"] {
        target.refused(&format!("{name}, speaking"), speaking(&own, name, true));
        let topic = own.service_builder(&name.try_into().expect("a name"));
        let opened = topic.publish_subscribe::<u64>().open();
        target.refused(&format!("{name} of another type"), opened.map(drop));
    }
    target.refused("credit, giving it", speaking(&own, "credit", false));
}

/// Tries to publish on a service, whose payload is a list of numbers or a single one.
fn speaking(own: &Node<Ipc>, name: &str, is_list: bool) -> Result<(), String> {
    let topic = own.service_builder(&name.try_into().expect("a name"));
    let error = if is_list {
        let topic = topic.publish_subscribe::<[u8]>().open();
        let topic = topic.expect("it may be looked at");
        topic.publisher_builder().create().err()
    } else {
        let topic = topic.publish_subscribe::<u64>().open();
        let topic = topic.expect("it may be looked at");
        topic.publisher_builder().create().err()
    };
    error.map_or(Ok(()), |error| Err(format!("{error:?}")))
}

/// Sends nonsense to the sockets.
fn sockets(target: &mut Target<'_>) {
    let deep = "[".repeat(100_000);
    let cases = [
        ("control", "\u{1}\u{2} nonsense", "not a request"),
        ("control", "{\"request\":\"obey\"}", "unknown variant"),
        ("control", &deep, "not a request"),
        (
            "control",
            r#"{"request":"inject","toml":"[[faults]]\nkind = 'bias'\n[[faults.effects]]\ntarget = 'measured.position_m'\nbias = nan"}"#,
            "not a number",
        ),
        (
            "hil",
            "{\"binary\":\"/bin/true\",\"set\":[]}",
            "does not speak the protocol",
        ),
    ];
    for (socket, line, expected) in cases {
        let output = asked(&target.session.folder.join(socket), line);
        let output = output.expect("an answer");
        target.answered(socket, &output.to_lowercase(), expected);
    }
}

fn asked(socket: &Path, line: &str) -> std::io::Result<String> {
    let mut stream = UnixStream::connect(socket)?;
    stream.write_all(line.as_bytes())?;
    stream.write_all(b"\n")?;
    let mut text = String::new();
    BufReader::new(stream).read_line(&mut text)?;
    Ok(text)
}

/// Acts as another user of the machine.
fn other_users(target: &mut Target<'_>) {
    if !rustix::process::geteuid().is_root() {
        return;
    }
    let folder = target.session.folder.clone();
    let segments = target.session.segments();
    assert!(!segments.is_empty());
    let shell = |script: &str, paths: &[PathBuf]| {
        let mut shell = Command::new("sh");
        shell.arg("-c").arg(script).arg("sh").args(paths);
        let output = shell.uid(NOBODY).gid(NOBODY).output().expect("a shell");
        if output.status.success() {
            Ok(())
        } else {
            Err(String::from_utf8_lossy(&output.stderr).into_owned())
        }
    };
    let inside = [folder.clone()];
    target.refused(
        "another user looks into the folder",
        shell("ls \"$1\"", &inside),
    );
    let read = shell(
        "for f in \"$@\"; do head -c 1 \"$f\" && exit 0; done; exit 1",
        &segments,
    );
    target.refused("another user reads a segment", read);
    let write = shell(
        "for f in \"$@\"; do : >> \"$f\" && exit 0; done; exit 1",
        &segments,
    );
    target.refused("another user writes a segment", write);
    let remove = shell(
        "for f in \"$@\"; do rm -f \"$f\" && exit 0; done; exit 1",
        &segments,
    );
    target.refused("another user removes a segment", remove);
    let pids: Vec<PathBuf> = (target.session.children.iter())
        .map(|child| child.pid.to_string().into())
        .collect();
    target.refused("another user ends a process", shell("kill \"$@\"", &pids));
    // The program is copied to where that user may run it.
    let copy = target.rig.path("hil");
    std::fs::copy(program("hil"), &copy).expect("copied");
    let open = std::fs::Permissions::from_mode(0o755);
    for path in [copy.parent().expect("a folder"), &copy] {
        std::fs::set_permissions(path, open.clone()).expect("set");
    }
    let mut pause = target.rig.command(&copy);
    pause.args(["pause", "--session", &target.session.name]);
    let output = pause
        .uid(NOBODY)
        .gid(NOBODY)
        .output()
        .expect("it can be run");
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success(), "{text}");
    target.answered("another user pauses", &text, "no session");
    assert_eq!(target.session.segments(), segments, "all are there");
}

/// Checks that no process of the run has an internet socket.
fn nothing_listens_on_a_network(session: &SessionInfo) {
    let pids = (session.children.iter().map(|child| child.pid)).chain([session.owner.pid]);
    for pid in pids {
        let mut inodes = Vec::new();
        for table in ["tcp", "tcp6", "udp", "udp6", "raw", "packet"] {
            let text = std::fs::read_to_string(format!("/proc/{pid}/net/{table}"));
            let text = text.unwrap_or_default();
            let column = if table == "packet" { 8 } else { 9 };
            let of_line = |line: &str| line.split_ascii_whitespace().nth(column).map(str::to_owned);
            inodes.extend(text.lines().skip(1).filter_map(of_line));
        }
        let descriptors = std::fs::read_dir(format!("/proc/{pid}/fd")).expect("it runs");
        for descriptor in descriptors.flatten() {
            let Ok(link) = std::fs::read_link(descriptor.path()) else {
                continue; // already closed
            };
            let link = link.to_string_lossy();
            let inode = (link.strip_prefix("socket:[")).and_then(|rest| rest.strip_suffix(']'));
            let is_internet = inode.is_some_and(|inode| inodes.iter().any(|one| one == inode));
            assert!(!is_internet, "process {pid} has {link}");
        }
    }
}

#[test]
fn a_file_of_another_user_with_our_prefix_is_left_alone_and_causes_no_trouble() {
    if !rustix::process::geteuid().is_root() {
        eprintln!("not root: left out");
        return;
    }
    let rig = Rig::new();
    let running = rig.held();
    let session = SessionInfo::read(&rig.session_folder()).expect("it runs");
    let file = Path::new("/dev/shm").join(format!("{}planted", session.prefix));
    let mut touch = Command::new("touch");
    let touched = touch.arg(&file).uid(NOBODY).gid(NOBODY).status();
    assert!(touched.expect("it can be run").success());
    assert!(!session.segments().contains(&file));
    rig.in_session("resume").expect(0);
    let run = running.finish().expect(0);
    assert_eq!(run.summary()["verdict"], "pass");
    assert!(file.exists() && !session.folder.exists());
    std::fs::remove_file(file).expect("it is there");
}

#[test]
fn a_stopped_hil_keeps_its_session() {
    let rig = Rig::new();
    let running = rig.start(&format!(
        "{SCENARIO} --set run.duration_s=60 --clock paced --wait-limit 60"
    ));
    until("it runs", || {
        SessionInfo::read(&rig.session_folder()).is_ok_and(|info| info.children.len() == 2)
    });
    running.signal(rustix::process::Signal::STOP);
    rig.beside(&["sessions", "--clean"])
        .expect(0)
        .prints(&[rig.session()]);
    assert!(rig.session_folder().exists());
    running.signal(rustix::process::Signal::CONT);
    running.signal(rustix::process::Signal::INT);
    running.finish().expect(130);
}
