//! Checks of the kernel: its preemption model, and its clock source.

use super::boot;
use super::checks::{CLOCK_SOURCE, PREEMPTION};
use super::finding::{Finding, known};
use super::tree::Tree;

/// Preemption model with which a kernel was built, according to `/proc/version`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Build {
    RealTime,
    Dynamic,
    Full,
    Other,
}

impl Build {
    fn of(version: &str) -> Self {
        if version.contains("PREEMPT_RT") || version.contains("PREEMPT RT") {
            Self::RealTime
        } else if version.contains("PREEMPT_DYNAMIC") {
            Self::Dynamic
        } else if version.split_ascii_whitespace().any(|w| w == "PREEMPT") {
            Self::Full
        } else {
            Self::Other
        }
    }
}

/// Checks the kernel's preemption model.
pub(crate) fn preemption(tree: &dyn Tree) -> Finding {
    /// File with the preemption mode of a dynamic kernel, readable and writable.
    const MODE: &str = "sys/kernel/debug/sched/preempt";
    let version = known!(PREEMPTION, tree.read("proc/version"));
    let release = version.split_ascii_whitespace().nth(2).unwrap_or("?");
    let description = |what: &str| format!("Linux {release}, {what}");
    let real_time = tree.read("sys/kernel/realtime").is_ok_and(|one| one == "1");
    match Build::of(&version) {
        _ if real_time => PREEMPTION.good(description("PREEMPT_RT")),
        Build::RealTime => PREEMPTION.good(description("PREEMPT_RT")),
        Build::Full => PREEMPTION
            .fair(description("preemptible, not PREEMPT_RT"))
            .mend_if(real_time_kernel(tree)),
        Build::Other => PREEMPTION
            .poor(description("not preemptible"))
            .mend_if(real_time_kernel(tree)),
        Build::Dynamic => match mode(tree.read(MODE).ok(), tree, release) {
            Some(mode) if mode == "full" || mode == "lazy" => PREEMPTION
                .fair(description(&format!("preemption {mode}, not PREEMPT_RT")))
                .mend_if(real_time_kernel(tree)),
            Some(mode) => PREEMPTION
                .poor(description(&format!("preemption {mode}")))
                .mend(format!("echo full | sudo tee /{MODE}")),
            None => PREEMPTION
                .unknown(description(&format!("/{MODE} cannot be read")))
                .mend(format!(
                    "sudo sh -c 'mount -t debugfs none /sys/kernel/debug; cat /{MODE}'"
                )),
        },
    }
}

/// Returns the mode of a dynamic kernel: from its own file, or else from its command line or build configuration.
fn mode(file_text: Option<String>, tree: &dyn Tree, release: &str) -> Option<String> {
    if let Some(text) = file_text {
        let (_, rest) = text.split_once('(')?;
        return rest.split_once(')').map(|(mode, _)| mode.to_owned());
    }
    let command_line = tree.read("proc/cmdline").unwrap_or_default();
    if let Some(mode) = boot::argument(&command_line, "preempt") {
        return Some(mode.to_owned());
    }
    let files = [
        format!("boot/config-{release}"),
        format!("lib/modules/{release}/config"),
    ];
    let config = files.iter().find_map(|path| tree.read(path).ok())?;
    let set = |option: &str| config.lines().any(|line| line == option);
    let modes = [
        ("CONFIG_PREEMPT_NONE=y", "none"),
        ("CONFIG_PREEMPT_VOLUNTARY=y", "voluntary"),
        ("CONFIG_PREEMPT_LAZY=y", "lazy"),
        ("CONFIG_PREEMPT=y", "full"),
    ];
    let (_, mode) = modes.iter().find(|(option, _)| set(option))?;
    Some((*mode).to_owned())
}

/// Returns the command that installs a PREEMPT_RT kernel, for distributions that have one.
fn real_time_kernel(tree: &dyn Tree) -> Option<String> {
    let release = tree.read("etc/os-release").ok()?;
    let id = release.lines().find_map(|line| line.strip_prefix("ID="))?;
    let command = match id.trim_matches('"') {
        "debian" => "sudo apt install linux-image-rt-$(dpkg --print-architecture)",
        "ubuntu" => "sudo pro enable realtime-kernel",
        "arch" => "sudo pacman -S linux-rt",
        "rhel" | "centos" | "almalinux" | "rocky" => "sudo dnf install kernel-rt",
        "opensuse-tumbleweed" => "sudo zypper install kernel-rt",
        _ => return None,
    };
    Some(format!("{command} # then reboot"))
}

/// Checks the clock source of the kernel.
pub(crate) fn clock_source(tree: &dyn Tree) -> Finding {
    const FOLDER: &str = "sys/devices/system/clocksource/clocksource0";
    let current = known!(
        CLOCK_SOURCE,
        tree.read(&format!("{FOLDER}/current_clocksource"))
    );
    let available = tree.read(&format!("{FOLDER}/available_clocksource"));
    let counter = (available.as_deref().unwrap_or_default())
        .split_ascii_whitespace()
        .find(|name| is_counter(name));
    let mend = match counter {
        Some(name) => Some(format!(
            "echo {name} | sudo tee /{FOLDER}/current_clocksource"
        )),
        // Tells the kernel to trust the counter, if there is one.
        None => boot::add_arguments(tree, "tsc=reliable"),
    };
    match current.as_str() {
        name if is_counter(name) => CLOCK_SOURCE.good(current),
        // Counters scaled by the hypervisor; reading them needs no system call either.
        "kvm-clock" | "hyperv_clocksource_tsc_page" | "xen" => {
            CLOCK_SOURCE.fair(current).mend_if(mend)
        }
        "hpet" | "acpi_pm" | "jiffies" | "refined-jiffies" | "pit" | "hyperv_clocksource_msr" => {
            CLOCK_SOURCE.poor(current).mend_if(mend)
        }
        _ => CLOCK_SOURCE.unknown(current),
    }
}

/// Returns `true` for counters inside the processor, which programs read directly.
fn is_counter(name: &str) -> bool {
    matches!(
        name,
        "tsc" | "arch_sys_counter" | "riscv_clocksource" | "timebase"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Grade;
    use crate::tree::{Fake, Files};

    #[rustfmt::skip] // one version a line, as kernels tell them
    const VERSIONS: [(&str, Build); 7] = [
        ("Linux version 6.12.43+deb13-rt-amd64 (debian-kernel@lists.debian.org) (x86_64-linux-gnu-gcc-14 (Debian 14.2.0-19) 14.2.0) #1 SMP PREEMPT_RT Debian 6.12.43-1 (2025-08-27)", Build::RealTime),
        ("Linux version 4.19.0-rt1 (root@cnc) (gcc version 8.3.0) #1 SMP PREEMPT RT Debian 4.19.37-5 (2019-06-19)", Build::RealTime),
        ("Linux version 6.8.0-45-generic (buildd@lcy02-amd64-115) (x86_64-linux-gnu-gcc-13) #45-Ubuntu SMP PREEMPT_DYNAMIC Fri Aug 30 12:02:04 UTC 2024", Build::Dynamic),
        ("Linux version 6.6.31+rpt-rpi-v8 (serge@raspberrypi.com) (gcc-12) #1 SMP PREEMPT Debian 1:6.6.31-1+rpt1 (2024-05-29)", Build::Full),
        ("Linux version 3.10.0-1160.el7.x86_64 (mockbuild@kbuilder) (gcc version 4.8.5) #1 SMP Mon Oct 19 16:18:59 UTC 2020", Build::Other),
        ("Linux version 5.4.0-42-generic (buildd@lgw01) (gcc version 9.3.0) #46-Ubuntu SMP Fri Jul 10 00:24:02 UTC 2020", Build::Other),
        ("Linux version 5.4.0-42-preemptive (x) #1 SMP NO-PREEMPT Fri Jul 10 2020", Build::Other),
    ];

    #[test]
    fn the_version_shows_the_build_of_a_kernel() {
        for (version, build) in VERSIONS {
            assert_eq!(Build::of(version), build, "{version}");
        }
    }

    #[test]
    fn a_real_time_kernel_is_good_and_one_without_preemption_poor() {
        let grades = [
            Grade::Good,
            Grade::Good,
            Grade::Unknown,
            Grade::Fair,
            Grade::Poor,
            Grade::Poor,
            Grade::Poor,
        ];
        for ((version, _), grade) in VERSIONS.iter().zip(grades) {
            let finding = preemption(&Fake::new(&[("proc/version", *version)]));
            assert_eq!(finding.grade, grade, "{version}");
        }
        // A vendor's version text does not hide the kernel's own flag.
        let vendor = [
            ("proc/version", "Linux version 5.15.0-vendor #7 SMP"),
            ("sys/kernel/realtime", "1\n"),
        ];
        let finding = preemption(&Fake::new(&vendor));
        assert_eq!(
            (finding.grade, finding.found.as_str()),
            (Grade::Good, "Linux 5.15.0-vendor, PREEMPT_RT")
        );
    }

    #[test]
    fn the_mode_of_a_dynamic_kernel_comes_from_the_most_reliable_source() {
        let mode_file = "sys/kernel/debug/sched/preempt";
        let config = "boot/config-6.8.0-45-generic";
        #[rustfmt::skip] // a table
        let cases: [(Files, Grade, &str); 8] = [
            (&[], Grade::Unknown, "cannot be read"),
            (&[(mode_file, "none voluntary (full)"), ("proc/cmdline", "preempt=none")], Grade::Fair, "full"),
            (&[(mode_file, "(none) voluntary full")], Grade::Poor, "none"),
            (&[(mode_file, "none voluntary full (lazy)")], Grade::Fair, "lazy"),
            (&[("proc/cmdline", "ro quiet preempt=full"), (config, "CONFIG_PREEMPT_NONE=y")], Grade::Fair, "full"),
            (&[(config, "# CONFIG_PREEMPT_NONE is not set\nCONFIG_PREEMPT_VOLUNTARY=y\nCONFIG_PREEMPT_COUNT=y")], Grade::Poor, "voluntary"),
            (&[("lib/modules/6.8.0-45-generic/config", "CONFIG_PREEMPT=y")], Grade::Fair, "full"),
            (&[(config, "# CONFIG_PREEMPT is not set\nCONFIG_PREEMPT_DYNAMIC=y")], Grade::Unknown, "cannot be read"),
        ];
        for (files, grade, expected) in cases {
            let machine = Fake::new(&[("proc/version", VERSIONS[2].0)]).with(files);
            let finding = preemption(&machine);
            assert_eq!(finding.grade, grade, "{files:?}");
            assert!(finding.found.contains(expected), "{}", finding.found);
        }
        let none = Fake::new(&[("proc/version", VERSIONS[2].0), (mode_file, "(none) full")]);
        assert_eq!(
            preemption(&none).mend.as_deref(),
            Some("echo full | sudo tee /sys/kernel/debug/sched/preempt")
        );
    }

    #[test]
    fn each_distribution_has_its_own_real_time_kernel() {
        for (id, command) in [
            (
                "PRETTY_NAME=\"Debian GNU/Linux 13 (trixie)\"\nID=debian\n",
                Some("sudo apt install linux-image-rt-$(dpkg --print-architecture) # then reboot"),
            ),
            (
                "ID=\"rocky\"\nID_LIKE=\"rhel centos fedora\"",
                Some("sudo dnf install kernel-rt # then reboot"),
            ),
            ("ID=alpine", None),
        ] {
            let machine = Fake::new(&[("proc/version", VERSIONS[3].0), ("etc/os-release", id)]);
            assert_eq!(preemption(&machine).mend.as_deref(), command, "{id}");
        }
    }

    #[test]
    fn a_counter_of_the_processor_is_the_best_clock_source() {
        let folder = "sys/devices/system/clocksource/clocksource0";
        let use_tsc = format!("echo tsc | sudo tee /{folder}/current_clocksource");
        for (current, available, grade, mend) in [
            ("tsc", "tsc hpet acpi_pm", Grade::Good, None),
            ("arch_sys_counter", "arch_sys_counter", Grade::Good, None),
            (
                "kvm-clock",
                "kvm-clock tsc acpi_pm",
                Grade::Fair,
                Some(&use_tsc),
            ),
            ("hpet", "hpet acpi_pm", Grade::Poor, None),
            ("acpi_pm", "tsc acpi_pm", Grade::Poor, Some(&use_tsc)),
            ("dual_timer", "dual_timer", Grade::Unknown, None),
        ] {
            let finding = clock_source(&Fake::new(&[
                (format!("{folder}/current_clocksource"), current),
                (format!("{folder}/available_clocksource"), available),
            ]));
            assert_eq!((finding.grade, finding.found.as_str()), (grade, current));
            let expected = mend.filter(|_| grade != Grade::Good);
            assert_eq!(finding.mend.as_ref(), expected, "{current}");
        }
    }
}
