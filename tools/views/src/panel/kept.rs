//! Answers to a page that looks back at a session: from what its panel has kept.
//!
//! The newest steps are kept one by one, earlier ones as the least and the greatest values of stretches, which are the
//! longer the older they are. An answer states their length. Never reads a file.

use tungstenite::Message;

use super::message::ClientMessage;
use super::reading::{At, Figures, Measured, Reading, Sums, widen};
use crate::monitor::history::{History, Range};
use crate::monitor::model::Model;

/// Answers a request; `None` before the first record, and for a request about nothing that is kept.
pub(super) fn answer(model: &Model, message: &ClientMessage) -> Option<Message> {
    let newest = model.seen()?;
    match message {
        ClientMessage::Read {
            number,
            from,
            to,
            most,
            signals,
            ..
        } => {
            let span = [*from.min(&newest), *to.min(&newest)];
            let shift = shift(span, newest, *most);
            let reading = read(model, signals, span, shift);
            Some(reading.encode(*number, false).into())
        }
        ClientMessage::Measure {
            number,
            from,
            to,
            signals,
            ..
        } => {
            let span = [*from.min(&newest), *to.min(&newest)];
            let measured = measure(model, signals, span, newest);
            Some(measured.json(*number, false).to_string().into())
        }
        _ => None,
    }
}

/// Returns the length of the stretches, as a power of two, of which the part of the run has at most so many, and which
/// are still kept.
fn shift([from, to]: [u64; 2], newest: u64, most: u64) -> u32 {
    let needed = (0..u64::BITS).find(|shift| (to >> shift) - (from >> shift) < most);
    let kept = History::kept_shift(newest - from);
    needed.unwrap_or(0).max(kept)
}

/// Returns the history of each of these signals.
fn histories<'a>(
    model: &'a Model,
    signals: &'a [usize],
) -> impl Iterator<Item = (usize, &'a History)> {
    let all: Vec<_> = model.histories().collect();
    let known = signals.iter().filter_map(move |index| {
        let (_, history) = all.get(*index)?;
        Some((*index, *history))
    });
    known.collect::<Vec<_>>().into_iter()
}

fn read(model: &Model, signals: &[usize], [from, to]: [u64; 2], shift: u32) -> Reading {
    let first = from >> shift;
    let count = (to >> shift) - first + 1;
    let signals = histories(model, signals).map(|(index, history)| {
        let ranges = history.stretches(first, count, shift);
        let ends = ranges.map(|range| range.map_or([f64::NAN; 2], |one| [one.min, one.max]));
        (index, ends.collect())
    });
    Reading {
        first: first << shift,
        length: 1 << shift,
        count: count as usize,
        signals: signals.collect(),
    }
}

/// Returns the value of a step, or between which values it is where the step itself is not kept any more.
fn at(history: &History, step: u64, newest: u64) -> At {
    let shift = History::kept_shift(newest - step);
    match history.stretches(step >> shift, 1, shift).next().flatten() {
        None => At::Exact(f64::NAN),
        Some(Range { min, max }) if min == max => At::Exact(min),
        Some(Range { min, max }) => At::Between([min, max]),
    }
}

fn measure(model: &Model, signals: &[usize], [from, to]: [u64; 2], newest: u64) -> Measured {
    let reading = read(
        model,
        signals,
        [from, to],
        shift([from, to], newest, u64::MAX),
    );
    let both = reading.signals.iter().zip(histories(model, signals));
    let signals = both.map(|((index, stretches), (_, history))| {
        if reading.length == 1 {
            let mut sums = Sums::default();
            for (step, [value, _]) in (from..).zip(stretches) {
                sums.take(*value, [step == from, step == to]);
            }
            return sums.figures(*index);
        }
        let mut ends = [f64::NAN; 2];
        for value in stretches.as_flattened() {
            widen(&mut ends, *value);
        }
        Figures {
            signal: *index,
            at: [from, to].map(|step| at(history, step, newest)),
            mean: f64::NAN,
            rms: f64::NAN,
            least: ends[0],
            greatest: ends[1],
            count: 0,
        }
    });
    Measured {
        from,
        to,
        length: reading.length,
        signals: signals.collect(),
    }
}
