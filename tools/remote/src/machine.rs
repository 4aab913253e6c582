//! Machines: what the agent finds of its own, and the machine that a program was built for.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use hil_session::file::hash;
use hil_session::shared_memory::{FOLDER, hindrance};
use serde::{Deserialize, Serialize};
use shared_types::text::{line_if_any, line_of};

/// Findings of an agent about the machine that it runs on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Findings {
    /// Name of the host, as it calls itself.
    #[serde(deserialize_with = "line_of")]
    pub host: String,
    /// Type of the machine, as `uname -m` has it.
    #[serde(deserialize_with = "line_of")]
    pub machine: String,
    /// Release and version of the kernel.
    #[serde(deserialize_with = "line_of")]
    pub kernel: String,
    /// Random number of the boot: two that differ are two kernels.
    #[serde(deserialize_with = "line_of")]
    pub boot_id: String,
    /// Cores that the agent may use.
    pub cores: u32,
    /// Highest real-time priority that the agent may ask for.
    pub most_priority: u32,
    /// Other types of machines whose programs its kernel hands to an emulator.
    #[serde(default)]
    pub emulates: Vec<String>,
    /// Bytes free in `/dev/shm`, if it is there.
    pub free_bytes: Option<u64>,
    /// Hindrance that keeps a session from being made there, and the remedy; `None` if none is known.
    #[serde(default, deserialize_with = "line_if_any")]
    pub hindrance: Option<String>,
    /// Bytes free in the folder of programs, of an agent that takes any.
    #[serde(default)]
    pub cache_free_bytes: Option<u64>,
    /// Hash of the agent's file; empty for who is no agent.
    #[serde(default, deserialize_with = "line_of")]
    pub agent_blake3: String,
}

impl Findings {
    /// Looks at this machine.
    #[must_use]
    pub fn own() -> Self {
        let host = rustix::system::uname();
        let text = |text: &std::ffi::CStr| text.to_string_lossy().into_owned();
        let boot_id =
            std::fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
        Self {
            host: text(host.nodename()),
            machine: text(host.machine()),
            kernel: format!("{} {}", text(host.release()), text(host.version())),
            boot_id: boot_id.trim().into(),
            cores: std::thread::available_parallelism().map_or(1, |cores| cores.get() as u32),
            most_priority: most_priority(),
            emulates: emulated(),
            free_bytes: free_bytes(Path::new(FOLDER)),
            hindrance: hindrance(),
            cache_free_bytes: None,
            agent_blake3: String::new(),
        }
    }

    /// Looks at this machine as an agent, with the folder where it keeps programs.
    #[must_use]
    pub(crate) fn of_agent(cache: Option<&Path>) -> Self {
        let own = std::env::current_exe().and_then(|own| hash(&own));
        Self {
            cache_free_bytes: cache.and_then(free_bytes),
            agent_blake3: own.unwrap_or_default(),
            ..Self::own()
        }
    }
}

/// Bytes free where a folder is, if it is there.
pub(crate) fn free_bytes(folder: &Path) -> Option<u64> {
    let disk = rustix::fs::statvfs(folder).ok()?;
    Some(disk.f_bavail.saturating_mul(disk.f_frsize))
}

/// Returns the machines that qemu-user is registered for, as Debian's package does it.
fn emulated() -> Vec<String> {
    let entries = std::fs::read_dir("/proc/sys/fs/binfmt_misc");
    let names = entries
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.file_name());
    let machine = |name: std::ffi::OsString| Some(name.to_str()?.strip_prefix("qemu-")?.to_owned());
    names.filter_map(machine).collect()
}

/// Returns the highest real-time priority that this process may have.
fn most_priority() -> u32 {
    if rustix::process::geteuid().is_root() {
        return 99;
    }
    let limit = rustix::process::getrlimit(rustix::process::Resource::Rtprio).current;
    limit.unwrap_or(99).min(99) as u32
}

/// Names the machine that an ELF file was built for as `uname -m` does; `None` if it is no ELF file, as a script is
/// none.
///
/// # Errors
/// If the file cannot be read.
pub fn built_for(program: &Path) -> io::Result<Option<String>> {
    let mut head = Vec::new();
    File::open(program)?.take(20).read_to_end(&mut head)?;
    if head.len() < 20 || !head.starts_with(b"\x7fELF") {
        return Ok(None);
    }
    let number = [head[18], head[19]];
    let machine = match head[5] {
        1 => u16::from_le_bytes(number),
        _ => u16::from_be_bytes(number),
    };
    Ok(Some(match machine {
        3 => "i686".into(),
        40 => "armv7l".into(),
        62 => "x86_64".into(),
        183 => "aarch64".into(),
        243 => "riscv64".into(),
        other => format!("machine {other}"),
    }))
}

/// Names the target of `cargo build` whose programs need nothing but a kernel of this machine.
#[must_use]
pub fn triple(machine: &str) -> Option<&'static str> {
    Some(match machine {
        "x86_64" => "x86_64-unknown-linux-musl",
        "aarch64" => "aarch64-unknown-linux-musl",
        "armv7l" => "armv7-unknown-linux-musleabihf",
        "riscv64" => "riscv64gc-unknown-linux-musl",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_tells_its_machine_and_a_script_none() {
        let own = std::env::current_exe().expect("this");
        assert_eq!(
            built_for(&own).expect("read"),
            Some(Findings::own().machine)
        );
        let folder = tempfile::tempdir().expect("a folder");
        let script = folder.path().join("script");
        std::fs::write(&script, "#!/bin/sh\nexec true\n# and so on").expect("written");
        assert_eq!(built_for(&script).expect("read"), None);
        let mut other = std::fs::read(&own).expect("read");
        (other[18], other[19]) = (183, 0);
        std::fs::write(&script, &other[..64]).expect("written");
        assert_eq!(
            built_for(&script).expect("read").as_deref(),
            Some("aarch64")
        );
    }
}
