//! The far end of a port: its wire, and the program there if the port file starts one.

use std::path::Path;
use std::time::Duration;

use hil_config::port::{Carries, Port};
use hil_session::supervision::Supervision;

use crate::peer::Peer;
use crate::wire::Wire;

/// Surroundings in which a far end is opened.
#[derive(Clone, Copy, Debug)]
pub struct Opening<'a> {
    /// Folder of the port file.
    pub folder: &'a Path,
    /// Longest wait for the started program.
    pub limit: Duration,
    /// Requests of the launcher, which may end the wait.
    pub supervision: &'a Supervision,
}

/// Opened far end.
pub struct FarEnd {
    /// Frames and media.
    pub wire: Wire,
    /// Started program.
    pub peer: Option<Peer>,
}

impl FarEnd {
    /// Opens the media for a side that sends one direction, and starts the program.
    ///
    /// # Errors
    /// If a medium cannot be opened, or the program does not get ready.
    pub fn open(
        port: &Port,
        sends: Carries,
        period_s: f64,
        opening: &Opening<'_>,
    ) -> Result<Self, String> {
        let Opening {
            folder,
            limit,
            supervision,
        } = *opening;
        let wire = || Wire::open(port, sends, period_s, folder);
        let peer = || Peer::start(&port.start, folder, limit, supervision);
        // A program that says when it is ready may use the addresses of the port until then.
        Ok(match port.start.ready {
            Some(_) => {
                let peer = peer()?;
                let wire = wire()?;
                Self { wire, peer }
            }
            None => {
                let wire = wire()?;
                let peer = peer()?;
                Self { wire, peer }
            }
        })
    }
}
