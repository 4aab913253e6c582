//! Shell completion of command lines: candidates for each argument from files, running sessions and the
//! descriptions of programs.
//!
//! The shell's script calls `hil` for each completion ([`answered`]). Read-only: starts no run, leaves no files and
//! never prints a message. A user's program is started to describe itself; the built-in programs are known.

mod candidates;
mod line;
mod shells;

use std::ffi::OsStr;
use std::panic;
use std::path::Path;

use clap::{Arg, Command};
use clap_complete::Shell;
use clap_complete::engine::{ArgValueCompleter, CompletionCandidate};
use clap_complete::env::{CompleteEnv, Elvish, Fish, Powershell, Shells};

use crate::arguments;
use candidates::Source;
use line::Line;
use shells::{BASH, ZSH};

/// Environment variable that marks a completion request and names the shell.
const VARIABLE: &str = "HIL_COMPLETE";
/// Supported shells.
const SHELLS: Shells<'static> = Shells(&[&BASH, &Elvish, &Fish, &Powershell, &ZSH]);

/// Answers a completion request; returns `true` if this process was started for one.
pub(crate) fn answered() -> bool {
    let Some(shell) = std::env::var_os(VARIABLE) else {
        return false;
    };
    // Output would end up in the command line being typed.
    panic::set_hook(Box::new(|_| {}));
    let words = Line::words_of(std::env::args_os(), shell == "bash");
    if words.is_empty() {
        return true; // an unparsable line has no completions
    }
    let answer = || {
        let line = Line::new(words.clone());
        let here = std::env::current_dir().ok();
        CompleteEnv::with_factory(|| command(&line))
            .var(VARIABLE)
            .shells(SHELLS)
            .try_complete(Line::asked(words.clone()), here.as_deref())
    };
    let answered = panic::catch_unwind(panic::AssertUnwindSafe(answer));
    // Neither an invalid line nor an unknown shell has completions.
    !matches!(answered, Ok(Ok(false)))
}

/// Returns the shell's completion script, which calls this program by name if the program itself was started by name.
pub(crate) fn script(shell: Shell) -> String {
    let called = std::env::args().next().unwrap_or_default();
    let path = std::env::current_exe()
        .ok()
        .filter(|_| called.contains('/'));
    let hil = path.as_deref().and_then(Path::to_str).unwrap_or("hil");
    let mut text = Vec::new();
    if let Some(shell) = SHELLS.completer(&shell.to_string()) {
        // Writing to memory cannot fail.
        let _ = shell.write_registration(VARIABLE, "hil", "hil", hil, &mut text);
    }
    String::from_utf8_lossy(&text).into_owned()
}

/// Returns the clap command with the candidates of each argument.
fn command(line: &Line) -> Command {
    let command = arguments::command();
    let command = candidates::with_keys_of_the_kind(command, line);
    with_values(command, line)
}

fn with_values(command: Command, line: &Line) -> Command {
    let name = command.get_name().to_owned();
    // There are many options: they are offered only after a dash, or where nothing else fits.
    let is_option = line.typed().starts_with('-');
    command
        .disable_help_flag(!is_option)
        .disable_version_flag(!is_option)
        .mut_args(|argument| {
            let is_hidden = !is_option && !argument.is_positional();
            with_source(&name, argument, line).hide(is_hidden)
        })
        .mut_subcommands(|inner| with_values(inner, line))
}

fn with_source(command: &str, argument: Arg, line: &Line) -> Arg {
    let Some(source) = Source::of(command, &argument) else {
        return argument;
    };
    let line = line.clone();
    argument.add(ArgValueCompleter::new(
        move |typed: &OsStr| -> Vec<CompletionCandidate> { candidates::of(source, &line, typed) },
    ))
}
