//! Detection of recordings that a running session still writes. Changes neither the recording nor the session.

use std::fs::File;
use std::path::Path;

use hil_console::terminal::exit::Failure;
use hil_session::session;
use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;

/// Refuses a recording that is still being written, which its writer's lock shows.
///
/// # Errors
/// If the recording is still being written, or cannot be opened.
pub fn refuse_live(path: &Path) -> Result<(), Failure> {
    let folder = path.canonicalize();
    let folder = folder.as_deref().ok().and_then(Path::parent);
    // If sessions cannot be listed, none is live: recordings may be read on any machine.
    let live = session::list().unwrap_or_default();
    let is_its = |info: &&session::SessionInfo| {
        let run_dir = info.run_dir.as_ref();
        let run_dir = run_dir.and_then(|folder| folder.canonicalize().ok());
        folder.is_some() && run_dir.as_deref() == folder
    };
    let path_text = path.display();
    if let Some(info) = live.iter().find(is_its) {
        let name = &info.name;
        return Err(Failure::usage(format!(
            "session `{name}` is still writing {path_text}"
        )));
    }
    // The writer may belong to another user, or the file may have been moved.
    let file = File::open(path).map_err(Failure::usage)?;
    match flock(&file, FlockOperation::NonBlockingLockShared) {
        Err(Errno::WOULDBLOCK) => Err(Failure::usage(format!(
            "{path_text} is still being written"
        ))),
        // Without file locks a live writer cannot be detected.
        _ => Ok(()),
    }
}
