//! Peers that send arbitrary messages for as long as they like, and still cannot keep a run from ending.
//!
//! Each machine is driven as in its process. At every poll the other side sends nothing or any message: any frame of
//! any step within reach, or any control message, from the active or the announced controller. A wait ends after a few
//! polls, and restarts only when the [`Standing`] changes. Every reachable state is visited, and no state may recur:
//! otherwise the other side could lead the run in a circle for ever.

use std::collections::HashMap;
use std::hash::Hash;

use super::*;
use crate::frame::{FrameKind, Header};
use crate::hello::{Control, Hello, Offer, agree};
use crate::time::Rate;

/// Limit of a wait, quoted in messages.
const LIMIT_MS: u64 = 5000;
/// Polls until a fruitless wait ends.
const PATIENCE: u8 = 2;
/// In real time, steps that may miss their command before the controller counts as lost.
const MISSES: u8 = 2;
/// Steps of a run.
const STEPS: u64 = 3;
/// Maximum number of controllers in one run.
const CREW: u32 = 3;
const KINDS: [FrameKind; 6] = [
    FrameKind::Sample,
    FrameKind::Command,
    FrameKind::End,
    FrameKind::EndConfirmed,
    FrameKind::Abort,
    FrameKind::Hold,
];

fn hello() -> Hello {
    Hello::new(5, "any")
}

fn offer(epoch: u32, first: Step, against_clock: bool) -> Offer<'static> {
    Offer {
        session: 5,
        epoch,
        rate: Rate::new(10.0).expect("legal"),
        steps: STEPS,
        first,
        against_clock,
        measured: &[],
        reference: &[],
        commands: &[],
    }
}

/// Side under test, its driver, and the messages of the other side.
trait Pestered: Clone {
    type Said: Clone + std::fmt::Debug;
    type Key: Eq + Hash;

    /// Complete state, which determines the side's further behaviour.
    fn key(&self) -> Self::Key;

    fn is_over(&self) -> bool;

    /// All messages that may arrive at the next poll.
    fn sayings(&self) -> Vec<Self::Said>;

    /// Performs the next poll.
    fn poll(&mut self, message: &Self::Said) -> Result<(), String>;
}

/// Visits every reachable state and returns their number. Fails if a state recurs.
fn explore<S: Pestered>(start: S) -> Result<usize, String> {
    /// State on the path from the start, with the messages not yet tried in that state.
    struct Place<S: Pestered> {
        state: S,
        left: Vec<S::Said>,
        said: Option<S::Said>,
    }
    // Maps each visited state to `true` while it lies on the path to the current one.
    let mut on_path = HashMap::from([(start.key(), true)]);
    let mut way = vec![Place {
        left: start.sayings(),
        state: start,
        said: None,
    }];
    while let Some(place) = way.last_mut() {
        let Some(message) = place.left.pop() else {
            on_path.insert(place.state.key(), false);
            way.pop();
            continue;
        };
        place.said = Some(message.clone());
        let mut state = place.state.clone();
        let polled = state.poll(&message);
        let so_far = |way: &[Place<S>]| {
            let messages: Vec<_> = way.iter().filter_map(|place| place.said.clone()).collect();
            format!("{messages:?}")
        };
        polled.map_err(|wrong| format!("{wrong}: {}", so_far(&way)))?;
        if state.is_over() {
            continue;
        }
        match on_path.get(&state.key()) {
            Some(false) => {}
            Some(true) => return Err(format!("the conversation never ends: {}", so_far(&way))),
            None => {
                on_path.insert(state.key(), true);
                let left = state.sayings();
                way.push(Place {
                    state,
                    left,
                    said: None,
                });
            }
        }
    }
    Ok(on_path.len())
}

/// Control message to the plant.
#[derive(Clone, Copy, Debug)]
enum Word {
    Hello,
    Ready(u32),
}

/// Input of a plant at one poll.
#[derive(Clone, Copy, Debug)]
struct Heard {
    frame: Option<(FrameKind, u64)>,
    word: Option<Word>,
    /// A request for another controller.
    swap: bool,
}

/// Plant, driven as by its engine and wait loop.
#[derive(Clone)]
struct PesteredPlant {
    side: PlantSide,
    against_clock: bool,
    policy: OnLoss,
    /// Polls left in the current wait and in the announced controller's wait, and misses left.
    left: u8,
    candidate_left: u8,
    misses_left: u8,
    swaps: u8,
    expected: u32,
}

impl PesteredPlant {
    fn new(policy: OnLoss, against_clock: bool) -> Self {
        let side = PlantSide::new(STEPS).on_loss(policy);
        Self {
            side: if against_clock {
                side.against_clock()
            } else {
                side
            },
            against_clock,
            policy,
            left: PATIENCE,
            candidate_left: 0,
            misses_left: MISSES,
            swaps: 1,
            expected: 1,
        }
    }

    /// Passes an event to the machine; returns `true` if the machine advanced.
    fn tell(&mut self, event: &PlantEvent<'_>) -> bool {
        let before = self.side.standing();
        match self.side.on(event) {
            PlantAction::Expect(epoch) => {
                (self.expected, self.candidate_left) = (epoch, 2 * PATIENCE);
            }
            PlantAction::Apply(_) | PlantAction::Keep | PlantAction::TakeOver(_) => {
                self.misses_left = MISSES;
            }
            PlantAction::Lose(_) => {
                self.misses_left = MISSES;
                if self.policy == OnLoss::WaitForRestart && self.side.candidate().is_none() {
                    self.tell(&PlantEvent::Expect(self.expected + 1));
                }
            }
            _ => {}
        }
        self.side.standing() != before
    }

    fn speak(&mut self, word: Word, epoch: u32) -> bool {
        match word {
            Word::Hello => {
                let offer = offer(epoch, self.side.at(), self.against_clock);
                self.tell(&PlantEvent::Hello(&hello(), &offer))
            }
            Word::Ready(epoch) => self.tell(&PlantEvent::Ready(epoch)),
        }
    }

    /// Polls the engine; returns `true` if the run advanced.
    fn gets_on(&mut self, input: &Heard) -> bool {
        if self.side.is_greeting() {
            return input.word.is_some_and(|word| self.speak(word, 1));
        }
        if self.side.candidate().is_some() {
            if self.candidate_left == 0 {
                if self.tell(&PlantEvent::CandidateLate(LIMIT_MS)) {
                    return true;
                }
            } else {
                self.candidate_left -= 1;
                // The launcher starts only a limited number.
                let word = input.word.filter(|_| self.expected <= CREW);
                if word.is_some_and(|word| self.speak(word, self.expected)) {
                    return true;
                }
            }
        }
        if self.side.unreleased().is_some() {
            return self.tell(&PlantEvent::Release);
        }
        if self.side.is_alone() {
            return self.tell(&PlantEvent::Missed);
        }
        input.frame.is_some_and(|(kind, step)| {
            self.tell(&PlantEvent::Frame(&Header::new(kind, Step(step))))
        })
    }

    /// Reports the end of the wait or, in real time, of the step.
    fn is_late(&mut self) {
        // The first command and the confirmation are waited for even in real time.
        let has_deadline = self.against_clock && (1..STEPS).contains(&self.side.at().0);
        if has_deadline && !self.side.is_greeting() && self.misses_left > 0 {
            self.misses_left -= 1;
            self.tell(&PlantEvent::Missed);
        } else {
            self.tell(&PlantEvent::Deadline(LIMIT_MS));
        }
    }
}

impl Pestered for PesteredPlant {
    type Said = Heard;
    type Key = ([u64; 7], [u8; 4], u32);

    fn key(&self) -> Self::Key {
        let counts = [self.left, self.candidate_left, self.misses_left, self.swaps];
        (self.side.key(), counts, self.expected)
    }

    fn is_over(&self) -> bool {
        self.side.is_over()
    }

    fn sayings(&self) -> Vec<Heard> {
        let of_kind = |kind| (0..=STEPS).map(move |step| Some((kind, step)));
        let frames: Vec<_> = (KINDS.into_iter().flat_map(of_kind))
            .chain([None])
            .collect();
        let ready = (1..=CREW).map(|epoch| Some(Word::Ready(epoch)));
        let words: Vec<_> = ready.chain([None, Some(Word::Hello)]).collect();
        let mut sayings = Vec::new();
        for swap in [false, true] {
            if swap && (self.swaps == 0 || self.side.is_greeting()) {
                continue;
            }
            for &frame in &frames {
                sayings.extend(words.iter().map(|&word| Heard { frame, word, swap }));
            }
        }
        sayings
    }

    fn poll(&mut self, input: &Heard) -> Result<(), String> {
        if input.swap {
            self.swaps -= 1;
            self.tell(&PlantEvent::Expect(self.expected + 1));
        }
        if self.gets_on(input) {
            self.left = PATIENCE;
        } else if self.left > 0 {
            self.left -= 1;
        } else {
            self.is_late();
            self.left = PATIENCE;
        }
        Ok(())
    }
}

/// Input of a controller at one poll.
#[derive(Clone, Debug)]
enum Told {
    Nothing,
    Frame(FrameKind, u64),
    Message(Control),
}

/// Controller, driven as by its runner and wait loop.
#[derive(Clone)]
struct PesteredController {
    side: ControllerSide,
    against_clock: bool,
    epoch: u32,
    left: u8,
}

impl PesteredController {
    fn new(against_clock: bool, epoch: u32) -> Self {
        let mut side = ControllerSide::new();
        side.on(&ControllerEvent::Begin(&hello()));
        Self {
            side,
            against_clock,
            epoch,
            left: PATIENCE,
        }
    }
}

impl Pestered for PesteredController {
    type Said = Told;
    type Key = ([u64; 3], u8);

    fn key(&self) -> Self::Key {
        (self.side.key(), self.left)
    }

    fn is_over(&self) -> bool {
        self.side.is_over()
    }

    /// All messages except a hold: a peer with the right to hold a run may hold it for ever.
    fn sayings(&self) -> Vec<Told> {
        let kinds = KINDS.into_iter().filter(|kind| *kind != FrameKind::Hold);
        let of_kind = |kind| (0..=STEPS).map(move |step| Told::Frame(kind, step));
        let offer = offer(self.epoch, Step(0), self.against_clock);
        let welcome = agree(&hello(), &offer).expect("agreed");
        let messages = [
            Control::Hello(hello()),
            Control::Welcome(Box::new(welcome)),
            Control::Ready { epoch: 1 },
            Control::Refusal {
                reason: "no".into(),
            },
        ];
        (kinds.flat_map(of_kind))
            .chain(messages.map(Told::Message))
            .chain([Told::Nothing])
            .collect()
    }

    fn poll(&mut self, input: &Told) -> Result<(), String> {
        let before = self.side.standing();
        match input {
            Told::Message(message) if self.side.is_greeting() || self.side.awaits_first() => {
                let action = self.side.on(&ControllerEvent::Control(message));
                if matches!(action, ControllerAction::OpenFrames(_)) {
                    self.side.on(&ControllerEvent::Opened);
                }
            }
            Told::Frame(kind, step) if !self.side.is_greeting() => {
                let header = Header::new(*kind, Step(*step));
                self.side.on(&ControllerEvent::Frame(&header));
            }
            _ => {}
        }
        if self.side.standing() != before {
            self.left = PATIENCE;
        } else if self.left > 0 {
            self.left -= 1;
        } else {
            self.side.on(&ControllerEvent::Deadline(LIMIT_MS));
        }
        Ok(())
    }
}

#[test]
fn a_plant_ends_whatever_its_controllers_send() {
    let mut states = 0;
    for policy in OnLoss::ALL {
        for against_clock in [false, true] {
            let explored = explore(PesteredPlant::new(policy, against_clock));
            states += explored.unwrap_or_else(|wrong| {
                panic!("{policy:?}, in real time: {against_clock}: {wrong}")
            });
        }
    }
    println!("{states} states");
}

#[test]
fn a_controller_ends_whatever_its_plant_sends() {
    for against_clock in [false, true] {
        for epoch in [1, 2] {
            let explored = explore(PesteredController::new(against_clock, epoch));
            explored.unwrap_or_else(|wrong| {
                panic!("epoch {epoch}, in real time: {against_clock}: {wrong}")
            });
        }
    }
}
