//! Tests over the whole workspace, in one binary: facts that hold only when everything works together. No test here
//! is about one package alone.
//!
//! | module | proves |
//! |---|---|
//! | [`architecture`] | packages, binaries and permitted dependencies, of packages and of their modules |
//! | [`audit`] | an audit finds a controller that depends on more than its samples, with step and signal |
//! | [`bad_input`] | every reader accepts any bytes or refuses them by name, and never panics |
//! | [`baselines`] | runs compared with named runs, by digest, by samples and by figures |
//! | [`book`] | commands, outputs, code and links of README and book |
//! | [`by_hand`] | sides started by hand: the same digest, and no other process in their place |
//! | [`campaign`] | each case of a campaign runs once, with the digest of a run of its own |
//! | [`chatter`] | controllers that never stop sending hold up no run |
//! | [`checkpoints`] | a resumed run equals the uninterrupted one; a checkpoint that does not fit is refused |
//! | [`cli`] | bad input gives a clear error and exit code 2, and starts nothing |
//! | [`clocks`] | lockstep, paced and real-time runs; late steps and commands, and their reruns |
//! | [`codec`] | frames of ports beside cantools and python-can, without allocation, and described |
//! | [`completion`] | completions in real shells, and that completing has no side effect |
//! | [`connect`] | a law on plants with other names and units |
//! | [`debian`] | the Debian package in a root with nothing but the C library |
//! | [`determinism`] | one digest for a scenario, however and wherever it runs |
//! | [`doctor`] | every check runs once, and the verdict follows from the grades |
//! | [`examples`] | a plant, a law and a link from outside the workspace |
//! | [`excerpts`] | recordings of selected signals and steps |
//! | [`export`] | tables made of a recording, read by independent readers |
//! | [`failures`] | deaths, stops and divergence name side, cause and step, and leave nothing behind |
//! | [`faults`] | faults of scenarios in whole runs |
//! | [`fmu`] | FMUs as plants and controllers: the numbers of FMPy, and FMUs that misbehave |
//! | [`foreign`] | plants and controllers in C: the numbers of Rust, and every mistake by name |
//! | [`foxglove`] | a client that shares no code with `hil monitor --foxglove` |
//! | [`guard`] | whatever kills `hil`, a summary reports it and nothing is left behind |
//! | [`hindrances`] | a machine without usable shared memory: the cause and the remedy are named |
//! | [`hot_path`] | a step makes no system call and no allocation |
//! | [`instruments`] | sensors and actuators: their effect in a recording, and the same bits wherever the run is |
//! | [`interruptions`] | Ctrl-C ends every command with exit code 130 and leaves nothing behind |
//! | [`intrusion`] | strangers to a session cannot read, disturb or join it |
//! | [`jsbsim`] | a flight simulator as the plant, behind a port |
//! | [`kept`] | persistent processes never use frames of one job for the next |
//! | [`lasting`] | descriptors and threads of processes that do many jobs |
//! | [`latency`] | every figure of a loop counts the right steps and is consistent with the others |
//! | [`layouts`] | layouts for Foxglove and PlotJuggler plot signals that are recorded |
//! | [`lies`] | false statements of a peer are detected and end the run by name |
//! | [`linearise`] | linear models against closed forms and an independent program, and refusals by name |
//! | [`live`] | faults and pauses from another terminal |
//! | [`margins`] | margins of running loops, against closed forms and python-control |
//! | [`marks`] | notes at a step of a running session |
//! | [`monitor`] | a monitored run has the same digest, and the terminal is restored |
//! | [`mutations`] | the explorer of the lockstep machines detects the removal of any guard |
//! | [`named_programs`] | programs that scenarios and recordings name: which one runs, and which never does |
//! | [`new`] | folders that `hil new` makes, and names that it refuses |
//! | [`panel`] | a session in a browser: every control works, and nobody else has access |
//! | [`paper`] | the paper's experiment against its checked figures |
//! | [`paths`] | file names that are not UTF-8 |
//! | [`playback`] | files of other programs and recordings, played back in runs |
//! | [`plots`] | report, monitor and layout show the same plots of a run in the same order |
//! | [`ports`] | port files as controllers, with a peer in Python |
//! | [`python`] | the wheel of the Python package in an empty environment, and its types |
//! | [`realtime_settings`] | real-time settings requested of the system, and those granted |
//! | [`recording`] | content of a recording, read without the recorder's code |
//! | [`recover`] | recovery after a death, on a full disk and of a damaged file |
//! | [`replay`] | recorded samples against controllers: the same one, a rebuilt one, a broken one |
//! | [`report`] | pages of runs, against the recording and in a browser |
//! | [`requirements`] | verdicts live and from the recording, and exit codes |
//! | [`runs`] | listing and removal of runs, and the newest run by its name |
//! | [`search`] | the smallest fault that breaks a requirement, and the worst case |
//! | [`succession`] | loss of controllers, and handover to others |
//! | [`suite`] | several runs by one command |
//! | [`tables`] | the compiler names each mistake in a `table!` and points at its row |
//! | [`target`] | the controller on another machine: the same digest, whatever the network does |
//! | [`trim`] | equilibria against closed forms, kept by runs that begin there, and refusals by name |
//! | [`tuning`] | changes of values in a running session: at one step, all or none, and repeatable |
//! | [`vacuous`] | passes whose premise never held, from the run to its evidence |
//! | [`validity`] | invalid and old signals, from the plant's sensor and the law's command to the verdict |
//! | [`values`] | `hil get` and `hil watch` against the recording of the session |
//! | [`viewers`] | recordings in rerun, Foxglove's packages and rosbags |
//! | [`wires`] | ports before cantools, can-cannelloni and tcpdump |
//!
//! [`support::programs`] builds the programs under test. [`support::harness`] gives each test a folder of its own and a
//! watchdog, and checks after every run that nothing of it is left. [`support::mcap_reader`] reads recordings,
//! [`support::terminal`] is a terminal for a program under test, and [`support::python`] finds an interpreter with the
//! packages that a test imports.
//!
//! Some features need more than Rust. A test whose feature is missing says so and passes, unless the environment
//! demands the feature:
//!
//! | variable | feature |
//! |---|---|
//! | `HIL_TEST_AARCH64=1` | Rust's target `aarch64-unknown-linux-musl` and `qemu-aarch64-static` |
//! | `HIL_TEST_CC=1` | a C compiler |
//! | `HIL_TEST_CHROMIUM=1` | a Chromium |
//! | `HIL_TEST_FMPY=1` | Python's `fmpy` |
//! | `HIL_TEST_GDB=1` | a `gdb` that may trace |
//! | `HIL_TEST_NETNS=1` | a user who may make network namespaces |
//! | `HIL_TEST_NODE=1` | Foxglove's packages and axe-core, installed with npm |
//! | `HIL_TEST_PARALLEL=1` | GNU `parallel` |
//! | `HIL_TEST_PYTHON=1` | a Python environment, made for the tests |
//! | `HIL_TEST_QEMU=1` | a kernel for a guest, unpacked by `.ci/run tools` |
//! | `HIL_TEST_SHELLS=1` | `bash`, `zsh` and `fish` |
//! | `HIL_TEST_SLURM=1` | Slurm and munge |
//! | `HIL_TEST_SSHD=1` | `sshd` and `python3` |
//! | `HIL_TEST_STRACE=1` | `strace` |
//! | `HIL_TEST_TCPDUMP=1` | `tcpdump`, `python3` and a user who may make network namespaces |
//! | `HIL_TEST_UNSHARE=1` | a user who may mount file systems |
//! | `HIL_TEST_VCAN=1` | a CAN interface `vcan0` of the kernel |
//!
//! `HIL_WRITE_BOOK=1` regenerates the references of the book. `HIL_TEST_PAGE=docs/faults` runs the commands of the pages
//! whose path contains that text, and of no others.

mod architecture;
mod audit;
mod bad_input;
mod baselines;
mod book;
mod bus;
mod by_hand;
mod campaign;
mod chatter;
mod checkpoints;
mod cli;
mod clocks;
mod codec;
mod completion;
mod connect;
mod debian;
mod determinism;
mod doctor;
mod evidence;
mod examples;
mod excerpts;
mod export;
mod failures;
mod faults;
mod fmu;
mod foreign;
mod foxglove;
mod guard;
mod hindrances;
mod hot_path;
mod inputs;
mod instruments;
mod interruptions;
mod intrusion;
mod jsbsim;
mod kept;
mod lasting;
mod latency;
mod layouts;
mod lies;
mod linearise;
mod live;
mod margins;
mod marks;
mod monitor;
mod mutations;
mod named_programs;
mod new;
mod newcomers;
mod panel;
#[path = "../shared/panel_socket.rs"]
mod panel_socket;
mod paper;
mod paths;
mod playback;
mod plots;
mod ports;
#[path = "../shared/pseudo_terminal.rs"]
mod pseudo_terminal;
mod python;
mod python_sides;
mod quad;
mod realtime_settings;
mod recording;
mod recover;
mod replay;
mod report;
mod requirements;
mod rigs;
mod runs;
mod search;
mod succession;
mod suite;
mod support;
mod tables;
mod target;
#[path = "../shared/tried_faults.rs"]
mod tried_faults;
mod trim;
mod tuning;
mod vacuous;
mod validity;
mod values;
mod viewers;
mod wires;
