//! The world of the machines: a plant, its controllers and the channels between them.
//!
//! Each action is performed as by the plant's engine and the controller's runner, and refused where it violates an
//! invariant.

use super::super::*;
use super::Bound;
use crate::frame::FrameKind;
use crate::hello::{Hello, Offer};
use crate::time::Rate;

/// Content of the cell that holds the latest frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Cell {
    pub(super) kind: FrameKind,
    pub(super) step: u64,
    pub(super) is_new: bool,
}

/// Control message in transit.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) enum Message {
    Hello,
    Welcome { first: Step },
    Ready,
    Refusal,
}

/// Controller and its channels.
#[derive(Clone, Debug)]
pub(super) struct Member {
    pub(super) side: ControllerSide,
    pub(super) lives: bool,
    /// `true` if the controller is alive but no longer acts.
    pub(super) stopped: bool,
    pub(super) told_gone: bool,
    pub(super) opened: bool,
    /// First step that the controller has not answered.
    pub(super) answered: u64,
    pub(super) confirmed: Option<u64>,
    pub(super) to_plant: Vec<Message>,
    pub(super) to_controller: Vec<Message>,
    pub(super) sample: Option<Cell>,
    pub(super) command: Option<Cell>,
}

#[derive(Clone, Debug)]
pub(super) struct World {
    pub(super) steps: u64,
    pub(super) policy: OnLoss,
    pub(super) against_clock: bool,
    pub(super) plant: PlantSide,
    pub(super) plant_lives: bool,
    pub(super) crew: Vec<Member>,
    /// Epoch whose control channel the plant reads.
    pub(super) expected_epoch: u32,
    /// Epoch whose frames the plant uses; 0 before there are any.
    pub(super) used: u32,
    /// Next step to be executed.
    pub(super) next: u64,
    /// First step whose command would be newer than every command accepted by the plant.
    pub(super) newer: u64,
    /// End of the run, as reported by the plant.
    pub(super) end: Option<Result<(), String>>,
    pub(super) left: Bound,
}

pub(super) type Key = (
    [u64; 7],
    (bool, u32, u32, (u64, u64), bool, Bound),
    Vec<(
        [u64; 3],
        ([bool; 4], u64, Option<u64>),
        (Vec<Message>, Vec<Message>, Option<Cell>, Option<Cell>),
    )>,
);

pub(super) fn hello() -> Hello {
    Hello::new(5, "any")
}

pub(super) fn offer(epoch: u32, first: Step, steps: u64, against_clock: bool) -> Offer<'static> {
    Offer {
        session: 5,
        epoch,
        rate: Rate::new(10.0).expect("legal"),
        steps,
        first,
        against_clock,
        measured: &[],
        reference: &[],
        commands: &[],
    }
}

impl Member {
    pub(super) fn new() -> Self {
        let mut side = ControllerSide::new();
        let hello = hello();
        assert_eq!(
            side.on(&ControllerEvent::Begin(&hello)),
            ControllerAction::SendHello
        );
        Self {
            side,
            lives: true,
            stopped: false,
            told_gone: false,
            opened: false,
            answered: 0,
            confirmed: None,
            to_plant: vec![Message::Hello],
            to_controller: vec![],
            sample: None,
            command: None,
        }
    }

    pub(super) fn send(&mut self, kind: FrameKind, step: u64) {
        self.command = Some(Cell {
            kind,
            step,
            is_new: true,
        });
    }

    /// Performs an action of the controller's machine.
    pub(super) fn act(&mut self, action: ControllerAction) -> Result<(), String> {
        match action {
            ControllerAction::Ignore => {}
            ControllerAction::SendHello | ControllerAction::SendReady(_) => {
                return Err("out of turn".into());
            }
            ControllerAction::OpenFrames(_) => {
                self.opened = true;
                match self.side.on(&ControllerEvent::Opened) {
                    ControllerAction::SendReady(_) => self.to_plant.push(Message::Ready),
                    other => return Err(format!("{other:?} after opening")),
                }
            }
            ControllerAction::Answer(step) => {
                if step.0 < self.answered {
                    return Err(format!("step {step} was answered twice"));
                }
                self.answered = step.0 + 1;
                self.send(FrameKind::Command, step.0);
            }
            ControllerAction::ConfirmEnd(step) => {
                self.confirmed = Some(step.0);
                self.send(FrameKind::EndConfirmed, step.0);
                self.lives = false;
            }
            ControllerAction::Abort(_) => {
                if self.opened {
                    self.send(FrameKind::Abort, self.side.at().0);
                }
                self.lives = false;
            }
        }
        Ok(())
    }
}

impl World {
    pub(super) fn new(steps: u64, policy: OnLoss, against_clock: bool, bound: Bound) -> Self {
        let plant = PlantSide::new(steps).on_loss(policy);
        Self {
            steps,
            policy,
            against_clock,
            plant: if against_clock {
                plant.against_clock()
            } else {
                plant
            },
            plant_lives: true,
            crew: vec![Member::new()],
            expected_epoch: 1,
            used: 0,
            next: 0,
            newer: 0,
            end: None,
            left: bound,
        }
    }

    pub(super) fn key(&self) -> Key {
        let member = |m: &Member| {
            (
                m.side.key(),
                (
                    [m.lives, m.stopped, m.told_gone, m.opened],
                    m.answered,
                    m.confirmed,
                ),
                (
                    m.to_plant.clone(),
                    m.to_controller.clone(),
                    m.sample,
                    m.command,
                ),
            )
        };
        (
            self.plant.key(),
            (
                self.plant_lives,
                self.expected_epoch,
                self.used,
                (self.next, self.newer),
                self.end.is_some(),
                self.left,
            ),
            self.crew.iter().map(member).collect(),
        )
    }

    pub(super) fn member(&mut self, epoch: u32) -> Option<&mut Member> {
        self.crew.get_mut((epoch as usize).checked_sub(1)?)
    }

    pub(super) fn plant_is_over(&self) -> bool {
        !self.plant_lives || self.plant.is_over()
    }

    /// Returns `true` if no process acts any more.
    pub(super) fn is_over(&self) -> bool {
        let works = |member: &Member| member.lives && !member.stopped;
        self.plant_is_over() && !self.crew.iter().any(works)
    }

    /// Sends a frame of the plant on the channels in use.
    pub(super) fn send(&mut self, kind: FrameKind, step: u64) {
        let used = self.used;
        if let Some(member) = self.member(used) {
            member.sample = Some(Cell {
                kind,
                step,
                is_new: true,
            });
        }
    }

    pub(super) fn say(&mut self, message: Message) {
        let epoch = self.expected_epoch;
        if let Some(member) = self.member(epoch) {
            member.to_controller.push(message);
        }
    }

    /// Executes a step.
    pub(super) fn execute(&mut self, step: Step) -> Result<(), String> {
        if step.0 != self.next {
            return Err(format!("step {step} was executed, {} was due", self.next));
        }
        self.next += 1;
        Ok(())
    }

    /// Passes an event to the plant and performs its action. A frame belongs to the epoch in use.
    pub(super) fn tell(&mut self, event: &PlantEvent<'_>) -> Result<(), String> {
        let was_alone = self.plant.is_alone();
        match self.plant.on(event) {
            PlantAction::Nothing | PlantAction::Ignore(_) => {}
            PlantAction::Expect(epoch) => self.expected_epoch = epoch,
            PlantAction::Welcome(welcome) => {
                if self.used == 0 {
                    self.used = welcome.epoch;
                }
                self.say(Message::Welcome {
                    first: welcome.first,
                });
            }
            PlantAction::Refuse(reason) => {
                self.say(Message::Refusal);
                self.end = Some(Err(reason));
            }
            PlantAction::Dismiss(why) => {
                if was_alone && self.policy == OnLoss::WaitForRestart {
                    return Err(format!("nobody is left to wait for: {why}"));
                }
                self.say(Message::Refusal);
            }
            PlantAction::TakeOver(unanswered) => {
                if !was_alone {
                    self.send(FrameKind::Abort, self.next);
                }
                self.used = self.plant.epoch();
                let used = self.used;
                if !self.member(used).is_some_and(|member| member.opened) {
                    return Err(format!("controller {used} took over before it was ready"));
                }
                if let Some(step) = unanswered {
                    if step.0 != self.next {
                        return Err(format!("step {step} is sent again, {} is due", self.next));
                    }
                    self.send(FrameKind::Sample, step.0);
                }
            }
            PlantAction::SendSample(step) => {
                if step.0 != self.next {
                    return Err(format!("step {step} was sent, {} is due", self.next));
                }
                self.send(FrameKind::Sample, step.0);
            }
            PlantAction::Apply(step) => match event {
                PlantEvent::Frame(header) if header.step == step.0 && !was_alone => {
                    self.newer = step.0 + 1;
                    self.execute(step)?;
                }
                other => return Err(format!("step {step} met a stale command: {other:?}")),
            },
            PlantAction::Keep => match event {
                PlantEvent::Frame(header)
                    if self.against_clock && (self.newer..self.next).contains(&header.step) =>
                {
                    self.newer = header.step + 1;
                }
                other => return Err(format!("kept {other:?}")),
            },
            PlantAction::Hold(step) => {
                if !self.against_clock && !was_alone {
                    return Err(format!("step {step} did not wait for its command"));
                }
                self.execute(step)?;
            }
            PlantAction::SendEnd(step) => {
                if (step.0, self.next) != (self.steps, self.steps) {
                    return Err(format!("the end came after {} steps", self.next));
                }
                self.send(FrameKind::End, step.0);
            }
            PlantAction::Finish => {
                let used = self.used;
                let confirmed = self.member(used).and_then(|member| member.confirmed);
                if self.next != self.steps || (!was_alone && confirmed != Some(self.steps)) {
                    return Err(format!("finished after {} steps", self.next));
                }
                self.end = Some(Ok(()));
            }
            PlantAction::Lose(why) => {
                if let PlantEvent::PeerGone(epoch) = event
                    && *epoch != self.plant.epoch()
                {
                    return Err(format!("lost by the death of controller {epoch}"));
                }
                if self.policy == OnLoss::Abort || was_alone {
                    return Err(format!("lost in spite of the policy: {why}"));
                }
                self.send(FrameKind::Abort, self.next);
                if self.policy == OnLoss::WaitForRestart && self.plant.candidate().is_none() {
                    let epoch = self.crew.len() as u32 + 1;
                    self.tell(&PlantEvent::Expect(epoch))?;
                }
            }
            PlantAction::Abort(why) => {
                if why.to_string().is_empty() {
                    return Err("ended without a reason".into());
                }
                if self.used == 0 {
                    self.say(Message::Refusal);
                } else {
                    self.send(FrameKind::Abort, self.next);
                }
                self.end = Some(Err(why.to_string()));
            }
        }
        if self.plant.is_over() && self.end.is_none() {
            return Err("over without an end".into());
        }
        Ok(())
    }
}
