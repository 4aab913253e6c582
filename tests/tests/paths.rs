//! File names that are not UTF-8, wherever a command accepts one: they work, or are refused by name.

use std::ffi::{OsStr, OsString};
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::PathBuf;

use crate::support::harness::{Rig, Run};
use crate::support::programs::{program, workspace};

/// Name that is not UTF-8.
const NAME: &[u8] = b"odd\xff";

/// Returns such a name with a suffix, in the test's folder.
fn odd(rig: &Rig, ending: &str) -> PathBuf {
    let name = [NAME, ending.as_bytes()].concat();
    rig.path("").join(OsString::from_vec(name))
}

/// Runs a command in which such a path replaces every `@`.
fn hil(rig: &Rig, line: &str) -> Run {
    let mut hil = rig.command(program("hil"));
    for word in line.split(' ') {
        match word.strip_prefix('@') {
            Some(ending) => hil.arg(odd(rig, ending)),
            None => hil.arg(word),
        };
    }
    rig.program(hil)
}

/// Checks a refusal with its reason, and that nothing was created.
#[track_caller]
fn refused(rig: &Rig, line: &str, made: &str) {
    let run = hil(rig, line).expect(2).says(&["odd\\xFF", "UTF-8"]);
    assert!(!run.stderr.contains("panicked"), "{}", run.stderr);
    assert!(!odd(rig, made).exists(), "{line} made something");
}

#[test]
fn a_run_folder_that_is_not_utf8_is_refused_by_name() {
    let rig = Rig::new();
    refused(&rig, "run scenarios/spring-mass.toml --out @", "");
    refused(
        &rig,
        "run scenarios/spring-mass.toml --out @ --link in-process",
        "",
    );
    // Also a folder that merely lies in such a folder.
    std::fs::create_dir(odd(&rig, "")).expect("made");
    refused(&rig, "run scenarios/spring-mass.toml --out @/run", "/run");
}

#[test]
fn recordings_and_scenarios_may_have_any_name() {
    let rig = Rig::new();
    let run = rig.run("scenarios/spring-mass.toml").expect(0);
    let folder = odd(&rig, "");
    std::fs::rename(&run.folder, &folder).expect("renamed");
    let scenario = odd(&rig, ".toml");
    std::fs::copy(workspace().join("scenarios/spring-mass.toml"), &scenario).expect("copied");
    for line in [
        "judge @",
        "judge @ --requirements @.toml",
        "compare @ @",
        "export @ -o @.csv",
        "scenario from @ -o @-again.toml",
        "replay @",
        "latency @ --csv @-latency.csv",
        "layout @ foxglove -o @.json",
        "report @ -o @.html",
        "recover @",
        "config check @.toml",
        "config show @.toml",
    ] {
        hil(&rig, line).expect(0);
    }
    for written in [".csv", "-again.toml", "-latency.csv", ".json", ".html"] {
        assert!(odd(&rig, written).exists(), "{written}");
    }
    let names = std::fs::read_dir(rig.path(""))
        .expect("the folder")
        .flatten();
    for name in names.map(|entry| entry.file_name()) {
        assert!(!name.as_bytes().contains(&0xef), "{name:?} is mangled");
    }
    let out = rig.path("again");
    let line = format!("rerun @ --out {}", out.display());
    hil(&rig, &line).expect(0);
}

#[test]
fn files_of_a_run_with_any_name_work_or_are_refused() {
    let rig = Rig::new();
    std::fs::copy(program("controller-process"), odd(&rig, "-controller")).expect("copied");
    let out = rig.path("run").display().to_string();
    let line = "run scenarios/spring-mass.toml --controller-bin @-controller --junit @.xml --markdown @.md --checkpoint-at 2.5";
    hil(&rig, &format!("{line} --out {out}")).expect(0);
    for written in [".xml", ".md"] {
        assert!(odd(&rig, written).exists(), "{written}");
    }
    let entries = std::fs::read_dir(rig.path("run")).expect("a run").flatten();
    let mut folders = entries
        .map(|entry| entry.path())
        .filter(|path| path.is_dir());
    let checkpoint = folders.next().expect("a checkpoint");
    let name = checkpoint.file_name().and_then(OsStr::to_str);
    let name = name.expect("plain text");
    std::fs::rename(rig.path("run"), odd(&rig, "")).expect("renamed");
    let from = format!("run --from @/{name} --controller-bin @-controller --out {out}");
    refused(&rig, &from, "-never");
    assert!(!rig.path("run").exists());

    refused(
        &rig,
        "compare @ --baseline a --update --baselines @.toml",
        ".toml",
    );
    let plain = rig.path("plain.toml").display().to_string();
    hil(
        &rig,
        &format!("compare @ --baseline a --update --baselines {plain}"),
    )
    .expect(0);
}

#[test]
fn a_controller_with_such_a_name_cannot_take_over_and_the_run_continues() {
    let rig = Rig::new();
    std::fs::copy(program("controller-process"), odd(&rig, "")).expect("copied");
    let running = rig.start("scenarios/spring-mass.toml --pace 1 --set run.duration_s=600");
    running.children_at_once();
    let swap = format!("controller swap --bin @ --session {}", rig.session());
    refused(&rig, &swap, "-never");
    running.signal(rustix::process::Signal::INT);
    running.finish().expect(130);
}
