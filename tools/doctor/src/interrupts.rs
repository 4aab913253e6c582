//! Kernel counters: device interrupts, and time stolen by a host.

use super::checks::INTERRUPTS;
use super::cores::{CoreList, Cores};
use super::finding::{Finding, Grade, known};
use super::tree::{Tree, Unread};

/// Rate of device interrupts on the chosen cores that is still fair; at 5 us each they take half a percent of the
/// time.
const MOST_INTERRUPTS_HZ: f64 = 1000.0;
/// Rate above which moving an interrupt is worthwhile.
const FEW_INTERRUPTS_HZ: f64 = 1.0;

/// Kernel counters at one time.
#[derive(Clone, Debug)]
pub(crate) struct Snapshot {
    interrupts: Result<String, Unread>,
    stat: Result<String, Unread>,
    uptime: Result<String, Unread>,
}

/// Kernel counters between two times.
#[derive(Clone, Debug)]
pub(crate) struct Interval {
    earlier: Option<Snapshot>,
    later: Snapshot,
}

/// Interrupt line of a device.
#[derive(Clone, Debug, PartialEq)]
struct Line {
    number: String,
    device: String,
    count: u64,
}

impl Snapshot {
    /// Reads the current counters.
    pub(crate) fn take(tree: &dyn Tree) -> Self {
        Self {
            interrupts: tree.read("proc/interrupts"),
            stat: tree.read("proc/stat"),
            uptime: tree.read("proc/uptime"),
        }
    }

    fn uptime_s(&self) -> Result<f64, Unread> {
        let text = self.uptime.as_deref().map_err(Unread::clone)?;
        let seconds = text.split(' ').next().and_then(|s| s.parse().ok());
        seconds.ok_or_else(|| Unread {
            path: "proc/uptime".into(),
            reason: format!("unexpected content `{text}`"),
        })
    }

    fn device_interrupts(&self, cores: &CoreList) -> Result<Vec<Line>, Unread> {
        let text = self.interrupts.as_deref().map_err(Unread::clone)?;
        Ok(device_interrupts(text, cores))
    }
}

impl Interval {
    /// Creates the interval between two snapshots.
    pub(crate) const fn between(earlier: Snapshot, later: Snapshot) -> Self {
        Self {
            earlier: Some(earlier),
            later,
        }
    }

    /// Creates the interval since boot.
    pub(crate) const fn since_boot(later: Snapshot) -> Self {
        Self {
            earlier: None,
            later,
        }
    }

    /// Describes the interval in words.
    pub(crate) fn describe(&self) -> String {
        match (&self.earlier, self.seconds()) {
            (Some(_), Ok(seconds)) => format!("in {seconds:.1} s"),
            _ => "since boot".into(),
        }
    }

    fn seconds(&self) -> Result<f64, Unread> {
        let earlier = self.earlier.as_ref().map_or(Ok(0.0), Snapshot::uptime_s)?;
        Ok(self.later.uptime_s()? - earlier)
    }

    /// Computes the percentage of these cores' time that a host took.
    ///
    /// # Errors
    /// If the counters cannot be read.
    pub(crate) fn stolen_percent(&self, cores: &CoreList) -> Result<f64, Unread> {
        let ticks = |snapshot: &Snapshot| {
            let text = snapshot.stat.as_deref().map_err(Unread::clone)?;
            Ok(stolen_of_all(text, cores))
        };
        let (stolen, all) = ticks(&self.later)?;
        let (stolen_before, all_before) = self.earlier.as_ref().map_or(Ok((0, 0)), ticks)?;
        let stolen = stolen.saturating_sub(stolen_before) as f64;
        let all = all.saturating_sub(all_before) as f64;
        Ok(if all > 0.0 { 100.0 * stolen / all } else { 0.0 })
    }

    /// Returns the device interrupts on these cores with their rates, busiest first.
    fn interrupts_hz(&self, cores: &CoreList) -> Result<Vec<(Line, f64)>, Unread> {
        let seconds = self.seconds()?;
        let before = match &self.earlier {
            Some(earlier) => earlier.device_interrupts(cores)?,
            None => Vec::new(),
        };
        let rate = |line: Line| {
            let before = before.iter().find(|other| other.number == line.number);
            let count = line
                .count
                .saturating_sub(before.map_or(0, |line| line.count));
            let hz = if seconds > 0.0 {
                count as f64 / seconds
            } else {
                0.0
            };
            (line, hz)
        };
        let lines = self.later.device_interrupts(cores)?;
        let mut rates: Vec<(Line, f64)> = lines.into_iter().map(rate).collect();
        rates.sort_by(|a, b| b.1.total_cmp(&a.1));
        Ok(rates)
    }
}

/// Parses the device interrupts in `/proc/interrupts` and their counts on these cores. The kernel's own interrupts,
/// whose names are not numbers, are omitted.
fn device_interrupts(text: &str, cores: &CoreList) -> Vec<Line> {
    let mut rows = text.lines();
    let header = rows.next().unwrap_or_default();
    let columns: Vec<Option<u32>> = (header.split_ascii_whitespace())
        .map(|name| name.strip_prefix("CPU")?.parse().ok())
        .collect();
    let line = |row: &str| {
        let (number, rest) = row.split_once(':')?;
        let number = number.trim();
        number.parse::<u32>().ok()?;
        let mut fields = rest.split_ascii_whitespace();
        let mut count = 0;
        for core in &columns {
            let of_core: u64 = fields.next()?.parse().ok()?;
            if core.is_some_and(|core| cores.contains(core)) {
                count += of_core;
            }
        }
        Some(Line {
            number: number.to_owned(),
            device: fields.next_back().unwrap_or("?").to_owned(),
            count,
        })
    };
    rows.filter_map(line).collect()
}

/// Returns the ticks stolen by a host and all ticks of these cores, from `/proc/stat`.
fn stolen_of_all(text: &str, cores: &CoreList) -> (u64, u64) {
    let (mut stolen, mut all) = (0, 0);
    for line in text.lines() {
        let mut fields = line.split_ascii_whitespace();
        let core = (fields.next()).and_then(|name| name.strip_prefix("cpu")?.parse().ok());
        if !core.is_some_and(|core| cores.contains(core)) {
            continue;
        }
        // user nice system idle iowait irq softirq steal; guest time is contained in the first two.
        let ticks: Vec<u64> = fields.take(8).filter_map(|t| t.parse().ok()).collect();
        stolen += ticks.get(7).unwrap_or(&0);
        all += ticks.iter().sum::<u64>();
    }
    (stolen, all)
}

/// Checks the device interrupts on the chosen cores: those counted there and those routed there.
pub(crate) fn interrupts(tree: &dyn Tree, cores: &Cores, interval: &Interval) -> Finding {
    let rates = known!(INTERRUPTS, interval.interrupts_hz(&cores.chosen));
    let came_hz: f64 = rates.iter().map(|(_, hz)| hz).sum();
    let aimed = |(line, _): &&(Line, f64)| aim(tree, &line.number).meets(&cores.chosen);
    let aimed: Vec<&(Line, f64)> = rates.iter().filter(aimed).collect();
    let mut text = format!("{came_hz:.0}/s {}", interval.describe());
    if let Some((busiest, _)) = rates.first().filter(|(_, hz)| *hz >= FEW_INTERRUPTS_HZ) {
        text += &format!(", most from {}", busiest.device);
    }
    text += &format!("; {} of {} lines are routed here", aimed.len(), rates.len());
    let grade = if came_hz > MOST_INTERRUPTS_HZ {
        Grade::Poor
    } else if came_hz >= FEW_INTERRUPTS_HZ || !aimed.is_empty() {
        Grade::Fair
    } else {
        Grade::Good
    };
    let finding = INTERRUPTS.graded(grade, text);
    let others = cores.others();
    if aimed.is_empty() || others.is_empty() {
        return finding;
    }
    let numbers: Vec<&str> = (aimed.iter())
        .map(|(line, _)| line.number.as_str())
        .collect();
    finding.mend(format!(
        "for i in {}; do echo {others} | sudo tee /proc/irq/$i/smp_affinity_list; done",
        numbers.join(" ")
    ))
}

/// Returns the cores to which an interrupt is routed.
fn aim(tree: &dyn Tree, number: &str) -> CoreList {
    let read = |file| tree.read(&format!("proc/irq/{number}/{file}"));
    let effective = read("effective_affinity_list").map(|list| CoreList::parse(&list));
    match effective {
        Ok(list) if !list.is_empty() => list,
        _ => CoreList::parse(&read("smp_affinity_list").unwrap_or_default()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tree::Fake;

    /// Core 1 is offline according to the header; one row has a name of several words.
    const INTERRUPTS_TEXT: &str = "\
           CPU0       CPU2       CPU3
  0:         44          0          0   IO-APIC   2-edge      timer
  8:          0          0          1   IO-APIC   8-edge      rtc0
125:        100         20       3000   IR-PCI-MSIX-0000:01:00.0    0-edge      nvme0q0
126:          0          0          0   IR-PCI-MSIX-0000:00:1f.6    0-edge      eth0
NMI:          2          3          4   Non-maskable interrupts
LOC:    7845550    8100814    9100814   Local timer interrupts
ERR:          0
";

    fn counted(interrupts: &str, uptime: &str) -> Fake {
        Fake::new(&[
            ("proc/interrupts", interrupts),
            ("proc/uptime", uptime),
            ("proc/irq/0/smp_affinity_list", "0"),
            ("proc/irq/8/smp_affinity_list", "0,2-3"),
            ("proc/irq/8/effective_affinity_list", "0"),
            ("proc/irq/125/smp_affinity_list", "0,2-3"),
            ("proc/irq/125/effective_affinity_list", "3"),
            ("proc/irq/126/smp_affinity_list", "0"),
            ("proc/irq/126/effective_affinity_list", ""),
        ])
    }

    #[test]
    fn interrupts_are_counted_for_the_cores_of_the_header() {
        let of = |cores: &str| -> Vec<(String, u64)> {
            let lines = device_interrupts(INTERRUPTS_TEXT, &CoreList::parse(cores));
            lines.into_iter().map(|l| (l.device, l.count)).collect()
        };
        let named = |counts: [u64; 4]| -> Vec<(String, u64)> {
            let names = ["timer", "rtc0", "nvme0q0", "eth0"].map(str::to_owned);
            names.into_iter().zip(counts).collect()
        };
        assert_eq!(of("2-3"), named([0, 1, 3020, 0]));
        assert_eq!(of("0"), named([44, 0, 100, 0]));
        assert_eq!(of("1"), named([0, 0, 0, 0]));
    }

    #[test]
    fn interrupts_on_the_chosen_cores_are_graded_by_their_rate() {
        let cores_with_others = Cores::of("0,2-3", "2-3");
        let before = Snapshot::take(&counted(INTERRUPTS_TEXT, "500.00 900.00"));
        for (count, grade, expected) in [
            (
                "3000",
                Grade::Fair,
                "0/s in 2.0 s; 1 of 4 lines are routed here",
            ),
            (
                "3400",
                Grade::Fair,
                "200/s in 2.0 s, most from nvme0q0; 1 of 4 lines are routed here",
            ),
            (
                "9000",
                Grade::Poor,
                "3000/s in 2.0 s, most from nvme0q0; 1 of 4 lines are routed here",
            ),
        ] {
            let later = counted(&INTERRUPTS_TEXT.replace("3000", count), "502.00 902.00");
            let interval = Interval::between(before.clone(), Snapshot::take(&later));
            let finding = interrupts(&later, &cores_with_others, &interval);
            assert_eq!((finding.grade, finding.found.as_str()), (grade, expected));
            assert_eq!(
                finding.mend.as_deref(),
                Some("for i in 125; do echo 0 | sudo tee /proc/irq/$i/smp_affinity_list; done")
            );
        }
        // 3021 interrupts in 100 s since boot, and no other core to route them to.
        let machine = counted(INTERRUPTS_TEXT, "100.00 1.00");
        let since_boot = Interval::since_boot(Snapshot::take(&machine));
        let finding = interrupts(&machine, &Cores::of("2-3", "2-3"), &since_boot);
        assert!(
            finding.found.starts_with("30/s since boot"),
            "{}",
            finding.found
        );
        assert_eq!((finding.grade, finding.mend), (Grade::Fair, None));
    }

    #[test]
    fn cores_without_interrupts_are_good() {
        let text = INTERRUPTS_TEXT.replace("3000", "0");
        let machine =
            counted(&text, "5000.00 1.00").with(&[("proc/irq/125/effective_affinity_list", "0")]);
        let interval = Interval::since_boot(Snapshot::take(&machine));
        let finding = interrupts(&machine, &Cores::of("0,2-3", "2-3"), &interval);
        assert_eq!((finding.grade, finding.mend), (Grade::Good, None));
        let blind = Interval::since_boot(Snapshot::take(&Fake::default()));
        let finding = interrupts(&machine, &Cores::of("0,2-3", "2-3"), &blind);
        assert_eq!(finding.grade, Grade::Unknown);
    }

    #[test]
    fn stolen_time_covers_only_the_interval_and_the_cores() {
        let stat = |steal: u64, idle: u64| {
            let text = format!(
                "cpu 9 9 9 9\ncpu0 0 0 0 {idle} 0 0 0 500 0 0\ncpu1 100 0 0 {idle} 0 0 0 {steal} 70 0\nintr 5\n"
            );
            Snapshot::take(&Fake::new(&[("proc/stat", text)]))
        };
        let interval = Interval::between(stat(50, 1000), stat(55, 1195));
        let percent = |cores| interval.stolen_percent(&CoreList::parse(cores));
        // 5 of 200 ticks on core 1, and none on core 0.
        assert_eq!(percent("1"), Ok(2.5));
        assert_eq!(percent("0"), Ok(0.0));
        assert_eq!(percent("7"), Ok(0.0));
    }
}
