//! Ctrl-C and its like, as a flag that the commands look at.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};

use crate::exit::Failure;

/// Whether the user wants the command to end.
#[derive(Clone, Debug, Default)]
pub struct Interruption(Arc<AtomicBool>);

impl Interruption {
    /// Listens to the signals from now on.
    ///
    /// # Errors
    /// If they cannot be listened to.
    pub fn listen() -> Result<Self, Failure> {
        let flag = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            signal_hook::flag::register(signal, Arc::clone(&flag))
                .map_err(Failure::infrastructure)?;
        }
        // A file that may grow no more is an error to whoever writes it, not the end of the process.
        signal_hook::flag::register(SIGXFSZ, Arc::default()).map_err(Failure::infrastructure)?;
        Ok(Self(flag))
    }

    /// Whether a signal came.
    #[must_use]
    pub fn came(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }
}
