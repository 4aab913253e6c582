//! The simplest possible fault kinds.

use std::sync::atomic::{AtomicUsize, Ordering};

use shared_types::describe::{ActsOn, Invalid};
use shared_types::directive::Directive;
use shared_types::random::RandomStream;
use shared_types::table::Empty;

use crate::faults::kind::{FaultKind, FaultKindEntry, Moment, Passage, Reading, Setup};

/// Lists all of them.
pub(super) fn all() -> Vec<FaultKindEntry> {
    vec![
        FaultKindEntry::of::<Plus>(),
        FaultKindEntry::of::<Times>(),
        FaultKindEntry::of::<Gone>(),
        FaultKindEntry::of::<Infinite>(),
        FaultKindEntry::of::<NoNumber>(),
        FaultKindEntry::of::<Dice>(),
        FaultKindEntry::of::<Before>(),
        FaultKindEntry::of::<Lost>(),
        FaultKindEntry::of::<Late>(),
        FaultKindEntry::of::<Broken>(),
        FaultKindEntry::of::<Busy>(),
        FaultKindEntry::of::<Jump>(),
        FaultKindEntry::of::<Counted>(),
    ]
}

shared_types::table! {
    /// The one parameter of most kinds here.
    struct By {
        /// Size of the addition.
        by: "target",
    }
}

/// Declares a kind of fault with the parameter `by`, or without parameters.
macro_rules! kind {
    ($kind:ident, $name:literal, $acts_on:ident, $parameters:ident, $method:ident, $body:expr, $at:ty $(, $result:ty)?) => {
        struct $kind($parameters, Option<RandomStream>);

        impl FaultKind for $kind {
            const NAME: &'static str = $name;
            const SUMMARY: &'static str = $name;
            const EQUATION: &'static str = $name;
            const ACTS_ON: ActsOn = ActsOn::$acts_on;
            type Parameters = $parameters;

            fn start(setup: &Setup<'_, $parameters>) -> Result<Self, Invalid> {
                Ok(Self(setup.parameters, None))
            }

            fn hold(&mut self, random: RandomStream) {
                self.1 = Some(random);
            }

            fn $method(&mut self, at: &Moment, what: $at) $(-> $result)? {
                let act: fn(&mut Self, &Moment, $at) $(-> $result)? = $body;
                act(self, at, what)
            }
        }
    };
}

kind!(
    Plus,
    "plus",
    Numbers,
    By,
    number,
    |this, at, x| {
        Reading {
            value: x.value + this.0.by * at.gain,
            ..x
        }
    },
    Reading,
    Reading
);
kind!(
    Times,
    "times",
    Numbers,
    By,
    number,
    |this, _, x| {
        Reading {
            value: x.value * this.0.by,
            ..x
        }
    },
    Reading,
    Reading
);
kind!(
    Gone,
    "gone",
    Signals,
    Empty,
    number,
    |_, at, x| {
        Reading {
            valid: x.valid && at.gain == 0.0,
            ..x
        }
    },
    Reading,
    Reading
);
kind!(
    Infinite,
    "infinite",
    Numbers,
    Empty,
    number,
    |_, _, x| {
        Reading {
            value: f64::INFINITY,
            ..x
        }
    },
    Reading,
    Reading
);
kind!(
    NoNumber,
    "no-number",
    Numbers,
    Empty,
    number,
    |_, _, x| {
        Reading {
            value: f64::NAN,
            ..x
        }
    },
    Reading,
    Reading
);
kind!(
    Dice,
    "dice",
    Signals,
    Empty,
    number,
    |this, _, x| {
        let drawn = this.1.as_mut().map_or(f64::NAN, RandomStream::uniform);
        Reading { value: drawn, ..x }
    },
    Reading,
    Reading
);
kind!(
    Lost,
    "lost",
    Links,
    Empty,
    message,
    |_, at, passage| {
        if at.gain != 0.0 {
            passage.copies = [None; Passage::MOST_COPIES];
        }
    },
    &mut Passage
);
kind!(
    Late,
    "late",
    Links,
    By,
    message,
    |this, at, passage| {
        for copy in &mut passage.copies {
            *copy = copy.map(|late| late + (this.0.by * at.gain) as u32);
        }
    },
    &mut Passage
);
kind!(
    Broken,
    "broken",
    Links,
    Empty,
    message,
    |_, at, passage| {
        if at.gain != 0.0 {
            passage.flips[passage.flipped] = passage.bits - 1;
            passage.flipped += 1;
        }
    },
    &mut Passage
);
kind!(
    Busy,
    "busy",
    Sides,
    By,
    timing,
    |this, at, directive| {
        directive.busy_ns += (this.0.by * at.gain) as u32;
    },
    &mut Directive
);
kind!(
    Jump,
    "jump",
    Controller,
    By,
    timing,
    |this, at, directive| {
        directive.late_steps += (this.0.by * at.gain) as u32;
    },
    &mut Directive
);

/// Shows the previous step's reading, including its validity.
struct Before(Option<Reading>);

impl FaultKind for Before {
    const NAME: &'static str = "before";
    const SUMMARY: &'static str = "before";
    const EQUATION: &'static str = "before";
    const ACTS_ON: ActsOn = ActsOn::Signals;
    type Parameters = Empty;

    fn start(_: &Setup<'_, Empty>) -> Result<Self, Invalid> {
        Ok(Self(None))
    }

    fn number(&mut self, _: &Moment, x: Reading) -> Reading {
        self.0.replace(x).unwrap_or(x)
    }
}

/// Number of existing faults of the kind [`Counted`].
pub(super) static COUNTED: AtomicUsize = AtomicUsize::new(0);

/// Changes nothing, but is counted while it exists; for one test only.
struct Counted;

impl FaultKind for Counted {
    const NAME: &'static str = "counted";
    const SUMMARY: &'static str = "counted";
    const EQUATION: &'static str = "counted";
    const ACTS_ON: ActsOn = ActsOn::Links;
    type Parameters = Empty;

    fn start(_: &Setup<'_, Empty>) -> Result<Self, Invalid> {
        COUNTED.fetch_add(1, Ordering::Relaxed);
        Ok(Self)
    }

    fn message(&mut self, _: &Moment, _: &mut Passage) {}
}

impl Drop for Counted {
    fn drop(&mut self) {
        COUNTED.fetch_sub(1, Ordering::Relaxed);
    }
}
