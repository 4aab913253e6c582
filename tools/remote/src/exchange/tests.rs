//! The exchange over a wire disturbed by seeded random numbers: each end passes its peer the same frames as shared
//! memory would.

use std::collections::{BTreeSet, VecDeque};

use shared_types::time::Step;

use super::*;

/// Time step of the simulation in ns.
const TICK_NS: u64 = 100_000;

/// Pseudo-random numbers (splitmix64).
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

/// One direction of a wire.
struct Line {
    percent: u64,
    /// Remaining ticks and the packet.
    under_way: VecDeque<(u64, Vec<u8>)>,
}

impl Line {
    fn new(percent: u64) -> Self {
        Self {
            percent,
            under_way: VecDeque::new(),
        }
    }

    /// Sends a packet with loss, repetition, delay and reordering. Corruption counts as loss, because
    /// authentication fails.
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

/// Returns a command that names these steps as answered earlier, the latest first.
fn command_after(step: u64, before: &[u64]) -> Header {
    let steps = |place: usize, from: u64| before.get(place).map_or(0, |step| (from - step) as u32);
    let last_steps = steps(0, step);
    let answered = Answered {
        last_steps,
        last_but_one_steps: steps(1, step - u64::from(last_steps)),
    };
    Header {
        directive: answered.to_wire(),
        ..command(step)
    }
}

/// Returns the state of a law that depends on every sample with which it stepped, in order.
fn law(state: u64, step: u64) -> u64 {
    (state ^ step).wrapping_mul(0x0000_0100_0000_01b3)
}

#[test]
fn in_lockstep_each_sample_is_answered_once_over_any_wire() {
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

/// Plant that never waits, a bridge and an agent that are not always scheduled, and a law with a variable computation
/// time. Neighbours share a cell with the latest frame, as in shared memory.
struct Realtime {
    random: Random,
    /// Share of ticks in which bridge and agent do not run, in percent.
    idle: u64,
    /// Longest computation of the law in ticks.
    longest: u64,
    lines: [Line; 2],
    desk: DeskEnd,
    target: TargetEnd,
    is_burst: bool,
    bytes: Vec<u8>,
    step: u64,
    /// Step of the latest command received by the plant.
    newest: u64,
    /// Cell from the plant to the bridge; the reverse one follows.
    sample: Option<Header>,
    command: Option<u64>,
    /// Cell from the agent to the law; the reverse one follows.
    pending: Option<u64>,
    answer: Option<Header>,
    /// Step in progress at the law, with its remaining ticks.
    work: Option<(u64, u64)>,
    answered: Vec<u64>,
    seen: BTreeSet<u64>,
    pairs: Vec<(u64, Vec<u64>)>,
}

impl Realtime {
    /// Creates a run whose first step is over: the plant waits for its command.
    fn new(random: Random, percent: u64, idle: u64, longest: u64) -> Self {
        let mut target = TargetEnd::new(true);
        target.delivered[0] = Some(0);
        target.say(&command(0), &[0.0]);
        Self {
            random,
            idle,
            longest,
            lines: [Line::new(percent), Line::new(percent)],
            desk: DeskEnd::new(true, BEAT_NS),
            target,
            is_burst: false,
            bytes: Vec::new(),
            step: 1,
            newest: 0,
            sample: None,
            command: None,
            pending: None,
            answer: None,
            work: None,
            answered: vec![0],
            seen: BTreeSet::from([0]),
            pairs: vec![(0, Vec::new())],
        }
    }

    /// Lets the plant receive the latest command and send the next sample.
    fn release(&mut self) {
        if let Some(step) = self.command.take() {
            self.newest = step;
            self.seen.insert(step);
        }
        self.sample = Some(Header {
            held_steps: (self.step - 1 - self.newest) as u32,
            ..sample(self.step)
        });
        self.step += 1;
    }

    /// Lets the law work for at least one tick.
    fn law(&mut self) {
        loop {
            if self.work.is_none() {
                let ticks = self.random.next() % (self.longest + 1);
                self.work = self.pending.take().map(|step| (step, ticks));
            }
            let Some((step, left)) = self.work else {
                return;
            };
            if left > 0 {
                self.work = Some((step, left - 1));
                return;
            }
            self.work = None;
            let named: Vec<u64> = self.answered.iter().rev().take(2).copied().collect();
            self.answer = Some(command_after(step, &named));
            self.pairs.push((step, named));
            self.answered.push(step);
            if self.random.hits(50) {
                return;
            }
        }
    }

    fn bridge(&mut self, now_ns: u64) {
        if let Some(header) = self.sample.take() {
            self.desk.say(&header, &[0.0]);
        }
        if now_ns >= self.desk.due_ns() {
            self.desk.packet(now_ns, &mut self.bytes);
            self.send(0);
        }
        for packet in self.lines[1].arrived() {
            if let Some(frame) = self.desk.take(packet, now_ns) {
                self.command = Some(frame.header.step);
            }
        }
    }

    /// The law may proceed at any point of this function.
    fn agent(&mut self) {
        for packet in self.lines[0].arrived() {
            self.look();
            self.interrupt();
            if let Some(frame) = self.target.take(packet) {
                self.pending = Some(frame.header.step);
            } else {
                self.target.packet(&mut self.bytes);
                self.send(1);
            }
            self.interrupt();
        }
        self.look();
    }

    fn look(&mut self) {
        if let Some(header) = self.answer.take() {
            self.target.say(&header, &[0.0]);
            self.target.packet(&mut self.bytes);
            self.send(1);
        }
    }

    fn interrupt(&mut self) {
        if self.random.hits(self.idle) {
            self.law();
        }
    }

    fn send(&mut self, line: usize) {
        if !self.is_burst {
            self.lines[line].send(&self.bytes, &mut self.random);
        }
    }
}

#[test]
fn in_real_time_the_answers_named_by_commands_complete_the_list() {
    const STEPS: u64 = 2_000;
    let loads = [(0, 7), (30, 2), (30, 7), (70, 7), (70, 30), (95, 2)];
    for ((percent, seed), (idle, longest)) in [0, 5, 20]
        .into_iter()
        .flat_map(|percent| (0..10).map(move |seed| (percent, seed)))
        .flat_map(|wire| loads.map(|load| (wire, load)))
    {
        let what = format!("{percent} %, seed {seed}, idle {idle} %, work {longest}");
        let mut world = Realtime::new(Random(seed), percent, idle, longest);
        for tick in 0..5 * STEPS {
            let now_ns = (tick + 1) * TICK_NS;
            // Occasional bursts in which nothing gets through.
            world.is_burst = tick / 100 % 5 == 4;
            if tick % 5 == 0 {
                world.release();
            }
            if !world.random.hits(idle) {
                world.bridge(now_ns);
            }
            if !world.random.hits(idle) {
                world.agent();
            }
            world.law();
        }
        let last = *world.seen.last().expect("the first");
        let least = if idle <= 30 { STEPS / 8 } else { STEPS / 80 };
        assert!(world.seen.len() as u64 > least, "{what}");
        let named = (world.pairs.iter()).filter(|(step, _)| world.seen.contains(step));
        let listed: BTreeSet<u64> = named
            .flat_map(|(step, named)| named.iter().chain([step]))
            .copied()
            .collect();
        let answered = world.answered.iter().copied();
        let all: BTreeSet<u64> = answered.filter(|step| *step <= last).collect();
        assert_eq!(listed, all, "{what}");
    }
}

/// Returns `true` if a sample made while the plant held another step's command is passed on.
fn is_given(target: &mut TargetEnd, number: u64, met: u64) -> bool {
    let frame = Numbered {
        number: number + 1,
        header: Header {
            held_steps: (number - 1 - met) as u32,
            ..sample(number)
        },
        values: vec![0.0],
    };
    let frame = Some(frame);
    target.take(Packet { received: 0, frame }).is_some()
}

/// Creates a target whose controller answered the samples of steps 0 and 1, of which the plant saw the first.
fn at_step_1() -> TargetEnd {
    let mut target = TargetEnd::new(true);
    let first = Numbered {
        number: 1,
        header: sample(0),
        values: vec![0.0],
    };
    let frame = Some(first);
    assert!(target.take(Packet { received: 0, frame }).is_some());
    target.say(&command(0), &[0.0]);
    assert!(is_given(&mut target, 1, 0));
    target.say(&command_after(1, &[0]), &[0.0]);
    target
}

#[test]
fn a_sample_is_withheld_while_its_answer_could_be_the_third_unseen_one() {
    let mut target = at_step_1();
    assert!(is_given(&mut target, 2, 0), "in work");
    assert!(is_given(&mut target, 3, 0), "may be taken at any time");
    // 2, 3 and 4 would be answered, and 4 names 3 and 2: nothing would name 1.
    assert!(!is_given(&mut target, 4, 0));
    assert!(is_given(&mut target, 5, 1));
    assert!(is_given(&mut target, 6, 1), "replaces one");
}

#[test]
fn an_answer_replaced_before_it_was_read_counts() {
    let mut target = at_step_1();
    assert!(is_given(&mut target, 2, 1));
    assert!(is_given(&mut target, 3, 1));
    target.say(&command_after(3, &[2, 1]), &[0.0]);
    // Step 1 was seen, but for step 2 that is unknown.
    assert!(!is_given(&mut target, 4, 1));
    assert!(is_given(&mut target, 5, 2));
}

#[test]
fn a_sample_is_never_repeated_in_real_time() {
    let (mut desk, mut bytes) = (DeskEnd::new(true, BEAT_NS), Vec::new());
    desk.say(&sample(3), &[0.0]);
    desk.packet(1, &mut bytes);
    assert!(Packet::read(&bytes).expect("a packet").frame.is_some());
    desk.packet(2 + BEAT_NS, &mut bytes);
    assert!(Packet::read(&bytes).expect("a packet").frame.is_none());
}

#[test]
fn a_repeated_frame_gets_the_stored_answer_without_a_step_of_the_law() {
    let (mut desk, mut target) = (DeskEnd::new(false, BEAT_NS), TargetEnd::new(false));
    let mut bytes = Vec::new();
    let read = |bytes: &[u8]| Packet::read(bytes).expect("a packet");
    desk.say(&sample(0), &[1.0]);
    desk.packet(1, &mut bytes);
    let first = bytes.clone();
    let frame = target.take(read(&first)).expect("given to the controller");
    assert_eq!(frame.values, [1.0]);
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
fn a_sample_is_repeated_only_in_lockstep_and_an_end_always() {
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
fn confirmations_of_unsent_frames_are_ignored() {
    let (mut desk, mut bytes) = (DeskEnd::new(false, BEAT_NS), Vec::new());
    desk.say(&sample(0), &[0.0]);
    desk.packet(1, &mut bytes);
    let lie = Packet {
        received: u64::MAX,
        frame: None,
    };
    assert!(desk.take(lie, 2).is_none());
    assert!(desk.awaits_answer());
}
