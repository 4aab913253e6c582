//! Advice on refusals of the operating system.
//!
//! Its errors come from everywhere, also as text: from logs of both sides, recordings and answers of
//! sessions. All of them have the number that Rust puts behind them, and by that they are known here, in
//! the one place where `hil` tells why it failed.

use hil_session::shared_memory::{self, FOLDER};
use rustix::io::Errno;

/// Advises on the first refusal of the system in a text, unless the text has advice already.
pub fn on(told: &str) -> Option<String> {
    let (before, number) = told.split_once("(os error ")?;
    let number: i32 = number.split_once(')')?.0.parse().ok()?;
    // Any text may say so; the kernel has no other numbers.
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
            "this user may not do that: `ls -ld` shows who may; choose a place of your own, or have the rights changed"
        }
        Errno::NOENT if std::env::current_dir().is_err() => {
            "the folder that you are in was deleted: `cd` to another one"
        }
        Errno::NOENT => {
            "check the spelling; a path that does not begin with / begins at the folder that you are in"
        }
        Errno::IO => "the disk reports an error: `sudo dmesg` tells more; save what is on it",
        Errno::NOEXEC => {
            "it is no program of this machine: build it here, or begin a script with `#!/..`"
        }
        Errno::AGAIN => "the system has no process or thread left to give: `ulimit -u`, `ps x`",
        Errno::NOMEM => "the system has no memory left to give: `free -m`, `ulimit -v`",
        Errno::NODEV | Errno::NXIO => "there is no such device on this machine",
        Errno::NOTDIR => "a part of the path is a file where a folder should be",
        Errno::ISDIR => "it is a folder; name a file",
        Errno::MFILE => "this process has too many files open: `ulimit -n 4096`",
        Errno::NFILE => "all processes together have too many files open: `sysctl fs.file-max`",
        Errno::TXTBSY => "the program is being written or run: wait until it is not",
        Errno::FBIG => "the file would be larger than is allowed: `ulimit -f unlimited`",
        Errno::NOSPC => {
            "nothing more fits there: `df -h` and `df -i` show room and files; free some or choose another place"
        }
        Errno::DQUOT => "your share of the disk is used up: free some or choose another place",
        Errno::ROFS => {
            "nothing can be written there: choose another place, or `sudo mount -o remount,rw` it"
        }
        Errno::NAMETOOLONG => "a name has at most 255 bytes, a path 4095: choose a shorter one",
        Errno::LOOP => "symbolic links of the path lead in a circle: `namei` shows them",
        Errno::ADDRINUSE => "another program listens there: choose another port",
        Errno::ADDRNOTAVAIL => "this machine has no such address: `ip address` lists those it has",
        Errno::STALE => "the file is gone from the server that it was on: open it anew",
        _ => return None,
    };
    Some(advice.into())
}

/// A reason with what to do behind it: about what it says, or about what may be behind it.
#[must_use]
pub fn behind(reason: &str) -> String {
    // The numbers in it may have changed since.
    let remedy = |hindrance: &str| {
        hindrance
            .rsplit_once(": ")
            .map(|(_, remedy)| remedy.to_owned())
    };
    let is_new = |hindrance: &String| remedy(hindrance).is_none_or(|it| !reason.contains(&it));
    let known = shared_memory::hindrance().filter(is_new);
    match on(reason).or(known.map(|hindrance| format!("{hindrance} (which may be why)"))) {
        Some(advice) => format!("{reason}; {advice}"),
        None => reason.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use std::io;

    use super::*;

    #[test]
    fn what_the_system_refuses_comes_with_what_to_do() {
        for (number, told) in [
            (Errno::ISDIR.raw_os_error(), "it is a folder"),
            (Errno::ACCESS.raw_os_error(), "may not"),
            (Errno::NOSPC.raw_os_error(), "df -i"),
            (Errno::ROFS.raw_os_error(), "remount,rw"),
            (Errno::MFILE.raw_os_error(), "ulimit -n"),
        ] {
            let error = io::Error::from_raw_os_error(number);
            let advice = on(&format!("cannot write x: {error}")).unwrap_or_default();
            assert!(advice.contains(told), "{error}: {advice}");
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
    fn a_reason_keeps_its_words_and_says_nothing_twice() {
        let reason = "cannot write x: No space left on device (os error 28)";
        let told = behind(reason);
        assert!(told.starts_with(reason) && told.contains("df -h"), "{told}");
    }
}
