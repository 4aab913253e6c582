//! The far end of a port: its wire, and the program there if the port file starts one.

use std::path::Path;

use hil_config::port::{Carries, Port};
use hil_session::supervision::Supervision;

use crate::peer::{Peer, longest_start};
use crate::wire::Wire;

/// Surroundings in which a far end is opened.
#[derive(Clone, Copy, Debug)]
pub struct Opening<'a> {
    /// Folder of the port file.
    pub folder: &'a Path,
    /// Time that the other side of the run may take, in s.
    pub wait_limit_s: f64,
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
            wait_limit_s,
            supervision,
        } = *opening;
        let wire = || Wire::open(port, sends, period_s, folder);
        let peer = || {
            Peer::start(
                &port.start,
                folder,
                longest_start(wait_limit_s),
                supervision,
            )
        };
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
