//! Plants and laws in Python that fail during a run: each ends with its reason, and leaves nothing.

use std::path::Path;

use super::{BUILT_IN, both, has_python, side};
use crate::support::harness::{Rig, Run};

/// First line of the law's computation, before which the changes of the tests stand.
const STEP: &str = "        k_p, k_i = self.gains";
/// Last line of the law's step.
const ANSWER: &str = "        return Command(self.force_n)\n\n    def save";
/// First line of the plant's truth.
const TRUTH: &str = "        p, x, v = self.parameters, self.position_m";

/// Runs both sides of the example with lines before one of its own.
fn run_with(rig: &Rig, line: &str, before: &str, options: &str) -> Run {
    let file = side(rig, line, &format!("{before}\n{line}"));
    super::run_both(rig, Path::new(BUILT_IN), &file, options)
}

/// Runs both sides of the example with another answer of the law.
fn answer(rig: &Rig, with: &str) -> Run {
    let file = side(
        rig,
        ANSWER,
        &ANSWER.replace("return Command(self.force_n)", with),
    );
    super::run_both(rig, Path::new(BUILT_IN), &file, "")
}

#[test]
fn an_exception_loses_the_side_and_its_log_ends_with_the_traceback() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    let before = "        1 / 0 if sample.time_s > 0.5 else None";
    let run = run_with(&rig, STEP, before, "").expect(3);
    let place = "ZeroDivisionError: division by zero (side.py line ";
    for expected in ["the law failed at step 501: ", place, ", in step)"] {
        assert!(run.stderr.contains(expected), "{expected}\n{}", run.stderr);
    }
    let log = std::fs::read_to_string(run.folder.join("controller.log")).expect("a log");
    let text = log.trim_end();
    let begin = text
        .find("Traceback (most recent call last):")
        .expect("a traceback");
    let lines: Vec<&str> = text[begin..].lines().collect();
    assert!(
        lines[1].contains("side.py\", line ") && lines[1].ends_with("in step"),
        "{log}"
    );
    assert!(
        !log.contains("hil/side.py") && !log.contains("<string>"),
        "{log}"
    );

    let before = "        1 / 0 if time_s > 0.5 else None";
    let run = run_with(&rig, TRUTH, before, "").expect(3);
    let summary = run.summary();
    let reason = summary["reason"].as_str().expect("a reason");
    assert!(
        reason.starts_with("plant failed at step 501 (0.501 s): ZeroDivisionError"),
        "{reason}"
    );
    let log = std::fs::read_to_string(run.folder.join("plant.log")).expect("a log");
    assert!(log.contains("Traceback"), "{log}");
    rig.assert_nothing_left();
}

#[test]
fn a_plant_in_python_can_diverge() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    let before = "        if time_s > 0.5:\n            raise hil.Diverged(\"the rod broke\")";
    let run = run_with(&rig, TRUTH, before, "").expect(1);
    let reason = "plant diverged at step 501 (0.501 s): the rod broke";
    assert_eq!(run.summary()["reason"], reason);
    // The same range of validity as in Rust.
    let scenario = Path::new(BUILT_IN);
    let file = side(
        &rig,
        "doc=\"Position x, 0 where the spring is relaxed.\"",
        "doc=\"Position x.\"",
    );
    let limit = "--set plant.limits.position_m=[-0.005,0.005]";
    let run = super::run_both(&rig, scenario, &file, limit).expect(1);
    assert!(
        run.summary()["reason"]
            .as_str()
            .expect("text")
            .contains("position_m")
    );
}

#[test]
fn a_wrong_answer_is_refused_with_its_name() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    for (with, expected) in [
        ("pass", "`step` returned None; it must return a `Command`"),
        (
            "return self.force_n",
            "`step` returned float; it must return a `Command`",
        ),
        (
            "return Command(\"3\")",
            "`force_n` of `Command` is of the type str; it must be a float, so convert it with `float(..)`",
        ),
        (
            "return Command(True)",
            "`force_n` of `Command` is of the type bool",
        ),
        (
            "return Command([1.0])",
            "`force_n` of `Command` is of the type list",
        ),
        (
            "return Command(None)",
            "`force_n` of `Command` is None; it must be a float",
        ),
        (
            "return Command(10**400)",
            "`force_n` of `Command` is an int beyond the range of a float",
        ),
        (
            "return Command(math.nan)",
            "force_n = NaN is not a finite number",
        ),
        (
            "command = Command(self.force_n)\n        command.forse_n = 3.0\n        return command",
            "`step`: `Command` has no `forse_n`; nearest: force_n",
        ),
        (
            "return (x for x in ())",
            "`step` returned generator; it must return a `Command`",
        ),
        (
            "return Command(self.force_n) if sample.is_valid(\"positon_m\") else None",
            "has no `positon_m`; nearest: position_m",
        ),
    ] {
        let run = answer(&rig, with).expect(3);
        assert!(run.stderr.contains(expected), "{with}\n{}", run.stderr);
    }
    // An int is a number, and so is a subclass of float, as the one of numpy.
    for with in [
        "return Command(int(0))",
        "return Command(type(\"F\", (float,), {})(0.0))",
    ] {
        let run = answer(&rig, with);
        assert!(
            [Some(0), Some(1)].contains(&run.code),
            "{with}\n{}",
            run.stderr
        );
    }
    rig.assert_nothing_left();
}

#[test]
fn prints_go_to_the_log_and_change_nothing() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    let expected = rig.run(BUILT_IN).expect(0).digest();
    let before = "        if sample.time_s < 0.002:\n            print(\"spoken\", flush=True)\n            import os\n            os.write(1, b\"raw\\n\")";
    let run = run_with(&rig, STEP, before, "").expect(0);
    assert_eq!(run.digest(), expected);
    let log = std::fs::read_to_string(run.folder.join("controller.log")).expect("a log");
    assert!(log.contains("spoken") && log.contains("raw"), "{log}");
}

#[test]
fn a_side_that_ends_its_process_is_lost() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    for (before, expected) in [
        (
            "        raise SystemExit(0)",
            "SystemExit: 0 (side.py line ",
        ),
        (
            "        raise KeyboardInterrupt",
            "KeyboardInterrupt (side.py line ",
        ),
        (
            "        import os\n        os._exit(0)",
            "controller is gone at step 0",
        ),
    ] {
        let run = run_with(&rig, STEP, before, "").expect(3);
        assert!(run.stderr.contains(expected), "{before}\n{}", run.stderr);
    }
    let abort = "        import os\n        os.abort()";
    let run = run_with(&rig, TRUTH, abort, "").expect(3);
    let summary = run.summary();
    let reason = summary["reason"].as_str().expect("a reason");
    assert!(reason.contains("plant was killed by SIGABRT"), "{reason}");
    rig.assert_nothing_left();
}

#[test]
fn a_law_that_never_answers_is_named_when_the_wait_limit_expires() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    let before = "        while sample.time_s > 0.1:\n            pass";
    let run = run_with(&rig, STEP, before, "--wait-limit 1").expect(3);
    assert!(
        run.stderr.contains("controller did not answer step 101"),
        "{}",
        run.stderr
    );
    rig.assert_nothing_left();
}

#[test]
fn threads_and_children_of_a_side_neither_disturb_the_run_nor_outlive_it() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    let expected = rig.run(BUILT_IN).expect(0).digest();
    let thread = "        if sample.time_s == 0.1:\n            import threading, time\n            threading.Thread(target=time.sleep, args=(1e6,), name=\"sleeper\").start()";
    let run = run_with(&rig, STEP, thread, "").expect(0);
    assert_eq!(run.digest(), expected);
    let log = std::fs::read_to_string(run.folder.join("controller.log")).expect("a log");
    assert!(
        log.contains("note: threads are still running at the end: sleeper"),
        "{log}"
    );

    // A child that returns into the loop would answer in place of its parent.
    let fork = "        if sample.time_s == 0.1:\n            import os\n            os.fork()";
    let run = run_with(&rig, STEP, fork, "").expect(0);
    assert_eq!(run.digest(), expected);
    let log = std::fs::read_to_string(run.folder.join("controller.log")).expect("a log");
    assert!(
        log.contains("a child process that os.fork made returned from a method"),
        "{log}"
    );
    rig.assert_nothing_left();
}

#[test]
fn parameters_that_do_not_go_together_are_refused_before_the_run() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    let line = "        self.parameters = parameters\n        self.position_m =";
    let check = "        if parameters.mass_kg > 50.0:\n            raise ValueError(\"the spring holds 50 kg\")";
    let file = side(&rig, line, &format!("{check}\n{line}"));
    let words = both(Path::new(BUILT_IN), &file);
    let mut words: Vec<&str> = words.iter().map(String::as_str).collect();
    words.extend(["--set", "plant.parameters.mass_kg=51"]);
    let run = rig.hil(&words).expect(2);
    assert!(
        run.stderr.contains("the spring holds 50 kg (side.py line "),
        "{}",
        run.stderr
    );
    rig.assert_nothing_left();
}

#[test]
fn a_check_that_the_class_ends_with_success_is_no_success() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    let line = "        self.parameters = parameters\n        self.position_m =";
    let file = side(
        &rig,
        line,
        &format!("        import os\n        os._exit(0)\n{line}"),
    );
    let words = both(Path::new(BUILT_IN), &file);
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let run = rig.hil(&words).expect(2);
    let expected = "the process ended with exit code 0 during the check";
    assert!(run.stderr.contains(expected), "{}", run.stderr);
}
