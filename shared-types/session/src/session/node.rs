//! The iceoryx2 nodes of a session.

use iceoryx2::prelude::{Node, NodeBuilder, SignalHandlingMode, ipc};

use super::SessionInfo;
use crate::shared_memory::refused;

impl SessionInfo {
    /// Creates the iceoryx2 node of one process in the session.
    ///
    /// # Errors
    /// If the session's shared memory cannot be used; the error states the reason.
    pub fn node(&self, name: &str) -> Result<Node<ipc::Service>, String> {
        let config = self.iceoryx_config().map_err(refused)?;
        let node = NodeBuilder::new()
            .name(&name.try_into().map_err(refused)?)
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(refused)?;
        self.tighten();
        Ok(node)
    }
}
