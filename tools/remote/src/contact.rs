//! Contact of the desk with a target: reach it, have the program there, ask it.

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

/// Longest time until an agent says that it is there, and until it answers.
const ANSWER_LIMIT: Duration = Duration::from_secs(15);
/// Longest silence of an agent that is receiving a part of a file.
const COPY_LIMIT: Duration = Duration::from_secs(60);
/// Parts of a file under way, and the bytes of each.
const PARTS: u32 = 4;
const PART_BYTES: u64 = 256 << 10;
/// Time between two looks at an interruption.
const LOOK: Duration = Duration::from_millis(20);
/// Time that the last word of `ssh` may take.
const LAST_WORD: Duration = Duration::from_millis(500);

/// An open contact. Dropping it ends the agent.
pub struct Contact {
    pub(crate) way: Way,
    pub(crate) ear: Ear<ToDesk>,
    // Before the leash: closing it is what ends the agent.
    pub(crate) mouth: Mouth,
    pub(crate) leash: Leash,
    findings: Findings,
}

/// Answer of a program that was asked on a target.
#[derive(Debug)]
pub struct Answer {
    /// True if its exit code was 0.
    pub is_success: bool,
    /// Standard output.
    pub stdout: String,
    /// The beginning of its standard error.
    pub stderr: String,
}

/// A program that runs on a target.
pub(crate) struct Running {
    /// Address for datagrams.
    pub(crate) address: Option<String>,
    /// Answer to the handshake.
    pub(crate) handshake: String,
}

impl Contact {
    /// Reaches a target and starts an agent there, or greets the one that listens. `ring` is called whenever something
    /// comes; `is_interrupted` is asked again and again.
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
            findings: Findings::own(), // replaced at once
        };
        match contact.wait(ANSWER_LIMIT, is_interrupted)? {
            ToDesk::Here { protocol, findings } if protocol == PROTOCOL => {
                contact.findings = findings
            }
            ToDesk::Here { protocol, .. } => {
                return Err(way.usage(format!(
                    "its agent speaks protocol {protocol}, this hil {PROTOCOL}; use programs of one version"
                )));
            }
            _ => {
                return Err(
                    way.infrastructure("its agent says something else than that it is there")
                );
            }
        }
        Ok(contact)
    }

    /// Findings of the agent about its machine.
    #[must_use]
    pub const fn findings(&self) -> &Findings {
        &self.findings
    }

    /// Provides this program on the target, by its hash.
    ///
    /// # Errors
    /// If it is built for another machine, or cannot be copied.
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
                "{program} is built for {built}, the target is {machine}: {how}"
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
    /// If no answer comes.
    pub fn describe(&self, is_interrupted: &dyn Fn() -> bool) -> Result<Answer, TargetError> {
        self.ask(&ToAgent::Describe, is_interrupted)
    }

    /// Asks the program to check a job.
    ///
    /// # Errors
    /// If no answer comes.
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

    /// Removes the programs that are kept on the target; returns how many there were.
    ///
    /// # Errors
    /// If no answer comes.
    pub fn clean(&self, is_interrupted: &dyn Fn() -> bool) -> Result<u32, TargetError> {
        self.mouth.say(&ToAgent::Clean);
        match self.wait(ANSWER_LIMIT, is_interrupted)? {
            ToDesk::Cleaned { files } => Ok(files),
            _ => Err(self.out_of_turn()),
        }
    }

    /// Measures the round trip of a message through the channel, in ns: each of `count`, one after another.
    ///
    /// # Errors
    /// If no answer comes.
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

    /// Waits until the agent has started the program; `log` takes what that writes at once.
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
        self.way
            .infrastructure("its agent says something that was not asked")
    }

    /// Waits for the agent's next message.
    pub(crate) fn wait(
        &self,
        limit: Duration,
        is_interrupted: &dyn Fn() -> bool,
    ) -> Result<ToDesk, TargetError> {
        let since = Instant::now();
        let mut heard = since;
        while since.elapsed() <= limit {
            if is_interrupted() {
                return Err(TargetError::Interrupted);
            }
            match self.ear.wait(LOOK) {
                None if heard.elapsed() > self.way.silence => {
                    let silence_s = self.way.silence.as_secs_f64();
                    let reason = format!("nothing received from its agent for {silence_s} s");
                    return Err(self.way.infrastructure(reason));
                }
                None => {}
                Some(Heard::Message(ToDesk::Beat)) => heard = Instant::now(),
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
        let told = format!("its agent gave no answer within {limit_s} s");
        Err(self.way.infrastructure(told))
    }

    /// Describes the end of the channel, with what `ssh` said of it.
    pub(crate) fn lost(&self, why: &str) -> TargetError {
        let said = match &self.leash {
            Leash::Ssh(_, said) => said.last_line(LAST_WORD),
            Leash::Connection(_) => None,
        };
        let said = said.map_or_else(String::new, |said| format!(" ({said})"));
        self.way
            .infrastructure(format!("connection lost: {why}{said}"))
    }
}

#[cfg(test)]
mod tests {
    use std::net::{TcpListener, TcpStream};

    use super::*;

    /// A contact with an agent that says what it is told to.
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
    fn an_agent_that_takes_more_parts_than_it_was_sent_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let program = folder.path().join("program");
        std::fs::write(&program, "short").expect("written");
        let (contact, agent) = contact();
        for said in [ToDesk::Send, ToDesk::Taken, ToDesk::Taken] {
            agent.say(&said);
        }
        let refused = contact.provide(&program, "0", &|| false);
        let told = refused.expect_err("refused").to_string();
        assert!(told.contains("something that was not asked"), "{told}");
    }
}
