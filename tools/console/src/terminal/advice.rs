//! Advice on errors of the operating system.
//!
//! These errors arrive from many sources, also as text: from logs of both sides, recordings and replies of sessions.
//! All of them contain the error number as formatted by Rust, which identifies them here, in the only place where `hil`
//! explains a failure.

use hil_session::shared_memory::{self, FOLDER};
use rustix::io::Errno;

/// Returns advice on the first system error in a text, unless the text already contains advice.
pub fn on(text: &str) -> Option<String> {
    let (before, number) = text.split_once("(os error ")?;
    let number: i32 = number.split_once(')')?.0.parse().ok()?;
    // Any text may contain this phrase; the kernel uses only these numbers.
    if !(1..4096).contains(&number) {
        return None;
    }
    if before.contains(FOLDER)
        && let Some(hindrance) = shared_memory::hindrance()
    {
        return Some(hindrance);
    }
    let advice = match Errno::from_raw_os_error(number) {
        Errno::PERM | Errno::ACCESS => {
            "this user lacks permission: `ls -ld` shows the owner and mode; choose another place, or have the permissions changed"
        }
        Errno::NOENT if std::env::current_dir().is_err() => {
            "the current folder was deleted; `cd` to another one"
        }
        Errno::NOENT => {
            "check the spelling; a path without a leading / is relative to the current folder"
        }
        Errno::IO => "the disk reports an error; see `sudo dmesg`, and back up the data",
        Errno::NOEXEC => {
            "it is not a program for this machine: build it here, or begin a script with `#!/..`"
        }
        Errno::AGAIN => "the limit of processes and threads is reached: `ulimit -u`, `ps x`",
        Errno::NOMEM => "the system is out of memory: `free -m`, `ulimit -v`",
        Errno::NODEV | Errno::NXIO => "there is no such device on this machine",
        Errno::NOTDIR => "a part of the path is a file where a folder should be",
        Errno::ISDIR => "the path is a folder; name a file",
        Errno::MFILE => "this process has too many files open: `ulimit -n 4096`",
        Errno::NFILE => "all processes together have too many files open: `sysctl fs.file-max`",
        Errno::TXTBSY => {
            "the program is being written or is running; try again once that has ended"
        }
        Errno::FBIG => "the file would exceed the size limit: `ulimit -f unlimited`",
        Errno::NOSPC => {
            "no space is left there: `df -h` and `df -i` show free space and inodes; free some or choose another place"
        }
        Errno::DQUOT => "your disk quota is used up: free some space or choose another place",
        Errno::ROFS => {
            "the file system is read-only: choose another place, or `sudo mount -o remount,rw` it"
        }
        Errno::NAMETOOLONG => "a name has at most 255 bytes, a path 4095: choose a shorter one",
        Errno::LOOP => "symbolic links of the path form a loop: `namei` shows them",
        Errno::ADDRINUSE => "another program already uses this port: choose another one",
        Errno::ADDRNOTAVAIL => "this machine has no such address: `ip address` lists those it has",
        Errno::STALE => "the file no longer exists on its server: open it again",
        _ => return None,
    };
    Some(advice.into())
}

/// Appends advice to a reason: on the error in the reason, or on a problem that may have caused it.
#[must_use]
pub fn behind(reason: &str) -> String {
    // Numbers in the text may have changed since.
    let remedy = |hindrance: &str| {
        hindrance
            .rsplit_once(": ")
            .map(|(_, remedy)| remedy.to_owned())
    };
    let is_new = |hindrance: &String| remedy(hindrance).is_none_or(|it| !reason.contains(&it));
    let hindrance = shared_memory::hindrance().filter(is_new);
    match on(reason).or(hindrance.map(|text| format!("{text} (a possible cause)"))) {
        Some(advice) => format!("{reason}; {advice}"),
        None => reason.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use std::io;

    use super::*;

    #[test]
    fn system_errors_come_with_advice() {
        for (number, expected) in [
            (Errno::ISDIR.raw_os_error(), "the path is a folder"),
            (Errno::ACCESS.raw_os_error(), "lacks permission"),
            (Errno::NOSPC.raw_os_error(), "df -i"),
            (Errno::ROFS.raw_os_error(), "remount,rw"),
            (Errno::MFILE.raw_os_error(), "ulimit -n"),
        ] {
            let error = io::Error::from_raw_os_error(number);
            let advice = on(&format!("cannot write x: {error}")).unwrap_or_default();
            assert!(advice.contains(expected), "{error}: {advice}");
        }
        for silent in [
            "cannot write x: it is there",
            "(os error x)",
            "(os error 99999)",
            "(os error 0)",
            "(os error -1)",
        ] {
            assert_eq!(on(silent), None, "{silent}");
        }
    }

    #[test]
    fn advice_is_appended_to_a_reason_only_once() {
        let reason = "cannot write x: No space left on device (os error 28)";
        let text = behind(reason);
        assert!(text.starts_with(reason) && text.contains("df -h"), "{text}");
    }
}
