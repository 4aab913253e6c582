//! Sides started by hand, for example in a debugger: prints the command that starts each side, and admits a process
//! that presents the session's token and runs the checked program.
//!
//! Waits without a time limit before anything else of the run is started. The sockets stay open until the end of the
//! run, so that a second process receives the reason for its refusal.

use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};

use hil_console::terminal::exit::Failure;
use hil_facts::programs::binaries::Binary;
use hil_session::file::hash;
use hil_session::live::{self, Listening};
use hil_session::manual_start::{Admission, Entry, Token, door, token_file};
use hil_session::process::ProcessId;
use hil_session::session::{Session, SessionInfo};
use rustix::net::sockopt::socket_peercred;
use shared_types::live::Refusal;
use shared_types::number::exact_in;
use shared_types::side::Side;

use super::prepared::PreparedRun;
use super::side::{LOOK, SideProcess};

/// Admitted sides of a run.
#[derive(Default)]
pub(crate) struct ByHand {
    pub(super) plant: Option<SideProcess>,
    pub(super) controller: Option<SideProcess>,
    _doors: Vec<Listening>,
}

impl ByHand {
    fn place(&mut self, role: Side) -> &mut Option<SideProcess> {
        match role {
            Side::Plant => &mut self.plant,
            Side::Controller => &mut self.controller,
        }
    }
}

/// Process that may become a side, with its connection.
type Admitted = (Side, ProcessId, UnixStream);

/// Waits for the sides of a run that are started by hand.
///
/// # Errors
/// If the user interrupts the wait, or an admitted side ends before all are admitted.
pub(super) fn admit(prepared: &PreparedRun, session: &mut Session) -> Result<ByHand, Failure> {
    let (sender, admitted) = channel();
    let mut by_hand = ByHand::default();
    for role in prepared.settings.by_hand.roles() {
        let binary = prepared.binaries.of_side(role);
        let opened = open(&prepared.session, role, binary.clone(), sender.clone());
        by_hand
            ._doors
            .push(opened.map_err(Failure::infrastructure)?);
        tell_command(prepared, role, &binary.path)?;
    }
    drop(sender);
    for _ in 0..by_hand._doors.len() {
        let (role, process, leash) = next(&admitted, prepared, &mut by_hand)?;
        let pid = process.pid;
        match role {
            Side::Plant => session.add_child(pid),
            Side::Controller => session.add_controller(1, pid),
        }
        .map_err(Failure::infrastructure)?;
        tell!("{}: process {pid} is admitted", role.name());
        *by_hand.place(role) = Some(SideProcess::by_hand(role.name(), process, leash));
    }
    Ok(by_hand)
}

/// Waits for the next process.
fn next(
    admitted: &Receiver<Admitted>,
    prepared: &PreparedRun,
    by_hand: &mut ByHand,
) -> Result<Admitted, Failure> {
    loop {
        match admitted.recv_timeout(LOOK) {
            Ok(one) => return Ok(one),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => {
                return Err(Failure::infrastructure("no more sides can be admitted"));
            }
        }
        prepared.interruption.check()?;
        for role in Side::ALL {
            if let Some(side) = by_hand.place(role)
                && side.has_ended()
            {
                let name = role.name();
                let death = side.death().unwrap_or_else(|| format!("{name} ended"));
                return Err(Failure::infrastructure(format!(
                    "{death}, before the run began"
                )));
            }
        }
    }
}

/// Prints the command that starts a side, with advice.
fn tell_command(prepared: &PreparedRun, role: Side, program: &Path) -> Result<(), Failure> {
    let words = [program, &prepared.session.folder].map(Path::to_str);
    let [Some(program), Some(folder)] = words else {
        return Err(Failure::usage(format!(
            "{}: its path is not valid UTF-8, so no command can be printed; rename the path",
            program.display()
        )));
    };
    let words = [program, "--session", folder, "--by-hand"];
    let command = shlex::try_join(words).map_err(Failure::usage)?;
    let (side, limit_s) = (role.name(), prepared.settings.wait_limit_s);
    let limit = if limit_s.is_finite() {
        format!(
            "after hello the run waits at most {} for each answer; use --wait-limit inf with a debugger",
            exact_in(limit_s, "s")
        )
    } else {
        "a debugger may stop the program for any length of time".to_owned()
    };
    tell!(
        "{side}: waits to be started by hand, in another terminal (Ctrl-C ends the wait); {limit}\n  {command}"
    );
    Ok(())
}

/// Opens the socket of a side and writes its token.
fn open(
    session: &SessionInfo,
    role: Side,
    binary: Binary,
    admitted: Sender<Admitted>,
) -> Result<Listening, String> {
    let token = Token::random().map_err(|error| format!("/dev/urandom: {error}"))?;
    let (own, mut occupant) = (token.clone(), None);
    let listening = live::listen(session, &door(role), move |client| {
        // A process that disconnected needs no answer.
        let _ = live::answer(client, |entry| {
            let verdict = (entry.map_err(|refusal: Refusal| refusal.message))
                .and_then(|entry| judge(client, &entry, &own, (role, &binary), occupant))
                .and_then(|process| {
                    let leash = client.try_clone().map_err(|error| error.to_string())?;
                    let result = admitted.send((role, process, leash));
                    result.map_err(|_| "the run is over".to_owned())?;
                    Ok(process)
                });
            match verdict {
                Ok(process) => {
                    occupant = Some(process);
                    Admission::Admitted
                }
                Err(reason) => Admission::Refused { reason },
            }
        });
    })?;
    // Written last: a process that reads it can connect at once.
    let written = session.write_file(&token_file(role), &token);
    written.map_err(|error| error.to_string())?;
    Ok(listening)
}

/// Checks a process that asks to be a side, beginning with its token; without a valid token the process learns nothing
/// else.
fn judge(
    client: &UnixStream,
    Entry { token, process }: &Entry,
    own: &Token,
    (role, binary): (Side, &Binary),
    occupant: Option<ProcessId>,
) -> Result<ProcessId, String> {
    let side = role.name();
    if !own.is(token) {
        return Err(format!(
            "the token does not belong to the {side} of this session"
        ));
    }
    let peer = socket_peercred(client).map_err(|error| error.to_string())?;
    if peer.uid != rustix::process::geteuid() {
        return Err("the process belongs to another user".into());
    }
    let pid = peer.pid.as_raw_nonzero().get().cast_unsigned();
    if pid != process.pid || ProcessId::of(pid) != Some(*process) {
        return Err(format!(
            "it claims to be process {}, but process {pid} is connected",
            process.pid
        ));
    }
    if let Some(ProcessId { pid, .. }) = occupant {
        return Err(format!("process {pid} is already the {side} of this run"));
    }
    let file = format!("/proc/{pid}/exe");
    let program = std::fs::read_link(&file).map(|path| path.display().to_string());
    let program = program.unwrap_or_else(|_| "its program".into());
    let actual = hash(Path::new(&file)).map_err(|error| format!("{program}: {error}"))?;
    if actual != binary.blake3 {
        let (path, expected) = (binary.path.display(), &binary.blake3);
        return Err(format!(
            "process {pid} runs {program} with hash {actual}, but the checked program is {path} with hash {expected}: start that program, or name yours with --{side}-bin"
        ));
    }
    Ok(*process)
}
