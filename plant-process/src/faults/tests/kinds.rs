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

/// Declares kinds of faults: a row has the type, its name, the class of its targets, its parameters, and the method in
/// which it acts.
macro_rules! kinds {
    ($($kind:ident $name:literal $acts_on:ident $parameters:ident
        $method:ident($this:pat_param, $at:pat_param, $what:ident: $type:ty) $(-> $result:ty)? $body:block)*) => {$(
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

            fn $method(&mut self, $at: &Moment, $what: $type) $(-> $result)? {
                let $this = self;
                $body
            }
        }
    )*};
}

kinds! {
    Plus "plus" Numbers By number(this, at, x: Reading) -> Reading {
        Reading { value: x.value + this.0.by * at.gain, ..x }
    }
    Times "times" Numbers By number(this, _, x: Reading) -> Reading {
        Reading { value: x.value * this.0.by, ..x }
    }
    Gone "gone" Signals Empty number(_, at, x: Reading) -> Reading {
        Reading { valid: x.valid && at.gain == 0.0, ..x }
    }
    Infinite "infinite" Numbers Empty number(_, _, x: Reading) -> Reading {
        Reading { value: f64::INFINITY, ..x }
    }
    NoNumber "no-number" Numbers Empty number(_, _, x: Reading) -> Reading {
        Reading { value: f64::NAN, ..x }
    }
    Dice "dice" Signals Empty number(this, _, x: Reading) -> Reading {
        Reading { value: this.1.as_mut().map_or(f64::NAN, RandomStream::uniform), ..x }
    }
    Lost "lost" Links Empty message(_, at, passage: &mut Passage) {
        if at.gain != 0.0 {
            passage.copies = [None; Passage::MOST_COPIES];
        }
    }
    Late "late" Links By message(this, at, passage: &mut Passage) {
        for copy in &mut passage.copies {
            *copy = copy.map(|late| late + (this.0.by * at.gain) as u32);
        }
    }
    Broken "broken" Links Empty message(_, at, passage: &mut Passage) {
        if at.gain != 0.0 {
            passage.flips[passage.flipped] = passage.bits - 1;
            passage.flipped += 1;
        }
    }
    Busy "busy" Sides By timing(this, at, directive: &mut Directive) {
        directive.busy_ns += (this.0.by * at.gain) as u32;
    }
    Jump "jump" Controller By timing(this, at, directive: &mut Directive) {
        directive.late_steps += (this.0.by * at.gain) as u32;
    }
}

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
