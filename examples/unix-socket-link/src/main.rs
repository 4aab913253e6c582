//! Runs a scenario over UNIX sockets and prints its digest: `unix-socket-link SCENARIO`.

use std::path::Path;
use std::process::ExitCode;

use unix_socket_link::link::UnixSocketLink;
use unix_socket_link::run::run;

fn main() -> ExitCode {
    let Some(scenario) = std::env::args_os().nth(1) else {
        eprintln!("usage: unix-socket-link SCENARIO");
        return ExitCode::from(2);
    };
    match digest(Path::new(&scenario)) {
        Ok(digest) => {
            println!("digest {digest}");
            ExitCode::SUCCESS
        }
        Err(reason) => {
            eprintln!("{reason}");
            ExitCode::FAILURE
        }
    }
}

fn digest(scenario: &Path) -> Result<String, String> {
    let folder = tempfile::tempdir().map_err(|e| e.to_string())?; // nobody else can enter it
    let plant = UnixSocketLink::create(folder.path()).map_err(|e| e.to_string())?;
    let place = folder.path().to_owned();
    run(scenario, 1, plant, move || UnixSocketLink::open(&place, 1))
}
