//! Files that appear whole or not at all, wherever they go, the folder of a run, and the runs below a folder. Knows nothing of what is
//! in them.

pub(crate) mod destination;
pub(crate) mod folder;
pub(crate) mod part_file;
pub(crate) mod runs;
