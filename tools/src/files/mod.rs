//! Files that appear whole or not at all, wherever they go, and the folder of a run. Knows nothing of what is
//! in them.

pub(crate) mod destination;
pub(crate) mod folder;
pub(crate) mod part_file;
