//! Check of throttling: the share of a core's time that the kernel withholds from real-time work.

use hil_console::terminal::duration::shown_ns;

use super::checks::THROTTLING;
use super::cores::Cores;
use super::finding::Finding;
use super::tree::Tree;

/// Time that the kernel withholds from real-time work on a core for waiting ordinary work. The older limit applies
/// where real-time work is grouped; since Linux 6.12 a server also takes 50 ms of each second, regardless of the
/// limit.
enum FairServer {
    /// The kernel has no such server.
    Absent,
    /// Longest time that the server takes at once; 0 if the server is off.
    Takes { longest_ns: u64 },
    /// The server exists, but its setting cannot be read.
    Unread,
}

impl FairServer {
    const FOLDER: &str = "sys/kernel/debug/sched/fair_server";

    fn of(tree: &dyn Tree, cores: &Cores) -> Self {
        if !tree.has(Self::FOLDER) {
            let version = tree.read("proc/version").unwrap_or_default();
            return match release(&version) {
                Some(release) if release < (6, 12) => Self::Absent,
                _ => Self::Unread,
            };
        }
        let mut longest_ns = 0;
        for file in Self::files(cores) {
            match tree.read(&file).ok().and_then(|text| text.parse().ok()) {
                Some(ns) if ns > longest_ns => longest_ns = ns,
                Some(_) => {}
                None => return Self::Unread,
            }
        }
        Self::Takes { longest_ns }
    }

    fn files(cores: &Cores) -> Vec<String> {
        let file = |core| format!("{}/cpu{core}/runtime", Self::FOLDER);
        cores.chosen.iter().map(file).collect()
    }
}

/// Parses the major and minor version from `/proc/version`.
fn release(version: &str) -> Option<(u32, u32)> {
    let mut numbers = version.split_ascii_whitespace().nth(2)?.split(['.', '-']);
    let mut next = || numbers.next()?.parse().ok();
    Some((next()?, next()?))
}

/// Checks whether real-time work that never sleeps is interrupted for a part of each second.
pub(crate) fn throttling(tree: &dyn Tree, cores: &Cores) -> Finding {
    let number = |name: &str| tree.read(&format!("proc/sys/kernel/{name}"));
    let (runtime, period) = match (number("sched_rt_runtime_us"), number("sched_rt_period_us")) {
        (Ok(runtime), Ok(period)) => (runtime, period),
        (Err(unread), _) | (_, Err(unread)) => return THROTTLING.unread(&unread),
    };
    let (Ok(runtime_us), Ok(period_us)) = (runtime.parse::<i64>(), period.parse::<i64>()) else {
        return THROTTLING.unknown(format!("{runtime} of {period} us"));
    };
    let mut parts = vec!["no limit".to_owned()];
    let mut mend = Vec::new();
    if (0..period_us).contains(&runtime_us) {
        parts[0] = format!("at most {runtime_us} of {period_us} us");
        mend.push("sysctl -w kernel.sched_rt_runtime_us=-1".to_owned());
    }
    let server = FairServer::of(tree, cores);
    match server {
        FairServer::Takes { longest_ns: 0 } => parts.push("fair server off".into()),
        FairServer::Takes { longest_ns } => {
            parts.push(format!("fair server takes {}", shown_ns(longest_ns)));
            let files = FairServer::files(cores);
            mend.push(format!("echo 0 | tee /{}", files.join(" /")));
        }
        FairServer::Unread => parts.push("fair server cannot be read".into()),
        FairServer::Absent => {}
    }
    let text = parts.join("; ");
    let mend_all = format!("sudo sh -c '{}'", mend.join("; "));
    match server {
        _ if runtime_us == 0 => THROTTLING.poor(text).mend(mend_all),
        _ if !mend.is_empty() => THROTTLING.fair(text).mend(mend_all),
        FairServer::Unread => THROTTLING.unknown(text).mend(format!(
            "sudo sh -c 'mount -t debugfs none /sys/kernel/debug; grep . /{}/cpu*/runtime'",
            FairServer::FOLDER
        )),
        _ => THROTTLING.good(text),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Grade;
    use crate::tree::Fake;

    #[test]
    fn neither_throttling_mechanism_may_limit_real_time_work() {
        let sysctl = "sysctl -w kernel.sched_rt_runtime_us=-1";
        let server = "echo 0 | tee /sys/kernel/debug/sched/fair_server/cpu2/runtime \
            /sys/kernel/debug/sched/fair_server/cpu3/runtime";
        let look = "mount -t debugfs none /sys/kernel/debug; \
            grep . /sys/kernel/debug/sched/fair_server/cpu*/runtime";
        let (old, new) = ("Linux version 6.11.9 x", "Linux version 6.12.0-rt1 x");
        #[rustfmt::skip] // a table
        let cases = [
            (old, "-1", None, Grade::Good, vec![]),
            (old, "1000000", None, Grade::Good, vec![]),
            (old, "950000", None, Grade::Fair, vec![sysctl]),
            (old, "0", None, Grade::Poor, vec![sysctl]),
            (old, "many", None, Grade::Unknown, vec![]),
            (new, "-1", None, Grade::Unknown, vec![look]),
            (new, "950000", None, Grade::Fair, vec![sysctl]),
            (new, "-1", Some(["50000000", "50000000"]), Grade::Fair, vec![server]),
            (new, "-1", Some(["0", "50000000"]), Grade::Fair, vec![server]),
            (new, "950000", Some(["50000000", "50000000"]), Grade::Fair, vec![sysctl, server]),
            (new, "-1", Some(["0", "0"]), Grade::Good, vec![]),
            // An old vendor kernel may contain the server as well.
            (old, "-1", Some(["50000000", "0"]), Grade::Fair, vec![server]),
        ];
        let cores = Cores::of("0-3", "2-3");
        for (version, runtime, servers, grade, mend) in cases {
            let mut machine = Fake::new(&[
                ("proc/version", version),
                ("proc/sys/kernel/sched_rt_runtime_us", runtime),
                ("proc/sys/kernel/sched_rt_period_us", "1000000\n"),
            ]);
            for (core, ns) in [2, 3].into_iter().zip(servers.into_iter().flatten()) {
                let file = format!("sys/kernel/debug/sched/fair_server/cpu{core}/runtime");
                machine = machine.with(&[(file.as_str(), ns)]);
            }
            let finding = throttling(&machine, &cores);
            assert_eq!(finding.grade, grade, "{version} {runtime} {servers:?}");
            let mend = (!mend.is_empty()).then(|| format!("sudo sh -c '{}'", mend.join("; ")));
            assert_eq!(finding.mend, mend, "{version} {runtime} {servers:?}");
        }
        assert_eq!(throttling(&Fake::default(), &cores).grade, Grade::Unknown);
    }
}
