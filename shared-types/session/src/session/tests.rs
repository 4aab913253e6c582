use std::ffi::CStr;
use std::mem::MaybeUninit;

use rustix::fs::inotify::{self, CreateFlags, ReadFlags, Reader, WatchFlags};

use super::*;

#[test]
fn a_dropped_session_leaves_nothing() {
    let session = Session::create(None).expect("a session");
    let info = session.info().clone();
    let node = info.node("test").expect("a node");
    assert!(info.folder.is_dir());
    assert!(
        !info.segments().is_empty(),
        "iceoryx2 keeps a file for each prefix"
    );
    drop(node);
    drop(session);
    assert!(!info.folder.exists());
    assert_eq!(info.segments(), Vec::<PathBuf>::new());
}

#[test]
fn a_session_of_one_process_is_just_a_folder_that_others_find() {
    let session = Session::of_one_process(None).expect("a session");
    let info = session.info().clone();
    assert!(list().expect("lists").contains(&info));
    let error = Session::create(Some(&info.name)).expect_err("taken");
    assert!(matches!(error, SessionError::Taken { .. }));
    assert_eq!(info.segments(), Vec::<PathBuf>::new());
    assert_eq!(info.open_to_others(), Vec::<PathBuf>::new());
    drop(session);
    assert!(!info.folder.exists());
    // The remains of a dead one are swept like any other's.
    let dead = Session::of_one_process(None).expect("a session");
    flock(&dead._lock, FlockOperation::Unlock).expect("unlocks");
    sweep().expect("sweeps");
    assert!(!dead.info().folder.exists());
}

#[test]
fn everything_is_closed_to_others() {
    let session = Session::create(None).expect("a session");
    let _node = session.info().node("test").expect("a node");
    let mode = |path: &Path| fs::metadata(path).expect("there").mode() & 0o777;
    assert_eq!(mode(&session.info().folder), 0o700);
    assert_eq!(mode(&session.info().folder.join("session.json")), 0o600);
    assert!(!session.info().segments().is_empty());
    assert_eq!(session.info().open_to_others(), Vec::<PathBuf>::new());

    let opened = session.info().folder.join("i").join("open");
    fs::write(&opened, "x").expect("writes");
    fs::set_permissions(&opened, Permissions::from_mode(0o604)).expect("sets");
    assert_eq!(session.info().open_to_others(), [opened]);
}

#[test]
fn the_node_counter_is_closed_from_its_creation() {
    let watch = inotify::init(CreateFlags::NONBLOCK).expect("inotify");
    let made_or_changed = WatchFlags::CREATE | WatchFlags::ATTRIB;
    inotify::add_watch(&watch, SHARED_MEMORY, made_or_changed).expect("watched");
    let session = Session::create(None).expect("a session");
    let _node = session.info().node("test").expect("a node");

    let segments = session.info().segments();
    let [counter] = &segments[..] else {
        panic!("{segments:?} are not one file");
    };
    // An update of iceoryx2 with another name would have created a second file, or a different one.
    assert_eq!(*counter, session.info().node_counter());
    let file_info = fs::metadata(counter).expect("there");
    assert_eq!(file_info.mode() & 0o777, 0o600);
    // The second of the 64-bit words counts nodes: that of the session, and that of this test.
    let content = fs::read(counter).expect("readable");
    assert_eq!(content[8..], [2, 0, 0, 0, 0, 0, 0, 0]);

    let name = counter.file_name().expect("a name").as_encoded_bytes();
    let mut buffer = [MaybeUninit::uninit(); 1 << 16];
    let mut events = Reader::new(&watch, &mut buffer);
    let mut modes = Vec::new();
    while let Ok(event) = events.next() {
        assert!(!event.events().contains(ReadFlags::QUEUE_OVERFLOW));
        if event.file_name().map(CStr::to_bytes) == Some(name) {
            modes.push(event.events());
        }
    }
    // Created once, and its mode never changed: it was closed all the time.
    assert_eq!(modes, [ReadFlags::CREATE]);
}

#[test]
fn a_file_under_construction_keeps_its_mark() {
    let session = Session::create(None).expect("a session");
    let prefix = &session.info().prefix;
    let file = |name: &str, mode| {
        let path = Path::new(SHARED_MEMORY).join(format!("{prefix}{name}"));
        fs::write(&path, "x").expect("writes");
        fs::set_permissions(&path, Permissions::from_mode(mode)).expect("sets");
        path
    };
    let (filling, open) = (file("filling", 0o200), file("open", 0o666));
    session.info().tighten();
    let mode = |path: &Path| fs::metadata(path).expect("there").mode() & 0o777;
    assert_eq!((mode(&filling), mode(&open)), (0o200, 0o600));
}

#[test]
fn a_name_in_use_is_refused_with_its_owner() {
    let session = Session::create(None).expect("a session");
    let error = Session::create(Some(&session.info().name)).expect_err("taken");
    assert!(matches!(error, SessionError::Taken { pid, .. } if pid == std::process::id()));
}

#[test]
fn a_file_of_another_folder_is_refused() {
    let session = Session::create(None).expect("a session");
    let info = session.info();
    assert_eq!(&SessionInfo::read(&info.folder).expect("its own"), info);
    for (prefix, folder) in [
        ("", info.folder.clone()),
        ("hil_", info.folder.clone()),
        ("hil_0123456_", info.folder.clone()),
        ("hil_01234567", info.folder.clone()),
        (&info.prefix, "/".into()),
        (&info.prefix, "/nowhere".into()),
    ] {
        let other = SessionInfo {
            prefix: prefix.into(),
            folder,
            ..info.clone()
        };
        info.write_file("session.json", &other).expect("writes");
        let read = SessionInfo::read(&info.folder);
        assert!(read.is_err(), "{other:?}");
    }
    info.write_file("session.json", info).expect("writes");
}

#[test]
fn unusable_names_are_refused() {
    for name in ["", "a/b", "..", "UPPER", "a-name-that-is-far-too-long", "é"] {
        assert!(
            matches!(Session::create(Some(name)), Err(SessionError::Name(_))),
            "{name}"
        );
    }
}

#[test]
fn a_sweep_removes_dead_sessions_and_leaves_live_ones() {
    let dead_ones = || super::dead().expect("lists");
    let live = Session::create(None).expect("a session");
    let dead = Session::create(None).expect("a session");
    let info = dead.info().clone();
    // As after a kill: the lock is gone, the files are not.
    let segment = Path::new(SHARED_MEMORY).join(format!("{}left", info.prefix));
    fs::write(&segment, "x").expect("writes");
    flock(&dead._lock, FlockOperation::Unlock).expect("unlocks");
    assert!(dead_ones().contains(&info.name));
    assert!(!dead_ones().contains(&live.info().name));
    sweep().expect("sweeps");
    assert!(!info.folder.exists() && !segment.exists());
    assert!(live.info().folder.exists());
    assert!(list().expect("lists").contains(live.info()));
    drop(dead);
}

#[test]
fn a_sweep_needs_no_readable_description() {
    let live = Session::create(None).expect("a session");
    let dead = Session::create(None).expect("a session");
    let (info, folder) = (dead.info().clone(), dead.info().folder.clone());
    fs::write(folder.join("session.json"), "{\"schema\":").expect("writes");
    assert_eq!(info.segments(), [info.node_counter()]);
    // A copy of a live session's folder, whose content is damaged too. It appears atomically, because other tests sweep
    // at any time.
    let copied_folder = Path::new(SHARED_MEMORY).join(format!("{}-copy", live.info().name));
    private_folder(&copied_folder).expect("made");
    fs::copy(live.info().folder.join("lock"), copied_folder.join("lock")).expect("copied");
    let copy = folder.with_file_name(format!("{}-copy", live.info().name));
    fs::rename(&copied_folder, &copy).expect("moved");
    flock(&dead._lock, FlockOperation::Unlock).expect("unlocks");

    sweep().expect("sweeps");
    assert_eq!(info.segments(), Vec::<PathBuf>::new());
    assert!(!folder.exists() && !copy.exists());
    assert_eq!(live.info().segments(), [live.info().node_counter()]);
    drop(dead);
}
