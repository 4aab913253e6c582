//! Checks of power saving that costs time: variable clock rates and deep sleep states.

use super::boot;
use super::checks::{GOVERNOR, IDLE_STATES};
use super::cores::Cores;
use super::finding::{Finding, Grade, known};
use super::measure::jitter_grade;
use super::tree::Tree;

/// Checks the frequency governor of the chosen cores.
pub(crate) fn governor(tree: &dyn Tree, cores: &Cores) -> Finding {
    let folder = |core: u32| format!("sys/devices/system/cpu/cpu{core}/cpufreq");
    let mut governors = Vec::new();
    let mut grade = Grade::Good;
    for core in cores.chosen.iter() {
        let folder = folder(core);
        if !tree.has(&folder) {
            return GOVERNOR.unknown("no frequency driver: firmware or a host decides");
        }
        let name = known!(GOVERNOR, tree.read(&format!("{folder}/scaling_governor")));
        let driver = tree.read(&format!("{folder}/scaling_driver"));
        grade = worse(grade, graded(&name, driver.as_deref().unwrap_or_default()));
        if !governors.contains(&name) {
            governors.push(name);
        }
    }
    let finding = GOVERNOR.graded(grade, governors.join(", "));
    if grade == Grade::Good {
        return finding;
    }
    let files: Vec<String> = (cores.chosen.iter())
        .map(|core| format!("/{}/scaling_governor", folder(core)))
        .collect();
    finding.mend(format!("echo performance | sudo tee {}", files.join(" ")))
}

fn graded(governor: &str, driver: &str) -> Grade {
    match (governor, driver) {
        ("performance", _) => Grade::Good,
        // With these drivers the processor chooses the rate; it is not fixed at a low one.
        ("powersave", "intel_pstate" | "amd-pstate-epp") => Grade::Fair,
        ("powersave" | "userspace", _) => Grade::Poor,
        ("schedutil" | "ondemand" | "conservative", _) => Grade::Fair,
        _ => Grade::Unknown,
    }
}

fn worse(a: Grade, b: Grade) -> Grade {
    let order = [Grade::Good, Grade::Fair, Grade::Unknown, Grade::Poor];
    let place = |grade| order.iter().position(|one| *one == grade);
    if place(a) >= place(b) { a } else { b }
}

/// Idle state that a core may enter.
struct IdleState {
    name: String,
    exit_us: u64,
    disable: String,
}

/// Checks the exit latency of the deepest idle state of the chosen cores.
pub(crate) fn idle_states(tree: &dyn Tree, cores: &Cores) -> Finding {
    let command_line = tree.read("proc/cmdline").unwrap_or_default();
    if boot::argument(&command_line, "idle") == Some("poll") {
        return IDLE_STATES.good("idle=poll: the cores never sleep");
    }
    let mut states = Vec::new();
    for core in cores.chosen.iter() {
        let of_core = enabled_states(tree, core);
        if of_core.is_empty() {
            let driver = tree.read("sys/devices/system/cpu/cpuidle/current_driver");
            let driver = driver.unwrap_or_else(|_| "none".into());
            return IDLE_STATES.unknown(format!(
                "core {core} reports no states (driver {driver}): firmware or a host decides"
            ));
        }
        states.extend(of_core);
    }
    let Some(deepest) = states.iter().max_by_key(|state| state.exit_us) else {
        return IDLE_STATES.unknown("no cores");
    };
    let grade = jitter_grade(deepest.exit_us.saturating_mul(1000));
    let text = format!("{} takes {} us to leave", deepest.name, deepest.exit_us);
    let finding = IDLE_STATES.graded(grade, text);
    if grade == Grade::Good {
        return finding;
    }
    let deep: Vec<String> = (states.iter())
        .filter(|state| jitter_grade(state.exit_us.saturating_mul(1000)) != Grade::Good)
        .map(|state| format!("/{}", state.disable))
        .collect();
    finding.mend(format!("echo 1 | sudo tee {}", deep.join(" ")))
}

fn enabled_states(tree: &dyn Tree, core: u32) -> Vec<IdleState> {
    let folder = format!("sys/devices/system/cpu/cpu{core}/cpuidle");
    let state = |name: &String| {
        let read = |file: &str| tree.read(&format!("{folder}/{name}/{file}"));
        let enabled = read("disable").is_ok_and(|disable| disable == "0");
        enabled.then_some(IdleState {
            name: read("name").ok()?,
            exit_us: read("latency").ok()?.parse().ok()?,
            disable: format!("{folder}/{name}/disable"),
        })
    };
    tree.names(&folder).iter().filter_map(state).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tree::Fake;

    #[test]
    fn only_the_performance_governor_is_good() {
        for (governor2, governor3, driver, grade) in [
            ("performance", "performance", "intel_pstate", Grade::Good),
            ("performance", "schedutil", "acpi-cpufreq", Grade::Fair),
            ("powersave", "powersave", "intel_pstate", Grade::Fair),
            ("powersave", "powersave", "amd-pstate-epp", Grade::Fair),
            ("ondemand", "powersave", "acpi-cpufreq", Grade::Poor),
            ("performance", "interactive", "msm", Grade::Unknown),
        ] {
            let folder = "sys/devices/system/cpu/cpu";
            let machine = Fake::new(&[
                (format!("{folder}2/cpufreq/scaling_governor"), governor2),
                (format!("{folder}3/cpufreq/scaling_governor"), governor3),
                (format!("{folder}2/cpufreq/scaling_driver"), driver),
                (format!("{folder}3/cpufreq/scaling_driver"), driver),
            ]);
            let finding = governor(&machine, &Cores::of("0-3", "2-3"));
            assert_eq!(finding.grade, grade, "{governor2} {governor3} {driver}");
            let mend = "echo performance | sudo tee \
                /sys/devices/system/cpu/cpu2/cpufreq/scaling_governor \
                /sys/devices/system/cpu/cpu3/cpufreq/scaling_governor";
            let expected = (grade != Grade::Good).then_some(mend);
            assert_eq!(finding.mend.as_deref(), expected);
        }
        let without = governor(&Fake::default(), &Cores::of("0-3", "2-3"));
        assert_eq!(without.grade, Grade::Unknown);
    }

    /// Idle states of a laptop core, as reported by `intel_idle`.
    fn laptop(disabled: &[&str]) -> Fake {
        let states = [("POLL", 0), ("C1E", 10), ("C3", 40), ("C10", 890)];
        let mut files = Vec::new();
        for (index, (name, latency)) in states.iter().enumerate() {
            let folder = format!("sys/devices/system/cpu/cpu3/cpuidle/state{index}");
            let disable = u8::from(disabled.contains(name)).to_string();
            files.push((format!("{folder}/name"), (*name).to_owned()));
            files.push((format!("{folder}/latency"), latency.to_string()));
            files.push((format!("{folder}/disable"), disable));
        }
        Fake::new(&files)
    }

    #[test]
    fn the_deepest_enabled_state_decides_and_the_deep_ones_are_switched_off() {
        let file = |state| format!("/sys/devices/system/cpu/cpu3/cpuidle/state{state}/disable");
        for (disabled, grade, expected, mend) in [
            (
                vec![],
                Grade::Poor,
                "C10 takes 890 us to leave",
                Some(format!("echo 1 | sudo tee {} {}", file(2), file(3))),
            ),
            (
                vec!["C10"],
                Grade::Fair,
                "C3 takes 40 us to leave",
                Some(format!("echo 1 | sudo tee {}", file(2))),
            ),
            (
                vec!["C10", "C3"],
                Grade::Good,
                "C1E takes 10 us to leave",
                None,
            ),
        ] {
            let finding = idle_states(&laptop(&disabled), &Cores::of("0-3", "3"));
            assert_eq!((finding.grade, finding.found.as_str()), (grade, expected));
            assert_eq!(finding.mend, mend);
        }
    }

    #[test]
    fn cores_without_reported_states_are_unknown() {
        let machine = Fake::new(&[("sys/devices/system/cpu/cpuidle/current_driver", "none")]);
        let finding = idle_states(&machine, &Cores::of("0-3", "2-3"));
        assert_eq!(finding.grade, Grade::Unknown);
        let polling = machine.with(&[("proc/cmdline", "quiet idle=poll")]);
        assert_eq!(
            idle_states(&polling, &Cores::of("0-3", "2-3")).grade,
            Grade::Good
        );
    }
}
