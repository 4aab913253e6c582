//! Compiler options that change numbers, and modes of the floating-point unit left behind by a callback.

use std::path::PathBuf;
use std::process::Command;

use super::deeds::{deed, misbehaving};
use super::{CLEAN, compiled, has};
use crate::support::harness::{Rig, Run};
use crate::support::programs::workspace;
use crate::support::python::succeeds;

/// Numbers of the modes that round up from step 100 on, and that flush to zero.
const ROUNDS_UP: u32 = 12;
const FLUSHES: u32 = 13;

/// Compiles a file that includes the header, to nothing or to assembly.
fn compilation(rig: &Rig, compiler: &str, options: &str, to: &str) -> Command {
    let source = rig.write(
        "sum.c",
        "#include <hil.h>\ndouble sum(const double *x, double d);\n\
         double sum(const double *x, double d) {\n  double s = 0.0;\n  \
         for (int i = 0; i < 64; i++) {\n    s += x[i] / d;\n  }\n  return s;\n}\n",
    );
    let mut command = Command::new(compiler);
    command.args([
        "-O2",
        "-std=c11",
        "-Wall",
        "-Wextra",
        "-Wpedantic",
        "-S",
        "-o",
        to,
        "-I",
    ]);
    command.arg(workspace().join("tools/foreign/include"));
    command.args(options.split_ascii_whitespace()).arg(source);
    command
}

/// Returns `true` for Clang, whose macros report less.
fn is_clang(compiler: &str) -> bool {
    let version = succeeds(Command::new(compiler).arg("--version"));
    version.to_ascii_lowercase().contains("clang")
}

#[test]
fn options_that_change_numbers_do_not_compile() {
    if !has("cc") || is_clang("cc") {
        return;
    }
    let rig = Rig::new();
    for options in [
        "-O3",
        "-fno-trapping-math",
        "-fno-math-errno",
        "-ffp-contract=off",
    ] {
        succeeds(&mut compilation(&rig, "cc", options, "/dev/null"));
    }
    let mut refused = vec![
        ("-ffast-math", "-ffast-math changes digests"),
        ("-Ofast", "-ffast-math changes digests"),
        (
            "-fassociative-math -fno-signed-zeros -fno-trapping-math",
            "-fassociative-math and",
        ),
        ("-funsafe-math-optimizations", "-fassociative-math and"),
        ("-freciprocal-math", "-freciprocal-math and"),
        ("-fno-signed-zeros", "-fno-signed-zeros changes digests"),
        ("-ffinite-math-only", "-ffinite-math-only changes digests"),
    ];
    if cfg!(target_arch = "x86_64") {
        refused.push(("-mfpmath=387", "compile for SSE2"));
    }
    for (options, reason) in refused {
        let output = compilation(&rig, "cc", options, "/dev/null").output();
        let output = output.expect("it runs");
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success(), "{options}");
        assert!(text.contains(reason), "{options}: {text}");
    }
}

#[test]
fn clang_compiles_the_same_code_under_undetectable_options() {
    if !has("clang") {
        return;
    }
    let rig = Rig::new();
    let code = |options: &str| {
        let path = rig.path("sum.s");
        let to = path.to_str().expect("text");
        succeeds(&mut compilation(&rig, "clang", options, to));
        std::fs::read_to_string(&path).expect("it was written")
    };
    let plain = code("");
    for options in [
        "-funsafe-math-optimizations",
        "-fassociative-math -fno-signed-zeros",
        "-freciprocal-math",
    ] {
        assert_eq!(code(options), plain, "{options}");
    }
}

/// Checks that a run has the digest of another, and that the log of a side and the terminal have one warning.
#[track_caller]
fn assert_restored(run: Run, digest: &str, side: &str, call: &str, mode: &str) {
    let run = run.expect(0);
    assert_eq!(run.digest(), digest, "{call}: {mode}");
    let warning = format!("warning: `{call}` left the floating-point unit at {mode}");
    let log = std::fs::read_to_string(run.folder.join(format!("{side}.log"))).expect("a log");
    assert_eq!(log.matches("warning: ").count(), 1, "{log}");
    assert!(log.contains(&warning), "`{warning}` is not in {log}");
    let line = format!("{side}: {warning}");
    assert!(
        run.stderr.contains(&line),
        "`{line}` is not in {}",
        run.stderr
    );
}

/// Returns the mode set by flushing to zero on this machine.
const fn flushing() -> &'static str {
    if cfg!(target_arch = "x86_64") {
        "flush-to-zero, denormals-are-zero"
    } else {
        "flush-to-zero"
    }
}

#[test]
fn a_mode_left_by_a_callback_is_named_and_changes_no_digest() {
    if !has("cc") {
        return;
    }
    let rig = Rig::new();
    let plant = misbehaving(&rig, "misbehaving-plant", CLEAN);
    let digest = deed(&rig, "plant", &plant, 0).expect(0).digest();
    for (number, mode) in [(ROUNDS_UP, "rounding up"), (FLUSHES, flushing())] {
        let run = deed(&rig, "plant", &plant, number);
        assert_restored(run, &digest, "plant", "measure", mode);
    }
    let controller = rig.path("misbehaving-controller");
    std::fs::copy(&plant, &controller).expect("copied");
    let digest = deed(&rig, "controller", &controller, 0).expect(0).digest();
    for (number, mode) in [(ROUNDS_UP, "rounding up"), (FLUSHES, flushing())] {
        let run = deed(&rig, "controller", &controller, number);
        assert_restored(run, &digest, "controller", "step", mode);
    }
}

/// Returns the object that sets flush-to-zero at the start of a program, as the linker adds it under -ffast-math.
fn fast_start() -> Option<PathBuf> {
    let printed = succeeds(Command::new("cc").arg("-print-file-name=crtfastmath.o"));
    let path = PathBuf::from(printed.trim());
    path.is_absolute().then_some(path)
}

#[test]
fn a_program_linked_with_fast_math_starts_in_the_default_mode() {
    if !has("cc") {
        return;
    }
    let Some(object) = fast_start() else { return };
    let rig = Rig::new();
    let plain = misbehaving(&rig, "misbehaving-plant", CLEAN);
    let digest = deed(&rig, "plant", &plain, 0).expect(0).digest();
    let object = object.to_str().expect("text");
    let source = "tests/tests/foreign/misbehaving.c";
    let plant = compiled(&rig, "cc", source, "misbehaving-fast", &[object]);
    let run = deed(&rig, "plant", &plant, 0);
    assert_restored(run, &digest, "plant", "main", flushing());
}
