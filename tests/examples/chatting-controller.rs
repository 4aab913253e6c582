//! A controller process that answers a hundred samples and then keeps sending without making progress. Not a program of
//! the workspace: tests give it to `hil` as `--controller-bin`.
//!
//! | law | at every look, from its hundredth sample on |
//! |---|---|
//! | `repeats`, and the shipped `hold` | sends its last answer once more |
//! | `contradicts` | sends another answer to the same sample |
//! | `greets` | says hello, from the beginning, and hears nothing |

#[macro_use]
#[path = "../shared/law.rs"]
mod law;
#[path = "../shared/position_and_force.rs"]
mod position_and_force;

use std::path::Path;
use std::process::ExitCode;

use controller_process::controller::LawKind;
use controller_process::job::{JOB_FILE, Job};
use controller_process::runner::{Progress, Runner, choose};
use hil_session::link::iceoryx::IceoryxLink;
use hil_session::program::{COMPLETED, Program, read_job};
use hil_session::realtime::apply;
use hil_session::session::SessionInfo;
use hil_session::supervision::Supervision;
use hil_session::waiter::Waiter;
use shared_types::describe::Description;
use shared_types::frame::{FrameKind, Header};
use shared_types::link::{Link, LinkError};
use shared_types::lockstep::ControllerEvent;
use shared_types::realtime;
use shared_types::side::Side;
use shared_types::wait::WaitLimit;

use position_and_force::{Force, Position};

/// Number of answered samples.
const ANSWERED: u64 = 100;
/// The command.
const FORCE_N: f64 = 0.5;

struct Steady;

law!(
    Steady,
    "steady",
    "Commands one force.",
    Position,
    None,
    Self,
    |_, _| FORCE_N
);

#[derive(Clone, Copy, PartialEq)]
enum Habit {
    Repeats,
    Contradicts,
    Greets,
}

/// A link that sends more than it is asked to.
struct Chatting {
    inner: IceoryxLink,
    habit: Habit,
    hello: Vec<u8>,
    answer: Option<(Header, Vec<f64>)>,
}

impl Link for Chatting {
    shared_types::pass_on!(self => self.inner; tell expect peer open_frames take_over rejected);

    fn send_control(&mut self, message: &[u8]) -> Result<(), LinkError> {
        self.hello = message.to_vec();
        self.inner.send_control(message)
    }

    fn receive_control(&mut self) -> Result<Option<Vec<u8>>, LinkError> {
        if self.habit == Habit::Greets {
            self.inner.send_control(&self.hello)?;
            return Ok(None);
        }
        self.inner.receive_control()
    }

    fn send(&mut self, header: &Header, values: &[f64]) -> Result<(), LinkError> {
        self.answer = Some((*header, values.to_vec()));
        self.inner.send(header, values)
    }

    fn receive(&mut self, values: &mut [f64]) -> Result<Option<Header>, LinkError> {
        let came = self.inner.receive(values)?;
        let answer = (self.answer.as_mut()).filter(|(answer, _)| answer.step + 1 >= ANSWERED);
        let Some((header, answer)) = answer else {
            return Ok(came);
        };
        if self.habit == Habit::Contradicts {
            answer[0] += 1e-3;
        }
        self.inner.send(header, answer)?;
        // An end is taken, a sample is not.
        Ok(came.filter(|header| header.kind() != Some(FrameKind::Sample)))
    }
}

struct ChattingController {
    laws: Vec<LawKind>,
}

impl Program for ChattingController {
    fn side(&self) -> Side {
        Side::Controller
    }

    fn description(&self) -> Description {
        let mut description = Description::new("chatting-controller", "0.1.0");
        description.laws = (self.laws.iter())
            .map(|kind| kind.description.clone())
            .collect();
        description
    }

    fn check(&self, _: &Path) -> Result<(), String> {
        Ok(())
    }

    fn serve(&self, session: &SessionInfo, supervision: &Supervision) -> Result<u8, String> {
        let told = |e: &dyn std::fmt::Display| e.to_string();
        let job: Job = read_job(&session.folder.join(JOB_FILE))?;
        let mut waiter = Waiter::new(WaitLimit::from_seconds(10.0));
        let inner = loop {
            match IceoryxLink::open(session, job.epoch) {
                Err(LinkError::Absent { .. }) if !waiter.pause() => {}
                opened => break opened.map_err(|e| told(&e))?,
            }
        };
        let link = Chatting {
            inner,
            habit: match job.law.as_str() {
                "contradicts" => Habit::Contradicts,
                "greets" => Habit::Greets,
                _ => Habit::Repeats,
            },
            hello: Vec::new(),
            answer: None,
        };
        let kind = choose(&self.laws, &job.law, &job.plant).map_err(|e| told(&e))?;
        let report = apply(&job.realtime);
        let mut runner = Runner::new(kind, job, link).map_err(|e| told(&e))?;
        let written = session.write_file(realtime::CONTROLLER_FILE, &report);
        written.map_err(|e| told(&e))?;
        runner.begin().map_err(|e| told(&e))?;
        // No wait, and no limit: only others end it.
        while runner.poll().map_err(|e| told(&e))? != Progress::Over {
            if supervision.wants_stop() || supervision.is_peer_gone() {
                let stopped = runner.interrupt(&ControllerEvent::Stop);
                stopped.map_err(|e| told(&e))?;
            }
        }
        Ok(COMPLETED)
    }
}

fn main() -> ExitCode {
    let law = |name: &str| {
        let mut kind = LawKind::of::<Steady>();
        kind.description.name = name.into();
        kind
    };
    let mut laws = controller_process::laws::all();
    laws.retain(|kind| kind.description.name == "hold");
    laws.extend(["repeats", "contradicts", "greets"].map(law));
    hil_session::program::run(&ChattingController { laws })
}
