//! Checks that the chosen cores are free of other work, and that this process may use them without a time limit.

use super::boot;
use super::checks::{ISOLATION, QUOTA};
use super::cores::{CoreList, Cores};
use super::finding::{Finding, known};
use super::tree::Tree;

/// Checks whether the chosen cores are isolated from other work and from the scheduler's tick.
pub(crate) fn isolation(tree: &dyn Tree, cores: &Cores) -> Finding {
    let list = |path: &str| tree.read(path).map(|text| CoreList::parse(&text));
    let from_boot = known!(ISOLATION, list("sys/devices/system/cpu/isolated"));
    // Both files are missing in kernels built without these features.
    let from_group = list("sys/fs/cgroup/cpuset.cpus.isolated").unwrap_or_default();
    let without_tick = list("sys/devices/system/cpu/nohz_full").unwrap_or_default();
    let isolated = from_boot.with(&from_group);
    let or_none = |list: &CoreList| match list.is_empty() {
        true => "none".to_owned(),
        false => list.to_string(),
    };
    let text = format!(
        "isolated: {}, without tick: {}",
        or_none(&isolated),
        or_none(&without_tick)
    );
    if isolated.covers(&cores.chosen) && without_tick.covers(&cores.chosen) {
        return ISOLATION.good(text);
    }
    let (chosen, others) = (&cores.chosen, cores.others());
    if others.is_empty() {
        return ISOLATION.fair(format!("{text}; no core is left for other work"));
    }
    let arguments = format!(
        "isolcpus=managed_irq,domain,{chosen} nohz_full={chosen} rcu_nocbs={chosen} irqaffinity={others}"
    );
    ISOLATION
        .fair(text)
        .mend_if(boot::add_arguments(tree, &arguments))
}

/// Limit on processor time, in either version of control groups.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Quota {
    file: String,
    quota_us: u64,
    period_us: u64,
}

/// Checks the limits on processor time in the control groups above this process.
pub(crate) fn quota(tree: &dyn Tree) -> Finding {
    let groups = known!(QUOTA, tree.read("proc/self/cgroup"));
    let mut looked = false;
    for line in groups.lines() {
        let mut parts = line.splitn(3, ':').skip(1);
        let (Some(controllers), Some(group)) = (parts.next(), parts.next()) else {
            continue;
        };
        let root = match controllers {
            "" => "sys/fs/cgroup",
            names if names.split(',').any(|name| name == "cpu") => "sys/fs/cgroup/cpu",
            _ => continue,
        };
        looked |= tree.has(root);
        if let Some(quota) =
            quota_above(tree, root, group.trim_matches('/'), controllers.is_empty())
        {
            let lift = if controllers.is_empty() { "max" } else { "-1" };
            let Quota {
                file,
                quota_us,
                period_us,
            } = quota;
            return QUOTA
                .poor(format!("{quota_us} us of each {period_us} us"))
                .mend(format!("echo {lift} | sudo tee /{file}"));
        }
    }
    match looked {
        true => QUOTA.good("none"),
        false => QUOTA.unknown("/sys/fs/cgroup does not exist"),
    }
}

/// Returns the first limit from a group up to the root of its hierarchy.
fn quota_above(tree: &dyn Tree, root: &str, group: &str, unified: bool) -> Option<Quota> {
    let mut group = group;
    loop {
        let folder = format!("{root}/{group}");
        let folder = folder.trim_end_matches('/');
        let quota = if unified {
            unified_quota(tree, folder)
        } else {
            legacy_quota(tree, folder)
        };
        if quota.is_some() || group.is_empty() {
            return quota;
        }
        group = group.rsplit_once('/').map_or("", |(above, _)| above);
    }
}

fn unified_quota(tree: &dyn Tree, folder: &str) -> Option<Quota> {
    let file = format!("{folder}/cpu.max");
    let text = tree.read(&file).ok()?;
    let (quota, period) = text.split_once(' ')?;
    Some(Quota {
        quota_us: quota.parse().ok()?, // `max` is no number and no limit
        period_us: period.parse().ok()?,
        file,
    })
}

fn legacy_quota(tree: &dyn Tree, folder: &str) -> Option<Quota> {
    let file = format!("{folder}/cpu.cfs_quota_us");
    let period = tree.read(&format!("{folder}/cpu.cfs_period_us")).ok()?;
    Some(Quota {
        quota_us: tree.read(&file).ok()?.parse().ok()?, // -1 is no limit
        period_us: period.parse().ok()?,
        file,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Grade;
    use crate::tree::{Fake, Files};

    #[test]
    fn isolation_is_good_without_other_work_and_tick() {
        let cores = Cores::of("0-7", "6-7");
        for (isolated, group, tick, grade) in [
            ("6-7", "", "6-7", Grade::Good),
            ("4-7", "", "1-7", Grade::Good),
            ("", "6-7", "6-7", Grade::Good),
            ("6-7", "", "(null)", Grade::Fair),
            ("6", "", "6-7", Grade::Fair),
            ("", "", "", Grade::Fair),
        ] {
            let machine = Fake::new(&[
                ("sys/devices/system/cpu/isolated", isolated),
                ("sys/fs/cgroup/cpuset.cpus.isolated", group),
                ("sys/devices/system/cpu/nohz_full", tick),
            ]);
            let finding = isolation(&machine, &cores);
            assert_eq!(finding.grade, grade, "{isolated} {group} {tick}");
        }
        assert_eq!(isolation(&Fake::default(), &cores).grade, Grade::Unknown);
    }

    #[test]
    fn isolating_cores_is_suggested_only_if_others_remain() {
        let machine = Fake::new(&[
            ("sys/devices/system/cpu/isolated", ""),
            ("usr/sbin/grubby", ""),
        ]);
        let command = isolation(&machine, &Cores::of("0-3", "2-3")).mend;
        assert_eq!(
            command.as_deref(),
            Some(
                "sudo grubby --update-kernel=ALL --args='isolcpus=managed_irq,domain,2-3 \
                 nohz_full=2-3 rcu_nocbs=2-3 irqaffinity=0-1' # then reboot"
            )
        );
        let finding = isolation(&machine, &Cores::of("0-1", "0-1"));
        assert_eq!((finding.grade, finding.mend), (Grade::Fair, None));
        assert!(finding.found.contains("no core is left"));
    }

    #[test]
    fn a_quota_of_any_parent_group_is_detected() {
        let unified = "0::/user.slice/build.scope";
        let legacy = "5:devices:/\n3:cpuset,cpu,cpuacct:/docker/1\n0::/";
        #[rustfmt::skip] // a table
        let cases: [(&str, Files, Grade, Option<&str>); 7] = [
            (unified, &[("sys/fs/cgroup/user.slice/build.scope/cpu.max", "max 100000")], Grade::Good, None),
            (unified, &[("sys/fs/cgroup/user.slice/cpu.max", "50000 100000")], Grade::Poor,
             Some("echo max | sudo tee /sys/fs/cgroup/user.slice/cpu.max")),
            ("0::/", &[("sys/fs/cgroup/cpu.max", "150000 100000")], Grade::Poor,
             Some("echo max | sudo tee /sys/fs/cgroup/cpu.max")),
            (legacy, &[("sys/fs/cgroup/cpu/docker/1/cpu.cfs_quota_us", "-1"), ("sys/fs/cgroup/cpu/docker/1/cpu.cfs_period_us", "100000")], Grade::Good, None),
            (legacy, &[("sys/fs/cgroup/cpu/docker/1/cpu.cfs_quota_us", "20000"), ("sys/fs/cgroup/cpu/docker/1/cpu.cfs_period_us", "100000")], Grade::Poor,
             Some("echo -1 | sudo tee /sys/fs/cgroup/cpu/docker/1/cpu.cfs_quota_us")),
            (unified, &[("sys/fs/cgroup/cgroup.procs", "1")], Grade::Good, None),
            (unified, &[], Grade::Unknown, None),
        ];
        for (groups, files, grade, mend) in cases {
            let machine = Fake::new(&[("proc/self/cgroup", groups)]).with(files);
            let finding = quota(&machine);
            assert_eq!(
                (finding.grade, finding.mend.as_deref()),
                (grade, mend),
                "{files:?}"
            );
        }
    }
}
