//! Bench `jitter`: how punctually does a paced run send its samples?
//!
//! `cargo bench -p tests --bench jitter` runs `scenarios/spring-mass.toml` by `hil run --pace 1` at
//! 1 kHz and at 4 kHz and takes from its recording how late each sample was sent. `cyclictest` of
//! rt-tests measures, at the same rate, on the same core and in the same scheduling class, how late
//! the kernel wakes a thread that does nothing else: the yardstick of every real-time Linux. Both run
//! in pairs, first one, then the other; ratios are medians over the pairs. Without `cyclictest`
//! (`apt-get install rt-tests`) there are no ratios.
//!
//! **What is compared.** `cyclictest` sleeps until a release and tells when it woke. The plant sleeps
//! until shortly before and spins (beside busy loops without priority it sleeps until the release), and
//! tells when the sample went out. Both figures are what a controller would see as release jitter; that
//! one costs more processor time than the other is the design, not an error of the measurement.
//!
//! **Holes.** On a virtual machine the hypervisor takes a core away for milliseconds. No thread can
//! prevent that, and a grid that is caught up makes tens of late samples out of one such hole, where
//! `cyclictest` leaves out the releases that it slept through. A hole here is a release that is late
//! by more than the doctor's limit for real time, 500 us; it and all samples that were due before it
//! was over are removed and counted. Of `cyclictest` only a histogram is known: what is above the same
//! limit is removed and counted. A thread that sleeps cannot see a hole, it sees only its result, and a
//! slow program would look the same: so before each pair the doctor's gap detector spins on the same
//! core, and its holes a second stand beside the removed ones. Where the plant's are not about as
//! frequent as the detector's and `cyclictest`'s, they are its own.
//!
//! **Busy loops**, one on each core in a session of its own, take slices of milliseconds. That is what is
//! measured there: no hole is removed, but what was due before the sample before was sent is left out there
//! too, and p99.9 is printed. `-- busy` measures only these.
//!
//! **Drift** is how much later than the grid of the first sample the last tenth of the samples was sent
//! than the first tenth, as medians, against the monotonic clock.
//!
//! Largest values are not printed: on a virtual machine they are the hypervisor's. No number has a
//! limit. `HIL_BENCH_QUICK=1` only tries whether it works.

#[path = "../shared/busy.rs"]
mod busy;
mod cyclictest;
#[path = "../shared/effort.rs"]
mod effort;
#[path = "../shared/measure.rs"]
mod measure;
#[path = "../shared/programs.rs"]
mod programs;
mod releases;

use hil_doctor::measure::gaps;
use hil_facts::results::latency::grade::UNFIT_NS;
use serde_json::{Value, json};

use self::busy::BusyLoop;
use self::cyclictest::Cyclictest;
use self::effort::{rounds, shortened};
use self::measure::{Bystanders, cores, machine, median};
use self::programs::Programs;
use self::releases::Releases;

/// Lateness from which a release counts as a hole.
const HOLE_NS: u64 = UNFIT_NS;
/// The same limit next to busy loops, where time slices are measured.
const LONGEST_NS: u64 = 1_000_000_000;
/// Rates, the number of samples in a run at each rate, and whether busy loops run at the same time.
const SETTINGS: [(u64, u64, bool); 3] = [
    (1000, 10_000, false),
    (4000, 40_000, false),
    (1000, 10_000, true),
];
/// Time for which the gap detector spins before each pair, in s.
const GAPS_S: f64 = 2.0;
/// Priority in the real-time class.
const PRIORITY: u32 = 80;

/// Scheduling class.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Class {
    Other,
    Fifo,
}

impl Class {
    const fn name(self) -> &'static str {
        match self {
            Self::Other => "SCHED_OTHER",
            Self::Fifo => "SCHED_FIFO",
        }
    }
}

/// Setting of a run: scheduling class, rate and cores.
#[derive(Clone, Copy, Debug)]
struct Setting {
    class: Class,
    rate_hz: u64,
    samples: u64,
    /// Core of the measured thread.
    core: usize,
    /// Core of the controller; the same core if there is only one.
    other_core: usize,
    /// True if a busy loop runs on each core.
    busy: bool,
}

impl Setting {
    const fn period_ns(&self) -> u64 {
        1_000_000_000 / self.rate_hz
    }

    fn seconds(&self) -> f64 {
        self.samples as f64 / self.rate_hz as f64
    }

    /// Lateness from which a release counts as a hole.
    const fn hole_ns(&self) -> u64 {
        if self.busy { LONGEST_NS } else { HOLE_NS }
    }
}

/// Jitter in one run.
#[derive(Clone, Copy, Debug)]
struct Jitter {
    p50_ns: f64,
    p99_ns: f64,
    p999_ns: f64,
    /// Holes per second.
    holes_hz: f64,
    /// The share of the samples that fell into them or were due before the one before was sent.
    removed: f64,
}

/// Results of both programs in turn, with the gaps that the detector saw before.
struct Pair {
    ours: Releases,
    theirs: Option<Jitter>,
    holes_hz: f64,
}

fn main() {
    if busy::burned() {
        return;
    }
    // `cargo test --all-targets` starts benches too, without this argument.
    if !std::env::args().any(|argument| argument == "--bench") {
        println!("run me with `cargo bench -p tests --bench jitter`");
        return;
    }
    println!("machine: {}", machine());
    let programs = Programs::built();
    let cyclictest = Cyclictest::found();
    if cyclictest.is_none() {
        println!("no cyclictest: `apt-get install rt-tests` brings it");
    }
    let cores = cores();
    let (core, other_core) = (cores[cores.len() - 1], cores[0]);
    let only_busy = std::env::args().any(|argument| argument == "busy");
    for class in [Class::Other, Class::Fifo] {
        if class == Class::Fifo && !releases::may_be_real_time(&programs) {
            println!("SCHED_FIFO is not permitted: no numbers for it");
            continue;
        }
        for (rate_hz, samples, busy) in SETTINGS {
            let setting = Setting {
                class,
                rate_hz,
                samples: shortened(samples),
                core,
                other_core,
                busy,
            };
            if busy || !only_busy {
                let loops = cores.iter().filter(|_| busy);
                let loops = loops.map(|core| BusyLoop::start(0, Some(*core), true));
                let _busy: Vec<BusyLoop> = loops.map(|it| it.expect("a busy loop")).collect();
                compare(&programs, cyclictest.as_ref(), &setting);
            }
        }
    }
}

/// Measures pairs of runs and prints them.
fn compare(programs: &Programs, cyclictest: Option<&Cyclictest>, setting: &Setting) {
    let bystanders = Bystanders::watch();
    let pairs: Vec<Pair> = (0..rounds())
        .map(|_| Pair {
            holes_hz: holes_hz(setting.core),
            theirs: cyclictest.map(|cyclictest| cyclictest.measure(setting)),
            ours: Releases::measure(programs, setting),
        })
        .collect();
    let others = bystanders.share();

    println!(
        "\n{} at {} Hz on core {}{}, medians of {} pairs of {} s, other programs took {:.0} % of the \
         machine",
        setting.class.name(),
        setting.rate_hz,
        setting.core,
        if setting.busy {
            ", a busy loop on each core"
        } else {
            ""
        },
        rounds(),
        setting.seconds(),
        100.0 * others
    );
    println!(
        "{:<14} {:>10} {:>10} {:>11} {:>10} {:>12}",
        "", "p50 [us]", "p99 [us]", "p99.9 [us]", "holes a s", "removed [%]"
    );
    let ours = summary(pairs.iter().map(|pair| pair.ours.jitter));
    row("hil run", &ours);
    let theirs: Option<Vec<Jitter>> = pairs.iter().map(|pair| pair.theirs).collect();
    let theirs = theirs.map(|all| summary(all.into_iter()));
    let ratio = |of: fn(&Jitter) -> f64| -> Option<f64> {
        let ratios: Option<Vec<f64>> = (pairs.iter())
            .map(|pair| Some(of(&pair.ours.jitter) / of(pair.theirs.as_ref()?)))
            .collect();
        ratios.map(median)
    };
    let ratios = [
        ratio(|jitter| jitter.p50_ns),
        ratio(|jitter| jitter.p99_ns),
        ratio(|jitter| jitter.p999_ns),
    ];
    if let (Some(theirs), [Some(p50), Some(p99), Some(p999)]) = (&theirs, ratios) {
        row("cyclictest", theirs);
        println!("{:<14} {p50:>10.3} {p99:>10.3} {p999:>11.3}", "ratio");
    }
    let detected_hz = median(pairs.iter().map(|pair| pair.holes_hz));
    let drift_ns = median(pairs.iter().map(|pair| pair.ours.drift_ns));
    let lost: u64 = pairs.iter().map(|pair| pair.ours.lost_steps).sum();
    println!(
        "{:<14} {:>10} {:>10} {:>11} {detected_hz:>10.2}",
        "gap detector", "", "", ""
    );
    println!("drift {drift_ns:.0} ns, {lost} steps lost in all");
    let line = json!({
        "bench": "jitter",
        "machine": machine(),
        "class": setting.class.name(),
        "rate_hz": setting.rate_hz,
        "core": setting.core,
        "pairs": rounds(),
        "seconds": setting.seconds(),
        "busy": setting.busy,
        "hole_ns": setting.hole_ns(),
        "others_share": others,
        "hil_run": figures(&ours),
        "cyclictest": theirs.as_ref().map(figures),
        "ratio_p50": ratios[0],
        "ratio_p99": ratios[1],
        "ratio_p999": ratios[2],
        "detected_holes_hz": detected_hz,
        "drift_ns": drift_ns,
        "lost_steps": lost,
    });
    println!("{line}");
}

/// Returns the holes per second on a core that runs only the detector and, if requested, a busy loop.
fn holes_hz(core: usize) -> f64 {
    let watched = gaps::measure(core as u32, GAPS_S).expect("a core that this process may use");
    let holes = (gaps::CLASSES_NS.iter().zip(watched.holes)).filter(|(from, _)| **from >= HOLE_NS);
    let count: u64 = holes.map(|(_, count)| count).sum();
    1e9 * count as f64 / watched.watched_ns as f64
}

/// The median of each figure.
fn summary(all: impl Iterator<Item = Jitter> + Clone) -> Jitter {
    Jitter {
        p50_ns: median(all.clone().map(|jitter| jitter.p50_ns)),
        p99_ns: median(all.clone().map(|jitter| jitter.p99_ns)),
        p999_ns: median(all.clone().map(|jitter| jitter.p999_ns)),
        holes_hz: median(all.clone().map(|jitter| jitter.holes_hz)),
        removed: median(all.map(|jitter| jitter.removed)),
    }
}

fn row(name: &str, jitter: &Jitter) {
    println!(
        "{name:<14} {:>10.2} {:>10.2} {:>11.2} {:>10.2} {:>12.2}",
        1e-3 * jitter.p50_ns,
        1e-3 * jitter.p99_ns,
        1e-3 * jitter.p999_ns,
        jitter.holes_hz,
        100.0 * jitter.removed
    );
}

fn figures(jitter: &Jitter) -> Value {
    json!({
        "p50_ns": jitter.p50_ns,
        "p99_ns": jitter.p99_ns,
        "p999_ns": jitter.p999_ns,
        "holes_hz": jitter.holes_hz,
        "removed_share": jitter.removed,
    })
}
