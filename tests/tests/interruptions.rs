//! Ctrl-C ends every command at any point: with exit code 130, and nothing left behind.

use std::fs;
use std::path::PathBuf;

use rustix::fs::{CWD, FileType, Mode, mknodat};
use rustix::process::Signal;

use crate::support::harness::{Rig, Running, until};
use crate::support::programs::shipped;

/// Requirements that take the check more than a second.
const MANY: usize = 150_000;

/// Returns the processor time of a process in ticks; `None` if it has ended.
fn ticks(running: &Running<'_>) -> Option<u64> {
    let stat = fs::read_to_string(format!("/proc/{}/stat", running.worker())).ok()?;
    let fields = stat.rsplit_once(')')?.1; // the name may contain spaces
    let mut fields = fields.split_ascii_whitespace();
    if fields.next()? == "Z" {
        return None;
    }
    let number = |field: Option<&str>| field?.parse::<u64>().ok();
    let user = number(fields.nth(10))?;
    Some(user + number(fields.next())?)
}

/// Returns `true` if a process has begun its work and none of its threads is running.
fn waits(running: &Running<'_>) -> bool {
    let process = PathBuf::from(format!("/proc/{}", running.worker()));
    let status = fs::read_to_string(process.join("status")).unwrap_or_default();
    let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:"));
    let caught = caught.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    let hears = caught.is_some_and(|mask| mask & 1 << (Signal::INT.as_raw() - 1) != 0);
    let threads = fs::read_dir(process.join("task"))
        .into_iter()
        .flatten()
        .flatten();
    hears
        && threads
            .filter_map(|thread| fs::read_to_string(thread.path().join("stat")).ok())
            .all(|stat| stat.contains(") S "))
}

/// A recording that is never written: opening it blocks for ever.
#[test]
fn commands_waiting_for_a_recording_end_on_ctrl_c_and_leave_nothing() {
    let rig = Rig::new();
    let (folder, output) = (rig.path("silent"), rig.path("out"));
    for path in [&folder, &output] {
        fs::create_dir(path).expect("a folder");
    }
    let pipe = folder.join("run.mcap");
    mknodat(CWD, &pipe, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).expect("a pipe");
    let (run, file) = (pipe.display(), output.join("file"));
    for command in [
        "judge RUN".to_owned(),
        "compare RUN RUN".into(),
        "compare RUN --baseline x --update --baselines OUT".into(),
        "report RUN -o OUT".into(),
        "export RUN -o OUT".into(),
        "layout RUN foxglove -o OUT".into(),
        "recover RUN -o OUT".into(),
        "replay RUN".into(),
        "rerun RUN".into(),
        "latency RUN".into(),
        "scenario from RUN -o OUT".into(),
    ] {
        let command = command.replace("RUN", &run.to_string());
        let command = command.replace("OUT", &file.display().to_string());
        let arguments: Vec<&str> = command.split(' ').collect();
        let running = rig.start_hil(&arguments);
        until(&format!("`{command}` waits"), || waits(&running));
        running.signal(Signal::INT);
        let ended = running.finish();
        assert_eq!(ended.code, Some(130), "{command}: {}", ended.stderr);
        let left: Vec<_> = fs::read_dir(&output).expect("a folder").collect();
        assert!(left.is_empty(), "{command}: {left:?}");
    }
}

#[test]
fn a_check_of_very_many_requirements_ends_on_ctrl_c() {
    let rig = Rig::new();
    let mut text = shipped("scenarios/spring-mass.toml");
    for number in 0..MANY {
        text += &format!(
            "[[requirements]]\nname = \"r{number}\"\nformula = \"truth.position_m < 1\"\n"
        );
    }
    let path = rig.write("many.toml", &text).display().to_string();
    let running = rig.start_hil(&["config", "check", &path]);
    let mut whole = 0;
    until("the check is over", || match ticks(&running) {
        Some(ticks) => {
            whole = ticks;
            false
        }
        None => true,
    });
    running.finish().expect(0);
    assert!(whole > 50, "{whole} ticks are too few to be interrupted in");
    for command in ["config check", "config show", "run"] {
        let arguments: Vec<&str> = command.split(' ').chain([path.as_str()]).collect();
        let running = rig.start_hil(&arguments);
        until("it is in the middle of the check", || {
            ticks(&running).is_none_or(|ticks| ticks > whole * 4 / 10)
        });
        running.signal(Signal::INT);
        let ended = running.finish();
        assert_eq!(ended.code, Some(130), "{command}: {}", ended.stderr);
        assert_eq!(ended.stdout, "", "{command}");
    }
}
