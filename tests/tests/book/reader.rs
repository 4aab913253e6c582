//! Executes the pages: one shell per page, in a folder that looks like a fresh clone after `cargo build --release`.
//!
//! `hil` and `cargo` on the path of that shell are wrapper scripts. `hil` names the session of the page, where a
//! reader has a single one running. `cargo` builds with the profile `dev` into a folder of the tests; tests and
//! benches are only checked for existence, because they are what runs here.

use std::fs::File;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process_group};

use super::page::Page;
use super::shown;
use crate::support::fmus;
use crate::support::harness::Rig;
use crate::support::programs::{LINES, path_from, program, target, workspace};
use crate::support::python::python;

/// Time limit of a page, after which it counts as hanging. On busy cores a run of 20 s takes minutes.
const WATCHDOG: Duration = Duration::from_secs(1200);

/// Folders of the scripts and of files shared by pages.
pub(super) struct Desk {
    /// Fixed location, so that its builds are reused.
    folder: PathBuf,
    programs: PathBuf,
    /// Lock against a second test run of this user.
    _lock: File,
}

/// Modules that Python blocks may import to be executed: those in the clone, and those that other tests need as
/// well.
const MODULES: [&str; 7] = [
    "hil",
    "json",
    "gymnasium",
    "mcap",
    "numpy",
    "pandas",
    "pyarrow",
];

const HIL: &str = r#"#!/usr/bin/env bash
# Names the session of the page for a command that would look for the only one.
case "$1" in
    controller | get | inject | mark | monitor | panel | pause | resume | set | step | watch)
        [[ " $* " == *" --list "* || " $* " == *" --session "* ]] || set -- "$@" --session "$SESSION" ;;
esac
exec "$PROGRAMS/hil" "$@"
"#;

const CARGO: &str = r#"#!/usr/bin/env bash
# The reader's cargo: what the tests have built is not built again.
set -euo pipefail
words=("$@")
folder=$PWD
into= example= after=$#
count=$#
for ((i = 0; i < count; i++)); do
    case "${words[i]}" in
        --release) unset 'words[i]' ;;
        --manifest-path)
            folder=$(cd "$(dirname "${words[i + 1]}")" && pwd)
            unset 'words[i]' 'words[i + 1]'
            ((++i)) ;;
        --manifest-path=* | --target-dir=*) echo "in two words, please" >&2; exit 2 ;;
        --target-dir)
            into=${words[i + 1]}
            unset 'words[i]' 'words[i + 1]'
            ((++i)) ;;
        --example) example=${words[i + 1]} ;;
        --) after=$((i + 1)) ;;
        --bench) [ -e "tests/benches/${words[i + 1]}" ] || grep -q "name = \"${words[i + 1]}\"" tests/Cargo.toml ;;
    esac
done
case "$1" in
    build)
        [ "$folder" -ef "$CLONE" ] && exit 0
        # What no page has changed is built where other tests have built it.
        original=$WORKSPACE/${folder#"$CLONE/"}
        diff -rq -x target "$folder" "$original" >"$NOTES/changed" 2>&1 || original=$folder
        (cd "$original" && CARGO_BUILD_BUILD_DIR=$OUTSIDE "$CARGO" "${words[@]}" --offline --target-dir "$OUTSIDE")
        into=${into:-$folder/target}
        mkdir -p "$into"
        ln -sfn "$OUTSIDE/debug" "$into/release" ;;
    test | bench)
        [[ $folder -ef $CLONE || $folder/ = "$CLONE/examples/"* ]] && exit 0
        cd "$folder"
        CARGO_BUILD_BUILD_DIR=$OUTSIDE exec "$CARGO" "${words[@]}" --offline --target-dir "$OUTSIDE" ;;
    rustc) ln -sf "$PROGRAMS/examples/libhil_c.a" "$CLONE/target/release/libhil_foreign.a" ;;
    run) exec "$PROGRAMS/examples/$example" "${@:after + 1}" ;;
    *) exec "$CARGO" "$@" ;;
esac
"#;

const PROLOGUE: &str = r#"set -euo pipefail
# Waits until the run of this page is held.
held() {
    until hil inject --active --json --session "$SESSION" 2>/dev/null | grep -q '"paused": *true'; do sleep 0.05; done
}
# Ends the run of this page as Ctrl-C would.
interrupt() {
    kill -INT "$!"
    wait "$!" || test $? = 130
}
"#;

impl Drop for Desk {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.folder); // the next page begins with the same removal
    }
}

impl Desk {
    pub(super) fn new() -> Self {
        // Not in the target directory: `cargo new` would add a crate to the enclosing workspace.
        let user = rustix::process::geteuid().as_raw();
        let folder = std::env::temp_dir().join(format!("hil-book-{user}"));
        // Beside the folder, which is removed at the end.
        let lock = File::create(folder.with_extension("lock")).expect("a lock");
        lock.lock().expect("a lock");
        std::fs::create_dir_all(folder.join("bin")).expect("a folder");
        let hil = program("hil");
        let desk = Self {
            programs: hil.parent().expect("a folder").into(),
            folder,
            _lock: lock,
        };
        for (name, text) in [("hil", HIL), ("cargo", CARGO)] {
            let path = desk.folder.join("bin").join(name);
            std::fs::write(&path, text).expect("a script");
            std::fs::set_permissions(path, PermissionsExt::from_mode(0o755)).expect("a script");
        }
        desk
    }

    /// Creates a folder with the content of a fresh clone, and nothing of the previous page.
    fn clone(&self) -> PathBuf {
        let desk = self.folder.join("desk");
        let _ = std::fs::remove_dir_all(&desk); // does not exist at first
        let clone = desk.join("hil");
        let release = clone.join("target/release");
        std::fs::create_dir_all(&release).expect("a folder");
        symlink(self.folder.join("bin/hil"), release.join("hil")).expect("a link");
        for name in ["plant-process", "controller-process"] {
            symlink(self.programs.join(name), release.join(name)).expect("a link");
        }
        for file in std::fs::read_dir(workspace()).expect("the workspace") {
            let (from, name) = file.map(|f| (f.path(), f.file_name())).expect("a file");
            let to = clone.join(&name);
            match name.to_str().unwrap_or_default() {
                "target" | "runs" | ".git" => {}
                // Pages write to these.
                "examples" | "scenarios" => copy(&from, &to),
                _ => symlink(from, to).expect("a link"),
            }
        }
        clone
    }

    /// Builds the FMUs that a reader of the FMU page is assumed to have: a plant and a controller.
    fn build_fmus(&self) {
        let folder = self.folder.join("fmus");
        std::fs::create_dir_all(&folder).expect("a folder");
        fmus::write(&folder.join("plant.fmu"), &fmus::reference("Dahlquist", 3));
        fmus::write(&folder.join("controller.fmu"), &fmus::proportional());
    }

    /// Executes everything on a page.
    ///
    /// # Errors
    /// If anything fails, with page and line.
    pub(super) fn follow(&self, page: &Page) -> Result<(), String> {
        let blocks = page.blocks();
        if !blocks.iter().any(|block| block.language == "sh") {
            return Ok(());
        }
        let rig = Rig::new();
        let clone = self.clone();
        if page.text.contains("$FMUS") {
            self.build_fmus();
        }
        let notes = self.folder.join("notes");
        let _ = std::fs::remove_dir_all(&notes);
        std::fs::create_dir_all(&notes).expect("a folder");
        let script = notes.join("script");
        let has_python = blocks.iter().any(|block| block.language == "python");
        let python = has_python.then(|| python(&MODULES[2..].join(", ")));
        let python = python.flatten();
        let mut text = String::from(PROLOGUE);
        for block in &blocks {
            let line = block.line;
            if let Some((file, continued)) = block.file {
                let into = if continued { ">>" } else { ">" };
                text += &format!("cat {into}'{file}' <<'_END_'\n{}_END_\n", block.text);
            }
            if block.language == "sh" {
                text += &format!("echo {line} >\"$NOTES/line\"\n");
                text += &format!("exec >\"$NOTES/{line}.out\" 2>\"$NOTES/{line}.err\"\n");
                text += &with_exit_codes(&block.text);
            }
            if let ("python", Some(python)) = (block.language, &python) {
                // Blocks that need more than the other tests are only parsed.
                let runs = imports(&block.text).all(|module| MODULES.contains(&module));
                let reads = if runs { "-" } else { "-m ast" };
                text += &format!("echo {line} >\"$NOTES/line\"\nexec 2>\"$NOTES/{line}.err\"\n");
                text += &format!(
                    "HIL_BIN=\"$PROGRAMS/hil\" PYTHONPATH=tools/python '{}' {reads} <<'_END_' >\"$NOTES/{line}.out\"\n{}_END_\n",
                    python.display(),
                    block.text
                );
            }
        }
        std::fs::write(&script, text).expect("a script");
        let mut bash = rig.command("bash");
        bash.arg(&script)
            .current_dir(&clone)
            .env("PATH", path_from(&self.folder.join("bin")))
            .env("CLONE", &clone)
            .env("NOTES", &notes)
            .env("FMUS", self.folder.join("fmus"))
            .env("OUTSIDE", target().join("examples-outside"))
            .env("PROGRAMS", &self.programs)
            .env("CARGO", env!("CARGO"))
            .env("WORKSPACE", workspace())
            .env(LINES.0, LINES.1)
            .env("SESSION", rig.session())
            .env("XDG_STATE_HOME", self.folder.join("state"))
            .env_remove("CARGO_TARGET_DIR")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .process_group(0);
        let passed = finish(&mut bash);
        let note = |name: &str| std::fs::read_to_string(notes.join(name)).unwrap_or_default();
        let page_path = page.path.display();
        if !passed {
            let line = note("line").trim().to_owned();
            let (out, err) = (note(&format!("{line}.out")), note(&format!("{line}.err")));
            return Err(format!(
                "{page_path}:{line}: a command failed\n{out}\n{err}"
            ));
        }
        rig.assert_nothing_left();
        for pair in blocks.windows(2) {
            let [command, output] = pair else { continue };
            if command.language == "sh" && output.language == "text" && output.follows {
                let result = note(&format!("{}.out", command.line))
                    + &note(&format!("{}.err", command.line));
                shown::compare(&output.text, &result)
                    .map_err(|missing| format!("{page_path}:{}: {missing}", output.line))?;
            }
        }
        Ok(())
    }
}

/// Runs a shell to its end, or until the watchdog expires; returns `true` on success. A failed page leaves no
/// session.
fn finish(bash: &mut Command) -> bool {
    let mut child = bash.spawn().expect("bash is there");
    let group = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
    let end = |signal| {
        let _ = kill_process_group(group.expect("a number"), signal); // may have ended
    };
    let since = Instant::now();
    loop {
        if let Some(status) = child.try_wait().expect("it is our child") {
            if !status.success() {
                end(Signal::INT);
            }
            return status.success();
        }
        if since.elapsed() > WATCHDOG {
            end(Signal::KILL);
            child.wait().expect("it is our child");
            return false;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Returns the modules imported by a Python block, by their first names.
fn imports(text: &str) -> impl Iterator<Item = &str> {
    let lines = text.lines().filter_map(|line| {
        let names = line.strip_prefix("import ");
        names.or_else(|| line.strip_prefix("from ")?.split(" import").next())
    });
    let names = lines.flat_map(|names| names.split(','));
    names.filter_map(|name| name.trim().split(['.', ' ']).next())
}

/// Returns the command and the exit codes named by the comment after it, as a pattern: `0|1`.
fn exit_codes(command: &str) -> Option<(&str, String)> {
    let (does, comment) = command
        .rsplit_once(" # ")
        .or_else(|| command.rsplit_once("  #"))?;
    let (_, codes) = comment.split_once("exit code ")?;
    let end = codes.find(|c: char| !c.is_ascii_digit() && !" or".contains(c));
    let codes = &codes[..end.unwrap_or(codes.len())];
    Some((does, codes.trim().replace(" or ", "|")))
}

/// Wraps commands so that one with a comment `exit code 1` must end that way; any other must succeed.
fn with_exit_codes(text: &str) -> String {
    let mut script = String::new();
    let mut command = String::new();
    for line in text.lines() {
        command += line;
        command.push('\n');
        if line.ends_with('\\') {
            continue;
        }
        match exit_codes(&command) {
            Some((does, codes)) => {
                script += &format!("code=0\n{{ {does}\n}} || code=$?\n");
                script += &format!(
                    "case $code in {codes}) ;; *) echo \"exit code $code\"; false ;; esac\n"
                );
            }
            None => script += &command,
        }
        command.clear();
    }
    script + &command
}

fn copy(from: &Path, to: &Path) {
    if from.is_dir() {
        std::fs::create_dir_all(to).expect("a folder");
        for file in std::fs::read_dir(from).expect("a folder") {
            let file = file.expect("a file");
            if file.file_name() != "target" {
                copy(&file.path(), &to.join(file.file_name()));
            }
        }
    } else {
        std::fs::copy(from, to).expect("a file");
    }
}

#[test]
fn imported_python_modules_are_found() {
    let text = "import json, pyarrow.parquet\nimport numpy as np\nfrom mcap.reader import x\n";
    let entries: Vec<&str> = imports(text).collect();
    assert_eq!(entries, ["json", "pyarrow", "numpy", "mcap"]);
}

#[test]
fn a_command_must_have_the_exit_code_in_its_comment() {
    for (commands, passes) in [
        ("true", true),
        ("false", false),
        ("false # exit code 1", true),
        ("false # it fails: exit code 1", true),
        ("false   # exit code 1: it fails", true),
        ("true # exit code 1", false),
        ("true # exit code 0 or 1", true),
        ("sh -c 'exit 2' # exit code 0 or 1", false),
        ("sh -c \\\n 'exit 2' # exit code 2\ntrue", true),
    ] {
        let script = format!("set -euo pipefail\n{}", with_exit_codes(commands));
        let mut bash = Command::new("bash");
        bash.arg("-c").arg(script).stdout(Stdio::null());
        assert_eq!(finish(&mut bash), passes, "{commands}");
    }
}
