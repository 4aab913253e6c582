//! Checks of this user's permissions: real-time priority and locked memory.

use super::checks::{LOCKED_MEMORY, PRIORITY};
use super::finding::Finding;
use super::tree::Tree;

/// Number of the capability to raise priorities, `CAP_SYS_NICE`.
const SYS_NICE: u32 = 23;
/// Number of the capability to lock memory, `CAP_IPC_LOCK`.
const IPC_LOCK: u32 = 14;

/// Command that sets both limits, because a user who needs one needs the other.
pub const LIMITS: &str = "printf '%s - rtprio 98\\n%s - memlock unlimited\\n' \"$USER\" \"$USER\" | \
    sudo tee /etc/security/limits.d/95-hil.conf # then log in again";

/// Checks the right to use real-time priority.
pub(crate) fn priority(tree: &dyn Tree) -> Finding {
    if has_capability(tree, SYS_NICE) {
        return PRIORITY.good("any (CAP_SYS_NICE)");
    }
    match soft_limit(tree, "Max realtime priority") {
        Err(missing) => PRIORITY.unknown(missing),
        Ok(limit) if limit == "0" => PRIORITY.poor("none allowed").mend(LIMITS),
        Ok(limit) => PRIORITY.good(format!("up to {limit}")),
    }
}

/// Checks the amount of memory that this user may lock.
pub(crate) fn locked_memory(tree: &dyn Tree) -> Finding {
    if has_capability(tree, IPC_LOCK) {
        return LOCKED_MEMORY.good("any amount (CAP_IPC_LOCK)");
    }
    match soft_limit(tree, "Max locked memory") {
        Err(missing) => LOCKED_MEMORY.unknown(missing),
        Ok(limit) if limit == "unlimited" => LOCKED_MEMORY.good("any amount"),
        Ok(limit) => LOCKED_MEMORY
            .fair(format!("at most {limit} bytes"))
            .mend(LIMITS),
    }
}

/// Returns a soft limit from `/proc/self/limits`.
fn soft_limit(tree: &dyn Tree, name: &str) -> Result<String, String> {
    let limits = (tree.read("proc/self/limits")).map_err(|unread| unread.to_string())?;
    let row = limits.lines().find_map(|line| line.strip_prefix(name));
    let limit = row.and_then(|row| row.split_ascii_whitespace().next());
    limit
        .map(str::to_owned)
        .ok_or_else(|| format!("/proc/self/limits has no `{name}`"))
}

/// Returns `true` if this process has a capability that is valid for the whole machine.
fn has_capability(tree: &dyn Tree, number: u32) -> bool {
    // A process in its own user namespace has all capabilities, none of which is valid outside.
    let whole_machine = tree.read("proc/self/uid_map").is_ok_and(|map| {
        let fields: Vec<&str> = map.split_ascii_whitespace().collect();
        fields == ["0", "0", "4294967295"]
    });
    let status = tree.read("proc/self/status").unwrap_or_default();
    let mask = (status.lines()).find_map(|line| line.strip_prefix("CapEff:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    whole_machine && mask.is_some_and(|mask| mask >> number & 1 == 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Grade;
    use crate::tree::Fake;

    /// Creates a process with these capabilities and limits, in the kernel's format.
    fn process(capabilities: &str, memory: &str, priority: &str) -> Fake {
        let limits = format!(
            "Limit                     Soft Limit           Hard Limit           Units     \n\
             Max resident set          unlimited            unlimited            bytes     \n\
             Max locked memory         {memory:<20} unlimited            bytes     \n\
             Max nice priority         0                    0                    \n\
             Max realtime priority     {priority:<20} 99                   \n"
        );
        let status = format!("Name:\thil\nCapPrm:\t000001ffffffffff\nCapEff:\t{capabilities}\n");
        Fake::new(&[
            ("proc/self/limits", limits.as_str()),
            ("proc/self/status", &status),
            ("proc/self/uid_map", "         0          0 4294967295\n"),
        ])
    }

    #[test]
    fn rights_come_from_limits_or_capabilities() {
        let (none, all) = ("0000000000000000", "000001ffffffffff");
        for (capabilities, memory, priority_limit, grades) in [
            (none, "8388608", "0", (Grade::Poor, Grade::Fair)),
            (none, "unlimited", "98", (Grade::Good, Grade::Good)),
            (all, "8388608", "0", (Grade::Good, Grade::Good)),
            // Only CAP_SYS_NICE, only CAP_IPC_LOCK.
            ("0000000000800000", "65536", "0", (Grade::Good, Grade::Fair)),
            ("0000000000004000", "65536", "0", (Grade::Poor, Grade::Good)),
        ] {
            let process = process(capabilities, memory, priority_limit);
            let findings = (priority(&process), locked_memory(&process));
            assert_eq!(
                (findings.0.grade, findings.1.grade),
                grades,
                "{capabilities}"
            );
            assert_eq!(findings.0.mend.is_some(), grades.0 == Grade::Poor);
            assert_eq!(findings.1.mend.is_some(), grades.1 == Grade::Fair);
        }
    }

    #[test]
    fn the_root_of_a_user_namespace_has_no_rights_outside() {
        let container = process("000001ffffffffff", "8388608", "0")
            .with(&[("proc/self/uid_map", "         0       1000          1\n")]);
        assert_eq!(priority(&container).grade, Grade::Poor);
        assert_eq!(locked_memory(&container).grade, Grade::Fair);
    }

    #[test]
    fn limits_that_cannot_be_read_are_unknown() {
        assert_eq!(priority(&Fake::default()).grade, Grade::Unknown);
        let other = Fake::new(&[("proc/self/limits", "Limit  Soft Limit\n")]);
        let finding = locked_memory(&other);
        assert_eq!(finding.grade, Grade::Unknown);
        assert_eq!(
            finding.found,
            "/proc/self/limits has no `Max locked memory`"
        );
    }
}
