//! Files that appear whole or not at all, the folder of a run, and runs found below a folder by the names of their
//! files, and the list of runs that a process has begun. Of contents it reads `summary.json`, and the beginning of a
//! file for its kind; it never judges them.

pub(crate) mod begun;
pub(crate) mod destination;
pub(crate) mod folder;
pub(crate) mod kind;
pub(crate) mod part_file;
pub(crate) mod runs;
