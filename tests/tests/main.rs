//! Tests over the whole workspace, in one binary: facts that hold only when everything works together.
//!
//! | module | proves |
//! |---|---|
//! | [`architecture`] | packages, binaries and dependency arrows, of packages and of their modules |
//! | [`completion`] | what is offered in the real shells, and that nothing else comes of it |
//! | [`clocks`] | lockstep, paced and real time; what comes too late and how it is repeated |
//! | [`audit`] | what depends on more than its samples is caught |
//! | [`bad_input`] | any bytes through every reader: taken or refused by name, never a panic |
//! | [`chatter`] | controllers that never fall silent hold no run |
//! | [`checkpoints`] | a run that goes on is the straight run, and what cannot go on is refused |
//! | [`baselines`] | runs against named runs, by digest, by samples and by figures |
//! | [`book`] | what README and book tell can be done, shows what they show, and leads where they say |
//! | [`by_hand`] | sides that somebody starts by hand: the same digest, and nobody else in their place |
//! | [`campaign`] | very many cases: each once, with the digest of a run of its own |
//! | [`cli`] | bad input: a clear error, exit code 2, nothing started |
//! | [`connect`] | a law on plants with other names and units |
//! | [`determinism`] | one digest, however and wherever a scenario runs |
//! | [`doctor`] | every check once, and a verdict that follows |
//! | [`examples`] | a plant and a controller from outside the workspace |
//! | [`export`] | tables made of a recording, read by others |
//! | [`excerpts`] | recordings of which not all is kept |
//! | [`failures`] | deaths, stops and divergence: who, what, which step, and what is left |
//! | [`faults`] | faults of scenarios in whole runs |
//! | [`fmu`] | FMUs as plants and controllers: FMPy's numbers, and what misbehaves |
//! | `foxglove` | a client that shares no code with `hil monitor --foxglove`; with the feature |
//! | [`hindrances`] | shared memory that the machine refuses is named, with what to do |
//! | [`hot_path`] | no system call and no allocation in a step |
//! | [`intrusion`] | who does not belong to a session gets nowhere |
//! | [`latency`] | every figure of a loop counts the right steps and follows from the others |
//! | [`lies`] | peers that say what is not so are found out |
//! | [`live`] | faults and pauses from another terminal |
//! | [`layouts`] | what Foxglove and PlotJuggler are told to plot is there |
//! | [`marks`] | notes put at a step while a run goes on |
//! | [`monitor`] | a session watched in a terminal: the same digest, and the terminal as it was |
//! | [`mutations`] | the explorer of the lockstep machines misses every guard that is taken out |
//! | [`named_programs`] | programs that scenarios and recordings name, and what is not run |
//! | [`new`] | folders to begin from: what is in them, and names that are none |
//! | [`panel`] | a session in a browser: every control, and nobody else |
//! | [`paper`] | the paper's experiment against its checked figures |
//! | [`paths`] | names of files that are no UTF-8 |
//! | [`plots`] | plots of one run in report, monitor and layout |
//! | [`recording`] | what a recording holds, read without the recorder's code |
//! | [`recover`] | what is left after a death, on a full disk and of a damaged file |
//! | [`report`] | pages of runs, against the recording and in a browser |
//! | [`replay`] | recorded samples against controllers: the same, rebuilt, broken |
//! | [`realtime_settings`] | what was asked of the system, and what it granted |
//! | [`runs`] | what was run here, listed and removed by a rule; the newest run by its name |
//! | [`requirements`] | verdicts live and from the recording, and exit codes |
//! | [`succession`] | lost controllers, and others that take over |
//! | [`suite`] | several runs by one command |
//! | [`survival`] | every law with every kind of fault |
//! | [`target`] | the controller on another machine: the same digest, whatever happens on the way |
//! | [`values`] | signals of a running session as they are told, against its recording |
//! | [`viewers`] | recordings in the programs that engineers look at them with |
//!
//! [`support::programs`] builds what is run; [`support::harness`] gives each test a place of its own and a watchdog, and
//! looks after every run that nothing of it is left. [`support::mcap_reader`] reads recordings.
//!
//! [`support::terminal`] is one that a program of a test runs in. [`support::python`] finds an interpreter with what a test imports.
//!
//! Twelve parts need more than Rust; a test that lacks its part says so and passes, unless the
//! environment demands it: `HIL_TEST_RELEASE=1` builds the binaries of the other profile, `HIL_TEST_PYTHON=1`
//! makes a Python environment, `HIL_TEST_NODE=1` installs Foxglove's packages with npm,
//! `HIL_TEST_STRACE=1` wants `strace`, `HIL_TEST_CHROMIUM=1` a Chromium, `HIL_TEST_UNSHARE=1` a user who may
//! mount file systems, `HIL_TEST_NETNS=1` one who may make network namespaces, `HIL_TEST_SSHD=1` `sshd` and `python3`,
//! `HIL_TEST_SLURM=1` Slurm and munge, `HIL_TEST_GDB=1` a `gdb` that may trace, `HIL_TEST_SHELLS=1` `bash`, `zsh` and `fish`,
//! `HIL_TEST_AARCH64=1` Rust's target `aarch64-unknown-linux-musl` and `qemu-aarch64-static`.
//!
//! `HIL_WRITE_BOOK=1` writes the references of the book anew; `HIL_TEST_PAGE=docs/faults` runs the commands of
//! the pages with that in their path alone.

mod architecture;
mod audit;
mod bad_input;
mod baselines;
mod book;
mod by_hand;
mod campaign;
mod chatter;
mod checkpoints;
mod cli;
mod clocks;
mod completion;
mod connect;
mod determinism;
mod doctor;
#[path = "../shared/every_fault.rs"]
mod every_fault;
mod examples;
mod excerpts;
mod export;
mod failures;
mod faults;
mod fmu;
mod foreign;
#[cfg(feature = "foxglove")]
mod foxglove;
mod hindrances;
mod hot_path;
mod interruptions;
mod intrusion;
mod kept;
mod latency;
mod layouts;
mod lies;
mod live;
mod marks;
mod monitor;
mod mutations;
mod named_programs;
mod new;
mod panel;
#[path = "../shared/panel_socket.rs"]
mod panel_socket;
mod paper;
mod paths;
mod plots;
#[path = "../shared/pseudo_terminal.rs"]
mod pseudo_terminal;
mod realtime_settings;
mod recording;
mod recover;
mod replay;
mod report;
mod requirements;
mod runs;
mod succession;
mod suite;
mod support;
mod survival;
mod tables;
mod target;
mod tuning;
mod values;
mod viewers;
