//! Hello: what both sides tell each other before step 0, and the agreement that comes of it.
//!
//! The controller says what it wants and gives, the plant what it has. Signals are bound by name
//! and unit: what is sent too much is ignored, what is missing is refused with the nearest names.
//! So a plant may gain a sensor without breaking a controller.

use serde::{Deserialize, Serialize};

use crate::describe::PROTOCOL;
use crate::frame::Seal;
use crate::layout::{SignalKind, SignalTable, Unbound, layout_hash};
use crate::table::Field;
use crate::time::{Rate, Step};

/// A control message, JSON on the wire.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "message", rename_all = "kebab-case")]
pub enum Control {
    /// Controller to plant, first: who I am and what I need.
    Hello(Hello),
    /// Plant to controller: agreed; open the frames.
    Welcome(Box<Welcome>),
    /// Plant to controller: no, and why.
    Refusal {
        /// Why.
        reason: String,
    },
    /// Controller to plant: the frames are open, step 0 may come.
    Ready {
        /// The epoch that was welcomed.
        epoch: u32,
    },
}

impl Control {
    /// The message as bytes.
    ///
    /// # Panics
    /// Never: these types always serialise.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        serde_json::to_vec(self).expect("plain data serialises")
    }

    /// The message of bytes.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        serde_json::from_slice(bytes).map_err(|e| e.to_string())
    }
}

/// What a controller says of itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// Its [`PROTOCOL`].
    pub protocol: u32,
    /// Its random number of the session, from the job.
    pub session: u64,
    /// Name of the law.
    pub law: String,
    /// Measured signals it needs.
    pub measured: Vec<Field>,
    /// Reference signals it needs.
    pub reference: Vec<Field>,
    /// Commands it gives; `None`: whatever the plant takes.
    pub commands: Option<Vec<Field>>,
    /// Inner quantities it shows.
    pub internals: Vec<Field>,
}

/// What the plant answers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Welcome {
    /// Its [`PROTOCOL`].
    pub protocol: u32,
    /// Random number of the session.
    pub session: u64,
    /// Which controller of the session this one is, from 1.
    pub epoch: u32,
    /// Hash of the two tables.
    pub layout: u64,
    /// Exchange rate in Hz.
    pub rate: Rate,
    /// Number of steps.
    pub steps: u64,
    /// The first of them that is exchanged: not 0 in a run that goes on from a checkpoint.
    #[serde(default, skip_serializing_if = "is_start")]
    pub first: Step,
    /// The plant does not wait for commands: samples may be replaced before they are received.
    pub against_clock: bool,
    /// What a sample frame carries, in order.
    pub sample: SignalTable,
    /// What a command frame carries, in order.
    pub command: SignalTable,
}

impl Welcome {
    /// What every frame carries.
    #[must_use]
    pub const fn seal(&self) -> Seal {
        Seal {
            session: self.session,
            layout: self.layout,
            epoch: self.epoch,
        }
    }

    /// Checks the welcome against the hello that it answers.
    ///
    /// # Errors
    /// What does not fit.
    pub fn check(&self, hello: &Hello) -> Result<(), Refused> {
        if self.protocol != PROTOCOL {
            return Err(Refused::Protocol {
                theirs: self.protocol,
                ours: PROTOCOL,
            });
        }
        if self.session != hello.session {
            return Err(Refused::Session);
        }
        if self.layout != layout_hash(&self.sample, &self.command) {
            return Err(Refused::Layout);
        }
        Ok(())
    }
}

/// Why two sides do not come together.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refused {
    /// They speak different versions.
    #[error("protocol {theirs} on the other side, {ours} here; use binaries of one version")]
    Protocol {
        /// The other side's.
        theirs: u32,
        /// This side's.
        ours: u32,
    },
    /// They belong to different sessions.
    #[error("the other side belongs to another session")]
    Session,
    /// A table and its hash do not go together.
    #[error("the tables do not have the layout hash that came with them")]
    Layout,
    /// Signals without a counterpart.
    #[error("{}", list(signals))]
    Unbound {
        /// Each of them.
        signals: Vec<String>,
    },
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde's contract")]
fn is_start(first: &Step) -> bool {
    *first == Step(0)
}

fn list(signals: &[String]) -> String {
    signals.join("; ")
}

/// What the plant has to offer.
#[derive(Clone, Debug)]
pub struct Offer<'a> {
    /// Random number of the session.
    pub session: u64,
    /// Which controller this will be.
    pub epoch: u32,
    /// Exchange rate.
    pub rate: Rate,
    /// Number of steps.
    pub steps: u64,
    /// The first of them that is exchanged.
    pub first: Step,
    /// Whether the plant does not wait for commands.
    pub against_clock: bool,
    /// Measured signals.
    pub measured: &'a [Field],
    /// Reference signals.
    pub reference: &'a [Field],
    /// Commands that the plant takes.
    pub commands: &'a [Field],
}

/// Agrees with a controller or says why not.
///
/// # Errors
/// What stands against it, every unbound signal in one go.
pub fn agree(hello: &Hello, offer: &Offer<'_>) -> Result<Welcome, Refused> {
    if hello.protocol != PROTOCOL {
        return Err(Refused::Protocol {
            theirs: hello.protocol,
            ours: PROTOCOL,
        });
    }
    if hello.session != offer.session {
        return Err(Refused::Session);
    }
    let sample = SignalTable::of(SignalKind::Measured, offer.measured)
        .and(SignalKind::Reference, offer.reference);
    let commands = hello.commands.as_deref().unwrap_or(offer.commands);
    let command =
        SignalTable::of(SignalKind::Command, commands).and(SignalKind::Internal, &hello.internals);
    let mut signals = Vec::new();
    let mut bind = |table: &SignalTable, kind: SignalKind, wanted: &[Field], whose: &str| {
        let unbound = table.bind(kind, wanted).err().unwrap_or_default();
        let line = |unbound: Unbound| format!("{} {whose}: {unbound}", kind.prefix());
        signals.extend(unbound.into_iter().map(line));
    };
    bind(
        &sample,
        SignalKind::Measured,
        &hello.measured,
        "signals that the law needs",
    );
    bind(
        &sample,
        SignalKind::Reference,
        &hello.reference,
        "signals that the law needs",
    );
    bind(
        &command,
        SignalKind::Command,
        offer.commands,
        "signals that the plant needs",
    );
    if !signals.is_empty() {
        return Err(Refused::Unbound { signals });
    }
    Ok(Welcome {
        protocol: PROTOCOL,
        session: offer.session,
        epoch: offer.epoch,
        layout: layout_hash(&sample, &command),
        rate: offer.rate,
        steps: offer.steps,
        first: offer.first,
        against_clock: offer.against_clock,
        sample,
        command,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(name: &str) -> Field {
        Field::signal(name, "rad", "x")
    }

    fn hello() -> Hello {
        Hello {
            protocol: PROTOCOL,
            session: 5,
            law: "pid".into(),
            measured: vec![field("angle_rad")],
            reference: vec![],
            commands: Some(vec![field("spare_rad"), field("drive_rad")]),
            internals: vec![field("integral_rad")],
        }
    }

    fn answer(hello: &Hello) -> Result<Welcome, Refused> {
        agree(
            hello,
            &Offer {
                session: 5,
                epoch: 1,
                rate: Rate::new(10.0).expect("legal"),
                steps: 3,
                first: Step(0),
                against_clock: false,
                measured: &[field("extra_rad"), field("angle_rad")],
                reference: &[field("angle_rad")],
                commands: &[field("drive_rad")],
            },
        )
    }

    #[test]
    fn signals_too_many_are_no_obstacle() {
        let welcome = answer(&hello()).expect("agreed");
        welcome.check(&hello()).expect("checks");
        assert_eq!((welcome.sample.len(), welcome.command.len()), (3, 3));
    }

    #[test]
    fn everything_missing_is_named_at_once() {
        let mut hello = hello();
        hello.measured.push(field("angel_rad"));
        hello.commands = Some(vec![]);
        let told = answer(&hello).unwrap_err().to_string();
        assert!(
            told.contains("no signal `angel_rad`, nearest: angle_rad"),
            "{told}"
        );
        assert!(told.contains("no signal `drive_rad`"), "{told}");
    }

    #[test]
    fn a_law_for_any_plant_gets_the_plants_commands() {
        let welcome = answer(&Hello {
            commands: None,
            ..hello()
        })
        .expect("agreed");
        assert_eq!(
            welcome.command.fields(SignalKind::Command),
            [field("drive_rad")]
        );
    }

    #[test]
    fn other_versions_and_sessions_are_refused() {
        let refused = answer(&Hello {
            protocol: 99,
            ..hello()
        });
        assert_eq!(
            refused,
            Err(Refused::Protocol {
                theirs: 99,
                ours: PROTOCOL
            })
        );
        assert_eq!(
            answer(&Hello {
                session: 6,
                ..hello()
            }),
            Err(Refused::Session)
        );
        let mut welcome = answer(&hello()).expect("agreed");
        welcome.sample.0.pop();
        assert_eq!(welcome.check(&hello()), Err(Refused::Layout));
    }

    #[test]
    fn messages_survive_the_wire() {
        let message = Control::Welcome(Box::new(answer(&hello()).expect("agreed")));
        assert_eq!(Control::from_bytes(&message.to_bytes()), Ok(message));
        assert!(Control::from_bytes(b"\xff{").is_err());
    }
}
