//! Files that appear whole or not at all, the folder of a run, and runs found below a folder by the names of their
//! files, and the list of runs that a process has begun. Of contents it reads `summary.json`, and the beginning of a
//! file for its kind; it never judges them.

pub mod begun;
pub mod destination;
pub mod folder;
pub mod kind;
pub mod part_file;
pub mod runs;
