//! Atomically written files, the folder of a run, runs found below a folder by the names of their files, and the list
//! of runs that a process has started. Reads only `summary.json` and the beginning of a file to determine its kind, and
//! never judges contents.

pub mod begun;
pub mod destination;
pub mod folder;
pub mod kind;
pub mod part_file;
pub mod runs;
