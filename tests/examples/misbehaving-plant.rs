//! A plant process with one plant for each way to break a run. Not a program of the workspace: the tests of failures
//! give it to `hil run --plant-bin`.

#[macro_use]
#[path = "../shared/plant.rs"]
mod plant;
#[path = "../shared/position_and_force.rs"]
mod position_and_force;

use std::os::unix::fs::FileExt;
use std::process::ExitCode;

use plant_process::plant::PlantKind;
use shared_types::table::Empty;

use position_and_force::{Force, Position};

/// The step at which a plant misbehaves.
const WHEN: u64 = 100;

macro_rules! spoiler {
    ($plant:ident, $name:literal, $deed:expr) => {
        struct $plant {
            steps: u64,
        }

        plant!(
            $plant,
            $name,
            "Misbehaves.",
            Empty,
            |_| Self { steps: 0 },
            |_| 0.0,
            |plant| {
                plant.steps += 1;
                if plant.steps == WHEN {
                    let deed: fn() = $deed;
                    deed();
                }
            }
        );
    };
}

spoiler!(Leaves, "leaves", || std::process::exit(0));
spoiler!(Panics, "panics", || panic!("the plant fell over"));
spoiler!(Sleeps, "sleeps", || loop {
    std::thread::park();
});
spoiler!(Mutters, "mutters", || {
    // What a terminal obeys: a cleared screen, a full clipboard, a line written over.
    eprintln!("\u{9b}2J\u{1b}]52;c;eA==\u{7}\rmuttered \u{1b}[31mpass");
    std::process::exit(7)
});
spoiler!(Smears, "smears", || write_over_shared_memory(0xff));
spoiler!(Wipes, "wipes", || write_over_shared_memory(0));
spoiler!(Hoards, "hoards", || {
    let mut hoard = Vec::new();
    loop {
        hoard.push(std::hint::black_box(vec![1_u8; 1 << 24]));
    }
});

/// Writes a byte over all shared memory of this process, as a wild pointer in C can.
fn write_over_shared_memory(byte: u8) {
    let maps = std::fs::read_to_string("/proc/self/maps").expect("own memory");
    let memory = std::fs::File::options().write(true).open("/proc/self/mem");
    let memory = memory.expect("own memory");
    for line in maps.lines().filter(|line| line.contains(" /dev/shm/hil_")) {
        let (range, rest) = line.split_once(' ').expect("a range and its rights");
        let (from, to) = range.split_once('-').expect("a range");
        let address = |text| u64::from_str_radix(text, 16).expect("an address");
        let (from, to) = (address(from), address(to));
        if rest.starts_with("rw") {
            let bytes = vec![byte; (to - from) as usize];
            memory.write_all_at(&bytes, from).expect("written");
        }
    }
}

fn main() -> ExitCode {
    let plants = vec![
        PlantKind::of::<Leaves>(),
        PlantKind::of::<Panics>(),
        PlantKind::of::<Sleeps>(),
        PlantKind::of::<Mutters>(),
        PlantKind::of::<Smears>(),
        PlantKind::of::<Wipes>(),
        PlantKind::of::<Hoards>(),
    ];
    plant_process::program::run("misbehaving-plant", "0.1.0", plants)
}
