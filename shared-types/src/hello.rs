//! Hello: the exchange of both sides before step 0, and the resulting agreement.
//!
//! The controller states its needs and its commands, the plant its signals. Signals are bound by name and unit: surplus
//! signals are ignored; missing ones are refused with the nearest names. A plant may therefore gain a sensor without
//! breaking a controller.

use serde::{Deserialize, Serialize};

use crate::describe::{LawDescription, PROTOCOL};
use crate::frame::{FrameIdentity, MAX_SIGNALS};
use crate::layout::{
    MOST_FIELDS, SignalKind, SignalTable, Unbound, Unusable, check_fields, check_title, difference,
    layout_hash,
};
use crate::table::{Field, number};
use crate::time::{Rate, Step};
use crate::tuning::Tuned;

/// A control message, JSON on the wire.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "message", rename_all = "kebab-case")]
pub enum Control {
    /// Controller to plant, first: identity and needs.
    Hello(Hello),
    /// Plant to controller: accepted; open the frames.
    Welcome(Box<Welcome>),
    /// Plant to controller: refused, with the reason.
    Refusal {
        /// Reason for the refusal.
        reason: String,
    },
    /// Controller to plant: the frames are open, step 0 may follow.
    Ready {
        /// The epoch that was welcomed.
        epoch: u32,
    },
    /// Plant to controller, during the run: changed law parameters.
    Tuned(Tuned),
}

impl Control {
    /// Serialises the message.
    ///
    /// # Panics
    /// Never: these types always serialise.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        serde_json::to_vec(self).expect("plain data serialises")
    }

    /// Parses a message.
    ///
    /// # Errors
    /// The parse error.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        serde_json::from_slice(bytes).map_err(|e| e.to_string())
    }
}

/// Self-description of a controller.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// [`PROTOCOL`] of the controller.
    pub protocol: u32,
    /// Random number of the session, from the controller's job.
    pub session: u64,
    /// Name of the law.
    pub law: String,
    /// Measured signals that the law needs.
    pub measured: Vec<Field>,
    /// Reference signals that the law needs.
    pub reference: Vec<Field>,
    /// Commands that the law sends; `None` means the commands that the plant accepts.
    pub commands: Option<Vec<Field>>,
    /// Internal signals that the law exposes.
    pub internals: Vec<Field>,
    /// Parameters of the law that can be changed during the run, each with its initial value.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tunable: Vec<TunableParameter>,
}

/// Law parameter that can be changed during the run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TunableParameter {
    /// Name, unit, range and description.
    #[serde(flatten)]
    pub field: Field,
    /// Initial value; NaN for an optional parameter that is not set.
    #[serde(with = "number")]
    pub value: f64,
    /// `true` if the value cannot be read back from the law, so that changes to it remain unconfirmed.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_unreadable: bool,
}

/// The plant's answer to an accepted hello.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Welcome {
    /// [`PROTOCOL`] of the plant.
    pub protocol: u32,
    /// Random number of the session.
    pub session: u64,
    /// Number of this controller in the session, from 1.
    pub epoch: u32,
    /// Hash of the two signal tables.
    pub layout: u64,
    /// Exchange rate in Hz.
    pub rate: Rate,
    /// Number of steps.
    pub steps: u64,
    /// First step that is exchanged; not 0 in a run resumed from a checkpoint.
    #[serde(default, skip_serializing_if = "is_start")]
    pub first: Step,
    /// `true` if the plant does not wait for commands: samples may be replaced before they are received.
    pub against_clock: bool,
    /// Signals of a sample frame, in order.
    pub sample: SignalTable,
    /// Signals of a command frame, in order.
    pub command: SignalTable,
}

impl Welcome {
    /// Returns the header fields that every frame carries.
    #[must_use]
    pub const fn frame_identity(&self) -> FrameIdentity {
        FrameIdentity {
            session: self.session,
            layout: self.layout,
            epoch: self.epoch,
        }
    }

    /// Checks the welcome against the hello that it answers.
    ///
    /// # Errors
    /// The first mismatch.
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
        self.sample.check().and_then(|()| self.command.check())
    }
}

impl Hello {
    /// Creates the greeting of a law that needs and exposes no signals and takes the commands of any plant.
    #[must_use]
    pub fn new(session: u64, law: &str) -> Self {
        Self {
            protocol: PROTOCOL,
            session,
            law: law.into(),
            measured: Vec::new(),
            reference: Vec::new(),
            commands: None,
            internals: Vec::new(),
            tunable: Vec::new(),
        }
    }

    /// Creates the greeting of a law with its defaults, as sent on the wire.
    #[must_use]
    pub fn of(law: &LawDescription, session: u64) -> Self {
        Self {
            protocol: PROTOCOL,
            session,
            law: law.name.clone(),
            measured: law.measured.clone(),
            reference: law.reference.clone(),
            commands: law.commands.clone(),
            internals: law.internals.clone(),
            tunable: (law.tunable())
                .map(|field| TunableParameter {
                    field: field.clone(),
                    value: field.default.unwrap_or(match field.is_optional {
                        true => f64::NAN,
                        false => field.min,
                    }),
                    is_unreadable: false,
                })
                .collect(),
        }
    }

    /// Checks that the names are printable and unique.
    ///
    /// # Errors
    /// The first name that is not.
    fn check(&self) -> Result<(), Refused> {
        let unusable = |kind| move |why| Refused::Unusable { kind, why };
        check_title(&self.law).map_err(unusable("law"))?;
        for (kind, fields) in self.tables() {
            check_fields(fields, MAX_SIGNALS).map_err(unusable(kind.prefix()))?;
        }
        check_fields(&self.tunable_fields(), MOST_FIELDS).map_err(unusable("tunable"))?;
        // As in any parameter table: within the range, which NaN is not; an optional parameter may not be set.
        let is_right = |one: &TunableParameter| {
            one.field.admits(one.value) || (one.field.is_optional && one.value.is_nan())
        };
        let wrong = self.tunable.iter().find(|one| !is_right(one));
        wrong.map_or(Ok(()), |one| {
            let (name, value) = (&one.field.name, one.value);
            Err(Refused::Otherwise(format!(
                "tunable parameter {name:?} is {value}, which is out of its range"
            )))
        })
    }

    fn tunable_fields(&self) -> Vec<Field> {
        (self.tunable.iter()).map(|one| one.field.clone()).collect()
    }

    /// Checks the hello against the law's earlier `--describe`.
    ///
    /// # Errors
    /// The first difference.
    pub fn check_described(&self, law: &LawDescription) -> Result<(), Refused> {
        let described = Self::of(law, self.session);
        let otherwise = |what| Err(Refused::Otherwise(what));
        if self.law != described.law {
            let (greeting, described) = (&self.law, &described.law);
            return otherwise(format!(
                "law {greeting:?}; its --describe says {described:?}"
            ));
        }
        if self.commands.is_some() != described.commands.is_some() {
            return otherwise(
                "commands of its own, but its --describe says those of the plant, or vice versa"
                    .into(),
            );
        }
        let both = self.tables().into_iter().zip(described.tables());
        let mut differences = both.filter_map(|((kind, greeting), (_, described))| {
            difference(kind.prefix(), greeting, described)
        });
        let tunable: Vec<Field> = law.tunable().cloned().collect();
        (differences.next())
            .or_else(|| difference("tunable", &self.tunable_fields(), &tunable))
            .map_or(Ok(()), otherwise)
    }

    fn tables(&self) -> [(SignalKind, &[Field]); 4] {
        [
            (SignalKind::Measured, &self.measured),
            (SignalKind::Reference, &self.reference),
            (
                SignalKind::Command,
                self.commands.as_deref().unwrap_or_default(),
            ),
            (SignalKind::Internal, &self.internals),
        ]
    }
}

impl SignalTable {
    /// Checks that the signals fit into a frame, and that their names are printable and unique.
    fn check(&self) -> Result<(), Refused> {
        for kind in [
            SignalKind::Measured,
            SignalKind::Reference,
            SignalKind::Command,
            SignalKind::Internal,
        ] {
            let unusable = |why| Refused::Unusable {
                kind: kind.prefix(),
                why,
            };
            check_fields(&self.fields(kind), MAX_SIGNALS).map_err(unusable)?;
        }
        match self.len() {
            0..=MAX_SIGNALS => Ok(()),
            count => Err(Refused::Many(count)),
        }
    }
}

/// Reason why two sides cannot agree.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refused {
    /// Different protocol versions.
    #[error(
        "the other side speaks protocol {theirs}, but this side speaks {ours}; use binaries of one version"
    )]
    Protocol {
        /// Version of the other side.
        theirs: u32,
        /// Version of this side.
        ours: u32,
    },
    /// Different sessions.
    #[error("the other side belongs to another session")]
    Session,
    /// Table that does not match its hash.
    #[error("the tables do not match their layout hash")]
    Layout,
    /// Unusable names, units or descriptions of the other side.
    #[error("{kind}: {why}")]
    Unusable {
        /// Kind of the signals, or `law` for the name of the law.
        kind: &'static str,
        /// Reason why the signals are unusable.
        why: Unusable,
    },
    /// More signals in one direction than a frame can carry.
    #[error("{0} signals in one direction; a frame carries at most {most}", most = MAX_SIGNALS)]
    Many(usize),
    /// Hello that differs from the binary's description.
    #[error("its hello says {0}")]
    Otherwise(String),
    /// Signals without a counterpart.
    #[error("{}", list(signals))]
    Unbound {
        /// Unbound signals.
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

/// Facts of the run that the plant offers to a controller.
#[derive(Clone, Debug)]
pub struct Offer<'a> {
    /// Random number of the session.
    pub session: u64,
    /// Number that the controller will have in the session.
    pub epoch: u32,
    /// Exchange rate.
    pub rate: Rate,
    /// Number of steps.
    pub steps: u64,
    /// First step that is exchanged.
    pub first: Step,
    /// `true` if the plant does not wait for commands.
    pub against_clock: bool,
    /// Measured signals.
    pub measured: &'a [Field],
    /// Reference signals.
    pub reference: &'a [Field],
    /// Commands that the plant accepts.
    pub commands: &'a [Field],
}

/// Returns the law's own commands with the start values that the plant declares for them, or else the plant's.
fn with_starts(own: Option<&[Field]>, of_plant: &[Field]) -> Vec<Field> {
    let Some(own) = own else {
        return of_plant.to_vec();
    };
    let start = |name: &str| of_plant.iter().find(|field| field.name == name)?.default;
    let with_start = |field: &Field| Field {
        default: start(&field.name),
        ..field.clone()
    };
    own.iter().map(with_start).collect()
}

/// Agrees with a controller, or refuses it.
///
/// # Errors
/// The reason for the refusal, which lists all unbound signals at once.
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
    hello.check()?;
    let sample = SignalTable::of(SignalKind::Measured, offer.measured)
        .and(SignalKind::Reference, offer.reference);
    let commands = with_starts(hello.commands.as_deref(), offer.commands);
    let command =
        SignalTable::of(SignalKind::Command, &commands).and(SignalKind::Internal, &hello.internals);
    sample.check().and_then(|()| command.check())?;
    let mut signals = Vec::new();
    let mut bind = |table: &SignalTable, kind: SignalKind, requirements: &[Field], whose: &str| {
        let unbound = table.bind(kind, requirements).err().unwrap_or_default();
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
mod tests;
