//! Connection of the desk to a target: connects, provides the program, and queries it.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;
use std::time::{Duration, Instant};

use crate::channel::{Ear, Heard, Mouth};
use crate::leash::Leash;
use crate::machine::{Findings, built_for, triple};
use crate::message::{PROTOCOL, ToAgent, ToDesk};
use crate::name::Target;
use crate::way::{TargetError, Way};
use crate::{connection, ssh};

/// Time limit for an agent to start, and to answer.
const ANSWER_LIMIT: Duration = Duration::from_secs(15);
/// Maximum silence of an agent that is receiving part of a file.
const COPY_LIMIT: Duration = Duration::from_secs(60);
/// Number of parts of a file in flight, and the size of each in bytes.
const PARTS: u32 = 4;
const PART_BYTES: u64 = 256 << 10;
/// Polling interval for an interruption.
const LOOK: Duration = Duration::from_millis(20);
/// Time limit for the last message of `ssh`.
const LAST_WORD: Duration = Duration::from_millis(500);

/// Open connection. Dropping it ends the agent.
pub struct Contact {
    pub(crate) way: Way,
    pub(crate) ear: Ear<ToDesk>,
    // Dropped before the leash, whose closing ends the agent.
    pub(crate) mouth: Mouth,
    pub(crate) leash: Leash,
    findings: Findings,
}

/// Answer of a program on a target.
#[derive(Debug)]
pub struct Answer {
    /// `true` if its exit code was 0.
    pub is_success: bool,
    /// Standard output.
    pub stdout: String,
    /// Beginning of its standard error.
    pub stderr: String,
}

/// Program running on a target.
pub(crate) struct Running {
    /// Address for datagrams.
    pub(crate) address: Option<String>,
    /// Answer to the handshake.
    pub(crate) handshake: String,
}

impl Contact {
    /// Connects to a target and starts an agent there, or contacts an agent that already listens. `ring` is called
    /// after each received item; `is_interrupted` is polled.
    ///
    /// # Errors
    /// If the target cannot be reached or used.
    pub fn open(
        way: &Way,
        ring: impl Fn() + Send + 'static,
        is_interrupted: &dyn Fn() -> bool,
    ) -> Result<Self, TargetError> {
        let (ear, mouth, leash) = match &way.target {
            Target::Ssh(host) => ssh::open(way, host, Box::new(ring), is_interrupted)?,
            Target::Serve(address) => connection::connect(way, address, Box::new(ring))?,
        };
        let mut contact = Self {
            way: way.clone(),
            ear,
            mouth,
            leash,
            findings: Findings::own(), // replaced below
        };
        match contact.wait(ANSWER_LIMIT, is_interrupted)? {
            ToDesk::Here { protocol, findings } if protocol == PROTOCOL => {
                contact.findings = findings
            }
            ToDesk::Here { protocol, .. } => {
                return Err(way.usage(format!(
                    "its agent speaks protocol {protocol}, but this hil speaks {PROTOCOL}; use programs of the same version"
                )));
            }
            _ => {
                return Err(way.infrastructure("unexpected first message from its agent"));
            }
        }
        Ok(contact)
    }

    /// Returns the agent's findings about its machine.
    #[must_use]
    pub const fn findings(&self) -> &Findings {
        &self.findings
    }

    /// Makes this program available on the target, under its hash.
    ///
    /// # Errors
    /// If the program is built for another type of machine, or cannot be copied.
    pub fn provide(
        &self,
        program: &Path,
        blake3: &str,
        is_interrupted: &dyn Fn() -> bool,
    ) -> Result<(), TargetError> {
        let cannot = |error: io::Error| {
            self.way
                .usage(format!("cannot read {}: {error}", program.display()))
        };
        let machine = &self.findings.machine;
        let built = built_for(program).map_err(cannot)?;
        let runs = |built: &String| built == machine || self.findings.emulates.contains(built);
        if let Some(built) = built.filter(|built| !runs(built)) {
            let how = match triple(machine) {
                Some(triple) => format!("build with `cargo build --release --target {triple}`"),
                None => "build it for that machine".into(),
            };
            let program = program.display();
            return Err(self.way.usage(format!(
                "{program} is built for {built}, but the target is {machine}: {how}"
            )));
        }
        let mut file = File::open(program).map_err(cannot)?;
        let bytes = file.metadata().map_err(cannot)?.len();
        if bytes == 0 {
            return Err(self.way.usage(format!("{} is empty", program.display())));
        }
        self.mouth.say(&ToAgent::Program {
            protocol: PROTOCOL,
            blake3: blake3.into(),
            bytes,
        });
        match self.wait(ANSWER_LIMIT, is_interrupted)? {
            ToDesk::Have => return Ok(()),
            ToDesk::Send => {}
            _ => return Err(self.out_of_turn()),
        }
        let (mut left, mut under_way) = (bytes, 0);
        loop {
            while left > 0 && under_way < PARTS {
                let mut part = vec![0; left.min(PART_BYTES) as usize];
                file.read_exact(&mut part).map_err(cannot)?;
                left -= part.len() as u64;
                under_way += 1;
                self.mouth.part(part);
            }
            match self.wait(COPY_LIMIT, is_interrupted)? {
                ToDesk::Taken if under_way > 0 => under_way -= 1,
                ToDesk::Have => return Ok(()),
                _ => return Err(self.out_of_turn()),
            }
        }
    }

    /// Asks the program for its description.
    ///
    /// # Errors
    /// If no answer arrives.
    pub fn describe(&self, is_interrupted: &dyn Fn() -> bool) -> Result<Answer, TargetError> {
        self.ask(&ToAgent::Describe, is_interrupted)
    }

    /// Has the program check a job.
    ///
    /// # Errors
    /// If no answer arrives.
    pub fn check(
        &self,
        job: String,
        is_interrupted: &dyn Fn() -> bool,
    ) -> Result<Answer, TargetError> {
        self.ask(&ToAgent::Check { job }, is_interrupted)
    }

    fn ask(
        &self,
        question: &ToAgent,
        is_interrupted: &dyn Fn() -> bool,
    ) -> Result<Answer, TargetError> {
        self.mouth.say(question);
        match self.wait(ANSWER_LIMIT, is_interrupted)? {
            ToDesk::Answer {
                code,
                stdout,
                stderr,
            } => Ok(Answer {
                is_success: code == Some(0),
                stdout,
                stderr,
            }),
            _ => Err(self.out_of_turn()),
        }
    }

    /// Removes the programs cached on the target; returns their number.
    ///
    /// # Errors
    /// If no answer arrives.
    pub fn clean(&self, is_interrupted: &dyn Fn() -> bool) -> Result<u32, TargetError> {
        self.mouth.say(&ToAgent::Clean);
        match self.wait(ANSWER_LIMIT, is_interrupted)? {
            ToDesk::Cleaned { files } => Ok(files),
            _ => Err(self.out_of_turn()),
        }
    }

    /// Measures `count` consecutive round trips of a message through the channel in ns.
    ///
    /// # Errors
    /// If no answer arrives.
    pub fn round_trips(
        &self,
        count: u32,
        is_interrupted: &dyn Fn() -> bool,
    ) -> Result<Vec<u64>, TargetError> {
        let mut trips = Vec::new();
        for _ in 0..count {
            let since = Instant::now();
            self.mouth.say(&ToAgent::Echo);
            match self.wait(ANSWER_LIMIT, is_interrupted)? {
                ToDesk::Echo => trips.push(since.elapsed().as_nanos() as u64),
                _ => return Err(self.out_of_turn()),
            }
        }
        Ok(trips)
    }

    /// Waits until the agent has started the program; `log` receives the program's early output.
    pub(crate) fn wait_to_run(
        &self,
        is_interrupted: &dyn Fn() -> bool,
        log: impl Fn(&str),
    ) -> Result<Running, TargetError> {
        loop {
            match self.wait(ANSWER_LIMIT, is_interrupted)? {
                ToDesk::Running { address, handshake } => {
                    return Ok(Running { address, handshake });
                }
                ToDesk::Log { text } => log(&text),
                _ => return Err(self.out_of_turn()),
            }
        }
    }

    pub(crate) fn out_of_turn(&self) -> TargetError {
        self.way.infrastructure("unexpected message from its agent")
    }

    /// Waits for the agent's next message.
    pub(crate) fn wait(
        &self,
        limit: Duration,
        is_interrupted: &dyn Fn() -> bool,
    ) -> Result<ToDesk, TargetError> {
        let since = Instant::now();
        let mut last_heard = since;
        while since.elapsed() <= limit {
            if is_interrupted() {
                return Err(TargetError::Interrupted);
            }
            match self.ear.wait(LOOK) {
                None if last_heard.elapsed() > self.way.silence => {
                    let silence_s = self.way.silence.as_secs_f64();
                    let reason = format!("nothing received from its agent for {silence_s} s");
                    return Err(self.way.infrastructure(reason));
                }
                None => {}
                Some(Heard::Message(ToDesk::Beat)) => last_heard = Instant::now(),
                Some(Heard::Message(ToDesk::Refused { is_usage, reason })) => {
                    return Err(if is_usage {
                        self.way.usage(reason)
                    } else {
                        self.way.infrastructure(reason)
                    });
                }
                Some(Heard::Message(message)) => return Ok(message),
                Some(Heard::Part(_) | Heard::Packet(_)) => return Err(self.out_of_turn()),
                Some(Heard::Closed(why)) => return Err(self.lost(&why)),
            }
        }
        let limit_s = limit.as_secs();
        let text = format!("no answer from its agent within {limit_s} s");
        Err(self.way.infrastructure(text))
    }

    /// Describes the end of the channel, with the last message of `ssh`.
    pub(crate) fn lost(&self, why: &str) -> TargetError {
        let last_message = match &self.leash {
            Leash::Ssh(_, last_message) => last_message.last_line(LAST_WORD),
            Leash::Connection(_) => None,
        };
        let last_message =
            last_message.map_or_else(String::new, |last_message| format!(" ({last_message})"));
        self.way
            .infrastructure(format!("connection lost: {why}{last_message}"))
    }
}

#[cfg(test)]
mod tests {
    use std::net::{TcpListener, TcpStream};

    use super::*;

    /// Creates a connection to an agent controlled by the test.
    fn contact() -> (Contact, Mouth) {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("its address");
        let ours = TcpStream::connect(address).expect("connected");
        let (theirs, _) = listener.accept().expect("connected");
        let again = || ours.try_clone().expect("the same");
        let contact = Contact {
            way: Way {
                target: "board".parse().expect("a name"),
                agent: None,
                key_file: None,
                silence: Way::SILENCE,
            },
            ear: Ear::listen(again(), None, || ()),
            mouth: Mouth::speak(again(), None),
            leash: Leash::Connection(ours),
            findings: Findings::own(),
        };
        (contact, Mouth::speak(theirs, None))
    }

    #[test]
    fn an_agent_that_acknowledges_more_parts_than_were_sent_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let program = folder.path().join("program");
        std::fs::write(&program, "short").expect("written");
        let (contact, agent) = contact();
        for message in [ToDesk::Send, ToDesk::Taken, ToDesk::Taken] {
            agent.say(&message);
        }
        let refused = contact.provide(&program, "0", &|| false);
        let message = refused.expect_err("refused").to_string();
        assert!(message.contains("unexpected message"), "{message}");
    }
}
