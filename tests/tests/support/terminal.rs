//! Terminal for a test: a pseudo-terminal with a program in it, and the content of its screen.

use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::OwnedFd;
use std::process::{Command, ExitStatus};
use std::sync::{Arc, Mutex, PoisonError};

use rustix::termios::tcgetattr;

use crate::pseudo_terminal::{open_terminal, resize};
use crate::support::company::Companion;
use crate::support::harness::{ended, until};

/// Program in a terminal. Dropped before its end, it is killed.
pub(crate) struct Terminal {
    keyboard: File,
    /// Kept open, so that its settings can be read after the program ended.
    line: OwnedFd,
    settings: String,
    screen: Arc<Mutex<vt100::Parser>>,
    process: Companion,
}

impl Terminal {
    /// Starts a program in a terminal of the given size.
    pub(crate) fn start(mut program: Command, (columns, rows): (u16, u16)) -> Self {
        let (master, line) = open_terminal(columns, rows);
        let settings = format!("{:?}", tcgetattr(&line).expect("its settings"));
        let end = || line.try_clone().expect("another handle");
        program
            .stdin(end())
            .stdout(end())
            .stderr(end())
            .env("TERM", "xterm-256color")
            .env("LC_ALL", "C.UTF-8")
            .env_remove("NO_COLOR")
            .env_remove("RUST_BACKTRACE");
        let process = Companion::start(&mut program);
        let screen = Arc::new(Mutex::new(vt100::Parser::new(rows, columns, 0)));
        let text = Arc::clone(&screen);
        let mut output = File::from(master.try_clone().expect("another handle"));
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            // An error means the end, as when the terminal is closed.
            while let Ok(count @ 1..) = output.read(&mut bytes) {
                let mut text = text.lock().unwrap_or_else(PoisonError::into_inner);
                text.process(&bytes[..count]);
            }
        });
        Self {
            keyboard: File::from(master),
            line,
            settings,
            screen,
            process,
        }
    }

    /// Returns the text on the screen.
    pub(crate) fn text(&self) -> String {
        self.with_screen(vt100::Screen::contents)
    }

    fn with_screen<T>(&self, read: impl FnOnce(&vt100::Screen) -> T) -> T {
        read(
            self.screen
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .screen(),
        )
    }

    /// Waits until the screen shows a text.
    pub(crate) fn until_it_shows(&self, expected: &str) {
        until(&format!("`{expected}` is shown"), || {
            self.text().contains(expected)
        });
    }

    /// Types a text.
    pub(crate) fn press(&mut self, keys: &str) {
        (self.keyboard.write_all(keys.as_bytes())).expect("the terminal takes keys");
    }

    /// Resizes the terminal, like a user dragging its corner.
    pub(crate) fn resize(&self, columns: u16, rows: u16) {
        let mut screen = self.screen.lock().unwrap_or_else(PoisonError::into_inner);
        screen.screen_mut().set_size(rows, columns);
        resize(&self.keyboard, columns, rows);
        drop(screen);
        // A terminal signals its foreground processes, which exclude a test's program.
        crate::support::harness::send(self.pid(), rustix::process::Signal::WINCH);
    }

    /// Returns the ID of the program's process.
    pub(crate) fn pid(&self) -> u32 {
        self.process.id()
    }

    /// Waits for the program's end.
    pub(crate) fn wait(&mut self) -> ExitStatus {
        ended(&mut self.process)
    }

    /// Fails unless the terminal is in the state before the program.
    pub(crate) fn assert_restored(&self, after: &str) {
        until(&format!("the screen is given back after {after}"), || {
            self.with_screen(|screen| !screen.alternate_screen() && !screen.hide_cursor())
        });
        let settings = format!("{:?}", tcgetattr(&self.line).expect("its settings"));
        assert_eq!(settings, self.settings, "after {after}");
    }

    /// Returns `true` if the program uses the alternate screen.
    pub(crate) fn is_taken(&self) -> bool {
        self.with_screen(|screen| screen.alternate_screen() && screen.hide_cursor())
    }
}
