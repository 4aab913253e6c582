//! The laws built for another processor.

use std::process::Command;

use crate::support::harness::{Rig, text};
use crate::support::programs::{self, skip, works, workspace};

/// Builds the three laws for the paper's plant from the same source for another processor: arithmetic and layout
/// are the same. An emulator keeps this machine's memory order, so nothing is proved about a weaker one.
pub(super) fn on_another_processor(scenario: &str) {
    const TRIPLE: &str = "aarch64-unknown-linux-musl";
    let installed = Command::new("rustup")
        .args(["target", "list", "--installed"])
        .output();
    let has_target =
        installed.is_ok_and(|entry| String::from_utf8_lossy(&entry.stdout).contains(TRIPLE));
    if !has_target || !works(&["qemu-aarch64-static", "--version"]) {
        return skip(
            "rustup has no target for aarch64, or qemu-user is missing",
            "HIL_TEST_AARCH64",
        );
    }
    // In its own folder, because `hil` takes agents from beside the other programs. Dependencies are shared: macros
    // and build scripts exist already if programs of this machine were built with that profile.
    let target = programs::target().join("other-processor");
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args([
        "build",
        "--release",
        "--locked",
        "-p",
        "controller-process",
        "-p",
        "hil-target",
    ]);
    // Numerical code is built as for a board. The speed of the rest is irrelevant here, so it is built faster.
    for level in [
        "opt-level=1",
        "package.hil-target.opt-level=1",
        "package.controller-process.opt-level=3",
        "package.shared-types.opt-level=3",
        "package.hil-session.opt-level=3",
        "package.libm.opt-level=3",
    ] {
        cargo.args(["--config", &format!("profile.release.{level}")]);
    }
    cargo
        .args(["--target", TRIPLE, "--target-dir"])
        .arg(&target)
        .env("CARGO_BUILD_BUILD_DIR", programs::target())
        .current_dir(workspace());
    // No C compiler and no other linker: an unexpected one would fail here.
    cargo.env("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_MUSL_LINKER", "rust-lld");
    cargo.env("CC_aarch64_unknown_linux_musl", "/nonexistent/cc");
    let built = cargo.output().expect("cargo runs");
    assert!(
        built.status.success(),
        "{}",
        String::from_utf8_lossy(&built.stderr)
    );
    let rig = Rig::new();
    let program = target.join(TRIPLE).join("release/controller-process");
    let emulated = rig.script(
        "emulated",
        &format!(
            "#!/bin/sh\nexec qemu-aarch64-static '{}' \"$@\"\n",
            text(&program)
        ),
    );
    for law in ["pid", "nrsc", "ftsc"] {
        let run =
            format!("{scenario} --no-record --set requirements=[] --set controller.law={law}");
        let here = rig.run(&run).expect(0).summary();
        let there = rig
            .run(&format!("{run} --controller-bin {}", text(&emulated)))
            .expect(0)
            .summary();
        assert!(here["digest"].is_string());
        assert_eq!(there["digest"], here["digest"], "{law}");
    }
}
