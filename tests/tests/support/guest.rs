//! Board with a kernel of its own: a QEMU guest with an emulated processor and a listening agent.
//!
//! Kernel and modules come from a Debian package unpacked in `target/guest` (`.ci/run`); its only files are the
//! agent, the controller, the libraries they need and a shell.

use std::fs;
use std::io::Write;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc::Receiver;

use crate::support::company::Companion;
use crate::support::harness::WATCHDOG;
use crate::support::hosts::lines;
use crate::support::programs::{program, skip, target, works};

const SHELL: &str = "/bin/busybox";
/// Modules of the network, in the order of their dependencies.
const MODULES: [&str; 8] = [
    "virtio_ring",
    "virtio",
    "virtio_pci_legacy_dev",
    "virtio_pci_modern_dev",
    "virtio_pci",
    "failover",
    "net_failover",
    "virtio_net",
];
/// Init program of the guest.
const INIT: &str = "#!/bin/busybox sh
b=/bin/busybox
$b mount -t proc proc /proc
$b mount -t devtmpfs dev /dev
$b mkdir -p /dev/shm
$b mount -t tmpfs -o mode=1777 shm /dev/shm
for m in MODULES; do [ ! -f /modules/$m.ko ] || $b insmod /modules/$m.ko; done
$b ip link set lo up
$b ip addr add 10.0.2.15/24 dev eth0
$b ip link set eth0 up
exec /hil-target serve --listen 0.0.0.0:7000 --key-file /key --allow /controller-process
";

/// Running guest; stopped when dropped.
pub(crate) struct Guest {
    _qemu: Companion,
    console: Receiver<String>,
    /// Release of its kernel.
    pub(crate) kernel: String,
    /// Arguments of `hil` that name it.
    pub(crate) target: String,
}

impl Guest {
    /// Starts it and waits until its agent listens, or reports what this machine lacks for that.
    pub(crate) fn new(folder: &Path, key: &Path) -> Option<Self> {
        let unpacked = target().join("guest");
        let kernel = first(&unpacked.join("boot"), "vmlinuz");
        let has_qemu = works(&["qemu-system-x86_64", "--version"]);
        let (Some(kernel), true, true) = (kernel, has_qemu, Path::new(SHELL).exists()) else {
            let why =
                "there is no qemu-system-x86_64, no static busybox, or no kernel in target/guest";
            skip(why, "HIL_TEST_QEMU");
            return None;
        };
        let files = folder.join("initramfs");
        fs::write(&files, initramfs(&unpacked, key)).expect("written");
        let name = kernel.file_name().expect("a file").to_string_lossy();
        let release = name.trim_start_matches("vmlinuz-").to_owned();
        let port = TcpListener::bind("127.0.0.1:0").and_then(|one| one.local_addr());
        let port = port.expect("a port").port();
        let mut qemu = Command::new("qemu-system-x86_64");
        // The processor is emulated, the network is isolated, and only this machine reaches the guest.
        qemu.args([
            "-accel",
            "tcg",
            "-cpu",
            "max",
            "-m",
            "512",
            "-nographic",
            "-no-reboot",
        ]);
        qemu.arg("-kernel").arg(kernel).arg("-initrd").arg(&files);
        qemu.args(["-append", "console=ttyS0 quiet panic=-1"]);
        qemu.arg("-nic").arg(format!(
            "user,model=virtio-net-pci,restrict=on,hostfwd=tcp:127.0.0.1:{port}-10.0.2.15:7000"
        ));
        qemu.stdin(Stdio::null()).stdout(Stdio::piped());
        let mut qemu = Companion::start(&mut qemu);
        let console = lines(qemu.stdout.take().expect("piped"));
        let mut guest = Self {
            _qemu: qemu,
            console,
            kernel: release,
            target: format!(
                "--target serve://127.0.0.1:{port} --key-file {}",
                key.display()
            ),
        };
        guest.wait_for("listening on");
        Some(guest)
    }

    fn wait_for(&mut self, what: &str) {
        let mut all = String::new();
        loop {
            // A guest prints continuously until it listens.
            let line = self.console.recv_timeout(3 * WATCHDOG);
            let line =
                line.unwrap_or_else(|_| panic!("watchdog: the guest is silent or ended\n{all}"));
            if line.contains(what) {
                return;
            }
            all.push_str(&line);
            all.push('\n');
        }
    }
}

/// Returns the first file in a folder with this prefix.
fn first(folder: &Path, name: &str) -> Option<PathBuf> {
    let mut files: Vec<PathBuf> = fs::read_dir(folder)
        .ok()?
        .flatten()
        .map(|file| file.path())
        .collect();
    files.sort();
    let is_it = |file: &PathBuf| {
        file.file_name()
            .is_some_and(|own| own.to_string_lossy().starts_with(name))
    };
    files.into_iter().find(is_it)
}

/// Returns the guest's files as the kernel unpacks them: a cpio archive in the format `newc`.
fn initramfs(unpacked: &Path, key: &Path) -> Vec<u8> {
    let mut archive = Archive::default();
    for folder in ["bin", "proc", "dev", "modules", "tmp"] {
        archive.put(folder, 0o40_755, &[], (0, 0));
    }
    archive.put("dev/console", 0o20_600, &[], (5, 1));
    archive.file(
        "init",
        0o755,
        INIT.replace("MODULES", &MODULES.join(" ")).as_bytes(),
    );
    archive.file("bin/busybox", 0o755, &fs::read(SHELL).expect("read"));
    archive.file("key", 0o600, &fs::read(key).expect("read"));
    let mut libraries = std::collections::BTreeSet::new();
    for name in ["hil-target", "controller-process"] {
        let path = program(name);
        archive.file(name, 0o755, &fs::read(&path).expect("read"));
        let listed = Command::new("ldd").arg(&path).output().expect("ldd runs");
        let listed = String::from_utf8_lossy(&listed.stdout).into_owned();
        let paths = listed
            .split_ascii_whitespace()
            .filter(|word| word.starts_with('/'));
        libraries.extend(paths.map(str::to_owned));
    }
    let mut folders = std::collections::BTreeSet::new();
    for library in &libraries {
        let path = library.trim_start_matches('/');
        for folder in Path::new(path)
            .ancestors()
            .skip(1)
            .filter(|one| *one != Path::new(""))
        {
            folders.insert(folder.to_str().expect("plain text").to_owned());
        }
    }
    // A folder sorts before its content.
    for folder in folders {
        archive.put(&folder, 0o40_755, &[], (0, 0));
    }
    for library in libraries {
        let content = fs::read(&library).expect("read");
        archive.file(library.trim_start_matches('/'), 0o755, &content);
    }
    for module in MODULES {
        let result = Command::new("find")
            .arg(unpacked.join("lib/modules"))
            .args(["-name", &format!("{module}.ko*")])
            .output();
        let result = result.expect("find runs");
        let result = String::from_utf8_lossy(&result.stdout).trim().to_owned();
        let content = match result.as_str() {
            "" => continue, // built into this kernel
            packed if packed.ends_with(".xz") => {
                let unpacked = Command::new("xz").args(["-dc", packed]).output();
                unpacked.expect("xz runs").stdout
            }
            plain => fs::read(plain).expect("read"),
        };
        archive.file(&format!("modules/{module}.ko"), 0o644, &content);
    }
    archive.put("TRAILER!!!", 0, &[], (0, 0));
    archive.bytes
}

#[derive(Default)]
struct Archive {
    bytes: Vec<u8>,
    entries: u32,
}

impl Archive {
    fn file(&mut self, name: &str, mode: u32, content: &[u8]) {
        self.put(name, 0o100_000 | mode, content, (0, 0));
    }

    fn put(&mut self, name: &str, mode: u32, content: &[u8], device: (u32, u32)) {
        self.entries += 1;
        let (size, length) = (content.len() as u32, name.len() as u32 + 1);
        let fields = [
            self.entries,
            mode,
            0,
            0,
            1,
            0,
            size,
            0,
            0,
            device.0,
            device.1,
            length,
            0,
        ];
        self.bytes.extend(b"070701");
        for field in fields {
            write!(self.bytes, "{field:08x}").expect("memory takes it");
        }
        self.bytes.extend(name.as_bytes());
        self.bytes.push(0);
        self.fill();
        self.bytes.extend(content);
        self.fill();
    }

    fn fill(&mut self) {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
    }
}
