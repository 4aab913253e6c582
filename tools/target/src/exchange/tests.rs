//! The exchange over a wire that a seeded random number spoils: what each end gives its peer is what it would have been
//! over shared memory.

use std::collections::VecDeque;

use shared_types::time::Step;

use super::*;

/// A step of the world.
const TICK_NS: u64 = 100_000;

/// Random numbers (splitmix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn hits(&mut self, percent: u64) -> bool {
        self.next() % 100 < percent
    }
}

/// Direction of a wire.
struct Line {
    percent: u64,
    /// Ticks left, and the packet.
    under_way: VecDeque<(u64, Vec<u8>)>,
}

impl Line {
    fn new(percent: u64) -> Self {
        Self {
            percent,
            under_way: VecDeque::new(),
        }
    }

    /// Loses, repeats, delays and reorders. What is corrupted is lost: its seal is broken.
    fn send(&mut self, packet: &[u8], random: &mut Random) {
        if random.hits(2 * self.percent) {
            return;
        }
        let copies = if random.hits(self.percent) { 2 } else { 1 };
        for _ in 0..copies {
            let ticks = if random.hits(self.percent) {
                random.next() % 50
            } else {
                1
            };
            self.under_way.push_back((ticks, packet.to_vec()));
        }
    }

    fn arrived(&mut self) -> Vec<Packet> {
        for (ticks, _) in &mut self.under_way {
            *ticks = ticks.saturating_sub(1);
        }
        let mut arrived = Vec::new();
        self.under_way.retain(|(ticks, packet)| {
            if *ticks == 0 {
                arrived.push(Packet::read(packet).expect("a packet"));
            }
            *ticks > 0
        });
        arrived
    }
}

fn sample(step: u64) -> Header {
    Header {
        count: 1,
        ..Header::new(FrameKind::Sample, Step(step))
    }
}

fn command(step: u64) -> Header {
    Header {
        count: 1,
        ..Header::new(FrameKind::Command, Step(step))
    }
}

/// A law whose state shows every sample that it stepped at, in order.
fn law(state: u64, step: u64) -> u64 {
    (state ^ step).wrapping_mul(0x0000_0100_0000_01b3)
}

#[test]
fn in_lockstep_each_sample_is_answered_once_whatever_the_wire_does() {
    const STEPS: u64 = 400;
    let expected: Vec<u64> = (0..STEPS)
        .scan(7, |state, step| {
            *state = law(*state, step);
            Some(*state)
        })
        .collect();
    for percent in [0, 1, 5, 20] {
        for seed in 0..50 {
            let mut random = Random(seed);
            let mut lines = [Line::new(percent), Line::new(percent)];
            let (mut desk, mut target) = (DeskEnd::new(false, BEAT_NS), TargetEnd::new(false));
            let (mut state, mut bytes, mut got) = (7, Vec::new(), Vec::new());
            let mut ticks = 0;
            desk.say(&sample(0), &[0.0]);
            while got.len() < STEPS as usize {
                ticks += 1;
                assert!(
                    ticks < 2_000_000,
                    "{percent} %, seed {seed}: stuck at {}",
                    got.len()
                );
                let now_ns = ticks * TICK_NS;
                if now_ns >= desk.due_ns() {
                    desk.packet(now_ns, &mut bytes);
                    lines[0].send(&bytes, &mut random);
                }
                for packet in lines[0].arrived() {
                    if let Some(frame) = target.take(packet) {
                        state = law(state, frame.header.step);
                        target.say(&command(frame.header.step), &[f64::from_bits(state)]);
                    }
                    target.packet(&mut bytes);
                    lines[1].send(&bytes, &mut random);
                }
                for packet in lines[1].arrived() {
                    if let Some(frame) = desk.take(packet, now_ns) {
                        assert_eq!(frame.header.step, got.len() as u64);
                        got.push(frame.values[0].to_bits());
                        let next = got.len() as u64;
                        if next < STEPS {
                            desk.say(&sample(next), &[next as f64]);
                        }
                    }
                }
            }
            assert_eq!(got, expected, "{percent} %, seed {seed}");
        }
    }
}

/// A plant that waits for nobody, a bridge and an agent that are not always scheduled, and a law that takes its time.
/// Each side has a cell with the latest frame for the next, as shared memory has.
struct Realtime {
    step: u64,
    /// Step of the newest command that the plant met.
    newest: Option<u64>,
    sample: Option<Header>,
    command: Option<u64>,
    pending: Option<u64>,
    /// Step that the law works on, and the ticks that it still takes.
    work: Option<(u64, u64)>,
    answered: Vec<u64>,
    seen: Vec<u64>,
    pairs: Vec<(u64, Vec<u64>)>,
}

impl Realtime {
    /// The plant meets the newest command and sends the next sample.
    fn release(&mut self) {
        if let Some(step) = self.command.take() {
            self.newest = Some(step);
            self.seen.push(step);
        }
        let met = self.newest.unwrap_or(0);
        let held = self.step.saturating_sub(1).saturating_sub(met);
        self.sample = Some(Header {
            held_steps: held as u32,
            ..sample(self.step)
        });
        self.step += 1;
    }

    /// The law works for a tick; returns its answer once it is done.
    fn law(&mut self, random: &mut Random) -> Option<u64> {
        if self.work.is_none() {
            self.work = self.pending.take().map(|step| (step, random.next() % 8));
        }
        let (step, left) = self.work?;
        if left > 0 {
            self.work = Some((step, left - 1));
            return None;
        }
        self.work = None;
        let named = self.answered.iter().rev().take(2).copied().collect();
        self.pairs.push((step, named));
        self.answered.push(step);
        Some(step)
    }
}

#[test]
fn against_the_clock_what_a_command_names_completes_the_list_of_all_answers() {
    const STEPS: u64 = 2_000;
    for percent in [0, 5, 20] {
        for seed in 0..50 {
            let mut random = Random(seed);
            let mut lines = [Line::new(percent), Line::new(percent)];
            let (mut desk, mut target) = (DeskEnd::new(true, BEAT_NS), TargetEnd::new(true));
            let mut bytes = Vec::new();
            let mut world = Realtime {
                step: 0,
                newest: None,
                sample: None,
                command: None,
                pending: None,
                work: None,
                answered: Vec::new(),
                seen: Vec::new(),
                pairs: Vec::new(),
            };
            for tick in 0..5 * STEPS {
                let now_ns = (tick + 1) * TICK_NS;
                // A burst now and then, in which nothing gets through.
                let is_burst = tick / 100 % 5 == 4;
                if tick % 5 == 0 {
                    world.release();
                }
                // The bridge and the agent run most of the time.
                if !random.hits(30) {
                    if let Some(header) = world.sample.take() {
                        desk.say(&header, &[0.0]);
                    }
                    if now_ns >= desk.due_ns() {
                        desk.packet(now_ns, &mut bytes);
                        if !is_burst {
                            lines[0].send(&bytes, &mut random);
                        }
                    }
                    for packet in lines[1].arrived() {
                        if let Some(frame) = desk.take(packet, now_ns) {
                            world.command = Some(frame.header.step);
                        }
                    }
                }
                if !random.hits(30) {
                    for packet in lines[0].arrived() {
                        if let Some(frame) = target.take(packet) {
                            world.pending = Some(frame.header.step);
                        }
                        target.packet(&mut bytes);
                        if !is_burst {
                            lines[1].send(&bytes, &mut random);
                        }
                    }
                }
                if let Some(step) = world.law(&mut random) {
                    target.say(&command(step), &[0.0]);
                    target.packet(&mut bytes);
                    if !is_burst {
                        lines[1].send(&bytes, &mut random);
                    }
                }
            }
            let last = *world.seen.last().expect("some were seen");
            assert!(
                world.seen.len() as u64 > STEPS / 8,
                "{percent} %, seed {seed}"
            );
            let named = world
                .pairs
                .iter()
                .filter(|(step, _)| world.seen.contains(step));
            let mut known: Vec<u64> = named
                .flat_map(|(step, named)| named.iter().chain([step]))
                .copied()
                .collect();
            known.sort_unstable();
            known.dedup();
            let all: Vec<u64> = world
                .answered
                .iter()
                .copied()
                .filter(|step| *step <= last)
                .collect();
            assert_eq!(known, all, "{percent} %, seed {seed}");
        }
    }
}

#[test]
fn a_sample_is_never_repeated_against_the_clock() {
    let (mut desk, mut bytes) = (DeskEnd::new(true, BEAT_NS), Vec::new());
    desk.say(&sample(3), &[0.0]);
    desk.packet(1, &mut bytes);
    assert!(Packet::read(&bytes).expect("a packet").frame.is_some());
    desk.packet(2 + BEAT_NS, &mut bytes);
    assert!(Packet::read(&bytes).expect("a packet").frame.is_none());
}

#[test]
fn a_repeated_frame_gets_the_stored_answer_and_the_law_no_step() {
    let (mut desk, mut target) = (DeskEnd::new(false, BEAT_NS), TargetEnd::new(false));
    let mut bytes = Vec::new();
    let read = |bytes: &[u8]| Packet::read(bytes).expect("a packet");
    desk.say(&sample(0), &[1.0]);
    desk.packet(1, &mut bytes);
    let first = bytes.clone();
    let given = target.take(read(&first)).expect("given to the controller");
    assert_eq!(given.values, [1.0]);
    assert!(target.take(read(&first)).is_none(), "again");
    target.say(&command(0), &[2.0]);
    for _ in 0..3 {
        assert!(target.take(read(&first)).is_none(), "again");
        target.packet(&mut bytes);
        assert_eq!(read(&bytes).frame.expect("stored").values, [2.0]);
    }
    assert!(desk.take(read(&bytes), 2).is_some());
    assert!(desk.take(read(&bytes), 3).is_none(), "again");
    assert!(!desk.awaits_answer());
}

#[test]
fn a_sample_is_repeated_in_lockstep_alone_and_an_end_always() {
    let mut bytes = Vec::new();
    for against_clock in [false, true] {
        for (header, wants) in [
            (sample(3), !against_clock),
            (Header::new(FrameKind::End, Step(4)), true),
        ] {
            let mut desk = DeskEnd::new(against_clock, BEAT_NS);
            desk.say(&header, &[0.0]);
            desk.packet(1, &mut bytes);
            let is_soon = desk.due_ns() < BEAT_NS;
            assert_eq!(is_soon, wants, "{against_clock} {:?}", header.kind());
        }
    }
}

#[test]
fn the_other_end_cannot_have_heard_what_was_never_said() {
    let (mut desk, mut bytes) = (DeskEnd::new(false, BEAT_NS), Vec::new());
    desk.say(&sample(0), &[0.0]);
    desk.packet(1, &mut bytes);
    let lie = Packet {
        heard: u64::MAX,
        frame: None,
    };
    assert!(desk.take(lie, 2).is_none());
    assert!(desk.awaits_answer());
}
