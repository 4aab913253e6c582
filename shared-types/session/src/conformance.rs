//! The links and record streams of this package, and broken ones that must fail.

use std::collections::BTreeSet;
use std::time::Duration;

use crate::link::iceoryx::IceoryxLink;
use crate::session::Session;
use crate::stream::{IceoryxSink, IceoryxSource};
use shared_types::conformance::{Sentence, WATCHDOG, link, stream};
use shared_types::link::in_process::{self, InProcessLink};
use shared_types::stream::Backpressure;
use shared_types::stream::in_process::{InProcessSink, InProcessSource, pair};

/// Two mailboxes.
struct InProcess {
    controller: InProcessLink,
    plant: Option<InProcessLink>,
}

impl link::Fixture for InProcess {
    type Link = InProcessLink;

    fn new() -> Self {
        let (plant, controller) = in_process::pair();
        let plant = Some(plant);
        Self { controller, plant }
    }

    fn plant(&mut self) -> InProcessLink {
        self.plant.take().expect("a plant is made once")
    }

    fn controller(&mut self, _epoch: u32) -> InProcessLink {
        self.controller.another()
    }
}

/// A session in shared memory.
struct Iceoryx(Session);

impl link::Fixture for Iceoryx {
    type Link = IceoryxLink;

    fn new() -> Self {
        Self(Session::create(None).expect("a session"))
    }

    fn plant(&mut self) -> IceoryxLink {
        IceoryxLink::create(self.0.info()).expect("creates")
    }

    fn controller(&mut self, epoch: u32) -> IceoryxLink {
        IceoryxLink::open(self.0.info(), epoch).expect("opens")
    }

    fn controller_elsewhere(&mut self) -> Option<link::Opener<IceoryxLink>> {
        let info = self.0.info().clone();
        Some(Box::new(move || {
            IceoryxLink::open(&info, 1).expect("opens")
        }))
    }

    fn kill(&mut self, end: IceoryxLink) {
        std::mem::forget(end); // nobody runs what a killed process would have run at its end
    }
}

impl stream::Fixture for InProcess {
    type Sink = InProcessSink;
    type Source = InProcessSource;

    fn new() -> Self {
        link::Fixture::new()
    }

    fn connect(
        &mut self,
    ) -> (
        InProcessSink,
        impl FnOnce() -> InProcessSource + Send + 'static,
    ) {
        let (sink, source) = pair();
        (sink, || source)
    }
}

impl stream::Fixture for Iceoryx {
    type Sink = IceoryxSink;
    type Source = IceoryxSource;

    fn new() -> Self {
        link::Fixture::new()
    }

    fn connect(&mut self) -> (IceoryxSink, impl FnOnce() -> IceoryxSource + Send + 'static) {
        let info = self.0.info().clone();
        let sink = IceoryxSink::create(&info, Backpressure::Always).expect("creates");
        (sink, move || {
            IceoryxSource::open(&info, true).expect("opens")
        })
    }
}

mod link_in_process {
    shared_types::conformance!(link: super::InProcess);
}

mod link_over_iceoryx2 {
    shared_types::conformance!(link: super::Iceoryx);
}

mod stream_in_process {
    shared_types::conformance!(stream: super::InProcess);
}

mod stream_over_iceoryx2 {
    shared_types::conformance!(stream: super::Iceoryx);
}

#[test]
fn a_hanging_property_is_named_within_its_limit() {
    let name = "a_link_answers";
    let check = || hang();
    let reason = Sentence { name, check }.holds(Duration::from_millis(50));
    let reason = reason.expect_err("it hangs");
    assert!(reason.contains("`a_link_answers` hangs"), "{reason}");
}

fn hang() {
    loop {
        std::thread::park();
    }
}

/// Checks that none of these properties holds.
fn assert_broken(sentences: &[Sentence], names: &[&str]) {
    for name in names {
        let mut sentences = sentences.iter();
        let sentence = sentences.find(|sentence| sentence.name == *name);
        let result = sentence.expect("a sentence").holds(Duration::from_secs(5));
        assert!(result.is_err(), "`{name}` finds nothing wrong");
    }
}

/// Makes a test for each flaw of a `Broken` fixture, which must violate exactly these properties, and one for all flaws
/// together.
macro_rules! flaws {
    ($($test:ident: $flaw:ident over $fixture:ty => $($sentence:ident),+;)+) => {
        /// Flaw of an implementation.
        #[derive(Clone, Copy)]
        enum Flaw {
            None,
            $($flaw),+
        }

        $(
            #[test]
            fn $test() {
                let sentences = sentences::<Broken<$fixture, { Flaw::$flaw as usize }>>();
                crate::conformance::assert_broken(&sentences, &[$(stringify!($sentence)),+]);
            }
        )+

        #[test]
        fn every_property_holds_without_a_mutation_and_is_violated_by_one() {
            let sentences = sentences::<Broken<InProcess, { Flaw::None as usize }>>();
            let broken = [$($(stringify!($sentence)),+),+];
            crate::conformance::assert_each_can_fail(&sentences, &broken);
        }
    };
}

fn assert_each_can_fail(without_flaw: &[Sentence], broken: &[&str]) {
    for sentence in without_flaw {
        assert_eq!(sentence.holds(WATCHDOG), Ok(()));
    }
    let names: BTreeSet<&str> = without_flaw.iter().map(|sentence| sentence.name).collect();
    assert_eq!(names, broken.iter().copied().collect());
}

mod broken_links;
mod broken_streams;
