//! Check for a hypervisor beneath the machine, and for the time that it takes.

use super::checks::VIRTUALISATION;
use super::cores::Cores;
use super::finding::Finding;
use super::interrupts::Interval;
use super::tree::Tree;

/// Vendor and product names that identify hypervisors.
const MAKERS: [&str; 13] = [
    "QEMU",
    "KVM",
    "Amazon EC2",
    "OpenStack",
    "KubeVirt",
    "VMware",
    "VirtualBox",
    "innotek GmbH",
    "Xen",
    "Parallels",
    "BHYVE",
    "Google Compute Engine",
    "Apple Virtualization",
];

/// Stolen time of a core, in percent, above which measurements mean little.
const STOLEN_PERCENT: f64 = 1.0;

/// Checks for virtualisation, and the share of the chosen cores' time that the host took.
pub(crate) fn virtualisation(tree: &dyn Tree, cores: &Cores, interval: &Interval) -> Finding {
    let Some(virtual_machine) = is_virtual(tree) else {
        return VIRTUALISATION.unknown("neither the processor nor the vendor's name shows it");
    };
    let stolen = interval.stolen_percent(&cores.chosen);
    let steal_text = match &stolen {
        Ok(percent) => format!("{percent:.1} % of time stolen {}", interval.describe()),
        Err(unread) => unread.to_string(),
    };
    let mut text = "bare metal".to_owned();
    if virtual_machine {
        let name = maker(tree).map(|name| format!(" ({name})"));
        text = format!("virtual machine{}, {steal_text}", name.unwrap_or_default());
    }
    match stolen {
        Ok(percent) if percent > STOLEN_PERCENT => VIRTUALISATION.poor(text),
        _ if virtual_machine => VIRTUALISATION.fair(text),
        _ => VIRTUALISATION.good(text),
    }
}

/// Returns `true` if there is a hypervisor, or `None` if that is unknown.
fn is_virtual(tree: &dyn Tree) -> Option<bool> {
    let cpuinfo = tree.read("proc/cpuinfo").unwrap_or_default();
    if let Some(present) = hypervisor_flag(&cpuinfo) {
        return Some(present);
    }
    // Other processors have no such flag, but firmware tables may identify the hypervisor.
    let hypervisor = ["proc/device-tree/hypervisor", "sys/hypervisor/type"];
    if hypervisor.iter().any(|path| tree.has(path)) {
        return Some(true);
    }
    if let Some(maker) = maker(tree) {
        return Some(MAKERS.iter().any(|name| maker.contains(name)));
    }
    let compatible = tree.read("proc/device-tree/compatible").ok()?;
    Some(compatible.contains("dummy-virt"))
}

/// Reads the hypervisor flag of an x86 processor from `/proc/cpuinfo`; `None` for other processors.
fn hypervisor_flag(cpuinfo: &str) -> Option<bool> {
    let line = cpuinfo.lines().find(|line| line.starts_with("flags"))?;
    Some(
        line.split_ascii_whitespace()
            .any(|flag| flag == "hypervisor"),
    )
}

/// Returns vendor and model according to the firmware.
fn maker(tree: &dyn Tree) -> Option<String> {
    let names = ["sys_vendor", "product_name"];
    let read = |name| tree.read(&format!("sys/class/dmi/id/{name}")).ok();
    let parts: Vec<String> = names.into_iter().filter_map(read).collect();
    (!parts.is_empty()).then(|| parts.join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Grade;
    use crate::interrupts::Snapshot;
    use crate::tree::{Fake, Files};

    const METAL: &str = "processor\t: 0\nmodel name\t: 13th Gen Intel(R) Core(TM) i7\nflags\t\t: fpu vme tsc_deadline_timer constant_tsc\n";
    const GUEST: &str =
        "processor\t: 0\nmodel name\t: AMD EPYC\nflags\t\t: fpu vme tsc hypervisor lahf_lm\n";
    const ARM: &str =
        "processor\t: 0\nBogoMIPS\t: 108.00\nFeatures\t: fp asimd evtstrm crc32 cpuid\n";
    const VENDOR: &str = "sys/class/dmi/id/sys_vendor";
    const PRODUCT: &str = "sys/class/dmi/id/product_name";

    fn look(files: &[(&str, &str)], steal: &str) -> Finding {
        // 10 000 ticks on each core, some of them taken by the host.
        let stat = format!(
            "cpu  1 1\ncpu0 0 0 0 10000 0 0 0 0 0 0\ncpu1 600 0 200 8000 0 0 0 {steal} 0 0\n"
        );
        let machine = Fake::new(files).with(&[
            ("proc/stat", stat.as_str()),
            ("proc/uptime", "100.00 180.00"),
        ]);
        let cores = Cores::of("0-1", "1");
        let interval = Interval::since_boot(Snapshot::take(&machine));
        virtualisation(&machine, &cores, &interval)
    }

    #[test]
    fn a_virtual_machine_is_fair_at_best() {
        #[rustfmt::skip] // a table
        let cases: [(Files, &str, Grade, &str); 10] = [
            (&[("proc/cpuinfo", METAL)], "0", Grade::Good, "bare metal"),
            // A rented bare-metal server: the vendor's name is not that of a hypervisor.
            (&[("proc/cpuinfo", METAL), (VENDOR, "Amazon EC2"), (PRODUCT, "c5.metal")], "0", Grade::Good, "bare metal"),
            (&[("proc/cpuinfo", GUEST)], "0", Grade::Fair, "virtual machine, 0.0 % of time stolen since boot"),
            (&[("proc/cpuinfo", GUEST), (VENDOR, "QEMU"), (PRODUCT, "Standard PC (Q35 + ICH9, 2009)")], "0", Grade::Fair,
             "virtual machine (QEMU Standard PC (Q35 + ICH9, 2009)), 0.0 % of time stolen since boot"),
            // 200 of 9000 ticks.
            (&[("proc/cpuinfo", GUEST)], "200", Grade::Poor, "virtual machine, 2.2 % of time stolen since boot"),
            (&[("proc/cpuinfo", ARM)], "0", Grade::Unknown, "neither"),
            (&[("proc/cpuinfo", ARM), (VENDOR, "Ampere(R)"), (PRODUCT, "Mt. Jade")], "0", Grade::Good, "bare metal"),
            (&[("proc/cpuinfo", ARM), (VENDOR, "Apple Inc."), (PRODUCT, "Apple Virtualization Generic Platform")], "0", Grade::Fair, "virtual machine"),
            (&[("proc/cpuinfo", ARM), ("proc/device-tree/compatible", "raspberrypi,4-model-b\0brcm,bcm2711\0")], "0", Grade::Good, "bare metal"),
            (&[("proc/cpuinfo", ARM), ("proc/device-tree/compatible", "linux,dummy-virt\0")], "0", Grade::Fair, "virtual machine"),
        ];
        for (files, steal, grade, expected) in cases {
            let finding = look(files, steal);
            assert_eq!(finding.grade, grade, "{files:?}");
            assert!(finding.found.starts_with(expected), "{}", finding.found);
        }
    }
}
