//! Terminal set up for the view and restored afterwards.
//!
//! However the view ends (by a return, an error, a panic or a signal), the terminal is restored: the guard is dropped
//! on the way out, and the panic hook, which may run on another thread, restores the terminal before printing.

use std::io::{self, Stdout, stdout};
use std::mem::ManuallyDrop;
use std::panic;
use std::sync::atomic::{AtomicBool, Ordering};

use ratatui::Terminal;
use ratatui::backend::CrosstermBackend;
use ratatui::crossterm::cursor::{Hide, Show};
use ratatui::crossterm::execute;
use ratatui::crossterm::terminal::{
    EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode, enable_raw_mode,
};

/// `true` while the view owns the terminal.
static TAKEN: AtomicBool = AtomicBool::new(false);

/// Terminal owned by the view. Dropping it restores the terminal.
pub struct Screen {
    /// Never dropped: on a closed terminal, its destructor would print an error to it.
    terminal: ManuallyDrop<Terminal<CrosstermBackend<Stdout>>>,
}

impl Screen {
    /// Takes over the terminal.
    ///
    /// # Errors
    /// If standard output is not a terminal, or the terminal does not answer.
    pub fn take() -> io::Result<Self> {
        let before = panic::take_hook();
        panic::set_hook(Box::new(move |panic| {
            restore();
            before(panic);
        }));
        enable_raw_mode()?;
        TAKEN.store(true, Ordering::Release);
        let result = execute!(stdout(), EnterAlternateScreen, Hide)
            .and_then(|()| Terminal::new(CrosstermBackend::new(stdout())));
        match result {
            Ok(terminal) => Ok(Self {
                terminal: ManuallyDrop::new(terminal),
            }),
            Err(error) => {
                restore();
                Err(error)
            }
        }
    }

    /// Returns the terminal to draw on.
    pub fn terminal(&mut self) -> &mut Terminal<CrosstermBackend<Stdout>> {
        &mut self.terminal
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        restore();
    }
}

/// Restores the terminal once. Errors are ignored: a closed terminal cannot be restored, and nobody sees it.
fn restore() {
    if TAKEN.swap(false, Ordering::AcqRel) {
        let _ = execute!(stdout(), Show, LeaveAlternateScreen);
        let _ = disable_raw_mode();
    }
}
