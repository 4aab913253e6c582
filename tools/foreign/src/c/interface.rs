//! The structs of `hil.h`, field by field. A test compiles the header and compares sizes and offsets.

use std::ffi::{c_char, c_int, c_uint, c_void};

/// `HIL_API`: version of the header.
pub const API: u32 = 3;
/// Version whose structs end before `read` and `answer`.
pub(super) const API_WITHOUT_QUALITY: u32 = 1;
/// Version whose structs end before `state`.
pub(super) const API_WITHOUT_STATE: u32 = 2;
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
    /// One-sentence description.
    pub description: *const c_char,
    /// Default value.
    pub initial: f64,
    /// Smallest valid value.
    pub min: f64,
    /// Largest valid value.
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
    /// One-sentence description.
    pub description: *const c_char,
    /// Smallest valid value.
    pub min: f64,
    /// Largest valid value.
    pub max: f64,
}

/// `hil_parameters` and `hil_signals`.
#[derive(Debug)]
#[repr(C)]
pub struct Rows<T> {
    /// Pointer to the first row.
    pub rows: *const T,
    /// Number of rows.
    pub count: usize,
}

/// `hil_interval`.
#[derive(Debug)]
#[repr(C)]
pub struct Interval {
    /// Simulated time at the start of the interval, in s.
    pub start_s: f64,
    /// Length of the interval, in s.
    pub length_s: f64,
    /// Number of equal substeps.
    pub substeps: u32,
}

/// `hil_setup`.
#[derive(Debug)]
#[repr(C)]
pub struct Setup {
    /// Values of the parameters.
    pub parameters: *const f64,
    /// Values of the model parameters.
    pub model: *const f64,
    /// Time between two samples, in s.
    pub period_s: f64,
}

/// `hil_sample`.
#[derive(Debug)]
#[repr(C)]
pub struct Sample {
    /// Simulated time, in s.
    pub time_s: f64,
    /// Values of the measured signals.
    pub measured: *const f64,
    /// Values of the reference signals.
    pub reference: *const f64,
    /// Nonzero if all of these signals are valid.
    pub valid: c_int,
    /// Number of steps for which a command has been held.
    pub held_steps: u32,
}

/// `hil_quality`.
#[derive(Debug)]
#[repr(C)]
pub struct Quality {
    /// Nonzero for each invalid measured signal.
    pub measured_invalid: *const u8,
    /// Nonzero for each invalid reference signal.
    pub reference_invalid: *const u8,
    /// Age of each measured signal in steps.
    pub age_steps: *const u32,
}

/// Callback that reads a row.
pub type TakeRow = unsafe extern "C" fn(*mut c_void, *const f64) -> c_int;
/// Callback that writes a row.
pub type WriteRow = unsafe extern "C" fn(*const c_void, *mut f64) -> c_int;
/// Callback that writes the measured signals and marks the invalid ones.
pub type Read = unsafe extern "C" fn(*const c_void, *mut f64, *mut u8) -> c_int;
/// Callback that writes the true state.
pub type WriteTruth = unsafe extern "C" fn(*const c_void, f64, *const f64, *mut f64) -> c_int;
/// Callback that integrates.
pub type Advance = unsafe extern "C" fn(*mut c_void, *const Interval, *const f64) -> c_int;
/// Callback that starts a law.
pub type StartLaw = unsafe extern "C" fn(*mut c_void, *const Setup) -> c_int;
/// Callback that applies new parameters to a law.
pub type RetuneLaw = unsafe extern "C" fn(*mut c_void, *const Setup, c_int);
/// Callback that computes the answer to a sample.
pub type Answer = unsafe extern "C" fn(*mut c_void, *const Sample, *mut f64, *mut f64) -> c_int;
/// Callback that computes the answer to a sample from its quality too.
pub type AnswerWithQuality = unsafe extern "C" fn(
    *mut c_void,
    *const Sample,
    *const Quality,
    *mut f64,
    *mut f64,
    *mut u8,
) -> c_int;
/// Callback that saves the state.
pub type Save = unsafe extern "C" fn(*const c_void, *mut c_void) -> c_int;
/// Callback that restores a state.
pub type Restore = unsafe extern "C" fn(*mut c_void, *const c_void) -> c_int;
/// Callback that frees resources after the last call.
pub type End = unsafe extern "C" fn(*mut c_void);
/// Callback that computes derivatives for the integrator.
pub type Rates = unsafe extern "C" fn(*const c_void, f64, *const f64, *mut f64);

/// `hil_plant`.
#[derive(Debug)]
#[repr(C)]
pub struct Plant {
    /// API version of the header, [`API`].
    pub api: u32,
    /// Name.
    pub name: *const c_char,
    /// One-sentence summary.
    pub summary: *const c_char,
    /// Version of the program.
    pub version: *const c_char,
    /// Parameters.
    pub parameters: Rows<Parameter>,
    /// True state and outputs.
    pub truth: Rows<Signal>,
    /// Sensor readings.
    pub measured: Rows<Signal>,
    /// Commands that the plant accepts.
    pub commands: Rows<Signal>,
    /// Size of the plant's state memory, in bytes.
    pub size: usize,
    /// Initialises the state at step 0.
    pub start: Option<TakeRow>,
    /// Applies new parameters.
    pub retune: Option<TakeRow>,
    /// Writes the measured signals.
    pub measure: Option<WriteRow>,
    /// Writes the true state.
    pub tell_truth: Option<WriteTruth>,
    /// Integrates over an interval.
    pub advance: Option<Advance>,
    /// Size of a saved state, in bytes.
    pub saved_size: usize,
    /// Saves the state.
    pub save: Option<Save>,
    /// Restores a saved state.
    pub restore: Option<Restore>,
    /// Called once at the end.
    pub end: Option<End>,
    /// Writes the measured signals with their validity; not in version 1.
    pub read: Option<Read>,
    /// Start value of each command, NaN for none; may be null. Not in version 1.
    pub start_commands: *const f64,
    /// Names of the state's numbers; not in versions 1 and 2.
    pub state: Rows<Signal>,
    /// Writes the named numbers of the state; not in versions 1 and 2.
    pub tell_state: Option<WriteRow>,
    /// Sets the named numbers of the state; not in versions 1 and 2.
    pub take_state: Option<TakeRow>,
}

/// `hil_controller`.
#[derive(Debug)]
#[repr(C)]
pub struct Controller {
    /// API version of the header, [`API`].
    pub api: u32,
    /// Name.
    pub name: *const c_char,
    /// One-sentence summary.
    pub summary: *const c_char,
    /// Version of the program.
    pub version: *const c_char,
    /// Name of the plant that the controller is made for.
    pub plant: *const c_char,
    /// Parameters.
    pub parameters: Rows<Parameter>,
    /// Parameters of the law's model of the plant.
    pub model: Rows<Parameter>,
    /// Measured signals that the law needs.
    pub measured: Rows<Signal>,
    /// Reference signals that the law needs.
    pub reference: Rows<Signal>,
    /// Commands that the law produces.
    pub commands: Rows<Signal>,
    /// Internal signals that the law exposes.
    pub internals: Rows<Signal>,
    /// Size of the law's state memory, in bytes.
    pub size: usize,
    /// Prepares for the first sample.
    pub start: Option<StartLaw>,
    /// Computes the answer to a sample.
    pub step: Option<Answer>,
    /// Applies new parameters.
    pub retune: Option<RetuneLaw>,
    /// Sentence for users who tune the law.
    pub tuning: *const c_char,
    /// Size of a saved state, in bytes.
    pub saved_size: usize,
    /// Saves the state.
    pub save: Option<Save>,
    /// Restores a saved state.
    pub restore: Option<Restore>,
    /// Called once at the end.
    pub end: Option<End>,
    /// Computes the answer to a sample from its quality too; not in version 1.
    pub answer: Option<AnswerWithQuality>,
    /// Names of the state's numbers; not in versions 1 and 2.
    pub state: Rows<Signal>,
    /// Writes the named numbers of the state; not in versions 1 and 2.
    pub tell_state: Option<WriteRow>,
    /// Sets the named numbers of the state; not in versions 1 and 2.
    pub take_state: Option<TakeRow>,
}
