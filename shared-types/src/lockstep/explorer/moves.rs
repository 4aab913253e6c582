//! Moves of the world: the possible next events and the world after each.

use super::super::*;
use super::world::{Cell, Member, Message, World, hello, offer};
use crate::frame::Header;
use crate::hello::{Control, Welcome, agree};

/// Limit of a wait, quoted in messages.
const LIMIT_MS: u64 = 5000;
/// Maximum number of controllers in one run.
const CREW: usize = 3;

#[derive(Clone, Copy, Debug)]
pub(super) enum Which {
    Sample,
    Command,
}

impl Which {
    pub(super) const fn of(self, member: &Member) -> Option<Cell> {
        match self {
            Self::Sample => member.sample,
            Self::Command => member.command,
        }
    }

    pub(super) fn set(self, member: &mut Member, is_new: bool) {
        let cell = match self {
            Self::Sample => &mut member.sample,
            Self::Command => &mut member.command,
        };
        if let Some(cell) = cell {
            cell.is_new = is_new;
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Move {
    Release,
    Command,
    Hear,
    Miss,
    PlantTimeout,
    CandidateTimeout,
    Start,
    Swap,
    KillPlant,
    KillController(usize),
    StopController(usize),
    TellPlant(usize),
    Sample(usize),
    Listen(usize),
    TellController(usize),
    ControllerTimeout(usize),
    LoseFrame(usize, Which),
    Repeat(usize, Which),
}

impl Move {
    /// Returns `true` if the move is a fault or a request, which need not ever happen.
    pub(super) const fn only_breaks(self) -> bool {
        matches!(
            self,
            Self::KillPlant
                | Self::KillController(_)
                | Self::StopController(_)
                | Self::LoseFrame(..)
                | Self::Repeat(..)
                | Self::Swap
        )
    }
}

impl World {
    /// Lists all possible moves; the second list counts only if no move of the first makes progress.
    pub(super) fn moves(&self) -> (Vec<Move>, Vec<Move>) {
        let (mut moves, mut at_last) = (Vec::new(), Vec::new());
        let plant_works = !self.plant_is_over();
        let active = self.crew.get(self.used.wrapping_sub(1) as usize);
        let unread = active.and_then(|m| m.command).filter(|c| c.is_new);
        // Even without an active controller: the dead one's last message may still be pending.
        let frames_flow = !self.plant.is_greeting();
        if plant_works {
            if self.plant.unreleased().is_some() {
                moves.push(Move::Release);
            } else if unread.is_some() && frames_flow {
                moves.push(Move::Command);
            }
            let peer_member = &self.crew.get(self.expected_epoch as usize - 1);
            if peer_member.is_some_and(|m| !m.to_plant.is_empty()) {
                moves.push(Move::Hear);
            }
            let awaits = self.plant.unreleased().is_none();
            if awaits && !self.plant.is_greeting() && (self.against_clock || self.plant.is_alone())
            {
                moves.push(Move::Miss);
            }
            if awaits {
                at_last.push(Move::PlantTimeout);
            }
            if self.plant.candidate().is_some() {
                at_last.push(Move::CandidateTimeout);
            }
            let restarts = self.plant.candidate().is_some_and(|epoch| {
                epoch as usize == self.crew.len() + 1 && self.crew.len() < CREW
            });
            if restarts {
                moves.push(Move::Start);
            } else if self.left.swaps > 0 && self.crew.len() < CREW && !self.plant.is_greeting() {
                moves.push(Move::Swap);
            }
            if self.left.deaths > 0 {
                moves.push(Move::KillPlant);
            }
        }
        for (index, member) in self.crew.iter().enumerate() {
            if member.stopped {
                // It cannot even end.
            } else if member.lives {
                let sample = member.sample.filter(|cell| cell.is_new && member.opened);
                if sample.is_some() {
                    moves.push(Move::Sample(index));
                }
                if !member.to_controller.is_empty() {
                    moves.push(Move::Listen(index));
                }
                let idle = sample.is_none() && member.to_controller.is_empty();
                if self.plant_is_over() && idle {
                    moves.push(Move::TellController(index));
                }
                at_last.push(Move::ControllerTimeout(index));
                if self.left.deaths > 0 {
                    moves.push(Move::KillController(index));
                    moves.push(Move::StopController(index));
                }
            } else if plant_works && !member.told_gone {
                // A message sent before its end still counts.
                let unread = member.command.is_some_and(|cell| cell.is_new);
                if !(unread && index + 1 == self.used as usize) && member.to_plant.is_empty() {
                    moves.push(Move::TellPlant(index));
                }
            }
            for cell in [Which::Sample, Which::Command] {
                match cell.of(member) {
                    Some(frame) if frame.is_new && self.left.losses > 0 => {
                        moves.push(Move::LoseFrame(index, cell));
                    }
                    Some(frame) if !frame.is_new && self.left.repeats > 0 => {
                        moves.push(Move::Repeat(index, cell));
                    }
                    _ => {}
                }
            }
        }
        if self.left.timeouts > 0 {
            moves.append(&mut at_last);
        }
        (moves, at_last)
    }

    /// Returns the world after a move.
    pub(super) fn after(&self, happens: Move) -> Result<Self, String> {
        let mut world = self.clone();
        match happens {
            Move::Release => world.tell(&PlantEvent::Release)?,
            Move::Command => {
                let used = world.used;
                let cell = world.member(used).and_then(|m| m.command.as_mut());
                let cell = cell.ok_or("no frame")?;
                cell.is_new = false;
                let header = Header::new(cell.kind, Step(cell.step));
                world.tell(&PlantEvent::Frame(&header))?;
            }
            Move::Hear => {
                let current_epoch = world.expected_epoch;
                let message = (world.member(current_epoch).ok_or("nobody")?)
                    .to_plant
                    .remove(0);
                match message {
                    Message::Hello => {
                        let at = world.plant.at();
                        let offer = offer(current_epoch, at, world.steps, world.against_clock);
                        world.tell(&PlantEvent::Hello(&hello(), &offer))?;
                    }
                    Message::Ready => world.tell(&PlantEvent::Ready(current_epoch))?,
                    _ => return Err("a controller welcomes nobody".into()),
                }
            }
            Move::Miss => world.tell(&PlantEvent::Missed)?,
            Move::PlantTimeout => {
                world.left.timeouts = world.left.timeouts.saturating_sub(1);
                world.tell(&PlantEvent::Deadline(LIMIT_MS))?;
            }
            Move::CandidateTimeout => {
                world.left.timeouts = world.left.timeouts.saturating_sub(1);
                world.tell(&PlantEvent::CandidateLate(LIMIT_MS))?;
            }
            Move::Start => world.crew.push(Member::new()),
            Move::Swap => {
                world.left.swaps -= 1;
                world.crew.push(Member::new());
                let epoch = world.crew.len() as u32;
                world.tell(&PlantEvent::Expect(epoch))?;
            }
            Move::KillPlant => {
                world.left.deaths -= 1;
                world.plant_lives = false;
            }
            Move::KillController(index) => {
                world.left.deaths -= 1;
                world.crew[index].lives = false;
            }
            Move::StopController(index) => {
                world.left.deaths -= 1;
                world.crew[index].stopped = true;
            }
            Move::TellPlant(index) => {
                world.crew[index].told_gone = true;
                world.tell(&PlantEvent::PeerGone(index as u32 + 1))?;
            }
            Move::Sample(index) => {
                let member = &mut world.crew[index];
                let cell = member.sample.as_mut().ok_or("no frame")?;
                cell.is_new = false;
                let header = Header::new(cell.kind, Step(cell.step));
                let action = member.side.on(&ControllerEvent::Frame(&header));
                member.act(action)?;
            }
            Move::Listen(index) => {
                let (steps, against_clock) = (world.steps, world.against_clock);
                let member = &mut world.crew[index];
                let message = match member.to_controller.remove(0) {
                    Message::Welcome { first } => {
                        let offer = offer(index as u32 + 1, first, steps, against_clock);
                        let welcome: Result<Welcome, _> = agree(&hello(), &offer);
                        Control::Welcome(Box::new(welcome.map_err(|e| e.to_string())?))
                    }
                    Message::Refusal => Control::Refusal {
                        reason: "no".into(),
                    },
                    _ => return Err("a plant says no hello".into()),
                };
                let action = member.side.on(&ControllerEvent::Control(&message));
                member.act(action)?;
                // While frames flow, a refusal means that the plant aborts.
                if message
                    == (Control::Refusal {
                        reason: "no".into(),
                    })
                {
                    member.lives = false;
                }
            }
            Move::TellController(index) => {
                let member = &mut world.crew[index];
                let action = member.side.on(&ControllerEvent::PeerGone);
                member.act(action)?;
            }
            Move::ControllerTimeout(index) => {
                world.left.timeouts = world.left.timeouts.saturating_sub(1);
                let member = &mut world.crew[index];
                let action = member.side.on(&ControllerEvent::Deadline(LIMIT_MS));
                member.act(action)?;
            }
            Move::LoseFrame(index, cell) => {
                world.left.losses -= 1;
                cell.set(&mut world.crew[index], false);
            }
            Move::Repeat(index, cell) => {
                world.left.repeats -= 1;
                cell.set(&mut world.crew[index], true);
            }
        }
        Ok(world)
    }
}
