//! The shared library of an FMU and its functions, looked up by name.
//!
//! The library runs in this process, which it may crash, exit or block for ever. This module checks as much as possible
//! in advance: that every function that will be called exists, and that the library has the version that the model
//! description declares.

use std::collections::BTreeMap;
use std::ffi::{CStr, c_char, c_int, c_void};
use std::mem::ManuallyDrop;
use std::path::Path;

use libloading::os::unix::Library;
use shared_types::text;

use super::description::{VariableType, Version};
use crate::crash::{self, calling};
use crate::float_modes;

mod elf;
pub(super) mod host;

/// Handle of an instance, or of a saved state, in the library.
pub(super) type Handle = *mut c_void;

/// Error of loading a library.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LibraryError {
    /// The library cannot be loaded.
    #[error("the FMU's library cannot be loaded: {0}")]
    Load(String),
    /// A function is missing.
    #[error("the FMU's library has no function `{0}`")]
    Missing(String),
    /// The versions of library and model description differ.
    #[error("the FMU's library uses FMI {library}, but the model description uses {description}")]
    Version {
        /// Version that the library reports.
        library: String,
        /// Version of the description.
        description: Version,
    },
}

pub(super) type OnInstance = unsafe extern "C" fn(Handle) -> c_int;
pub(super) type FreeInstance = unsafe extern "C" fn(Handle);
pub(super) type OnState = unsafe extern "C" fn(Handle, Handle) -> c_int;
pub(super) type OnStatePlace = unsafe extern "C" fn(Handle, *mut Handle) -> c_int;
pub(super) type StateSize = unsafe extern "C" fn(Handle, Handle, *mut usize) -> c_int;
pub(super) type Serialize = unsafe extern "C" fn(Handle, Handle, *mut u8, usize) -> c_int;
pub(super) type Deserialize = unsafe extern "C" fn(Handle, *const u8, usize, *mut Handle) -> c_int;

type GetVersion = unsafe extern "C" fn() -> *const c_char;

/// `fmi2GetXXX`: instance, value references, their number, values.
pub(super) type GetTwo = unsafe extern "C" fn(Handle, *const u32, usize, *mut c_void) -> c_int;
/// `fmi2SetXXX`.
pub(super) type SetTwo = unsafe extern "C" fn(Handle, *const u32, usize, *const c_void) -> c_int;
/// `fmi3GetXXX`: as in FMI 2, followed by the number of values.
pub(super) type GetThree =
    unsafe extern "C" fn(Handle, *const u32, usize, *mut c_void, usize) -> c_int;
/// `fmi3SetXXX`.
pub(super) type SetThree =
    unsafe extern "C" fn(Handle, *const u32, usize, *const c_void, usize) -> c_int;

/// `fmi2GetDirectionalDerivative`: instance, unknowns, their number, knowns, their number, seed, result.
pub(super) type DerivativeTwo = unsafe extern "C" fn(
    Handle,
    *const u32,
    usize,
    *const u32,
    usize,
    *const f64,
    *mut f64,
) -> c_int;
/// `fmi3GetDirectionalDerivative`: as in FMI 2, with the lengths of seed and result.
pub(super) type DerivativeThree = unsafe extern "C" fn(
    Handle,
    *const u32,
    usize,
    *const u32,
    usize,
    *const f64,
    usize,
    *mut f64,
    usize,
) -> c_int;

/// Function for directional derivatives.
#[derive(Clone, Copy, Debug)]
pub(super) enum DerivativeFunction {
    Two(DerivativeTwo),
    Three(DerivativeThree),
}

/// Functions that read and write variables of one type.
#[derive(Clone, Copy, Debug)]
pub(super) enum Access {
    Two(GetTwo, SetTwo),
    Three(GetThree, SetThree),
}

/// Callbacks that FMI 2 passes as one struct; its pointer must stay valid while the instance lives.
#[repr(C)]
pub(super) struct CallbacksTwo {
    pub(super) logger: unsafe extern "C" fn(
        *mut c_void,
        *const c_char,
        c_int,
        *const c_char,
        *const c_char,
        usize,
    ),
    pub(super) allocate: unsafe extern "C" fn(usize, usize) -> *mut c_void,
    pub(super) free: unsafe extern "C" fn(*mut c_void),
    pub(super) step_finished: Option<unsafe extern "C" fn(*mut c_void, c_int)>,
    pub(super) environment: *mut c_void,
}

pub(super) type InstantiateTwo = unsafe extern "C" fn(
    *const c_char,
    c_int,
    *const c_char,
    *const c_char,
    *const CallbacksTwo,
    c_int,
    c_int,
) -> Handle;
pub(super) type SetupTwo = unsafe extern "C" fn(Handle, c_int, f64, f64, c_int, f64) -> c_int;
pub(super) type StepTwo = unsafe extern "C" fn(Handle, f64, f64, c_int) -> c_int;
pub(super) type LoggingTwo =
    unsafe extern "C" fn(Handle, c_int, usize, *const *const c_char) -> c_int;
pub(super) type StatusTwo = unsafe extern "C" fn(Handle, c_int, *mut c_int) -> c_int;

pub(super) type LogThree = unsafe extern "C" fn(*mut c_void, c_int, *const c_char, *const c_char);
pub(super) type InstantiateThree = unsafe extern "C" fn(
    *const c_char,
    *const c_char,
    *const c_char,
    bool,
    bool,
    bool,
    bool,
    *const u32,
    usize,
    *mut c_void,
    LogThree,
    *const c_void,
) -> Handle;
pub(super) type EnterThree = unsafe extern "C" fn(Handle, bool, f64, f64, bool, f64) -> c_int;
pub(super) type StepThree =
    unsafe extern "C" fn(Handle, f64, f64, bool, *mut u8, *mut u8, *mut u8, *mut f64) -> c_int;
pub(super) type LoggingThree =
    unsafe extern "C" fn(Handle, bool, usize, *const *const c_char) -> c_int;

/// Functions that differ between the versions of the standard.
#[derive(Debug)]
pub(super) enum Own {
    Two {
        instantiate: InstantiateTwo,
        setup: SetupTwo,
        enter: OnInstance,
        step: StepTwo,
        logging: LoggingTwo,
        /// Queries whether a discarded step was the end of the model.
        status: StatusTwo,
    },
    Three {
        instantiate: InstantiateThree,
        enter: EnterThree,
        step: StepThree,
        logging: LoggingThree,
    },
}

/// Functions for saving and restoring the state.
#[derive(Debug)]
pub(super) struct StateFunctions {
    pub(super) get: OnStatePlace,
    pub(super) set: OnState,
    pub(super) free: OnStatePlace,
    pub(super) size: StateSize,
    pub(super) serialize: Serialize,
    pub(super) deserialize: Deserialize,
}

/// Optional capabilities that a run uses.
#[derive(Clone, Copy, Debug)]
pub(super) struct Uses {
    /// `true` if states are to be saved, which requires the library's state functions.
    pub(super) state: bool,
    /// The library needs the tool that generated it.
    pub(super) tool: bool,
    /// Structural parameters are set.
    pub(super) configuration: bool,
    /// Directional derivatives are promised.
    pub(super) derivatives: bool,
}

/// Functions of a library that are called.
#[derive(Debug)]
pub(super) struct Functions {
    pub(super) own: Own,
    pub(super) exit: OnInstance,
    pub(super) terminate: OnInstance,
    pub(super) free: FreeInstance,
    pub(super) state: Option<StateFunctions>,
    /// Entry and exit of configuration mode, in which structural parameters are set.
    pub(super) configuration: Option<[OnInstance; 2]>,
    /// Directional derivatives; `None` also if the library lacks what its description promises, because no run needs it.
    pub(super) derivative: Option<DerivativeFunction>,
    pub(super) access: BTreeMap<VariableType, Access>,
}

impl Functions {
    /// Loads a library, for variables of these types. The library is never unloaded, because a thread that it started
    /// could still be running. If the library needs its tool, its symbols become available to all libraries that it
    /// loads.
    ///
    /// # Errors
    /// If the library cannot be loaded, has another version or lacks a function.
    pub(super) fn load(
        path: &Path,
        version: Version,
        kinds: &[VariableType],
        uses: &Uses,
    ) -> Result<Self, LibraryError> {
        // Constructors of the library run during loading.
        crash::install(&"");
        let call = calling(&"dlopen");
        let library = host::load(path, uses.tool);
        drop(call);
        // A library linked with -ffast-math enables flush-to-zero during loading.
        float_modes::settle("dlopen");
        let library = library?;
        let library = ManuallyDrop::new(library);
        crash::install(match version {
            Version::Two => &"fmi2",
            Version::Three => &"fmi3",
        });
        let find = Find {
            library: &library,
            version,
        };
        find.check_version()?;
        // SAFETY: each name has the type that the headers of its version declare.
        let functions = unsafe {
            Self {
                own: find.own()?,
                exit: find.function("ExitInitializationMode")?,
                terminate: find.function("Terminate")?,
                free: find.function("FreeInstance")?,
                state: if uses.state {
                    Some(find.state()?)
                } else {
                    None
                },
                configuration: match uses.configuration {
                    true => Some([
                        find.function("EnterConfigurationMode")?,
                        find.function("ExitConfigurationMode")?,
                    ]),
                    false => None,
                },
                derivative: match uses.derivatives {
                    true => find.derivative().ok(),
                    false => None,
                },
                access: (kinds.iter())
                    .map(|kind| Ok((*kind, find.access(*kind)?)))
                    .collect::<Result<_, LibraryError>>()?,
            }
        };
        Ok(functions)
    }
}

/// Library, with the version that prefixes the names of its functions.
struct Find<'a> {
    library: &'a Library,
    version: Version,
}

impl Find<'_> {
    /// Looks up a function by its name without the version prefix.
    ///
    /// # Safety
    /// `T` must be the function's C type.
    unsafe fn function<T: Copy>(&self, name: &str) -> Result<T, LibraryError> {
        let number = match self.version {
            Version::Two => 2,
            Version::Three => 3,
        };
        let full = format!("fmi{number}{name}\0");
        // SAFETY: guaranteed by the caller.
        let symbol = unsafe { self.library.get::<T>(full.as_bytes()) };
        match symbol {
            Ok(symbol) if !symbol.clone().into_raw().is_null() => Ok(*symbol),
            _ => Err(LibraryError::Missing(full.trim_end_matches('\0').into())),
        }
    }

    fn check_version(&self) -> Result<(), LibraryError> {
        // SAFETY: `const char* fmiXGetVersion(void)` in both versions.
        let version_text = unsafe {
            let version: GetVersion = self.function("GetVersion")?;
            let _call = calling(&"GetVersion");
            version()
        };
        float_modes::settle("GetVersion");
        let library = if version_text.is_null() {
            String::new()
        } else {
            // SAFETY: not null, and a text of the library.
            text::line(&unsafe { CStr::from_ptr(version_text) }.to_string_lossy())
        };
        let expected = match self.version {
            Version::Two => "2.0",
            Version::Three => "3.0",
        };
        if library.starts_with(expected) {
            return Ok(());
        }
        Err(LibraryError::Version {
            library,
            description: self.version,
        })
    }

    /// # Safety
    /// None required from the caller: the types are those of the headers.
    unsafe fn own(&self) -> Result<Own, LibraryError> {
        // SAFETY: the types are those of fmi2FunctionTypes.h and fmi3FunctionTypes.h.
        unsafe {
            Ok(match self.version {
                Version::Two => Own::Two {
                    instantiate: self.function("Instantiate")?,
                    setup: self.function("SetupExperiment")?,
                    enter: self.function("EnterInitializationMode")?,
                    step: self.function("DoStep")?,
                    logging: self.function("SetDebugLogging")?,
                    status: self.function("GetBooleanStatus")?,
                },
                Version::Three => Own::Three {
                    instantiate: self.function("InstantiateCoSimulation")?,
                    enter: self.function("EnterInitializationMode")?,
                    step: self.function("DoStep")?,
                    logging: self.function("SetDebugLogging")?,
                },
            })
        }
    }

    /// # Safety
    /// See [`own`](Self::own).
    unsafe fn state(&self) -> Result<StateFunctions, LibraryError> {
        let (state, de) = match self.version {
            Version::Two => ("state", "DeSerialize"),
            Version::Three => ("State", "Deserialize"),
        };
        // SAFETY: the types are those of the headers; both versions differ only in the names.
        unsafe {
            Ok(StateFunctions {
                get: self.function(&format!("GetFMU{state}"))?,
                set: self.function(&format!("SetFMU{state}"))?,
                free: self.function(&format!("FreeFMU{state}"))?,
                size: self.function(&format!("SerializedFMU{state}Size"))?,
                serialize: self.function(&format!("SerializeFMU{state}"))?,
                deserialize: self.function(&format!("{de}FMU{state}"))?,
            })
        }
    }

    /// # Safety
    /// See [`own`](Self::own).
    unsafe fn derivative(&self) -> Result<DerivativeFunction, LibraryError> {
        let name = "GetDirectionalDerivative";
        // SAFETY: the types are those of the headers.
        unsafe {
            Ok(match self.version {
                Version::Two => DerivativeFunction::Two(self.function(name)?),
                Version::Three => DerivativeFunction::Three(self.function(name)?),
            })
        }
    }

    /// # Safety
    /// See [`own`](Self::own).
    unsafe fn access(&self, kind: VariableType) -> Result<Access, LibraryError> {
        let names = access_names(self.version, kind);
        let Some([get, set]) = names else {
            return Err(LibraryError::Missing(format!("for a {}", kind.name())));
        };
        // SAFETY: as in the headers; a pointer to values of any type is passed like any other.
        unsafe {
            Ok(match self.version {
                Version::Two => Access::Two(self.function(get)?, self.function(set)?),
                Version::Three => Access::Three(self.function(get)?, self.function(set)?),
            })
        }
    }
}

/// Returns the names of the functions that read and write variables of a type, without the version prefix: `SetReal` for
/// `fmi2SetReal`. Values pass through [`Access`], which `values` calls for each group of variables of one type.
pub(super) fn access_names(
    version: Version,
    kind: VariableType,
) -> Option<[&'static &'static str; 2]> {
    Some(match (version, kind) {
        (Version::Two, VariableType::Float64) => [&"GetReal", &"SetReal"],
        (Version::Two, VariableType::Int32 | VariableType::Enumeration) => {
            [&"GetInteger", &"SetInteger"]
        }
        (Version::Three, VariableType::Float32) => [&"GetFloat32", &"SetFloat32"],
        (Version::Three, VariableType::Float64) => [&"GetFloat64", &"SetFloat64"],
        (Version::Three, VariableType::Int8) => [&"GetInt8", &"SetInt8"],
        (Version::Three, VariableType::UInt8) => [&"GetUInt8", &"SetUInt8"],
        (Version::Three, VariableType::Int16) => [&"GetInt16", &"SetInt16"],
        (Version::Three, VariableType::UInt16) => [&"GetUInt16", &"SetUInt16"],
        (Version::Three, VariableType::Int32) => [&"GetInt32", &"SetInt32"],
        (Version::Three, VariableType::UInt32) => [&"GetUInt32", &"SetUInt32"],
        (Version::Three, VariableType::Int64 | VariableType::Enumeration) => {
            [&"GetInt64", &"SetInt64"]
        }
        (Version::Three, VariableType::UInt64) => [&"GetUInt64", &"SetUInt64"],
        (_, VariableType::String) => [&"GetString", &"SetString"],
        (_, VariableType::Boolean) => [&"GetBoolean", &"SetBoolean"],
        _ => return None,
    })
}
