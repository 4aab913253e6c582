//! Bench `callbacks`: the cost of a step of a plant in C compared with its twin in Rust, in one process.
//!
//! `cargo bench -p hil-foreign --bench callbacks` compiles `examples/c-plant/pendulum.c`, loads it, and runs it
//! alternately with the same plant in Rust, each through the engine's interface. Both must end with the same bits.
//! The bench is in this package rather than in `tests`, because loading is unsafe. Without a C compiler the bench
//! prints a note and exits.

use std::ffi::{CString, c_char, c_int, c_void};
use std::hint::black_box;
use std::mem::transmute;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use hil_foreign::c::interface::Plant as PlantInC;
use hil_foreign::c::{mathematics, plant};
use hil_session::clock::monotonic_ns;
use plant_process::integrate::integrate;
use plant_process::plant::{Plant, PlantKind};
use shared_types::describe::{Invalid, Settings};
use shared_types::table;
use shared_types::time::Interval;

/// Number of turns of each side.
const TURNS: usize = 10;
/// Number of steps in a turn.
const STEPS: u64 = 1_000_000;
/// `RTLD_NOW` of Linux.
const NOW: c_int = 2;

table! {
    /// Parameters.
    struct Parameters {
        /// Mass.
        mass_kg: "kg" = 1.0 in 1e-3..=1e3 [faultable],
        /// Length.
        length_m: "m" = 0.5 in 1e-2..=1e2,
        /// Friction.
        friction_nm_s_per_rad: "N m s/rad" = 0.05 in 0.0..=1e3,
        /// Angle at step 0.
        initial_angle_rad: "rad" = 0.2 in (-1.5)..=1.5,
    }
}

table! {
    /// Truth and measured signals.
    struct Motion {
        /// Angle.
        angle_rad: "rad",
        /// Rate.
        rate_radps: "rad/s",
    }
}

table! {
    /// Command signals.
    struct Torque {
        /// Torque.
        torque_nm: "N m",
    }
}

/// The pendulum of `examples/own-plant`.
struct Pendulum {
    parameters: Parameters,
    state: [f64; 2],
}

impl Plant for Pendulum {
    const NAME: &'static str = "pendulum";
    const SUMMARY: &'static str = "A pendulum on its head.";
    type Parameters = Parameters;
    type Truth = Motion;
    type Measured = Motion;
    type Command = Torque;

    fn start(parameters: &Parameters) -> Result<Self, Invalid> {
        let (parameters, state) = (*parameters, [parameters.initial_angle_rad, 0.0]);
        Ok(Self { parameters, state })
    }

    fn retune(&mut self, parameters: &Parameters) {
        self.parameters = *parameters;
    }

    fn measure(&self) -> Motion {
        let [angle_rad, rate_radps] = self.state;
        Motion {
            angle_rad,
            rate_radps,
        }
    }

    fn truth(&self, _time_s: f64, _command: &Torque) -> Motion {
        self.measure()
    }

    fn advance(&mut self, interval: &Interval, command: &Torque) {
        const G: f64 = 9.80665;
        let p = &self.parameters;
        let (m, l, c) = (p.mass_kg, p.length_m, p.friction_nm_s_per_rad);
        integrate(&mut self.state, interval, |_, &[a, a_dot]| {
            let torque_nm = m * G * l * libm::sin(a) - c * a_dot + command.torque_nm;
            [a_dot, torque_nm / (m * l * l)]
        });
    }
}

unsafe extern "C" {
    fn dlopen(name: *const c_char, flags: c_int) -> *mut c_void;
    fn dlsym(library: *mut c_void, name: *const c_char) -> *mut c_void;
}

fn main() {
    if !std::env::args().any(|argument| argument == "--bench") {
        println!("run me with `cargo bench -p hil-foreign --bench callbacks`");
        return;
    }
    if Command::new("cc").arg("--version").output().is_err() {
        println!("there is no C compiler `cc` here");
        return;
    }
    let library = compiled();
    let in_c = loaded(&library);
    let in_rust = PlantKind::of::<Pendulum>();
    let (mut c_ns, mut rust_ns) = (Vec::new(), Vec::new());
    for _ in 0..TURNS {
        let (rust, rust_end) = turn(&in_rust);
        let (c, c_end) = turn(&in_c);
        assert_eq!(c_end, rust_end, "both compute the same bits");
        rust_ns.push(rust);
        c_ns.push(c);
    }
    let over = (c_ns.iter().zip(&rust_ns))
        .map(|(c, rust)| c - rust)
        .collect();
    println!("a step of the pendulum, medians of {TURNS} turns of {STEPS} steps");
    for (name, values) in [("Rust", rust_ns), ("C", c_ns), ("C over Rust", over)] {
        println!("{name:<12} {:>7.1} ns", median(values));
    }
}

fn compiled() -> PathBuf {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let library = std::env::temp_dir().join(format!("hil-callbacks-{}.so", std::process::id()));
    let mut cc = Command::new("cc");
    cc.args([
        "-O2",
        "-std=c11",
        "-ffp-contract=off",
        "-shared",
        "-fPIC",
        "-Dmain=process",
        // Pointers in place of functions, declared by the header in both files.
        "-fcommon",
        "-Dhil_sin=(*bench_sin)",
        "-Dhil_integrate=(*bench_integrate)",
        "-I",
    ]);
    cc.arg(package.join("include"));
    cc.arg(package.join("../../examples/c-plant/pendulum.c"));
    cc.arg(package.join("benches/callbacks/taken.c"));
    let status = cc.arg("-o").arg(&library).status().expect("cc");
    assert!(status.success(), "the pendulum does not compile");
    library
}

fn loaded(path: &Path) -> PlantKind {
    let name = CString::new(path.as_os_str().as_bytes()).expect("a path");
    // SAFETY: the library was just compiled from two files without constructors.
    let library = unsafe { dlopen(name.as_ptr(), NOW) };
    assert!(!library.is_null(), "the library can be loaded");
    std::fs::remove_file(path).expect("it is ours");
    let symbol = |name: &CString| {
        // SAFETY: the library stays loaded.
        let symbol = unsafe { dlsym(library, name.as_ptr()) };
        assert!(!symbol.is_null(), "{name:?}");
        symbol
    };
    let symbol = |name: &str| symbol(&CString::new(name).expect("a name"));
    // SAFETY: `taken.c` and the options make these symbols a function, two function pointers and a plant of `hil.h`,
    // and nothing else uses them while they are set.
    unsafe {
        let sin: *mut extern "C" fn(f64) -> f64 = symbol("bench_sin").cast();
        sin.write(mathematics::hil_sin);
        let integrate: *mut *const () = symbol("bench_integrate").cast();
        integrate.write(mathematics::hil_integrate as *const ());
        let process: extern "C" fn(c_int, *mut *mut c_char) -> c_int = transmute(symbol("process"));
        assert_eq!(process(0, std::ptr::null_mut()), 0);
        let taken: *const PlantInC = symbol("taken").cast();
        plant::kind(&*taken).expect("a sound plant")
    }
}

/// Runs a turn; returns the duration of a step in ns, and the bits of the final state.
fn turn(kind: &PlantKind) -> (f64, [u64; 2]) {
    let mut model = (kind.start)(&Settings::of(&Parameters::default())).expect("starts");
    let (mut measured, mut truth) = ([0.0; 2], [0.0; 2]);
    let since_ns = monotonic_ns();
    for step in 0..STEPS {
        let interval = Interval {
            start_s: step as f64 * 1e-3,
            length_s: 1e-3,
            substeps: 1,
        };
        model.measure(&mut measured).expect("measured");
        let [a, a_dot] = *black_box(&measured);
        // Around 0.3 rad, because denormal numbers near zero would be slow.
        let command = [-9.0 * (a - 0.3) - 2.95 * a_dot];
        (model.truth(interval.start_s, &command, &mut truth)).expect("told");
        black_box(&truth);
        model.advance(&interval, &command).expect("goes on");
    }
    let step_ns = (monotonic_ns() - since_ns) as f64 / STEPS as f64;
    (step_ns, measured.map(f64::to_bits))
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
