//! Files that appear whole or not at all, the folder of a run, and runs found below a folder by the names of their
//! files. Of contents it reads `summary.json` alone, and never judges it.

pub(crate) mod destination;
pub(crate) mod folder;
pub(crate) mod part_file;
pub(crate) mod runs;
