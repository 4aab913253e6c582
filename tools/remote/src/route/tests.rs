//! Both routes and both ends of the exchange over simulated wires: datagrams that are cut in one direction, in both, or
//! by size, and a channel that always works, faster or slower than the datagrams. Time is a counter.

use std::collections::VecDeque;

use shared_types::frame::{FrameKind, Header};
use shared_types::time::Step;

use super::*;
use crate::exchange::{BEAT_NS, DeskEnd, TargetEnd};
use crate::packet::Packet;

/// Time step of the simulation in ns.
const TICK_NS: u64 = 100_000;
const SECOND_NS: u64 = 1_000_000_000;
/// Interval between checks of the route, as in the bridge.
const LOOK_NS: u64 = 250_000_000;

/// One direction of a carrier: packets with their arrival times.
struct Line {
    delay_ns: u64,
    under_way: VecDeque<(u64, Vec<u8>)>,
}

impl Line {
    fn new(delay_ns: u64) -> Self {
        Self {
            delay_ns,
            under_way: VecDeque::new(),
        }
    }

    fn send(&mut self, packet: &[u8], now_ns: u64) {
        self.under_way
            .push_back((now_ns + self.delay_ns, packet.to_vec()));
    }

    fn arrived(&mut self, now_ns: u64) -> Option<Packet> {
        let place = self.under_way.iter().position(|(at, _)| *at <= now_ns)?;
        let (_, bytes) = self.under_way.remove(place)?;
        Some(Packet::read(&bytes).expect("a packet"))
    }
}

/// Selection of datagrams that a wire drops.
#[derive(Clone, Copy, Debug, Default)]
struct Cut {
    to_target: bool,
    to_desk: bool,
    /// `true` to drop only datagrams with a frame, as where fragments are dropped.
    frames_only: bool,
}

impl Cut {
    const BOTH: Self = Self {
        to_target: true,
        to_desk: true,
        frames_only: false,
    };

    fn drops(self, packet: &[u8], is_cut: bool) -> bool {
        let has_frame = Packet::read(packet).is_some_and(|packet| packet.frame.is_some());
        is_cut && (has_frame || !self.frames_only)
    }
}

struct World {
    now_ns: u64,
    cut: Cut,
    /// Datagram wires to the target and to the desk.
    datagrams: [Line; 2],
    channel: [Line; 2],
    desk: DeskEnd,
    target: TargetEnd,
    desk_route: DeskRoute,
    target_route: TargetRoute,
    look_ns: u64,
    /// Computation time of the controller, and the time at which its answer to a step is ready.
    work_ns: u64,
    at_work: Option<(u64, u64)>,
    /// Pause between an answer and the next sample, and the time of that sample.
    pause_ns: u64,
    next_ns: Option<u64>,
    step: u64,
    /// Number of answers by datagram, and number of those through the channel.
    by_datagram: u64,
    by_channel: u64,
    notices: Vec<Notice>,
}

impl World {
    fn new(datagram_ns: u64, channel_ns: u64) -> Self {
        Self {
            now_ns: 5 * SECOND_NS,
            cut: Cut::default(),
            datagrams: [datagram_ns, datagram_ns].map(Line::new),
            channel: [channel_ns, channel_ns].map(Line::new),
            desk: DeskEnd::new(false, BEAT_NS),
            target: TargetEnd::new(false),
            desk_route: DeskRoute::new(true),
            target_route: TargetRoute::new(),
            look_ns: 0,
            work_ns: TICK_NS,
            at_work: None,
            pause_ns: 0,
            next_ns: Some(0),
            step: 0,
            by_datagram: 0,
            by_channel: 0,
            notices: Vec::new(),
        }
    }

    /// Simulates a period; returns the numbers of answers by datagram and through the channel.
    fn run(&mut self, seconds: u64) -> (u64, u64) {
        let before = (self.by_datagram, self.by_channel);
        let end_ns = self.now_ns + seconds * SECOND_NS;
        while self.now_ns < end_ns {
            self.now_ns += TICK_NS;
            self.plant();
            self.desk_hears();
            self.desk_speaks();
            self.target_hears();
            self.controller();
        }
        (self.by_datagram - before.0, self.by_channel - before.1)
    }

    fn plant(&mut self) {
        if self.next_ns.is_some_and(|at| at <= self.now_ns) {
            self.next_ns = None;
            self.step += 1;
            let header = Header {
                count: 1,
                ..Header::new(FrameKind::Sample, Step(self.step))
            };
            self.desk.say(&header, &[0.5]);
            self.desk_route.sent_sample(self.now_ns);
        }
    }

    fn desk_hears(&mut self) {
        while let Some(packet) = self.datagrams[1].arrived(self.now_ns) {
            let has_frame = packet.frame.is_some();
            let notice = self.desk_route.received_datagram(has_frame, self.now_ns);
            self.notices.extend(notice);
            self.desk_takes(packet, Carrier::Datagram);
        }
        while let Some(packet) = self.channel[1].arrived(self.now_ns) {
            self.desk_takes(packet, Carrier::Channel);
        }
    }

    fn desk_takes(&mut self, packet: Packet, carrier: Carrier) {
        if self.desk.take(packet, self.now_ns).is_some() {
            match carrier {
                Carrier::Datagram => self.by_datagram += 1,
                Carrier::Channel => self.by_channel += 1,
            }
            self.next_ns = Some(self.now_ns + self.pause_ns);
        }
    }

    fn desk_speaks(&mut self) {
        if self.now_ns >= self.look_ns {
            self.look_ns = self.now_ns + LOOK_NS;
            self.notices.extend(self.desk_route.look(self.now_ns));
        }
        if self.now_ns >= self.desk.due_ns() {
            let mut bytes = Vec::new();
            self.desk.packet(self.now_ns, &mut bytes);
            let carriers = self.desk_route.carriers();
            self.send(0, carriers, &bytes);
        }
    }

    fn target_hears(&mut self) {
        for carrier in [Carrier::Datagram, Carrier::Channel] {
            let lines = match carrier {
                Carrier::Datagram => &mut self.datagrams,
                Carrier::Channel => &mut self.channel,
            };
            let Some(packet) = lines[0].arrived(self.now_ns) else {
                continue;
            };
            let number = packet.frame.as_ref().map(|frame| frame.number);
            self.target_route.received(carrier, number, self.now_ns);
            match self.target.take(packet) {
                Some(frame) => self.at_work = Some((frame.header.step, self.now_ns + self.work_ns)),
                None => {
                    let has_frame = self.target.has_unheard();
                    let carriers = self.target_route.of_reply(carrier, has_frame, self.now_ns);
                    self.target_speaks(carriers);
                }
            }
        }
    }

    fn controller(&mut self) {
        let Some((step, _)) = self.at_work.filter(|(_, at)| *at <= self.now_ns) else {
            return;
        };
        self.at_work = None;
        let header = Header {
            count: 1,
            ..Header::new(FrameKind::Command, Step(step))
        };
        self.target.say(&header, &[1.5]);
        let carriers = (self.target_route).of_answer(self.target.received(), self.now_ns);
        self.target_speaks(carriers);
    }

    fn target_speaks(&mut self, carriers: Carriers) {
        let mut bytes = Vec::new();
        self.target.packet(&mut bytes);
        self.send(1, carriers, &bytes);
    }

    fn send(&mut self, direction: usize, carriers: Carriers, bytes: &[u8]) {
        let is_cut = [self.cut.to_target, self.cut.to_desk][direction];
        if carriers.datagram && !self.cut.drops(bytes, is_cut) {
            self.datagrams[direction].send(bytes, self.now_ns);
        }
        if carriers.channel {
            self.channel[direction].send(bytes, self.now_ns);
        }
    }
}

/// Delays of a datagram and of the channel in ticks: either one slower, or both equal.
const DELAYS: [(u64, u64); 5] = [(1, 1), (1, 5), (5, 1), (3, 40), (40, 3)];

fn worlds() -> impl Iterator<Item = World> {
    DELAYS
        .into_iter()
        .map(|(datagram, channel)| World::new(datagram * TICK_NS, channel * TICK_NS))
}

#[test]
fn on_a_clean_wire_all_answers_but_the_first_arrive_as_datagrams() {
    for (mut world, delays) in worlds().zip(DELAYS) {
        let (_, first) = world.run(1);
        assert!(first <= 20, "{delays:?}: {first}");
        let (by_datagram, by_channel) = world.run(20);
        assert!(by_datagram > 1000, "{delays:?}: {by_datagram}");
        assert_eq!(by_channel, 0, "{delays:?}");
        assert_eq!(world.notices, [], "{delays:?}");
    }
}

#[test]
fn overtaking_copies_do_not_move_answers_to_the_channel() {
    for (ahead, behind) in [(0, 3), (3, 0), (0, 50), (50, 0)] {
        let mut world = World::new(2 * TICK_NS, 2 * TICK_NS);
        world.run(1);
        // Every second, a few packets of one carrier or the other are late.
        for round in 0..10 {
            let late = |line: &mut Line, ticks: u64| line.delay_ns = (2 + ticks) * TICK_NS;
            for line in &mut world.datagrams {
                late(line, if round % 2 == 0 { ahead } else { behind });
            }
            for line in &mut world.channel {
                late(line, if round % 2 == 0 { behind } else { ahead });
            }
            world.run(1);
        }
        assert!(
            world.by_channel <= 40,
            "{ahead} {behind}: {}",
            world.by_channel
        );
        assert_eq!(world.notices, [], "{ahead} {behind}");
    }
}

#[test]
fn a_cut_costs_a_second_and_ends_with_the_cut() {
    for (mut world, delays) in worlds().zip(DELAYS) {
        world.run(2);
        world.cut = Cut::BOTH;
        let (_, by_channel) = world.run(2);
        assert!(by_channel > 50, "{delays:?}: {by_channel}");
        let (by_datagram, by_channel) = world.run(5);
        assert_eq!(by_datagram, 0, "{delays:?}");
        assert!(by_channel > 400, "{delays:?}: {by_channel}");
        assert_eq!(world.notices, [Notice::Lost], "{delays:?}");
        world.cut = Cut::default();
        world.run(1);
        let (by_datagram, by_channel) = world.run(5);
        assert_eq!(by_channel, 0, "{delays:?}");
        assert!(by_datagram > 400, "{delays:?}: {by_datagram}");
        assert_eq!(
            world.notices,
            [Notice::Lost, Notice::Restored],
            "{delays:?}"
        );
    }
}

#[test]
fn a_wire_without_datagrams_loses_no_answer() {
    for (mut world, delays) in worlds().zip(DELAYS) {
        world.cut = Cut::BOTH;
        let (by_datagram, by_channel) = world.run(10);
        assert_eq!(by_datagram, 0, "{delays:?}");
        assert!(by_channel > 1000, "{delays:?}: {by_channel}");
        assert_eq!(world.notices, [Notice::Lost], "{delays:?}");
    }
}

#[test]
fn datagrams_that_arrive_in_one_direction_only_do_not_stall_the_run() {
    let directions = [
        Cut {
            to_target: true,
            ..Cut::default()
        },
        Cut {
            to_desk: true,
            ..Cut::default()
        },
    ];
    for cut in directions {
        for frames_only in [false, true] {
            for (mut world, delays) in worlds().zip(DELAYS) {
                let cut = Cut { frames_only, ..cut };
                // From the start, and after a time without a cut.
                for before_s in [0, 2] {
                    world.run(before_s);
                    world.cut = cut;
                    world.run(2);
                    let (by_datagram, by_channel) = world.run(10);
                    let case = format!("{cut:?} {delays:?}, after {before_s} s");
                    assert_eq!(by_datagram, 0, "{case}");
                    assert!(by_channel > 1000, "{case}: {by_channel}");
                    world.cut = Cut::default();
                    world.run(1);
                    let (_, by_channel) = world.run(2);
                    assert_eq!(by_channel, 0, "{case}");
                }
            }
        }
    }
}

#[test]
fn a_slow_controller_or_a_pause_between_steps_raises_no_doubt() {
    for (work_ns, pause_ns) in [(3 * SECOND_NS, 0), (0, 3 * SECOND_NS)] {
        for (mut world, delays) in worlds().zip(DELAYS) {
            world.run(1);
            (world.work_ns, world.pause_ns) = (work_ns, pause_ns);
            world.run(1);
            let (by_datagram, by_channel) = world.run(30);
            assert!(by_datagram >= 8, "{delays:?}: {by_datagram}");
            assert_eq!(by_channel, 0, "{delays:?}");
            assert_eq!(world.notices, [], "{delays:?}");
        }
    }
}

#[test]
fn notices_of_an_intermittent_wire_are_rare() {
    let mut world = World::new(TICK_NS, 2 * TICK_NS);
    for _ in 0..30 {
        world.cut = Cut::BOTH;
        world.run(2);
        world.cut = Cut::default();
        world.run(1);
    }
    // 90 s: two losses, each restored.
    let pair = [Notice::Lost, Notice::Restored];
    assert_eq!(world.notices, [pair, pair].concat());
}
