//! Searches by other programs, which run the same scenario with `hil` and find nothing worse and nothing nearer.

use crate::support::harness::{Rig, text};
use crate::support::programs::{program, skip, workspace};
use crate::support::python::{python, succeeds};

use super::{TRUSTS, TWO, search, study};

/// Lets a program search the box of two biases, after `hil search` did.
#[track_caller]
fn judged_by(judge: &str, modules: &str) {
    let Some(python) = python(modules) else {
        return skip(&format!("no Python has {modules}"), "HIL_TEST_PYTHON");
    };
    let rig = Rig::new();
    let study = study(&rig, TRUSTS, 0.5, TWO);
    let answer = |kind: &str, code: i32| {
        let answer = search(&rig, kind, &study, kind).expect(code).stdout;
        rig.write(&format!("{kind}.json"), &answer)
    };
    let answers = [answer("smallest", 0), answer("worst", 1)];
    let mut command = rig.command(python);
    // The runs of the script are written below its folder.
    command.current_dir(rig.path(""));
    command.arg(workspace().join("tests/python/judge_search.py"));
    command.arg(judge).arg(program("hil"));
    command.arg(rig.path("scenario.toml"));
    command.args(answers.iter().map(|path| text(path)));
    println!("{}", succeeds(&mut command));
}

#[test]
fn cma_finds_no_case_that_is_worse() {
    judged_by("cma", "cma, numpy");
}

#[test]
fn psy_taliro_finds_no_failing_case_that_is_nearer() {
    judged_by("psy-taliro", "staliro, numpy");
}
