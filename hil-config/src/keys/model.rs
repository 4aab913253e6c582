//! Keys of `[plant]` and `[controller]` for imported models, that is FMUs.

use super::{Key, KeyKind, number};

pub(super) const TRUST_ARCHIVE: Key = key! {
    trust_archive: KeyKind::Boolean { default: false },
        "Permission for the archive of an FMU to unpack to more than 100 times its size, as one with a large table of zeros does; its other limits stay."
};

pub(super) const ALLOW_EXECUTION_TOOL: Key = key! {
    allow_execution_tool: KeyKind::Boolean { default: false },
        "Permission for an FMU that says it needs the tool it was made with (needsExecutionTool) to run and to start that tool."
};

pub(super) const TOLERANCE: Key = key! {
    tolerance: number("1", 1e-16, 1.0),
        "Relative tolerance of an FMU's solver. Default: that of the FMU's defaultExperiment, else the FMU's own."
};

pub(super) const START_TIME_S: Key = key! {
    start_time_s: number("s", -1e15, 1e15),
        "Time of an FMU at its first step. Default: startTime of the FMU's defaultExperiment, else 0."
};

pub(super) const STOP_TIME_S: Key = key! {
    stop_time_s: number("s", -1e15, 1e15),
        "Time of an FMU beyond which it will not be asked to go. Default: the FMU is told none."
};

pub(super) const INITIAL: Key = key! {
    initial: KeyKind::Described,
        "Initial values of an FMU's states, inputs and other variables that it calls exact or approximate, by their names in the FMU or in hil. Default: the FMU's own."
};

pub(super) const TEXTS: Key = key! {
    texts: KeyKind::Described, "Text parameters of an FMU. Default: the FMU's own."
};

pub(super) const FILES: Key = key! {
    files: KeyKind::Described,
        "Text parameters of an FMU that are files, relative to the scenario; the FMU gets the absolute path. Default: the FMU's own."
};

pub(super) const STRUCTURAL: Key = key! {
    structural: KeyKind::Described,
        "Structural parameters of an FMU, which set sizes of its arrays. Default: the FMU's own."
};
