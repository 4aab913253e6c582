//! Every interleaving of a plant, its controllers and their faults, up to a bound.
//!
//! The machines are driven as by the plant's engine and the controller's runner, in a world where frames get lost or
//! are delivered twice, processes die or stall, and other controllers take over. Every state reachable from the start
//! is visited once. Each action is checked against the invariants, and at the end every state is checked to have a path
//! to an end.

mod moves;
mod world;

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use super::*;
use moves::Move;
use world::{Key, World};

/// Maximum number of each fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Bound {
    /// Lost frames.
    losses: u8,
    /// Frames delivered twice.
    repeats: u8,
    /// Processes killed or stopped.
    deaths: u8,
    /// Waits that end although the other side is alive.
    timeouts: u8,
    /// Requests for another controller.
    swaps: u8,
}

/// Counts of explored states.
#[derive(Debug, Default)]
struct Explored {
    states: usize,
    moves: usize,
    /// States that ended with every step executed.
    completed: usize,
    /// States that ended early, with a reason.
    aborted: usize,
}

/// States visited so far, and the moves between them.
struct Graph {
    worlds: Vec<World>,
    numbers: HashMap<Key, usize>,
    /// For each state, its first predecessor and the move from there.
    origins: Vec<Option<(usize, Move)>>,
    /// For each state, all its predecessors.
    before: Vec<Vec<usize>>,
    explored: Explored,
}

impl Graph {
    fn of(start: World) -> Self {
        Self {
            numbers: HashMap::from([(start.key(), 0)]),
            worlds: vec![start],
            origins: vec![None],
            before: vec![vec![]],
            explored: Explored::default(),
        }
    }

    /// Makes a move; returns `true` if it leads to another state without a fault.
    fn go(&mut self, from: usize, happens: Move) -> Result<bool, String> {
        let next = self.worlds[from].after(happens);
        let next = next.map_err(|wrong| format!("{wrong}\n{}", self.path(from, happens)))?;
        self.explored.moves += 1;
        let after = match self.numbers.entry(next.key()) {
            Entry::Occupied(known) => *known.get(),
            Entry::Vacant(free) => {
                free.insert(self.worlds.len());
                self.worlds.push(next);
                self.origins.push(Some((from, happens)));
                self.before.push(vec![]);
                self.worlds.len() - 1
            }
        };
        self.before[after].push(from);
        Ok(after != from && !happens.only_breaks())
    }

    /// Lists the moves that led to a state.
    fn path(&self, mut number: usize, last: Move) -> String {
        let mut moves = vec![format!("{last:?}")];
        while let Some((from, happens)) = self.origins[number] {
            moves.push(format!("{happens:?}"));
            number = from;
        }
        moves.reverse();
        moves.join(", ")
    }

    /// Returns a state from which no end can be reached.
    fn stuck(&self, mut ends: Vec<usize>) -> Option<usize> {
        let mut is_known = vec![false; self.worlds.len()];
        while let Some(number) = ends.pop() {
            if !std::mem::replace(&mut is_known[number], true) {
                ends.extend(&self.before[number]);
            }
        }
        is_known.iter().position(|one| !one)
    }
}

/// Visits every reachable state.
fn explore(start: World) -> Result<Explored, String> {
    let mut graph = Graph::of(start);
    let mut ends = Vec::new();
    let mut number = 0;
    while number < graph.worlds.len() {
        let world = &graph.worlds[number];
        if world.is_over() {
            ends.push(number);
            match &world.end {
                Some(Ok(())) => graph.explored.completed += 1,
                _ => graph.explored.aborted += 1,
            }
        }
        let (moves, at_last) = world.moves();
        let mut goes_on = false;
        for happens in moves {
            goes_on |= graph.go(number, happens)?;
        }
        // Waits end where nothing else can make progress.
        if !goes_on {
            for happens in at_last {
                graph.go(number, happens)?;
            }
        }
        number += 1;
    }
    if let Some(stuck) = graph.stuck(ends) {
        let how =
            graph.origins[stuck].map_or_else(String::new, |(from, how)| graph.path(from, how));
        return Err(format!(
            "no end can be reached: {:?}\n{how}",
            graph.worlds[stuck]
        ));
    }
    graph.explored.states = graph.worlds.len();
    Ok(graph.explored)
}

/// Combinations of all kinds of fault, and many instances of the worst kinds.
const BOUNDS: [Bound; 3] = [
    Bound {
        losses: 1,
        repeats: 1,
        deaths: 1,
        timeouts: 1,
        swaps: 0,
    },
    Bound {
        losses: 0,
        repeats: 1,
        deaths: 1,
        timeouts: 1,
        swaps: 1,
    },
    Bound {
        losses: 0,
        repeats: 0,
        deaths: 3,
        timeouts: 2,
        swaps: 1,
    },
];

/// Explores every policy and kind of clock within these bounds.
fn explore_all(steps: u64, bounds: &[Bound]) {
    let (mut states, mut moves) = (0, 0);
    for policy in OnLoss::ALL {
        for against_clock in [false, true] {
            for bound in bounds {
                let explored = explore(World::new(steps, policy, against_clock, *bound));
                let explored = explored.unwrap_or_else(|wrong| {
                    panic!("{policy:?}, in real time: {against_clock}, {bound:?}: {wrong}")
                });
                assert!(
                    explored.completed > 0 && explored.aborted > 0,
                    "{explored:?}"
                );
                states += explored.states;
                moves += explored.moves;
            }
        }
    }
    println!("{states} states, {moves} transitions");
}

#[test]
fn no_step_is_executed_twice_or_on_a_stale_command_and_every_run_ends() {
    let none = Bound {
        losses: 0,
        repeats: 0,
        deaths: 0,
        timeouts: 0,
        swaps: 0,
    };
    let bounds = [
        Bound {
            losses: 1,
            repeats: 1,
            deaths: 1,
            ..none
        },
        Bound {
            deaths: 1,
            timeouts: 1,
            swaps: 1,
            ..none
        },
        Bound { deaths: 2, ..none },
    ];
    explore_all(2, &bounds);
}

#[test]
#[ignore = "takes minutes and gigabytes; run it after a change of the machines"]
fn every_interleaving_completes_within_wider_bounds() {
    explore_all(3, &BOUNDS);
}

#[test]
fn every_interleaving_of_repeats_and_handovers_completes() {
    for against_clock in [false, true] {
        let harmless = Bound {
            losses: 0,
            repeats: 2,
            deaths: 0,
            timeouts: 0,
            swaps: 1,
        };
        let explored = explore(World::new(2, OnLoss::Abort, against_clock, harmless));
        let explored = explored.expect("right");
        assert_eq!(explored.aborted, 0, "{explored:?}");
        assert!(explored.completed > 0);
    }
}
