//! The Debian package, unpacked into a root that has nothing else but the C library.

use std::path::Path;

use crate::support::harness::Rig;
use crate::support::programs::{program, shipped, skip, works, workspace};
use crate::support::python::succeeds;

/// Mounts what a kernel provides, then runs `hil` in the root: `ROOT ARGUMENTS..`.
const ENTER: &str = r#"
root=$0
mount -t proc proc "$root/proc"
mount -t tmpfs tmpfs "$root/dev/shm"
for device in null urandom; do
    touch "$root/dev/$device"
    mount --bind "/dev/$device" "$root/dev/$device"
done
exec chroot "$root" /usr/bin/hil "$@"
"#;

#[test]
fn the_debian_package_runs_the_scenario_of_the_readme_in_a_bare_root() {
    if !works(&["dpkg-deb", "--version"]) {
        return skip("dpkg-deb is missing", "HIL_TEST_UNSHARE");
    }
    if !works(&["unshare", "-m", "mount", "-t", "tmpfs", "tmpfs", "/dev/shm"]) {
        let why = "this user may not mount file systems";
        return skip(why, "HIL_TEST_UNSHARE");
    }
    let rig = Rig::new();
    let programs = program("hil");
    let out = rig.path("packages");
    let mut build = rig.command(workspace().join("tools/debian/build"));
    // The default compressor takes minutes beside other tests.
    build
        .env("DPKG_DEB_COMPRESSOR_TYPE", "gzip")
        .env("DPKG_DEB_COMPRESSOR_LEVEL", "1")
        .arg("--programs")
        .arg(programs.parent().expect("a folder"));
    succeeds(build.arg("--out").arg(&out));
    let package = (std::fs::read_dir(&out).expect("a folder").next())
        .expect("a package")
        .expect("a file")
        .path();

    let root = rig.path("a root");
    succeeds(rig.command("dpkg-deb").arg("-x").arg(&package).arg(&root));
    for folder in ["proc", "dev/shm", "tmp"] {
        std::fs::create_dir_all(root.join(folder)).expect("a folder");
    }
    copy_libraries(&rig, &programs, &root);
    std::fs::write(
        root.join("severe-leakage.toml"),
        shipped("scenarios/severe-leakage.toml"),
    )
    .expect("the scenario");
    let hil = |arguments: &[&str]| {
        let mut unshare = rig.command("unshare");
        unshare.args(["--mount", "--pid", "--fork", "sh", "-euc", ENTER]);
        succeeds(unshare.arg(&root).args(arguments))
    };
    let output = hil(&["run", "/severe-leakage.toml", "--out", "/tmp/run"]);
    let readme = shipped("README.md");
    let digest = readme
        .lines()
        .find(|line| line.trim().starts_with("digest "));
    assert!(output.contains(digest.expect("a digest")), "{output}");

    let share = root.join("usr/share");
    for page in [
        "man1/hil.1.gz",
        "man1/hil-run.1.gz",
        "man1/hil-campaign.1.gz",
    ] {
        let page = share.join("man").join(page);
        let text = succeeds(rig.command("gzip").arg("-dc").arg(&page));
        assert!(text.contains("Usage: hil"), "{}: {text}", page.display());
    }
    let bash = share.join("bash-completion/completions/hil");
    let bash = std::fs::read_to_string(bash).expect("completions");
    assert!(bash.contains(" hil -- "), "by name: {bash}");
}

/// Copies the shared libraries of a program to the same places below another root.
fn copy_libraries(rig: &Rig, program: &Path, root: &Path) {
    let listing = succeeds(rig.command("ldd").arg(program));
    let libraries = listing
        .split_ascii_whitespace()
        .filter(|word| word.starts_with('/'));
    for library in libraries {
        let copy = root.join(library.trim_start_matches('/'));
        std::fs::create_dir_all(copy.parent().expect("a folder")).expect("a folder");
        std::fs::copy(library, copy).expect("a library");
    }
}
