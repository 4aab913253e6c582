//! The structs of `hil.h`, field by field. A test compiles the header and compares sizes and places.

use std::ffi::{c_char, c_int, c_uint, c_void};

/// `HIL_API`: version of the header.
pub const API: u32 = 1;
/// `HIL_FAULTABLE`.
pub const FAULTABLE: c_uint = 1;
/// `HIL_TUNABLE`.
pub const TUNABLE: c_uint = 2;
/// `HIL_OK`.
pub const OK: c_int = 0;
/// `HIL_DIVERGED`.
pub const DIVERGED: c_int = 1;
/// `HIL_FAILED`.
pub const FAILED: c_int = 2;

/// `hil_parameter`.
#[derive(Debug)]
#[repr(C)]
pub struct Parameter {
    /// Name.
    pub name: *const c_char,
    /// Unit.
    pub unit: *const c_char,
    /// Description in one sentence.
    pub description: *const c_char,
    /// Default.
    pub initial: f64,
    /// Smallest legal value.
    pub min: f64,
    /// Largest legal value.
    pub max: f64,
    /// Flags.
    pub flags: c_uint,
}

/// `hil_signal`.
#[derive(Debug)]
#[repr(C)]
pub struct Signal {
    /// Name.
    pub name: *const c_char,
    /// Unit.
    pub unit: *const c_char,
    /// Description in one sentence.
    pub description: *const c_char,
    /// Smallest legal value.
    pub min: f64,
    /// Largest legal value.
    pub max: f64,
}

/// `hil_parameters` and `hil_signals`.
#[derive(Debug)]
#[repr(C)]
pub struct Rows<T> {
    /// The first row.
    pub rows: *const T,
    /// Number of rows.
    pub count: usize,
}

/// `hil_interval`.
#[derive(Debug)]
#[repr(C)]
pub struct Interval {
    /// Simulated time in s.
    pub start_s: f64,
    /// Length in s.
    pub length_s: f64,
    /// Equal parts.
    pub substeps: u32,
}

/// `hil_setup`.
#[derive(Debug)]
#[repr(C)]
pub struct Setup {
    /// Row of parameters.
    pub parameters: *const f64,
    /// Row of the model.
    pub model: *const f64,
    /// Time between two samples in s.
    pub period_s: f64,
}

/// `hil_sample`.
#[derive(Debug)]
#[repr(C)]
pub struct Sample {
    /// Simulated time in s.
    pub time_s: f64,
    /// Row of measured signals.
    pub measured: *const f64,
    /// Row of reference signals.
    pub reference: *const f64,
    /// Not 0 if all of these signals are valid.
    pub valid: c_int,
    /// Steps for which a command has been held.
    pub held_steps: u32,
}

/// Callback that takes a row.
pub type TakeRow = unsafe extern "C" fn(*mut c_void, *const f64) -> c_int;
/// Callback that writes a row.
pub type WriteRow = unsafe extern "C" fn(*const c_void, *mut f64) -> c_int;
/// Callback that tells the truth.
pub type WriteTruth = unsafe extern "C" fn(*const c_void, f64, *const f64, *mut f64) -> c_int;
/// Callback that integrates.
pub type Advance = unsafe extern "C" fn(*mut c_void, *const Interval, *const f64) -> c_int;
/// Callback that starts a law.
pub type StartLaw = unsafe extern "C" fn(*mut c_void, *const Setup) -> c_int;
/// Callback that takes new parameters of a law.
pub type RetuneLaw = unsafe extern "C" fn(*mut c_void, *const Setup, c_int);
/// Callback that answers a sample.
pub type Answer = unsafe extern "C" fn(*mut c_void, *const Sample, *mut f64, *mut f64) -> c_int;
/// Callback that saves.
pub type Save = unsafe extern "C" fn(*const c_void, *mut c_void) -> c_int;
/// Callback that restores.
pub type Restore = unsafe extern "C" fn(*mut c_void, *const c_void) -> c_int;
/// Callback after the last call.
pub type End = unsafe extern "C" fn(*mut c_void);
/// Callback of the integrator.
pub type Rates = unsafe extern "C" fn(*const c_void, f64, *const f64, *mut f64);

/// `hil_plant`.
#[derive(Debug)]
#[repr(C)]
pub struct Plant {
    /// [`API`] of the header.
    pub api: u32,
    /// Name.
    pub name: *const c_char,
    /// Summary in one sentence.
    pub summary: *const c_char,
    /// Version of the program.
    pub version: *const c_char,
    /// Parameters.
    pub parameters: Rows<Parameter>,
    /// True state and outputs.
    pub truth: Rows<Signal>,
    /// Readings of the sensors.
    pub measured: Rows<Signal>,
    /// The commands it takes.
    pub commands: Rows<Signal>,
    /// Bytes of its own memory.
    pub size: usize,
    /// Makes the state at step 0.
    pub start: Option<TakeRow>,
    /// Takes new parameters.
    pub retune: Option<TakeRow>,
    /// Writes the measured row.
    pub measure: Option<WriteRow>,
    /// Writes the row of truth.
    pub tell_truth: Option<WriteTruth>,
    /// Integrates over an interval.
    pub advance: Option<Advance>,
    /// Bytes of a saved state.
    pub saved_size: usize,
    /// Saves the state.
    pub save: Option<Save>,
    /// Puts a state back.
    pub restore: Option<Restore>,
    /// Function that is called at the end.
    pub end: Option<End>,
}

/// `hil_controller`.
#[derive(Debug)]
#[repr(C)]
pub struct Controller {
    /// [`API`] of the header.
    pub api: u32,
    /// Name.
    pub name: *const c_char,
    /// Summary in one sentence.
    pub summary: *const c_char,
    /// Version of the program.
    pub version: *const c_char,
    /// The plant it is made for.
    pub plant: *const c_char,
    /// Parameters.
    pub parameters: Rows<Parameter>,
    /// Model that it has of the plant.
    pub model: Rows<Parameter>,
    /// Measured signals it needs.
    pub measured: Rows<Signal>,
    /// Reference signals it needs.
    pub reference: Rows<Signal>,
    /// The commands it gives.
    pub commands: Rows<Signal>,
    /// Inner quantities it shows.
    pub internals: Rows<Signal>,
    /// Bytes of its own memory.
    pub size: usize,
    /// Makes it ready for the first sample.
    pub start: Option<StartLaw>,
    /// Answers a sample.
    pub step: Option<Answer>,
    /// Takes new parameters.
    pub retune: Option<RetuneLaw>,
    /// Sentence for whoever tunes it.
    pub tuning: *const c_char,
    /// Bytes of a saved state.
    pub saved_size: usize,
    /// Saves the state.
    pub save: Option<Save>,
    /// Puts a state back.
    pub restore: Option<Restore>,
    /// Function that is called at the end.
    pub end: Option<End>,
}
