//! Machines: an agent's findings about its own machine, and the type of machine for which a program was built.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use hil_session::file::hash;
use hil_session::shared_memory::{FOLDER, hindrance};
use serde::{Deserialize, Serialize};
use shared_types::text::{line_if_any, line_of};

/// Findings of an agent about its machine.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Findings {
    /// Host name of the machine.
    #[serde(deserialize_with = "line_of")]
    pub host: String,
    /// Machine type as reported by `uname -m`.
    #[serde(deserialize_with = "line_of")]
    pub machine: String,
    /// Release and version of the kernel.
    #[serde(deserialize_with = "line_of")]
    pub kernel: String,
    /// Random number of the boot, which identifies a running kernel.
    #[serde(deserialize_with = "line_of")]
    pub boot_id: String,
    /// Number of cores available to the agent.
    pub cores: u32,
    /// Highest real-time priority available to the agent.
    pub most_priority: u32,
    /// Other machine types whose programs the kernel runs in an emulator.
    #[serde(default)]
    pub emulates: Vec<String>,
    /// Free bytes in `/dev/shm`, if it exists.
    pub free_bytes: Option<u64>,
    /// Reason why no session can be created there, with the remedy; `None` if none is known.
    #[serde(default, deserialize_with = "line_if_any")]
    pub hindrance: Option<String>,
    /// Free bytes in the cache folder of an agent that stores programs.
    #[serde(default)]
    pub cache_free_bytes: Option<u64>,
    /// Hash of the agent's file; empty for a process that is not an agent.
    #[serde(default, deserialize_with = "line_of")]
    pub agent_blake3: String,
}

impl Findings {
    /// Examines this machine.
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

    /// Examines this machine as an agent, with the folder of its cached programs.
    pub(crate) fn of_agent(cache: Option<&Path>) -> Self {
        let own = std::env::current_exe().and_then(|own| hash(&own));
        Self {
            cache_free_bytes: cache.and_then(free_bytes),
            agent_blake3: own.unwrap_or_default(),
            ..Self::own()
        }
    }
}

/// Returns the free bytes in the file system of a folder, if the folder exists.
pub(crate) fn free_bytes(folder: &Path) -> Option<u64> {
    let disk = rustix::fs::statvfs(folder).ok()?;
    Some(disk.f_bavail.saturating_mul(disk.f_frsize))
}

/// Returns the machine types registered with qemu-user, in the manner of Debian's package.
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

/// Returns the highest real-time priority available to this process.
fn most_priority() -> u32 {
    if rustix::process::geteuid().is_root() {
        return 99;
    }
    let limit = rustix::process::getrlimit(rustix::process::Resource::Rtprio).current;
    limit.unwrap_or(99).min(99) as u32
}

/// Returns the machine type for which an ELF file was built, as in `uname -m`; `None` for other files such as
/// scripts.
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

/// Returns the target of `cargo build` for static programs of a machine type.
pub(crate) fn triple(machine: &str) -> Option<&'static str> {
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
    fn a_program_has_a_machine_type_and_a_script_has_none() {
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
