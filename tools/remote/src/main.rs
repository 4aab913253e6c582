//! Program of both ends: `hil` starts it at the desk in the controller's place, and `ssh` or a service manager
//! starts it on the target.

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use hil_session::program::{FAILED, UNUSABLE, say, with_stack};
use hil_session::supervision::end_with;
use hil_target::name::Target;
use hil_target::programs::AllowedPrograms;
use hil_target::way::Way;
use hil_target::{agent, bridge, serve};

/// The controller of a hil run on another machine
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    #[command(subcommand)]
    end: Mode,
}

#[derive(Debug, Subcommand)]
enum Mode {
    /// Serve one desk through standard input and output; started by hil through ssh
    Agent,
    /// Serve one desk after another that has the key; for boards without ssh
    Serve {
        /// Address to listen on, as 192.0.2.7:7000
        #[arg(long, value_name = "ADDRESS:PORT")]
        listen: SocketAddr,
        /// File with the key, which `hil target key FILE` creates
        #[arg(long, value_name = "FILE")]
        key_file: PathBuf,
        /// Program that may be run; may be given several times
        #[arg(long, value_name = "PROGRAM", required = true)]
        allow: Vec<PathBuf>,
    },
    /// Have the controller's place in a session; started by hil
    Bridge {
        /// The target
        #[arg(long)]
        target: Target,
        /// Agent that was named
        #[arg(long)]
        agent: Option<PathBuf>,
        /// File with the key of a listening agent
        #[arg(long)]
        key_file: Option<PathBuf>,
        /// The controller's file
        #[arg(long)]
        program: PathBuf,
        /// Hash that the file must have
        #[arg(long)]
        blake3: String,
        /// Folder of the session
        #[arg(long)]
        session: PathBuf,
    },
}

fn main() -> ExitCode {
    with_stack(run)
}

fn run() -> ExitCode {
    let failed = |reason| (FAILED, reason);
    let ended = match Arguments::parse().end {
        Mode::Agent => serve_ssh().map(|()| 0).map_err(failed),
        Mode::Serve {
            listen,
            key_file,
            allow,
        } => (serve::serve(listen, &key_file, &allow, say).map(|()| 0))
            .map_err(|reason| (UNUSABLE, reason)),
        Mode::Bridge {
            target,
            agent,
            key_file,
            program,
            blake3,
            session,
        } => {
            let way = Way {
                target,
                agent,
                key_file,
                silence: Way::SILENCE,
            };
            bridge::run(&way, (&program, &blake3), &session).map_err(failed)
        }
    };
    ExitCode::from(ended.unwrap_or_else(|(code, reason)| {
        say(&format!("error: {reason}"));
        code
    }))
}

/// Serves the desk behind `ssh`, at the address through which it connected.
fn serve_ssh() -> Result<(), String> {
    let connection = std::env::var("SSH_CONNECTION").unwrap_or_default();
    let own = connection
        .split(' ')
        .nth(2)
        .and_then(|own| own.parse().ok());
    let programs = AllowedPrograms::cached()?;
    end_with(io::stdin());
    let ends = (io::stdin(), io::stdout());
    agent::run(ends, None, &programs, own, || Ok(()), |_| ())
}
